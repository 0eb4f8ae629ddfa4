//! A recording with known truth, in memory.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::cell::{Cell, Disturbances};
use super::corners::{CornerNoise, corners_of_shots};
use super::random::{Purpose, normal3, stream};
use super::{faults, knowledge, moving, obstacles::Obstacles, others};
use crate::complaint::{Complaint, InputError, list};
use crate::frames::{Edge, FrameTree};
use crate::geometry::Pose;
use crate::layout::Layout;
use crate::recording::{Recording, RobotMotion};
use rand::Rng;

/// What a simulation makes.
#[derive(Debug)]
pub struct Simulated {
    /// What is true; see [`knowledge::truth`].
    pub truth: Layout,
    /// What a solver is told; see [`knowledge::told`].
    pub told: Layout,
    /// How the robots really moved, and all measurements.
    pub recording: Recording,
    /// How the robots moved according to their log.
    pub logged: Vec<RobotMotion>,
    /// How the cell differs from its description.
    pub disturbances: Disturbances,
    /// The configurations in order.
    pub configurations: Vec<u64>,
    /// Pictures (camera, configuration, shot) that do not exist.
    pub missing: Vec<(usize, u64, u64)>,
    /// What was spoilt on purpose, in words.
    pub spoilt: Vec<String>,
}

impl Simulated {
    /// The true cell, to be asked where things are.
    #[must_use]
    pub fn cell(&self) -> Cell<'_> {
        Cell { disturbances: self.disturbances.clone(), ..Cell::new(&self.truth, &self.recording) }
    }
}

/// Simulates a layout all of whose poses are known, along `motions`. `noise` multiplies every standard deviation of the measurements; with
/// zero they are exact.
///
/// # Errors
/// Poses that are not known ([`knowledge::missing`]); frames and robots of the `simulate` section that are not there.
pub fn simulate(layout: &Layout, motions: Vec<RobotMotion>, seed: u64, noise: f64) -> Result<Simulated, InputError> {
    let missing_poses = knowledge::missing(layout);
    if !missing_poses.is_empty() {
        return Err(InputError(missing_poses));
    }
    let settings = &layout.simulate;
    let truth = knowledge::truth(layout, seed);
    let configurations = configurations(&motions, settings.configurations);
    let middle = configurations.get(configurations.len() / 2).copied().unwrap_or(0);
    let recording = Recording { motions: motions.clone(), ..Recording::default() };
    let tree = Arc::new(FrameTree::new(&truth));
    let mut cell = Cell::with_tree(&truth, &recording, tree);
    cell.disturbances.stops = stops(&motions, settings.repeatability, seed);
    cell.disturbances.bumped = bump(layout, &cell, middle, seed)?;
    cell.disturbances.moving = moving::waved(&cell, &configurations, seed);
    let solve = &layout.solve;
    let shots = 0..settings.shots;
    let pixel_sigma = noise * settings.noise.pixel.unwrap_or(solve.pixel_sigma);
    let obstacles = Obstacles::new(&cell);
    let mut corners =
        corners_of_shots(&cell, Some(&obstacles), &configurations, shots.clone(), CornerNoise { pixel_sigma, seed });
    let pose_sigma = settings.noise.pose.unwrap_or(solve.pose_sigma).map(|sigma| noise * sigma);
    let mut poses = others::whole_poses(&cell, &configurations, shots.clone(), pose_sigma, seed);
    let point_sigma = noise * settings.noise.point.unwrap_or(solve.point_sigma);
    let mut points = others::points(&cell, &configurations, shots.clone(), point_sigma, seed);
    // A picture that does not exist takes everything with it that would have been seen in it.
    let lost = |kind: u64, instrument: usize, configuration: u64, shot: u64| {
        let mut random = stream(seed, Purpose::Missing, [configuration, shot, kind << 32 | instrument as u64]);
        random.random::<f64>() < settings.missing
    };
    corners.retain(|row| !lost(0, row.camera, row.configuration, row.shot));
    poses.retain(|row| !lost(0, row.camera, row.configuration, row.shot));
    points.retain(|row| !lost(1, row.sensor, row.configuration, row.shot));
    let pictures = (0..layout.cameras.len())
        .flat_map(|camera| configurations.iter().flat_map(move |c| (0..settings.shots).map(move |s| (camera, *c, s))));
    let missing = pictures.filter(|(camera, configuration, shot)| lost(0, *camera, *configuration, *shot)).collect();
    let outliers = &settings.outliers;
    let [wrong, turned, dragged] = faults::spoil_corners(layout, &mut corners, outliers, seed);
    let flipped = faults::flip_poses(&mut poses, outliers.flipped, seed);
    let mut logged = motions;
    let mut spoilt: Vec<String> = [
        (wrong, "tags with another tag's id"),
        (turned, "tags or boards whose corners begin elsewhere"),
        (dragged, "corners dragged away"),
        (flipped, "whole poses mirrored"),
    ]
    .iter()
    .filter(|(count, _)| *count > 0)
    .map(|(count, what)| format!("{count} {what}"))
    .collect();
    if let Some((name, line)) = &outliers.shifted_log {
        let names = || layout.robots.iter().map(|robot| robot.name.as_str());
        let robot = names().position(|robot| robot == name).ok_or_else(|| {
            let what = format!("`shifted_log` names `{name}`, which is no robot");
            Complaint::at(&layout.file, *line, what, format!("the layout's robots are {}", list(names())))
        })?;
        faults::shift_log(&mut logged[robot], middle);
        spoilt.push(format!("the log of `{name}` off by one from configuration {middle} on"));
    }
    if let Some(moved) = &outliers.moved {
        spoilt.push(format!("`{}` bumped at configuration {middle}", moved.frame));
    }
    let disturbances = std::mem::take(&mut cell.disturbances);
    drop(cell);
    let told = knowledge::told(layout, seed);
    let recording = Recording { corners: corners.into(), poses, points, ..recording };
    Ok(Simulated { truth, told, recording, logged, disturbances, configurations, missing, spoilt })
}

/// The configurations at which every robot stands somewhere; those asked for where there is no robot.
fn configurations(motions: &[RobotMotion], wanted: u64) -> Vec<u64> {
    match motions.split_first() {
        None => (1..=wanted).collect(),
        Some((first, rest)) => {
            let all = first.configurations().into_iter();
            all.filter(|configuration| rest.iter().all(|motion| motion.knows(*configuration))).collect()
        }
    }
}

/// Where robots really stop.
fn stops(motions: &[RobotMotion], sigma: [f64; 2], seed: u64) -> BTreeMap<(usize, u64), Pose> {
    let mut stops = BTreeMap::new();
    if sigma == [0.0; 2] {
        return stops;
    }
    for (robot, motion) in motions.iter().enumerate() {
        for configuration in motion.configurations() {
            let mut random = stream(seed, Purpose::Stop, [robot as u64, configuration, 0]);
            let shift = normal3(&mut random) * sigma[0];
            let turn = Pose::from_rotation_vector(&(normal3(&mut random) * sigma[1])).rotation;
            stops.insert((robot, configuration), Pose::new(turn, shift));
        }
    }
    stops
}

/// The edge that somebody bumps, from when on, and its pose then.
fn bump(layout: &Layout, cell: &Cell<'_>, from: u64, seed: u64) -> Result<Option<(usize, u64, Pose)>, Complaint> {
    let Some(moved) = &layout.simulate.outliers.moved else { return Ok(None) };
    let frame = cell.tree.frames.iter().find(|frame| frame.name == moved.frame);
    match frame.map(|frame| frame.edge) {
        Some(Edge::Static(edge)) if moved.frame != layout.world => {
            let pose = cell.tree.static_edges[edge].spec.truth().unwrap_or_else(Pose::identity);
            Ok(Some((edge, from, faults::bumped(&pose, moved.translation, moved.rotation, seed))))
        }
        _ => Err(Complaint::at(
            &layout.file,
            moved.line,
            format!("`moved` names `{}`, which nobody can bump", moved.frame),
            "name a camera, a sensor, a target or a robot's base that is not the world",
        )),
    }
}
