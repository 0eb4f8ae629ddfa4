//! The robots' part of every path: poses of the segments at each configuration, and how link parameters move them.

use rayon::prelude::*;
use std::collections::BTreeMap;

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
                    at(&plan.configurations, values).map(|joints| joints.map_or(&[][..], Vec::as_slice)).collect();
            }
            RobotMotion::Flange(poses) => {
                data.flange = at(&plan.configurations, poses).map(|pose| pose.copied().unwrap_or_default()).collect();
            }
        }
        data
    };
    layout.robots.iter().enumerate().map(one).collect()
}

/// What is recorded at each of some configurations, ascending. One walk over both, since to look up each takes the longer the more there are.
fn at<'a, T>(configurations: &[u64], recorded: &'a BTreeMap<u64, T>) -> impl Iterator<Item = Option<&'a T>> {
    let mut known = recorded.range(configurations.first().copied().unwrap_or(0)..).peekable();
    configurations.iter().map(move |wanted| {
        while known.next_if(|(configuration, _)| *configuration < wanted).is_some() {}
        known.peek().filter(|(configuration, _)| *configuration == wanted).map(|(_, one)| *one)
    })
}

/// Configurations a task takes: fewer are not worth waking another thread.
const APIECE: usize = 64;

/// What [`fill_segments`] is to fill.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wanted<'a> {
    /// How link parameters move the segments, too.
    pub(super) derivatives: bool,
    /// Of a robot that is being identified only these configurations, if they are named.
    pub(super) seen: Option<&'a [bool]>,
    /// Whether one thread is enough.
    pub(super) alone: bool,
}

/// Evaluates every segment of the plan at every configuration. Nothing is allocated when `out` has been filled once.
pub(super) fn fill_segments(
    plan: &Plan,
    robots: &[RobotData<'_>],
    state: &State,
    wanted: Wanted<'_>,
    out: &mut [SegmentValues],
) {
    let count = plan.configurations.len();
    for (segment, values) in plan.segments.iter().zip(out) {
        let robot = &robots[segment.robot];
        let links = &robot.wanted;
        // A robot that is not identified stands where it stands: computed once.
        let still = links.is_empty();
        if still && values.poses.len() == count {
            continue;
        }
        let Some(chain) = robot.chain else {
            values.poses.clone_from(&robot.flange);
            continue;
        };
        let (from, to, corrections) = (segment.from, segment.to, &state.corrections[segment.robot]);
        let is_seen = |place: usize| still || wanted.seen.is_none_or(|seen| seen[place]);
        let fill = |first: usize, poses: &mut [Pose], jacobians: &mut [[f64; 6]]| {
            let mut columns = jacobians.chunks_exact_mut(links.len().max(1));
            for (place, pose) in (first..).zip(poses) {
                let (joints, columns) = (robot.joints[place], columns.next());
                if joints.is_empty() || !is_seen(place) {
                    continue;
                }
                *pose = match columns {
                    Some(columns) => chain.differentiate_segment(joints, corrections, from, to, links, columns),
                    None => chain.segment(joints, corrections, from, to),
                };
            }
        };
        let SegmentValues { poses, jacobians } = values;
        poses.resize(count, Pose::identity());
        let differentiated = wanted.derivatives && !still;
        if differentiated {
            jacobians.resize(count * links.len(), [0.0; 6]);
        }
        match (wanted.alone, differentiated) {
            (true, true) => fill(0, poses, jacobians),
            (true, false) => fill(0, poses, &mut []),
            (false, true) => {
                let columns = jacobians.par_chunks_mut(APIECE * links.len());
                let runs = poses.par_chunks_mut(APIECE).zip(columns).enumerate();
                runs.for_each(|(run, (poses, columns))| fill(run * APIECE, poses, columns));
            }
            (false, false) => {
                let runs = poses.par_chunks_mut(APIECE).enumerate();
                runs.for_each(|(run, poses)| fill(run * APIECE, poses, &mut []));
            }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_recorded_is_found_where_it_is() {
        let recorded: BTreeMap<u64, u64> = [1, 4, 5, 9, 12].into_iter().map(|c| (c, 10 * c)).collect();
        for wanted in [&[0, 1, 2, 5, 9, 10, 12, 13][..], &[4, 5], &[12], &[13, 14], &[]] {
            let found: Vec<Option<&u64>> = at(wanted, &recorded).collect();
            assert_eq!(found, wanted.iter().map(|c| recorded.get(c)).collect::<Vec<_>>());
        }
    }
}
