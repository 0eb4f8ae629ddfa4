//! Plane geometry: the perspective map between a square and its picture, and where lines meet.

use nalgebra::Matrix3;

/// The perspective map that takes the unit square's corners (0,0) (1,0) (1,1) (0,1) to a quadrangle's.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Projection([f64; 8]);

impl Projection {
    /// Heckbert's closed form; `None` for a degenerate quadrangle.
    pub fn from_unit_square(corners: [[f64; 2]; 4]) -> Option<Self> {
        let [p0, p1, p2, p3] = corners;
        let (dx1, dx2, sx) = (p1[0] - p2[0], p3[0] - p2[0], p0[0] - p1[0] + p2[0] - p3[0]);
        let (dy1, dy2, sy) = (p1[1] - p2[1], p3[1] - p2[1], p0[1] - p1[1] + p2[1] - p3[1]);
        let determinant = dx1 * dy2 - dx2 * dy1;
        if determinant.is_nan() || determinant.abs() <= 1e-9 {
            return None;
        }
        let g = (sx * dy2 - dx2 * sy) / determinant;
        let h = (dx1 * sy - sx * dy1) / determinant;
        Some(Self([
            p1[0] - p0[0] + g * p1[0],
            p3[0] - p0[0] + h * p3[0],
            p0[0],
            p1[1] - p0[1] + g * p1[1],
            p3[1] - p0[1] + h * p3[1],
            p0[1],
            g,
            h,
        ]))
    }

    pub fn map(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [a, b, c, d, e, f, _, _] = self.0;
        let w = self.depth([x, y]);
        [(a * x + b * y + c) / w, (d * x + e * y + f) / w]
    }

    /// The point of the unit square `place` along one side (0 top, then around) and `depth` inside it.
    pub fn on_side(side: usize, place: f64, depth: f64) -> [f64; 2] {
        match side {
            0 => [place, depth],
            1 => [1.0 - depth, place],
            2 => [1.0 - place, 1.0 - depth],
            _ => [depth, 1.0 - place],
        }
    }

    /// The denominator of both coordinates.
    pub fn depth(&self, [x, y]: [f64; 2]) -> f64 {
        self.0[6] * x + self.0[7] * y + 1.0
    }

    /// The same map of a square of side `side` around the origin.
    pub fn around_origin(&self, side: f64) -> Option<Self> {
        let [a, b, c, d, e, f, g, h] = self.0;
        let depth = 0.5 * (g + h) + 1.0;
        let numbers = [a, b, side * (c + 0.5 * (a + b)), d, e, side * (f + 0.5 * (d + e)), g, h];
        (depth > 1e-9).then(|| Self(numbers.map(|number| number / (side * depth))))
    }

    /// The map as a matrix of homogeneous coordinates.
    pub fn matrix(&self) -> Matrix3<f64> {
        let [a, b, c, d, e, f, g, h] = self.0;
        Matrix3::new(a, b, c, d, e, f, g, h, 1.0)
    }

    /// Changes the eight numbers: those of x, those of y, those of the depth.
    pub fn add(&mut self, change: [f64; 8]) {
        for (number, change) in self.0.iter_mut().zip(change) {
            *number += change;
        }
    }
}

/// Where two lines, each through two points, cross; `None` if nearly parallel.
pub(super) fn cross(first: [[f64; 2]; 2], second: [[f64; 2]; 2]) -> Option<[f64; 2]> {
    let a = [first[1][0] - first[0][0], first[1][1] - first[0][1]];
    let b = [second[1][0] - second[0][0], second[1][1] - second[0][1]];
    let determinant = a[0] * b[1] - a[1] * b[0];
    // The sine of the angle between them; below 0.05 (3 degrees) the crossing is anywhere.
    if determinant.is_nan() || determinant.abs() <= 0.05 * a[0].hypot(a[1]) * b[0].hypot(b[1]) {
        return None;
    }
    let between = [second[0][0] - first[0][0], second[0][1] - first[0][1]];
    let t = (between[0] * b[1] - between[1] * b[0]) / determinant;
    Some([first[0][0] + t * a[0], first[0][1] + t * a[1]])
}
