//! Pictures of tags: flat plates seen through a lens, by casting rays.
//!
//! Each pixel is the mean of rays on a regular grid within it; the lens is inverted for every ray, so distortion is exact. Then come
//! a Gaussian blur, as every lens has, and noise.

use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use nalgebra::{Vector2, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::cell::Cell;
use crate::detect::GreyPicture;
use crate::geometry::{Intrinsics, Pattern, Pose, TargetGeometry};

/// Rays a pixel along each axis.
const RAYS: usize = 4;
/// Grey of paper, ink, and what is behind.
const PAPER: f64 = 215.0;
const INK: f64 = 28.0;

/// A square plate with a tag on it, in some frame.
#[derive(Clone, Debug)]
pub struct Plate {
    /// The frame it hangs on.
    pub frame: usize,
    /// `frame_from_tag`.
    pub frame_from_tag: Pose,
    /// Edge of the printed pattern, m.
    pub size: f64,
    /// Half the plate's edge, m.
    pub half: f64,
    /// Cells along one side, border included.
    pub cells: usize,
    /// Row by row from the top left: whether the cell is white.
    pub white: Vec<bool>,
}

/// How a picture is spoilt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PictureNoise {
    /// Standard deviation of the blur, px.
    pub blur: f64,
    /// Standard deviation of the noise, grey values.
    pub grey: f64,
    /// Seed.
    pub seed: u64,
}

/// The plates of every tag of a cell.
#[must_use]
pub fn plates(cell: &Cell<'_>) -> Vec<Plate> {
    let mut plates = Vec::new();
    for (target, frame) in cell.layout.targets.iter().zip(&cell.tree.targets) {
        let (TargetGeometry::Tags(faces), Some(Pattern::Tags { dictionary, .. })) = (&target.geometry, &target.pattern)
        else {
            continue;
        };
        for face in faces {
            let (Some(frame_from_tag), Some(white)) = (face.target_from_tag, dictionary.cells(face.id)) else {
                continue;
            };
            let cells = dictionary.cells_per_side();
            let size = face.size * cells as f64 / dictionary.edge_cells() as f64;
            // A white margin of one cell, as every printed tag needs.
            let half = 0.5 * size * (1.0 + 2.0 / cells as f64);
            plates.push(Plate { frame: *frame, frame_from_tag, size, half, cells, white });
        }
    }
    plates
}

/// A picture as a PNG file's bytes.
///
/// # Errors
/// The encoder's own.
pub fn png(picture: &GreyPicture) -> std::io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let (width, height) = (picture.width() as u32, picture.height() as u32);
    PngEncoder::new(&mut bytes)
        .write_image(picture.pixels(), width, height, ExtendedColorType::L8)
        .map_err(std::io::Error::other)?;
    Ok(bytes)
}

/// A plate in the camera's frame, with the part of the picture it can touch.
struct Placed<'a> {
    plate: &'a Plate,
    tag_from_camera: Pose,
    columns: std::ops::Range<usize>,
    rows: std::ops::Range<usize>,
}

/// The picture that a camera takes at a configuration; `None` if the camera has no lens or is not placed.
#[must_use]
pub fn render(
    cell: &Cell<'_>,
    plates: &[Plate],
    camera: usize,
    configuration: u64,
    noise: PictureNoise,
) -> Option<GreyPicture> {
    let intrinsics = cell.layout.cameras[camera].intrinsics.as_ref()?;
    let [width, height] = intrinsics.size().map(|n| n as usize);
    let mut grey: Vec<f64> = (0..width * height).map(|i| backdrop(i % width, i / width)).collect();
    let placed: Vec<Placed<'_>> =
        plates.iter().filter_map(|plate| place(cell, intrinsics, plate, camera, configuration)).collect();
    for row in 0..height {
        let on_row: Vec<&Placed<'_>> = placed.iter().filter(|p| p.rows.contains(&row)).collect();
        if on_row.is_empty() {
            continue;
        }
        for column in 0..width {
            let near: Vec<&Placed<'_>> = on_row.iter().copied().filter(|p| p.columns.contains(&column)).collect();
            if !near.is_empty() {
                grey[row * width + column] = pixel(intrinsics, &near, column, row);
            }
        }
    }
    let mut grey = blur(&grey, width, height, noise.blur);
    let mut random =
        ChaCha8Rng::seed_from_u64(noise.seed ^ configuration.wrapping_mul(0x9e37_79b9) ^ ((camera as u64) << 40));
    for value in &mut grey {
        let draw: f64 = StandardNormal.sample(&mut random);
        *value += noise.grey * draw;
    }
    GreyPicture::new(width, height, grey.into_iter().map(|value| value.round().clamp(0.0, 255.0) as u8).collect())
}

fn place<'a>(
    cell: &Cell<'_>,
    intrinsics: &Intrinsics,
    plate: &'a Plate,
    camera: usize,
    configuration: u64,
) -> Option<Placed<'a>> {
    let camera_from_tag = cell.pose(cell.tree.cameras[camera], plate.frame, configuration)? * plate.frame_from_tag;
    let normal = camera_from_tag.rotation * Vector3::z();
    if normal.dot(&camera_from_tag.translation) >= 0.0 {
        return None;
    }
    let h = plate.half;
    let (mut low, mut high) = (Vector2::repeat(f64::INFINITY), Vector2::repeat(f64::NEG_INFINITY));
    for (x, y) in [(-h, -h), (h, -h), (h, h), (-h, h)] {
        let at = intrinsics.project(&(camera_from_tag * Vector3::new(x, y, 0.0)))?;
        low = low.inf(&at);
        high = high.sup(&at);
    }
    // Edges bend outwards by a few pixels at most.
    let span = |low: f64, high: f64, size: u32| {
        let clamp = |value: f64| value.clamp(0.0, f64::from(size)) as usize;
        clamp(low - 4.0)..clamp(high + 5.0)
    };
    let [width, height] = intrinsics.size();
    Some(Placed {
        plate,
        tag_from_camera: camera_from_tag.inverse(),
        columns: span(low.x, high.x, width),
        rows: span(low.y, high.y, height),
    })
}

/// The mean over the rays of a pixel.
fn pixel(intrinsics: &Intrinsics, near: &[&Placed<'_>], column: usize, row: usize) -> f64 {
    let offset = |i: usize| (i as f64 + 0.5) / RAYS as f64 - 0.5;
    let mut sum = 0.0;
    for j in 0..RAYS {
        for i in 0..RAYS {
            let at = Vector2::new(column as f64 + offset(i), row as f64 + offset(j));
            sum += intrinsics.ray(&at).map_or_else(
                |_| backdrop(column, row),
                |ray| {
                    let hits = near.iter().filter_map(|placed| hit(placed, &ray));
                    hits.min_by(|a, b| a.0.total_cmp(&b.0)).map_or_else(|| backdrop(column, row), |(_, value)| value)
                },
            );
        }
    }
    sum / (RAYS * RAYS) as f64
}

/// Where a ray from the camera meets a plate: distance and grey.
fn hit(placed: &Placed<'_>, ray: &Vector3<f64>) -> Option<(f64, f64)> {
    let origin = placed.tag_from_camera.translation;
    let direction = placed.tag_from_camera.rotation * ray;
    let distance = -origin.z / direction.z;
    // A ray along the plate has an infinite distance or none.
    if !distance.is_finite() || distance <= 0.0 {
        return None;
    }
    let (x, y) = (origin.x + distance * direction.x, origin.y + distance * direction.y);
    let plate = placed.plate;
    if x.abs() > plate.half || y.abs() > plate.half {
        return None;
    }
    let cell = |value: f64| (value / plate.size + 0.5) * plate.cells as f64;
    let (column, row) = (cell(x).floor(), cell(-y).floor());
    let inside = column >= 0.0 && row >= 0.0 && column < plate.cells as f64 && row < plate.cells as f64;
    let white = !inside || plate.white.get(row as usize * plate.cells + column as usize).copied().unwrap_or(true);
    // Light falls off a little across a slanted plate, so that no two faces are alike.
    let light = 0.8 + 0.2 * (-direction.z);
    Some((distance, light * if white { PAPER } else { INK }))
}

/// A workshop out of focus: soft bands of grey.
fn backdrop(column: usize, row: usize) -> f64 {
    let (x, y) = (column as f64, row as f64);
    110.0 + 25.0 * (x / 173.0).sin() * (y / 131.0).cos() + 10.0 * ((x + 0.6 * y) / 47.0).sin()
}

/// A separable Gaussian.
fn blur(grey: &[f64], width: usize, height: usize, sigma: f64) -> Vec<f64> {
    if sigma <= 0.0 {
        return grey.to_vec();
    }
    let reach = (3.0 * sigma).ceil() as i64;
    let weights: Vec<f64> = (-reach..=reach).map(|i| (-0.5 * (i as f64 / sigma).powi(2)).exp()).collect();
    let total: f64 = weights.iter().sum();
    let pass = |from: &[f64], horizontal: bool| -> Vec<f64> {
        let mut to = vec![0.0; from.len()];
        for row in 0..height {
            for column in 0..width {
                let mut sum = 0.0;
                for (weight, i) in weights.iter().zip(-reach..=reach) {
                    let (c, r) =
                        if horizontal { (column as i64 + i, row as i64) } else { (column as i64, row as i64 + i) };
                    let (c, r) = (c.clamp(0, width as i64 - 1) as usize, r.clamp(0, height as i64 - 1) as usize);
                    sum += weight * from[r * width + c];
                }
                to[row * width + column] = sum / total;
            }
        }
        to
    };
    pass(&pass(grey, true), false)
}
