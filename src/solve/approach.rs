//! The first steps under Huber's loss, from far away.
//!
//! There the loss is nearly a sum of distances. Its weights fall with the distance and it has next to no curvature along the residuals, so steps that it
//! steers are short of the mark. Residuals of a wrong start say much the same in every picture, though, and least squares finds its way from there in
//! a few steps. So the first steps follow a loss that bends further out, at twice the residuals' mean distance, which still holds back what lies beyond, as long as
//! they lower the true cost well. Each that does is a reason to damp less, here and in the search that follows: where lens and mount can hardly be told
//! apart, damping is what would keep it from the minimum.

use super::loss::Loss;
use super::minimise::{EASED, NEAR, Search};
use super::state::State;
use super::step::frozen_scaling;

/// A mean distance of the residuals beyond this many times the loss' bend is far from the minimum.
const FAR: f64 = 3.0;

impl Search<'_, '_> {
    /// Takes such steps from `state`, in place, while the cost is high and each lowers it by a fifth. The equations are overwritten.
    pub(super) fn approach(&mut self, state: &mut State) {
        let count = self.assembler.scalar_count();
        // One linearisation is left for the search itself.
        while self.report.iterations + 1 < self.options.iterations
            && let Some(guide) = guide(self.assembler.loss(), self.cost, count)
        {
            self.assembler.set_guide(Some(guide));
            self.linearise(state);
            self.assembler.set_guide(None);
            let scaling = frozen_scaling(&self.normal);
            if !self.solve(&scaling, self.damping) {
                self.report.refused += 1;
                break;
            }
            let cost = self.try_step(state, false);
            if cost.is_nan() || cost > NEAR * self.cost {
                self.report.rejected += 1;
                break;
            }
            self.take(state, cost);
            self.damping *= EASED;
        }
    }
}

/// The loss to steer by at a cost of `count` numbers, or none where most residuals lie near the loss' own bend.
fn guide(loss: Loss, cost: f64, count: usize) -> Option<Loss> {
    let Loss::Huber(k) = loss else { return None };
    // Corners are pairs of numbers; beyond the bend a residual r costs k r - k^2 / 2.
    let mean = cost / (0.5 * count as f64 * k) + 0.5 * k;
    (mean > FAR * k).then_some(Loss::Huber(2.0 * mean))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_distant_start_under_hubers_loss_is_guided() {
        // A hundred corners, each 20 standard deviations off.
        let k = 1.5;
        let cost = 100.0 * (k * 20.0 - 0.5 * k * k);
        assert_eq!(guide(Loss::Huber(k), cost, 200), Some(Loss::Huber(40.0)));
        assert_eq!(guide(Loss::Huber(k), 100.0, 200), None);
        for loss in [Loss::Squared, Loss::Cauchy(k), Loss::Tukey(k)] {
            assert_eq!(guide(loss, cost, 200), None);
        }
    }
}
