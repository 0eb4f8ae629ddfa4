//! What bends straight lines, and pixels with and without it.

use super::edge_lines::Weakness;

/// What bends straight lines: a camera's distortion, between pixels and *ideal* pixels, where the ideal
/// ones are those of the same focal lengths and centre without distortion (u = fx x / z + cx).
pub trait Lens {
    /// Pixel to ideal pixel; `None` where the lens model has no answer.
    fn undistort(&self, pixel: [f64; 2]) -> Option<[f64; 2]>;
    /// Ideal pixel to pixel; `None` where the lens model has no answer.
    fn distort(&self, ideal: [f64; 2]) -> Option<[f64; 2]>;
}

/// A lens or none.
pub(super) struct Bender<'a>(pub Option<&'a dyn Lens>);

impl Bender<'_> {
    pub fn undistort(&self, pixel: [f64; 2]) -> Result<[f64; 2], Weakness> {
        self.0.map_or(Some(pixel), |lens| lens.undistort(pixel)).ok_or(Weakness::OutsideLens)
    }

    pub fn distort(&self, ideal: [f64; 2]) -> Result<[f64; 2], Weakness> {
        self.0.map_or(Some(ideal), |lens| lens.distort(ideal)).ok_or(Weakness::OutsideLens)
    }

    pub fn undistort_all(&self, pixels: [[f64; 2]; 4]) -> Result<[[f64; 2]; 4], Weakness> {
        let [a, b, c, d] = pixels;
        Ok([self.undistort(a)?, self.undistort(b)?, self.undistort(c)?, self.undistort(d)?])
    }

    pub fn distort_all(&self, ideals: [[f64; 2]; 4]) -> Result<[[f64; 2]; 4], Weakness> {
        let [a, b, c, d] = ideals;
        Ok([self.distort(a)?, self.distort(b)?, self.distort(c)?, self.distort(d)?])
    }

    /// A covariance `[suu, suv, svv]` of ideal pixels as one of pixels.
    pub fn bend(&self, ideal: [f64; 2], covariance: [f64; 3]) -> Result<[f64; 3], Weakness> {
        if self.0.is_none() {
            return Ok(covariance);
        }
        let [right, left] = [0.5, -0.5].map(|step| self.distort([ideal[0] + step, ideal[1]]));
        let [below, above] = [0.5, -0.5].map(|step| self.distort([ideal[0], ideal[1] + step]));
        let (right, left, below, above) = (right?, left?, below?, above?);
        let (across, down) = ([right[0] - left[0], right[1] - left[1]], [below[0] - above[0], below[1] - above[1]]);
        let [uu, uv, vv] = covariance;
        let product = |a: usize, b: usize| {
            across[a] * across[b] * uu + (across[a] * down[b] + down[a] * across[b]) * uv + down[a] * down[b] * vv
        };
        Ok([product(0, 0), product(0, 1), product(1, 1)])
    }
}
