//! A symmetric positive definite system solved by faer's dense Cholesky.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::{factor, solve};
use faer::{Conj, Mat, Par};

/// How much of the right-hand side may be left over after one refinement, in the largest entry. Rounding leaves 1e-15 times the condition number.
pub(super) const LEFT_OVER: f64 = 1e-6;

/// Room for solving systems of one size again and again.
pub(super) struct Dense {
    /// The matrix with unit diagonal, and its lower Cholesky factor.
    scaled: Mat<f64>,
    lower: Mat<f64>,
    /// One over the root of the diagonal: the columns carry metres, radians and pixels.
    scale: Vec<f64>,
    target: Mat<f64>,
    x: Mat<f64>,
    rest: Mat<f64>,
    factor_memory: MemBuffer,
    solve_memory: MemBuffer,
}

impl Dense {
    pub(super) fn new(n: usize) -> Self {
        let column = || Mat::zeros(n, 1);
        Self {
            scaled: Mat::zeros(n, n),
            lower: Mat::zeros(n, n),
            scale: vec![0.0; n],
            target: column(),
            x: column(),
            rest: column(),
            factor_memory: MemBuffer::new(factor::cholesky_in_place_scratch::<f64>(n, Par::Seq, Default::default())),
            solve_memory: MemBuffer::new(solve::solve_in_place_scratch::<f64>(n, 1, Par::Seq)),
        }
    }

    /// Solves for the matrix (row-major, both triangles), sequentially so that the bits never change, with one refinement. `None`, and nothing else, if the
    /// matrix is not positive definite or the solution does not satisfy it.
    pub(super) fn solve(&mut self, matrix: &[f64], right: &[f64]) -> Option<&Mat<f64>> {
        let n = right.len();
        for i in 0..n {
            let d = matrix[i * n + i];
            if !(d.is_finite() && d > 0.0) {
                return None;
            }
            self.scale[i] = 1.0 / d.sqrt();
        }
        for j in 0..n {
            for i in 0..n {
                self.scaled[(i, j)] = matrix[j * n + i] * self.scale[i] * self.scale[j];
            }
            self.target[(j, 0)] = right[j] * self.scale[j];
        }
        self.lower.copy_from(&self.scaled);
        let memory = MemStack::new(&mut self.factor_memory);
        factor::cholesky_in_place(self.lower.as_mut(), Default::default(), Par::Seq, memory, Default::default())
            .ok()?;
        self.x.copy_from(&self.target);
        self.back(true);
        self.leave_over();
        self.back(false);
        for i in 0..n {
            self.x[(i, 0)] += self.rest[(i, 0)];
        }
        self.leave_over();
        let size = |m: &Mat<f64>| (0..n).map(|i| m[(i, 0)].abs()).fold(0.0, f64::max);
        let good = size(&self.rest) <= LEFT_OVER * (size(&self.target) + f64::MIN_POSITIVE);
        for i in 0..n {
            self.x[(i, 0)] *= self.scale[i];
        }
        (good && (0..n).all(|i| self.x[(i, 0)].is_finite())).then_some(&self.x)
    }

    /// Substitutes into the solution or into what is left over.
    fn back(&mut self, solution: bool) {
        let b = if solution { self.x.as_mut() } else { self.rest.as_mut() };
        let memory = MemStack::new(&mut self.solve_memory);
        solve::solve_in_place_with_conj(self.lower.as_ref(), Conj::No, b, Par::Seq, memory);
    }

    /// `rest = target - scaled x`.
    fn leave_over(&mut self) {
        self.rest.copy_from(&self.target);
        let n = self.scale.len();
        for j in 0..n {
            let x = self.x[(j, 0)];
            for i in 0..n {
                self.rest[(i, 0)] -= self.scaled[(i, j)] * x;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hilbert_matrix_is_solved_or_refused_but_never_wrong() {
        for n in [1, 4, 8, 13, 30] {
            let matrix: Vec<f64> = (0..n * n).map(|k| 1.0 / ((k / n + k % n + 1) as f64)).collect();
            let right = vec![1.0; n];
            let mut dense = Dense::new(n);
            let solved = dense.solve(&matrix, &right).map(|x| (0..n).map(|i| x[(i, 0)]).collect::<Vec<_>>());
            assert_eq!(solved.is_some(), n < 20, "{n}");
            let Some(x) = solved else { continue };
            for i in 0..n {
                let sum: f64 = (0..n).map(|j| matrix[i * n + j] * x[j]).sum();
                assert!((sum - 1.0).abs() < 1e-5, "{n}: {sum}");
            }
        }
    }

    #[test]
    fn what_is_not_positive_definite_is_refused() {
        for matrix in
            [[1.0, 2.0, 2.0, 1.0], [0.0, 0.0, 0.0, 1.0], [-1.0, 0.0, 0.0, 1.0], [1.0, f64::NAN, f64::NAN, 1.0]]
        {
            assert!(Dense::new(2).solve(&matrix, &[1.0, 1.0]).is_none(), "{matrix:?}");
        }
        let infinite = [f64::INFINITY, 0.0];
        assert!(Dense::new(2).solve(&[1.0, 0.0, 0.0, 1.0], &infinite).is_none());
    }
}
