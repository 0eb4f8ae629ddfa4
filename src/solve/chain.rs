//! The transform along a path at one configuration, and its derivative to every unknown on the way.

use nalgebra::{Matrix6, Vector6};

use super::plan::{CompiledPath, CompiledStep};
use super::state::State;
use crate::geometry::Pose;

/// What the robots of a cell do at one state: for each compiled robot segment and configuration, its pose and, for a robot that is being
/// identified, how its link parameters move it.
#[derive(Clone, Debug, Default)]
pub(super) struct SegmentValues {
    /// `from_from_to` by configuration; identity where the robot's place is not known (no block uses it).
    pub(super) poses: Vec<Pose>,
    /// By configuration, one column for each unknown correction; empty for a robot that is not identified.
    pub(super) jacobians: Vec<[f64; 6]>,
}

/// The pose along a path, multiplied in the order of [`pose_and_jacobian`], so that both have the same bits.
pub(super) fn pose_along(path: &CompiledPath, configuration: usize, state: &State, segments: &[SegmentValues]) -> Pose {
    path.steps.iter().rev().fold(Pose::identity(), |after, step| value(step, configuration, state, segments) * after)
}

fn value(step: &CompiledStep, configuration: usize, state: &State, segments: &[SegmentValues]) -> Pose {
    let (pose, inverse) = match *step {
        CompiledStep::Static { edge, inverse, .. } => (state.static_poses[edge], inverse),
        CompiledStep::Moving { edge, inverse, .. } => (state.moving_poses[edge][configuration], inverse),
        CompiledStep::Robot { segment, inverse, .. } => (segments[segment].poses[configuration], inverse),
    };
    if inverse { pose.inverse() } else { pose }
}

/// The pose along a path and, in `jacobian`, its twist on the right per unit of each of the path's unknowns: column `c` of the path's own
/// numbering is `jacobian[c]`. Source of the rule: `A Exp(d) B = A B Exp(Ad(B^-1) d)`.
pub(super) fn pose_and_jacobian(
    path: &CompiledPath,
    configuration: usize,
    state: &State,
    segments: &[SegmentValues],
    jacobian: &mut [[f64; 6]],
) -> Pose {
    let mut after = Pose::identity();
    for step in path.steps.iter().rev() {
        let with = value(step, configuration, state, segments) * after;
        match *step {
            CompiledStep::Static { inverse, column: Some((column, count)), .. } => {
                let adjoint = signed_adjoint(if inverse { &with } else { &after }, inverse);
                for c in 0..count {
                    jacobian[column + c] = adjoint.column(c).into();
                }
            }
            CompiledStep::Moving { inverse, column, .. } => {
                let adjoint = signed_adjoint(if inverse { &with } else { &after }, inverse);
                for c in 0..6 {
                    jacobian[column + c] = adjoint.column(c).into();
                }
            }
            CompiledStep::Robot { segment, inverse, column: Some((column, count)), .. } => {
                let adjoint = signed_adjoint(if inverse { &with } else { &after }, inverse);
                let links = &segments[segment].jacobians[configuration * count..(configuration + 1) * count];
                for (c, link) in links.iter().enumerate() {
                    jacobian[column + c] = (adjoint * Vector6::from(*link)).into();
                }
            }
            CompiledStep::Static { column: None, .. } | CompiledStep::Robot { column: None, .. } => {}
        }
        after = with;
    }
    after
}

/// `Ad(T^-1)`, negated for a step that is walked upwards (`E^-1` moves by `Exp(-d) E^-1`).
fn signed_adjoint(pose: &Pose, negative: bool) -> Matrix6<f64> {
    let adjoint = pose.inverse_adjoint();
    if negative { -adjoint } else { adjoint }
}
