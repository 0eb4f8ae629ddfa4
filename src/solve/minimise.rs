//! Levenberg-Marquardt on the condensed equations.
//!
//! The damping is Marquardt's, with the diagonal of the first linearisation frozen and clamped so that the measure of a step does not drift.
//! A step is judged by the gain ratio on the robust cost; a rejected trial costs one evaluation and one factorisation, no new linearisation.
//! No uphill step is ever taken.

use std::time::Instant;

use rayon::prelude::*;

use super::approach::approach;
use super::assemble::{Assembler, Normal};
use super::loss::Loss;
use super::state::State;
use super::system::System;
use crate::frames::FrameTree;
use crate::geometry::pose::Twist;

/// When to stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Linearisations at most.
    pub iterations: usize,
    /// A step smaller than this in every unknown, counted in the unknown's unit (1 mm, 1 mrad, 1 px), ends the search.
    pub step: f64,
    /// A relative decrease of the cost below this, predicted and found, ends the search.
    pub decrease: f64,
    /// First damping, relative to the diagonal.
    pub damping: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self { iterations: 100, step: 1e-7, decrease: 1e-12, damping: 1e-5 }
    }
}

/// Why the search ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Termination {
    /// The last step was too small to matter.
    SmallStep,
    /// The cost no longer changes.
    CostUnchanged,
    /// There is nothing to be found.
    NoUnknowns,
    /// No step lowers the cost, though the slope says that one should.
    Stuck,
    /// The iterations ran out.
    IterationLimit,
    /// The cost at the start is not a number.
    BadStart,
}

impl Termination {
    /// Whether the answer is a minimum.
    #[must_use]
    pub fn converged(self) -> bool {
        matches!(self, Self::SmallStep | Self::CostUnchanged | Self::NoUnknowns)
    }

    /// In words.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::SmallStep => "converged: the last step was too small to matter",
            Self::CostUnchanged => "converged: the cost no longer changes",
            Self::NoUnknowns => "converged: everything is known",
            Self::Stuck => "not converged: no step lowers the cost",
            Self::IterationLimit => "not converged: the iterations ran out",
            Self::BadStart => "not converged: the cost at the start is not a number",
        }
    }
}

/// Where the time went.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Seconds {
    /// Linearising and assembling.
    pub linearise: f64,
    /// Factorising and solving.
    pub factorise: f64,
    /// Evaluating trial steps.
    pub evaluate: f64,
}

/// How the search went.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// Why it ended.
    pub termination: Termination,
    /// Linearisations.
    pub iterations: usize,
    /// Robust cost at the start.
    pub initial_cost: f64,
    /// Robust cost at the end.
    pub final_cost: f64,
    /// Times that the equations were not positive definite or could not be solved to enough digits, and the damping was raised.
    pub refused: usize,
    /// Trial steps that did not lower the cost enough, after which the damping was raised.
    pub rejected: usize,
    /// The cost after every accepted step, first the start: never increasing.
    pub costs: Vec<f64>,
    /// Where the time went.
    pub seconds: Seconds,
}

/// The largest damping; a step damped more than this is zero in every digit.
const MOST_DAMPING: f64 = 1e14;

/// Damping beyond which a small step is no sign of a minimum.
const HEAVY: f64 = 1e-2;
/// An undamped step this small (units) is rounding.
const ROUNDING: f64 = 1e-4;

/// The damping's factor after a step that did what was promised.
pub(super) const EASED: f64 = 0.02;

/// A step that leaves more than this share of the cost has arrived near the minimum.
pub(super) const NEAR: f64 = 0.8;

/// Minimises the robust cost from `state`, in place.
pub fn minimise(assembler: &mut Assembler<'_>, tree: &FrameTree, state: &mut State, options: &Options) -> Report {
    let n = assembler.plan.unknowns.count;
    let units = assembler.plan.unknowns.units();
    let mut seconds = Seconds::default();
    let mut normal = Normal::default();
    let linearise = |assembler: &mut Assembler<'_>, state: &State, normal: &mut Normal, seconds: &mut Seconds| {
        let start = Instant::now();
        assembler.linearise(state, normal);
        seconds.linearise += start.elapsed().as_secs_f64();
    };
    assembler.set_curved(false);
    let robust = matches!(assembler.loss(), Loss::Huber(_));
    let mut cost = if robust {
        assembler.cost(state)
    } else {
        linearise(assembler, state, &mut normal, &mut seconds);
        normal.cost
    };
    let mut report = Report {
        termination: Termination::IterationLimit,
        iterations: usize::from(!robust),
        initial_cost: cost,
        final_cost: cost,
        refused: 0,
        rejected: 0,
        costs: vec![cost],
        seconds,
    };
    if !cost.is_finite() || !state.is_finite() {
        report.termination = Termination::BadStart;
        return report;
    }
    if n == 0 && assembler.bundles.is_empty() {
        report.termination = Termination::NoUnknowns;
        return report;
    }
    let (mut step, mut trial) = (Step::new(assembler), state.clone());
    let (mut lambda, mut growth) = (options.damping, 4.0);
    if robust {
        let room = (&mut step, &mut trial, &mut normal);
        (cost, lambda) = approach(assembler, tree, state, options, room, (&mut report, &mut seconds));
        linearise(assembler, state, &mut normal, &mut seconds);
        report.iterations += 1;
    }
    let scaling = frozen_scaling(&normal);
    report.termination = loop {
        let start = Instant::now();
        let solved = step.solve(assembler, &normal, &scaling, lambda);
        seconds.factorise += start.elapsed().as_secs_f64();
        if !solved {
            report.refused += 1;
            lambda = (lambda * growth).max(1e-9);
            growth *= 2.0;
            if lambda > MOST_DAMPING {
                break Termination::Stuck;
            }
            continue;
        }
        let small = step.largest(assembler, &units) < options.step;
        let negligible = step.predicted <= options.decrease * cost;
        if small || negligible {
            // The step is still taken if it helps: Gauss-Newton's last step often brings the last digits.
            step.apply(assembler, tree, state, &mut trial);
            let trial_cost = assembler.cost(&trial);
            if trial_cost <= cost {
                std::mem::swap(state, &mut trial);
                cost = trial_cost;
                report.costs.push(cost);
            }
            // A step that only damping made small proves nothing: ask what an undamped one would do.
            let honest = lambda <= HEAVY || {
                step.solve(assembler, &normal, &scaling, options.damping)
                    && (step.largest(assembler, &units) < ROUNDING || step.predicted <= 1e-9 * cost)
            };
            break match (honest, small) {
                (false, _) => Termination::Stuck,
                (true, true) => Termination::SmallStep,
                (true, false) => Termination::CostUnchanged,
            };
        }
        let start = Instant::now();
        step.apply(assembler, tree, state, &mut trial);
        let trial_cost = assembler.cost(&trial);
        seconds.evaluate += start.elapsed().as_secs_f64();
        let gain = (cost - trial_cost) / step.predicted;
        // NaN fails the comparison and counts as a rejected step.
        if gain > 1e-4 {
            std::mem::swap(state, &mut trial);
            // Weights alone are the better guide while most residuals lie beyond the loss' bend, where its curvature vanishes.
            assembler.set_curved(trial_cost > NEAR * cost);
            cost = trial_cost;
            report.costs.push(cost);
            growth = 4.0;
            lambda *= if gain > 0.9 {
                EASED
            } else if gain > 0.5 {
                0.2
            } else if gain > 0.25 {
                1.0
            } else {
                4.0
            };
            lambda = lambda.max(1e-14);
            if report.iterations >= options.iterations {
                break Termination::IterationLimit;
            }
            linearise(assembler, state, &mut normal, &mut seconds);
            report.iterations += 1;
        } else {
            report.rejected += 1;
            lambda = (lambda * growth).max(1e-9);
            growth *= 2.0;
            if lambda > MOST_DAMPING {
                break Termination::Stuck;
            }
        }
    };
    assembler.set_curved(false);
    report.final_cost = cost;
    report.seconds = seconds;
    report
}

/// The diagonal at the start, kept away from zero so that a direction nobody measures is still held.
pub(super) fn frozen_scaling(normal: &Normal) -> Vec<f64> {
    let diagonal: Vec<f64> = (0..normal.gradient.len()).map(|i| normal.hessian[normal.diagonal_place(i)]).collect();
    let floor = diagonal.iter().copied().fold(0.0, f64::max) * 1e-12;
    diagonal.into_iter().map(|d| d.max(floor).max(f64::MIN_POSITIVE)).collect()
}

/// A step of all unknowns, and room to find it. The local steps stand in the assembler's units.
pub(super) struct Step {
    shared: Vec<f64>,
    /// The decrease of the cost that the linear model promises.
    predicted: f64,
    system: System,
}

impl Step {
    fn new(assembler: &Assembler<'_>) -> Self {
        let equations = &assembler.plan.equations;
        Self { shared: vec![0.0; equations.solver.unknowns], predicted: 0.0, system: System::new(equations) }
    }

    /// The largest component, counted in units; local unknowns are poses.
    fn largest(&self, assembler: &Assembler<'_>, units: &[f64]) -> f64 {
        let shared = self.shared.iter().zip(units).map(|(d, unit)| d.abs() / unit);
        let local = assembler.local_units().flat_map(|unit| unit.step.iter().map(|x| x.abs() / 1e-3));
        shared.chain(local).fold(0.0, f64::max)
    }

    /// Solves the damped equations; false if they are not positive definite at this damping or the solution does not satisfy them.
    pub(super) fn solve(
        &mut self,
        assembler: &mut Assembler<'_>,
        normal: &Normal,
        scaling: &[f64],
        lambda: f64,
    ) -> bool {
        self.system.load(normal, scaling, lambda);
        assembler.bundles.par_iter_mut().for_each(|bundle| bundle.eliminate(lambda));
        for bundle in &assembler.bundles {
            let Some(taken) = bundle.taken() else { return false };
            self.system.take(&bundle.shared, taken);
        }
        let Some(solution) = self.system.solve() else { return false };
        self.shared.copy_from_slice(solution);
        let shared = &self.shared;
        assembler.bundles.par_iter_mut().for_each(|bundle| {
            bundle.units.iter_mut().for_each(|unit| unit.back_substitute(shared));
        });
        let (mut slope, mut damping) = (0.0, 0.0);
        for ((d, gradient), scale) in shared.iter().zip(&normal.gradient).zip(scaling) {
            slope -= gradient * d;
            damping += lambda * scale * d * d;
        }
        for unit in assembler.local_units() {
            let (s, d) = unit.predicted(lambda);
            slope += s;
            damping += d;
        }
        self.predicted = 0.5 * (slope + damping);
        self.predicted.is_finite()
    }

    /// Puts the state after the step into `next`.
    pub(super) fn apply(&self, assembler: &Assembler<'_>, tree: &FrameTree, state: &State, next: &mut State) {
        next.copy_from(state);
        next.advance(&assembler.plan.unknowns, tree, &self.shared);
        for unit in assembler.local_units() {
            for (&edge, d) in unit.edges.iter().zip(unit.step.chunks_exact(6)) {
                let pose = &mut next.moving_poses[edge][unit.configuration];
                *pose = pose.retract(&Twist::from_column_slice(d));
            }
        }
    }
}
