//! From a condensed block to its path's unknowns.

use pulp::{Simd, WithSimd};

use super::kernels::Condensed;

/// The task of adding `[B 0; 0 S]^T M [B 0; 0 S]` to a compact matrix, where `B` (6 x columns) is the chain Jacobian and `S` picks the active lens
/// parameters. Written so that the compiler can use whatever registers it is dispatched to.
pub(super) struct Expand<'a> {
    pub(super) condensed: &'a Condensed,
    pub(super) jacobian: &'a [[f64; 6]],
    pub(super) lens: &'a [usize],
    /// Room for the first six rows of `M [B 0; 0 S]`.
    pub(super) product: &'a mut Vec<f64>,
    pub(super) out: &'a mut [f64],
}

impl WithSimd for Expand<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { condensed, jacobian, lens, product, out } = self;
        let m = &condensed.matrix;
        let (k, last) = (jacobian.len(), condensed.size - 1);
        let width = k + lens.len() + 1;
        product.resize(6 * width, 0.0);
        let twist: [[f64; 6]; 6] = std::array::from_fn(|i| std::array::from_fn(|j| m[i.min(j)][i.max(j)]));
        for (c, b) in jacobian.iter().enumerate() {
            let mut column = [0.0; 6];
            for (row, b) in twist.iter().zip(b) {
                for (entry, value) in column.iter_mut().zip(row) {
                    *entry += value * b;
                }
            }
            for (i, value) in column.into_iter().enumerate() {
                product[i * width + c] = value;
            }
        }
        for (i, row) in product.chunks_exact_mut(width).enumerate() {
            for (entry, place) in row[k..].iter_mut().zip(lens.iter().map(|place| 6 + place).chain([last])) {
                *entry = m[i][place];
            }
        }
        for (i, b) in jacobian.iter().enumerate() {
            let n = width - i;
            let row = &mut out[i * width + i..][..n];
            let p: [&[f64]; 6] = std::array::from_fn(|a| &product[a * width + i..][..n]);
            for j in 0..n {
                let first = b[0] * p[0][j] + b[1] * p[1][j] + b[2] * p[2][j];
                row[j] += first + (b[3] * p[3][j] + b[4] * p[4][j] + b[5] * p[5][j]);
            }
        }
        for (i, &place) in lens.iter().enumerate() {
            let row = &mut out[(k + i) * width..(k + i + 1) * width];
            for (entry, other) in row[k + i..].iter_mut().zip(lens[i..].iter().map(|place| 6 + place).chain([last])) {
                *entry += m[6 + place][other];
            }
        }
    }
}
