//! Robust losses on whole registers of residuals; the formulas are those of [`super::loss::Loss`].

use pulp::Simd;

use super::kernels::UNSEEN;
use super::lanes::{Lanes, Splat, Truths, WIDEST_REGISTER};
use super::loss::Loss;

/// The cost under a loss, summed register by register.
pub(super) struct Robust<S: Simd> {
    loss: Loss,
    simd: S,
    /// `sum rho`, without what is still in `product`.
    sum: Lanes<S>,
    /// Corners that cannot be seen.
    hidden: Lanes<S>,
    /// For Cauchy's loss: `prod (1 + t) - 1`, so that several logarithms become one.
    product: Lanes<S>,
    factors: u32,
}

/// Factors that cannot overflow together: each is at most about 1e30.
const FACTORS: u32 = 8;

impl<S: Simd> Robust<S> {
    #[inline(always)]
    pub(super) fn new(simd: S, loss: Loss) -> Self {
        let zero = Lanes::splat(simd, 0.0);
        Self { loss, simd, sum: zero, hidden: zero, product: zero, factors: 0 }
    }

    /// Adds a register of squared residuals; returns [`Loss::weight_and_bend`] of each.
    #[inline(always)]
    pub(super) fn add(&mut self, s: Lanes<S>) -> (Lanes<S>, Lanes<S>) {
        let simd = self.simd;
        let n = Splat(simd);
        match self.loss {
            Loss::Squared => {
                self.sum += s;
                (n.of(1.0), n.of(0.0))
            }
            Loss::Huber(k) => {
                let far = n.of(k * k).less(s);
                let r = s.root();
                // Away from zero, where the division is not used.
                let reach = r.max(n.of(k));
                let weight = n.of(k).over(reach);
                self.sum += far.choose(r.times_plus(n.of(2.0 * k), n.of(-k * k)), s);
                (far.choose(weight, n.of(1.0)), far.choose(-weight.over(reach * reach), n.of(0.0)))
            }
            Loss::Cauchy(k) => {
                let t = s * n.of(1.0 / (k * k));
                self.product = self.product + t + self.product * t;
                self.factors += 1;
                if self.factors == FACTORS {
                    self.flush(k);
                }
                let weight = n.of(1.0).over(t + n.of(1.0));
                let full = n.of(-2.0 / (k * k)) * weight * weight;
                (weight, full.max(-weight.over(s.max(n.of(f64::MIN_POSITIVE)))))
            }
            Loss::Tukey(k) => {
                let u = s * n.of(1.0 / (k * k));
                let near = u.less(n.of(1.0));
                let rest = n.of(1.0) - u;
                let inside = s * u.times_plus(u.times_plus(n.of(1.0 / 3.0), n.of(-1.0)), n.of(1.0));
                // A residual that is no number stays one: it is on neither side of the limit.
                let beyond = n.of(1.0).less(u).choose(n.of(k * k / 3.0), inside);
                self.sum += near.choose(inside, beyond);
                let weight = near.choose(rest * rest, n.of(0.0));
                let full = near.choose(n.of(-4.0 / (k * k)) * rest, n.of(0.0));
                (weight, full.max(-weight.over(s.max(n.of(f64::MIN_POSITIVE)))))
            }
        }
    }

    /// Counts the corners behind points that cannot be seen.
    #[inline(always)]
    pub(super) fn hide(&mut self, seen: Truths<S>, counts: Lanes<S>) {
        self.hidden += seen.choose(Lanes::splat(self.simd, 0.0), counts);
    }

    #[inline(always)]
    fn flush(&mut self, k: f64) {
        let mut values = [0.0; WIDEST_REGISTER];
        self.product.store(&mut values);
        values.iter_mut().take(Lanes::<S>::COUNT).for_each(|value| *value = value.ln_1p() * k * k);
        self.sum += Lanes::load(self.simd, &values, 0);
        self.product = Lanes::splat(self.simd, 0.0);
        self.factors = 0;
    }

    /// Half the sum of losses.
    #[inline(always)]
    pub(super) fn finish(mut self) -> f64 {
        if let Loss::Cauchy(k) = self.loss {
            self.flush(k);
        }
        0.5 * (self.sum.sum() + self.hidden.sum() * self.loss.evaluate(UNSEEN).0)
    }
}
