//! The normal equations of the shared unknowns.

use std::sync::Arc;

use super::plan::Plan;
use super::sparse::Symbolic;

/// The normal equations of the shared unknowns, moving targets included as they were condensed.
#[derive(Clone, Debug, Default)]
pub struct Normal {
    /// `J^T W J`, local unknowns not yet eliminated: row-major with both triangles, or where the plan's equations are sparse
    /// the values of the pattern's places.
    pub hessian: Vec<f64>,
    /// `J^T W r`.
    pub gradient: Vec<f64>,
    /// The robust cost.
    pub cost: f64,
    sparse: Option<Arc<Symbolic>>,
}

impl Normal {
    /// The empty equations of a plan; nothing is allocated if there were as many before.
    pub(super) fn reset(&mut self, plan: &Plan) {
        let equations = &plan.equations;
        let columns = equations.solver.unknowns;
        self.sparse.clone_from(&equations.sparse);
        let size = self.sparse.as_ref().map_or(columns * columns, |symbolic| symbolic.pattern.places());
        self.hessian.clear();
        self.hessian.resize(size, 0.0);
        self.gradient.clear();
        self.gradient.resize(columns, 0.0);
        self.cost = 0.0;
    }

    /// The pattern that the entries stand in, if they are sparse.
    pub(crate) fn symbolic(&self) -> Option<&Arc<Symbolic>> {
        self.sparse.as_ref()
    }

    /// Where an entry of the diagonal stands.
    pub(super) fn diagonal_place(&self, column: usize) -> usize {
        match &self.sparse {
            None => column * self.gradient.len() + column,
            Some(symbolic) => symbolic.pattern.range(column).start,
        }
    }

    /// An entry of `J^T W J`.
    #[must_use]
    pub fn entry(&self, i: usize, j: usize) -> f64 {
        match &self.sparse {
            None => self.hessian[i * self.gradient.len() + j],
            Some(symbolic) => symbolic.pattern.place(i, j).map_or(0.0, |place| self.hessian[place]),
        }
    }

    /// Adds to an entry of the whole matrix; of a sparse one the upper triangle is left alone, since the lower stands for both.
    pub(super) fn add(&mut self, i: usize, j: usize, value: f64) {
        match &self.sparse {
            None => self.hessian[i * self.gradient.len() + j] += value,
            Some(symbolic) if i >= j => {
                if let Some(place) = symbolic.pattern.place(i, j) {
                    self.hessian[place] += value;
                }
            }
            Some(_) => {}
        }
    }

    /// Adds a compact matrix (row-major over its columns and the residual, upper triangle) whose column `i` is shared column `columns[i]`, to the upper
    /// triangle; [`Normal::mirror`] completes it.
    pub(super) fn add_upper(&mut self, columns: &[usize], matrix: &[f64]) {
        let (n, width) = (self.gradient.len(), columns.len() + 1);
        for (&a, row) in columns.iter().zip(matrix.chunks_exact(width)) {
            self.gradient[a] += row[width - 1];
        }
        if let Some(symbolic) = &self.sparse {
            symbolic.pattern.add_upper(&mut self.hessian, columns, matrix, width, 1.0);
            return;
        }
        for (i, (&a, row)) in columns.iter().zip(matrix.chunks_exact(width)).enumerate() {
            for (&b, value) in columns[i..].iter().zip(&row[i..]) {
                self.hessian[a.min(b) * n + a.max(b)] += value;
            }
        }
    }

    /// Copies the upper triangle to the lower, where both are kept.
    pub(super) fn mirror(&mut self) {
        if self.sparse.is_some() {
            return;
        }
        let n = self.gradient.len();
        for i in 1..n {
            for j in 0..i {
                self.hessian[i * n + j] = self.hessian[j * n + i];
            }
        }
    }
}
