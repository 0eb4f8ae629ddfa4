//! A space of directions: taking known directions out of it, and the basis with the fewest entries.

use nalgebra::DVector;

/// A known direction belongs to a space that holds this share of its square.
const HELD: f64 = 0.98;
/// What is left of a known direction once others have been taken out, below which it says nothing new.
const NEW: f64 = 0.1;

/// An orthonormal basis, with a standard deviation along each vector.
#[derive(Clone, Debug, Default)]
pub(super) struct Span {
    vectors: Vec<Vec<f64>>,
    /// The whole space as it was, by which standard deviations are judged.
    original: Vec<Vec<f64>>,
    sigmas: Vec<f64>,
    taken: Vec<Vec<f64>>,
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn normalised(v: Vec<f64>) -> Option<Vec<f64>> {
    let length = dot(&v, &v).sqrt();
    (length > 1e-9).then(|| v.iter().map(|x| x / length).collect())
}

fn without(v: &[f64], direction: &[f64]) -> Vec<f64> {
    let along = dot(v, direction);
    v.iter().zip(direction).map(|(x, d)| x - along * d).collect()
}

impl Span {
    pub(super) fn new(vectors: &[Vec<f64>], sigmas: &[f64]) -> Self {
        Self { vectors: vectors.to_vec(), original: vectors.to_vec(), sigmas: sigmas.to_vec(), taken: Vec::new() }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.vectors.is_empty()
    }

    pub(super) fn vectors(&self) -> &[Vec<f64>] {
        &self.vectors
    }

    /// The standard deviation along a unit vector of the space; infinite if nothing at all is known of it.
    pub(super) fn sigma(&self, direction: &[f64]) -> f64 {
        let one = |(vector, sigma): (&Vec<f64>, &f64)| {
            let share = dot(vector, direction).powi(2);
            // Rounding alone must not bring an infinity in.
            if share < 1e-12 { 0.0 } else { share * sigma * sigma }
        };
        self.original.iter().zip(&self.sigmas).map(one).sum::<f64>().sqrt()
    }

    /// Takes a known direction out of the space. Returns it as it lies there, with its standard deviation; none if the space does not hold it.
    pub(super) fn take(&mut self, known: &[f64]) -> Option<(Vec<f64>, f64)> {
        let before = dot(known, known).sqrt();
        let mut rest = known.to_vec();
        for taken in &self.taken {
            rest = without(&rest, taken);
        }
        if self.vectors.is_empty() || dot(&rest, &rest).sqrt() < NEW * before {
            return None;
        }
        let rest = normalised(rest)?;
        let mut held = vec![0.0; rest.len()];
        for vector in &self.vectors {
            let along = dot(vector, &rest);
            held.iter_mut().zip(vector).for_each(|(h, v)| *h += along * v);
        }
        if dot(&held, &held) < HELD {
            return None;
        }
        let held = normalised(held)?;
        let mut left: Vec<Vec<f64>> = Vec::new();
        for vector in &self.vectors {
            let mut vector = without(vector, &held);
            for known in &left {
                vector = without(&vector, known);
            }
            if dot(&vector, &vector) > 1e-8 {
                left.extend(normalised(vector));
            }
        }
        // One dimension has gone, whatever rounding says.
        left.truncate(self.vectors.len() - 1);
        self.vectors = left;
        self.taken.push(held.clone());
        // Told as theory has it: the part that the data show is the same within rounding, and theory's has clean zeros.
        let told = normalised(known.to_vec())?;
        let sigma = self.sigma(&held);
        Some((told, sigma))
    }
}

/// A basis of the same space in reduced echelon form, largest pivots first, each vector of length one.
pub(super) fn sparse_basis(vectors: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let mut rows: Vec<DVector<f64>> = vectors.iter().map(|v| DVector::from_column_slice(v)).collect();
    let mut used: Vec<usize> = Vec::new();
    for turn in 0..rows.len() {
        let mut best = (turn, 0, 0.0);
        for (r, row) in rows.iter().enumerate().skip(turn) {
            for (c, x) in row.iter().enumerate().filter(|(c, _)| !used.contains(c)) {
                // Among equals the first, so that rounding does not choose.
                if x.abs() > best.2 + 1e-6 {
                    best = (r, c, x.abs());
                }
            }
        }
        let (row, column, size) = best;
        if size == 0.0 {
            break;
        }
        rows.swap(turn, row);
        used.push(column);
        let pivot = rows[turn].clone() / rows[turn][column];
        for (r, row) in rows.iter_mut().enumerate() {
            if r != turn {
                *row -= &pivot * row[column];
            }
        }
        rows[turn] = pivot;
    }
    rows.into_iter().filter_map(|row| normalised(row.iter().copied().collect())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_directions_are_taken_out_and_the_rest_is_sparse() {
        // The space of e0 - e1, e2 - e3 and e4, turned.
        let plain = [[1.0, -1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, -1.0, 0.0], [0.0, 0.0, 0.0, 0.0, 1.0]];
        let mix = [[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]];
        let unit = |i: usize, c: usize| plain[i][c] / dot(&plain[i], &plain[i]).sqrt();
        let vectors: Vec<Vec<f64>> =
            mix.iter().map(|m| (0..5).map(|c| (0..3).map(|i| m[i] * unit(i, c)).sum()).collect()).collect();
        let mut span = Span::new(&vectors, &[f64::INFINITY, f64::INFINITY, 60.0]);
        assert!(span.take(&[1.0, 0.0, 0.0, 0.0, 0.0]).is_none(), "only half of it is in the space");
        let (told, sigma) = span.take(&[2.0, -2.0, 0.0, 0.0, 0.0]).unwrap();
        assert!((told[0] - 0.5f64.sqrt()).abs() < 1e-12 && sigma.is_infinite());
        assert!(span.take(&[-1.0, 1.0, 0.0, 0.0, 0.0]).is_none(), "nothing new");
        assert_eq!(span.vectors().len(), 2);
        let rest = sparse_basis(span.vectors());
        for row in &rest {
            assert!(row.iter().filter(|x| x.abs() > 1e-9).count() <= 2, "{row:?}");
        }
        let last = rest.iter().find(|row| row[4].abs() > 0.5).unwrap();
        assert!((span.sigma(last) - 60.0).abs() < 1e-6);
    }
}
