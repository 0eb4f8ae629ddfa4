//! Things that moved while the recording was made: for each pose that should stand still, where in the sequence of configurations it changed.
//!
//! What each picture by itself says of a pose is a sequence. Its best single change point is the one that leaves the least scatter on both
//! sides (least squares; Hinkley, *Inference about the change-point in a sequence of random variables*, Biometrika 57, 1970).

use nalgebra::Vector6;

use super::sightings::{ARM, Sighting, implied};
use super::undetermined::Evidence;
use crate::frames::{FrameId, Step};
use crate::geometry::{Pose, rotation};

/// A pose that may have changed.
#[derive(Clone, Debug, PartialEq)]
pub struct Change {
    /// Index into the tree's static edges.
    pub edge: usize,
    /// The frame that hangs on it.
    pub frame: FrameId,
    /// The first configuration (of the plan) after the change.
    pub from: usize,
    /// The share of the scatter that one step explains, 0 to 1.
    pub explained: f64,
    /// `after^-1 before`, by the middle of each side.
    pub step: Pose,
    /// Scatter that is left on both sides (m at an arm's length).
    pub scatter: f64,
}

/// Configurations that a side must have.
const LEAST: usize = 3;

/// The best change point of every static edge, the clearest first.
#[must_use]
pub fn changes(evidence: &Evidence<'_>, sightings: &[Vec<Sighting>]) -> Vec<Change> {
    let edges = 0..evidence.tree.static_edges.len();
    let mut all: Vec<Change> =
        edges.filter_map(|edge| change(&values(evidence, sightings, edge), evidence, edge)).collect();
    all.sort_by(|a, b| b.explained.total_cmp(&a.explained).then(a.edge.cmp(&b.edge)));
    all
}

/// What each sighting says of an edge, with its configuration, in the order of configurations.
#[must_use]
pub fn values(evidence: &Evidence<'_>, sightings: &[Vec<Sighting>], edge: usize) -> Vec<(usize, Pose)> {
    let mut all = Vec::new();
    for (group, sightings) in evidence.plan.groups.iter().zip(sightings) {
        let crosses = |step: &Step| matches!(step, Step::Static { edge: e, .. } if *e == edge);
        let Some(at) = group.path.steps.iter().position(crosses) else { continue };
        if group.path.steps.iter().any(|step| matches!(step, Step::Moving { .. })) {
            continue;
        }
        all.extend(sightings.iter().filter_map(|s| Some((s.configuration, implied(evidence, &group.path, at, s)?))));
    }
    all.sort_by_key(|(configuration, _)| *configuration);
    all
}

/// Component by component, the middle of poses that are near each other.
#[must_use]
pub fn middle(poses: &[Pose]) -> Pose {
    let Some(first) = poses.first() else { return Pose::identity() };
    let mut reference = *first;
    // The chart is moved to the middle that it found: one bad pose in front must not matter.
    for _ in 0..2 {
        let charted: Vec<Vector6<f64>> = poses.iter().map(|pose| chart(&reference, pose)).collect();
        let step = Vector6::from_fn(|i, _| median(charted.iter().map(|v| v[i]).collect()));
        let turn = step.fixed_rows::<3>(3) / ARM;
        let translation = reference.translation + step.fixed_rows::<3>(0);
        reference = Pose::new(reference.rotation * rotation::exp(&turn), translation);
    }
    reference
}

fn median(mut values: Vec<f64>) -> f64 {
    let middle = values.len() / 2;
    if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(middle, f64::total_cmp).1 }
}

fn chart(reference: &Pose, pose: &Pose) -> Vector6<f64> {
    let turn = rotation::log(&(reference.rotation.inverse() * pose.rotation)) * ARM;
    let shift = pose.translation - reference.translation;
    Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z)
}

/// Median distance (m at an arm's length) of poses from their middle.
#[must_use]
pub fn scatter(poses: &[Pose]) -> f64 {
    let centre = middle(poses);
    median(poses.iter().map(|pose| chart(&centre, pose).norm()).collect())
}

fn change(values: &[(usize, Pose)], evidence: &Evidence<'_>, edge: usize) -> Option<Change> {
    let poses: Vec<Pose> = values.iter().map(|(_, pose)| *pose).collect();
    let centre = middle(&poses);
    let mut charted: Vec<Vector6<f64>> = poses.iter().map(|pose| chart(&centre, pose)).collect();
    let spread = median(charted.iter().map(|v| v.norm()).collect()).max(1e-9);
    // What is far out is an outlier, not a step; it counts as if it were at the rim.
    for v in &mut charted {
        let norm = v.norm();
        if norm > 4.0 * spread {
            *v *= 4.0 * spread / norm;
        }
    }
    let total: Vector6<f64> = charted.iter().sum();
    let squares: f64 = charted.iter().map(|v| v.norm_squared()).sum();
    let all = charted.len() as f64;
    let whole = squares - total.norm_squared() / all;
    let mut configurations: Vec<usize> = values.iter().map(|(c, _)| *c).collect();
    configurations.dedup();
    if configurations.len() < 2 * LEAST || whole <= 0.0 {
        return None;
    }
    let (mut sum, mut best) = (Vector6::zeros(), (0.0, 0));
    for i in 1..values.len() {
        sum += charted[i - 1];
        let boundary = values[i].0 != values[i - 1].0;
        let side = configurations.partition_point(|c| *c < values[i].0);
        if !boundary || side < LEAST || configurations.len() - side < LEAST {
            continue;
        }
        let (left, right) = (i as f64, all - i as f64);
        let between = sum.norm_squared() / left + (total - sum).norm_squared() / right - total.norm_squared() / all;
        if between > best.0 {
            best = (between, i);
        }
    }
    let (between, at) = best;
    if at == 0 {
        return None;
    }
    let (before, after) = (middle(&poses[..at]), middle(&poses[at..]));
    Some(Change {
        edge,
        frame: evidence.tree.static_edges[edge].frame,
        from: values[at].0,
        explained: between / whole,
        step: after.inverse() * before,
        scatter: scatter(&poses[..at]).max(scatter(&poses[at..])),
    })
}
