//! How certain the pose between any two frames is, by first-order propagation along the path.
//!
//! The path's twist at its end moves by `J_s d_s + J_l d_l`, with the shared unknowns `d_s` and those of one configuration alone, `d_l` (a target that moves, a
//! robot's inexact stop). The latter follow the former, `d_l = -G d_s + e`, and keep an uncertainty of their own, `cov e = H_ll^-1`.

use nalgebra::{DMatrix, Matrix3};

use super::covariance::Covariance;
use super::undetermined::Evidence;
use crate::frames::{FrameId, FrameTree, Freedom, Step};
use crate::geometry::Pose;
use crate::solve::{Assembler, Loss, Plan, Priors};

/// A direction that is undetermined to more than this share makes what depends on it undetermined.
const SHARE: f64 = 0.01;

/// A pose between two frames with its standard deviations.
#[derive(Clone, Debug, PartialEq)]
pub struct Relative {
    /// `from_from_to`.
    pub pose: Pose,
    /// Covariance of the translation (m) and of the rotation vector (rad), both in the axes of `from`, from the information matrix.
    pub information: DMatrix<f64>,
    /// The same, cluster-robust.
    pub clusters: DMatrix<f64>,
    /// Standard deviations from the information, from the clusters, and the ones to use; none where undetermined.
    pub sigma: [[Option<f64>; 6]; 3],
}

/// The pose of `to` in `from` at a configuration (an index into the plan's; any will do for frames that stand still against each other).
#[must_use]
pub fn relative(
    evidence: &Evidence<'_>,
    covariance: &Covariance,
    from: FrameId,
    to: FrameId,
    configuration: usize,
) -> Relative {
    let Evidence { layout, tree, recording, plan, state, .. } = *evidence;
    let mut longer = plan.clone();
    let path = longer.path(tree, from, to);
    let mut assembler = Assembler::new(layout, recording, &longer, Priors::default());
    assembler.set_loss(Loss::Squared);
    let (pose, along) = assembler.along(&path, configuration, state);
    let mut jacobian = DMatrix::zeros(6, plan.unknowns.count);
    for &(column, shared, count) in &path.shared {
        let mut part = jacobian.columns_mut(shared, count);
        part += along.columns(column, count);
    }
    let mut own = DMatrix::zeros(6, 6);
    let local = if path.moving.is_empty() { None } else { assembler.local_gain(configuration, state) };
    if let Some(local) = local {
        let mut across = DMatrix::zeros(6, 6 * local.edges.len());
        for &(column, edge) in &path.moving {
            if let Some(slot) = local.edges.iter().position(|known| *known == edge) {
                across.columns_mut(6 * slot, 6).copy_from(&along.columns(column, 6));
            }
        }
        let follows = &across * &local.gain;
        for (i, &column) in local.shared.iter().enumerate() {
            let mut part = jacobian.column_mut(column);
            part -= follows.column(i);
        }
        own = &across * &local.covariance * across.transpose() * covariance.noise.powi(2);
    }
    // The twist is in the axes of `to`; translations and rotations are said in those of `from`.
    let turn = both(&pose.rotation_matrix());
    let (jacobian, own) = (&turn * jacobian, &turn * own * turn.transpose());
    let unmeasured = path_has_unmeasured(tree, plan, from, to);
    let determined: Vec<bool> =
        covariance.determined(&jacobian, SHARE).into_iter().map(|fine| fine && !unmeasured).collect();
    let [information, clusters, shown] = covariance.of(&jacobian).map(|matrix| matrix + &own);
    let sigma = |variance: &dyn Fn(usize) -> f64| -> [Option<f64>; 6] {
        std::array::from_fn(|i| determined[i].then(|| variance(i).max(0.0).sqrt()))
    };
    let at = |matrix: &DMatrix<f64>, i: usize| matrix[(i, i)];
    let sigma = [
        sigma(&|i| at(&information, i)),
        sigma(&|i| at(&clusters, i)),
        sigma(&|i| at(&information, i).max(at(&shown, i))),
    ];
    Relative { pose, information, clusters, sigma }
}

/// Whether the path crosses a pose that is to be found and that no measurement mentions.
fn path_has_unmeasured(tree: &FrameTree, plan: &Plan, from: FrameId, to: FrameId) -> bool {
    tree.path(from, to).steps.iter().any(|step| match step {
        Step::Static { edge, .. } => {
            tree.static_edges[*edge].freedom != Freedom::Fixed && plan.unknowns.edge(*edge).is_none()
        }
        _ => false,
    })
}

fn both(rotation: &Matrix3<f64>) -> DMatrix<f64> {
    let mut turn = DMatrix::zeros(6, 6);
    turn.view_mut((0, 0), (3, 3)).copy_from(rotation);
    turn.view_mut((3, 3), (3, 3)).copy_from(rotation);
    turn
}
