//! The normal equations of the shared unknowns.

/// The normal equations of the shared unknowns, moving targets included as they were condensed.
#[derive(Clone, Debug, Default)]
pub struct Normal {
    /// `J^T W J`, row-major, both triangles; local unknowns not yet eliminated.
    pub hessian: Vec<f64>,
    /// `J^T W r`.
    pub gradient: Vec<f64>,
    /// The robust cost.
    pub cost: f64,
}

impl Normal {
    /// Empty equations of `columns` unknowns; nothing is allocated if there were as many before.
    pub(super) fn reset(&mut self, columns: usize) {
        self.hessian.clear();
        self.hessian.resize(columns * columns, 0.0);
        self.gradient.clear();
        self.gradient.resize(columns, 0.0);
        self.cost = 0.0;
    }

    /// Adds a compact matrix (row-major over its columns and the residual, upper triangle) whose column `i` is shared column `columns[i]`, to the upper
    /// triangle; [`Normal::mirror`] completes it.
    pub(super) fn add_upper(&mut self, columns: &[usize], matrix: &[f64]) {
        let (n, width) = (self.gradient.len(), columns.len() + 1);
        for (i, (&a, row)) in columns.iter().zip(matrix.chunks_exact(width)).enumerate() {
            for (&b, value) in columns[i..].iter().zip(&row[i..]) {
                self.hessian[a.min(b) * n + a.max(b)] += value;
            }
            self.gradient[a] += row[width - 1];
        }
    }

    /// Copies the upper triangle to the lower.
    pub(super) fn mirror(&mut self) {
        let n = self.gradient.len();
        for i in 1..n {
            for j in 0..i {
                self.hessian[i * n + j] = self.hessian[j * n + i];
            }
        }
    }
}
