//! The robots' part of every path: poses of the segments at each configuration, and how link parameters move them.

use rayon::prelude::*;

use super::chain::SegmentValues;
use super::plan::{Plan, Stop};
use super::state::State;
use super::unknowns::UnknownKind;
use crate::geometry::Pose;
use crate::layout::{Layout, Motion, PoseSigma, Robot};
use crate::recording::{Recording, RobotMotion};
use crate::robot::Chain;

/// How a robot's joints are known, ready for the loop.
#[derive(Clone, Debug)]
pub(super) struct RobotData<'a> {
    chain: Option<&'a Chain>,
    /// By configuration of the plan.
    joints: Vec<&'a [f64]>,
    flange: Vec<Pose>,
    /// Correction places that are unknown.
    wanted: Vec<usize>,
}

/// One for each robot of the layout.
pub(super) fn robot_data<'a>(layout: &'a Layout, recording: &'a Recording, plan: &Plan) -> Vec<RobotData<'a>> {
    let wanted = |robot: usize| {
        plan.unknowns.links(robot).map_or(Vec::new(), |block| match &plan.unknowns.blocks[block].kind {
            UnknownKind::Links { places, .. } => places.clone(),
            _ => Vec::new(),
        })
    };
    let one = |(index, robot): (usize, &'a Robot)| {
        let mut data = RobotData { chain: None, joints: Vec::new(), flange: Vec::new(), wanted: wanted(index) };
        if let Motion::Joints { chain, .. } = &robot.motion {
            data.chain = Some(chain);
        }
        match &recording.motions[index] {
            RobotMotion::Joints(values) => {
                data.joints =
                    plan.configurations.iter().map(|c| values.get(c).map_or(&[][..], Vec::as_slice)).collect();
            }
            RobotMotion::Flange(poses) => {
                data.flange = plan.configurations.iter().map(|c| poses.get(c).copied().unwrap_or_default()).collect();
            }
        }
        data
    };
    layout.robots.iter().enumerate().map(one).collect()
}

/// Evaluates every segment of the plan at every configuration. Nothing is allocated when `out` has been filled once.
pub(super) fn fill_segments(
    plan: &Plan,
    robots: &[RobotData<'_>],
    state: &State,
    derivatives: bool,
    out: &mut [SegmentValues],
) {
    let count = plan.configurations.len();
    for (segment, values) in plan.segments.iter().zip(out) {
        let robot = &robots[segment.robot];
        // A robot that is not identified stands where it stands: computed once.
        if robot.wanted.is_empty() && values.poses.len() == count {
            continue;
        }
        let Some(chain) = robot.chain else {
            values.poses.clone_from(&robot.flange);
            continue;
        };
        let (from, to, corrections) = (segment.from, segment.to, &state.corrections[segment.robot]);
        values.poses.resize(count, Pose::identity());
        let known = robot.joints.par_iter().zip(&mut values.poses);
        if derivatives && !robot.wanted.is_empty() {
            let wanted = &robot.wanted;
            values.jacobians.resize(count * wanted.len(), [0.0; 6]);
            known.zip(values.jacobians.par_chunks_mut(wanted.len())).for_each(|((joints, pose), columns)| {
                if !joints.is_empty() {
                    *pose = chain.differentiate_segment(joints, corrections, from, to, wanted, columns);
                }
            });
        } else {
            known.for_each(|(joints, pose)| {
                if !joints.is_empty() {
                    *pose = chain.segment(joints, corrections, from, to);
                }
            });
        }
    }
}

/// The robots of a layout that stop inexactly.
pub(super) fn stops(layout: &Layout) -> Vec<Stop> {
    let one = |(robot, described): (usize, &Robot)| {
        let [translation, rotation] = described.repeatability?;
        Some(Stop { robot, sigma: PoseSigma { translation: [translation; 3], rotation: [rotation; 3] } })
    };
    layout.robots.iter().enumerate().filter_map(one).collect()
}
