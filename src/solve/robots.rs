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

/// Configurations a task takes at least: fewer are not worth waking another thread.
const APIECE: usize = 64;

/// Evaluates every segment of the plan at every configuration; of a robot that is being identified at those only that are `seen`, if they are named.
/// Nothing is allocated when `out` has been filled once.
pub(super) fn fill_segments(
    plan: &Plan,
    robots: &[RobotData<'_>],
    state: &State,
    derivatives: bool,
    seen: Option<&[bool]>,
    out: &mut [SegmentValues],
) {
    let count = plan.configurations.len();
    for (segment, values) in plan.segments.iter().zip(out) {
        let robot = &robots[segment.robot];
        // A robot that is not identified stands where it stands: computed once.
        let still = robot.wanted.is_empty();
        if still && values.poses.len() == count {
            continue;
        }
        let Some(chain) = robot.chain else {
            values.poses.clone_from(&robot.flange);
            continue;
        };
        let (from, to, corrections) = (segment.from, segment.to, &state.corrections[segment.robot]);
        values.poses.resize(count, Pose::identity());
        let is_seen = |place: usize| still || seen.is_none_or(|seen| seen[place]);
        let wanted = |place: usize, joints: &[f64]| !joints.is_empty() && is_seen(place);
        let known = robot.joints.par_iter().with_min_len(APIECE).zip(&mut values.poses).enumerate();
        if derivatives && !still {
            let links = &robot.wanted;
            values.jacobians.resize(count * links.len(), [0.0; 6]);
            let columns = values.jacobians.par_chunks_mut(links.len());
            known.zip(columns).for_each(|((place, (joints, pose)), columns)| {
                if wanted(place, joints) {
                    *pose = chain.differentiate_segment(joints, corrections, from, to, links, columns);
                }
            });
        } else {
            known.for_each(|(place, (joints, pose))| {
                if wanted(place, joints) {
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
