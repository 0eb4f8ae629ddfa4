//! Levenberg-Marquardt on the condensed equations.
//!
//! The damping is Marquardt's, with the diagonal of the first linearisation frozen and clamped so that the measure of a step does not drift.
//! A step is judged by the gain ratio on the robust cost; a rejected trial costs one evaluation and one factorisation, no new linearisation.
//! No uphill step is ever taken.

use std::time::Instant;

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::{factor, solve};
use faer::{Conj, Mat, Par};

use super::assemble::{Assembler, Normal};
use super::state::State;
use super::unknowns::UnknownKind;
use crate::frames::{FrameTree, Freedom};
use crate::geometry::Pose;
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
    linearise(assembler, state, &mut normal, &mut seconds);
    let mut cost = normal.cost;
    let mut report = Report {
        termination: Termination::IterationLimit,
        iterations: 1,
        initial_cost: cost,
        final_cost: cost,
        costs: vec![cost],
        seconds,
    };
    if !cost.is_finite() || !state.is_finite() {
        report.termination = Termination::BadStart;
        return report;
    }
    if n == 0 && assembler.local.is_empty() {
        report.termination = Termination::NoUnknowns;
        return report;
    }
    let scaling = frozen_scaling(&normal);
    let (mut lambda, mut growth) = (options.damping, 4.0);
    report.termination = loop {
        let start = Instant::now();
        let step = solve_step(assembler, &normal, &scaling, lambda);
        seconds.factorise += start.elapsed().as_secs_f64();
        let Some(step) = step else {
            lambda = (lambda * growth).max(1e-9);
            growth *= 2.0;
            if lambda > MOST_DAMPING {
                break Termination::Stuck;
            }
            continue;
        };
        let small = step.largest(&units) < options.step;
        let negligible = step.predicted <= options.decrease * cost;
        if small || negligible {
            // The step is still taken if it helps: Gauss-Newton's last step often brings the last digits.
            let trial = apply(assembler, tree, state, &step);
            let trial_cost = assembler.cost(&trial);
            if trial_cost <= cost {
                (*state, cost) = (trial, trial_cost);
                report.costs.push(cost);
            }
            // A step that only damping made small proves nothing: ask what an undamped one would do.
            let honest = lambda <= HEAVY || {
                solve_step(assembler, &normal, &scaling, options.damping)
                    .is_some_and(|full| full.largest(&units) < ROUNDING || full.predicted <= 1e-9 * cost)
            };
            break match (honest, small) {
                (false, _) => Termination::Stuck,
                (true, true) => Termination::SmallStep,
                (true, false) => Termination::CostUnchanged,
            };
        }
        let start = Instant::now();
        let trial = apply(assembler, tree, state, &step);
        let trial_cost = assembler.cost(&trial);
        seconds.evaluate += start.elapsed().as_secs_f64();
        let gain = (cost - trial_cost) / step.predicted;
        // NaN fails the comparison and counts as a rejected step.
        if gain > 1e-4 {
            (*state, cost) = (trial, trial_cost);
            report.costs.push(cost);
            growth = 4.0;
            lambda *= if gain > 0.9 {
                0.02
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
            lambda = (lambda * growth).max(1e-9);
            growth *= 2.0;
            if lambda > MOST_DAMPING {
                break Termination::Stuck;
            }
        }
    };
    report.final_cost = cost;
    report.seconds = seconds;
    report
}

/// The diagonal at the start, kept away from zero so that a direction nobody measures is still held.
fn frozen_scaling(normal: &Normal) -> Vec<f64> {
    let n = normal.gradient.len();
    let diagonal: Vec<f64> = (0..n).map(|i| normal.hessian[i * n + i]).collect();
    let floor = diagonal.iter().copied().fold(0.0, f64::max) * 1e-12;
    diagonal.into_iter().map(|d| d.max(floor).max(f64::MIN_POSITIVE)).collect()
}

/// A step of all unknowns.
struct Step {
    shared: Vec<f64>,
    /// In the order of the assembler's local units.
    local: Vec<nalgebra::DVector<f64>>,
    /// The decrease of the cost that the linear model promises.
    predicted: f64,
}

impl Step {
    /// The largest component, counted in units; local unknowns are poses.
    fn largest(&self, units: &[f64]) -> f64 {
        let shared = self.shared.iter().zip(units).map(|(d, unit)| d.abs() / unit);
        let local = self.local.iter().flat_map(|d| d.iter().map(|x| x.abs() / 1e-3));
        shared.chain(local).fold(0.0, f64::max)
    }
}

/// Solves the damped equations; `None` if they are not positive definite at this damping or the solution does not satisfy them.
fn solve_step(assembler: &mut Assembler<'_>, normal: &Normal, scaling: &[f64], lambda: f64) -> Option<Step> {
    let n = normal.gradient.len();
    let mut matrix = Mat::<f64>::from_fn(n, n, |i, j| normal.hessian[i * n + j]);
    let mut right: Vec<f64> = normal.gradient.iter().map(|g| -g).collect();
    for i in 0..n {
        matrix[(i, i)] += lambda * scaling[i];
    }
    for unit in &mut assembler.local {
        if !unit.factorise(lambda) {
            return None;
        }
        let (block, gradient) = unit.reduction()?;
        for (i, &a) in unit.shared().iter().enumerate() {
            right[a] += gradient[i];
            for (j, &b) in unit.shared().iter().enumerate() {
                matrix[(a, b)] -= block[(i, j)];
            }
        }
    }
    let shared = solve_positive(&matrix, &right)?;
    let local: Vec<_> = assembler.local.iter().map(|unit| unit.back_substitute(&shared)).collect();
    let (mut slope, mut damping) = (0.0, 0.0);
    for i in 0..n {
        slope -= normal.gradient[i] * shared[i];
        damping += lambda * scaling[i] * shared[i] * shared[i];
    }
    for (unit, step) in assembler.local.iter().zip(&local) {
        let (s, d) = unit.predicted(step, lambda);
        slope += s;
        damping += d;
    }
    let predicted = 0.5 * (slope + damping);
    predicted.is_finite().then_some(Step { shared, local, predicted })
}

/// Solves a symmetric positive definite system by faer's Cholesky, sequentially so that the bits never change, with one refinement; the
/// residual is checked.
pub(crate) fn solve_positive(matrix: &Mat<f64>, right: &[f64]) -> Option<Vec<f64>> {
    let n = right.len();
    if n == 0 {
        return Some(Vec::new());
    }
    // Unit diagonal: the columns carry metres, radians and pixels.
    let mut scale = Vec::with_capacity(n);
    for i in 0..n {
        let d = matrix[(i, i)];
        if !(d.is_finite() && d > 0.0) {
            return None;
        }
        scale.push(1.0 / d.sqrt());
    }
    let scaled = Mat::<f64>::from_fn(n, n, |i, j| matrix[(i, j)] * scale[i] * scale[j]);
    let mut lower = scaled.clone();
    let parameters = Default::default();
    let scratch = factor::cholesky_in_place_scratch::<f64>(n, Par::Seq, parameters);
    let mut memory = MemBuffer::new(scratch);
    factor::cholesky_in_place(lower.as_mut(), Default::default(), Par::Seq, MemStack::new(&mut memory), parameters)
        .ok()?;
    let target = Mat::<f64>::from_fn(n, 1, |i, _| right[i] * scale[i]);
    let solve_scratch = solve::solve_in_place_scratch::<f64>(n, 1, Par::Seq);
    let mut memory = MemBuffer::new(solve_scratch);
    let mut back = |mut b: Mat<f64>| {
        solve::solve_in_place_with_conj(lower.as_ref(), Conj::No, b.as_mut(), Par::Seq, MemStack::new(&mut memory));
        b
    };
    let mut x = back(target.clone());
    let residual = residual_of(&scaled, &x, &target);
    let correction = back(residual);
    for i in 0..n {
        x[(i, 0)] += correction[(i, 0)];
    }
    let size = |m: &Mat<f64>| (0..n).map(|i| m[(i, 0)].abs()).fold(0.0, f64::max);
    let left = residual_of(&scaled, &x, &target);
    let good = size(&left) <= 1e-6 * (size(&target) + f64::MIN_POSITIVE);
    let solution: Vec<f64> = (0..n).map(|i| x[(i, 0)] * scale[i]).collect();
    (good && solution.iter().all(|value| value.is_finite())).then_some(solution)
}

fn residual_of(matrix: &Mat<f64>, x: &Mat<f64>, target: &Mat<f64>) -> Mat<f64> {
    let n = target.nrows();
    Mat::from_fn(n, 1, |i, _| target[(i, 0)] - (0..n).map(|j| matrix[(i, j)] * x[(j, 0)]).sum::<f64>())
}

/// The state after a step.
fn apply(assembler: &Assembler<'_>, tree: &FrameTree, state: &State, step: &Step) -> State {
    let mut next = state.clone();
    for block in &assembler.plan.unknowns.blocks {
        let d = &step.shared[block.start..block.start + block.count()];
        match &block.kind {
            UnknownKind::Edge(edge) => {
                let pose = &mut next.static_poses[*edge];
                *pose = match tree.static_edges[*edge].freedom {
                    Freedom::Pose => pose.retract(&Twist::from_column_slice(d)),
                    Freedom::Translation => *pose * Pose::from_translation(d[0], d[1], d[2]),
                    Freedom::Fixed => *pose,
                };
            }
            UnknownKind::Links { robot, places, .. } => {
                for (place, d) in places.iter().zip(d) {
                    next.corrections[*robot][*place] += d;
                }
            }
            UnknownKind::Lens { camera, places } => {
                for (place, d) in places.iter().zip(d) {
                    let value = &mut next.lenses[*camera][*place];
                    // A focal length stays positive: a step never takes more than half of it.
                    *value = if *place < 2 { (*value + d).max(0.5 * *value) } else { *value + d };
                }
            }
        }
    }
    for (unit, step) in assembler.local.iter().zip(&step.local) {
        for (slot, &edge) in unit.edges.iter().enumerate() {
            let pose = &mut next.moving_poses[edge][unit.configuration];
            *pose = pose.retract(&Twist::from_column_slice(&step.as_slice()[6 * slot..6 * slot + 6]));
        }
    }
    next
}
