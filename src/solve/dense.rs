//! A symmetric positive definite system solved by faer's dense Cholesky.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::{factor, solve};
use faer::{Conj, Mat, Par};

use super::refined::Refined;

/// Room for solving systems of one size again and again.
pub(super) struct Dense {
    /// The matrix with unit diagonal, and its lower Cholesky factor.
    scaled: Mat<f64>,
    lower: Mat<f64>,
    refined: Refined,
    factor_memory: MemBuffer,
    solve_memory: MemBuffer,
}

impl Dense {
    pub(super) fn new(n: usize) -> Self {
        Self {
            scaled: Mat::zeros(n, n),
            lower: Mat::zeros(n, n),
            refined: Refined::new(n),
            factor_memory: MemBuffer::new(factor::cholesky_in_place_scratch::<f64>(n, Par::Seq, Default::default())),
            solve_memory: MemBuffer::new(solve::solve_in_place_scratch::<f64>(n, 1, Par::Seq)),
        }
    }

    /// Solves for the matrix (row-major, both triangles), sequentially so that the bits never change, with one refinement. `None`, and nothing else, if the
    /// matrix is not positive definite or the solution does not satisfy it.
    pub(super) fn solve(&mut self, matrix: &[f64], right: &[f64]) -> Option<&Mat<f64>> {
        let Self { scaled, lower, refined, factor_memory, solve_memory } = self;
        let n = right.len();
        let scale = refined.scale((0..n).map(|i| matrix[i * n + i]))?;
        for j in 0..n {
            for i in 0..n {
                scaled[(i, j)] = matrix[j * n + i] * scale[i] * scale[j];
            }
        }
        lower.copy_from(&*scaled);
        let memory = MemStack::new(factor_memory);
        factor::cholesky_in_place(lower.as_mut(), Default::default(), Par::Seq, memory, Default::default()).ok()?;
        refined.solve(
            right,
            |b| {
                let memory = MemStack::new(solve_memory);
                solve::solve_in_place_with_conj(lower.as_ref(), Conj::No, b, Par::Seq, memory);
            },
            |x, rest| {
                for (j, x) in x.iter().enumerate() {
                    for (i, rest) in rest.iter_mut().enumerate() {
                        *rest -= scaled[(i, j)] * x;
                    }
                }
            },
        )
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
