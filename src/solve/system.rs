//! The damped shared equations of one step, dense or sparse.

use super::dense::Dense;
use super::equations::Equations;
use super::normal::Normal;
use super::sparse::{Sparse, Symbolic};
use std::sync::Arc;

/// Room for the equations of a step.
pub(super) struct System {
    /// The matrix: row-major with both triangles, of which the upper one is filled first, or the values of the pattern.
    matrix: Vec<f64>,
    right: Vec<f64>,
    /// Whether something was taken since the equations were loaded.
    taken: bool,
    form: Form,
}

enum Form {
    Dense(Box<Dense>),
    Sparse(Arc<Symbolic>, Box<Sparse>),
}

impl System {
    pub(super) fn new(equations: &Equations) -> Self {
        let n = equations.solver.unknowns;
        let (size, form) = match &equations.sparse {
            None => (n * n, Form::Dense(Box::new(Dense::new(n)))),
            Some(symbolic) => {
                let room = Box::new(Sparse::new(symbolic));
                (symbolic.pattern.places(), Form::Sparse(Arc::clone(symbolic), room))
            }
        };
        Self { matrix: vec![0.0; size], right: vec![0.0; n], taken: false, form }
    }

    /// Takes over the equations, with `lambda * scaling` more on the diagonal.
    pub(super) fn load(&mut self, normal: &Normal, scaling: &[f64], lambda: f64) {
        self.matrix.copy_from_slice(&normal.hessian);
        self.right.iter_mut().zip(&normal.gradient).for_each(|(right, g)| *right = -g);
        for (i, scale) in scaling.iter().enumerate() {
            self.matrix[normal.diagonal_place(i)] += lambda * scale;
        }
        self.taken = false;
    }

    /// Takes away what eliminating local unknowns does: a compact matrix (row-major over ascending `columns` and the residual, upper triangle).
    pub(super) fn take(&mut self, columns: &[usize], matrix: &[f64]) {
        let (n, width) = (self.right.len(), columns.len() + 1);
        for (&a, row) in columns.iter().zip(matrix.chunks_exact(width)) {
            self.right[a] += row[width - 1];
        }
        match &self.form {
            Form::Dense(_) => {
                for (i, (&a, row)) in columns.iter().zip(matrix.chunks_exact(width)).enumerate() {
                    for (&b, value) in columns[i..].iter().zip(&row[i..]) {
                        self.matrix[a * n + b] -= value;
                    }
                }
            }
            Form::Sparse(symbolic, _) => symbolic.pattern.add_upper(&mut self.matrix, columns, matrix, width, -1.0),
        }
        self.taken = true;
    }

    /// Solves for the step; `None` if the matrix is not positive definite or the solution does not satisfy the equations.
    pub(super) fn solve(&mut self) -> Option<&[f64]> {
        let n = self.right.len();
        match &mut self.form {
            Form::Dense(dense) => {
                if self.taken {
                    for i in 1..n {
                        for j in 0..i {
                            self.matrix[i * n + j] = self.matrix[j * n + i];
                        }
                    }
                }
                dense.solve(&self.matrix, &self.right)
            }
            Form::Sparse(_, sparse) => sparse.solve(&self.matrix, &self.right),
        }
        .map(|x| x.col_as_slice(0))
    }
}
