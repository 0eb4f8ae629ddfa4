//! The two fits that a tag's side is made of: a blurred step across it at each station, and a robust straight
//! line along it through the stations' edges.
//!
//! Apart from [`super::edge_side`], which decides what pixels to use, this is plain numbers in and out.
//! Signs, as there: distances are positive away from the tag, a step rises from dark to bright that way.

use std::sync::OnceLock;

use super::edge_side::{MINIMUM_CONTRAST, WIDEST_GATE};

/// How many stations' worth the noise in the pixels counts against the stations' own scatter: a handful may
/// lie on a line by chance, and must not be believed to be exact for it.
const PRIOR_FREEDOM: f64 = 3.0;
/// Bounds of the edge's blur, px: a pixel's own area alone gives 0.29.
const BLUR_BOUNDS: [f64; 2] = [0.35, 3.0];

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

#[derive(Debug, Default)]
pub(super) struct Station {
    /// Distance outside the side (px) and grey value.
    pub samples: Vec<[f64; 2]>,
    /// Mean place along the side, px.
    pub middle: f64,
}

/// A blurred step fitted at one station.
#[derive(Debug, Clone, Copy)]
pub(super) struct Step {
    pub dark: f64,
    pub contrast: f64,
    pub edge: f64,
    /// Variance of `edge` in px^2 for pixel noise of variance 1.
    pub information_inverse: f64,
    /// Sum of squared residuals, grey levels squared.
    pub squares: f64,
}

/// Fits every station, from where `steps` stand.
pub(super) fn fit_steps(stations: &[Station], steps: &mut [Option<Step>], blur: f64, iterations: usize) {
    for (station, step) in stations.iter().zip(steps) {
        *step = fit_step(&station.samples, step.map_or(0.0, |step| step.edge), blur, iterations);
    }
}

/// Gauss-Newton on (dark, contrast, edge). `None` where there is no rise outwards.
///
/// With the edge held, dark and contrast are linear and solved for outright; the edge's own derivative
/// is taken orthogonal to theirs (variable projection). That converges from a pixel away, where a plain
/// start would not, and one sweep over the pixels an iteration gives all the sums it needs.
fn fit_step(samples: &[[f64; 2]], start: f64, blur: f64, iterations: usize) -> Option<Step> {
    let mut edge = start;
    let n = samples.len() as f64;
    let sharpness = 1.0 / blur;
    for iteration in 0..=iterations {
        // p: Phi, g: its slope, v: the value.
        let [mut p, mut pp, mut v, mut pv, mut vv, mut g, mut gp, mut gg, mut gv] = [0.0; 9];
        for [d, value] in samples {
            let (phi, density) = normal((d - edge) * sharpness);
            let slope = density * sharpness;
            p += phi;
            pp += phi * phi;
            v += value;
            pv += phi * value;
            vv += value * value;
            g += slope;
            gp += slope * phi;
            gg += slope * slope;
            gv += slope * value;
        }
        let determinant = n * pp - p * p;
        if determinant < 1e-3 * n {
            return None;
        }
        let contrast = (n * pv - p * v) / determinant;
        let dark = (v - contrast * p) / n;
        if contrast < MINIMUM_CONTRAST / 2.0 {
            return None;
        }
        let projected = contrast * contrast * (gg - (pp * g * g - 2.0 * p * g * gp + n * gp * gp) / determinant);
        if projected <= 1e-9 * contrast * contrast * gg || gg <= 0.0 {
            return None;
        }
        if iteration == iterations {
            let squares = (vv - dark * v - contrast * pv).max(0.0);
            return Some(Step { dark, contrast, edge, information_inverse: 1.0 / projected, squares });
        }
        // The residual is orthogonal to the linear parts already, so this is the joint step.
        edge += (-contrast * (gv - dark * g - contrast * gp) / projected).clamp(-1.0, 1.0);
        if edge.abs() > WIDEST_GATE {
            return None;
        }
    }
    None
}

/// One Gauss-Newton step on the side's common blur, from all stations at once.
pub(super) fn better_blur(stations: &[Station], steps: &[Option<Step>], blur: f64) -> f64 {
    let (mut gradient, mut curvature) = (0.0, 0.0);
    for (station, step) in stations.iter().zip(steps) {
        let Some(step) = step else { continue };
        for [d, value] in &station.samples {
            let z = (d - step.edge) / blur;
            let (phi, density) = normal(z);
            let derivative = -step.contrast * density * z / blur;
            gradient += derivative * (value - step.dark - step.contrast * phi);
            curvature += derivative * derivative;
        }
    }
    if curvature <= 0.0 {
        return blur;
    }
    // dark and contrast give way too, so a full step falls short rather than overshoots.
    (blur + (gradient / curvature).clamp(-0.5 * blur, blur)).clamp(BLUR_BOUNDS[0], BLUR_BOUNDS[1])
}

/// Variance of a grey value about the fitted steps; the median station, so that a few bad ones do
/// not spoil the weights of all.
pub(super) fn pixel_noise(stations: &[Station], steps: &[Option<Step>]) -> Option<f64> {
    let mut variances: Vec<f64> = stations
        .iter()
        .zip(steps)
        .filter_map(|(station, step)| Some(step.as_ref()?.squares / (station.samples.len() as f64 - 3.0).max(1.0)))
        .collect();
    if variances.is_empty() {
        return None;
    }
    let middle = variances.len() / 2;
    // A quarter of a grey level squared: rounding to whole grey levels alone is a twelfth.
    Some(variances.select_nth_unstable_by(middle, f64::total_cmp).1.max(0.25))
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
    let mut factors = vec![1.0; edges.len()];
    let mut line = weighted_line(edges, &factors)?;
    let mut distances: Vec<f64> = Vec::with_capacity(edges.len());
    let mut scale = least_scale;
    for iteration in 0..8 {
        distances.clear();
        distances.extend(edges.iter().map(|edge| (edge.offset - line.at(edge.u)).abs()));
        let middle = distances.len() / 2;
        let median = *distances.select_nth_unstable_by(middle, f64::total_cmp).1;
        scale = (1.4826 * median).max(least_scale);
        for (factor, edge) in factors.iter_mut().zip(edges.iter()) {
            let r = (edge.offset - line.at(edge.u)).abs() / scale;
            // First by absolute value, which cannot be led astray; then Tukey's, which forgets outliers.
            *factor = if iteration < 3 { 1.0 / r.max(0.5) } else { (1.0 - (r / 4.7).powi(2)).max(0.0).powi(2) };
        }
        line = weighted_line(edges, &factors)?;
    }
    // What remains is fitted plainly, so that its scatter means what it says.
    edges.retain(|edge| (edge.offset - line.at(edge.u)).abs() <= 3.5 * scale);
    factors.clear();
    factors.resize(edges.len(), 1.0);
    let mut line = weighted_line(edges, &factors)?;
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
fn weighted_line(edges: &[Edge], factors: &[f64]) -> Option<SideFit> {
    let weights = || edges.iter().zip(factors).map(|(edge, factor)| (edge, edge.weight * factor));
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
