//! The pose that most observations agree on, where each observation may offer several candidates.

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use crate::geometry::{Pose, rotation};

/// Candidates that one observation offers for the same pose, and how far they can be trusted.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Votes {
    /// The candidates.
    pub(super) candidates: Vec<Pose>,
    /// How many measurements stand behind them.
    pub(super) weight: f64,
    /// The distance (m) at which they were seen: sets how much disagreement in translation is to be expected.
    pub(super) distance: f64,
}

/// Disagreement in rotation (rad) at which a vote counts nothing: a small tag's tilt is no better.
pub(super) const TURN: f64 = 0.15;
/// The same for translation, as a fraction of the distance seen from.
pub(super) const SHIFT: f64 = 0.08;

/// How badly two poses disagree, from 0 to 1.
pub(super) fn disagreement(a: &Pose, b: &Pose, distance: f64) -> f64 {
    let reach = SHIFT * distance.max(1e-3);
    let apart = (a.translation - b.translation).norm_squared() / (reach * reach);
    // Most pairs are far apart, and need no angle to tell: |cos(angle / 2)| < 0.997 is beyond 0.15 rad.
    if apart >= 1.0 || a.rotation.coords.dot(&b.rotation.coords).abs() < 0.997 {
        return 1.0;
    }
    let turn = a.rotation.angle_to(&b.rotation) / TURN;
    (apart + turn * turn).min(1.0)
}

/// Hypotheses tried at most: enough to meet a good one, cheap enough for thousands of pictures.
const HYPOTHESES: usize = 60;

/// The consensus of votes, and its mean disagreement (0 is perfect, 1 is none). Every candidate of a sample of observations is tried as the
/// answer; the best is then averaged with the candidates nearest to it.
pub(super) fn consensus(votes: &[Votes]) -> Option<(Pose, f64)> {
    let total: f64 = votes.iter().map(|vote| vote.weight).sum();
    let cost = |pose: &Pose| {
        let sum: f64 = votes.iter().map(|vote| vote.weight * nearest(vote, pose).1).sum();
        sum / total
    };
    let stride = votes.len().div_ceil(HYPOTHESES).max(1);
    let hypotheses: Vec<(usize, &Pose)> =
        votes.iter().step_by(stride).flat_map(|vote| vote.candidates.iter().enumerate()).collect();
    // Candidates come best fit first; among equals the better fit wins.
    let score = |(rank, candidate): &(usize, &Pose)| cost(candidate) + 1e-3 * *rank as f64;
    let scores: Vec<f64> = hypotheses.par_iter().map(score).collect();
    let best = (0..scores.len()).min_by(|a, b| scores[*a].total_cmp(&scores[*b]))?;
    let (mut pose, mut score) = (*hypotheses[best].1, scores[best]);
    for _ in 0..3 {
        let Some(mean) = mean_near(votes, &pose) else { break };
        let mean_score = cost(&mean);
        if mean_score > score {
            break;
        }
        (pose, score) = (mean, mean_score);
    }
    Some((pose, score))
}

/// The candidate nearest to a pose, its place and its disagreement.
pub(super) fn nearest(vote: &Votes, pose: &Pose) -> (usize, f64) {
    vote.candidates
        .iter()
        .map(|candidate| disagreement(candidate, pose, vote.distance))
        .enumerate()
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .unwrap_or((0, 1.0))
}

fn mean_near(votes: &[Votes], pose: &Pose) -> Option<Pose> {
    let (mut translation, mut turn, mut total) = (Vector3::zeros(), Matrix3::zeros(), 0.0);
    for vote in votes {
        let (place, far) = nearest(vote, pose);
        if far < 1.0 {
            let weight = vote.weight * (1.0 - far);
            translation += vote.candidates[place].translation * weight;
            turn += vote.candidates[place].rotation_matrix() * weight;
            total += weight;
        }
    }
    (total > 0.0).then_some(())?;
    Some(Pose::new(rotation::nearest_rotation(&turn)?, translation / total))
}
