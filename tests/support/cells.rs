//! Cells with known truth for tests: the layouts' poses are the truth, and are hidden before solving.
#![allow(dead_code)]

use std::collections::BTreeMap;
use std::path::Path;

use cellmap::geometry::Pose;
use cellmap::layout::{Layout, parse_layout};
use cellmap::recording::{Recording, RobotMotion};
use cellmap::simulate::{Cell, CornerNoise, corners};
use cellmap::workflow::solve::Solved;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

pub const TWO_ROBOTS: &str = include_str!("../../layouts/two_robots.yaml");

/// A layout from text.
pub fn layout(text: &str) -> Layout {
    parse_layout(Path::new("cell.yaml"), text, None).unwrap_or_else(|e| panic!("{e}"))
}

/// The text without its poses.
pub fn hidden(text: &str) -> String {
    text.lines().filter(|line| !line.trim_start().starts_with("pose:")).map(|line| format!("{line}\n")).collect()
}

/// The layout with nothing hidden.
fn revealed(text: &str) -> String {
    text.replace(", unknown: true", "")
}

/// The truth of the two-robot cell.
pub fn two_robot_truth() -> String {
    revealed(TWO_ROBOTS)
}

/// The truth of the cell with one robot, three cameras and a cube of tags.
pub fn one_robot_truth() -> String {
    revealed(include_str!("../../layouts/one_robot.yaml"))
}

/// A path for the cell with one robot on which its cameras see what they need.
pub fn one_robot_path(stops: u64) -> Vec<RobotMotion> {
    cellmap::simulate::paths::generate(&layout(&one_robot_truth()), stops, 1).unwrap_or_else(|e| panic!("{e}"))
}

/// Joint values around a middle, the same for the same seed.
pub fn wander(middle: &[f64], stray: f64, stops: u64, seed: u64) -> BTreeMap<u64, Vec<f64>> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut draw = || middle.iter().map(|q| q + random.random_range(-stray..stray)).collect();
    (1..=stops).map(|stop| (stop, draw())).collect()
}

/// What two robots over a table do.
pub fn two_robot_motion(stops: u64) -> Vec<RobotMotion> {
    // The arms reach over the table, flanges down.
    let middle = [3.2, -1.6, 1.9, -1.87, -1.57, 0.2];
    vec![RobotMotion::Joints(wander(&middle, 0.6, stops, 7)), RobotMotion::Joints(wander(&middle, 0.6, stops, 8))]
}

/// A recording of corners from a truth.
pub fn record(truth: &Layout, motions: Vec<RobotMotion>, pixel_sigma: f64, seed: u64) -> Recording {
    let mut recording = Recording { motions, ..Recording::default() };
    let configurations = recording.motions[0].configurations();
    let found = corners(&Cell::new(truth, &recording), &configurations, CornerNoise { pixel_sigma, seed });
    recording.corners = found.into();
    recording
}

/// Solves in memory.
pub fn solve(layout: Layout, recording: &Recording) -> Solved {
    cellmap::workflow::solve::solve_recording(layout, recording, &[], Vec::new(), std::time::Instant::now())
        .unwrap_or_else(|e| panic!("{e}"))
}

/// `parent_from_child` of a truth, by key, along its own tree.
pub fn true_pose(truth: &Layout, key: &str) -> Pose {
    let tree = cellmap::frames::FrameTree::new(truth);
    let edge = tree.static_edges.iter().find(|edge| edge.key == key).unwrap_or_else(|| panic!("no {key}"));
    edge.spec.truth().unwrap()
}
