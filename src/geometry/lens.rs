//! Lens models: from a point in the camera's frame to a pixel, with exact derivatives.
//!
//! | model | parameters, in this order | formula |
//! |---|---|---|
//! | pinhole | fx fy cx cy | `u = fx x/z + cx` |
//! | brown | + k1 k2 p1 p2 k3 | D. C. Brown 1971, as in OpenCV's `projectPoints` |
//! | rational | + k1 k2 p1 p2 k3 k4 k5 k6 | OpenCV's `CALIB_RATIONAL_MODEL` |
//! | kannala_brandt | + k1 k2 k3 k4 | Kannala and Brandt 2006, as in OpenCV's `fisheye` |
//!
//! A model is a type without data that implements [`Lens`], so that the solver's inner loop is compiled once for
//! each with constant sizes; [`LensModel`] is the value that users and files speak of.

/// The largest number of parameters any model has.
pub const MAX_PARAMETERS: usize = 12;

/// Which formula a camera follows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum LensModel {
    /// No distortion.
    Pinhole,
    /// Brown-Conrady with five coefficients.
    Brown,
    /// Brown-Conrady with a rational radial part, eight coefficients.
    Rational,
    /// Kannala-Brandt fisheye with four coefficients.
    KannalaBrandt,
}

impl LensModel {
    /// Every model.
    pub const ALL: [Self; 4] = [Self::Pinhole, Self::Brown, Self::Rational, Self::KannalaBrandt];

    /// The name used in layouts.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Pinhole => "pinhole",
            Self::Brown => "brown",
            Self::Rational => "rational",
            Self::KannalaBrandt => "kannala_brandt",
        }
    }

    /// How many distortion coefficients the model has.
    #[must_use]
    pub fn distortion_count(self) -> usize {
        self.parameter_count() - 4
    }

    /// How many parameters the model has in all: fx fy cx cy and the distortion.
    #[must_use]
    pub fn parameter_count(self) -> usize {
        match self {
            Self::Pinhole => Pinhole::COUNT,
            Self::Brown => Brown::COUNT,
            Self::Rational => Rational::COUNT,
            Self::KannalaBrandt => KannalaBrandt::COUNT,
        }
    }

    /// The name of parameter `index`: `fx`, `cy`, `k1`, `p2`...
    #[must_use]
    pub fn parameter_name(self, index: usize) -> &'static str {
        let brown = ["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"];
        let fisheye = ["k1", "k2", "k3", "k4"];
        match (index, self) {
            (0..4, _) => ["fx", "fy", "cx", "cy"][index],
            (_, Self::KannalaBrandt) => fisheye.get(index - 4).copied().unwrap_or("?"),
            _ => brown.get(index - 4).copied().unwrap_or("?"),
        }
    }
}

/// A pixel with its derivatives to the point and to the lens parameters.
#[derive(Clone, Copy, Debug)]
pub struct Projection {
    /// The pixel (u, v).
    pub pixel: [f64; 2],
    /// d(u, v) / d(point), px per metre, rows u and v.
    pub by_point: [[f64; 3]; 2],
    /// d(u, v) / d(parameter), rows u and v; entries past the model's count are zero.
    pub by_parameter: [[f64; MAX_PARAMETERS]; 2],
}

/// A lens model as a formula. `parameters` must hold [`Lens::COUNT`] numbers in the order of the table above.
pub trait Lens {
    /// How many parameters the model has.
    const COUNT: usize;
    /// The pixel of a point in the camera's frame (m), or `None` where the camera cannot see it (behind the lens).
    fn project(parameters: &[f64; MAX_PARAMETERS], point: &[f64; 3]) -> Option<[f64; 2]>;
    /// As [`Lens::project`], with derivatives.
    fn project_with_derivatives(parameters: &[f64; MAX_PARAMETERS], point: &[f64; 3]) -> Option<Projection>;
}

/// A point nearer than this to the lens plane (m) cannot be divided by its depth.
const NEAREST: f64 = 1e-9;

/// The pinhole camera.
#[derive(Debug)]
pub struct Pinhole;
/// Brown-Conrady, five coefficients.
#[derive(Debug)]
pub struct Brown;
/// Brown-Conrady with a rational radial part, eight coefficients.
#[derive(Debug)]
pub struct Rational;
/// Kannala-Brandt, four coefficients.
#[derive(Debug)]
pub struct KannalaBrandt;

impl Lens for Pinhole {
    const COUNT: usize = 4;

    #[inline(always)]
    fn project(p: &[f64; MAX_PARAMETERS], point: &[f64; 3]) -> Option<[f64; 2]> {
        if point[2] < NEAREST {
            return None;
        }
        Some([p[0] * point[0] / point[2] + p[2], p[1] * point[1] / point[2] + p[3]])
    }

    #[inline(always)]
    fn project_with_derivatives(p: &[f64; MAX_PARAMETERS], point: &[f64; 3]) -> Option<Projection> {
        if point[2] < NEAREST {
            return None;
        }
        let w = 1.0 / point[2];
        let (x, y) = (point[0] * w, point[1] * w);
        let mut by_parameter = [[0.0; MAX_PARAMETERS]; 2];
        (by_parameter[0][0], by_parameter[0][2]) = (x, 1.0);
        (by_parameter[1][1], by_parameter[1][3]) = (y, 1.0);
        Some(Projection {
            pixel: [p[0] * x + p[2], p[1] * y + p[3]],
            by_point: [[p[0] * w, 0.0, -p[0] * w * x], [0.0, p[1] * w, -p[1] * w * y]],
            by_parameter,
        })
    }
}

/// The radial factor of a Brown-type model at `r2`: value, derivative to `r2`, and derivative to each of its coefficients.
struct Radial<const N: usize> {
    value: f64,
    by_r2: f64,
    by_coefficient: [f64; N],
}

/// `x_d = x g + 2 p1 x y + p2 (r2 + 2 x^2)`, `y_d = y g + p1 (r2 + 2 y^2) + 2 p2 x y`: all that Brown and Rational share.
#[inline(always)]
fn brown_with_derivatives<const N: usize>(
    p: &[f64; MAX_PARAMETERS],
    point: &[f64; 3],
    radial: impl Fn(f64) -> Radial<N>,
    radial_places: [usize; N],
) -> Option<Projection> {
    if point[2] < NEAREST {
        return None;
    }
    let w = 1.0 / point[2];
    let (x, y) = (point[0] * w, point[1] * w);
    let r2 = x * x + y * y;
    let g = radial(r2);
    let (p1, p2) = (p[6], p[7]);
    let xd = x * g.value + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x);
    let yd = y * g.value + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y;
    let xx = g.value + 2.0 * x * x * g.by_r2 + 2.0 * p1 * y + 6.0 * p2 * x;
    let xy = 2.0 * x * y * g.by_r2 + 2.0 * p1 * x + 2.0 * p2 * y;
    let yy = g.value + 2.0 * y * y * g.by_r2 + 6.0 * p1 * y + 2.0 * p2 * x;
    let mut by_parameter = [[0.0; MAX_PARAMETERS]; 2];
    (by_parameter[0][0], by_parameter[0][2]) = (xd, 1.0);
    (by_parameter[1][1], by_parameter[1][3]) = (yd, 1.0);
    for (place, by) in radial_places.into_iter().zip(g.by_coefficient) {
        by_parameter[0][place] = p[0] * x * by;
        by_parameter[1][place] = p[1] * y * by;
    }
    (by_parameter[0][6], by_parameter[0][7]) = (p[0] * 2.0 * x * y, p[0] * (r2 + 2.0 * x * x));
    (by_parameter[1][6], by_parameter[1][7]) = (p[1] * (r2 + 2.0 * y * y), p[1] * 2.0 * x * y);
    // Chain rule through x = X/Z, y = Y/Z.
    let (ux, uy) = (p[0] * xx * w, p[0] * xy * w);
    let (vx, vy) = (p[1] * xy * w, p[1] * yy * w);
    Some(Projection {
        pixel: [p[0] * xd + p[2], p[1] * yd + p[3]],
        by_point: [[ux, uy, -(ux * x + uy * y)], [vx, vy, -(vx * x + vy * y)]],
        by_parameter,
    })
}

#[inline(always)]
fn brown_project(p: &[f64; MAX_PARAMETERS], point: &[f64; 3], radial: impl Fn(f64) -> f64) -> Option<[f64; 2]> {
    if point[2] < NEAREST {
        return None;
    }
    let (x, y) = (point[0] / point[2], point[1] / point[2]);
    let r2 = x * x + y * y;
    let g = radial(r2);
    let xd = x * g + 2.0 * p[6] * x * y + p[7] * (r2 + 2.0 * x * x);
    let yd = y * g + p[6] * (r2 + 2.0 * y * y) + 2.0 * p[7] * x * y;
    Some([p[0] * xd + p[2], p[1] * yd + p[3]])
}

impl Lens for Brown {
    const COUNT: usize = 9;

    #[inline(always)]
    fn project(p: &[f64; MAX_PARAMETERS], point: &[f64; 3]) -> Option<[f64; 2]> {
        brown_project(p, point, |r2| 1.0 + r2 * (p[4] + r2 * (p[5] + r2 * p[8])))
    }

    #[inline(always)]
    fn project_with_derivatives(p: &[f64; MAX_PARAMETERS], point: &[f64; 3]) -> Option<Projection> {
        let radial = |r2: f64| Radial {
            value: 1.0 + r2 * (p[4] + r2 * (p[5] + r2 * p[8])),
            by_r2: p[4] + r2 * (2.0 * p[5] + r2 * 3.0 * p[8]),
            by_coefficient: [r2, r2 * r2, r2 * r2 * r2],
        };
        brown_with_derivatives(p, point, radial, [4, 5, 8])
    }
}

impl Lens for Rational {
    const COUNT: usize = 12;

    #[inline(always)]
    fn project(p: &[f64; MAX_PARAMETERS], point: &[f64; 3]) -> Option<[f64; 2]> {
        brown_project(p, point, |r2| {
            (1.0 + r2 * (p[4] + r2 * (p[5] + r2 * p[8]))) / (1.0 + r2 * (p[9] + r2 * (p[10] + r2 * p[11])))
        })
    }

    #[inline(always)]
    fn project_with_derivatives(p: &[f64; MAX_PARAMETERS], point: &[f64; 3]) -> Option<Projection> {
        let radial = |r2: f64| {
            let top = 1.0 + r2 * (p[4] + r2 * (p[5] + r2 * p[8]));
            let bottom = 1.0 + r2 * (p[9] + r2 * (p[10] + r2 * p[11]));
            let top_slope = p[4] + r2 * (2.0 * p[5] + r2 * 3.0 * p[8]);
            let bottom_slope = p[9] + r2 * (2.0 * p[10] + r2 * 3.0 * p[11]);
            let value = top / bottom;
            let powers = [r2, r2 * r2, r2 * r2 * r2];
            Radial {
                value,
                by_r2: (top_slope - value * bottom_slope) / bottom,
                by_coefficient: [
                    powers[0] / bottom,
                    powers[1] / bottom,
                    powers[2] / bottom,
                    -value * powers[0] / bottom,
                    -value * powers[1] / bottom,
                    -value * powers[2] / bottom,
                ],
            }
        };
        brown_with_derivatives(p, point, radial, [4, 5, 8, 9, 10, 11])
    }
}

impl Lens for KannalaBrandt {
    const COUNT: usize = 8;

    #[inline(always)]
    fn project(p: &[f64; MAX_PARAMETERS], point: &[f64; 3]) -> Option<[f64; 2]> {
        let rho = point[0].hypot(point[1]);
        if point[2] < NEAREST && rho < NEAREST {
            return None;
        }
        let scale = if rho < NEAREST {
            1.0 / point[2]
        } else {
            let angle = rho.atan2(point[2]);
            let t = angle * angle;
            angle * (1.0 + t * (p[4] + t * (p[5] + t * (p[6] + t * p[7])))) / rho
        };
        Some([p[0] * point[0] * scale + p[2], p[1] * point[1] * scale + p[3]])
    }

    #[inline(always)]
    fn project_with_derivatives(p: &[f64; MAX_PARAMETERS], point: &[f64; 3]) -> Option<Projection> {
        let [x, y, z] = *point;
        let rho2 = x * x + y * y;
        let rho = rho2.sqrt();
        if rho < NEAREST {
            // On the axis the model is the pinhole camera, derivatives included.
            return Pinhole::project_with_derivatives(p, point);
        }
        let angle = rho.atan2(z);
        let t = angle * angle;
        let bent = angle * (1.0 + t * (p[4] + t * (p[5] + t * (p[6] + t * p[7]))));
        let slope = 1.0 + t * (3.0 * p[4] + t * (5.0 * p[5] + t * (7.0 * p[6] + t * 9.0 * p[7])));
        let scale = bent / rho;
        let squared = rho2 + z * z;
        // d angle / d(x, y, z) = (x z / (rho R2), y z / (rho R2), -rho / R2)
        let by_rho = slope * z / (squared * rho) - scale / rho;
        let (scale_x, scale_y, scale_z) = (by_rho * x / rho, by_rho * y / rho, -slope / squared);
        let mut by_parameter = [[0.0; MAX_PARAMETERS]; 2];
        (by_parameter[0][0], by_parameter[0][2]) = (x * scale, 1.0);
        (by_parameter[1][1], by_parameter[1][3]) = (y * scale, 1.0);
        let mut power = angle * t / rho;
        let [by_u, by_v] = &mut by_parameter;
        for (u, v) in by_u[4..8].iter_mut().zip(&mut by_v[4..8]) {
            *u = p[0] * x * power;
            *v = p[1] * y * power;
            power *= t;
        }
        Some(Projection {
            pixel: [p[0] * x * scale + p[2], p[1] * y * scale + p[3]],
            by_point: [
                [p[0] * (scale + x * scale_x), p[0] * x * scale_y, p[0] * x * scale_z],
                [p[1] * y * scale_x, p[1] * (scale + y * scale_y), p[1] * y * scale_z],
            ],
            by_parameter,
        })
    }
}

/// Calls `$body` with `$lens` bound to the type of `$model`: the one place where the value becomes a type.
macro_rules! with_lens {
    ($model:expr, $lens:ident => $body:expr) => {
        match $model {
            $crate::geometry::lens::LensModel::Pinhole => {
                type $lens = $crate::geometry::lens::Pinhole;
                $body
            }
            $crate::geometry::lens::LensModel::Brown => {
                type $lens = $crate::geometry::lens::Brown;
                $body
            }
            $crate::geometry::lens::LensModel::Rational => {
                type $lens = $crate::geometry::lens::Rational;
                $body
            }
            $crate::geometry::lens::LensModel::KannalaBrandt => {
                type $lens = $crate::geometry::lens::KannalaBrandt;
                $body
            }
        }
    };
}
pub(crate) use with_lens;
