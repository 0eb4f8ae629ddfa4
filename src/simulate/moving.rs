//! Where targets are that move by themselves: each waved before the cameras, somewhere else at every configuration.

use nalgebra::{Vector2, Vector3};
use rand::Rng;
use std::collections::BTreeMap;

use super::cell::Cell;
use super::random::{Purpose, stream};
use super::visible::visible;
use crate::geometry::{Intrinsics, Pose, TargetGeometry};

/// The share of the picture's smaller side that a waved target fills, at least and at most.
const FILLS: [f64; 2] = [0.25, 0.6];
/// A waved target leans away from the camera by up to this (rad).
const LEANS: f64 = 0.7;
/// Places tried for each configuration.
const TRIES: u64 = 200;

/// A pose for every moving edge at every configuration such that some camera sees the target, by edge and configuration.
#[must_use]
pub fn waved(cell: &Cell<'_>, configurations: &[u64], seed: u64) -> BTreeMap<(usize, u64), Pose> {
    let mut poses = BTreeMap::new();
    for (edge, moving) in cell.tree.moving_edges.iter().enumerate() {
        let Some(target) = cell.tree.targets.iter().position(|frame| *frame == moving.frame) else { continue };
        let Some(parent) = cell.tree.frames[moving.frame].parent else { continue };
        for &configuration in configurations {
            let found = (0..TRIES).find_map(|attempt| {
                let which = [edge as u64, configuration, attempt];
                place(cell, target, parent, configuration, &mut stream(seed, Purpose::Moving, which))
            });
            if let Some(parent_from_target) = found {
                poses.insert((edge, configuration), parent_from_target);
            }
        }
    }
    poses
}

/// A random place before a random camera, if that camera sees the target there.
fn place(cell: &Cell<'_>, target: usize, parent: usize, configuration: u64, random: &mut impl Rng) -> Option<Pose> {
    let lenses: Vec<(usize, &Intrinsics)> =
        cell.layout.cameras.iter().enumerate().filter_map(|(i, c)| Some((i, c.intrinsics.as_ref()?))).collect();
    if lenses.is_empty() {
        return None;
    }
    let (camera, intrinsics) = lenses[random.random_range(0..lenses.len())];
    let geometry = &cell.layout.targets[target].true_geometry;
    let (middle, extent) = span(geometry);
    let [width, height] = intrinsics.size().map(f64::from);
    let distance = extent * intrinsics.focal()[0] / (random.random_range(FILLS[0]..FILLS[1]) * width.min(height));
    let pixel = Vector2::new(width * random.random_range(0.15..0.85), height * random.random_range(0.15..0.85));
    let centre = intrinsics.ray(&pixel).ok()?.normalize() * distance;
    // A board's z points into it, a tag's out of it: turned by half a turn about x, a tag faces the camera.
    let facing = match geometry {
        TargetGeometry::Board { .. } => Vector3::zeros(),
        _ => Vector3::x() * std::f64::consts::PI,
    };
    let lean = Vector3::new(random.random_range(-LEANS..LEANS), random.random_range(-LEANS..LEANS), 0.0);
    let roll = Vector3::z() * random.random_range(-std::f64::consts::PI..std::f64::consts::PI);
    let turn = [lean, roll, facing].map(|v| Pose::from_rotation_vector(&v));
    let rotation = (turn[0] * turn[1] * turn[2]).rotation;
    let camera_from_target = Pose::new(rotation, centre - rotation * middle);
    if visible(cell, intrinsics, &camera_from_target, target, &[]).is_empty() {
        return None;
    }
    Some(cell.pose(parent, cell.tree.cameras[camera], configuration)? * camera_from_target)
}

/// The middle of a target and how wide it is, m.
fn span(geometry: &TargetGeometry) -> (Vector3<f64>, f64) {
    let points = super::obstacles::extremes(geometry);
    let low = points.iter().fold(Vector3::repeat(f64::INFINITY), |low, p| low.inf(p));
    let high = points.iter().fold(Vector3::repeat(f64::NEG_INFINITY), |high, p| high.sup(p));
    ((low + high) * 0.5, (high - low).norm().max(1e-3))
}
