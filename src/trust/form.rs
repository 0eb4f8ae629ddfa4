//! Quadratic forms around some columns of the covariance, for matrices that are sparse or sums of outer products.
//!
//! A sandwich needs `X^T M X` for the columns `X` of each block of unknowns: thousands of times over all rows. So the columns are kept row by row, eight to a
//! register's width: one entry of `M` is read once for all columns.

use faer::Mat;
use nalgebra::DMatrix;

use crate::solve::Pattern;

const LANES: usize = 8;

/// Sparse vectors, one after the other.
#[derive(Default)]
pub(super) struct Vectors {
    places: Vec<usize>,
    values: Vec<f64>,
    ends: Vec<usize>,
}

impl Vectors {
    /// Adds a vector with `values` at `places`.
    pub(super) fn push<'a>(&mut self, places: &[usize], values: impl Iterator<Item = &'a f64>) {
        self.places.extend_from_slice(places);
        self.values.extend(values);
        self.ends.push(self.places.len());
    }

    /// The entries of a vector.
    fn range(&self, number: usize) -> std::ops::Range<usize> {
        let start = number.checked_sub(1).map_or(0, |before| self.ends[before]);
        start..self.ends[number]
    }
}

/// Columns of a matrix, row by row.
pub(super) struct Columns {
    count: usize,
    /// Groups of [`LANES`] columns; what is left of the last is zero.
    groups: Vec<Vec<[f64; LANES]>>,
}

impl Columns {
    /// Of `n x count`.
    pub(super) fn new(columns: &Mat<f64>) -> Self {
        let count = columns.ncols();
        let group = |first: usize| {
            let mut rows = vec![[0.0; LANES]; columns.nrows()];
            for lane in 0..LANES.min(count - first) {
                for (row, value) in rows.iter_mut().zip(columns.col_as_slice(first + lane)) {
                    row[lane] = *value;
                }
            }
            rows
        };
        Self { count, groups: (0..count).step_by(LANES).map(group).collect() }
    }

    /// `X^T M X` for the symmetric `M` of these values on a pattern: `count x count`. Of `M` only some columns, and the rows that mirror them.
    pub(super) fn around(&self, pattern: &Pattern, values: &[f64], columns: &[usize]) -> DMatrix<f64> {
        let rows = pattern.rows();
        let mut half = DMatrix::zeros(self.count, self.count);
        for (right, x) in self.groups.iter().enumerate() {
            let mut sums = vec![[[0.0; LANES]; LANES]; self.groups.len()];
            for &column in columns {
                let range = pattern.range(column);
                // Half the diagonal, and what is below: with the transposed, added at the end, that is all.
                let mut product = x[column].map(|x| 0.5 * values[range.start] * x);
                for place in range.start + 1..range.end {
                    let (value, x) = (values[place], &x[rows[place]]);
                    for lane in 0..LANES {
                        product[lane] += value * x[lane];
                    }
                }
                for (sum, group) in sums.iter_mut().zip(&self.groups) {
                    outer(sum, &group[column], &product);
                }
            }
            self.put(&mut half, right, &sums);
        }
        &half + half.transpose()
    }

    /// `X^T (sum v v^T) X` over some of the vectors: `count x count`.
    pub(super) fn scatter(&self, vectors: &Vectors, numbers: &[usize]) -> DMatrix<f64> {
        let mut total = DMatrix::zeros(self.count, self.count);
        let along = |group: &[[f64; LANES]], range: std::ops::Range<usize>| {
            let mut along = [0.0; LANES];
            for (place, value) in vectors.places[range.clone()].iter().zip(&vectors.values[range]) {
                let x = &group[*place];
                for lane in 0..LANES {
                    along[lane] += value * x[lane];
                }
            }
            along
        };
        for (right, x) in self.groups.iter().enumerate() {
            let mut sums = vec![[[0.0; LANES]; LANES]; self.groups.len()];
            for range in numbers.iter().map(|number| vectors.range(*number)) {
                let own = along(x, range.clone());
                for (left, (sum, group)) in sums.iter_mut().zip(&self.groups).enumerate() {
                    let other = if left == right { own } else { along(group, range.clone()) };
                    outer(sum, &other, &own);
                }
            }
            self.put(&mut total, right, &sums);
        }
        total
    }

    /// Writes the sums of one group of columns, with each of the groups as rows.
    fn put(&self, to: &mut DMatrix<f64>, right: usize, sums: &[[[f64; LANES]; LANES]]) {
        for j in right * LANES..self.count.min((right + 1) * LANES) {
            for i in 0..self.count {
                to[(i, j)] = sums[i / LANES][i % LANES][j % LANES];
            }
        }
    }
}

/// `sum += a b^T`.
fn outer(sum: &mut [[f64; LANES]; LANES], a: &[f64; LANES], b: &[f64; LANES]) {
    for (row, a) in sum.iter_mut().zip(a) {
        for (sum, b) in row.iter_mut().zip(b) {
            *sum += a * b;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn forms_are_those_of_whole_matrices() {
        let pattern = Pattern::new(&[(0, 2), (2, 1), (3, 9)], [&[0, 2][..], &[1][..]].into_iter());
        let n = pattern.columns();
        let values: Vec<f64> = (0..pattern.places()).map(|k| (1.0 + k as f64).sin()).collect();
        let whole = DMatrix::from_fn(n, n, |i, j| pattern.place(i, j).map_or(0.0, |place| values[place]));
        let mut vectors = Vectors::default();
        let mut sum = DMatrix::zeros(n, n);
        for k in 0..5_usize {
            let places: Vec<usize> = (k..n).step_by(k + 1).collect();
            let entries: Vec<f64> = places.iter().map(|place| (*place as f64 + 0.3 * k as f64).cos()).collect();
            vectors.push(&places, entries.iter());
            let mut dense = nalgebra::DVector::zeros(n);
            places.iter().zip(&entries).for_each(|(place, value)| dense[*place] = *value);
            sum += &dense * dense.transpose();
        }
        for count in [1, 6, 8, 11, 17] {
            let x = Mat::from_fn(n, count, |i, j| ((3 * i + 7 * j) as f64).sin());
            let dense = DMatrix::from_fn(n, count, |i, j| x[(i, j)]);
            let columns = Columns::new(&x);
            let near = |a: DMatrix<f64>, b: &DMatrix<f64>| assert!((a - dense.transpose() * b * &dense).amax() < 1e-12);
            let parts = |apart: [&[usize]; 2], of: &dyn Fn(&[usize]) -> DMatrix<f64>| of(apart[0]) + of(apart[1]);
            near(
                parts([&[1, 2, 7], &[0, 3, 4, 5, 6, 8, 9, 10, 11]], &|some| columns.around(&pattern, &values, some)),
                &whole,
            );
            near(parts([&[0, 3], &[1, 2, 4]], &|some| columns.scatter(&vectors, some)), &sum);
        }
    }
}
