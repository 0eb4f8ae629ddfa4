//! `simulate`: a layout whose poses are known becomes a recording in ordinary files, with its truth.

mod files;
mod pictures;
mod prepare;

use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

use super::detect::Watch;
use super::localise::Copied;
use crate::complaint::{Complaint, InputError};
use crate::layout::Layout;
use crate::recording::{Recording, RobotMotion};
use crate::simulate::render::PictureFormat;
use crate::simulate::{Simulated, knowledge, paths, simulate};
use files::{put_in_place, write_files};
use pictures::write_pictures;
pub use prepare::{prepare, size};

/// What to simulate.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulateRequest {
    /// The folder of the recording that is made.
    pub out: PathBuf,
    /// The same seed gives the same files.
    pub seed: u64,
    /// Render pictures; the corners are then for a detector to find.
    pub pictures: bool,
    /// Replace what an earlier simulation left in the folder.
    pub force: bool,
    /// Multiplies every standard deviation of the measurements.
    pub noise: f64,
    /// In the place of the layout's number.
    pub configurations: Option<u64>,
    /// In the place of the layout's number.
    pub shots: Option<u64>,
}

/// A simulation that has been checked and can begin.
#[derive(Debug)]
pub struct Prepared {
    layout: Layout,
    request: SimulateRequest,
    copied: Vec<Copied>,
    formats: Vec<Option<PictureFormat>>,
    /// Pictures that will be rendered at most.
    pub pictures: u64,
    /// Bytes that the recording will need, about.
    pub bytes: u64,
    /// Whether the robots' own files are the path.
    pub recorded_path: bool,
    /// Whether every pose is hidden because the layout marks none as unknown.
    pub hides_all: bool,
}

/// What was made.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Made {
    /// Configurations.
    pub configurations: usize,
    /// Pictures rendered.
    pub pictures: usize,
    /// Corners measured; none where pictures were rendered.
    pub corners: usize,
    /// Whole poses measured.
    pub poses: usize,
    /// Points measured.
    pub points: usize,
    /// Cameras that never see anything.
    pub blind: Vec<String>,
    /// Targets that no camera ever sees.
    pub unseen: Vec<String>,
    /// What was spoilt on purpose, in words.
    pub spoilt: Vec<String>,
    /// Whether the caller stopped it; nothing was then written.
    pub interrupted: bool,
}

/// The file in which a simulated recording keeps what is true.
pub const TRUTH: &str = "truth.yaml";
/// The layout that a solver is told.
pub const LAYOUT: &str = "layout.yaml";

/// Makes the recording: all of it, or nothing.
///
/// # Errors
/// Faults of a recorded path, a path that cannot be found, a cell in which nothing is ever seen, a folder that cannot be written to.
pub fn make(prepared: &Prepared, watch: &Watch<'_>) -> Result<Made, InputError> {
    let Prepared { layout, request, .. } = prepared;
    let settings = &layout.simulate;
    let truth_for_path = knowledge::truth(layout, request.seed);
    let motions = if prepared.recorded_path {
        recorded(layout, settings.configurations, request.configurations.is_some())?
    } else {
        paths::generate(&truth_for_path, settings.configurations, request.seed)?
    };
    let simulated = simulate(layout, motions, request.seed, request.noise)?;
    let mut made = summary(layout, &simulated);
    if simulated.recording.corners.is_empty() && made.poses == 0 && made.points == 0 {
        return Err(Complaint::of(
            &layout.file,
            "in this cell nothing is ever seen: no camera sees a target at any configuration",
            "check the cameras' poses (x right, y down, z forward), and the targets' faces (z out of a tag)",
        )
        .into());
    }
    let failed = |error: std::io::Error| -> InputError {
        let what = format!("the recording cannot be written: {error}");
        Complaint::of(&request.out, what, "give another folder with `--out DIR`").into()
    };
    let parent = request.out.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    std::fs::create_dir_all(parent).map_err(failed)?;
    let folder = tempfile::Builder::new().prefix(".cellmap-simulate-").tempdir_in(parent).map_err(failed)?;
    write_files(folder.path(), prepared, &simulated).map_err(failed)?;
    if request.pictures {
        made.corners = 0;
        made.pictures = write_pictures(folder.path(), prepared, &simulated, watch).map_err(failed)?;
    }
    if watch.stop.load(Ordering::Relaxed) {
        return Ok(Made { interrupted: true, ..made });
    }
    put_in_place(folder, &request.out).map_err(failed)?;
    Ok(made)
}

/// The robots' own files as the path, the first `count` configurations of it if that was asked for.
fn recorded(layout: &Layout, count: u64, limited: bool) -> Result<Vec<RobotMotion>, InputError> {
    let mut motions = Recording::read_motion(layout)?.motions;
    if limited {
        for motion in &mut motions {
            let last = motion.configurations().get(count as usize).copied();
            match (motion, last) {
                (RobotMotion::Joints(values), Some(last)) => values.retain(|configuration, _| *configuration < last),
                (RobotMotion::Flange(poses), Some(last)) => poses.retain(|configuration, _| *configuration < last),
                _ => {}
            }
        }
    }
    if layout.simulate.joints.is_empty() {
        return Ok(motions);
    }
    let ranges = paths::joint_ranges(layout)?;
    for ((robot, motion), ranges) in layout.robots.iter().zip(&motions).zip(&ranges) {
        let RobotMotion::Joints(values) = motion else { continue };
        for (configuration, joints) in values {
            let outside = joints.iter().zip(ranges).position(|(q, [least, most])| q < least || q > most);
            if let Some(joint) = outside {
                return Err(Complaint::at(
                    &layout.file,
                    robot.line,
                    format!(
                        "configuration {configuration} cannot be reached: joint {} of robot `{}` is outside its range",
                        joint + 1,
                        robot.name
                    ),
                    "mend the path, or the ranges in `simulate: {joints: ...}`",
                )
                .into());
            }
        }
    }
    Ok(motions)
}

fn summary(layout: &Layout, simulated: &Simulated) -> Made {
    let recording = &simulated.recording;
    let seen_by = |camera: usize| {
        recording.corners.appearances().iter().any(|one| one.camera == camera)
            || recording.poses.iter().any(|row| row.camera == camera)
    };
    let seen = |target: usize| {
        recording.corners.appearances().iter().any(|one| one.target == target)
            || recording.poses.iter().any(|row| row.target == target)
            || recording.points.iter().any(|row| row.target == target)
    };
    let cameras = layout.cameras.iter().enumerate().filter(|(i, _)| !seen_by(*i));
    let targets = layout.targets.iter().enumerate().filter(|(i, _)| !seen(*i));
    Made {
        configurations: simulated.configurations.len(),
        corners: recording.corners.len(),
        poses: recording.poses.len(),
        points: recording.points.len(),
        blind: cameras.map(|(_, camera)| camera.name.clone()).collect(),
        unseen: targets.map(|(_, target)| target.name.clone()).collect(),
        spoilt: simulated.spoilt.clone(),
        ..Made::default()
    }
}
