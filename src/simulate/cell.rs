//! A cell whose poses are all known, asked where things are.

use nalgebra::{Vector2, Vector3};

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
    pub tree: FrameTree,
    /// The robots' motion.
    pub recording: &'a Recording,
}

/// Beyond this angle (rad) between a face's normal and the line of sight, a tag is too slanted to be seen: 75 degrees.
const SLANTED: f64 = 1.31;

impl<'a> Cell<'a> {
    /// A cell from its layout and the motion in a recording.
    #[must_use]
    pub fn new(layout: &'a Layout, recording: &'a Recording) -> Self {
        Self { layout, tree: FrameTree::new(layout), recording }
    }

    /// `from_from_to` at a configuration; `None` if a pose on the way is not known, a robot was not recorded, or something moves by itself.
    #[must_use]
    pub fn pose(&self, from: FrameId, to: FrameId, configuration: u64) -> Option<Pose> {
        self.tree.path(from, to).steps.iter().try_fold(Pose::identity(), |pose, step| {
            let (value, inverse) = match *step {
                Step::Static { edge, inverse } => (self.tree.static_edges[edge].spec.truth()?, inverse),
                Step::Moving { .. } => return None,
                Step::Robot { robot, from, to, inverse } => {
                    (self.recording.robot_segment(self.layout, robot, configuration, from, to)?, inverse)
                }
            };
            Some(pose * if inverse { value.inverse() } else { value })
        })
    }

    /// The pixel of a point that lies on a face looking along `normal` (both in the camera's frame), if the camera sees it: in front, not too slanted, in the
    /// picture with `margin` pixels to spare.
    #[must_use]
    pub fn sees(
        &self,
        intrinsics: &Intrinsics,
        point: &Vector3<f64>,
        normal: Option<&Vector3<f64>>,
        margin: f64,
    ) -> Option<Vector2<f64>> {
        if let Some(normal) = normal
            && normal.angle(&-point) > SLANTED
        {
            return None;
        }
        let pixel = intrinsics.project(point)?;
        let [width, height] = intrinsics.size().map(f64::from);
        let inside = pixel.x >= margin && pixel.y >= margin && pixel.x < width - margin && pixel.y < height - margin;
        inside.then_some(pixel)
    }
}
