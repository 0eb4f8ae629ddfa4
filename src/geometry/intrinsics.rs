//! A camera's intrinsics: picture size, lens model and its numbers; projection and its inverse.

use nalgebra::{Matrix2, Vector2, Vector3};
use thiserror::Error;

use super::lens::{Lens, LensModel, MAX_PARAMETERS, with_lens};

/// The intrinsics of one camera. Pixels are counted from the centre of the top-left one.
#[derive(Clone, Debug, PartialEq)]
pub struct Intrinsics {
    model: LensModel,
    size: [u32; 2],
    parameters: [f64; MAX_PARAMETERS],
    /// Beyond this radius (normalised plane; angle in rad for a fisheye) the distortion folds back on itself.
    fold: f64,
}

/// Intrinsics that cannot be.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum IntrinsicsError {
    /// The picture has no pixels.
    #[error("the picture size {0} x {1} is not positive")]
    Size(u32, u32),
    /// A focal length that is not a positive number.
    #[error("the focal length {0} is not a positive number of pixels")]
    Focal(f64),
    /// A number that is not finite.
    #[error("the {0} is not a finite number")]
    NotFinite(&'static str),
    /// The wrong number of distortion coefficients.
    #[error("the model `{model}` takes {expected} distortion coefficients, not {found}")]
    DistortionCount {
        /// The model's name in layouts.
        model: &'static str,
        /// How many it takes.
        expected: usize,
        /// How many were given.
        found: usize,
    },
}

/// A pixel that no ray of the lens model reaches.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum UndistortError {
    /// The pixel lies outside the image of the model's one-to-one region.
    #[error("the pixel lies outside the region where the lens model is one-to-one")]
    OutsideDomain,
    /// The iteration did not settle.
    #[error("no ray was found that projects to the pixel")]
    NotConverged,
}

impl Intrinsics {
    /// Intrinsics from a model, picture size (width, height), focal lengths (px), principal point (px) and the model's distortion.
    ///
    /// # Errors
    /// When a size or focal length is not positive, a number is not finite, or the number of coefficients is not the model's.
    pub fn new(
        model: LensModel,
        size: [u32; 2],
        focal: [f64; 2],
        centre: [f64; 2],
        distortion: &[f64],
    ) -> Result<Self, IntrinsicsError> {
        if size.contains(&0) {
            return Err(IntrinsicsError::Size(size[0], size[1]));
        }
        if let Some(bad) = focal.iter().find(|f| !f.is_finite() || **f <= 0.0) {
            return Err(IntrinsicsError::Focal(*bad));
        }
        if !centre.iter().all(|c| c.is_finite()) {
            return Err(IntrinsicsError::NotFinite("principal point"));
        }
        if !distortion.iter().all(|k| k.is_finite()) {
            return Err(IntrinsicsError::NotFinite("distortion"));
        }
        if distortion.len() != model.distortion_count() {
            return Err(IntrinsicsError::DistortionCount {
                model: model.name(),
                expected: model.distortion_count(),
                found: distortion.len(),
            });
        }
        let mut parameters = [0.0; MAX_PARAMETERS];
        parameters[..2].copy_from_slice(&focal);
        parameters[2..4].copy_from_slice(&centre);
        parameters[4..4 + distortion.len()].copy_from_slice(distortion);
        Ok(Self { model, size, parameters, fold: fold_radius(model, &parameters) })
    }

    /// The lens model.
    #[must_use]
    pub fn model(&self) -> LensModel {
        self.model
    }

    /// Picture width and height in pixels.
    #[must_use]
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Focal lengths in pixels, x and y.
    #[must_use]
    pub fn focal(&self) -> [f64; 2] {
        [self.parameters[0], self.parameters[1]]
    }

    /// The principal point in pixels.
    #[must_use]
    pub fn centre(&self) -> [f64; 2] {
        [self.parameters[2], self.parameters[3]]
    }

    /// The distortion coefficients in the model's order.
    #[must_use]
    pub fn distortion(&self) -> &[f64] {
        &self.parameters[4..self.model.parameter_count()]
    }

    /// All parameters in the order of [`super::lens`], padded with zeros.
    #[must_use]
    pub fn parameters(&self) -> &[f64; MAX_PARAMETERS] {
        &self.parameters
    }

    /// The same camera with other parameters; used by the solver, which keeps focal lengths positive itself.
    #[must_use]
    pub fn with_parameters(&self, parameters: [f64; MAX_PARAMETERS]) -> Self {
        Self { parameters, fold: fold_radius(self.model, &parameters), ..self.clone() }
    }

    /// The pixel of a point in the camera's frame (m); `None` for a point that the camera cannot see because it lies behind
    /// the lens or where the distortion has folded back.
    #[must_use]
    pub fn project(&self, point: &Vector3<f64>) -> Option<Vector2<f64>> {
        let radius = match self.model {
            LensModel::KannalaBrandt => point.x.hypot(point.y).atan2(point.z),
            _ => point.x.hypot(point.y) / point.z,
        };
        if radius >= self.fold {
            return None;
        }
        let p = [point.x, point.y, point.z];
        with_lens!(self.model, L => L::project(&self.parameters, &p)).map(Vector2::from)
    }

    /// The ray (unit vector in the camera's frame) that projects to `pixel`.
    ///
    /// # Errors
    /// [`UndistortError::OutsideDomain`] where the distortion is not one-to-one, [`UndistortError::NotConverged`] if the iteration fails.
    pub fn ray(&self, pixel: &Vector2<f64>) -> Result<Vector3<f64>, UndistortError> {
        let d = Vector2::new(
            (pixel.x - self.parameters[2]) / self.parameters[0],
            (pixel.y - self.parameters[3]) / self.parameters[1],
        );
        match self.model {
            LensModel::Pinhole => Ok(Vector3::new(d.x, d.y, 1.0).normalize()),
            LensModel::KannalaBrandt => self.fisheye_ray(&d),
            LensModel::Brown | LensModel::Rational => {
                let ideal = self.brown_ideal(&d)?;
                Ok(Vector3::new(ideal.x, ideal.y, 1.0).normalize())
            }
        }
    }

    /// The point (x/z, y/z) on the normalised image plane that projects to `pixel`.
    ///
    /// # Errors
    /// As [`Intrinsics::ray`]; also `OutsideDomain` for a ray at or beyond 90 degrees from the axis.
    pub fn undistort(&self, pixel: &Vector2<f64>) -> Result<Vector2<f64>, UndistortError> {
        let ray = self.ray(pixel)?;
        if ray.z < 1e-6 {
            return Err(UndistortError::OutsideDomain);
        }
        Ok(Vector2::new(ray.x / ray.z, ray.y / ray.z))
    }

    /// Newton's method on the distorted normalised coordinates, backtracking so that it never crosses the fold.
    fn brown_ideal(&self, distorted: &Vector2<f64>) -> Result<Vector2<f64>, UndistortError> {
        let mut unit = self.parameters;
        (unit[0], unit[1], unit[2], unit[3]) = (1.0, 1.0, 0.0, 0.0);
        let evaluate = |x: &Vector2<f64>| {
            let point = [x.x, x.y, 1.0];
            with_lens!(self.model, L => L::project_with_derivatives(&unit, &point))
        };
        let mut x = *distorted;
        if x.norm() >= self.fold {
            x *= 0.9 * self.fold / x.norm();
        }
        let mut error = f64::INFINITY;
        for _ in 0..60 {
            let Some(at) = evaluate(&x) else { return Err(UndistortError::NotConverged) };
            let residual = distorted - Vector2::from(at.pixel);
            error = residual.norm();
            if error <= 1e-13 * (1.0 + distorted.norm()) {
                break;
            }
            let slope = Matrix2::new(at.by_point[0][0], at.by_point[0][1], at.by_point[1][0], at.by_point[1][1]);
            let Some(inverse) = slope.try_inverse() else { return Err(UndistortError::OutsideDomain) };
            let step = inverse * residual;
            let mut scale = 1.0;
            let better = loop {
                let trial = x + step * scale;
                if trial.norm() < self.fold {
                    let trial_error = evaluate(&trial).map(|p| (distorted - Vector2::from(p.pixel)).norm());
                    if trial_error.is_some_and(|e| e < error) {
                        break Some(trial);
                    }
                }
                scale *= 0.5;
                if scale < 1e-6 {
                    break None;
                }
            };
            match better {
                Some(trial) => x = trial,
                None => break,
            }
        }
        // A point that the model does not reach leaves Newton stuck at the fold with an error far above rounding.
        if error <= 1e-10 * (1.0 + distorted.norm()) { Ok(x) } else { Err(UndistortError::OutsideDomain) }
    }

    fn fisheye_ray(&self, distorted: &Vector2<f64>) -> Result<Vector3<f64>, UndistortError> {
        let k = &self.parameters[4..8];
        let bent = distorted.norm();
        if bent < 1e-15 {
            return Ok(Vector3::z());
        }
        let value = |t: f64| {
            let t2 = t * t;
            t * (1.0 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3]))))
        };
        let top = self.fold.min(std::f64::consts::PI);
        if bent > value(top) {
            return Err(UndistortError::OutsideDomain);
        }
        // Bisection guarded Newton: value() is increasing on (0, top).
        let (mut low, mut high) = (0.0, top);
        let mut angle = bent.min(top);
        for _ in 0..100 {
            let residual = value(angle) - bent;
            if residual > 0.0 {
                high = angle
            } else {
                low = angle
            }
            let t2 = angle * angle;
            let slope = 1.0 + t2 * (3.0 * k[0] + t2 * (5.0 * k[1] + t2 * (7.0 * k[2] + t2 * 9.0 * k[3])));
            let next = angle - residual / slope;
            let next = if next > low && next < high { next } else { 0.5 * (low + high) };
            if (next - angle).abs() <= 1e-16 * (1.0 + angle) {
                angle = next;
                break;
            }
            angle = next;
        }
        let direction = distorted / bent;
        let (sin, cos) = angle.sin_cos();
        Ok(Vector3::new(direction.x * sin, direction.y * sin, cos))
    }
}

/// The smallest radius at which the radial map stops growing, by scanning and bisecting its derivative.
///
/// Tangential terms are left out: they are tiny in any lens, and the Newton iteration checks its own residual.
fn fold_radius(model: LensModel, p: &[f64; MAX_PARAMETERS]) -> f64 {
    let slope = |r: f64| {
        let t = r * r;
        match model {
            LensModel::Pinhole => 1.0,
            LensModel::KannalaBrandt => 1.0 + t * (3.0 * p[4] + t * (5.0 * p[5] + t * (7.0 * p[6] + t * 9.0 * p[7]))),
            LensModel::Brown => 1.0 + t * (3.0 * p[4] + t * (5.0 * p[5] + t * 7.0 * p[8])),
            LensModel::Rational => {
                let top = 1.0 + t * (p[4] + t * (p[5] + t * p[8]));
                let bottom = 1.0 + t * (p[9] + t * (p[10] + t * p[11]));
                let top_slope = 2.0 * r * (p[4] + t * (2.0 * p[5] + t * 3.0 * p[8]));
                let bottom_slope = 2.0 * r * (p[9] + t * (2.0 * p[10] + t * 3.0 * p[11]));
                if bottom <= 0.0 { -1.0 } else { (top + r * top_slope - r * top * bottom_slope / bottom) / bottom }
            }
        }
    };
    // A pinhole-like model reaches any radius short of 90 degrees; a fisheye at most a full turn to the back.
    let (end, steps, unbounded) = match model {
        LensModel::Pinhole => return f64::INFINITY,
        LensModel::KannalaBrandt => (std::f64::consts::PI, 400, std::f64::consts::PI),
        _ => (10.0, 2000, f64::INFINITY),
    };
    let mut last = 0.0;
    for i in 1..=steps {
        let r = end * f64::from(i) / f64::from(steps);
        if slope(r) <= 0.0 {
            let (mut low, mut high) = (last, r);
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                if slope(middle) > 0.0 { low = middle } else { high = middle }
            }
            return low;
        }
        last = r;
    }
    unbounded
}
