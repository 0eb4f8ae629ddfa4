//! The lens models on whole registers of points; the formulas are those of [`crate::geometry::lens`], which says where they are from.
//!
//! A point that the camera cannot see gives finite numbers that mean nothing, and is told by the mask.

use pulp::Simd;

use super::lanes::{Lanes, Splat, Truths};
use crate::geometry::lens::{Brown, KannalaBrandt, Lens, MAX_PARAMETERS, Pinhole, Rational};

/// Projections of a register of points.
pub(super) struct Projected<S: Simd> {
    /// Which of them the camera sees.
    pub seen: Truths<S>,
    pub pixel: [Lanes<S>; 2],
}

/// As [`Projected`], with derivatives.
pub(super) struct Differentiated<S: Simd> {
    pub seen: Truths<S>,
    pub pixel: [Lanes<S>; 2],
    /// d(u, v) / d(point).
    pub by_point: [[Lanes<S>; 3]; 2],
    /// d(u, v) / d(parameter); zero past the model's count.
    pub by_parameter: [[Lanes<S>; MAX_PARAMETERS]; 2],
}

/// A lens model on registers.
pub(super) trait LensLanes: Lens {
    fn project_lanes<S: Simd>(simd: S, p: &[f64; MAX_PARAMETERS], point: [Lanes<S>; 3]) -> Projected<S>;
    fn differentiate_lanes<S: Simd>(simd: S, p: &[f64; MAX_PARAMETERS], point: [Lanes<S>; 3]) -> Differentiated<S>;
}

/// As in [`crate::geometry::lens`].
const NEAREST: f64 = 1e-9;
/// The last depth that is too near.
const TOO_NEAR: f64 = NEAREST.next_down();

/// Which points lie before the lens, one over their depth (of one metre for the others), and (x/z, y/z).
#[inline(always)]
fn normalised<S: Simd>(simd: S, point: [Lanes<S>; 3]) -> (Truths<S>, Lanes<S>, [Lanes<S>; 2]) {
    let one = Lanes::splat(simd, 1.0);
    // A depth that is not a number is not beyond the nearest.
    let seen = Lanes::splat(simd, TOO_NEAR).less(point[2]);
    let w = one.over(seen.choose(point[2], one));
    (seen, w, [point[0] * w, point[1] * w])
}

impl LensLanes for Pinhole {
    #[inline(always)]
    fn project_lanes<S: Simd>(simd: S, p: &[f64; MAX_PARAMETERS], point: [Lanes<S>; 3]) -> Projected<S> {
        let n = Splat(simd);
        let (seen, _, [x, y]) = normalised(simd, point);
        Projected { seen, pixel: [x.times_plus(n.of(p[0]), n.of(p[2])), y.times_plus(n.of(p[1]), n.of(p[3]))] }
    }

    #[inline(always)]
    fn differentiate_lanes<S: Simd>(simd: S, p: &[f64; MAX_PARAMETERS], point: [Lanes<S>; 3]) -> Differentiated<S> {
        let n = Splat(simd);
        let (seen, w, [x, y]) = normalised(simd, point);
        let (zero, one) = (n.of(0.0), n.of(1.0));
        let mut by_parameter = [[zero; MAX_PARAMETERS]; 2];
        (by_parameter[0][0], by_parameter[0][2]) = (x, one);
        (by_parameter[1][1], by_parameter[1][3]) = (y, one);
        let (fx, fy) = (n.of(p[0]) * w, n.of(p[1]) * w);
        Differentiated {
            seen,
            pixel: [x.times_plus(n.of(p[0]), n.of(p[2])), y.times_plus(n.of(p[1]), n.of(p[3]))],
            by_point: [[fx, zero, -(fx * x)], [zero, fy, -(fy * y)]],
            by_parameter,
        }
    }
}

/// The radial factor of a Brown-type model: value, derivative to `r2`, and derivative to each of its coefficients.
struct Radial<S: Simd, const N: usize> {
    value: Lanes<S>,
    by_r2: Lanes<S>,
    by_coefficient: [Lanes<S>; N],
}

/// `c0 + t (c1 + t (c2 + t c3))`.
#[inline(always)]
fn cubic<S: Simd>(t: Lanes<S>, c: [f64; 4]) -> Lanes<S> {
    let inner = t.times_plus(t.like(c[3]), t.like(c[2]));
    let middle = t.times_plus(inner, t.like(c[1]));
    t.times_plus(middle, t.like(c[0]))
}

/// `c0 + t (c1 + t c2)`.
#[inline(always)]
fn square<S: Simd>(t: Lanes<S>, c: [f64; 3]) -> Lanes<S> {
    t.times_plus(t.times_plus(t.like(c[2]), t.like(c[1])), t.like(c[0]))
}

/// The distorted point.
#[inline(always)]
fn bend<S: Simd>(p: &[f64; MAX_PARAMETERS], [x, y]: [Lanes<S>; 2], r2: Lanes<S>, radial: Lanes<S>) -> [Lanes<S>; 2] {
    let (p1, p2, xy) = (x.like(p[6]), x.like(p[7]), x * y);
    let xx = (x + x).times_plus(x, r2);
    let yy = (y + y).times_plus(y, r2);
    [x.times_plus(radial, (p1 + p1).times_plus(xy, p2 * xx)), y.times_plus(radial, p1.times_plus(yy, (p2 + p2) * xy))]
}

/// A Brown-type model: a radial factor beside Brown's tangential part.
trait Radially {
    /// The factor, for the squared distance from the axis.
    fn factor<S: Simd>(p: &[f64; MAX_PARAMETERS], r2: Lanes<S>) -> Lanes<S>;
}

#[inline(always)]
fn brown_project<L: Radially, S: Simd>(simd: S, p: &[f64; MAX_PARAMETERS], point: [Lanes<S>; 3]) -> Projected<S> {
    let n = Splat(simd);
    let (seen, _, [x, y]) = normalised(simd, point);
    let r2 = x.times_plus(x, y * y);
    let [xd, yd] = bend(p, [x, y], r2, L::factor(p, r2));
    Projected { seen, pixel: [xd.times_plus(n.of(p[0]), n.of(p[2])), yd.times_plus(n.of(p[1]), n.of(p[3]))] }
}

/// The rest of the derivatives, from the radial factor `g` of the normalised point `at`.
#[inline(always)]
fn brown_derivatives<S: Simd, const N: usize>(
    simd: S,
    p: &[f64; MAX_PARAMETERS],
    (seen, w, [x, y]): (Truths<S>, Lanes<S>, [Lanes<S>; 2]),
    r2: Lanes<S>,
    g: &Radial<S, N>,
    places: [usize; N],
) -> Differentiated<S> {
    let n = Splat(simd);
    let [xd, yd] = bend(p, [x, y], r2, g.value);
    let (fx, fy) = (n.of(p[0]), n.of(p[1]));
    let (p1x, p1y, p2x, p2y) = (n.of(p[6]) * x, n.of(p[6]) * y, n.of(p[7]) * x, n.of(p[7]) * y);
    let slope = g.by_r2 + g.by_r2;
    let xx = (x * x).times_plus(slope, g.value) + 2.0 * p1y + 6.0 * p2x;
    let xy = (x * y).times_plus(slope, 2.0 * (p1x + p2y));
    let yy = (y * y).times_plus(slope, g.value) + 6.0 * p1y + 2.0 * p2x;
    let mut by_parameter = [[n.of(0.0); MAX_PARAMETERS]; 2];
    (by_parameter[0][0], by_parameter[0][2]) = (xd, n.of(1.0));
    (by_parameter[1][1], by_parameter[1][3]) = (yd, n.of(1.0));
    let (x_px, y_px) = (fx * x, fy * y);
    for i in 0..N {
        by_parameter[0][places[i]] = x_px * g.by_coefficient[i];
        by_parameter[1][places[i]] = y_px * g.by_coefficient[i];
    }
    let double_xy = 2.0 * (x * y);
    (by_parameter[0][6], by_parameter[0][7]) = (fx * double_xy, fx * (x + x).times_plus(x, r2));
    (by_parameter[1][6], by_parameter[1][7]) = (fy * (y + y).times_plus(y, r2), fy * double_xy);
    let pixel = [xd.times_plus(fx, n.of(p[2])), yd.times_plus(fy, n.of(p[3]))];
    let (fx, fy) = (fx * w, fy * w);
    let (ux, uy, vx, vy) = (fx * xx, fx * xy, fy * xy, fy * yy);
    Differentiated {
        seen,
        pixel,
        by_point: [[ux, uy, -ux.times_plus(x, uy * y)], [vx, vy, -vx.times_plus(x, vy * y)]],
        by_parameter,
    }
}

impl Radially for Brown {
    #[inline(always)]
    fn factor<S: Simd>(p: &[f64; MAX_PARAMETERS], r2: Lanes<S>) -> Lanes<S> {
        cubic(r2, [1.0, p[4], p[5], p[8]])
    }
}

impl LensLanes for Brown {
    #[inline(always)]
    fn project_lanes<S: Simd>(simd: S, p: &[f64; MAX_PARAMETERS], point: [Lanes<S>; 3]) -> Projected<S> {
        brown_project::<Self, S>(simd, p, point)
    }

    #[inline(always)]
    fn differentiate_lanes<S: Simd>(simd: S, p: &[f64; MAX_PARAMETERS], point: [Lanes<S>; 3]) -> Differentiated<S> {
        let (seen, w, [x, y]) = normalised(simd, point);
        let r2 = x.times_plus(x, y * y);
        let r4 = r2 * r2;
        let radial = Radial {
            value: Self::factor(p, r2),
            by_r2: square(r2, [p[4], 2.0 * p[5], 3.0 * p[8]]),
            by_coefficient: [r2, r4, r4 * r2],
        };
        brown_derivatives(simd, p, (seen, w, [x, y]), r2, &radial, [4, 5, 8])
    }
}

impl Radially for Rational {
    #[inline(always)]
    fn factor<S: Simd>(p: &[f64; MAX_PARAMETERS], r2: Lanes<S>) -> Lanes<S> {
        cubic(r2, [1.0, p[4], p[5], p[8]]) * r2.like(1.0).over(cubic(r2, [1.0, p[9], p[10], p[11]]))
    }
}

impl LensLanes for Rational {
    #[inline(always)]
    fn project_lanes<S: Simd>(simd: S, p: &[f64; MAX_PARAMETERS], point: [Lanes<S>; 3]) -> Projected<S> {
        brown_project::<Self, S>(simd, p, point)
    }

    #[inline(always)]
    fn differentiate_lanes<S: Simd>(simd: S, p: &[f64; MAX_PARAMETERS], point: [Lanes<S>; 3]) -> Differentiated<S> {
        let (seen, w, [x, y]) = normalised(simd, point);
        let r2 = x.times_plus(x, y * y);
        let inverse = r2.like(1.0).over(cubic(r2, [1.0, p[9], p[10], p[11]]));
        let value = cubic(r2, [1.0, p[4], p[5], p[8]]) * inverse;
        let top_slope = square(r2, [p[4], 2.0 * p[5], 3.0 * p[8]]);
        let bottom_slope = square(r2, [p[9], 2.0 * p[10], 3.0 * p[11]]);
        let first = r2 * inverse;
        let (second, third) = (first * r2, first * r2 * r2);
        let radial = Radial {
            value,
            by_r2: (top_slope - value * bottom_slope) * inverse,
            by_coefficient: [first, second, third, -(value * first), -(value * second), -(value * third)],
        };
        brown_derivatives(simd, p, (seen, w, [x, y]), r2, &radial, [4, 5, 8, 9, 10, 11])
    }
}

/// What a fisheye makes of a register of points.
struct Bent<S: Simd> {
    seen: Truths<S>,
    /// Which points are off the axis; the others are a pinhole's.
    off_axis: Truths<S>,
    /// Distance from the axis, of one metre for points on it.
    rho: Lanes<S>,
    angle: Lanes<S>,
    /// `bent angle / rho`, or `1 / z` on the axis.
    scale: Lanes<S>,
}

#[inline(always)]
fn fisheye<S: Simd>(simd: S, p: &[f64; MAX_PARAMETERS], [x, y, z]: [Lanes<S>; 3]) -> Bent<S> {
    let n = Splat(simd);
    let (zero, one, nearest) = (n.of(0.0), n.of(1.0), n.of(NEAREST));
    let squared = x.times_plus(x, y * y);
    let off_axis = nearest.less(squared.root());
    let rho = off_axis.choose(squared.root(), one);
    let angle = rho.each(z, f64::atan2);
    let t = angle * angle;
    let series = t.times_plus(cubic(t, [p[4], p[5], p[6], p[7]]), one);
    let before = nearest.less(z);
    let on_axis = one.over(before.choose(z, one));
    // Off the axis everything is seen; on it, what lies before the lens. A point that is not a number is on neither side.
    let seen = zero.less(off_axis.choose(one, before.choose(one, zero)));
    Bent { seen, off_axis, rho, angle, scale: off_axis.choose((angle * series).over(rho), on_axis) }
}

impl LensLanes for KannalaBrandt {
    #[inline(always)]
    fn project_lanes<S: Simd>(simd: S, p: &[f64; MAX_PARAMETERS], point: [Lanes<S>; 3]) -> Projected<S> {
        let n = Splat(simd);
        let Bent { seen, scale, .. } = fisheye(simd, p, point);
        let pixel = [
            (point[0] * scale).times_plus(n.of(p[0]), n.of(p[2])),
            (point[1] * scale).times_plus(n.of(p[1]), n.of(p[3])),
        ];
        Projected { seen, pixel }
    }

    #[inline(always)]
    fn differentiate_lanes<S: Simd>(simd: S, p: &[f64; MAX_PARAMETERS], point: [Lanes<S>; 3]) -> Differentiated<S> {
        let n = Splat(simd);
        let [x, y, z] = point;
        let (zero, one) = (n.of(0.0), n.of(1.0));
        let Bent { seen, off_axis, rho, angle, scale } = fisheye(simd, p, point);
        let t = angle * angle;
        let slope = t.times_plus(cubic(t, [3.0 * p[4], 5.0 * p[5], 7.0 * p[6], 9.0 * p[7]]), one);
        let inverse_rho = one.over(rho);
        let inverse_squared = one.over(off_axis.choose(rho.times_plus(rho, z * z), one));
        let by_rho = slope * z * inverse_squared * inverse_rho - scale * inverse_rho;
        let across = off_axis.choose(by_rho * inverse_rho, zero);
        let (scale_x, scale_y) = (across * x, across * y);
        // On the axis the model is the pinhole camera: d(1 / z) / dz.
        let scale_z = off_axis.choose(-(slope * inverse_squared), -(scale * scale));
        let mut by_parameter = [[zero; MAX_PARAMETERS]; 2];
        (by_parameter[0][0], by_parameter[0][2]) = (x * scale, one);
        (by_parameter[1][1], by_parameter[1][3]) = (y * scale, one);
        let (fx, fy) = (n.of(p[0]), n.of(p[1]));
        let mut power = off_axis.choose(angle * t * inverse_rho, zero);
        let [by_u, by_v] = &mut by_parameter;
        for (u, v) in by_u[4..8].iter_mut().zip(&mut by_v[4..8]) {
            *u = fx * x * power;
            *v = fy * y * power;
            power = power * t;
        }
        Differentiated {
            seen,
            pixel: [(x * scale).times_plus(fx, n.of(p[2])), (y * scale).times_plus(fy, n.of(p[3]))],
            by_point: [
                [fx * x.times_plus(scale_x, scale), fx * x * scale_y, fx * x * scale_z],
                [fy * y * scale_x, fy * y.times_plus(scale_y, scale), fy * y * scale_z],
            ],
            by_parameter,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::lens::Projection;

    /// The register form against the scalar one, on whatever this machine has, on the registers one step narrower, and on plain numbers.
    fn compare<L: LensLanes>(parameters: &[f64; MAX_PARAMETERS]) {
        struct Task<'a, L>(&'a [f64; MAX_PARAMETERS], std::marker::PhantomData<L>);
        impl<L: LensLanes> pulp::WithSimd for Task<'_, L> {
            type Output = ();
            fn with_simd<S: Simd>(self, simd: S) {
                let points = [
                    [0.1, -0.2, 0.9],
                    [0.0, 0.0, 1.0],
                    [-0.4, 0.3, 0.5],
                    [0.01, 0.02, -0.5],
                    [0.0, 0.0, -1.0],
                    [1e-12, 0.0, 0.7],
                    [0.3, 0.3, 1e-10],
                    [f64::NAN, 0.1, 1.0],
                    [0.1, 0.1, f64::NAN],
                ];
                for point in points {
                    let wide = point.map(|x| Lanes::splat(simd, x));
                    let (zero, one) = (Lanes::splat(simd, 0.0), Lanes::splat(simd, 1.0));
                    let at = L::differentiate_lanes(simd, self.0, wide);
                    let plain = L::project_lanes(simd, self.0, wide);
                    let mean = |lanes: Lanes<S>| lanes.sum() / S::F64_LANES as f64;
                    let seen = mean(at.seen.choose(one, zero)) == 1.0;
                    assert_eq!(seen, mean(plain.seen.choose(one, zero)) == 1.0);
                    if point.iter().any(|x| x.is_nan()) {
                        continue;
                    }
                    let expected = L::project_with_derivatives(self.0, &point);
                    assert_eq!(seen, expected.is_some(), "{point:?}");
                    let Some(Projection { pixel, by_point, by_parameter }) = expected else { continue };
                    let near = |found: Lanes<S>, expected: f64| {
                        let found = mean(found);
                        assert!(
                            (found - expected).abs() <= 1e-11 * (1.0 + expected.abs()),
                            "{point:?} {found} {expected}"
                        );
                    };
                    for axis in 0..2 {
                        near(at.pixel[axis], pixel[axis]);
                        near(plain.pixel[axis], pixel[axis]);
                        (0..3).for_each(|i| near(at.by_point[axis][i], by_point[axis][i]));
                        (0..MAX_PARAMETERS).for_each(|i| near(at.by_parameter[axis][i], by_parameter[axis][i]));
                    }
                }
            }
        }
        pulp::Arch::new().dispatch(Task::<L>(parameters, std::marker::PhantomData));
        // A machine with AVX-512 has the narrower registers too.
        #[cfg(target_arch = "x86_64")]
        if let Some(simd) = pulp::x86::V3::try_new() {
            Simd::vectorize(simd, Task::<L>(parameters, std::marker::PhantomData));
        }
        pulp::WithSimd::with_simd(Task::<L>(parameters, std::marker::PhantomData), pulp::Scalar);
    }

    #[test]
    fn registers_and_scalars_agree() {
        let with = |distortion: &[f64]| {
            let mut all = [0.0; MAX_PARAMETERS];
            all[..4].copy_from_slice(&[900.0, 905.0, 640.0, 479.0]);
            all[4..4 + distortion.len()].copy_from_slice(distortion);
            all
        };
        compare::<Pinhole>(&with(&[]));
        compare::<Brown>(&with(&[0.1, -0.2, 0.001, -0.002, 0.05]));
        compare::<Rational>(&with(&[0.1, 0.02, 0.001, -0.001, 0.01, 0.2, 0.03, 0.001]));
        compare::<KannalaBrandt>(&with(&[0.01, -0.01, 0.004, 0.001]));
    }
}
