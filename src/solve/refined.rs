//! What dense and sparse solvers share: a unit diagonal, one refinement, and a check that the answer solves the equations.

use faer::{Mat, MatMut};

/// How much of the right-hand side may be left over after one refinement, in the largest entry. Rounding leaves 1e-15 times the condition number.
const LEFT_OVER: f64 = 1e-6;

/// Vectors of one size.
pub(super) struct Refined {
    /// One over the root of the diagonal: the columns carry metres, radians and pixels.
    scale: Vec<f64>,
    target: Mat<f64>,
    x: Mat<f64>,
    rest: Mat<f64>,
}

impl Refined {
    pub(super) fn new(n: usize) -> Self {
        let column = || Mat::zeros(n, 1);
        Self { scale: vec![0.0; n], target: column(), x: column(), rest: column() }
    }

    /// What rows and columns are to be multiplied by; none if an entry of the diagonal is not positive.
    pub(super) fn scale(&mut self, diagonal: impl Iterator<Item = f64>) -> Option<&[f64]> {
        for (scale, d) in self.scale.iter_mut().zip(diagonal) {
            if !(d.is_finite() && d > 0.0) {
                return None;
            }
            *scale = 1.0 / d.sqrt();
        }
        Some(&self.scale)
    }

    /// Solves with one refinement. `back` substitutes into a factor of the scaled matrix, in place; `subtract` takes the scaled matrix times its first vector from its
    /// second. `None` if the solution does not satisfy the equations.
    pub(super) fn solve(
        &mut self,
        right: &[f64],
        mut back: impl FnMut(MatMut<'_, f64>),
        mut subtract: impl FnMut(&[f64], &mut [f64]),
    ) -> Option<&Mat<f64>> {
        let Self { scale, target, x, rest } = self;
        let n = scale.len();
        for i in 0..n {
            target[(i, 0)] = right[i] * scale[i];
        }
        x.copy_from(&*target);
        back(x.as_mut());
        let mut leave_over = |x: &Mat<f64>, rest: &mut Mat<f64>| {
            rest.copy_from(&*target);
            subtract(x.col_as_slice(0), rest.col_as_slice_mut(0));
        };
        leave_over(x, rest);
        back(rest.as_mut());
        for i in 0..n {
            x[(i, 0)] += rest[(i, 0)];
        }
        leave_over(x, rest);
        let size = |m: &Mat<f64>| (0..n).map(|i| m[(i, 0)].abs()).fold(0.0, f64::max);
        let good = size(rest) <= LEFT_OVER * (size(target) + f64::MIN_POSITIVE);
        for i in 0..n {
            x[(i, 0)] *= scale[i];
        }
        (good && (0..n).all(|i| x[(i, 0)].is_finite())).then_some(&*x)
    }
}
