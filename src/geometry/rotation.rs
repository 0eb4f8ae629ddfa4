//! The rotation group SO(3): exponential, logarithm and the Jacobians of both.
//!
//! Formulas: T. D. Barfoot, *State Estimation for Robotics*, 2nd ed. 2024, chapter 8. Every coefficient that cancels
//! near zero switches to its Taylor series below [`SERIES_ANGLE`], where the closed form would lose digits.

use nalgebra::{Matrix3, Quaternion, Unit, UnitQuaternion, Vector3};

/// Below this angle (rad) series replace closed forms: with six terms they are exact to the last bit there,
/// while `(2 t - 3 sin t + t cos t) / 2 t^5` has already lost four digits.
pub(crate) const SERIES_ANGLE: f64 = 0.5;

/// The cross-product matrix of `v`: `skew(v) * w == v.cross(&w)`.
#[must_use]
pub fn skew(v: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -v.z, v.y, v.z, 0.0, -v.x, -v.y, v.x, 0.0)
}

/// The rotation by `|rotation_vector|` radians about the direction of `rotation_vector`.
#[must_use]
pub fn exp(rotation_vector: &Vector3<f64>) -> UnitQuaternion<f64> {
    let angle = rotation_vector.norm();
    let half = 0.5 * angle;
    // sin(t/2)/t is even in t, so its series needs no care about the sign of the axis.
    let scale = if angle < 1e-4 { 0.5 - angle * angle / 48.0 } else { half.sin() / angle };
    let v = rotation_vector * scale;
    Unit::new_normalize(Quaternion::new(half.cos(), v.x, v.y, v.z))
}

/// The rotation vector (rad) of smallest length whose [`exp`] is `rotation`; its length is at most pi.
#[must_use]
pub fn log(rotation: &UnitQuaternion<f64>) -> Vector3<f64> {
    let q = rotation.quaternion();
    // q and -q are the same rotation; the one with a positive real part has the shorter vector.
    let (w, v) = if q.w < 0.0 { (-q.w, -q.imag()) } else { (q.w, q.imag()) };
    let n = v.norm();
    if n < 1e-9 { v * 2.0 } else { v * (2.0 * n.atan2(w) / n) }
}

/// The left Jacobian: `Exp(v + d) = Exp(J_l(v) d) Exp(v)` to first order.
#[must_use]
pub fn left_jacobian(v: &Vector3<f64>) -> Matrix3<f64> {
    let w = skew(v);
    let (first, second) = jacobian_coefficients(v.norm());
    Matrix3::identity() + w * first + w * w * second
}

/// The right Jacobian: `Exp(v + d) = Exp(v) Exp(J_r(v) d)` to first order.
#[must_use]
pub fn right_jacobian(v: &Vector3<f64>) -> Matrix3<f64> {
    left_jacobian(&-v)
}

/// The inverse of [`left_jacobian`], finite for angles below 2 pi.
#[must_use]
pub fn left_jacobian_inverse(v: &Vector3<f64>) -> Matrix3<f64> {
    let w = skew(v);
    let angle = v.norm();
    let second = if angle < 1e-2 {
        let t = angle * angle;
        1.0 / 12.0 + t / 720.0 + t * t / 30240.0
    } else {
        1.0 / (angle * angle) - 1.0 / (2.0 * angle * (0.5 * angle).tan())
    };
    Matrix3::identity() - w * 0.5 + w * w * second
}

/// The inverse of [`right_jacobian`].
#[must_use]
pub fn right_jacobian_inverse(v: &Vector3<f64>) -> Matrix3<f64> {
    left_jacobian_inverse(&-v)
}

/// `((1 - cos t) / t^2, (t - sin t) / t^3)`.
fn jacobian_coefficients(angle: f64) -> (f64, f64) {
    let t = angle * angle;
    if angle < SERIES_ANGLE {
        let first = alternating_series(t, [2.0, 24.0, 720.0, 40_320.0, 3_628_800.0, 479_001_600.0]);
        let second = alternating_series(t, [6.0, 120.0, 5_040.0, 362_880.0, 39_916_800.0, 6_227_020_800.0]);
        (first, second)
    } else {
        ((1.0 - angle.cos()) / t, (angle - angle.sin()) / (t * angle))
    }
}

/// `1/d0 - t/d1 + t^2/d2 - ...`, smallest terms first so that nothing is lost in the sum.
pub(crate) fn alternating_series(t: f64, denominators: [f64; 6]) -> f64 {
    denominators.iter().rev().fold(0.0, |sum, d| 1.0 / d - t * sum)
}

/// The rotation matrix nearest to `matrix` in the Frobenius norm (SVD, determinant forced to +1).
/// Returns `None` when `matrix` has no direction to speak of (two singular values vanish or entries are not finite).
#[must_use]
pub fn nearest_rotation(matrix: &Matrix3<f64>) -> Option<UnitQuaternion<f64>> {
    if !matrix.iter().all(|x| x.is_finite()) {
        return None;
    }
    let svd = matrix.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| svd.singular_values[*b].total_cmp(&svd.singular_values[*a]));
    if svd.singular_values[order[1]] <= 1e-12 * svd.singular_values[order[0]].max(f64::MIN_POSITIVE) {
        return None;
    }
    let mut signs = Vector3::repeat(1.0);
    signs[order[2]] = (u.determinant() * v_t.determinant()).signum();
    let rotation = u * Matrix3::from_diagonal(&signs) * v_t;
    Some(from_matrix(&rotation))
}

/// The rotation of URDF's `rpy`: about the fixed x, then y, then z axis (rad), `Rz(yaw) Ry(pitch) Rx(roll)`.
#[must_use]
pub fn from_rpy([roll, pitch, yaw]: [f64; 3]) -> UnitQuaternion<f64> {
    UnitQuaternion::from_euler_angles(roll, pitch, yaw)
}

/// URDF's `rpy` of a rotation (rad): the inverse of [`from_rpy`].
///
/// Yaw is taken first and divided out, so that roll and pitch come from entries of full size: straight up and down, where the usual formula loses half
/// its digits, the three still compose to the rotation within rounding.
///
/// ```
/// use cellmap::geometry::rotation::{from_rpy, to_rpy};
/// let steep = from_rpy([0.4, std::f64::consts::FRAC_PI_2, 0.1]);
/// assert!(steep.angle_to(&from_rpy(to_rpy(&steep))) < 1e-12);
/// ```
#[must_use]
pub fn to_rpy(rotation: &UnitQuaternion<f64>) -> [f64; 3] {
    let r = rotation.to_rotation_matrix().into_inner();
    let yaw = if r[(0, 0)].hypot(r[(1, 0)]) < 1e-9 { 0.0 } else { r[(1, 0)].atan2(r[(0, 0)]) };
    let (sin, cos) = yaw.sin_cos();
    // Rz(-yaw) R = Ry(pitch) Rx(roll).
    let top = cos * r[(0, 0)] + sin * r[(1, 0)];
    let middle = |column: usize| cos * r[(1, column)] - sin * r[(0, column)];
    let pitch = (-r[(2, 0)]).atan2(top);
    let roll = (-middle(2)).atan2(middle(1));
    [roll, pitch, yaw]
}

/// The unit quaternion of an orthonormal right-handed matrix.
#[must_use]
pub fn from_matrix(matrix: &Matrix3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::from_rotation_matrix(&nalgebra::Rotation3::from_matrix_unchecked(*matrix))
}
