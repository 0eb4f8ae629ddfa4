//! From a condensed block to its path's unknowns.

use pulp::{Simd, WithSimd};

use super::kernels::Condensed;
use super::lanes::Lanes;
use super::lines::{in_lines, room_in_lines};

/// Numbers in the largest register of any machine.
const WIDEST_REGISTER: usize = 8;

/// The task of adding `[B 0; 0 S]^T M [B 0; 0 S]` to a compact matrix, where `B` (6 x columns) is the chain Jacobian and `S` picks the active lens
/// parameters. Whole registers are added, so that what is left below the diagonal is no matter.
pub(super) struct Expand<'a> {
    pub(super) condensed: &'a Condensed,
    pub(super) jacobian: &'a [[f64; 6]],
    pub(super) lens: &'a [usize],
    /// Room for `B` and the first six rows of `M [B 0; 0 S]`, row by row in whole registers.
    pub(super) room: &'a mut Vec<f64>,
    pub(super) out: &'a mut [f64],
}

impl Expand<'_> {
    /// Numbers in `room` at most for a compact matrix of so many columns, on any machine.
    pub(super) fn room(width: usize) -> usize {
        room_in_lines(12 * width.next_multiple_of(WIDEST_REGISTER))
    }
}

impl WithSimd for Expand<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { condensed, jacobian, lens, room, out } = self;
        let (m, lanes) = (&condensed.matrix, Lanes::<S>::COUNT);
        let (k, last) = (jacobian.len(), condensed.size - 1);
        let width = k + lens.len() + 1;
        let stride = width.next_multiple_of(lanes);
        room.clear();
        let (across, product) = in_lines(room, 12 * stride).split_at_mut(6 * stride);
        for (c, b) in jacobian.iter().enumerate() {
            b.iter().enumerate().for_each(|(i, value)| across[i * stride + c] = *value);
        }
        for (i, row) in product.chunks_exact_mut(stride).enumerate() {
            let twist = std::array::from_fn(|j| m[i.min(j)][i.max(j)]);
            for register in 0..k.div_ceil(lanes) {
                Lanes::sum_of_six(simd, &twist, across, stride, register).store(&mut row[register * lanes..]);
            }
            for (entry, place) in row[k..].iter_mut().zip(lens.iter().map(|place| 6 + place).chain([last])) {
                *entry = m[i][place];
            }
        }
        for (b, (i, row)) in jacobian.iter().zip(out.chunks_exact_mut(width).enumerate()) {
            for register in i / lanes..stride / lanes {
                Lanes::sum_of_six(simd, b, product, stride, register).add_to(&mut row[register * lanes..]);
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
