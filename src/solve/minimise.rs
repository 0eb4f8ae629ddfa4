//! Levenberg-Marquardt on the condensed equations.
//!
//! The damping is Marquardt's, with the diagonal of the first linearisation frozen and clamped so that the measure of a step does not drift.
//! A step is judged by the gain ratio on the robust cost. A good model's steps are nearly always taken, so where the last one was, the equations
//! are formed at the trial at once: they tell its cost too. After a rejected step a trial costs one evaluation until one is taken again.
//! No uphill step is ever taken. From far away a part of the measurements shows the way ([`super::thinned`]).

use std::time::Instant;

use super::assemble::{Assembler, Normal};
use super::loss::Loss;
use super::report::{Options, Report, Termination};
use super::state::State;
use super::step::{Step, frozen_scaling};
use crate::frames::FrameTree;

/// The largest damping; a step damped more than this is zero in every digit.
const MOST_DAMPING: f64 = 1e14;

/// Damping beyond which a small step is no sign of a minimum.
const HEAVY: f64 = 1e-2;
/// An undamped step this small (units) is rounding.
const ROUNDING: f64 = 1e-4;

/// The share of a cost that rounding makes of its sum, whatever the registers.
const DIGITS: f64 = 1e-13;

/// The damping's factor after a step that did what was promised.
pub(super) const EASED: f64 = 0.02;

/// A step that leaves more than this share of the cost has arrived near the minimum.
pub(super) const NEAR: f64 = 0.8;

/// Minimises the robust cost from `state`, in place.
pub fn minimise(assembler: &mut Assembler<'_>, tree: &FrameTree, state: &mut State, options: &Options) -> Report {
    assembler.set_curved(false);
    let mut search = Search::new(assembler, tree, options, state);
    if search.assembler.cut.is_small() {
        search.run(state);
    } else {
        // Work is handed to other threads more quickly by one of their own.
        rayon::scope(|_| search.run(state));
    }
    search.assembler.set_curved(false);
    search.report
}

/// A search under way.
pub(super) struct Search<'s, 'a> {
    pub(super) assembler: &'s mut Assembler<'a>,
    tree: &'s FrameTree,
    pub(super) options: Options,
    units: Vec<f64>,
    pub(super) step: Step,
    pub(super) trial: State,
    pub(super) normal: Normal,
    pub(super) cost: f64,
    pub(super) damping: f64,
    pub(super) report: Report,
}

impl<'s, 'a> Search<'s, 'a> {
    fn new(assembler: &'s mut Assembler<'a>, tree: &'s FrameTree, options: &Options, state: &State) -> Self {
        Self {
            tree,
            options: *options,
            units: assembler.plan.unknowns.units(),
            step: Step::new(assembler),
            trial: state.clone(),
            normal: Normal::default(),
            cost: f64::NAN,
            damping: options.damping,
            report: Report::default(),
            assembler,
        }
    }

    fn run(&mut self, state: &mut State) {
        let nothing = self.assembler.plan.unknowns.count == 0 && self.assembler.cut.bundles.is_empty();
        self.report.termination = if !nothing && state.is_finite() && self.begin_thinned(state) {
            self.descend(state)
        } else {
            self.search(state, nothing)
        };
        self.report.final_cost = self.cost;
    }

    /// Searches from `state` on what the assembler looks at.
    fn search(&mut self, state: &mut State, nothing: bool) -> Termination {
        let robust = matches!(self.assembler.loss(), Loss::Huber(_));
        self.cost = if robust { self.evaluate(state) } else { self.linearise(state) };
        self.report.initial_cost = self.cost;
        self.report.costs = vec![self.cost];
        if !self.cost.is_finite() || !state.is_finite() {
            return Termination::BadStart;
        }
        if nothing {
            return Termination::NoUnknowns;
        }
        if robust {
            self.approach(state);
            self.linearise(state);
        }
        self.descend(state)
    }

    /// Forms the equations at `state`; returns the cost.
    pub(super) fn linearise(&mut self, state: &State) -> f64 {
        let start = Instant::now();
        let cost = self.assembler.linearise(state, &mut self.normal);
        self.report.iterations += 1;
        self.report.seconds.linearise += start.elapsed().as_secs_f64();
        cost
    }

    pub(super) fn evaluate(&mut self, state: &State) -> f64 {
        let start = Instant::now();
        let cost = self.assembler.cost(state);
        self.report.seconds.evaluate += start.elapsed().as_secs_f64();
        cost
    }

    pub(super) fn solve(&mut self, scaling: &[f64], damping: f64) -> bool {
        let start = Instant::now();
        let solved = self.step.solve(self.assembler, &self.normal, scaling, damping);
        self.report.seconds.factorise += start.elapsed().as_secs_f64();
        solved
    }

    /// The cost after the step from `state`, which stays in `trial`; the equations are formed there too if they are asked for.
    pub(super) fn try_step(&mut self, state: &State, equations: bool) -> f64 {
        let mut trial = std::mem::take(&mut self.trial);
        self.step.apply(self.assembler, self.tree, state, &mut trial);
        let cost = if equations { self.linearise(&trial) } else { self.evaluate(&trial) };
        self.trial = trial;
        cost
    }

    /// Goes to the trial.
    pub(super) fn take(&mut self, state: &mut State, cost: f64) {
        std::mem::swap(state, &mut self.trial);
        self.cost = cost;
        self.report.costs.push(cost);
    }

    fn is_smaller_than(&self, step: f64) -> bool {
        self.step.largest(self.assembler, &self.units) < step
    }

    /// Descends to a minimum from `state`, where the equations are formed.
    pub(super) fn descend(&mut self, state: &mut State) -> Termination {
        let scaling = frozen_scaling(&self.normal);
        let Options { step, decrease, iterations, damping: first, .. } = self.options;
        let (mut growth, mut sure) = (4.0, true);
        loop {
            if !self.solve(&scaling, self.damping) {
                self.report.refused += 1;
                self.damping = (self.damping * growth).max(1e-9);
                growth *= 2.0;
                if self.damping > MOST_DAMPING {
                    return Termination::Stuck;
                }
                continue;
            }
            let small = self.is_smaller_than(step);
            if small || self.step.predicted <= decrease * self.cost {
                // The step is still taken if it helps: Gauss-Newton's last step often brings the last digits.
                // By how much is less than the cost can tell to its last digit: only beyond that would it be uphill.
                let cost = self.try_step(state, false);
                if cost <= self.cost * (1.0 + DIGITS) {
                    self.take(state, cost.min(self.cost));
                }
                // A step that only damping made small proves nothing: ask what an undamped one would do.
                let honest = self.damping <= HEAVY || {
                    self.solve(&scaling, first)
                        && (self.is_smaller_than(ROUNDING) || self.step.predicted <= 1e-9 * self.cost)
                };
                return match (honest, small) {
                    (false, _) => Termination::Stuck,
                    (true, true) => Termination::SmallStep,
                    (true, false) => Termination::CostUnchanged,
                };
            }
            // Whether the loss' curvature is to count at the trial is known only when its cost is.
            let at_once = sure && self.assembler.is_curved() && self.report.iterations < iterations;
            let predicted = self.step.predicted;
            let cost = self.try_step(state, at_once);
            let gain = (self.cost - cost) / predicted;
            // NaN fails the comparison and counts as a rejected step.
            sure = gain > 1e-4;
            if sure {
                // Weights alone are the better guide while most residuals lie beyond the loss' bend, where its curvature vanishes.
                self.assembler.set_curved(cost > NEAR * self.cost);
                self.take(state, cost);
                growth = 4.0;
                let factor = if gain > 0.9 {
                    EASED
                } else if gain > 0.5 {
                    0.2
                } else if gain > 0.25 {
                    1.0
                } else {
                    4.0
                };
                self.damping = (self.damping * factor).max(1e-14);
            } else {
                self.report.rejected += 1;
                self.damping = (self.damping * growth).max(1e-9);
                growth *= 2.0;
                if self.damping > MOST_DAMPING {
                    return Termination::Stuck;
                }
            }
            if sure != at_once {
                // Either the equations are still those of the state before, or they are those of a trial that was not taken.
                if self.report.iterations >= iterations {
                    return Termination::IterationLimit;
                }
                self.linearise(state);
            }
        }
    }
}
