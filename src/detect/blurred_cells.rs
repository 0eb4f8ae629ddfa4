//! How a tag's cells look through a blur.
//!
//! The blur is normal with a covariance of its own, since a camera that moves blurs more along its way. In the cells' coordinates it is a
//! bivariate normal distribution, correlated where the tag is seen at a slant and from the side. Its integral over a quadrant is Mehler's series
//!
//! ```text
//! Phi2(x, y; r) = Phi(x) Phi(y) + phi(x) phi(y) * sum_k r^(k+1) / (k+1)! * He_k(x) He_k(y)
//! ```
//!
//! and the cells are a sum of quadrants, one for each place where four cells meet that are not alike.

use super::edge_fit::normal;

/// Cells along a side, at most.
pub(super) const MOST_CELLS: usize = 14;
/// Places where cells meet, along a side.
const MOST_EDGES: usize = MOST_CELLS + 1;
/// Terms of Mehler's series, at most.
const MOST_TERMS: usize = 8;

/// The cells of a tag.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cells<'a> {
    /// Cells along the edge.
    pub per_side: usize,
    /// Whether each cell within the edge has the shade of the margin, row by row.
    pub bright: &'a [bool],
}

impl Cells<'_> {
    /// Where cells meet that are not alike.
    pub fn meetings(&self) -> Meetings {
        let n = self.per_side;
        let dark = |row: usize, column: usize| {
            // Counted from 1, so that the margin has a place.
            let inside = (1..=n).contains(&row) && (1..=n).contains(&column);
            let bright = !inside || self.bright.get((row - 1) * n + column - 1).copied().unwrap_or(true);
            if bright { 0.0 } else { 1.0 }
        };
        let mut meetings = [[0.0; MOST_EDGES]; MOST_EDGES];
        for (row, line) in meetings.iter_mut().enumerate().take(n + 1) {
            for (column, meeting) in line.iter_mut().enumerate().take(n + 1) {
                *meeting =
                    dark(row + 1, column + 1) - dark(row + 1, column) - dark(row, column + 1) + dark(row, column);
            }
        }
        meetings
    }

    /// The blurred cells at a place (in cells): 1 for the margin's shade, 0 for the border's. `blur` is the covariance.
    pub fn look(&self, meetings: &Meetings, [u, v]: [f64; 2], blur: [f64; 3]) -> Look {
        let n = self.per_side;
        let (across, down) = (blur[0].max(1e-6).sqrt(), blur[2].max(1e-6).sqrt());
        let correlation = (blur[1] / (across * down)).clamp(-0.95, 0.95);
        let (x, y) = (Edges::of(u, across, n), Edges::of(v, down, n));
        let (mut value, mut slope, mut curvature) = (1.0, [0.0; 2], [0.0; 3]);
        // Cell by cell, as if the two directions had nothing to do with each other.
        for row in y.first..(y.end - 1).min(n) {
            let (mut sum, mut by_u, mut by_uu) = (0.0, 0.0, 0.0);
            let cells = self.bright.get(row * n..(row + 1) * n).unwrap_or(&[]);
            for column in x.first..(x.end - 1).min(n) {
                if cells.get(column) == Some(&false) {
                    sum += x.integral[column] - x.integral[column + 1];
                    by_u += x.density[column] - x.density[column + 1];
                    by_uu += x.bend[column] - x.bend[column + 1];
                }
            }
            let seen = y.integral[row] - y.integral[row + 1];
            value -= seen * sum;
            slope[0] -= seen * by_u;
            slope[1] -= (y.density[row] - y.density[row + 1]) * sum;
            curvature[0] -= seen * by_uu;
            curvature[2] -= (y.bend[row] - y.bend[row + 1]) * sum;
        }
        // What the correlation adds where cells meet.
        let terms = terms(correlation);
        for (row, meetings) in meetings.iter().enumerate().take(y.end).skip(y.first) {
            let mut sums = [0.0; MOST_TERMS];
            for (column, meeting) in meetings.iter().enumerate().take(x.end).skip(x.first) {
                if *meeting != 0.0 {
                    let (z, mut hermite) = (x.distance[column], [0.0, 1.0]);
                    for (k, sum) in sums.iter_mut().enumerate().take(terms.max(1)) {
                        *sum += meeting * x.density[column] * hermite[1];
                        hermite = [hermite[1], z * hermite[1] - k as f64 * hermite[0]];
                    }
                }
            }
            let (z, mut hermite, mut power) = (y.distance[row], [0.0, 1.0], 1.0);
            curvature[1] -= sums[0] * y.density[row];
            for (k, sum) in sums.iter().enumerate().take(terms) {
                power *= correlation / (k + 1) as f64;
                // Densities are those of places in cells, not in blurs.
                value -= power * across * down * sum * y.density[row] * hermite[1];
                hermite = [hermite[1], z * hermite[1] - k as f64 * hermite[0]];
            }
        }
        Look { value, slope, curvature }
    }
}

/// For each place where four cells meet, row by row: how many quadrants of dark begin there.
pub(super) type Meetings = [[f64; MOST_EDGES]; MOST_EDGES];

/// A value of the blurred cells, and its first and second slopes (by u, v; uu, uv, vv), in cells.
pub(super) struct Look {
    pub value: f64,
    pub slope: [f64; 2],
    pub curvature: [f64; 3],
}

/// How many terms of the series are needed for a hundredth of a grey level.
fn terms(correlation: f64) -> usize {
    let mut left = correlation.abs();
    let mut terms = 0;
    while terms < MOST_TERMS && left > 2e-3 {
        terms += 1;
        left *= correlation.abs();
    }
    terms
}

/// The edges between cells along one direction, as seen from a place.
struct Edges {
    /// Those that are near enough to matter.
    first: usize,
    end: usize,
    /// In blurs.
    distance: [f64; MOST_EDGES],
    integral: [f64; MOST_EDGES],
    density: [f64; MOST_EDGES],
    /// Slope of the density.
    bend: [f64; MOST_EDGES],
}

impl Edges {
    fn of(at: f64, blur: f64, n: usize) -> Self {
        let reach = 4.0 * blur;
        let first = ((at - reach).max(0.0) as usize).min(n);
        // One beyond the last cell that is seen, and one as a range's end.
        let end = ((at + reach).max(0.0) as usize).saturating_add(2).min(n + 1);
        let none = [0.0; MOST_EDGES];
        let mut edges = Self { first, end, distance: none, integral: none, density: none, bend: none };
        for k in first..end {
            let z = (at - k as f64) / blur;
            let (integral, density) = normal(z);
            edges.distance[k] = z;
            edges.integral[k] = integral;
            edges.density[k] = density / blur;
            edges.bend[k] = -z * density / (blur * blur);
        }
        edges
    }
}
