//! Corners as a detector would report them, from truth and noise.

use rayon::prelude::*;

use super::cell::Cell;
use super::obstacles::Obstacles;
use super::random::{Purpose, normal, stream};
use super::visible::visible;
use crate::recording::CornerRow;

/// How corners are spoilt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CornerNoise {
    /// Standard deviation a coordinate, px.
    pub pixel_sigma: f64,
    /// Seed: the same seed gives the same bits.
    pub seed: u64,
}

/// Every corner that every camera sees at every configuration of the cell's robots, once.
#[must_use]
pub fn corners(cell: &Cell<'_>, configurations: &[u64], noise: CornerNoise) -> Vec<CornerRow> {
    corners_of_shots(cell, None, configurations, 0..1, noise)
}

/// Every corner that every camera sees in every shot, sorted by [`CornerRow::key`]. Robots hide what is behind their `obstacles`.
#[must_use]
pub fn corners_of_shots(
    cell: &Cell<'_>,
    obstacles: Option<&Obstacles>,
    configurations: &[u64],
    shots: std::ops::Range<u64>,
    noise: CornerNoise,
) -> Vec<CornerRow> {
    let cameras = 0..cell.layout.cameras.len();
    let work: Vec<(usize, u64)> = cameras.flat_map(|camera| configurations.iter().map(move |c| (camera, *c))).collect();
    let one = |&(camera, configuration): &(usize, u64)| {
        let mut rows = Vec::new();
        let Some(intrinsics) = &cell.layout.cameras[camera].intrinsics else { return rows };
        for target in 0..cell.layout.targets.len() {
            let (from, to) = (cell.tree.cameras[camera], cell.tree.targets[target]);
            let Some(camera_from_target) = cell.pose(from, to, configuration) else { continue };
            let mut seen = visible(cell, intrinsics, &camera_from_target, target, &[]);
            if let (Some(obstacles), false) = (obstacles, seen.is_empty()) {
                let bodies = obstacles.hiding(cell, from, to, configuration);
                seen = visible(cell, intrinsics, &camera_from_target, target, &bodies);
            }
            for shot in shots.clone() {
                // One stream a picture and target, so that a target more or less changes nothing about the others.
                let which = [configuration, shot, (camera as u64) << 32 | target as u64];
                let mut random = stream(noise.seed, Purpose::Measurement, which);
                rows.extend(seen.iter().map(|(feature, pixel)| {
                    let pixel = [
                        pixel.x + noise.pixel_sigma * normal(&mut random),
                        pixel.y + noise.pixel_sigma * normal(&mut random),
                    ];
                    let feature = feature.clone();
                    CornerRow { configuration, shot, camera, target, feature, pixel, covariance: None }
                }));
            }
        }
        rows
    };
    let pictures: Vec<Vec<CornerRow>> = work.par_iter().map(one).collect();
    // Room at once: vectors that grow to such sizes leave holes of the same.
    let mut rows = Vec::with_capacity(pictures.iter().map(Vec::len).sum());
    rows.extend(pictures.into_iter().flatten());
    rows.sort_by(|a, b| a.key().cmp(&b.key()));
    rows
}
