//! A cell whose poses are all known, asked where things are.

use nalgebra::{Vector2, Vector3};
use std::collections::BTreeMap;
use std::sync::Arc;

use crate::frames::{FrameId, FrameTree, Step};
use crate::geometry::{Intrinsics, Pose};
use crate::layout::Layout;
use crate::recording::Recording;

/// A layout with its frames and the robots' motion.
#[derive(Debug)]
pub struct Cell<'a> {
    /// The layout; every pose known.
    pub layout: &'a Layout,
    /// Its frames.
    pub tree: Arc<FrameTree>,
    /// The robots' motion.
    pub recording: &'a Recording,
    /// What differs from what anybody wrote down.
    pub disturbances: Disturbances,
    /// Angle (rad) between a face's normal and the line of sight beyond which a tag is not seen.
    pub slanted: f64,
    /// Pixels at the edge of a picture in which nothing is seen.
    pub margin: f64,
}

/// How a real cell differs from its description and its log.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Disturbances {
    /// `flange_from_real_flange` by robot and configuration: a robot never stops at quite the same place.
    pub stops: BTreeMap<(usize, u64), Pose>,
    /// Poses of targets that move by themselves, by moving edge and configuration.
    pub moving: BTreeMap<(usize, u64), Pose>,
    /// A static edge that somebody bumped: from a configuration on, its pose is this.
    pub bumped: Option<(usize, u64, Pose)>,
}

/// Beyond this angle (rad) between a face's normal and the line of sight, a tag is too slanted to be seen, unless said otherwise: 75 degrees.
const SLANTED: f64 = 1.31;
/// A corner keeps this far (px) from the picture's edge.
const MARGIN: f64 = 4.0;

impl<'a> Cell<'a> {
    /// A cell from its layout and the motion in a recording, undisturbed.
    #[must_use]
    pub fn new(layout: &'a Layout, recording: &'a Recording) -> Self {
        Self::with_tree(layout, recording, Arc::new(FrameTree::new(layout)))
    }

    /// As [`Cell::new`], with frames that were made before.
    #[must_use]
    pub fn with_tree(layout: &'a Layout, recording: &'a Recording, tree: Arc<FrameTree>) -> Self {
        Self { layout, tree, recording, disturbances: Disturbances::default(), slanted: SLANTED, margin: MARGIN }
    }

    /// `from_from_to` at a configuration; `None` if a pose on the way is not known or a robot was not recorded.
    #[must_use]
    pub fn pose(&self, from: FrameId, to: FrameId, configuration: u64) -> Option<Pose> {
        self.tree.path(from, to).steps.iter().try_fold(Pose::identity(), |pose, step| {
            let (value, inverse) = match *step {
                Step::Static { edge, inverse } => (self.static_pose(edge, configuration)?, inverse),
                Step::Moving { edge, inverse } => (*self.disturbances.moving.get(&(edge, configuration))?, inverse),
                Step::Robot { robot, from, to, inverse } => {
                    (self.robot_segment(robot, configuration, from, to)?, inverse)
                }
            };
            Some(pose * if inverse { value.inverse() } else { value })
        })
    }

    fn static_pose(&self, edge: usize, configuration: u64) -> Option<Pose> {
        match self.disturbances.bumped {
            Some((bumped, from, pose)) if bumped == edge && configuration >= from => Some(pose),
            _ => self.tree.static_edges[edge].spec.truth(),
        }
    }

    fn robot_segment(&self, robot: usize, configuration: u64, from: usize, to: usize) -> Option<Pose> {
        let nominal = self.recording.robot_segment(self.layout, robot, configuration, from, to)?;
        let at_flange = to + 1 == self.tree.robots[robot].len();
        match self.disturbances.stops.get(&(robot, configuration)) {
            Some(flange_from_real) if at_flange => Some(nominal * *flange_from_real),
            _ => Some(nominal),
        }
    }

    /// The pixel of a point that lies on a face looking along `normal` (both in the camera's frame), if the camera sees it: in front, not too slanted, in the
    /// picture and not in its margin.
    #[must_use]
    pub fn sees(
        &self,
        intrinsics: &Intrinsics,
        point: &Vector3<f64>,
        normal: Option<&Vector3<f64>>,
    ) -> Option<Vector2<f64>> {
        if let Some(normal) = normal
            && normal.angle(&-point) > self.slanted
        {
            return None;
        }
        let pixel = intrinsics.project(point)?;
        let [width, height] = intrinsics.size().map(f64::from);
        let margin = self.margin;
        let inside = pixel.x >= margin && pixel.y >= margin && pixel.x < width - margin && pixel.y < height - margin;
        inside.then_some(pixel)
    }
}
