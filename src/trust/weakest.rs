//! The directions that a large sparse information matrix says least about, without an eigen-analysis of all of it.
//!
//! `H - t I` is positive definite exactly if every eigenvalue exceeds `t`: one Cholesky factorisation says that there is nothing to look for. Otherwise the
//! smallest eigenvalues are found by subspace iteration with `(H + s I)^-1` and Rayleigh-Ritz (Golub and Van Loan, *Matrix Computations*, 8.2.4); the block is
//! enlarged until it also holds one that exceeds the threshold.

use faer::Mat;
use nalgebra::DMatrix;
use std::sync::Arc;

use crate::solve::{Factor, Symbolic};

/// Vectors in the first block, and the most that are looked for: who has more open directions has seen the first of them.
const FIRST: usize = 12;
const MOST: usize = 200;
/// Rounds of the iteration at most, and the change of an eigenvalue (relative to the threshold) that is none.
const ROUNDS: usize = 60;
const SETTLED: f64 = 1e-6;
/// Rounds without a change before it is believed: vectors settle later than values.
const CALM: usize = 4;
/// The same for an eigenvalue well above the threshold, of which no more is asked than that it is there.
const ROUGHLY: f64 = 0.1;

/// A direction and its eigenvalue.
pub(super) type Direction = (Vec<f64>, f64);

/// What has to be added to the diagonal for a factor of a matrix that may be singular: as much as rounding would, or `least`.
pub(super) fn shifted(symbolic: &Arc<Symbolic>, values: &[f64], least: f64) -> Option<(Factor, f64)> {
    let mut shift = least.max(1e-14 * largest_diagonal(symbolic, values));
    for _ in 0..8 {
        if let Some(factor) = factor(symbolic, values, shift) {
            return Some((factor, shift));
        }
        shift *= 10.0;
    }
    None
}

/// The factor of a matrix with `shift` more on its diagonal; none if that is not positive definite.
pub(super) fn factor(symbolic: &Arc<Symbolic>, values: &[f64], shift: f64) -> Option<Factor> {
    let mut values = values.to_vec();
    for column in 0..symbolic.pattern.columns() {
        values[symbolic.pattern.range(column).start] += shift;
    }
    let mut factor = Factor::new(symbolic);
    factor.factorise(&values).then_some(factor)
}

fn largest_diagonal(symbolic: &Symbolic, values: &[f64]) -> f64 {
    let pattern = &symbolic.pattern;
    (0..pattern.columns()).map(|column| values[pattern.range(column).start]).fold(0.0, f64::max)
}

/// All directions with eigenvalues below `threshold`, smallest first (at most [`MOST`]). The directions are orthonormal.
pub(super) fn weakest(symbolic: &Arc<Symbolic>, values: &[f64], threshold: f64) -> Vec<Direction> {
    let n = symbolic.pattern.columns();
    if n == 0 || factor(symbolic, values, -threshold).is_some() {
        return Vec::new();
    }
    let Some((factor, _)) = shifted(symbolic, values, 1e-3 * threshold) else { return Vec::new() };
    let mut size = FIRST.min(n);
    loop {
        let (values, basis) = smallest(symbolic, values, &factor, size, threshold);
        let below = values.iter().filter(|value| **value < threshold).count();
        if below < size || size == n || size >= MOST {
            let column = |i: usize| (0..n).map(|row| basis[(row, i)]).collect();
            return (0..below).map(|i| (column(i), values[i])).collect();
        }
        size = (2 * size).min(n).min(MOST);
    }
}

/// The `size` smallest eigenvalues and their vectors.
fn smallest(symbolic: &Symbolic, values: &[f64], factor: &Factor, size: usize, threshold: f64) -> (Vec<f64>, Mat<f64>) {
    let n = symbolic.pattern.columns();
    // Any start will do that no structure of the problem is blind to; the same one each time.
    let mut block = Mat::from_fn(n, size, |i, j| (1.0 + (i * size + j) as f64).powi(2).sin());
    let mut room = factor.room(size);
    let mut found: Vec<f64> = vec![f64::INFINITY; size];
    let mut calm = 0;
    for round in 1..=ROUNDS {
        let basis = block.qr().compute_thin_Q();
        let mut products = Mat::zeros(n, size);
        for j in 0..size {
            symbolic.pattern.multiply(values, 1.0, basis.col_as_slice(j), products.col_as_slice_mut(j));
        }
        let small = basis.transpose() * &products;
        let eigen = DMatrix::from_fn(size, size, |i, j| 0.5 * (small[(i, j)] + small[(j, i)])).symmetric_eigen();
        let mut order: Vec<usize> = (0..size).collect();
        order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
        let turn = Mat::from_fn(size, size, |i, j| eigen.eigenvectors[(i, order[j])]);
        block = &basis * &turn;
        let now: Vec<f64> = order.iter().map(|i| eigen.eigenvalues[*i]).collect();
        let settled = now.iter().zip(&found).all(|(now, before)| {
            let within = if *now > 2.0 * threshold { ROUGHLY } else { SETTLED };
            (now - before).abs() <= within * (threshold + now.abs())
        });
        found = now;
        calm = if settled { calm + 1 } else { 0 };
        if calm == CALM || round == ROUNDS {
            break;
        }
        factor.solve(block.as_mut(), &mut room);
    }
    (found, block)
}
