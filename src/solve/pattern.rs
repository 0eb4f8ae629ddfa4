//! Where the shared equations can have entries: the lower triangle of a sparse symmetric matrix, column by column.

use faer::sparse::SymbolicSparseColMat;
use std::collections::BTreeSet;

/// The places of a sparse symmetric matrix, its lower triangle in compressed columns. Every block of unknowns is whole, so that neighbouring rows are
/// neighbours in memory, and every column begins with its diagonal.
#[derive(Clone, Debug)]
pub(crate) struct Pattern {
    /// For faer, which checks it once.
    pub(super) symbolic: SymbolicSparseColMat<usize>,
}

impl Pattern {
    /// The pattern of a sum of matrices that each fill all pairs among some blocks. `blocks` has the first column and the number of columns of each,
    /// in order and without gaps; `cliques` numbers of blocks.
    pub(crate) fn new<'a>(blocks: &[(usize, usize)], cliques: impl Iterator<Item = &'a [usize]>) -> Self {
        let mut below: Vec<BTreeSet<usize>> = (0..blocks.len()).map(|block| BTreeSet::from([block])).collect();
        for clique in cliques {
            for &a in clique {
                below[a].extend(clique.iter().filter(|b| **b > a));
            }
        }
        let (mut starts, mut rows) = (vec![0], Vec::new());
        for (&(first, count), below) in blocks.iter().zip(&below) {
            for column in first..first + count {
                rows.extend(column..first + count);
                for &other in below.iter().skip(1) {
                    rows.extend(blocks[other].0..blocks[other].0 + blocks[other].1);
                }
                starts.push(rows.len());
            }
        }
        let n = starts.len() - 1;
        Self { symbolic: SymbolicSparseColMat::new_checked(n, n, starts, None, rows) }
    }

    /// The number of columns.
    pub(crate) fn columns(&self) -> usize {
        self.symbolic.ncols()
    }

    /// The number of places.
    pub(crate) fn places(&self) -> usize {
        self.symbolic.row_idx().len()
    }

    /// The places of a column, first its diagonal's.
    pub(crate) fn range(&self, column: usize) -> std::ops::Range<usize> {
        self.symbolic.col_ptr()[column]..self.symbolic.col_ptr()[column + 1]
    }

    /// The rows of all places.
    pub(crate) fn rows(&self) -> &[usize] {
        self.symbolic.row_idx()
    }

    /// The place of an entry and its mirror image, if there is one.
    pub(crate) fn place(&self, i: usize, j: usize) -> Option<usize> {
        let range = self.range(i.min(j));
        let at = self.rows()[range.clone()].binary_search(&i.max(j)).ok()?;
        Some(range.start + at)
    }

    /// Adds the upper triangle of a compact matrix (row-major, `stride` entries a row), whose column `i` is column `columns[i]`, to the values of this pattern.
    /// What lies outside the pattern is left out: it is zero.
    pub(super) fn add_upper(&self, values: &mut [f64], columns: &[usize], matrix: &[f64], stride: usize, sign: f64) {
        let rows = self.rows();
        for (i, (&a, row)) in columns.iter().zip(matrix.chunks_exact(stride)).enumerate() {
            // Mostly the next entry is the next place.
            let mut next = None;
            for (&b, value) in columns[i..].iter().zip(&row[i..]) {
                let place = match next {
                    Some(next) if b > a && next < self.range(a).end && rows[next] == b => Some(next),
                    _ => self.place(a, b),
                };
                if let Some(place) = place {
                    values[place] += sign * value;
                }
                debug_assert!(place.is_some() || *value == 0.0, "an entry of ({a}, {b}) has no place");
                next = place.filter(|_| b >= a).map(|place| place + 1);
            }
        }
    }

    /// `out += sign * matrix * x` for the symmetric matrix of these values.
    pub(crate) fn multiply(&self, values: &[f64], sign: f64, x: &[f64], out: &mut [f64]) {
        let rows = self.rows();
        for column in 0..self.columns() {
            let range = self.range(column);
            let with = sign * x[column];
            let mut sum = values[range.start] * with;
            for place in range.start + 1..range.end {
                out[rows[place]] += values[place] * with;
                sum += sign * values[place] * x[rows[place]];
            }
            out[column] += sum;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_find_their_places() {
        let pattern = Pattern::new(&[(0, 2), (2, 1), (3, 2)], [&[0, 2][..], &[1][..]].into_iter());
        assert_eq!((pattern.columns(), pattern.places()), (5, 3 + 1 + 3 + 4));
        assert!(pattern.place(0, 2).is_none() && pattern.place(4, 2).is_none());
        // Block 2 before block 0, as a path may meet them.
        let (columns, stride) = ([3, 4, 0, 1], 5);
        let matrix: Vec<f64> = (0..4 * stride).map(|k| k as f64).collect();
        let mut values = vec![0.0; pattern.places()];
        pattern.add_upper(&mut values, &columns, &matrix, stride, 2.0);
        for (i, &a) in columns.iter().enumerate() {
            for (j, &b) in columns.iter().enumerate().skip(i) {
                assert_eq!(values[pattern.place(a, b).unwrap()], 2.0 * matrix[i * stride + j], "{a} {b}");
            }
        }
        assert_eq!(values[pattern.place(2, 2).unwrap()], 0.0);
        let x = [1.0, -2.0, 5.0, 0.5, 3.0];
        let mut out = [1.0; 5];
        pattern.multiply(&values, -1.0, &x, &mut out);
        for i in 0..5 {
            let sum: f64 = (0..5).filter_map(|j| Some(values[pattern.place(i, j)?] * x[j])).sum();
            assert!((out[i] - (1.0 - sum)).abs() < 1e-12, "{i}");
        }
    }
}
