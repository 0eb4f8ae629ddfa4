//! Least squares over measurements that are never in memory at once: each pass goes over all of them part by part.
//!
//! A pass gives the cost and the next linearisation together, since to go over the measurements costs more than to linearise them. So a step is judged one pass
//! later; one that did not lower the cost is taken back and damped. Unknowns of one configuration alone are found within their part for whatever the shared
//! ones are, and eliminated there (variable projection; G. Golub and V. Pereyra, *Inverse Problems* 19, 2003): nothing is kept of them from pass to pass.

use rayon::prelude::*;

use super::assemble::{Assembler, Normal};
use super::plan::Plan;
use super::prior::Priors;
use super::report::Termination;
use super::state::State;
use super::step::frozen_scaling;
use super::system::System;
use crate::frames::FrameTree;
use crate::geometry::Pose;

/// A step this long, in standard deviations of where it leads to, ends the search: nobody could tell.
const NEGLIGIBLE: f64 = 1e-3;
/// Passes at most.
const MOST_PASSES: usize = 12;
/// First damping, relative to the diagonal: the start is a solution already, of a part.
const DAMPING: f64 = 1e-9;
/// The damping's factor after an uphill step, and after a good one.
const RAISED: f64 = 1e3;
const LOWERED: f64 = 1e-2;
/// Damping of unknowns of one configuration, relative to their diagonal: holds a direction that was not seen, and nothing else.
const HELD: f64 = 1e-10;
/// Times that unknowns of one configuration are improved, and the step (m, rad) that is too small to go on.
const LOCAL_STEPS: usize = 20;
const LOCAL_STEP: f64 = 1e-9;

/// What one pass found at a state.
#[derive(Clone, Debug, Default)]
pub struct Passed {
    /// The equations of the shared unknowns and the cost, beliefs not among them.
    pub normal: Normal,
    /// The variance of the measurements against the layout's.
    pub variance: f64,
}

/// How the passes went.
#[derive(Clone, Debug, PartialEq)]
pub struct PassReport {
    /// Why they ended.
    pub termination: Termination,
    /// The cost at each pass, beliefs included, and whether it was kept.
    pub costs: Vec<(f64, bool)>,
    /// The length of the step that was not taken any more, in standard deviations.
    pub left_over: f64,
}

/// Minimises the cost of all that `pass` goes over, from `state` and in place. The last pass was made at the state that is left.
///
/// # Errors
/// Those of `pass`.
pub fn minimise_in_passes<P, E>(
    plan: &Plan,
    tree: &FrameTree,
    priors: &Priors,
    state: &mut State,
    mut pass: impl FnMut(&State, &mut Passed) -> Result<P, E>,
) -> Result<(P, PassReport), E> {
    let mut at = Passed::default();
    let mut gathered = pass(state, &mut at)?;
    priors.add(state, &mut at.normal);
    let mut report =
        PassReport { termination: Termination::IterationLimit, costs: vec![(at.normal.cost, true)], left_over: 0.0 };
    if plan.unknowns.count == 0 {
        report.termination = Termination::NoUnknowns;
        return Ok((gathered, report));
    }
    let scaling = frozen_scaling(&at.normal);
    let mut system = System::new(&plan.equations);
    let mut damping = DAMPING;
    let mut trial = Passed::default();
    loop {
        system.load(&at.normal, &scaling, damping);
        let Some(step) = system.solve() else {
            damping *= RAISED;
            if damping > 1.0 / DAMPING {
                report.termination = Termination::Stuck;
                return Ok((gathered, report));
            }
            continue;
        };
        // `-g . d` is the squared length of the step in standard deviations at the layout's noise.
        let squared: f64 = step.iter().zip(&at.normal.gradient).map(|(d, g)| -d * g).sum();
        report.left_over = (squared.max(0.0) / at.variance.max(f64::MIN_POSITIVE)).sqrt();
        if report.left_over <= NEGLIGIBLE || squared <= 1e-12 * at.normal.cost {
            report.termination = if damping < 1e-3 { Termination::CostUnchanged } else { Termination::Stuck };
            return Ok((gathered, report));
        }
        if report.costs.len() == MOST_PASSES {
            return Ok((gathered, report));
        }
        let mut next = state.clone();
        next.advance(&plan.unknowns, tree, step);
        let found = pass(&next, &mut trial)?;
        priors.add(&next, &mut trial.normal);
        // NaN is no descent.
        let descends = trial.normal.cost <= at.normal.cost;
        report.costs.push((trial.normal.cost, descends));
        if descends {
            (*state, gathered) = (next, found);
            std::mem::swap(&mut at, &mut trial);
            damping = (damping * LOWERED).max(DAMPING);
        } else {
            damping *= RAISED;
        }
    }
}

impl State {
    /// Begins with what is unknown at each configuration of a plan alone: robots that stop where they were sent.
    pub fn begin(&mut self, plan: &Plan) {
        self.moving_poses = vec![vec![Pose::identity(); plan.configurations.len()]; plan.moving_count()];
    }
}

impl Normal {
    /// Empties the equations, for the unknowns of a plan.
    pub fn clear(&mut self, plan: &Plan) {
        self.reset(plan);
    }

    /// Adds the equations of other measurements of the same unknowns.
    pub fn include(&mut self, more: &Self) {
        self.hessian.iter_mut().zip(&more.hessian).for_each(|(sum, value)| *sum += value);
        self.gradient.iter_mut().zip(&more.gradient).for_each(|(sum, value)| *sum += value);
        self.cost += more.cost;
    }
}

impl Assembler<'_> {
    /// Finds the unknowns of each configuration alone for the shared ones as they are.
    pub fn settle(&mut self, state: &mut State) {
        if self.cut.bundles.is_empty() {
            return;
        }
        let (still, arch) = (vec![0.0; self.plan.unknowns.count], self.arch);
        for _ in 0..LOCAL_STEPS {
            self.linearise_locally(state);
            self.cut.bundles.par_iter_mut().for_each(|bundle| {
                bundle.eliminate(arch, HELD);
                bundle.back_substitute(arch, &still, HELD);
                bundle.step_from(state);
            });
            self.cut.bundles.iter().for_each(|bundle| bundle.go(state));
            let largest = self.cut.bundles.iter().fold(0.0, |most: f64, bundle| most.max(bundle.promise.largest));
            if largest <= LOCAL_STEP {
                return;
            }
        }
    }

    /// Linearises at `state`, where [`Assembler::settle`] has been, and eliminates the unknowns of each configuration alone.
    pub fn reduced(&mut self, state: &State, normal: &mut Normal) {
        self.linearise(state, normal);
        let arch = self.arch;
        self.cut.bundles.par_iter_mut().for_each(|bundle| bundle.eliminate(arch, HELD));
        for bundle in &self.cut.bundles {
            if let Some(taken) = bundle.taken() {
                let negative: Vec<f64> = taken.iter().map(|value| -value).collect();
                normal.add_upper(&bundle.shared, &negative);
            }
        }
        if !self.cut.bundles.is_empty() {
            normal.mirror();
        }
    }
}
