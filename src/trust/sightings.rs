//! Where each picture by itself sees each target, and where the solution has it: the raw material for finding what is wrong.

use nalgebra::{Vector2, Vector3};
use rayon::prelude::*;

use super::undetermined::Evidence;
use crate::frames::{FrameId, Path, Step};
use crate::geometry::Pose;
use crate::initialise::poses_from_points;
use crate::layout::Motion;
use crate::recording::RobotMotion;
use crate::solve::{Block, Group, GroupKind};

/// One target seen at one configuration: `sensor_from_target` as measured there, without any other measurement.
#[derive(Clone, Debug, PartialEq)]
pub struct Sighting {
    /// Index into the plan's configurations.
    pub configuration: usize,
    /// The candidates: two for a flat target.
    pub candidates: Vec<Pose>,
}

impl Sighting {
    /// The candidate nearest to a pose.
    #[must_use]
    pub fn nearest(&self, pose: &Pose) -> Pose {
        let far = |candidate: &Pose| distance(candidate, pose);
        let nearest = self.candidates.iter().min_by(|a, b| far(a).total_cmp(&far(b)));
        nearest.copied().unwrap_or(*pose)
    }
}

/// At this arm's length (m) an angle counts as a distance.
pub const ARM: f64 = 0.3;

/// How far two poses are apart (m): the translation, and the rotation at an arm's length of 0.3 m.
#[must_use]
pub fn distance(a: &Pose, b: &Pose) -> f64 {
    (a.translation - b.translation).norm().hypot(ARM * a.rotation.angle_to(&b.rotation))
}

/// What every group's blocks see, by group; empty for points and contacts. All corners count, set aside or not, of one shot a block.
#[must_use]
pub fn sightings(evidence: &Evidence<'_>) -> Vec<Vec<Sighting>> {
    let one = |group: &Group| -> Vec<Sighting> {
        group.blocks.par_iter().filter_map(|block| sighting(evidence, group, block)).collect()
    };
    evidence.plan.groups.iter().map(one).collect()
}

fn sighting(evidence: &Evidence<'_>, group: &Group, block: &Block) -> Option<Sighting> {
    let m = &evidence.plan.measurements;
    let candidates: Vec<Pose> = match group.kind {
        GroupKind::Corners { camera } => {
            let lens = evidence.layout.cameras[camera].intrinsics.clone()?;
            let lens = lens.with_parameters(evidence.state.lenses[camera]);
            let (mut points, mut image) = (Vec::new(), Vec::new());
            // The first picture speaks for all of one configuration.
            for i in m.appearances(block.start..block.end).next()?.0 {
                if let Ok(ideal) = lens.undistort(&Vector2::from(m.pixel(i))) {
                    points.push(Vector3::from(m.place(i)));
                    image.push(ideal);
                }
            }
            poses_from_points(&points, &image).into_iter().map(|candidate| candidate.pose).collect()
        }
        // Set aside or not, as the file has it: the plan keeps no pose that was set aside.
        GroupKind::Poses => {
            let configuration = evidence.plan.configurations[block.configuration];
            let rows = evidence.recording.poses.iter().filter(|row| {
                row.configuration == configuration
                    && evidence.tree.cameras[row.camera] == group.path.from
                    && evidence.tree.targets[row.target] == group.path.to
            });
            rows.take(1).map(|row| row.pose).collect()
        }
        GroupKind::Points | GroupKind::Contacts => Vec::new(),
    };
    (!candidates.is_empty()).then_some(Sighting { configuration: block.configuration, candidates })
}

/// The value of a step at a configuration (of the plan) of the solution; none where a robot was not recorded.
#[must_use]
pub fn step_value(evidence: &Evidence<'_>, step: &Step, configuration: usize) -> Option<Pose> {
    let (pose, inverse) = match *step {
        Step::Static { edge, inverse } => (evidence.state.static_poses[edge], inverse),
        Step::Moving { edge, inverse } => (evidence.state.moving_poses[edge][configuration], inverse),
        Step::Robot { robot, from, to, inverse } => {
            let id = evidence.plan.configurations[configuration];
            (robot_segment(evidence, robot, from, to, id)?, inverse)
        }
    };
    Some(if inverse { pose.inverse() } else { pose })
}

/// A part of a robot at a recorded configuration, with its links as found.
#[must_use]
pub fn robot_segment(evidence: &Evidence<'_>, robot: usize, from: usize, to: usize, id: u64) -> Option<Pose> {
    match (&evidence.recording.motions[robot], &evidence.layout.robots[robot].motion) {
        (RobotMotion::Joints(values), Motion::Joints { chain, .. }) => {
            values.get(&id).map(|joints| chain.segment(joints, &evidence.state.corrections[robot], from, to))
        }
        (RobotMotion::Flange(poses), _) => poses.get(&id).copied(),
        (RobotMotion::Joints(_), Motion::FlangePoses { .. }) => None,
    }
}

/// The product of steps.
#[must_use]
pub fn along(evidence: &Evidence<'_>, steps: &[Step], configuration: usize) -> Option<Pose> {
    steps.iter().try_fold(Pose::identity(), |pose, step| Some(pose * step_value(evidence, step, configuration)?))
}

/// `from_from_to` at a configuration.
#[must_use]
pub fn between(evidence: &Evidence<'_>, from: FrameId, to: FrameId, configuration: usize) -> Option<Pose> {
    let path: Path = evidence.tree.path(from, to);
    along(evidence, &path.steps, configuration)
}

/// What a step of a path would have to be for a sighting to fit exactly, in the direction from parent to child.
#[must_use]
pub fn implied(evidence: &Evidence<'_>, path: &Path, at: usize, sighting: &Sighting) -> Option<Pose> {
    let c = sighting.configuration;
    let before = along(evidence, &path.steps[..at], c)?;
    let after = along(evidence, &path.steps[at + 1..], c)?;
    let here = step_value(evidence, &path.steps[at], c)?;
    let measured = sighting.nearest(&(before * here * after));
    let value = before.inverse() * measured * after.inverse();
    let inverse = match path.steps[at] {
        Step::Static { inverse, .. } | Step::Moving { inverse, .. } | Step::Robot { inverse, .. } => inverse,
    };
    Some(if inverse { value.inverse() } else { value })
}
