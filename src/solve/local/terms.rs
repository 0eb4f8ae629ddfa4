//! What a unit of local unknowns says once the search is over: what its elimination takes from the shared ones, and how well it is known itself.

use nalgebra::{DMatrix, DVector};

use super::LocalUnit;

impl LocalUnit {
    /// What eliminating the local unknowns takes from the shared ones, without damping: `H_sl H_ll^+ H_ls` and `H_sl H_ll^+ g_l`. The pseudo-inverse
    /// takes nothing away for a direction of a moving target that was not seen.
    pub(in super::super) fn marginal(&self) -> (DMatrix<f64>, DVector<f64>) {
        let (local, shared) = (self.form.local(), self.form.shared.len());
        let across = DMatrix::from_fn(local, shared, |i, j| self.rows()[i * (local + shared + 1) + local + j]);
        let taken = across.transpose() * self.gain();
        (taken.columns(0, shared).into_owned(), taken.column(shared).into_owned())
    }

    /// `H_ll^+ [H_ls, g_l]`: how the local unknowns follow the shared ones, with the sign turned.
    pub(in super::super) fn gain(&self) -> DMatrix<f64> {
        let (local, shared) = (self.form.local(), self.form.shared.len());
        let right = DMatrix::from_fn(local, shared + 1, |i, j| self.rows()[i * (local + shared + 1) + local + j]);
        self.local_covariance() * right
    }

    /// `H_ll^+`: the covariance of the local unknowns if the shared ones were known.
    pub(in super::super) fn local_covariance(&self) -> DMatrix<f64> {
        let (local, size) = (self.form.local(), self.form.size());
        // Millimetres and milliradians are of like size, so that one tolerance fits both.
        let eigen = DMatrix::from_fn(local, local, |i, j| self.rows()[i * size + j]).symmetric_eigen();
        let floor = eigen.eigenvalues.max() * 1e-12;
        let mut inverse = DMatrix::zeros(local, local);
        for (value, vector) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
            if *value > floor {
                inverse += vector * vector.transpose() / *value;
            }
        }
        inverse
    }

    /// The shared columns that the unit touches.
    pub(in super::super) fn shared(&self) -> &[usize] {
        &self.form.shared
    }
}
