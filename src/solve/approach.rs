//! The first steps under Huber's loss, from far away.
//!
//! There the loss is nearly a sum of distances. Its weights fall with the distance and it has next to no curvature along the residuals, so steps that it
//! steers are short of the mark. Residuals of a wrong start say much the same in every picture, though, and least squares finds its way from there in
//! a few steps. So the first steps follow a loss that bends further out, at twice the residuals' mean distance, which still holds back what lies beyond, as long as
//! they lower the true cost well. Each that does is a reason to damp less, here and in the search that follows: where lens and mount can hardly be told
//! apart, damping is what would keep it from the minimum.

use std::time::Instant;

use super::assemble::{Assembler, Normal};
use super::loss::Loss;
use super::minimise::{EASED, NEAR, Options, Report, Seconds, Step, frozen_scaling};
use super::state::State;
use crate::frames::FrameTree;

/// A mean distance of the residuals beyond this many times the loss' bend is far from the minimum.
const FAR: f64 = 3.0;

/// Takes such steps from `state`, in place, while the cost is high and each lowers it by a fifth; returns the cost and the damping to go on with.
/// `room` is overwritten: a step, a state of the same size, and equations.
pub(super) fn approach(
    assembler: &mut Assembler<'_>,
    tree: &FrameTree,
    state: &mut State,
    options: &Options,
    (step, trial, normal): (&mut Step, &mut State, &mut Normal),
    (report, seconds): (&mut Report, &mut Seconds),
) -> (f64, f64) {
    let mut damping = options.damping;
    let count = assembler.plan.scalar_count();
    let mut cost = report.initial_cost;
    // One linearisation is left for the search itself.
    while report.iterations + 1 < options.iterations
        && let Some(guide) = guide(assembler.loss(), cost, count)
    {
        let start = Instant::now();
        assembler.set_guide(Some(guide));
        assembler.linearise(state, normal);
        assembler.set_guide(None);
        report.iterations += 1;
        seconds.linearise += start.elapsed().as_secs_f64();
        let start = Instant::now();
        let solved = step.solve(assembler, normal, &frozen_scaling(normal), damping);
        seconds.factorise += start.elapsed().as_secs_f64();
        if !solved {
            report.refused += 1;
            break;
        }
        let start = Instant::now();
        step.apply(assembler, tree, state, trial);
        let trial_cost = assembler.cost(trial);
        seconds.evaluate += start.elapsed().as_secs_f64();
        if trial_cost.is_nan() || trial_cost > NEAR * cost {
            report.rejected += 1;
            break;
        }
        std::mem::swap(state, trial);
        cost = trial_cost;
        damping *= EASED;
        report.costs.push(cost);
    }
    (cost, damping)
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
