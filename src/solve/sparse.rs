//! A sparse symmetric positive definite system solved by faer's sparse Cholesky, with an order and a symbolic factor that are found once.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::sparse::SparseColMatRef;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::{Conj, Mat, MatMut, Par, Side};
use std::sync::Arc;

use super::pattern::Pattern;
use super::refined::Refined;

/// A pattern and what factorising it takes.
#[derive(Debug)]
pub(crate) struct Symbolic {
    pub(crate) pattern: Pattern,
    factor: SymbolicCholesky<usize>,
}

impl Symbolic {
    /// Finds the order and the places of the factor; none if they do not fit this machine.
    pub(crate) fn new(pattern: Pattern) -> Option<Self> {
        let (order, parameters) = (SymmetricOrdering::Amd, CholeskySymbolicParams::default());
        let factor = factorize_symbolic_cholesky(pattern.symbolic.as_ref(), Side::Lower, order, parameters).ok()?;
        Some(Self { pattern, factor })
    }

    /// Multiplications of one factorisation: half the sum of the squared lengths of the factor's columns. Dense, that would be a sixth of the cube of the
    /// columns.
    pub(crate) fn work(&self) -> f64 {
        let square = |length: usize| 0.5 * (length as f64).powi(2);
        match self.factor.raw() {
            SymbolicCholeskyRaw::Simplicial(factor) => factor.col_ptr().windows(2).map(|w| square(w[1] - w[0])).sum(),
            SymbolicCholeskyRaw::Supernodal(factor) => (0..factor.n_supernodes())
                .map(|s| {
                    let wide = factor.supernode_end()[s] - factor.supernode_begin()[s];
                    let below = factor.col_ptr_for_row_idx()[s + 1] - factor.col_ptr_for_row_idx()[s];
                    (1..=wide).map(|own| square(own + below)).sum::<f64>()
                })
                .sum(),
        }
    }
}

/// A numeric factor.
pub(crate) struct Factor {
    symbolic: Arc<Symbolic>,
    lower: Vec<f64>,
    memory: MemBuffer,
}

impl Factor {
    /// Room for a factor.
    pub(crate) fn new(symbolic: &Arc<Symbolic>) -> Self {
        let factor = &symbolic.factor;
        Self {
            lower: vec![0.0; factor.len_val()],
            memory: MemBuffer::new(factor.factorize_numeric_llt_scratch::<f64>(Par::Seq, Default::default())),
            symbolic: Arc::clone(symbolic),
        }
    }

    /// Factorises the matrix of these values; false if it is not positive definite.
    pub(crate) fn factorise(&mut self, values: &[f64]) -> bool {
        let matrix = SparseColMatRef::new(self.symbolic.pattern.symbolic.as_ref(), values);
        let (none, memory) = (LltRegularization::default(), MemStack::new(&mut self.memory));
        let factor = &self.symbolic.factor;
        factor
            .factorize_numeric_llt(&mut self.lower, matrix, Side::Lower, none, Par::Seq, memory, Default::default())
            .is_ok()
    }

    /// Room for solving so many right-hand sides at once.
    pub(crate) fn room(&self, right: usize) -> MemBuffer {
        MemBuffer::new(self.symbolic.factor.solve_in_place_scratch::<f64>(right, Par::Seq))
    }

    /// Solves with the last factor, in place.
    pub(crate) fn solve(&self, right: MatMut<'_, f64>, room: &mut MemBuffer) {
        let factor = LltRef::new(&self.symbolic.factor, &self.lower);
        factor.solve_in_place_with_conj(Conj::No, right, Par::Seq, MemStack::new(room));
    }
}

/// Room for solving systems of one pattern again and again.
pub(super) struct Sparse {
    symbolic: Arc<Symbolic>,
    /// The values with unit diagonal.
    scaled: Vec<f64>,
    factor: Factor,
    room: MemBuffer,
    refined: Refined,
}

impl Sparse {
    pub(super) fn new(symbolic: &Arc<Symbolic>) -> Self {
        let factor = Factor::new(symbolic);
        Self {
            scaled: vec![0.0; symbolic.pattern.places()],
            room: factor.room(1),
            factor,
            refined: Refined::new(symbolic.pattern.columns()),
            symbolic: Arc::clone(symbolic),
        }
    }

    /// As [`super::dense::Dense::solve`], for the values of the pattern.
    pub(super) fn solve(&mut self, values: &[f64], right: &[f64]) -> Option<&Mat<f64>> {
        let Self { symbolic, scaled, factor, room, refined } = self;
        let pattern = &symbolic.pattern;
        let columns = pattern.columns();
        let scale = refined.scale((0..columns).map(|column| values[pattern.range(column).start]))?;
        for column in 0..columns {
            for place in pattern.range(column) {
                scaled[place] = values[place] * scale[pattern.rows()[place]] * scale[column];
            }
        }
        if !factor.factorise(scaled) {
            return None;
        }
        refined.solve(right, |b| factor.solve(b, room), |x, rest| pattern.multiply(scaled, -1.0, x, rest))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Blocks of two that all hang on the last.
    fn arrow(blocks: usize) -> Arc<Symbolic> {
        let places: Vec<(usize, usize)> = (0..blocks).map(|i| (2 * i, 2)).collect();
        let pairs: Vec<[usize; 2]> = (0..blocks - 1).map(|i| [i, blocks - 1]).collect();
        let pattern = Pattern::new(&places, pairs.iter().map(|pair| &pair[..]));
        Arc::new(Symbolic::new(pattern).unwrap())
    }

    fn values(symbolic: &Symbolic, of: impl Fn(usize, usize) -> f64) -> Vec<f64> {
        let pattern = &symbolic.pattern;
        (0..pattern.columns())
            .flat_map(|column| pattern.range(column).map(move |place| (pattern.rows()[place], column)))
            .map(|(row, column)| of(row, column))
            .collect()
    }

    #[test]
    fn an_arrow_costs_what_it_has_and_solves_like_a_dense_matrix() {
        for blocks in [2, 7, 400] {
            let symbolic = arrow(blocks);
            let n = 2 * blocks;
            assert!(symbolic.work() < 0.5 * 16.0 * n as f64, "{}", symbolic.work());
            let value =
                |i: usize, j: usize| if i == j { 3.0 + n as f64 * 0.1 * (i >= n - 2) as u8 as f64 } else { 0.1 };
            let values = values(&symbolic, value);
            let right: Vec<f64> = (0..n).map(|i| (i as f64).sin()).collect();
            let mut sparse = Sparse::new(&symbolic);
            let found: Vec<f64> = sparse.solve(&values, &right).map(|x| (0..n).map(|i| x[(i, 0)]).collect()).unwrap();
            let whole: Vec<f64> =
                (0..n * n).map(|k| symbolic.pattern.place(k / n, k % n).map_or(0.0, |place| values[place])).collect();
            let mut dense = super::super::dense::Dense::new(n);
            let expected = dense.solve(&whole, &right).unwrap();
            for (i, x) in found.iter().enumerate() {
                assert!((x - expected[(i, 0)]).abs() < 1e-14, "{blocks} {i}");
            }
        }
    }

    #[test]
    fn what_is_not_positive_definite_is_refused() {
        let symbolic = arrow(3);
        let solve = |of: &dyn Fn(usize, usize) -> f64, right: f64| {
            Sparse::new(&symbolic).solve(&values(&symbolic, of), &[right; 6]).is_some()
        };
        let unit = |i: usize, j: usize| f64::from(u8::from(i == j));
        assert!(solve(&unit, 1.0));
        // Diagonals that are zero, negative or no number; a pivot that turns negative; a right-hand side without an answer.
        assert!(!solve(&|i, j| if i == 3 { 0.0 } else { unit(i, j) }, 1.0));
        assert!(!solve(&|i, j| if i == 3 { -unit(i, j) } else { unit(i, j) }, 1.0));
        assert!(!solve(&|i, j| if i == 5 { f64::NAN } else { unit(i, j) }, 1.0));
        assert!(!solve(&|i, j| if i == j { 1.0 } else { 2.0 }, 1.0));
        assert!(!solve(&unit, f64::INFINITY));
    }

    #[test]
    fn a_singular_matrix_is_refused_or_solved_but_never_wrong() {
        // One block of two that hangs on another: a Hilbert matrix is worse than the digits can hold, and what is left over says so.
        for blocks in [2, 4, 8] {
            let all: Vec<usize> = (0..blocks).collect();
            let places: Vec<(usize, usize)> = (0..blocks).map(|i| (2 * i, 2)).collect();
            let pattern = Pattern::new(&places, std::iter::once(&all[..]));
            let symbolic = Arc::new(Symbolic::new(pattern).unwrap());
            let n = 2 * blocks;
            let values = values(&symbolic, |i, j| 1.0 / ((i + j + 1) as f64));
            let mut sparse = Sparse::new(&symbolic);
            let solved = sparse.solve(&values, &vec![1.0; n]).map(|x| (0..n).map(|i| x[(i, 0)]).collect::<Vec<_>>());
            let Some(x) = solved else { continue };
            let mut left = vec![1.0; n];
            symbolic.pattern.multiply(&values, -1.0, &x, &mut left);
            assert!(left.iter().all(|x| x.abs() < 1e-5), "{n}: {left:?}");
        }
    }
}
