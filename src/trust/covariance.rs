//! Standard deviations, and the directions that are left open.
//!
//! The matrix is scaled to physical units first (1 mm, 1 mrad, what moves an edge pixel by 1 px), so that its eigenvalues can be
//! read: the standard deviation along an eigenvector is one over the root of its eigenvalue, in those units.

use nalgebra::DMatrix;
use std::sync::Arc;

use super::large::{Judged, Large, judge};
use super::sandwich::{Sandwich, sandwich};
use super::undetermined::WEAK;
use crate::frames::{FrameTree, Freedom};
use crate::solve::terms::Terms;
use crate::solve::{Normal, Plan, State, Unknown, UnknownKind};

/// A direction counts as undetermined when its standard deviation exceeds this many units (50 mm, 50 mrad, 50 px): no measurement of a cell is that bad.
pub const UNDETERMINED: f64 = 50.0;
/// A component that carries more than this share of an undetermined direction is undetermined itself.
const SHARE: f64 = 0.01;

/// Where a standard deviation comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// The information matrix with the fitted noise: right where all errors are independent.
    Information,
    /// The cluster-robust sandwich: right also where the errors of a configuration, or of a corner that never moves, have something in common.
    Clusters,
    /// The one to use: the information's, or where the clusters show that errors have something in common ([`Sandwich::shown`]) the larger of both.
    Both,
}

/// The uncertainty of the shared unknowns.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Covariance {
    /// From the information matrix, in units, of the determined part; `n x n`, or empty where the equations are sparse ([`Covariance::is_whole`]).
    pub matrix: DMatrix<f64>,
    /// The cluster-robust one beside it; the same holds for its matrices.
    pub clusters: Sandwich,
    /// The undetermined directions: eigenvectors in units (columns), weakest first.
    pub open: Vec<Vec<f64>>,
    /// The standard deviation along each of them, in units; infinite if there is no information at all.
    pub open_sigma: Vec<f64>,
    /// What the standard deviations have been scaled by: the fitted noise against the layout's.
    pub noise: f64,
    units: Vec<f64>,
    large: Option<Arc<Large>>,
}

/// The covariance from the terms of the measurements and the equations of the priors. The measurements' is scaled
/// by the fitted `noise`, the priors' is not. Directions are judged by the fitted noise or the layout's own, whichever is larger, so
/// that perfect data does not hide an open one.
#[must_use]
pub fn covariance(plan: &Plan, terms: &Terms, believed: &Normal, noise: f64) -> Covariance {
    let n = plan.unknowns.count;
    if let Some(symbolic) = believed.symbolic() {
        let Judged { large, open, open_sigma, scatter: [configurations, corners] } =
            judge(plan, symbolic, terms, believed, noise);
        let clusters = Sandwich { configurations, corners, ..Sandwich::default() };
        let (units, large) = (plan.unknowns.units(), Some(Arc::new(large)));
        return Covariance { clusters, open, open_sigma, noise, units, large, ..Covariance::default() };
    }
    let believed = &believed.hessian;
    let mut result = from_information(plan, &terms.information(n), believed, noise);
    // Where nothing at all is known the gradients may not even be numbers.
    result.clusters = if result.open.len() < n {
        sandwich(&result, terms, believed)
    } else {
        Sandwich { matrix: result.matrix.clone(), shown: result.matrix.clone(), ..Sandwich::default() }
    };
    result
}

pub(super) fn from_information(plan: &Plan, measured: &[f64], believed: &[f64], noise: f64) -> Covariance {
    let n = plan.unknowns.count;
    let units = plan.unknowns.units();
    let scaled = |noise: f64| {
        DMatrix::from_fn(n, n, |i, j| {
            let entry = |m: &[f64]| 0.5 * (m[i * n + j] + m[j * n + i]);
            (entry(measured) / (noise * noise) + entry(believed)) * units[i] * units[j]
        })
    };
    let judged = scaled(noise.max(1.0));
    let fitted = scaled(noise.max(1e-9));
    let mut result = Covariance { matrix: DMatrix::zeros(n, n), noise, units: units.clone(), ..Covariance::default() };
    if n == 0 {
        return result;
    }
    if fitted.iter().chain(judged.iter()).any(|x| !x.is_finite()) {
        result.open = (0..n).map(|i| (0..n).map(|j| f64::from(u8::from(i == j))).collect()).collect();
        result.open_sigma = vec![f64::INFINITY; n];
        return result;
    }
    let eigen = judged.symmetric_eigen();
    let largest = eigen.eigenvalues.max().max(f64::MIN_POSITIVE);
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
    let mut determined = Vec::new();
    for index in order {
        let value = eigen.eigenvalues[index];
        // Below this, rounding alone could have made the eigenvalue.
        let sigma = if value <= 1e-14 * largest { f64::INFINITY } else { 1.0 / value.sqrt() };
        if sigma > UNDETERMINED {
            result.open.push(eigen.eigenvectors.column(index).iter().copied().collect());
            result.open_sigma.push(sigma);
        } else {
            // Scaled by its own sigma, so that what is left to invert is near the identity.
            determined.push(eigen.eigenvectors.column(index) * sigma);
        }
    }
    if determined.is_empty() {
        return result;
    }
    let basis = DMatrix::from_columns(&determined);
    if let Some(inverse) = (basis.transpose() * fitted * &basis).cholesky().map(|factor| factor.inverse()) {
        result.matrix = &basis * inverse * basis.transpose();
    }
    result
}

impl Covariance {
    /// One unit of each column in natural units.
    #[must_use]
    pub fn units(&self) -> &[f64] {
        &self.units
    }

    /// The covariances of a linear function of the unknowns, `jacobian * unknowns` in natural units: from the information, from the clusters, and where only
    /// errors that are shown to be shared count as such.
    #[must_use]
    pub fn of(&self, jacobian: &DMatrix<f64>) -> [DMatrix<f64>; 3] {
        let scaled = self.scaled(jacobian);
        if let Some(large) = &self.large {
            return large.of(&scaled);
        }
        [&self.matrix, &self.clusters.matrix, &self.clusters.shown].map(|matrix| &scaled * matrix * scaled.transpose())
    }

    /// Whether the whole matrices are kept; of large cells only what single unknowns need, and what [`Covariance::of`] finds when it is asked.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        self.large.is_none()
    }

    /// From the information, in units: the part of neighbouring columns of one block of unknowns.
    #[must_use]
    pub fn own(&self, start: usize, count: usize) -> DMatrix<f64> {
        self.variances(Source::Information, start, count)[0].clone()
    }

    /// The directions that are determined, but to more than [`super::undetermined::WEAK`] units only, weakest first, with their standard deviations.
    #[must_use]
    pub fn weak(&self) -> (Vec<Vec<f64>>, Vec<f64>) {
        if let Some(large) = &self.large {
            return large.weak.iter().cloned().unzip();
        }
        // The largest eigenvalue is at most the trace: a well determined cell stops here.
        if self.matrix.trace() < WEAK * WEAK {
            return (Vec::new(), Vec::new());
        }
        let eigen = self.matrix.clone().symmetric_eigen();
        let mut order: Vec<usize> =
            (0..eigen.eigenvalues.len()).filter(|i| eigen.eigenvalues[*i] > WEAK * WEAK).collect();
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
        let vectors = order.iter().map(|&i| eigen.eigenvectors.column(i).iter().copied().collect()).collect();
        (vectors, order.iter().map(|&i| eigen.eigenvalues[i].sqrt()).collect())
    }

    /// Of which rows of a linear function less than `share` lies along undetermined directions.
    #[must_use]
    pub fn determined(&self, jacobian: &DMatrix<f64>, share: f64) -> Vec<bool> {
        let scaled = self.scaled(jacobian);
        let along =
            |row: usize, v: &[f64]| v.iter().enumerate().map(|(j, x)| scaled[(row, j)] * x).sum::<f64>().powi(2);
        let open = |row: usize| self.open.iter().map(|v| along(row, v)).sum::<f64>();
        (0..scaled.nrows()).map(|row| open(row) <= share * scaled.row(row).norm_squared()).collect()
    }

    fn scaled(&self, jacobian: &DMatrix<f64>) -> DMatrix<f64> {
        DMatrix::from_fn(jacobian.nrows(), jacobian.ncols(), |i, j| jacobian[(i, j)] * self.units[j])
    }

    /// Standard deviations of a pose in its parent's axes: translation (m), then rotation vector (rad); `None` where undetermined.
    #[must_use]
    pub fn pose_sigma(&self, tree: &FrameTree, state: &State, block: &Unknown, source: Source) -> [Option<f64>; 6] {
        let UnknownKind::Edge(edge) = block.kind else { return [None; 6] };
        let r = state.static_poses[edge].rotation_matrix();
        let rotated = |m: &DMatrix<f64>| -> [f64; 6] {
            let turned = |at: usize| (r * m.fixed_view::<3, 3>(at, at) * r.transpose()).diagonal();
            let translation = turned(0);
            if tree.static_edges[edge].freedom == Freedom::Translation {
                return [translation.x, translation.y, translation.z, 0.0, 0.0, 0.0];
            }
            let rotation = turned(3);
            [translation.x, translation.y, translation.z, rotation.x, rotation.y, rotation.z]
        };
        let (start, count) = (block.start, block.count());
        let open = rotated(&self.open_matrix(start, count));
        let variances = self.variances(source, start, count).map(|matrix| rotated(&matrix));
        let larger = |i: usize| variances.iter().fold(0.0, |most: f64, v| most.max(v[i]));
        std::array::from_fn(|i| (open[i] <= SHARE).then(|| larger(i).sqrt() * 1e-3))
    }

    /// Standard deviation of one column in natural units; `None` if it is undetermined.
    #[must_use]
    pub fn column_sigma(&self, column: usize, source: Source) -> Option<f64> {
        let open: f64 = self.open.iter().map(|v| v[column] * v[column]).sum();
        let variances = self.variances(source, column, 1).map(|matrix| matrix[(0, 0)]);
        (open <= SHARE).then(|| variances.into_iter().fold(0.0, f64::max).sqrt() * self.units[column])
    }

    /// The matrices whose larger variance counts, for neighbouring columns of one block.
    fn variances(&self, source: Source, start: usize, count: usize) -> [DMatrix<f64>; 2] {
        let which = match source {
            Source::Information => [0, 0],
            Source::Clusters => [1, 1],
            Source::Both => [0, 2],
        };
        which.map(|which| match &self.large {
            Some(large) => large.own(which, start, count),
            None => {
                let matrix = [&self.matrix, &self.clusters.matrix, &self.clusters.shown][which];
                matrix.view((start, start), (count, count)).into_owned()
            }
        })
    }

    /// The projection onto the undetermined directions, of neighbouring columns.
    fn open_matrix(&self, start: usize, count: usize) -> DMatrix<f64> {
        DMatrix::from_fn(count, count, |i, j| self.open.iter().map(|v| v[start + i] * v[start + j]).sum())
    }
}
