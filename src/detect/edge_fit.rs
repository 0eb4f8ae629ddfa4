//! A robust straight line along a tag's side, through the edges that its stations found.
//!
//! Plain numbers in and out. Signs as in [`super::edge_side`]: distances are positive away from the tag.

use std::sync::OnceLock;

/// How many stations' worth the noise in the pixels counts against the stations' own scatter: a handful may
/// lie on a line by chance, and must not be believed to be exact for it.
const PRIOR_FREEDOM: f64 = 3.0;

/// What a fit found: the edge lies `offset + slope * (u - middle)` outside the side, u along it in px.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SideFit {
    pub middle: f64,
    pub offset: f64,
    pub slope: f64,
    /// Variances; about `middle` the two are independent.
    pub offset_variance: f64,
    pub slope_variance: f64,
    /// The edge's blur as a standard deviation, px.
    pub blur: f64,
}

impl SideFit {
    pub fn at(&self, u: f64) -> f64 {
        self.offset + self.slope * (u - self.middle)
    }

    pub fn variance_at(&self, u: f64) -> f64 {
        self.offset_variance + self.slope_variance * (u - self.middle).powi(2)
    }
}

/// A station's edge: place along the side, distance outside it, weight = 1 / variance.
#[derive(Debug, Clone, Copy)]
pub(super) struct Edge {
    pub u: f64,
    pub offset: f64,
    pub weight: f64,
}

/// A robust straight line; drops the edges that do not belong to it. Also returns the scatter about it, px.
///
/// `least_scale` (px) keeps a perfect picture from rejecting its own stations.
pub(super) fn fit_line(edges: &mut Vec<Edge>, least_scale: f64) -> Option<(SideFit, f64)> {
    let mut factors = Vec::new();
    let mut line = weighted_line(edges, None)?;
    let mut distances: Vec<f64> = Vec::with_capacity(edges.len());
    let mut scale = least_scale;
    for iteration in 0..6 {
        distances.clear();
        distances.extend(edges.iter().map(|edge| (edge.offset - line.at(edge.u)).abs()));
        let middle = distances.len() / 2;
        let median = *distances.select_nth_unstable_by(middle, f64::total_cmp).1;
        scale = (1.4826 * median).max(least_scale);
        // Nothing stands out: the plain line is the answer.
        if iteration == 0 && edges.iter().all(|edge| (edge.offset - line.at(edge.u)).abs() <= 3.0 * scale) {
            break;
        }
        factors.clear();
        factors.extend(edges.iter().map(|edge| {
            let r = (edge.offset - line.at(edge.u)).abs() / scale;
            // First by absolute value, which cannot be led astray; then Tukey's, which forgets outliers.
            if iteration < 2 { 1.0 / r.max(0.5) } else { (1.0 - (r / 4.7).powi(2)).max(0.0).powi(2) }
        }));
        line = weighted_line(edges, Some(&factors))?;
    }
    // What remains is fitted plainly, so that its scatter means what it says.
    edges.retain(|edge| (edge.offset - line.at(edge.u)).abs() <= 3.5 * scale);
    let mut line = weighted_line(edges, None)?;
    let freedom = edges.len() as f64 - 2.0;
    if freedom < 1.0 {
        return None;
    }
    let (mut weighted, mut plain) = (0.0, 0.0);
    for edge in edges.iter() {
        let squared = (edge.offset - line.at(edge.u)).powi(2);
        weighted += edge.weight * squared;
        plain += squared;
    }
    // The weights are 1 / variance by the pixels' noise, so that `weighted / freedom` is 1 if that were all.
    let scatter = (weighted + PRIOR_FREEDOM) / (freedom + PRIOR_FREEDOM);
    line.offset_variance *= scatter;
    line.slope_variance *= scatter;
    Some((line, (plain / freedom).sqrt()))
}

/// The weighted least-squares line, with variances as if the weights were true.
///
/// With `factors` on them.
fn weighted_line(edges: &[Edge], factors: Option<&[f64]>) -> Option<SideFit> {
    let factor = |k: usize| factors.and_then(|factors| factors.get(k)).copied().unwrap_or(1.0);
    let weights = || edges.iter().enumerate().map(|(k, edge)| (edge, edge.weight * factor(k)));
    let total: f64 = weights().map(|(_, weight)| weight).sum();
    if total <= 0.0 || !total.is_finite() {
        return None;
    }
    let middle = weights().map(|(edge, weight)| weight * edge.u).sum::<f64>() / total;
    let offset = weights().map(|(edge, weight)| weight * edge.offset).sum::<f64>() / total;
    let (mut spread, mut product) = (0.0, 0.0);
    for (edge, weight) in weights() {
        spread += weight * (edge.u - middle).powi(2);
        product += weight * (edge.u - middle) * (edge.offset - offset);
    }
    if spread <= 0.0 {
        return None;
    }
    let (offset_variance, slope_variance) = (1.0 / total, 1.0 / spread);
    Some(SideFit { middle, offset, slope: product / spread, offset_variance, slope_variance, blur: 0.0 })
}

/// The normal distribution's integral and density at `z`, from a table: exact to 1e-5, several times
/// faster than `exp`, and it is called for every pixel near every edge.
pub(crate) fn normal(z: f64) -> (f64, f64) {
    const PER_UNIT: f64 = 64.0;
    const REACH: f64 = 5.0;
    const ENTRIES: usize = 2 * (REACH * PER_UNIT) as usize + 2;
    static TABLE: OnceLock<Vec<[f64; 2]>> = OnceLock::new();
    let table = TABLE.get_or_init(|| {
        let density = |z: f64| (-0.5 * z * z).exp() / std::f64::consts::TAU.sqrt();
        let mut integral = 0.0;
        (0..ENTRIES)
            .map(|entry| {
                let z = entry as f64 / PER_UNIT - REACH;
                let value = [integral, density(z)];
                // Simpson's rule over one step.
                integral +=
                    (density(z) + 4.0 * density(z + 0.5 / PER_UNIT) + density(z + 1.0 / PER_UNIT)) / (6.0 * PER_UNIT);
                value
            })
            .collect()
    });
    let place = (z.clamp(-REACH, REACH) + REACH) * PER_UNIT;
    let entry = place as usize;
    let fraction = place - entry as f64;
    match (table.get(entry), table.get(entry + 1)) {
        (Some(low), Some(high)) => (low[0] + fraction * (high[0] - low[0]), low[1] + fraction * (high[1] - low[1])),
        _ => (f64::from(z > 0.0), 0.0),
    }
}
