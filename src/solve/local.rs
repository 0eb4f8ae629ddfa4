//! Unknowns that live at one configuration only: the poses of targets that move, eliminated before the shared equations are solved.
//!
//! Measurements never reach across configurations, so the local unknowns of one configuration meet only shared ones. Each configuration
//! is a unit: its compact matrix over (local, shared, residual) is reduced by the Schur complement
//! `S = H_ss - H_sl (H_ll + lambda D)^-1 H_ls`, and the local step follows from the shared one.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::assemble::{Assembler, Normal};
use super::plan::{Block, Group, Plan};

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
    shared: Vec<usize>,
    /// One compact buffer a member.
    buffers: Vec<Vec<f64>>,
    /// Over (local, shared, residual), both triangles.
    matrix: DMatrix<f64>,
    cost: f64,
    /// The frozen scaling of the local columns.
    scaling: Vec<f64>,
    factor: Option<Cholesky<f64, Dyn>>,
}

/// One unit for each configuration at which something moves.
pub(super) fn local_units(plan: &Plan) -> Vec<LocalUnit> {
    let mut units: Vec<Option<LocalUnit>> = (0..plan.configurations.len()).map(|_| None).collect();
    for (group_index, group) in plan.groups.iter().enumerate().filter(|(_, group)| !group.compiled.moving.is_empty()) {
        for (block_index, block) in group.blocks.iter().enumerate() {
            let unit = units[block.configuration].get_or_insert_with(|| LocalUnit {
                configuration: block.configuration,
                members: Vec::new(),
                edges: Vec::new(),
                shared: Vec::new(),
                buffers: Vec::new(),
                matrix: DMatrix::zeros(0, 0),
                cost: 0.0,
                scaling: Vec::new(),
                factor: None,
            });
            unit.members.push((group_index, block_index));
            unit.buffers.push(Vec::new());
            for &(_, edge) in &group.compiled.moving {
                if !unit.edges.contains(&edge) {
                    unit.edges.push(edge);
                }
            }
        }
    }
    units.into_iter().flatten().collect()
}

impl LocalUnit {
    /// Gives every member a buffer of its group's width.
    pub(super) fn size_buffers(&mut self, widths: &[usize]) {
        for ((group, _), buffer) in self.members.iter().zip(&mut self.buffers) {
            buffer.resize(widths[*group] * widths[*group], 0.0);
        }
    }

    /// The number of local columns.
    pub(super) fn local_count(&self) -> usize {
        6 * self.edges.len()
    }

    /// Fills the compact matrix from the unit's blocks.
    pub(super) fn fill(
        &mut self,
        assembler: &Assembler<'_>,
        mut expand: impl FnMut(&Group, &Block, &mut [f64]) -> f64,
    ) {
        let plan = assembler.plan;
        if self.shared.is_empty() {
            for &(group, _) in &self.members {
                for (_, shared, count) in assembler.shared_columns(&plan.groups[group]) {
                    self.shared.extend(shared..shared + count);
                }
            }
            self.shared.sort_unstable();
            self.shared.dedup();
        }
        let local = self.local_count();
        let size = local + self.shared.len() + 1;
        self.matrix = DMatrix::zeros(size, size);
        self.cost = 0.0;
        for (&(group_index, block), buffer) in self.members.iter().zip(&mut self.buffers) {
            let group = &plan.groups[group_index];
            buffer.fill(0.0);
            self.cost += expand(group, &group.blocks[block], buffer);
            let width = assembler.width(group);
            // Where each compact column of the member goes.
            let mut places = vec![size - 1; width];
            for (compact, shared, count) in assembler.shared_columns(group) {
                for i in 0..count {
                    places[compact + i] = local + self.shared.binary_search(&(shared + i)).unwrap_or(0);
                }
            }
            for &(column, edge) in &group.compiled.moving {
                let slot = self.edges.iter().position(|known| *known == edge).unwrap_or(0);
                for i in 0..6 {
                    places[column + i] = 6 * slot + i;
                }
            }
            for i in 0..width {
                for j in i..width {
                    let value = buffer[i * width + j];
                    self.matrix[(places[i], places[j])] += value;
                    if i != j {
                        self.matrix[(places[j], places[i])] += value;
                    }
                }
            }
        }
        if self.scaling.is_empty() {
            self.scaling = (0..local).map(|i| self.matrix[(i, i)]).collect();
            let floor = self.scaling.iter().copied().fold(0.0, f64::max) * 1e-9;
            self.scaling.iter_mut().for_each(|d| *d = d.max(floor).max(f64::MIN_POSITIVE));
        }
    }

    /// Adds the shared part, not reduced, and the cost.
    pub(super) fn add_shared(&self, normal: &mut Normal) {
        let (local, n, last) = (self.local_count(), normal.gradient.len(), self.matrix.ncols() - 1);
        for (i, &a) in self.shared.iter().enumerate() {
            normal.gradient[a] += self.matrix[(local + i, last)];
            for (j, &b) in self.shared.iter().enumerate() {
                normal.hessian[a * n + b] += self.matrix[(local + i, local + j)];
            }
        }
        normal.cost += self.cost;
    }

    /// The cost of the unit's blocks.
    pub(super) fn cost_of(&self, plan: &Plan, cost: &impl Fn(&Group, &Block) -> f64) -> f64 {
        self.members.iter().map(|&(group, block)| cost(&plan.groups[group], &plan.groups[group].blocks[block])).sum()
    }

    /// Factorises the damped local block; false if it is not positive definite.
    pub(super) fn factorise(&mut self, lambda: f64) -> bool {
        let local = self.local_count();
        let mut block = self.matrix.view((0, 0), (local, local)).into_owned();
        for i in 0..local {
            block[(i, i)] += lambda * self.scaling[i];
        }
        self.factor = Cholesky::new(block);
        self.factor.is_some()
    }

    /// `(H_sl H_ll^-1 H_ls, H_sl H_ll^-1 g_l)` for the last factor.
    pub(super) fn reduction(&self) -> Option<(DMatrix<f64>, DVector<f64>)> {
        let (local, shared) = (self.local_count(), self.shared.len());
        let across = self.matrix.view((0, local), (local, shared + 1)).into_owned();
        let solved = self.factor.as_ref()?.solve(&across);
        let product = across.columns(0, shared).transpose() * solved;
        Some((product.columns(0, shared).into_owned(), product.column(shared).into_owned()))
    }

    /// `H_sl H_ll^+ H_ls` without damping. The pseudo-inverse takes nothing away for a direction of a moving target that was not seen.
    pub(super) fn marginal(&self) -> DMatrix<f64> {
        let (local, shared) = (self.local_count(), self.shared.len());
        let across = self.matrix.view((0, local), (local, shared)).into_owned();
        // Millimetres and milliradians are of like size, so that one tolerance fits both.
        let eigen = self.matrix.view((0, 0), (local, local)).into_owned().symmetric_eigen();
        let floor = eigen.eigenvalues.max() * 1e-12;
        let mut block = DMatrix::zeros(shared, shared);
        for (value, vector) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
            if *value > floor {
                let along = across.transpose() * vector;
                block += &along * along.transpose() / *value;
            }
        }
        block
    }

    /// The shared columns that the unit touches.
    pub(super) fn shared(&self) -> &[usize] {
        &self.shared
    }

    /// The local step that goes with a shared one: `-H_ll^-1 (g_l + H_ls step)`.
    pub(super) fn back_substitute(&self, step: &[f64]) -> DVector<f64> {
        let (local, shared) = (self.local_count(), self.shared.len());
        let mut right = self.matrix.view((0, local + shared), (local, 1)).column(0).into_owned();
        for (j, &column) in self.shared.iter().enumerate() {
            right.axpy(step[column], &self.matrix.view((0, local + j), (local, 1)).column(0), 1.0);
        }
        match &self.factor {
            Some(factor) => -factor.solve(&right),
            None => DVector::zeros(local),
        }
    }

    /// How much of the model's decrease the local step accounts for: `(-g_l . d, lambda d^T D d)`.
    pub(super) fn predicted(&self, step: &DVector<f64>, lambda: f64) -> (f64, f64) {
        let last = self.matrix.ncols() - 1;
        let (mut gradient, mut damping) = (0.0, 0.0);
        for i in 0..step.len() {
            gradient -= self.matrix[(i, last)] * step[i];
            damping += lambda * self.scaling[i] * step[i] * step[i];
        }
        (gradient, damping)
    }
}
