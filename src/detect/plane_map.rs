//! A plane in perspective: from places on a board to pixels.
//!
//! Every finder's answer is judged, and every corner's neighbourhood predicted, by such a map. It is exact
//! for a pinhole camera; a lens bends it, so those who use it allow for that or fit it to a small part only.

use nalgebra::{SMatrix, SVector};

/// A perspective map from a board's plane (in squares) to the picture (in pixels).
#[derive(Debug, Clone)]
pub struct PlaneMap([f64; 8]);

impl PlaneMap {
    /// The least-squares map of at least four places; `None` if they do not determine one.
    #[must_use]
    pub fn fit(places: &[[f64; 2]], pixels: &[[f64; 2]]) -> Option<Self> {
        if places.len() < 4 || places.len() != pixels.len() {
            return None;
        }
        // Both sides are moved to their middle and scaled to order 1: without it the system is singular in doubles.
        let (place_middle, place_scale) = spread(places)?;
        let (pixel_middle, pixel_scale) = spread(pixels)?;
        let mut weights = vec![1.0; places.len()];
        let mut h = SVector::<f64, 8>::zeros();
        // The linear equations are multiplied by the depth; dividing by it afterwards makes it a fit of pixels.
        for _ in 0..3 {
            let mut information = SMatrix::<f64, 8, 8>::zeros();
            let mut gradient = SVector::<f64, 8>::zeros();
            for ((place, pixel), weight) in places.iter().zip(pixels).zip(&mut weights) {
                let [x, y] = [0, 1].map(|axis: usize| (place[axis] - place_middle[axis]) * place_scale);
                let [u, v] = [0, 1].map(|axis: usize| (pixel[axis] - pixel_middle[axis]) * pixel_scale);
                let first = SVector::<f64, 8>::from([x, y, 1.0, 0.0, 0.0, 0.0, -u * x, -u * y]);
                let second = SVector::<f64, 8>::from([0.0, 0.0, 0.0, x, y, 1.0, -v * x, -v * y]);
                let depth = h[6] * x + h[7] * y + 1.0;
                if depth < 1e-3 {
                    return None;
                }
                *weight = 1.0 / (depth * depth);
                information.ger(*weight, &first, &first, 1.0);
                information.ger(*weight, &second, &second, 1.0);
                gradient.axpy(*weight * u, &first, 1.0);
                gradient.axpy(*weight * v, &second, 1.0);
            }
            h = information.cholesky()?.solve(&gradient);
        }
        // Back to squares and pixels: pixel = middle + (h (place - middle) scale) / scale.
        let [sx, sy] = [-place_middle[0] * place_scale, -place_middle[1] * place_scale];
        let row = |a: f64, b: f64, c: f64| [a * place_scale, b * place_scale, a * sx + b * sy + c];
        let (r0, r1, r2) = (row(h[0], h[1], h[2]), row(h[3], h[4], h[5]), row(h[6], h[7], 1.0));
        if r2[2].is_nan() || r2[2].abs() <= 1e-9 {
            return None;
        }
        let full = |r: [f64; 3], middle: f64| [0, 1, 2].map(|k: usize| (r[k] / pixel_scale + middle * r2[k]) / r2[2]);
        let (a, b) = (full(r0, pixel_middle[0]), full(r1, pixel_middle[1]));
        Some(Self([a[0], a[1], a[2], b[0], b[1], b[2], r2[0] / r2[2], r2[1] / r2[2]]))
    }

    /// A place on the board to pixels.
    #[must_use]
    pub fn map(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [a, b, c, d, e, f, g, h] = self.0;
        let w = g * x + h * y + 1.0;
        [(a * x + b * y + c) / w, (d * x + e * y + f) / w]
    }

    /// One unit along x and one along y at a place, in pixels (the map's derivative).
    #[must_use]
    pub fn square(&self, [x, y]: [f64; 2]) -> [[f64; 2]; 2] {
        let [a, b, _, d, e, _, g, h] = self.0;
        let w = g * x + h * y + 1.0;
        let [u, v] = self.map([x, y]);
        [[(a - g * u) / w, (d - g * v) / w], [(b - h * u) / w, (e - h * v) / w]]
    }
}

/// Middle of points and the factor that makes their mean distance from it about 1.
fn spread(points: &[[f64; 2]]) -> Option<([f64; 2], f64)> {
    let n = points.len() as f64;
    let middle = [0, 1].map(|axis: usize| points.iter().map(|point| point[axis]).sum::<f64>() / n);
    let mean = points.iter().map(|point| (point[0] - middle[0]).hypot(point[1] - middle[1])).sum::<f64>() / n;
    (mean > 1e-9 && mean.is_finite()).then_some((middle, 1.0 / mean))
}
