//! Corners as a detector would report them, from truth and noise.

use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::cell::Cell;
use crate::geometry::target::tag_corners;
use crate::geometry::{Feature, Intrinsics, Pose, TargetGeometry};
use crate::recording::CornerRow;

/// How corners are spoilt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CornerNoise {
    /// Standard deviation a coordinate, px.
    pub pixel_sigma: f64,
    /// Seed: the same seed gives the same bits.
    pub seed: u64,
}

/// A corner keeps this far (px) from the picture's edge.
const MARGIN: f64 = 4.0;

/// Every corner that every camera sees at every configuration of the cell's robots. Faces hide nothing but what they carry themselves: a tag seen from
/// behind or at more than 75 degrees is not reported.
#[must_use]
pub fn corners(cell: &Cell<'_>, configurations: &[u64], noise: CornerNoise) -> Vec<CornerRow> {
    let mut random = ChaCha8Rng::seed_from_u64(noise.seed);
    let mut rows = Vec::new();
    for (camera, described) in cell.layout.cameras.iter().enumerate() {
        let Some(intrinsics) = &described.intrinsics else { continue };
        for &configuration in configurations {
            for target in 0..cell.layout.targets.len() {
                let frames = (cell.tree.cameras[camera], cell.tree.targets[target]);
                let Some(camera_from_target) = cell.pose(frames.0, frames.1, configuration) else { continue };
                for (feature, pixel) in visible(cell, intrinsics, &camera_from_target, target) {
                    let mut draw = || -> f64 { StandardNormal.sample(&mut random) };
                    let pixel = [pixel[0] + noise.pixel_sigma * draw(), pixel[1] + noise.pixel_sigma * draw()];
                    rows.push(CornerRow { configuration, shot: 0, camera, target, feature, pixel, covariance: None });
                }
            }
        }
    }
    rows.sort_by(|a, b| a.key().cmp(&b.key()));
    rows
}

/// The features of a target that a camera sees, whole tags and whole boards only.
fn visible(
    cell: &Cell<'_>,
    intrinsics: &Intrinsics,
    camera_from_target: &Pose,
    target: usize,
) -> Vec<(Feature, [f64; 2])> {
    let mut found = Vec::new();
    match &cell.layout.targets[target].geometry {
        TargetGeometry::None => {}
        TargetGeometry::Tags(faces) => {
            for face in faces {
                let Some(target_from_tag) = face.target_from_tag else { continue };
                let camera_from_tag = *camera_from_target * target_from_tag;
                let normal = camera_from_tag.rotation * Vector3::z();
                let pixels: Option<Vec<_>> = tag_corners(face.size)
                    .iter()
                    .map(|corner| cell.sees(intrinsics, &(camera_from_tag * *corner), Some(&normal), MARGIN))
                    .collect();
                let pixels = pixels.unwrap_or_default();
                found
                    .extend(pixels.iter().enumerate().map(|(i, p)| (Feature::TagCorner(face.id, i as u8), [p.x, p.y])));
            }
        }
        TargetGeometry::Board { columns, rows, square, .. } => {
            // The board looks along -z: its z axis points into it.
            let normal = camera_from_target.rotation * -Vector3::z();
            let pixels: Option<Vec<_>> = (0..columns * rows)
                .map(|i| {
                    let place = Vector3::new((i % columns) as f64 * square, (i / columns) as f64 * square, 0.0);
                    cell.sees(intrinsics, &(*camera_from_target * place), Some(&normal), MARGIN)
                })
                .collect();
            let pixels = pixels.unwrap_or_default();
            found.extend(pixels.iter().enumerate().map(|(i, p)| (Feature::BoardCorner(i as u32), [p.x, p.y])));
        }
        TargetGeometry::Points(points) => {
            for (name, place) in points {
                if let Some(pixel) = place.and_then(|p| cell.sees(intrinsics, &(*camera_from_target * p), None, MARGIN))
                {
                    found.push((Feature::Point(name.clone()), [pixel.x, pixel.y]));
                }
            }
        }
    }
    found
}
