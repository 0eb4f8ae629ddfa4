//! Columns of the covariance of a large sparse problem, on the part of the space that is determined.

use faer::dyn_stack::MemBuffer;
use faer::{Mat, MatMut};
use nalgebra::DMatrix;
use std::sync::Arc;

use super::weakest::{factor, shifted};
use crate::solve::{Factor, Symbolic};

/// The inverse of an information matrix on the complement of its open directions, by a sparse factor.
///
/// With `A` the matrix, `V` an orthonormal basis of the open directions and `Y = A^-1 V`, it is `A^-1 - Y (V^T Y)^-1 Y^T`. Where there are such
/// directions `A` has a small number added to its diagonal, which one refinement takes out of the rest.
pub(super) struct Inverse {
    symbolic: Arc<Symbolic>,
    values: Vec<f64>,
    factor: Factor,
    open: Mat<f64>,
    across: Mat<f64>,
    small: DMatrix<f64>,
}

impl Inverse {
    /// None if the rest is not positive definite.
    pub(super) fn new(symbolic: &Arc<Symbolic>, values: Vec<f64>, open: &[Vec<f64>]) -> Option<Self> {
        let n = symbolic.pattern.columns();
        let factor = match open {
            [] => factor(symbolic, &values, 0.0)?,
            _ => shifted(symbolic, &values, 1e-6)?.0,
        };
        let basis = Mat::from_fn(n, open.len(), |i, j| open[j][i]);
        let mut across = basis.clone();
        factor.solve(across.as_mut(), &mut factor.room(open.len()));
        let product = basis.transpose() * &across;
        let small = DMatrix::from_fn(open.len(), open.len(), |i, j| product[(i, j)]).try_inverse()?;
        Some(Self { symbolic: Arc::clone(symbolic), values, factor, open: basis, across, small })
    }

    /// Room for right-hand sides of so many columns.
    pub(super) fn room(&self, columns: usize) -> MemBuffer {
        self.factor.room(columns)
    }

    /// Multiplies a matrix by the covariance.
    pub(super) fn apply(&self, right: &Mat<f64>, room: &mut MemBuffer) -> Mat<f64> {
        let mut x = right.clone();
        self.project(x.as_mut());
        let target = x.clone();
        self.once(x.as_mut(), room);
        if self.open.ncols() > 0 {
            let mut rest = target;
            for j in 0..rest.ncols() {
                self.symbolic.pattern.multiply(&self.values, -1.0, x.col_as_slice(j), rest.col_as_slice_mut(j));
            }
            self.project(rest.as_mut());
            self.once(rest.as_mut(), room);
            x += rest;
            self.project(x.as_mut());
        }
        x
    }

    fn once(&self, mut x: MatMut<'_, f64>, room: &mut MemBuffer) {
        self.factor.solve(x.as_mut(), room);
        self.take(x, &self.across, Some(&self.small));
    }

    /// Takes the open directions out.
    fn project(&self, x: MatMut<'_, f64>) {
        self.take(x, &self.open, None);
    }

    /// `x -= by (small) V^T x`.
    fn take(&self, mut x: MatMut<'_, f64>, by: &Mat<f64>, small: Option<&DMatrix<f64>>) {
        let (n, count) = (self.open.nrows(), self.open.ncols());
        for c in 0..if count == 0 { 0 } else { x.ncols() } {
            let along = nalgebra::DVector::from_fn(count, |j, _| (0..n).map(|i| self.open[(i, j)] * x[(i, c)]).sum());
            let along = small.map_or_else(|| along.clone(), |small| small * &along);
            for j in 0..count {
                for i in 0..n {
                    x[(i, c)] -= by[(i, j)] * along[j];
                }
            }
        }
    }
}
