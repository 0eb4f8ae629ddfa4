//! Finding the crowd: minimising a robust cost and setting aside what does not belong to it.

use crate::layout::Layout;
use crate::recording::Recording;
use crate::solve::{Assembler, Loss, Options, Plan, Priors, Report, State};
use crate::trust::outliers::{Rejected, contamination, reject};
use crate::trust::residuals;

/// Passes of rejecting and solving again at most.
const REJECTION_PASSES: usize = 3;

/// More than this share of measurements far outside the bulk calls for graduated non-convexity.
const GROSS: f64 = 0.05;
/// Beyond how many times the bulk's scale a measurement is forgotten, step by step.
const FORGOTTEN: [f64; 5] = [60.0, 30.0, 15.0, 8.0, 5.0];

/// Minimises the robust cost and sets aside what does not belong, until nothing more is found.
///
/// What is accepted is then fitted by plain least squares ([`super::solve`]): a robust loss is the way to find the crowd, but within
/// the crowd least squares has the smaller variance (reweighted least squares; Rousseeuw and Leroy, *Robust Regression and Outlier Detection*, 1987).
#[allow(clippy::too_many_arguments, reason = "the stages of one solve share all of it")]
pub(super) fn robust_search(
    layout: &Layout,
    recording: &Recording,
    plan: &mut Plan,
    priors: &Priors,
    state: &mut State,
    rejected: &mut Rejected,
    run: &mut impl FnMut(&mut Assembler<'_>, &mut State, &Options) -> Report,
) {
    let loss: Loss = layout.solve.loss.into();
    // Only the accepted set is taken from here, so the last digits are left to the fit that follows.
    let options = Options { decrease: 1e-6, step: 1e-3, ..Options::default() };
    for pass in 0..=REJECTION_PASSES {
        let mut assembler = Assembler::new(layout, recording, plan, priors.clone());
        // A loss that forgets what is far away must not forget before the cell is nearly right.
        if pass == 0
            && let Loss::Cauchy(k) | Loss::Tukey(k) = loss
        {
            assembler.set_loss(Loss::Huber(k));
            run(&mut assembler, state, &options);
            assembler.set_loss(loss);
        }
        run(&mut assembler, state, &options);
        let mut poses = assembler.block_poses(state);
        let mut rest = residuals(layout, plan, state, &poses, loss);
        if pass == 0 && contamination(plan, &rest).1 > GROSS {
            graduate(&mut assembler, state, &mut |assembler, state| {
                run(assembler, state, &options);
                let poses = assembler.block_poses(state);
                contamination(plan, &residuals(layout, plan, state, &poses, loss)).0
            });
            poses = assembler.block_poses(state);
            rest = residuals(layout, plan, state, &poses, loss);
        }
        let more = reject(plan, &rest);
        rejected.add(more);
        if more.total() == 0 {
            break;
        }
    }
}

/// Graduated non-convexity: a loss that forgets what is far away, but first only what is very far, so that the search is led from the crowd's broad basin into
/// its bottom (Black and Rangarajan, IJCV 19, 1996; Yang, Antonante, Tzoumas, Carlone, IEEE RA-L 5, 2020). `run` minimises and returns how far the bulk is off.
fn graduate(
    assembler: &mut Assembler<'_>,
    state: &mut State,
    run: &mut impl FnMut(&mut Assembler<'_>, &mut State) -> f64,
) {
    let mut scale = f64::INFINITY;
    for forgotten in FORGOTTEN {
        // The first round judges the scale by the loss that the assembler still has.
        scale = scale.min(run(assembler, state));
        assembler.set_loss(Loss::Tukey(forgotten * scale));
    }
    run(assembler, state);
}
