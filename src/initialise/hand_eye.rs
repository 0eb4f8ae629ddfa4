//! Robot-world/hand-eye calibration with candidates: `Z_c = X K_c Y`, with `Z` measured, `K` the robot, `X` and `Y` sought.
//!
//! Rotations by M. Shah, *Solving the Robot-World/Hand-Eye Calibration Problem Using the Kronecker Product*, J. Mech. Robotics 5(3), 2013;
//! translations then linearly. Samples of observations with one candidate each are solved in closed form and judged by how many other
//! observations have a candidate that agrees; the best is polished by Gauss-Newton. Degenerate motions (one axis, no turning at all) leave the closed form
//! without an answer; there, many starts and damping find one of the many solutions, and the solver later says which directions are free.

use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, SMatrix, SVector, UnitQuaternion, Vector3};
use rayon::prelude::*;

use super::consensus::{Votes, nearest};
use super::pose_from_points::cube_rotations;
use crate::geometry::{Pose, rotation};

/// One observation: the robot's known transform and what was measured.
#[derive(Clone, Debug)]
pub(super) struct HandEyeVote {
    /// `K`.
    pub(super) robot: Pose,
    /// Candidates for `Z`.
    pub(super) votes: Votes,
}

/// The two poses sought.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HandEye {
    /// `X`.
    pub near: Pose,
    /// `Y`.
    pub far: Pose,
    /// Mean disagreement of the observations, 0 (perfect) to 1.
    pub disagreement: f64,
}

/// Samples drawn. With four observations of two candidates each, one sample in sixteen is right by luck alone.
const SAMPLES: usize = 400;
/// Observations judged at most, spread evenly.
const JUDGED: usize = 150;
/// Observations in a sample.
const SAMPLE_SIZE: usize = 4;

/// Solves `Z_c = X K_c Y` for unambiguous, equally trusted observations `(K, Z)`.
#[must_use]
pub fn solve_hand_eye(observations: &[(Pose, Pose)]) -> Option<HandEye> {
    let votes: Vec<HandEyeVote> = observations
        .iter()
        .map(|(robot, measured)| HandEyeVote {
            robot: *robot,
            votes: Votes { candidates: vec![*measured], weight: 1.0, distance: measured.translation.norm() },
        })
        .collect();
    solve(&votes)
}

pub(super) fn solve(all: &[HandEyeVote]) -> Option<HandEye> {
    let stride = all.len().div_ceil(JUDGED).max(1);
    let votes: Vec<&HandEyeVote> = all.iter().step_by(stride).collect();
    let mut best: Option<HandEye> = None;
    let consider = |best: &mut Option<HandEye>, (near, far): (Pose, Pose)| {
        let disagreement = judge(&votes, &near, &far);
        if best.is_none_or(|known| disagreement < known.disagreement) {
            *best = Some(HandEye { near, far, disagreement });
        }
    };
    // A fixed generator: the same recording must give the same answer.
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let mut draw = |bound: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((state >> 33) as usize) % bound.max(1)
    };
    if votes.len() >= 3 {
        let mut sample = || -> Vec<(Pose, Pose)> {
            (0..SAMPLE_SIZE.min(votes.len()))
                .map(|_| {
                    let vote = votes[draw(votes.len())];
                    (vote.robot, vote.votes.candidates[draw(vote.votes.candidates.len())])
                })
                .collect()
        };
        let samples: Vec<Vec<(Pose, Pose)>> = (0..SAMPLES).map(|_| sample()).collect();
        let judged = |sample: &Vec<(Pose, Pose)>| {
            let (near, far) = closed_form(sample)?;
            Some(HandEye { near, far, disagreement: judge(&votes, &near, &far) })
        };
        let solutions: Vec<Option<HandEye>> = samples.par_iter().map(judged).collect();
        best = solutions.into_iter().flatten().min_by(|a, b| a.disagreement.total_cmp(&b.disagreement));
    }
    if best.is_none_or(|known| known.disagreement > 0.5) {
        // Degenerate or too few: one Gauss-Newton from each of many orientations.
        for turn in cube_rotations() {
            let (near, far) = from_orientation(&votes, turn)?;
            consider(&mut best, polish(&votes, near, far));
        }
    }
    let rough = best?;
    consider(&mut best, polish(&votes, rough.near, rough.far));
    best
}

/// Mean disagreement of the votes with `X K Y`.
fn judge(votes: &[&HandEyeVote], near: &Pose, far: &Pose) -> f64 {
    let total: f64 = votes.iter().map(|vote| vote.votes.weight).sum();
    let one = |vote: &&HandEyeVote| vote.votes.weight * nearest(&vote.votes, &(*near * vote.robot * *far)).1;
    votes.iter().map(one).sum::<f64>() / total
}

/// Shah's closed form for `(K, Z)` pairs; `None` if the rotations do not determine an answer.
fn closed_form(pairs: &[(Pose, Pose)]) -> Option<(Pose, Pose)> {
    // R_X^T R_Z = R_K R_Y, so vec(R_Y) = (R_Z^T (x) R_K^T) vec(R_X^T).
    let mut sum = SMatrix::<f64, 9, 9>::zeros();
    for (robot, measured) in pairs {
        sum += measured.rotation_matrix().transpose().kronecker(&robot.rotation_matrix().transpose());
    }
    let svd = DMatrix::from_column_slice(9, 9, sum.as_slice()).svd(true, true);
    let (u, v_t) = (svd.u.as_ref()?, svd.v_t.as_ref()?);
    let mut order: Vec<usize> = (0..9).collect();
    order.sort_by(|a, b| svd.singular_values[*b].total_cmp(&svd.singular_values[*a]));
    let (first, second) = (svd.singular_values[order[0]], svd.singular_values[order[1]]);
    if first - second < 1e-4 * first {
        return None;
    }
    let unvec = |v: DVector<f64>| {
        let m = Matrix3::from_column_slice(v.as_slice());
        rotation::nearest_rotation(&(m * m.determinant().signum()))
    };
    let near_inverse = unvec(v_t.row(order[0]).transpose())?;
    let far = unvec(u.column(order[0]).into_owned())?;
    translations(pairs.iter().map(|(k, z)| (*k, *z, 1.0)), near_inverse.inverse(), far)
}

/// The translations for given rotations: `R_X^T t_Z - t_K = R_K t_Y + R_X^T t_X`, least squares of smallest norm.
fn translations(
    pairs: impl Iterator<Item = (Pose, Pose, f64)>,
    near: UnitQuaternion<f64>,
    far: UnitQuaternion<f64>,
) -> Option<(Pose, Pose)> {
    let (mut gram, mut right) = (Matrix6::zeros(), SVector::<f64, 6>::zeros());
    for (robot, measured, weight) in pairs {
        let mut row = SMatrix::<f64, 3, 6>::zeros();
        row.fixed_view_mut::<3, 3>(0, 0).copy_from(&robot.rotation_matrix());
        row.fixed_view_mut::<3, 3>(0, 3).copy_from(&Matrix3::identity());
        let value = near.inverse() * measured.translation - robot.translation;
        gram += row.transpose() * row * weight;
        right += row.transpose() * value * weight;
    }
    let eigen = gram.symmetric_eigen();
    let largest = eigen.eigenvalues.max();
    let mut solution = SVector::<f64, 6>::zeros();
    for i in 0..6 {
        if eigen.eigenvalues[i] > 1e-9 * largest {
            let v = eigen.eigenvectors.column(i);
            solution += v * (v.dot(&right) / eigen.eigenvalues[i]);
        }
    }
    let far_translation: Vector3<f64> = solution.fixed_rows::<3>(0).into_owned();
    let near_translation = near * solution.fixed_rows::<3>(3).into_owned();
    let (near, far) = (Pose::new(near, near_translation), Pose::new(far, far_translation));
    (near.is_finite() && far.is_finite()).then_some((near, far))
}

/// `X` and `Y` for an assumed rotation of `Y`: `R_X` is the mean of `R_Z (R_K R_Y)^-1`.
fn from_orientation(votes: &[&HandEyeVote], far: UnitQuaternion<f64>) -> Option<(Pose, Pose)> {
    let first = |vote: &&HandEyeVote| (vote.robot, vote.votes.candidates.first().copied().unwrap_or_default());
    let mut sum = Matrix3::zeros();
    for (robot, measured) in votes.iter().map(first) {
        sum += (measured.rotation * (robot.rotation * far).inverse()).to_rotation_matrix().into_inner();
    }
    let near = rotation::nearest_rotation(&sum).unwrap_or_default();
    translations(votes.iter().map(first).map(|(k, z)| (k, z, 1.0)), near, far)
}

/// Gauss-Newton on `log(Z^-1 X K Y)`, each observation by its nearest candidate and weighted down as it disagrees.
fn polish(votes: &[&HandEyeVote], mut near: Pose, mut far: Pose) -> (Pose, Pose) {
    let mut lambda = 1e-6;
    let mut current = judge(votes, &near, &far);
    for _ in 0..30 {
        let mut hessian = DMatrix::<f64>::zeros(12, 12);
        let mut gradient = DVector::<f64>::zeros(12);
        for vote in votes {
            let after = vote.robot * far;
            let predicted = near * after;
            let (place, far_off) = nearest(&vote.votes, &predicted);
            let measured = &vote.votes.candidates[place];
            // Far from everything the cost is flat; a little weight still pulls a bad start in.
            let weight = vote.votes.weight * (1.0 - far_off).max(0.05);
            let residual = (measured.inverse() * predicted).log();
            let mut jacobian = SMatrix::<f64, 6, 12>::zeros();
            jacobian.fixed_view_mut::<6, 6>(0, 0).copy_from(&after.inverse_adjoint());
            jacobian.fixed_view_mut::<6, 6>(0, 6).copy_from(&Matrix6::identity());
            let scale = scales(vote.votes.distance);
            let scaled = Matrix6::from_diagonal(&scale);
            let (j, r) = (scaled * jacobian, scaled * residual);
            hessian += DMatrix::from_column_slice(12, 12, (j.transpose() * j * weight).as_slice());
            gradient += DVector::from_column_slice((j.transpose() * r * weight).as_slice());
        }
        let mut damped = hessian.clone();
        let largest = hessian.diagonal().max();
        for i in 0..12 {
            damped[(i, i)] += lambda * hessian[(i, i)].max(1e-9 * largest) + 1e-12;
        }
        let Some(factor) = damped.cholesky() else { break };
        let step = -factor.solve(&gradient);
        let trial_near = near.retract(&step.fixed_rows::<6>(0).into_owned());
        let trial_far = far.retract(&step.fixed_rows::<6>(6).into_owned());
        let trial = judge(votes, &trial_near, &trial_far);
        if trial <= current && trial_near.is_finite() && trial_far.is_finite() {
            let done = current - trial < 1e-9 && step.norm() < 1e-6;
            (near, far, current) = (trial_near, trial_far, trial);
            lambda = (lambda * 0.1).max(1e-9);
            if done {
                break;
            }
        } else {
            lambda = lambda.max(1e-7) * 10.0;
            if lambda > 1e4 {
                break;
            }
        }
    }
    (near, far)
}

/// One over the disagreement that counts as one, for each component of a twist.
fn scales(distance: f64) -> SVector<f64, 6> {
    let (t, r) = (1.0 / (super::consensus::SHIFT * distance.max(1e-3)), 1.0 / super::consensus::TURN);
    SVector::from([t, t, t, r, r, r])
}
