//! Standard deviations from the information matrix, and the directions it leaves open.
//!
//! The matrix is scaled to physical units first (1 mm, 1 mrad, what moves an edge pixel by 1 px), so that its eigenvalues can be
//! read: the standard deviation along an eigenvector is one over the root of its eigenvalue, in those units.

use nalgebra::{DMatrix, Matrix3, Matrix6};

use crate::frames::{FrameTree, Freedom};
use crate::solve::{Plan, State, Unknown, UnknownKind};

/// A direction counts as undetermined when its standard deviation exceeds this many units (50 mm, 50 mrad, 50 px): no measurement of a cell is that bad.
pub const UNDETERMINED: f64 = 50.0;
/// A component that carries more than this share of an undetermined direction is undetermined itself.
const SHARE: f64 = 0.01;

/// The uncertainty of the shared unknowns.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Covariance {
    /// In units, of the determined part; `n x n`.
    pub matrix: DMatrix<f64>,
    /// The undetermined directions: eigenvectors in units (columns), weakest first.
    pub open: Vec<Vec<f64>>,
    /// The standard deviation along each of them, in units; infinite if there is no information at all.
    pub open_sigma: Vec<f64>,
    /// What the standard deviations have been scaled by: the fitted noise against the layout's.
    pub noise: f64,
    units: Vec<f64>,
}

/// The covariance from the reduced information of the measurements and that of the priors (row-major, natural units). The measurements' is scaled
/// by the fitted `noise`, the priors' is not. Directions are judged by the fitted noise or the layout's own, whichever is larger, so
/// that perfect data does not hide an open one.
#[must_use]
pub fn covariance(plan: &Plan, measured: &[f64], believed: &[f64], noise: f64) -> Covariance {
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
    /// Standard deviations of a pose in its parent's axes: translation (m), then rotation vector (rad); `None` where undetermined.
    #[must_use]
    pub fn pose_sigma(&self, tree: &FrameTree, state: &State, block: &Unknown) -> [Option<f64>; 6] {
        let UnknownKind::Edge(edge) = block.kind else { return [None; 6] };
        let r = state.static_poses[edge].rotation_matrix();
        if tree.static_edges[edge].freedom == Freedom::Translation {
            let turn = |m: Matrix3<f64>| (r * m * r.transpose()).diagonal();
            let (sigma, open) = (turn(self.block3(block.start)), turn(self.open3(block.start)));
            let value = |i: usize| (open[i] <= SHARE).then(|| sigma[i].max(0.0).sqrt() * 1e-3);
            return [value(0), value(1), value(2), Some(0.0), Some(0.0), Some(0.0)];
        }
        let mut turn = Matrix6::zeros();
        turn.fixed_view_mut::<3, 3>(0, 0).copy_from(&r);
        turn.fixed_view_mut::<3, 3>(3, 3).copy_from(&r);
        let rotated = |m: Matrix6<f64>| (turn * m * turn.transpose()).diagonal();
        let sigma = rotated(self.matrix.fixed_view::<6, 6>(block.start, block.start).into_owned());
        let open = rotated(self.open_block::<6>(block.start));
        std::array::from_fn(|i| (open[i] <= SHARE).then(|| sigma[i].max(0.0).sqrt() * 1e-3))
    }

    /// Standard deviation of one column in natural units; `None` if it is undetermined.
    #[must_use]
    pub fn column_sigma(&self, column: usize) -> Option<f64> {
        let open: f64 = self.open.iter().map(|v| v[column] * v[column]).sum();
        (open <= SHARE).then(|| self.matrix[(column, column)].max(0.0).sqrt() * self.units[column])
    }

    fn block3(&self, start: usize) -> Matrix3<f64> {
        self.matrix.fixed_view::<3, 3>(start, start).into_owned()
    }

    fn open3(&self, start: usize) -> Matrix3<f64> {
        self.open_block::<3>(start)
    }

    fn open_block<const N: usize>(&self, start: usize) -> nalgebra::SMatrix<f64, N, N> {
        nalgebra::SMatrix::from_fn(|i, j| self.open.iter().map(|v| v[start + i] * v[start + j]).sum())
    }
}
