//! One step of all unknowns: solving the damped equations, and taking it.

use super::assemble::{Assembler, Normal};
use super::share::each;
use super::state::State;
use super::system::System;
use crate::frames::FrameTree;

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
    pub(super) predicted: f64,
    system: System,
}

impl Step {
    pub(super) fn new(assembler: &Assembler<'_>) -> Self {
        let equations = &assembler.plan.equations;
        Self { shared: vec![0.0; equations.solver.unknowns], predicted: 0.0, system: System::new(equations) }
    }

    /// The largest component, counted in units; local unknowns are poses.
    pub(super) fn largest(&self, assembler: &Assembler<'_>, units: &[f64]) -> f64 {
        let shared = self.shared.iter().zip(units).map(|(d, unit)| d.abs() / unit);
        let local = assembler.cut.bundles.iter().map(|bundle| bundle.promise.largest / 1e-3);
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
        let (alone, arch) = (assembler.cut.is_small(), assembler.arch);
        let bundles = &mut assembler.cut.bundles;
        each(alone, bundles, |bundle| bundle.eliminate(arch, lambda));
        for bundle in &*bundles {
            let Some(taken) = bundle.taken() else { return false };
            self.system.take(&bundle.shared, taken);
        }
        let Some(solution) = self.system.solve() else { return false };
        self.shared.copy_from_slice(solution);
        let shared = &self.shared;
        each(alone, bundles, |bundle| bundle.back_substitute(arch, shared, lambda));
        let (mut slope, mut damping) = (0.0, 0.0);
        for ((d, gradient), scale) in shared.iter().zip(&normal.gradient).zip(scaling) {
            slope -= gradient * d;
            damping += lambda * scale * d * d;
        }
        for bundle in &*bundles {
            slope += bundle.promise.slope;
            damping += bundle.promise.damping;
        }
        self.predicted = 0.5 * (slope + damping);
        self.predicted.is_finite()
    }

    /// Puts the state after the step into `next`.
    pub(super) fn apply(&self, assembler: &mut Assembler<'_>, tree: &FrameTree, state: &State, next: &mut State) {
        next.copy_from(state);
        next.advance(&assembler.plan.unknowns, tree, &self.shared);
        let alone = assembler.cut.is_small();
        let bundles = &mut assembler.cut.bundles;
        each(alone, bundles, |bundle| bundle.step_from(state));
        bundles.iter().for_each(|bundle| bundle.go(next));
    }
}
