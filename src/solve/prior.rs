//! Priors: beliefs about poses and link parameters that come from the layout.

use nalgebra::{Matrix6, Vector6};

use super::assemble::Normal;
use super::plan::Plan;
use super::state::State;
use super::unknowns::{UnknownKind, Unknowns};
use crate::frames::FrameTree;
use crate::geometry::{Pose, rotation};
use crate::layout::{PoseSigma, PoseSpec};

/// All priors of a problem.
#[derive(Clone, Debug, Default)]
pub struct Priors {
    /// (static edge, first shared column, expected pose, standard deviations).
    poses: Vec<(usize, usize, Pose, PoseSigma)>,
    /// (robot, place in the correction vector, shared column, standard deviation); the expected value is zero.
    links: Vec<(usize, usize, usize, f64)>,
}

impl Priors {
    /// The priors on the given unknowns.
    #[must_use]
    pub fn new(tree: &FrameTree, unknowns: &Unknowns) -> Self {
        let mut priors = Self::default();
        for block in &unknowns.blocks {
            match &block.kind {
                UnknownKind::Edge(edge) => {
                    if let PoseSpec::Prior(pose, sigma) = tree.static_edges[*edge].spec {
                        priors.poses.push((*edge, block.start, pose, sigma));
                    }
                }
                UnknownKind::Links { robot, places, sigmas } => {
                    for (i, (place, sigma)) in places.iter().zip(sigmas).enumerate() {
                        if let Some(sigma) = sigma {
                            priors.links.push((*robot, *place, block.start + i, *sigma));
                        }
                    }
                }
                UnknownKind::Lens { .. } => {}
            }
        }
        priors
    }

    /// The number of scalar beliefs.
    #[must_use]
    pub fn scalar_count(&self) -> usize {
        6 * self.poses.len() + self.links.len()
    }

    /// The equations of the beliefs alone.
    #[must_use]
    pub fn equations(&self, plan: &Plan, state: &State) -> Normal {
        let mut normal = Normal::default();
        normal.reset(plan);
        self.add(state, &mut normal);
        normal
    }

    /// Adds the beliefs to the equations.
    pub(super) fn add(&self, state: &State, normal: &mut Normal) {
        for (edge, start, expected, sigma) in &self.poses {
            let pose = &state.static_poses[*edge];
            let (residual, jacobian) = pose_prior(expected, pose, sigma);
            let (hessian, gradient) = (jacobian.transpose() * jacobian, jacobian.transpose() * residual);
            for i in 0..6 {
                normal.gradient[start + i] += gradient[i];
                for j in 0..6 {
                    normal.add(start + i, start + j, hessian[(i, j)]);
                }
            }
        }
        for (robot, place, column, sigma) in &self.links {
            let value = state.corrections[*robot][*place] / sigma;
            normal.gradient[*column] += value / sigma;
            normal.add(*column, *column, 1.0 / (sigma * sigma));
        }
        normal.cost += self.cost(state);
    }

    /// The cost of the beliefs.
    pub(super) fn cost(&self, state: &State) -> f64 {
        let poses = self.poses.iter().map(|(edge, _, expected, sigma)| {
            0.5 * pose_prior(expected, &state.static_poses[*edge], sigma).0.norm_squared()
        });
        let links = self.links.iter().map(|(robot, place, _, sigma)| {
            let value = state.corrections[*robot][*place] / sigma;
            0.5 * value * value
        });
        poses.sum::<f64>() + links.sum::<f64>()
    }
}

/// Whitened difference from the expected pose (translation in the parent's axes, rotation vector of `expected^-1 pose`) and its derivative.
pub(super) fn pose_prior(expected: &Pose, pose: &Pose, sigma: &PoseSigma) -> (Vector6<f64>, Matrix6<f64>) {
    let translation = pose.translation - expected.translation;
    let turn = rotation::log(&(expected.rotation.inverse() * pose.rotation));
    let (r, slope) = (pose.rotation_matrix(), rotation::right_jacobian_inverse(&turn));
    let (mut residual, mut jacobian) = (Vector6::zeros(), Matrix6::zeros());
    for i in 0..3 {
        residual[i] = translation[i] / sigma.translation[i];
        residual[i + 3] = turn[i] / sigma.rotation[i];
        for j in 0..3 {
            jacobian[(i, j)] = r[(i, j)] / sigma.translation[i];
            jacobian[(i + 3, j + 3)] = slope[(i, j)] / sigma.rotation[i];
        }
    }
    (residual, jacobian)
}
