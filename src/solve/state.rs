//! The numbers that are being found.

use super::unknowns::{UnknownKind, Unknowns};
use crate::frames::{FrameTree, Freedom};
use crate::geometry::Pose;
use crate::geometry::lens::MAX_PARAMETERS;
use crate::geometry::pose::Twist;

/// A value for every edge, link parameter and lens of a cell, known ones included.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct State {
    /// `parent_from_child` of each static edge.
    pub static_poses: Vec<Pose>,
    /// `parent_from_child` of each moving edge at each configuration of the plan; after them, for each robot that stops inexactly, `flange_from_real_flange`.
    pub moving_poses: Vec<Vec<Pose>>,
    /// Link corrections of each robot; empty for a robot that is not identified.
    pub corrections: Vec<Vec<f64>>,
    /// Lens parameters of each camera; zeros for a camera without a lens.
    pub lenses: Vec<[f64; MAX_PARAMETERS]>,
}

impl State {
    /// Takes the values of another state of the same cell, without allocating.
    pub(super) fn copy_from(&mut self, other: &Self) {
        self.static_poses.clone_from(&other.static_poses);
        self.moving_poses.clone_from(&other.moving_poses);
        self.corrections.clone_from(&other.corrections);
        self.lenses.clone_from(&other.lenses);
    }

    /// Takes a step of the shared unknowns.
    pub(super) fn advance(&mut self, unknowns: &Unknowns, tree: &FrameTree, step: &[f64]) {
        for block in &unknowns.blocks {
            let d = &step[block.start..block.start + block.count()];
            match &block.kind {
                UnknownKind::Edge(edge) => {
                    let pose = &mut self.static_poses[*edge];
                    *pose = match tree.static_edges[*edge].freedom {
                        Freedom::Pose => pose.retract(&Twist::from_column_slice(d)),
                        Freedom::Translation => *pose * Pose::from_translation(d[0], d[1], d[2]),
                        Freedom::Fixed => *pose,
                    };
                }
                UnknownKind::Links { robot, places, .. } => {
                    for (place, d) in places.iter().zip(d) {
                        self.corrections[*robot][*place] += d;
                    }
                }
                UnknownKind::Lens { camera, places } => {
                    for (place, d) in places.iter().zip(d) {
                        let value = &mut self.lenses[*camera][*place];
                        // A focal length stays positive: a step never takes more than half of it.
                        *value = if *place < 2 { (*value + d).max(0.5 * *value) } else { *value + d };
                    }
                }
            }
        }
    }

    /// Whether every number is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.static_poses.iter().chain(self.moving_poses.iter().flatten()).all(Pose::is_finite)
            && self.corrections.iter().flatten().all(|x| x.is_finite())
            && self.lenses.iter().flatten().all(|x| x.is_finite())
    }
}
