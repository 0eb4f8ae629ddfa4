//! A recording of the paper's size for benches and memory measurements: a UR3 with a board before three cameras, 250 configurations
//! x 10 shots x 3 cameras = 7500 pictures.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;

use super::cell::Cell;
use super::corners::{CornerNoise, corners};
use crate::layout::Layout;
use crate::recording::{CornerRow, Recording, RobotMotion};

const TRUTH: &str = include_str!("../../layouts/paper_size.yaml");

/// The layout with all its poses.
#[must_use]
pub fn truth() -> String {
    TRUTH.to_owned()
}

/// The layout without its poses; `refine` frees focal lengths, centres and distortion.
#[must_use]
pub fn hidden(refine: bool) -> String {
    let lines = TRUTH.lines().filter(|line| !line.trim_start().starts_with("pose:"));
    let mut text = String::new();
    for line in lines {
        text.push_str(line);
        text.push('\n');
        if refine && line.trim_start().starts_with("intrinsics:") {
            text.push_str("    refine: [focal, centre, distortion]\n");
        }
    }
    text
}

/// Records `configurations` x `shots` pictures a camera with `pixel_sigma` (px) of noise. Every camera sees all the board's `corners_a_picture` (40 if the layout
/// is [`truth`]'s) in every picture; with more than the board has, or a board that cannot be seen, nothing is recorded.
#[must_use]
pub fn record(
    truth: &Layout,
    configurations: u64,
    shots: u64,
    corners_a_picture: usize,
    pixel_sigma: f64,
) -> Recording {
    let mut random = ChaCha8Rng::seed_from_u64(7500);
    let middle = [0.3, -1.6, 1.7, -1.7, -1.57, 0.2];
    let cameras = truth.cameras.len();
    let mut joints: BTreeMap<u64, Vec<f64>> = BTreeMap::new();
    let mut rows: Vec<CornerRow> = Vec::new();
    // Bounded, so that a layout in which the board cannot be seen ends too.
    for _ in 0..100 * configurations {
        let id = joints.len() as u64 + 1;
        if id > configurations {
            break;
        }
        let q: Vec<f64> = middle.iter().map(|q| q + random.random_range(-0.45..0.45)).collect();
        let recording =
            Recording { motions: vec![RobotMotion::Joints(BTreeMap::from([(id, q.clone())]))], ..Recording::default() };
        let cell = Cell::new(truth, &recording);
        let take = |shot: u64| corners(&cell, &[id], CornerNoise { pixel_sigma, seed: id * 1000 + shot });
        let first = take(0);
        if first.len() < corners_a_picture * cameras {
            continue;
        }
        joints.insert(id, q);
        rows.extend(first);
        for shot in 1..shots {
            rows.extend(take(shot).into_iter().map(|row| CornerRow { shot, ..row }));
        }
    }
    Recording { motions: vec![RobotMotion::Joints(joints)], corners: rows.into(), ..Recording::default() }
}
