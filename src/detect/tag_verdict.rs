//! Whether the fit of all cells of a tag is one, and how large the residuals are.

use super::edge_lines::Weakness;
use super::tag_pixels::Neighbours;
use super::tag_sums::UNKNOWNS;
use super::whole_tag::State;
use super::wide::{LANES, Lanes};

/// Residuals are believed up to so many standard deviations.
pub(super) const BELIEVED: f64 = 2.5;
/// Grey levels between black and white below which there is no tag.
const LEAST_CONTRAST: f64 = 8.0;
/// Part of the picture's variance that the fit must explain.
const EXPLAINED: f64 = 0.8;
/// Residuals of which the running spread is taken, at most.
const MOST_SPREAD: usize = 256;

/// What a fit is judged by.
pub(super) struct Judge {
    pub bright_inside: bool,
    /// Standard deviation of the residuals.
    pub scale: f64,
}

impl Judge {
    /// The variance that the inverse of the normal matrix is to be multiplied by, of a fit that is one.
    ///
    /// Values and residuals are of so many pixels, in order.
    pub fn variance(
        &self,
        count: usize,
        neighbours: &Neighbours,
        [values, residuals]: [&[Lanes]; 2],
        state: &State,
    ) -> Result<f64, Weakness> {
        let (variance, explained) = judged(count, neighbours, [values, residuals], self.scale);
        let contrast = if self.bright_inside { -state.light[3] } else { state.light[3] };
        if contrast.is_nan() || contrast < LEAST_CONTRAST {
            return Err(Weakness::NoContrast);
        }
        if explained.is_nan() || explained < EXPLAINED {
            return Err(Weakness::NotStraight);
        }
        Ok(variance)
    }
}

/// A robust standard deviation; at least half a grey level. Of very many residuals every second, every third ... eight are enough.
pub(super) fn spread(residuals: &[Lanes], count: usize) -> f64 {
    let every = (count / MOST_SPREAD).max(1);
    let mut sizes: Vec<f32> =
        residuals.iter().take(count / LANES).step_by(every).flatten().map(|residual| residual.abs()).collect();
    let middle = sizes.len() / 2;
    f64::from(1.4826 * *sizes.select_nth_unstable_by(middle, f32::total_cmp).1).max(0.5)
}

/// The variance that the inverse of the normal matrix is to be multiplied by, and the part of the picture that is explained.
///
/// Residuals of neighbours are alike where the model is not quite right, and what is alike is not averaged away: the variance is that of a first-order
/// autoregressive process in both directions.
fn judged(count: usize, neighbours: &Neighbours, [values, residuals]: [&[Lanes]; 2], scale: f64) -> (f64, f64) {
    let believed: Vec<f64> = residuals
        .iter()
        .flatten()
        .take(count)
        .map(|residual| f64::from(*residual).clamp(-BELIEVED * scale, BELIEVED * scale))
        .collect();
    let values = || values.iter().flatten().take(count).map(|value| f64::from(*value));
    let count = count as f64;
    let squares: f64 = believed.iter().map(|residual| residual * residual).sum();
    let mean = values().sum::<f64>() / count;
    let all: f64 = values().map(|value| (value - mean).powi(2)).sum();
    let variance = squares / (count - UNKNOWNS as f64).max(1.0);
    let widened = |product: f64| {
        let correlation = (product / (squares / count)).clamp(0.0, 0.9);
        (1.0 + correlation) / (1.0 - correlation)
    };
    let [beside, below] = neighbours.alike(&believed);
    (variance * widened(beside) * widened(below), 1.0 - squares / all)
}
