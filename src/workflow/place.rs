//! Where every frame is at every configuration, at the solution.

use crate::frames::{Edge, FrameId, Step};
use crate::geometry::Pose;
use crate::layout::Motion;
use crate::recording::{Recording, RobotMotion};
use crate::workflow::solve::Solved;

/// Asks a solved cell where things are.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Places<'a> {
    pub(crate) solved: &'a Solved,
    pub(crate) recording: &'a Recording,
}

impl Places<'_> {
    /// `from_from_to` at a configuration (index into the plan's); none where something on the way was not recorded or not found.
    pub(crate) fn between(&self, from: FrameId, to: FrameId, configuration: usize) -> Option<Pose> {
        let s = self.solved;
        s.tree.path(from, to).steps.iter().try_fold(Pose::identity(), |pose, step| {
            let (value, inverse) = match *step {
                Step::Static { edge, inverse } => {
                    (*s.state.static_poses.get(edge).filter(|_| !self.lost(edge))?, inverse)
                }
                Step::Moving { edge, inverse } => {
                    let found = s.moved.get(edge).is_some_and(|at| at.contains(&configuration));
                    (*s.state.moving_poses.get(edge)?.get(configuration).filter(|_| found)?, inverse)
                }
                Step::Robot { robot, from, to, inverse } => (self.segment(robot, configuration, from, to)?, inverse),
            };
            Some(pose * if inverse { value.inverse() } else { value })
        })
    }

    /// `world_from_frame` at a configuration.
    pub(crate) fn world_from(&self, frame: FrameId, configuration: usize) -> Option<Pose> {
        self.between(0, frame, configuration)
    }

    /// Whether a frame never moves.
    pub(crate) fn stands(&self, frame: FrameId) -> bool {
        self.solved.tree.path(0, frame).is_static()
    }

    /// A static edge that nothing measured.
    fn lost(&self, edge: usize) -> bool {
        let frame = self.solved.tree.static_edges[edge].frame;
        self.solved.unseen.contains(&frame) && matches!(self.solved.tree.frames[frame].edge, Edge::Static(_))
    }

    fn segment(&self, robot: usize, configuration: usize, from: usize, to: usize) -> Option<Pose> {
        let s = self.solved;
        let id = *s.plan.configurations.get(configuration)?;
        match (&s.layout.robots[robot].motion, self.recording.motions.get(robot)?) {
            (Motion::Joints { chain, .. }, RobotMotion::Joints(values)) => {
                let corrections = s.state.corrections.get(robot).map_or(&[][..], Vec::as_slice);
                Some(chain.segment(values.get(&id)?, corrections, from, to))
            }
            _ => self.recording.robot_segment(&s.layout, robot, id, from, to),
        }
    }
}
