//! Random cells of several kinds, each with its truth: the project's layouts with every hidden pose shaken, along stops drawn from a long path.
#![allow(dead_code)]

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::OnceLock;

use cellmap::geometry::{Feature, Pose};
use cellmap::layout::{Layout, LinkParameters, PoseSpec, parse_layout};
use cellmap::recording::{Recording, RobotMotion};
use cellmap::robot::ParameterKind;
use cellmap::simulate::{Simulated, paths, simulate};
use cellmap::workflow::solve::{Solved, solve_recording};
use nalgebra::Vector3;
use rand::seq::index::sample;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// What a cell is like.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// One robot, two cameras on tripods, one on its wrist.
    OneRobot,
    /// Two robots, five cameras.
    TwoRobots,
    /// One robot, every lens to be found too.
    Lenses,
    /// One robot, its links to be found too.
    Links,
    /// One robot that stops elsewhere than its log says, and nobody is told.
    Stops,
    /// The same, and the layout says how far.
    StopsTold,
    /// One robot; what stands still before a camera that stands still is seen with the same error every time.
    StillCorners,
}

impl Kind {
    pub const ALL: [Self; 7] =
        [Self::OneRobot, Self::TwoRobots, Self::Lenses, Self::Links, Self::Stops, Self::StopsTold, Self::StillCorners];

    pub fn words(self) -> &'static str {
        match self {
            Self::OneRobot => "one robot",
            Self::TwoRobots => "two robots",
            Self::Lenses => "with lenses",
            Self::Links => "with link parameters",
            Self::Stops => "inexact stops, not told",
            Self::StopsTold => "inexact stops, told",
            Self::StillCorners => "still corners err alike",
        }
    }
}

/// How far robots stop from their log, where they do: m and rad an axis.
pub const REPEATABILITY: [f64; 2] = [1e-4, 5e-4];

/// A layout and a long path through it.
fn base(two: bool) -> &'static (Layout, Vec<RobotMotion>) {
    static ONE: OnceLock<(Layout, Vec<RobotMotion>)> = OnceLock::new();
    static TWO: OnceLock<(Layout, Vec<RobotMotion>)> = OnceLock::new();
    let read = |text: &str| parse_layout(Path::new("cell.yaml"), text, None).unwrap_or_else(|e| panic!("{e}"));
    if two {
        TWO.get_or_init(|| {
            let layout = read(include_str!("../../layouts/two_robots.yaml"));
            let stray = |seed: u64| {
                let mut random = ChaCha8Rng::seed_from_u64(seed);
                let middle = [3.2, -1.6, 1.9, -1.87, -1.57, 0.2];
                (1..=100)
                    .map(|stop| (stop, middle.iter().map(|q| q + random.random_range(-0.6..0.6)).collect()))
                    .collect()
            };
            (layout, vec![RobotMotion::Joints(stray(7)), RobotMotion::Joints(stray(8))])
        })
    } else {
        ONE.get_or_init(|| {
            let layout = read(include_str!("../../layouts/one_robot.yaml"));
            let motions = paths::generate(&layout, 120, 1).unwrap_or_else(|e| panic!("{e}"));
            (layout, motions)
        })
    }
}

/// The cell of a kind and seed with `stops` configurations.
pub fn cell(kind: Kind, seed: u64, stops: usize) -> Simulated {
    let (layout, path) = base(kind == Kind::TwoRobots);
    let mut layout = layout.clone();
    let mut random = ChaCha8Rng::seed_from_u64(seed ^ 0x5eed_0000);
    shake(&mut layout, &mut random);
    match kind {
        Kind::OneRobot | Kind::TwoRobots | Kind::StillCorners => {}
        Kind::Lenses => {
            layout.simulate.lens_errors = [4.0, 3.0, 0.004];
            for camera in &mut layout.cameras {
                let count = camera.intrinsics.as_ref().map_or(0, |lens| lens.model().parameter_count());
                camera.refine = (0..count).collect();
            }
        }
        Kind::Links => {
            layout.simulate.link_errors = [0.1_f64.to_radians(), 3e-4, 0.05_f64.to_radians()];
            let sigmas =
                [(ParameterKind::JointOffset, 0.1), (ParameterKind::LengthD, 0.3), (ParameterKind::LengthA, 0.3)];
            let sigmas = sigmas.into_iter().chain([(ParameterKind::TwistAlpha, 0.05)]);
            layout.robots[0].identify =
                sigmas.map(|(kind, sigma)| LinkParameters { kind, sigma: Some(sigma) }).collect();
        }
        Kind::Stops => layout.simulate.repeatability = REPEATABILITY,
        Kind::StopsTold => {
            layout.simulate.repeatability = REPEATABILITY;
            layout.robots[0].repeatability = Some(REPEATABILITY);
        }
    }
    let places = path[0].configurations();
    let chosen: Vec<u64> = sample(&mut random, places.len(), stops).into_iter().map(|i| places[i]).collect();
    let motions = path.iter().map(|motion| drawn(motion, &chosen, &mut random)).collect();
    let mut simulated = simulate(&layout, motions, seed, 1.0).unwrap_or_else(|e| panic!("{e}"));
    if kind == Kind::StillCorners {
        repeat_still_errors(&mut simulated);
    }
    simulated
}

/// The chosen stops, each a little elsewhere, numbered anew.
fn drawn(motion: &RobotMotion, chosen: &[u64], random: &mut ChaCha8Rng) -> RobotMotion {
    let RobotMotion::Joints(values) = motion else { return motion.clone() };
    let mut near = |stop: &u64| values[stop].iter().map(|q| q + random.random_range(-0.05..0.05)).collect();
    RobotMotion::Joints((1..).zip(chosen.iter().map(&mut near)).collect())
}

/// Moves everything whose pose is hidden by up to 40 mm and 4 degrees an axis.
fn shake(layout: &mut Layout, random: &mut ChaCha8Rng) {
    let mut draw = |scale: f64| Vector3::from_fn(|_, _| random.random_range(-scale..scale));
    let cameras = layout.cameras.iter_mut().map(|c| &mut c.pose);
    let robots = layout.robots.iter_mut().map(|r| &mut r.pose);
    let targets = layout.targets.iter_mut().map(|t| &mut t.pose);
    for pose in cameras.chain(robots).chain(targets) {
        if let PoseSpec::Hidden(pose) = pose {
            let turn = Pose::from_rotation_vector(&draw(0.07)).rotation;
            *pose = Pose::new(turn * pose.rotation, pose.translation + draw(0.04));
        }
    }
}

/// Gives a corner that a camera on a tripod sees of something that stands still nearly the same pixel at every configuration.
fn repeat_still_errors(simulated: &mut Simulated) {
    let mut first: BTreeMap<(usize, usize, Feature), [f64; 2]> = BTreeMap::new();
    let (cameras, targets) = (&simulated.truth.cameras, &simulated.truth.targets);
    simulated.recording.corners.edit(|rows| {
        for row in rows {
            if cameras[row.camera].mount.parent != "world" || targets[row.target].mount.parent != "world" {
                continue;
            }
            let [u, v] = *first.entry((row.camera, row.target, row.feature.clone())).or_insert(row.pixel);
            row.pixel = [u + 0.25 * (row.pixel[0] - u), v + 0.25 * (row.pixel[1] - v)];
        }
    });
}

/// Solves what a cell's solver is told.
pub fn solve(simulated: &Simulated) -> Solved {
    solve_from(simulated, &[])
}

/// Solves it from given poses.
pub fn solve_from(simulated: &Simulated, start: &[(String, Pose)]) -> Solved {
    let told = simulated.told.clone();
    let recording = Recording { motions: simulated.logged.clone(), ..simulated.recording.clone() };
    solve_recording(told, &recording, start, Vec::new(), std::time::Instant::now()).unwrap_or_else(|e| panic!("{e}"))
}
