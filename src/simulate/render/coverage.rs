//! How much of a pixel a surface covers: exact areas, because a detector reads an edge's place from them.
//!
//! A pixel is the unit square centred on its coordinates. Within it the map from the picture to a plane, and the edge of a round body, are replaced by their
//! linear parts at the centre; what this leaves out is some 1e-4 px, for a lens or a perspective that bends that much within one pixel cannot be used anyway.

/// A point of a plane, or a derivative along it.
pub type Planar = [f64; 2];

/// The part of a pixel (0 to 1) on which `value + slope . offset` is negative.
#[must_use]
pub fn half_plane(value: f64, slope: Planar) -> f64 {
    let (a, b) = (slope[0].abs().max(slope[1].abs()), slope[0].abs().min(slope[1].abs()));
    let (reach, flat, z) = (0.5 * (a + b), 0.5 * (a - b), -value);
    if z <= -reach {
        0.0
    } else if z >= reach {
        1.0
    } else if z < -flat {
        (z + reach).powi(2) / (2.0 * a * b)
    } else if z <= flat {
        0.5 + z / a
    } else {
        1.0 - (reach - z).powi(2) / (2.0 * a * b)
    }
}

/// Where a pixel lies on a plane: its centre and how that moves from column to column and from row to row.
#[derive(Clone, Copy, Debug)]
pub struct Footprint {
    /// The centre.
    pub centre: Planar,
    /// Change of the place per pixel to the right.
    pub right: Planar,
    /// Change of the place per pixel down.
    pub down: Planar,
}

/// A rectangle divided by lines along both axes, each cell with a value.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// Where cells begin and end along x, increasing; one more than there are columns.
    pub xs: Vec<f64>,
    /// The same along y.
    pub ys: Vec<f64>,
    /// Row by row, from the smallest y.
    pub values: Vec<f32>,
}

/// A convex polygon of few corners.
struct Polygon {
    corners: [Planar; 12],
    count: usize,
}

impl Grid {
    /// One cell from `low` to `high`.
    #[must_use]
    pub fn plain(low: Planar, high: Planar, value: f32) -> Self {
        Self { xs: vec![low[0], high[0]], ys: vec![low[1], high[1]], values: vec![value] }
    }

    /// The part of a pixel that the rectangle covers, and the mean value over the whole pixel (outside the rectangle counts as zero).
    #[must_use]
    pub fn mean(&self, footprint: &Footprint) -> Option<(f64, f64)> {
        let Footprint { centre, right, down } = *footprint;
        let half = [0.5 * (right[0].abs() + down[0].abs()), 0.5 * (right[1].abs() + down[1].abs())];
        let columns = span(&self.xs, centre[0] - half[0], centre[0] + half[0])?;
        let rows = span(&self.ys, centre[1] - half[1], centre[1] + half[1])?;
        let width = self.xs.len() - 1;
        let value = |column: usize, row: usize| f64::from(self.values[row * width + column]);
        // Nearly all pixels lie in one cell, and nearly all others on one line.
        match (columns, rows) {
            (Span::Within(column), Span::Within(row)) => Some((1.0, value(column, row))),
            (Span::Line(line), Span::Within(row)) => {
                let before = half_plane(centre[0] - self.xs[line], [right[0], down[0]]);
                Some(two(before, line, width, |column| value(column, row)))
            }
            (Span::Within(column), Span::Line(line)) => {
                let before = half_plane(centre[1] - self.ys[line], [right[1], down[1]]);
                Some(two(before, line, self.ys.len() - 1, |row| value(column, row)))
            }
            (columns, rows) => self.clipped(footprint, columns.cells(width), rows.cells(self.ys.len() - 1)),
        }
    }

    /// The same by cutting the pixel's outline along every line that crosses it.
    fn clipped(
        &self,
        footprint: &Footprint,
        columns: std::ops::Range<usize>,
        rows: std::ops::Range<usize>,
    ) -> Option<(f64, f64)> {
        let Footprint { centre, right, down } = *footprint;
        let corner = |u: f64, v: f64| [0, 1].map(|i| centre[i] + u * right[i] + v * down[i]);
        let mut outline = Polygon { corners: [[0.0; 2]; 12], count: 4 };
        outline.corners[..4].copy_from_slice(&[
            corner(-0.5, -0.5),
            corner(0.5, -0.5),
            corner(0.5, 0.5),
            corner(-0.5, 0.5),
        ]);
        let whole = (right[0] * down[1] - right[1] * down[0]).abs();
        if whole < 1e-300 {
            return None;
        }
        let (mut covered, mut sum) = (0.0, 0.0);
        for column in columns {
            let strip = outline.above(0, self.xs[column]).below(0, self.xs[column + 1]);
            for row in rows.clone() {
                let area = strip.above(1, self.ys[row]).below(1, self.ys[row + 1]).area() / whole;
                covered += area;
                sum += area * f64::from(self.values[row * (self.xs.len() - 1) + column]);
            }
        }
        Some((covered.min(1.0), sum))
    }
}

/// A pixel on one line: cell `line - 1` has the part `before` of it, cell `line` the rest; cells outside do not exist.
fn two(before: f64, line: usize, cells: usize, value: impl Fn(usize) -> f64) -> (f64, f64) {
    let (mut covered, mut sum) = (0.0, 0.0);
    if line > 0 {
        covered += before;
        sum += before * value(line - 1);
    }
    if line < cells {
        covered += 1.0 - before;
        sum += (1.0 - before) * value(line);
    }
    (covered, sum)
}

/// Which lines a pixel meets along one axis.
#[derive(Clone, Copy)]
enum Span {
    /// None: it lies within a cell.
    Within(usize),
    /// One.
    Line(usize),
    /// From the first to the last.
    Lines(usize, usize),
}

impl Span {
    fn cells(self, count: usize) -> std::ops::Range<usize> {
        match self {
            Self::Within(cell) => cell..cell + 1,
            Self::Line(line) => line.saturating_sub(1)..(line + 1).min(count),
            Self::Lines(first, last) => first.saturating_sub(1)..(last + 1).min(count),
        }
    }
}

/// `None` if the pixel lies beyond the first or last line.
fn span(lines: &[f64], low: f64, high: f64) -> Option<Span> {
    if low.is_nan() || high <= lines[0] || low >= lines[lines.len() - 1] {
        return None;
    }
    let before = lines.partition_point(|line| *line <= low);
    let mut upto = before;
    while upto < lines.len() && lines[upto] < high {
        upto += 1;
    }
    Some(match upto - before {
        0 => Span::Within(before - 1),
        1 => Span::Line(before),
        _ => Span::Lines(before, upto - 1),
    })
}

impl Polygon {
    fn above(&self, axis: usize, bound: f64) -> Self {
        self.cut(|p| p[axis] - bound)
    }

    fn below(&self, axis: usize, bound: f64) -> Self {
        self.cut(|p| bound - p[axis])
    }

    /// The part on which `side` is positive (Sutherland and Hodgman).
    fn cut(&self, side: impl Fn(&Planar) -> f64) -> Self {
        let mut out = Self { corners: [[0.0; 2]; 12], count: 0 };
        let mut push = |p: Planar| {
            if out.count < 12 {
                out.corners[out.count] = p;
                out.count += 1;
            }
        };
        for i in 0..self.count {
            let (from, to) = (self.corners[i], self.corners[(i + 1) % self.count]);
            let (a, b) = (side(&from), side(&to));
            if a >= 0.0 {
                push(from);
            }
            if (a >= 0.0) != (b >= 0.0) {
                let t = a / (a - b);
                push([from[0] + t * (to[0] - from[0]), from[1] + t * (to[1] - from[1])]);
            }
        }
        out
    }

    fn area(&self) -> f64 {
        let corners = &self.corners[..self.count];
        let mut sum = 0.0;
        for (i, p) in corners.iter().enumerate() {
            let q = corners[(i + 1) % corners.len()];
            sum += p[0] * q[1] - p[1] * q[0];
        }
        0.5 * sum.abs()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The mean over a fine lattice within the pixel.
    fn sampled(value: impl Fn(f64, f64) -> f64) -> f64 {
        let n = 400;
        let at = |i: usize| (i as f64 + 0.5) / n as f64 - 0.5;
        (0..n * n).map(|k| value(at(k % n), at(k / n))).sum::<f64>() / (n * n) as f64
    }

    #[test]
    fn half_planes_agree_with_counting() {
        for (value, slope) in [
            (0.0, [1.0, 0.0]),
            (0.1, [0.3, -0.7]),
            (-0.45, [0.5, 0.5]),
            (0.4, [-0.9, 0.2]),
            (2.0, [0.3, 0.3]),
            (-2.0, [0.3, 0.3]),
            (0.2, [0.0, 0.5]),
        ] {
            let counted = sampled(|u, v| f64::from(value + slope[0] * u + slope[1] * v < 0.0));
            let exact = half_plane(value, slope);
            assert!((exact - counted).abs() < 2e-3, "{value} {slope:?}: {exact} {counted}");
        }
    }

    #[test]
    fn means_agree_with_counting_on_lines_crossings_and_rims() {
        let grid = Grid {
            xs: vec![-1.0, 0.0, 0.4, 2.0],
            ys: vec![-1.0, 0.1, 1.0],
            values: vec![1.0, 0.2, 0.7, 0.1, 0.9, 0.4],
        };
        let mut kinds = [0; 3];
        for k in 0..600 {
            let r = |i: u64| (((k * 8 + i) * 2_654_435_761 % 10_007) as f64 / 10_007.0 - 0.5) * 2.0;
            let size = if k % 2 == 0 { 0.1 } else { 0.9 };
            let footprint = Footprint {
                centre: [1.5 * r(0), 1.2 * r(1)],
                right: [size * r(2), size * r(3)],
                down: [size * r(4), size * r(5)],
            };
            if (footprint.right[0] * footprint.down[1] - footprint.right[1] * footprint.down[0]).abs() < 1e-3 * size {
                continue;
            }
            let cell = |u: f64, v: f64| {
                let at = [0, 1].map(|i| footprint.centre[i] + u * footprint.right[i] + v * footprint.down[i]);
                let inside = at[0] >= -1.0 && at[0] < 2.0 && at[1] >= -1.0 && at[1] < 1.0;
                inside.then(|| {
                    let column = grid.xs.iter().filter(|x| **x <= at[0]).count() - 1;
                    let row = grid.ys.iter().filter(|y| **y <= at[1]).count() - 1;
                    f64::from(grid.values[row * 3 + column])
                })
            };
            let (covered, mean) = grid.mean(&footprint).unwrap_or((0.0, 0.0));
            let counted = [sampled(|u, v| f64::from(cell(u, v).is_some())), sampled(|u, v| cell(u, v).unwrap_or(0.0))];
            assert!(
                (covered - counted[0]).abs() < 4e-3 && (mean - counted[1]).abs() < 4e-3,
                "{k}: {covered} {mean} {counted:?}"
            );
            kinds[if covered == 0.0 {
                0
            } else if covered < 1.0 {
                1
            } else {
                2
            }] += 1;
        }
        assert!(kinds.iter().all(|n| *n > 20), "{kinds:?}");
    }
}
