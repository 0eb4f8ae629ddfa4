//! Several observations made one.

use super::chunk::WEIGHT;

/// The one observation that stands for several under least squares: the weighted mean, and the summed weights. With half the weighted sum of squares about
/// the mean as constant, `sum |W_i (x - x_i)|^2 = |W (x - mean)|^2 + 2 constant` for every `x`.
#[derive(Clone, Copy, Default)]
pub(super) struct Mean {
    /// The first corner, from which the mean is counted so that nothing is lost to the size of a pixel coordinate.
    origin: [f64; 2],
    /// The weighted sum of the others' offsets, and once closed the mean's offset.
    offset: [f64; 2],
    pub(super) weight: [f64; WEIGHT],
}

impl Mean {
    pub(super) fn add(&mut self, pixel: [f64; 2], w: [f64; WEIGHT]) {
        if self.weight[0] == 0.0 {
            self.origin = pixel;
        }
        let d = [pixel[0] - self.origin[0], pixel[1] - self.origin[1]];
        (0..WEIGHT).for_each(|k| self.weight[k] += w[k]);
        self.offset[0] += w[0] * d[0] + w[1] * d[1];
        self.offset[1] += w[1] * d[0] + w[2] * d[1];
    }

    pub(super) fn close(&mut self) {
        let ([uu, uv, vv], [u, v]) = (self.weight, self.offset);
        let determinant = uu * vv - uv * uv;
        self.offset = [(vv * u - uv * v) / determinant, (uu * v - uv * u) / determinant];
    }

    pub(super) fn pixel(&self) -> [f64; 2] {
        [self.origin[0] + self.offset[0], self.origin[1] + self.offset[1]]
    }
}
