//! The recording of the demo cell: a path for its robot, pictures, and the layout with its poses hidden.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::Path;

use super::cell::Cell;
use super::corners::{CornerNoise, corners};
use super::picture::{PictureNoise, Plate, png, render};
use crate::geometry::{Feature, Pose};
use crate::layout::images::ImagePattern;
use crate::layout::{Layout, Motion};
use crate::recording::{Recording, RobotMotion, atomic};

/// The demo cell with all its poses.
pub const TRUTH: &str = include_str!("../../layouts/demo.yaml");
/// Places at which the robot stops.
const STOPS: usize = 16;
/// Joint values (rad) around which the robot moves.
const MIDDLE: [f64; 6] = [-1.9, -1.75, 1.9, -1.7, -1.55, 0.4];
/// How far each joint strays from there (rad).
const STRAY: [f64; 6] = [0.5, 0.4, 0.4, 0.7, 0.7, 1.5];

/// The layout that a user would write: the truth without its poses.
#[must_use]
pub fn hidden_layout() -> String {
    let body = TRUTH.lines().filter(|line| !line.starts_with('#') && !line.trim_start().starts_with("pose:"));
    let mut text = "# The demo cell as a user describes it: what there is, but not where. No pose is given, and none is guessed.\n".to_owned();
    body.for_each(|line| {
        text.push_str(line);
        text.push('\n');
    });
    text
}

/// A path on which a fixed camera sees at least two tags of the tool at every stop, or the wrist camera four of the table: joint values by configuration.
#[must_use]
pub fn path(layout: &Layout, seed: u64) -> BTreeMap<u64, Vec<f64>> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut stops: BTreeMap<u64, Vec<f64>> = BTreeMap::new();
    // Bounded, so that a layout in which nothing can be seen ends too.
    for _ in 0..20_000 {
        if stops.len() == STOPS {
            break;
        }
        let joints: Vec<f64> =
            MIDDLE.iter().zip(STRAY).map(|(q, stray)| q + random.random_range(-stray..stray)).collect();
        let motion = RobotMotion::Joints(BTreeMap::from([(0, joints.clone())]));
        let recording = Recording { motions: vec![motion], ..Recording::default() };
        let cell = Cell::new(layout, &recording);
        let flange = cell.tree.robots[0].last().copied().unwrap_or(0);
        let above = cell.pose(0, flange, 0).is_some_and(|pose: Pose| pose.translation.z > 0.25);
        let seen = corners(&cell, &[0], CornerNoise { pixel_sigma: 0.0, seed });
        let count = |camera: &str, ids: std::ops::Range<u32>| {
            let one = |row: &&crate::recording::CornerRow| match row.feature {
                Feature::TagCorner(id, 0) => ids.contains(&id) && layout.cameras[row.camera].name == camera,
                _ => false,
            };
            seen.iter().filter(one).count()
        };
        let tool = count("left", 20..30).max(count("right", 20..30)) >= 2;
        let table = count("wrist", 0..20) >= 4;
        if above && tool && (table || stops.len().is_multiple_of(2)) {
            stops.insert(stops.len() as u64 + 1, joints);
        }
    }
    stops
}

/// Writes `layout.yaml`, `truth.yaml` and `joints.csv` into a folder.
///
/// # Errors
/// When a file cannot be written.
pub fn write_description(folder: &Path, layout: &Layout, stops: &BTreeMap<u64, Vec<f64>>) -> std::io::Result<()> {
    atomic::write(&folder.join("layout.yaml"), |out| out.write_all(hidden_layout().as_bytes()))?;
    atomic::write(&folder.join("truth.yaml"), |out| out.write_all(TRUTH.as_bytes()))?;
    let Some(robot) = layout.robots.first() else { return Ok(()) };
    let Motion::Joints { chain, .. } = &robot.motion else { return Ok(()) };
    let header: Vec<String> = (1..=chain.joint_count()).map(|i| format!("q{i}")).collect();
    atomic::write(&folder.join("joints.csv"), |out| {
        writeln!(out, "configuration,robot,{}", header.join(","))?;
        for (configuration, joints) in stops {
            let values: Vec<String> = joints.iter().map(|q| format!("{:.9}", q / layout.units.angle)).collect();
            writeln!(out, "{configuration},{},{}", robot.name, values.join(","))?;
        }
        Ok(())
    })
}

/// Renders every camera's picture of every stop into a folder; returns how many there are. `done` is called after each.
///
/// # Errors
/// When a picture cannot be written.
pub fn write_pictures(
    folder: &Path,
    cell: &Cell<'_>,
    plates: &[Plate],
    noise: PictureNoise,
    done: &(dyn Fn() + Sync),
) -> std::io::Result<usize> {
    let stops: Vec<u64> = cell.recording.motions.first().map(RobotMotion::configurations).unwrap_or_default();
    let work: Vec<(usize, u64)> =
        (0..cell.layout.cameras.len()).flat_map(|camera| stops.iter().map(move |stop| (camera, *stop))).collect();
    let one = |&(camera, stop): &(usize, u64)| -> std::io::Result<usize> {
        let pattern = cell.layout.cameras[camera].images.as_deref().and_then(|text| ImagePattern::parse(text).ok());
        let (Some(pattern), Some(picture)) = (pattern, render(cell, plates, camera, stop, noise)) else { return Ok(0) };
        let png = png(&picture)?;
        atomic::write(&pattern.path(folder, stop, 0), |out| out.write_all(&png))?;
        done();
        Ok(1)
    };
    work.par_iter().map(one).collect::<std::io::Result<Vec<usize>>>().map(|counts| counts.iter().sum())
}
