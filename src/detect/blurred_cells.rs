//! How a tag's cells look through a blur.
//!
//! The blur is normal with a covariance of its own, since a camera that moves blurs more along its way. In the cells' coordinates it is a
//! bivariate normal distribution, correlated where the tag is seen at a slant and from the side. Its integral over a quadrant is Mehler's series
//!
//! ```text
//! Phi2(x, y; r) = Phi(x) Phi(y) + sum_k r^(k+1) / (k+1)! * h_k(x) h_k(y),    h_k = phi He_k,    h_k' = -h_(k+1)
//! ```
//!
//! and the cells are a sum of quadrants, one for each place where four cells meet that are not alike. Eight places are looked at together,
//! which are to be neighbours: only cells that one of them sees are added up.

use pulp::Simd;

use super::wide::{LANES, Lanes, Wide, lanes, normal};

/// Cells along a side, at most.
pub(super) const MOST_CELLS: usize = 14;
/// Places where cells meet, along a side.
const MOST_EDGES: usize = MOST_CELLS + 1;
/// Terms of Mehler's series, at most.
const MOST_TERMS: usize = 8;
/// Hermite's functions that its slopes and curvatures need.
const FUNCTIONS: usize = MOST_TERMS + 2;
/// A cell is seen from so many blurs away.
const REACH: f32 = 4.0;

/// The cells of a tag.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cells<'a> {
    /// Cells along the edge.
    pub per_side: usize,
    /// Whether each cell within the edge has the shade of the margin, row by row.
    pub bright: &'a [bool],
}

/// The same, ready to be looked at.
#[derive(Debug, Clone)]
pub(super) struct Marks {
    /// Cells along the edge.
    pub per_side: usize,
    /// Whether each cell is dark, row by row.
    dark: [[bool; MOST_CELLS]; MOST_CELLS],
    /// For each place where four cells meet, row by row: how many quadrants of dark begin there.
    meetings: [[f32; MOST_EDGES]; MOST_EDGES],
}

impl Cells<'_> {
    /// `None` if there are too many or too few of them.
    pub fn marks(&self) -> Option<Marks> {
        let n = self.per_side;
        if n == 0 || n > MOST_CELLS || self.bright.len() != n * n {
            return None;
        }
        let mut dark = [[false; MOST_CELLS]; MOST_CELLS];
        for (k, bright) in self.bright.iter().enumerate() {
            dark[k / n][k % n] = !bright;
        }
        let mut meetings = [[0.0; MOST_EDGES]; MOST_EDGES];
        for (row, line) in dark.iter().enumerate() {
            for (column, _) in line.iter().enumerate().filter(|(_, dark)| **dark) {
                meetings[row][column] += 1.0;
                meetings[row][column + 1] -= 1.0;
                meetings[row + 1][column] -= 1.0;
                meetings[row + 1][column + 1] += 1.0;
            }
        }
        Some(Marks { per_side: n, dark, meetings })
    }
}

/// Eight places (in cells) and the covariance `[uu, uv, vv]` of the blur at each of them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Places {
    pub at: [Lanes; 2],
    pub blur: [Lanes; 3],
}

/// Values of the blurred cells, 1 for the margin's shade and 0 for the border's, and their first and second slopes (by u, v; uu, uv, vv), in cells.
#[derive(Clone, Copy)]
pub(super) struct Look<S: Simd> {
    pub value: Wide<S>,
    pub slope: [Wide<S>; 2],
    pub curvature: [Wide<S>; 3],
}

/// What eight places see of an edge between cells: h_k, k from 0.
#[derive(Clone, Copy)]
struct Edge<S: Simd> {
    integral: Wide<S>,
    functions: [Wide<S>; FUNCTIONS],
}

impl<S: Simd> Edge<S> {
    /// From `z` blurs beyond it, with what so many terms of the series need.
    #[inline(always)]
    fn see(&mut self, simd: S, z: Wide<S>, terms: usize) {
        // Farther away nothing is seen, and Hermite's polynomials would make something of it.
        let z = z.max(Wide::splat(simd, -5.0)).min(Wide::splat(simd, 5.0));
        let (integral, density) = normal(simd, z);
        self.integral = integral;
        self.functions[0] = density;
        self.functions[1] = z * density;
        for k in 2..(terms + 2).min(FUNCTIONS) {
            self.functions[k] = z * self.functions[k - 1] - Wide::splat(simd, (k - 1) as f32) * self.functions[k - 2];
        }
    }
}

/// Three registers of some of the lanes.
#[inline(always)]
fn wide_three<S: Simd>(simd: S, all: &[Lanes; 3], part: usize) -> [Wide<S>; 3] {
    [lanes(simd, &all[0], part), lanes(simd, &all[1], part), lanes(simd, &all[2], part)]
}

/// Memory for the edges of one direction; every place of it that is read has been written before.
pub(super) struct Edges<S: Simd>([Edge<S>; MOST_EDGES]);

impl<S: Simd> Edges<S> {
    #[inline(always)]
    pub fn new(simd: S) -> Self {
        let zero = Wide::splat(simd, 0.0);
        Self([Edge { integral: zero, functions: [zero; FUNCTIONS] }; MOST_EDGES])
    }
}

/// The edges that matter to places along one direction.
#[inline(always)]
fn window(at: &Lanes, variance: &Lanes, n: usize) -> [usize; 2] {
    let (mut low, mut high, mut widest) = (at[0], at[0], variance[0]);
    for lane in 1..LANES {
        low = low.min(at[lane]);
        high = high.max(at[lane]);
        widest = widest.max(variance[lane]);
    }
    let reach = REACH * widest.max(0.0).sqrt();
    // Conversion to integers cuts towards zero and saturates. One beyond the last cell that is seen, and one as a range's end.
    let first = ((low - reach).max(0.0) as usize).min(n);
    [first, ((high + reach).max(0.0) as usize).saturating_add(2).min(n + 1)]
}

/// How many terms of the series are needed for some hundredths of a grey level: h_k is at most 0.4 root(k!) or so, and seldom that, so that
/// the first term left out is less than 0.16 r^(k+1) / (k+1)^(3/2).
#[inline(always)]
fn terms(blur: &[Lanes; 3]) -> usize {
    let mut most = 0.0_f32;
    for ((uu, uv), vv) in blur[0].iter().zip(&blur[1]).zip(&blur[2]) {
        most = most.max(uv * uv / (uu * vv).max(1e-12));
    }
    let (correlation, mut terms) = (most.sqrt().min(1.0), 0);
    let mut power = correlation;
    while terms < MOST_TERMS && 0.16 * power > 2e-4 * ((terms + 1) as f32).powf(1.5) {
        terms += 1;
        power *= correlation;
    }
    terms
}

impl Marks {
    /// What is seen from some of the eight places.
    #[inline(always)]
    pub fn look<S: Simd>(&self, simd: S, places: &Places, part: usize, columns: &mut Edges<S>) -> Look<S> {
        let number = |value: f32| Wide::splat(simd, value);
        let (zero, one, n) = (number(0.0), number(1.0), self.per_side);
        let (u, v) = (lanes(simd, &places.at[0], part), lanes(simd, &places.at[1], part));
        let [uu, uv, vv] = wide_three(simd, &places.blur, part);
        let least = number(1e-6);
        let (across, down) = (uu.max(least).sqrt().inverse(), vv.max(least).sqrt().inverse());
        let correlation = (uv * across * down).max(number(-0.95)).min(number(0.95));
        let terms = terms(&places.blur);
        let [left, right] = window(&places.at[0], &places.blur[0], n);
        let [top, bottom] = window(&places.at[1], &places.blur[2], n);
        for (k, column) in columns.0.iter_mut().enumerate().take(right).skip(left) {
            column.see(simd, (u - number(k as f32)) * across, terms);
        }
        let (mut value, mut by_u, mut by_v) = (one, zero, zero);
        let (mut by_uu, mut by_uv, mut by_vv) = (zero, zero, zero);
        let mut above = [zero; 3];
        let mut below = Edge { integral: zero, functions: [zero; FUNCTIONS] };
        for row in top..bottom {
            below.see(simd, (v - number(row as f32)) * down, terms);
            // Cell by cell, as if the two directions had nothing to do with each other.
            if row > top {
                let (mut sum, mut slope, mut curvature) = (zero, zero, zero);
                for (pair, dark) in columns.0[left..right].windows(2).zip(&self.dark[row - 1][left..]) {
                    if *dark {
                        sum = sum + (pair[0].integral - pair[1].integral);
                        slope = slope + (pair[0].functions[0] - pair[1].functions[0]);
                        curvature = curvature + (pair[0].functions[1] - pair[1].functions[1]);
                    }
                }
                let seen = above[0] - below.integral;
                let seen_slope = above[1] - below.functions[0];
                value = value - seen * sum;
                by_u = by_u - seen * slope;
                by_v = by_v - seen_slope * sum;
                by_uu = by_uu + seen * curvature;
                by_vv = by_vv + (above[2] - below.functions[1]) * sum;
            }
            // What the correlation adds where cells meet.
            let mut sums = [zero; FUNCTIONS];
            for (column, meeting) in columns.0[left..right].iter().zip(&self.meetings[row][left..]) {
                if *meeting != 0.0 {
                    let meeting = number(*meeting);
                    for (sum, function) in sums.iter_mut().zip(&column.functions).take(terms + 2) {
                        *sum = *sum + meeting * *function;
                    }
                }
            }
            let h = &below.functions;
            by_uv = by_uv - sums[0] * h[0];
            let mut power = one;
            for k in 0..terms.min(MOST_TERMS) {
                power = power * correlation * number(1.0 / (k + 1) as f32);
                let (here, more, most) = (power * h[k], power * h[k + 1], power * h[k + 2]);
                value = value - here * sums[k];
                by_u = by_u + here * sums[k + 1];
                by_v = by_v + more * sums[k];
                by_uu = by_uu - here * sums[k + 2];
                by_uv = by_uv - more * sums[k + 1];
                by_vv = by_vv - most * sums[k];
            }
            above = [below.integral, h[0], h[1]];
        }
        Look {
            value,
            slope: [by_u * across, by_v * down],
            curvature: [by_uu * across * across, by_uv * across * down, by_vv * down * down],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Cells, Edges, Places};
    use pulp::{Scalar, Simd};

    const N: usize = 6;

    fn bright() -> Vec<bool> {
        (0..N * N).map(|k| k * 7 % 5 < 2 && k / N > 0 && k % N > 0 && k % N < N - 1).collect()
    }

    /// Value, slopes and curvatures.
    fn look(at: [f32; 2], blur: [f32; 3]) -> [f64; 6] {
        let bright = bright();
        let marks = Cells { per_side: N, bright: &bright }.marks().unwrap();
        let places = Places { at: at.map(|at| [at; 8]), blur: blur.map(|blur| [blur; 8]) };
        let look = marks.look(Scalar, &places, 3, &mut Edges::new(Scalar));
        let all = [look.value, look.slope[0], look.slope[1], look.curvature[0], look.curvature[1], look.curvature[2]];
        all.map(|wide| f64::from(Scalar.reduce_sum_f32s(wide.values)))
    }

    const BLURS: [[f32; 3]; 4] = [[0.06, 0.0, 0.06], [0.2, 0.0, 0.05], [0.12, 0.06, 0.12], [0.3, -0.17, 0.14]];

    #[test]
    fn blurred_cells_are_what_an_integral_says() {
        let bright = bright();
        for blur in BLURS {
            let [uu, uv, vv] = blur.map(f64::from);
            let (first, mix) = (uu.sqrt(), uv / uu.sqrt());
            let second = (vv - mix * mix).sqrt();
            for at in [[1.3, 2.4], [3.05, 3.9], [0.2, 5.8], [-0.3, 1.0]] {
                let (mut sum, mut all) = (0.0, 0.0);
                for i in -160..=160 {
                    for k in -160..=160 {
                        let (a, b) = (f64::from(i) / 32.0, f64::from(k) / 32.0);
                        let weight = (-0.5 * (a * a + b * b)).exp();
                        let (u, v) = (f64::from(at[0]) + first * a, f64::from(at[1]) + mix * a + second * b);
                        let inside = u >= 0.0 && v >= 0.0 && u < N as f64 && v < N as f64;
                        let dark = inside && !bright[v as usize * N + u as usize];
                        sum += if dark { 0.0 } else { weight };
                        all += weight;
                    }
                }
                let [value, ..] = look(at, blur);
                assert!((value - sum / all).abs() < 6e-3, "{at:?} {blur:?}: {value} {}", sum / all);
            }
        }
    }

    #[test]
    fn slopes_and_curvatures_are_those_of_the_values() {
        const STEP: f32 = 0.01;
        for blur in BLURS {
            for at in [[1.3, 2.4], [3.05, 3.9], [0.2, 5.8], [-0.3, 1.0]] {
                let [_, by_u, by_v, uu, uv, vv] = look(at, blur);
                let [right, left] = [STEP, -STEP].map(|step| look([at[0] + step, at[1]], blur));
                let [below, above] = [STEP, -STEP].map(|step| look([at[0], at[1] + step], blur));
                let slope = |a: f64, b: f64| (a - b) / f64::from(2.0 * STEP);
                assert!((slope(right[0], left[0]) - by_u).abs() < 2e-3, "{at:?} {blur:?}");
                assert!((slope(below[0], above[0]) - by_v).abs() < 2e-3, "{at:?} {blur:?}");
                assert!((slope(below[1], above[1]) - uv).abs() < 2e-2, "{at:?} {blur:?}");
                assert!((slope(right[1], left[1]) - uu).abs() < 2e-2, "{at:?} {blur:?}");
                assert!((slope(below[2], above[2]) - vv).abs() < 2e-2, "{at:?} {blur:?}");
            }
        }
    }
}
