//! From a condensed block to its path's unknowns, and from there to the shared equations.

use super::assemble::Normal;
use super::kernels::Condensed;

/// Adds `[B 0; 0 S]^T M [B 0; 0 S]` to a compact matrix, where `B` (6 x columns) is the chain Jacobian and `S` picks the active lens parameters.
pub(super) fn expand_condensed(
    condensed: &Condensed,
    jacobian: &[[f64; 6]],
    lens: &[usize],
    product: &mut Vec<[f64; 6]>,
    out: &mut [f64],
) {
    let m = &condensed.matrix;
    let (k, last) = (jacobian.len(), condensed.size - 1);
    let width = k + lens.len() + 1;
    product.clear();
    product.extend(jacobian.iter().map(|b| {
        let mut column = [0.0; 6];
        for (i, entry) in column.iter_mut().enumerate() {
            for (j, b) in b.iter().enumerate() {
                *entry += if i <= j { m[i][j] } else { m[j][i] } * b;
            }
        }
        column
    }));
    for i in 0..k {
        let row = &mut out[i * width..(i + 1) * width];
        let b = &jacobian[i];
        for (entry, mb) in row[i..k].iter_mut().zip(&product[i..]) {
            *entry += b[0] * mb[0] + b[1] * mb[1] + b[2] * mb[2] + b[3] * mb[3] + b[4] * mb[4] + b[5] * mb[5];
        }
        for (entry, place) in row[k..].iter_mut().zip(lens.iter().map(|place| 6 + place).chain([last])) {
            for (j, b) in b.iter().enumerate() {
                *entry += b * m[j][place];
            }
        }
    }
    for (i, &place) in lens.iter().enumerate() {
        let row = &mut out[(k + i) * width..(k + i + 1) * width];
        for (entry, other) in row[k + i..].iter_mut().zip(lens[i..].iter().map(|place| 6 + place).chain([last])) {
            *entry += m[6 + place][other];
        }
    }
}

/// Adds a compact matrix (upper triangle, residual last) to the shared equations.
pub(super) fn add_compact(matrix: &[f64], width: usize, columns: &[(usize, usize, usize)], normal: &mut Normal) {
    let n = normal.gradient.len();
    for &(compact_a, shared_a, count_a) in columns {
        for a in 0..count_a {
            let (ca, sa) = (compact_a + a, shared_a + a);
            normal.gradient[sa] += matrix[ca * width + width - 1];
            for &(compact_b, shared_b, count_b) in columns {
                for b in 0..count_b {
                    let cb = compact_b + b;
                    let value = if ca <= cb { matrix[ca * width + cb] } else { matrix[cb * width + ca] };
                    normal.hessian[sa * n + shared_b + b] += value;
                }
            }
        }
    }
}
