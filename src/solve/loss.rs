//! Robust losses on the squared whitened norm of a residual.

use crate::layout::LossSetting;

/// A loss `rho(s)` of the squared norm `s` of a residual in standard deviations. The cost of a residual is `rho(s) / 2`; `rho(s) = s` near zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Loss {
    /// Plain least squares.
    Squared,
    /// Linear beyond `k`.
    Huber(f64),
    /// Logarithmic beyond `k`.
    Cauchy(f64),
    /// Constant beyond `k`.
    Tukey(f64),
}

impl From<LossSetting> for Loss {
    fn from(setting: LossSetting) -> Self {
        match setting {
            LossSetting::Squared => Self::Squared,
            LossSetting::Huber(k) => Self::Huber(k),
            LossSetting::Cauchy(k) => Self::Cauchy(k),
            LossSetting::Tukey(k) => Self::Tukey(k),
        }
    }
}

impl Loss {
    /// `(rho(s), rho'(s))`; the derivative is the weight of iteratively reweighted least squares.
    #[inline]
    #[must_use]
    pub fn evaluate(self, s: f64) -> (f64, f64) {
        match self {
            Self::Squared => (s, 1.0),
            Self::Huber(k) => {
                if s <= k * k {
                    (s, 1.0)
                } else {
                    let r = s.sqrt();
                    (2.0 * k * r - k * k, k / r)
                }
            }
            Self::Cauchy(k) => {
                let t = s / (k * k);
                (k * k * t.ln_1p(), 1.0 / (1.0 + t))
            }
            Self::Tukey(k) => {
                let u = s / (k * k);
                if u >= 1.0 {
                    (k * k / 3.0, 0.0)
                } else {
                    // k^2/3 (1 - (1 - u)^3), written so that small residuals lose no digits.
                    (s * (1.0 - u + u * u / 3.0), (1.0 - u) * (1.0 - u))
                }
            }
        }
    }

    /// The weight `rho'(s)` and the curvature along the residual, `2 rho''(s)`, held so that `rho' + 2 rho'' s` is not negative.
    ///
    /// With residual `r` of derivative `J` the second derivative of `rho(|r|^2) / 2`, but for that of `r` itself, is
    /// `J^T (rho' I + 2 rho'' r r^T) J` (B. Triggs and others, *Bundle Adjustment: A Modern Synthesis*, 2000, section 4.3). Weights alone, as in
    /// iteratively reweighted least squares, take the loss for stiffer than it is, and converge linearly where this converges quadratically.
    #[must_use]
    pub fn weight_and_bend(self, s: f64) -> (f64, f64) {
        let weight = self.evaluate(s).1;
        let full = match self {
            Self::Squared => 0.0,
            Self::Huber(k) if s <= k * k => 0.0,
            Self::Huber(k) => -k / (s * s.sqrt()),
            Self::Cauchy(k) => -2.0 * weight * weight / (k * k),
            Self::Tukey(k) => -4.0 * (1.0 - s / (k * k)).max(0.0) / (k * k),
        };
        (weight, full.max(-weight / s.max(f64::MIN_POSITIVE)))
    }
}
