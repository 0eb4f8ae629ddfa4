//! One configuration at which something moves.

use std::sync::Arc;

use pulp::Simd;

use super::super::assemble::Shape;
use super::super::lanes::Lanes;
use super::super::plan::{Block, Group, Plan};
use super::super::prior::pose_prior;
use super::super::state::State;
use super::form::{Form, Place, Span};
use crate::geometry::Pose;

/// The blocks of one configuration whose paths cross a moving edge.
#[derive(Clone, Debug)]
pub struct LocalUnit {
    /// Index into [`Plan::configurations`].
    pub(in super::super) configuration: usize,
    pub(in super::super) form: Arc<Form>,
    /// Which of the bundle's places its form has.
    pub(super) place: usize,
    /// The block within each group of the form.
    blocks: Box<[u32]>,
    /// The rows; the lower Cholesky factor `L` of the damped local block, row-major; the frozen scaling of the local columns; the local step.
    numbers: Box<[f64]>,
    /// Whether the scaling has been frozen.
    scaled: bool,
    cost: f64,
}

/// The numbers of a unit, apart.
struct Numbers<'a> {
    rows: &'a mut [f64],
    factor: &'a mut [f64],
    scaling: &'a mut [f64],
    step: &'a mut [f64],
}

/// What a local step promises and how large it is.
#[derive(Clone, Copy, Debug, Default)]
pub(in super::super) struct Promise {
    /// `-g_l . d`.
    pub(in super::super) slope: f64,
    /// `lambda d^T D d`.
    pub(in super::super) damping: f64,
    /// The largest component, m or rad.
    pub(in super::super) largest: f64,
}

impl LocalUnit {
    pub(super) fn new(configuration: usize, form: Arc<Form>, blocks: Vec<u32>) -> Self {
        let local = form.local();
        let count = local * (form.size() + local + 2);
        Self {
            configuration,
            form,
            place: 0,
            blocks: blocks.into(),
            numbers: vec![0.0; count].into(),
            scaled: false,
            cost: 0.0,
        }
    }

    /// Row-major, local rows over (local, shared, residual), both triangles of the local block.
    pub(in super::super) fn rows(&self) -> &[f64] {
        &self.numbers[..self.form.local() * self.form.size()]
    }

    /// The local step of the last factor, six numbers an edge.
    pub(in super::super) fn step(&self) -> &[f64] {
        &self.numbers[self.numbers.len() - self.form.local()..]
    }

    #[inline(always)]
    fn split<'n>(numbers: &'n mut [f64], form: &Form) -> Numbers<'n> {
        let local = form.local();
        let (rows, rest) = numbers.split_at_mut(local * form.size());
        let (factor, rest) = rest.split_at_mut(local * local);
        let (scaling, step) = rest.split_at_mut(local);
        Numbers { rows, factor, scaling, step }
    }

    /// Its blocks with their groups.
    fn members<'p>(&self, plan: &'p Plan) -> impl Iterator<Item = (usize, &'p Group, &'p Block)> {
        self.form.groups.iter().zip(&self.blocks).map(|(&index, &block)| {
            let group = &plan.groups[index];
            (index, group, &group.blocks[block as usize])
        })
    }

    /// Fills the local rows from the unit's blocks and adds the shared part to `sums` (row-major with the given stride over the columns that `place` tells; upper
    /// triangle). `buffer` has room for one member's compact matrix. Returns the cost.
    pub(super) fn fill(
        &mut self,
        (plan, shapes): (&Plan, &[Shape]),
        state: &State,
        buffer: &mut [f64],
        (place, sums, stride): (&Place, &mut [f64], usize),
        mut expand: impl FnMut(&Group, &Shape, &Block, &mut [f64]) -> f64,
    ) -> f64 {
        let mut numbers = std::mem::take(&mut self.numbers);
        let (local, size) = (self.form.local(), self.form.size());
        let Numbers { rows, scaling, .. } = Self::split(&mut numbers, &self.form);
        rows.fill(0.0);
        let mut cost = 0.0;
        for ((index, group, block), spans) in self.members(plan).zip(&self.form.spans) {
            let (shape, width) = (&shapes[index], shapes[index].width);
            let buffer = &mut buffer[..width * width];
            buffer.fill(0.0);
            cost += expand(group, shape, block, buffer);
            for (s, a) in spans[..spans.len() - 1].iter().enumerate() {
                for b in &spans[s..] {
                    if a.to.min(b.to) < local {
                        add(buffer, width, (a, b), rows, size, (a.to, b.to));
                    } else {
                        add(buffer, width, (a, b), sums, stride, (place.of[a.to - local], place.of[b.to - local]));
                    }
                }
            }
        }
        for i in 1..local {
            for j in 0..i {
                rows[i * size + j] = rows[j * size + i];
            }
        }
        self.believe(plan, state, rows);
        if !self.scaled {
            scaling.iter_mut().enumerate().for_each(|(i, d)| *d = rows[i * size + i]);
            let floor = scaling.iter().copied().fold(0.0, f64::max) * 1e-9;
            scaling.iter_mut().for_each(|d| *d = d.max(floor).max(f64::MIN_POSITIVE));
            self.scaled = true;
        }
        self.numbers = numbers;
        self.cost = cost + self.belief_cost(plan, state);
        self.cost
    }

    /// The cost of the unit's blocks.
    pub(in super::super) fn cost_of(
        &self,
        plan: &Plan,
        state: &State,
        mut cost: impl FnMut(&Group, &Block) -> f64,
    ) -> f64 {
        let measured: f64 = self.members(plan).map(|(_, group, block)| cost(group, block)).sum();
        measured + self.belief_cost(plan, state)
    }

    /// Adds what is believed of the robots' stops.
    fn believe(&self, plan: &Plan, state: &State, rows: &mut [f64]) {
        let size = self.form.size();
        for (slot, &edge) in self.form.edges.iter().enumerate() {
            let Some(stop) = edge.checked_sub(plan.moving_edges).map(|stop| &plan.stops[stop]) else { continue };
            let twist = &state.moving_poses[edge][self.configuration];
            let (residual, jacobian) = pose_prior(&Pose::identity(), twist, &stop.sigma);
            let (hessian, gradient) = (jacobian.transpose() * jacobian, jacobian.transpose() * residual);
            for i in 0..6 {
                let row = &mut rows[(6 * slot + i) * size..(6 * slot + i + 1) * size];
                row[size - 1] += gradient[i];
                for j in 0..6 {
                    row[6 * slot + j] += hessian[(i, j)];
                }
            }
        }
    }

    /// The cost of what is believed of the robots' stops.
    pub(in super::super) fn belief_cost(&self, plan: &Plan, state: &State) -> f64 {
        let stop = |edge: usize| plan.stops.get(edge.checked_sub(plan.moving_edges)?);
        let stops = self.form.edges.iter().filter_map(|&edge| Some((edge, stop(edge)?)));
        stops
            .map(|(edge, stop)| {
                let twist = &state.moving_poses[edge][self.configuration];
                0.5 * pose_prior(&Pose::identity(), twist, &stop.sigma).0.norm_squared()
            })
            .sum()
    }

    /// Factorises the damped local block; false if it is not positive definite.
    #[inline(always)]
    pub(super) fn factorise(&mut self, lambda: f64) -> bool {
        let (local, size) = (self.form.local(), self.form.size());
        let Numbers { rows, factor, scaling, .. } = Self::split(&mut self.numbers, &self.form);
        for (i, (to, from)) in factor.chunks_exact_mut(local).zip(rows.chunks_exact(size)).enumerate() {
            to.copy_from_slice(&from[..local]);
            to[i] += lambda * scaling[i];
        }
        // Nearly always one thing moves: then the compiler knows the size.
        if local == 6 { cholesky(factor, 6) } else { cholesky(factor, local) }
    }

    /// Adds `[H_ls, g_l]^T H_ll^-1 [H_ls, g_l]` for the last factor to the bundle's sums (upper triangle). `room` is [`Form::room`] numbers.
    #[inline(always)]
    pub(super) fn take<S: Simd>(&self, simd: S, place: &Place, room: &mut [f64], taken: &mut [f64], stride: usize) {
        let (local, size, lanes) = (self.form.local(), self.form.size(), Lanes::<S>::COUNT);
        let width = size - local;
        let whole = width.next_multiple_of(lanes);
        let (rows, l) = self.numbers.split_at(local * size);
        // `L^-1 [H_ls, g_l]`, in whole registers.
        let (solved, sum) = room.split_at_mut(local * whole);
        for (i, from) in rows.chunks_exact(size).enumerate() {
            let (done, rest) = solved.split_at_mut(i * whole);
            let row = &mut rest[..whole];
            row[..width].copy_from_slice(&from[local..]);
            row[width..].fill(0.0);
            let inverse = Lanes::splat(simd, 1.0 / l[i * local + i]);
            for register in 0..whole / lanes {
                let mut value = Lanes::load(simd, row, register);
                for (k, done) in done.chunks_exact(whole).enumerate() {
                    value = Lanes::splat(simd, -l[i * local + k]).times_plus(Lanes::load(simd, done, register), value);
                }
                (value * inverse).store(&mut row[register * lanes..]);
            }
        }
        // Six rows at once, those of one edge.
        for six in solved.chunks_exact(6 * whole) {
            for (i, &at) in place.of[..width - 1].iter().enumerate() {
                let factors = std::array::from_fn(|k| six[k * whole + i]);
                for register in i / lanes..whole / lanes {
                    Lanes::sum_of_six(simd, &factors, six, whole, register).store(&mut sum[register * lanes..]);
                }
                let row = &mut taken[at * stride..(at + 1) * stride];
                for &(own, first, count) in &place.runs {
                    let skipped = i.saturating_sub(own).min(count);
                    let from = &sum[own + skipped..];
                    for (register, into) in row[first + skipped..first + count].chunks_mut(lanes).enumerate() {
                        Lanes::load(simd, from, register).add_to(into);
                    }
                }
            }
        }
    }

    /// Finds the local step that goes with a shared one: `-H_ll^-1 (g_l + H_ls step)`. `across` has room for the shared step in the form's columns.
    #[inline(always)]
    pub(super) fn back_substitute(&mut self, shared: &[f64], lambda: f64, across: &mut [f64]) -> Promise {
        let (local, size) = (self.form.local(), self.form.size());
        let Numbers { rows, factor: l, scaling, step } = Self::split(&mut self.numbers, &self.form);
        let across = &mut across[..size - local];
        across.iter_mut().zip(&self.form.shared).for_each(|(to, column)| *to = shared[*column]);
        across[size - local - 1] = 1.0;
        for (i, row) in rows.chunks_exact(size).enumerate() {
            let mut value = -dot(&row[local..], across);
            for k in 0..i {
                value -= l[i * local + k] * step[k];
            }
            step[i] = value / l[i * local + i];
        }
        for i in (0..local).rev() {
            let mut value = step[i];
            for k in i + 1..local {
                value -= l[k * local + i] * step[k];
            }
            step[i] = value / l[i * local + i];
        }
        let mut promise = Promise::default();
        for ((row, d), scale) in rows.chunks_exact(size).zip(&*step).zip(&*scaling) {
            promise.slope -= row[size - 1] * d;
            promise.damping += lambda * scale * d * d;
            promise.largest = promise.largest.max(d.abs());
        }
        promise
    }
}

/// Turns the lower triangle of a symmetric matrix (row-major) into its Cholesky factor; false if it is not positive definite.
#[inline(always)]
fn cholesky(l: &mut [f64], n: usize) -> bool {
    let l = &mut l[..n * n];
    for i in 0..n {
        for j in 0..=i {
            let mut value = l[i * n + j];
            for k in 0..j {
                value -= l[i * n + k] * l[j * n + k];
            }
            if i != j {
                l[i * n + j] = value / l[j * n + j];
            } else if value > 0.0 && value.is_finite() {
                l[i * n + i] = value.sqrt();
            } else {
                return false;
            }
        }
    }
    true
}

/// A scalar product in four sums, so that the compiler may use registers.
#[inline(always)]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let (whole_a, rest_a) = a.as_chunks::<4>();
    let (whole_b, rest_b) = b.as_chunks::<4>();
    let mut sums = [0.0; 4];
    for (a, b) in whole_a.iter().zip(whole_b) {
        for i in 0..4 {
            sums[i] += a[i] * b[i];
        }
    }
    let rest: f64 = rest_a.iter().zip(rest_b).map(|(a, b)| a * b).sum();
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + rest
}

/// Adds what two stretches of a compact matrix (upper triangle) have in common to a larger one (upper triangle), where they begin at `places`.
#[inline(always)]
fn add(matrix: &[f64], width: usize, (a, b): (&Span, &Span), to: &mut [f64], stride: usize, places: (usize, usize)) {
    let (p, q) = places;
    if p == q {
        for i in 0..a.count {
            let from = &matrix[(a.compact + i) * width + a.compact + i..][..a.count - i];
            let to = &mut to[(p + i) * stride + p + i..][..a.count - i];
            to.iter_mut().zip(from).for_each(|(to, from)| *to += from);
        }
    } else if (a.compact < b.compact) == (p < q) {
        // The one that comes first in both.
        let (first, second, p, q) = if p < q { (a, b, p, q) } else { (b, a, q, p) };
        for i in 0..first.count {
            let from = &matrix[(first.compact + i) * width + second.compact..][..second.count];
            let to = &mut to[(p + i) * stride + q..][..second.count];
            to.iter_mut().zip(from).for_each(|(to, from)| *to += from);
        }
    } else {
        let (first, second, p, q) = if p < q { (a, b, p, q) } else { (b, a, q, p) };
        for i in 0..second.count {
            let from = &matrix[(second.compact + i) * width + first.compact..][..first.count];
            for (j, from) in from.iter().enumerate() {
                to[(p + j) * stride + q + i] += from;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Local columns that come after shared ones in the blocks, and shared ones in another order.
    #[test]
    fn stretches_go_where_they_belong_in_any_order() {
        const WIDTH: usize = 9;
        let spans =
            [(0, 6, 2), (2, 0, 3), (5, 3, 3), (8, 8, 1)].map(|(compact, to, count)| Span { compact, to, count });
        let matrix: Vec<f64> =
            (0..WIDTH * WIDTH).map(|i| if i % WIDTH >= i / WIDTH { (i as f64).sin() } else { f64::NAN }).collect();
        let mut found = vec![0.0; WIDTH * WIDTH];
        for (i, a) in spans[..3].iter().enumerate() {
            for b in &spans[i..] {
                add(&matrix, WIDTH, (a, b), &mut found, WIDTH, (a.to, b.to));
            }
        }
        let to: Vec<usize> = spans.iter().flat_map(|span| span.to..span.to + span.count).collect();
        let mut expected = vec![0.0; WIDTH * WIDTH];
        for i in 0..WIDTH - 1 {
            for j in i..WIDTH {
                expected[to[i].min(to[j]) * WIDTH + to[i].max(to[j])] += matrix[i * WIDTH + j];
            }
        }
        assert_eq!(found, expected);
    }

    #[test]
    fn a_factor_gives_the_matrix_and_is_refused_if_there_is_none() {
        for n in [6, 12] {
            let b: Vec<f64> = (0..n * n).map(|i| (1.3 * i as f64).cos()).collect();
            let product = |a: &[f64], i: usize, j: usize| (0..n).map(|k| a[i * n + k] * a[j * n + k]).sum::<f64>();
            let matrix: Vec<f64> =
                (0..n * n).map(|i| product(&b, i / n, i % n) + f64::from(u8::from(i / n == i % n))).collect();
            let mut l = matrix.clone();
            assert!(cholesky(&mut l, n));
            (0..n).for_each(|i| l[i * n + i + 1..(i + 1) * n].fill(0.0));
            for (i, entry) in matrix.iter().enumerate() {
                assert!((product(&l, i / n, i % n) - entry).abs() < 1e-12);
            }
            let mut indefinite = matrix.clone();
            indefinite[n * n - 1] = -1.0;
            assert!(!cholesky(&mut indefinite, n));
            let mut no_number = matrix;
            no_number[0] = f64::NAN;
            assert!(!cholesky(&mut no_number, n));
        }
    }
}
