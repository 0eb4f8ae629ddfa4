//! Units whose shared parts are summed together.

use std::sync::Arc;

use pulp::{Arch, Simd, WithSimd};

use super::super::assemble::Shape;
use super::super::normal::Normal;
use super::super::plan::{Block, Group, Plan};
use super::super::state::State;
use super::form::{Form, Place};
use super::unit::{LocalUnit, Promise};
use crate::geometry::Pose;
use crate::geometry::pose::Twist;

/// Units whose shared parts are summed together.
#[derive(Clone, Debug)]
pub(in super::super) struct Bundle {
    pub(in super::super) units: Vec<LocalUnit>,
    /// Shared columns of all its units, ascending.
    pub(in super::super) shared: Vec<usize>,
    /// The places of the forms of its units.
    places: Vec<Place>,
    /// Row-major over (shared, residual), upper triangle: the units' shared parts.
    sums: Vec<f64>,
    /// The same, of what elimination takes away.
    taken: Vec<f64>,
    /// A compact matrix of one member, then what eliminating one unit needs.
    buffer: Vec<f64>,
    cost: f64,
    /// Whether every unit's damped local block was positive definite.
    positive: bool,
    /// What the units' last steps promise together.
    pub(in super::super) promise: Promise,
    /// Where the units' edges are after the last step.
    moved: Vec<Pose>,
}

impl Bundle {
    pub(super) fn new(mut units: Vec<LocalUnit>, shapes: &[Shape]) -> Self {
        let mut shared: Vec<usize> = units.iter().flat_map(|unit| unit.form.shared.iter().copied()).collect();
        shared.sort_unstable();
        shared.dedup();
        let mut forms: Vec<Arc<Form>> = Vec::new();
        for unit in &mut units {
            unit.place = forms.iter().position(|form| Arc::ptr_eq(form, &unit.form)).unwrap_or(forms.len());
            if unit.place == forms.len() {
                forms.push(Arc::clone(&unit.form));
            }
        }
        let room = |form: &Arc<Form>| {
            let widest = form.groups.iter().map(|group| shapes[*group].width).max().unwrap_or(0);
            (widest * widest).max(form.room()).max(form.size())
        };
        let size = (shared.len() + 1) * (shared.len() + 1);
        Self {
            buffer: vec![0.0; forms.iter().map(room).max().unwrap_or(0)],
            places: forms.iter().map(|form| Place::new(form, &shared)).collect(),
            moved: Vec::with_capacity(units.iter().map(|unit| unit.form.edges.len()).sum()),
            units,
            shared,
            sums: vec![0.0; size],
            taken: vec![0.0; size],
            cost: 0.0,
            positive: true,
            promise: Promise::default(),
        }
    }

    /// Linearises every unit.
    pub(in super::super) fn fill(
        &mut self,
        (plan, shapes): (&Plan, &[Shape]),
        state: &State,
        mut expand: impl FnMut(&Group, &Shape, &Block, &mut [f64]) -> f64,
    ) {
        let Self { units, shared, places, sums, buffer, .. } = self;
        sums.fill(0.0);
        self.cost = 0.0;
        for unit in units {
            let into = (&places[unit.place], &mut sums[..], shared.len() + 1);
            self.cost += unit.fill((plan, shapes), state, buffer, into, &mut expand);
        }
    }

    /// Adds the shared part, not reduced, and the cost.
    pub(in super::super) fn add_shared(&self, normal: &mut Normal) {
        normal.add_upper(&self.shared, &self.sums);
        normal.cost += self.cost;
    }

    /// Factorises the damped local blocks and sums what their elimination takes from the shared equations.
    pub(in super::super) fn eliminate(&mut self, arch: Arch, lambda: f64) {
        arch.dispatch(Eliminate { bundle: self, lambda });
    }

    /// What the last elimination takes from the shared equations, as [`Bundle::add_shared`] has it; none if a local block was not positive definite.
    pub(in super::super) fn taken(&self) -> Option<&[f64]> {
        self.positive.then_some(&self.taken)
    }

    /// Finds the units' steps that go with a shared one, for the last factors.
    pub(in super::super) fn back_substitute(&mut self, arch: Arch, shared: &[f64], lambda: f64) {
        arch.dispatch(BackSubstitute { bundle: self, shared, lambda });
    }

    /// Finds where the units' edges are after their steps from `state`.
    pub(in super::super) fn step_from(&mut self, state: &State) {
        self.moved.clear();
        for unit in &self.units {
            for (&edge, d) in unit.form.edges.iter().zip(unit.step().chunks_exact(6)) {
                let pose = &state.moving_poses[edge][unit.configuration];
                self.moved.push(pose.retract(&Twist::from_column_slice(d)));
            }
        }
    }

    /// Puts them there.
    pub(in super::super) fn go(&self, state: &mut State) {
        let edges = self.units.iter().flat_map(|unit| unit.form.edges.iter().map(|edge| (*edge, unit.configuration)));
        for ((edge, configuration), pose) in edges.zip(&self.moved) {
            state.moving_poses[edge][configuration] = *pose;
        }
    }
}

/// [`Bundle::eliminate`], in whatever registers there are.
struct Eliminate<'a> {
    bundle: &'a mut Bundle,
    lambda: f64,
}

impl WithSimd for Eliminate<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Bundle { units, shared, places, taken, buffer, positive, .. } = self.bundle;
        taken.fill(0.0);
        *positive = true;
        for unit in units {
            if !unit.factorise(self.lambda) {
                *positive = false;
                return;
            }
            unit.take(simd, &places[unit.place], buffer, taken, shared.len() + 1);
        }
    }
}

/// [`Bundle::back_substitute`], in whatever registers there are.
struct BackSubstitute<'a> {
    bundle: &'a mut Bundle,
    shared: &'a [f64],
    lambda: f64,
}

impl WithSimd for BackSubstitute<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Bundle { units, buffer, promise, .. } = self.bundle;
        *promise = Promise::default();
        for unit in units {
            let one = unit.back_substitute(self.shared, self.lambda, buffer);
            promise.slope += one.slope;
            promise.damping += one.damping;
            promise.largest = promise.largest.max(one.largest);
        }
    }
}
