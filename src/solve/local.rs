//! Unknowns that live at one configuration only: the poses of targets that move and the twists of robots that stop inexactly, eliminated before the
//! shared equations are solved. A robot's twist has its repeatability R as a prior, so eliminating it leaves `M - M (M + R^-1)^-1 M` of what
//! its measurements say.
//!
//! Measurements never reach across configurations, so the local unknowns of one configuration meet only shared ones. Each configuration
//! is a unit that keeps its local rows `[H_ll, H_ls, g_l]`; what is shared alone goes straight into the sums of a *bundle* of units. The
//! Schur complement `S = H_ss - H_sl (H_ll + lambda D)^-1 H_ls` is formed in the same sums, and the local step follows from the shared one.

use std::collections::BTreeSet;

use super::assemble::{Normal, Scratch, Shape};
use super::plan::{Block, Group, Plan};
use super::prior::pose_prior;
use super::state::State;
use crate::geometry::Pose;

/// Units in a bundle: enough to make the sums worth folding, few enough to share out evenly.
const BUNDLE: usize = 64;
/// Shared columns of a bundle, unless one configuration alone touches more.
const WIDEST: usize = 256;

/// The blocks of one configuration whose paths cross a moving edge.
#[derive(Clone, Debug)]
pub struct LocalUnit {
    /// Index into [`Plan::configurations`].
    pub(super) configuration: usize,
    /// (group, block within the group).
    members: Vec<(usize, usize)>,
    /// Moving edges at this configuration; edge `i` owns local columns `6 i .. 6 i + 6`.
    pub(super) edges: Vec<usize>,
    /// Shared columns that its measurements touch, ascending.
    pub(super) shared: Vec<usize>,
    /// Where each of them stands in the bundle's sums.
    in_bundle: Vec<u32>,
    /// For each compact column of each member in turn: its place in (local, shared, residual).
    places: Vec<u32>,
    /// Row-major, local rows over (local, shared, residual), both triangles of the local block.
    pub(super) rows: Vec<f64>,
    cost: f64,
    /// The frozen scaling of the local columns.
    scaling: Vec<f64>,
    /// The lower Cholesky factor `L` of the damped local block, row-major.
    factor: Vec<f64>,
    /// `L^-1 [H_ls, g_l]`, row-major.
    solved: Vec<f64>,
    /// The local step of the last factor.
    pub(super) step: Vec<f64>,
}

/// Units whose shared parts are summed together.
#[derive(Clone, Debug)]
pub(super) struct Bundle {
    pub(super) units: Vec<LocalUnit>,
    /// Shared columns of all its units, ascending.
    pub(super) shared: Vec<usize>,
    /// Row-major over (shared, residual), upper triangle: the units' shared parts.
    sums: Vec<f64>,
    /// The same, of what elimination takes away.
    taken: Vec<f64>,
    /// A compact matrix of one member.
    buffer: Vec<f64>,
    pub(super) scratch: Scratch,
    cost: f64,
    /// Whether every unit's damped local block was positive definite.
    positive: bool,
}

/// One unit for each configuration at which something moves, in bundles; of the chosen blocks only, if any are chosen.
pub(super) fn bundles(plan: &Plan, shapes: &[Shape], chosen: Option<&[bool]>) -> Vec<Bundle> {
    let mut units: Vec<Option<LocalUnit>> = vec![None; plan.configurations.len()];
    for (group_index, group) in plan.groups.iter().enumerate().filter(|(_, group)| !group.compiled.moving.is_empty()) {
        let wanted = |block: &Block| chosen.is_none_or(|chosen| chosen[block.place]);
        for (block_index, block) in group.blocks.iter().enumerate().filter(|(_, block)| wanted(block)) {
            let unit = units[block.configuration].get_or_insert_with(|| LocalUnit::new(block.configuration));
            unit.members.push((group_index, block_index));
            for &(_, edge) in &group.compiled.moving {
                if !unit.edges.contains(&edge) {
                    unit.edges.push(edge);
                }
            }
        }
    }
    let mut units: Vec<LocalUnit> = units.into_iter().flatten().collect();
    units.iter_mut().for_each(|unit| unit.prepare(plan, shapes));
    if plan.unknowns.count > WIDEST {
        // Like to like, so that a bundle's sums, which are dense, hold what its units touch and little else.
        units.sort_by(|a, b| a.shared.cmp(&b.shared));
    }
    let mut bundles = Vec::new();
    let mut rest = units.into_iter().peekable();
    while let Some(first) = rest.next() {
        let mut touched: BTreeSet<usize> = first.shared.iter().copied().collect();
        let mut units = vec![first];
        while units.len() < BUNDLE
            && let Some(next) = rest.next_if(|next| {
                let more = next.shared.iter().filter(|column| !touched.contains(column)).count();
                more == 0 || touched.len() + more <= WIDEST
            })
        {
            touched.extend(&next.shared);
            units.push(next);
        }
        bundles.push(Bundle::new(units, shapes));
    }
    bundles
}

impl Bundle {
    fn new(mut units: Vec<LocalUnit>, shapes: &[Shape]) -> Self {
        let mut shared: Vec<usize> = units.iter().flat_map(|unit| unit.shared.iter().copied()).collect();
        shared.sort_unstable();
        shared.dedup();
        let groups = units.iter().flat_map(|unit| unit.members.iter().map(|(group, _)| *group));
        let widest = groups.map(|group| shapes[group].width).max().unwrap_or(0);
        for unit in &mut units {
            let place = |column: &usize| shared.binary_search(column).unwrap_or(0) as u32;
            unit.in_bundle = unit.shared.iter().map(place).chain([shared.len() as u32]).collect();
        }
        let size = (shared.len() + 1) * (shared.len() + 1);
        Self {
            units,
            shared,
            sums: vec![0.0; size],
            taken: vec![0.0; size],
            buffer: vec![0.0; widest * widest],
            scratch: Scratch::default(),
            cost: 0.0,
            positive: true,
        }
    }

    /// Linearises every unit.
    pub(super) fn fill(
        &mut self,
        (plan, shapes): (&Plan, &[Shape]),
        state: &State,
        mut expand: impl FnMut(&Group, &Shape, &Block, &mut Scratch, &mut [f64]) -> f64,
    ) {
        self.sums.fill(0.0);
        self.cost = 0.0;
        for unit in &mut self.units {
            let stride = self.shared.len() + 1;
            let scratch = &mut self.scratch;
            unit.fill((plan, shapes), &mut self.buffer, (&mut self.sums, stride), |group, shape, block, matrix| {
                expand(group, shape, block, scratch, matrix)
            });
            unit.believe(plan, state);
            self.cost += unit.cost;
        }
    }

    /// Adds the shared part, not reduced, and the cost.
    pub(super) fn add_shared(&self, normal: &mut Normal) {
        normal.add_upper(&self.shared, &self.sums);
        normal.cost += self.cost;
    }

    /// Factorises the damped local blocks and sums what their elimination takes from the shared equations.
    pub(super) fn eliminate(&mut self, lambda: f64) {
        self.taken.fill(0.0);
        self.positive = true;
        for unit in &mut self.units {
            if !unit.factorise(lambda) {
                self.positive = false;
                return;
            }
            unit.take(&mut self.taken, self.shared.len() + 1);
        }
    }

    /// What the last elimination takes from the shared equations, as [`Bundle::add_shared`] has it; none if a local block was not positive definite.
    pub(super) fn taken(&self) -> Option<&[f64]> {
        self.positive.then_some(&self.taken)
    }
}

impl LocalUnit {
    fn new(configuration: usize) -> Self {
        Self {
            configuration,
            members: Vec::new(),
            edges: Vec::new(),
            shared: Vec::new(),
            in_bundle: Vec::new(),
            places: Vec::new(),
            rows: Vec::new(),
            cost: 0.0,
            scaling: Vec::new(),
            factor: Vec::new(),
            solved: Vec::new(),
            step: Vec::new(),
        }
    }

    /// Finds where everything goes, and makes room.
    fn prepare(&mut self, plan: &Plan, shapes: &[Shape]) {
        for &(group, _) in &self.members {
            for &(_, shared, count) in &shapes[group].shared {
                self.shared.extend(shared..shared + count);
            }
        }
        self.shared.sort_unstable();
        self.shared.dedup();
        let (local, last) = (self.local_count(), self.local_count() + self.shared.len());
        for &(group_index, _) in &self.members {
            let shape = &shapes[group_index];
            let start = self.places.len();
            self.places.resize(start + shape.width, last as u32);
            let places = &mut self.places[start..];
            for &(compact, shared, count) in &shape.shared {
                for i in 0..count {
                    places[compact + i] = (local + self.shared.binary_search(&(shared + i)).unwrap_or(0)) as u32;
                }
            }
            for &(column, edge) in &plan.groups[group_index].compiled.moving {
                let slot = self.edges.iter().position(|known| *known == edge).unwrap_or(0);
                for i in 0..6 {
                    places[column + i] = (6 * slot + i) as u32;
                }
            }
        }
        self.rows = vec![0.0; local * (last + 1)];
        self.factor = vec![0.0; local * local];
        self.solved = vec![0.0; local * (self.shared.len() + 1)];
        self.step = vec![0.0; local];
    }

    /// The number of local columns.
    pub(super) fn local_count(&self) -> usize {
        6 * self.edges.len()
    }

    /// Fills the local rows from the unit's blocks and adds the shared part to `sums` (row-major over the columns that `in_bundle` numbers, with the
    /// given stride; upper triangle). `buffer` holds one member's compact matrix.
    pub(super) fn fill(
        &mut self,
        (plan, shapes): (&Plan, &[Shape]),
        buffer: &mut [f64],
        (sums, stride): (&mut [f64], usize),
        mut expand: impl FnMut(&Group, &Shape, &Block, &mut [f64]) -> f64,
    ) {
        let (local, size) = (self.local_count(), self.local_count() + self.shared.len() + 1);
        self.rows.fill(0.0);
        self.cost = 0.0;
        let mut first = 0;
        for &(group_index, block) in &self.members {
            let group = &plan.groups[group_index];
            let shape = &shapes[group_index];
            let width = shape.width;
            let buffer = &mut buffer[..width * width];
            buffer.fill(0.0);
            self.cost += expand(group, shape, &group.blocks[block], buffer);
            let places = &self.places[first..first + width];
            first += width;
            for i in 0..width - 1 {
                for j in i..width {
                    let value = buffer[i * width + j];
                    let (p, q) = (places[i].min(places[j]) as usize, places[i].max(places[j]) as usize);
                    if p >= local {
                        let (a, b) = (self.in_bundle[p - local] as usize, self.in_bundle[q - local] as usize);
                        sums[a * stride + b] += value;
                    } else {
                        self.rows[p * size + q] += value;
                        if q < local && p != q {
                            self.rows[q * size + p] += value;
                        }
                    }
                }
            }
        }
        if self.scaling.is_empty() {
            self.scaling = (0..local).map(|i| self.rows[i * size + i]).collect();
            let floor = self.scaling.iter().copied().fold(0.0, f64::max) * 1e-9;
            self.scaling.iter_mut().for_each(|d| *d = d.max(floor).max(f64::MIN_POSITIVE));
        }
    }

    /// The cost of the unit's blocks.
    pub(super) fn cost_of(&self, plan: &Plan, state: &State, mut cost: impl FnMut(&Group, &Block) -> f64) -> f64 {
        let members = self.members.iter();
        let measured: f64 =
            members.map(|&(group, block)| cost(&plan.groups[group], &plan.groups[group].blocks[block])).sum();
        measured + self.belief_cost(plan, state)
    }

    /// Adds what is believed of the robots' stops.
    fn believe(&mut self, plan: &Plan, state: &State) {
        let size = self.local_count() + self.shared.len() + 1;
        for (slot, &edge) in self.edges.iter().enumerate() {
            let Some(stop) = edge.checked_sub(plan.moving_edges).map(|stop| &plan.stops[stop]) else { continue };
            let twist = &state.moving_poses[edge][self.configuration];
            let (residual, jacobian) = pose_prior(&Pose::identity(), twist, &stop.sigma);
            let (hessian, gradient) = (jacobian.transpose() * jacobian, jacobian.transpose() * residual);
            for i in 0..6 {
                let row = &mut self.rows[(6 * slot + i) * size..(6 * slot + i + 1) * size];
                row[size - 1] += gradient[i];
                for j in 0..6 {
                    row[6 * slot + j] += hessian[(i, j)];
                }
            }
        }
        self.cost += self.belief_cost(plan, state);
    }

    /// The cost of what is believed of the robots' stops.
    pub(super) fn belief_cost(&self, plan: &Plan, state: &State) -> f64 {
        let stop = |edge: usize| plan.stops.get(edge.checked_sub(plan.moving_edges)?);
        let stops = self.edges.iter().filter_map(|&edge| Some((edge, stop(edge)?)));
        stops
            .map(|(edge, stop)| {
                let twist = &state.moving_poses[edge][self.configuration];
                0.5 * pose_prior(&Pose::identity(), twist, &stop.sigma).0.norm_squared()
            })
            .sum()
    }

    /// Factorises the damped local block and solves its lower half; false if it is not positive definite.
    fn factorise(&mut self, lambda: f64) -> bool {
        let (local, shared) = (self.local_count(), self.shared.len());
        let size = local + shared + 1;
        let l = &mut self.factor;
        for i in 0..local {
            for j in 0..=i {
                let mut value = self.rows[i * size + j];
                if i == j {
                    value += lambda * self.scaling[i];
                }
                for k in 0..j {
                    value -= l[i * local + k] * l[j * local + k];
                }
                if i != j {
                    l[i * local + j] = value / l[j * local + j];
                } else if value > 0.0 && value.is_finite() {
                    l[i * local + i] = value.sqrt();
                } else {
                    return false;
                }
            }
        }
        let width = shared + 1;
        for i in 0..local {
            let (done, rest) = self.solved.split_at_mut(i * width);
            let row = &mut rest[..width];
            row.copy_from_slice(&self.rows[i * size + local..(i + 1) * size]);
            for k in 0..i {
                let factor = l[i * local + k];
                row.iter_mut().zip(&done[k * width..]).for_each(|(x, y)| *x -= factor * y);
            }
            let inverse = 1.0 / l[i * local + i];
            row.iter_mut().for_each(|x| *x *= inverse);
        }
        true
    }

    /// Adds `[H_ls, g_l]^T H_ll^-1 [H_ls, g_l]` for the last factor to the bundle's sums.
    fn take(&self, taken: &mut [f64], stride: usize) {
        let width = self.shared.len() + 1;
        for row in self.solved.chunks_exact(width) {
            for (i, &a) in self.in_bundle[..width - 1].iter().enumerate() {
                let value = row[i];
                let into = &mut taken[a as usize * stride..(a as usize + 1) * stride];
                for (&b, other) in self.in_bundle[i..].iter().zip(&row[i..]) {
                    into[b as usize] += value * other;
                }
            }
        }
    }

    /// Finds the local step that goes with a shared one: `-H_ll^-1 (g_l + H_ls step)`.
    pub(super) fn back_substitute(&mut self, step: &[f64]) {
        let (local, width) = (self.local_count(), self.shared.len() + 1);
        for i in 0..local {
            let row = &self.solved[i * width..(i + 1) * width];
            let across: f64 = self.shared.iter().zip(row).map(|(column, value)| value * step[*column]).sum();
            self.step[i] = -(row[width - 1] + across);
        }
        for i in (0..local).rev() {
            for k in i + 1..local {
                self.step[i] -= self.factor[k * local + i] * self.step[k];
            }
            self.step[i] /= self.factor[i * local + i];
        }
    }

    /// How much of the model's decrease the local step accounts for: `(-g_l . d, lambda d^T D d)`.
    pub(super) fn predicted(&self, lambda: f64) -> (f64, f64) {
        let size = self.local_count() + self.shared.len() + 1;
        let (mut gradient, mut damping) = (0.0, 0.0);
        for (i, d) in self.step.iter().enumerate() {
            gradient -= self.rows[(i + 1) * size - 1] * d;
            damping += lambda * self.scaling[i] * d * d;
        }
        (gradient, damping)
    }
}
