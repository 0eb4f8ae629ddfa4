//! Measurements that do not belong: found by their residual against the scale that the bulk shows, and set aside.

use super::residuals::Residuals;
use crate::solve::Plan;

/// A residual this many times the bulk's scale is set aside. Of a two-dimensional Gaussian four in a million lie beyond; what real cells show there is
/// wrong ids, dragged corners and shifted logs.
const TIMES: f64 = 5.0;

/// How many of each kind have been set aside.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rejected {
    /// Corners.
    pub corners: usize,
    /// Measured poses.
    pub poses: usize,
    /// Measured points.
    pub points: usize,
    /// Measurements of moving targets at configurations where too little of them was seen.
    pub unplaced: usize,
}

impl Rejected {
    /// Counts more.
    pub fn add(&mut self, more: Self) {
        self.corners += more.corners;
        self.poses += more.poses;
        self.points += more.points;
        self.unplaced += more.unplaced;
    }

    /// All kinds together.
    #[must_use]
    pub fn total(&self) -> usize {
        self.corners + self.poses + self.points + self.unplaced
    }
}

/// Sets aside in the plan what lies far outside, and says how many more there are than before.
pub fn reject(plan: &mut Plan, residuals: &Residuals) -> Rejected {
    let m = &mut plan.measurements;
    let mut found = Rejected::default();
    let corners = residuals.corners.iter().zip(&residuals.whitened[0]).filter(|(d, _)| d.is_some()).map(|(_, s)| *s);
    let limit = limit(corners, 2.0 * std::f64::consts::LN_2);
    for (whitener, s) in m.corner_whiteners.iter_mut().zip(&residuals.whitened[0]) {
        if whitener[0] != 0.0 && *s > limit {
            *whitener = [0.0; 3];
            found.corners += 1;
        }
    }
    // Median of the chi-squared distribution with three degrees of freedom.
    let poses = |part: usize| {
        let kept = residuals.poses.iter().enumerate().filter(|(_, e)| e.is_some());
        kept.map(move |(i, _)| residuals.whitened[1][2 * i + part])
    };
    let limits = [self::limit(poses(0), 2.366), self::limit(poses(1), 2.366)];
    for (i, pose) in m.poses.iter_mut().enumerate() {
        let s = [residuals.whitened[1][2 * i], residuals.whitened[1][2 * i + 1]];
        if pose.is_some() && (s[0] > limits[0] || s[1] > limits[1]) {
            *pose = None;
            found.poses += 1;
        }
    }
    let points = residuals.points.iter().zip(&residuals.whitened[2]).filter(|(e, _)| e.is_some()).map(|(_, s)| *s);
    let limit = self::limit(points, 2.366);
    for (point, s) in m.points.iter_mut().zip(&residuals.whitened[2]) {
        if point.is_some() && *s > limit {
            *point = None;
            found.points += 1;
        }
    }
    found
}

/// The squared norm beyond which a residual is set aside: the bulk's scale from the median of the squared norms, but never below what
/// the layout calls one standard deviation, so that perfect data rejects nothing.
fn limit(squared: impl Iterator<Item = f64>, median_of_unit: f64) -> f64 {
    let mut all: Vec<f64> = squared.collect();
    if all.is_empty() {
        return f64::INFINITY;
    }
    let middle = all.len() / 2;
    let (_, median, _) = all.select_nth_unstable_by(middle, f64::total_cmp);
    TIMES * TIMES * (*median / median_of_unit).max(1.0)
}
