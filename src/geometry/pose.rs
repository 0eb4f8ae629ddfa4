//! Rigid transforms: the group SE(3) with exponential, logarithm, adjoint and Jacobians.
//!
//! A [`Pose`] named `a_from_b` maps points of frame `b` into frame `a`: `p_a = a_from_b * p_b`. Names cancel when
//! composed, `a_from_c = a_from_b * b_from_c`. Twists are ordered (translation, rotation).

use nalgebra::{Matrix3, Matrix6, UnitQuaternion, Vector3, Vector6};
use std::ops::Mul;

use super::rotation::{self, SERIES_ANGLE, alternating_series, skew};

/// A tangent vector of SE(3): three translational components (m), then three rotational ones (rad).
pub type Twist = Vector6<f64>;

/// A rigid transform `a_from_b`: rotation first, then translation (m), `p_a = R p_b + t`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// The rotation `a_from_b`.
    pub rotation: UnitQuaternion<f64>,
    /// The origin of `b` in `a`, metres.
    pub translation: Vector3<f64>,
}

impl Default for Pose {
    fn default() -> Self {
        Self::identity()
    }
}

impl Pose {
    /// The transform that changes nothing.
    #[must_use]
    pub fn identity() -> Self {
        Self { rotation: UnitQuaternion::identity(), translation: Vector3::zeros() }
    }

    /// A transform from its two parts.
    #[must_use]
    pub fn new(rotation: UnitQuaternion<f64>, translation: Vector3<f64>) -> Self {
        Self { rotation, translation }
    }

    /// A pure translation by `(x, y, z)` metres.
    #[must_use]
    pub fn from_translation(x: f64, y: f64, z: f64) -> Self {
        Self { rotation: UnitQuaternion::identity(), translation: Vector3::new(x, y, z) }
    }

    /// A pure rotation by a rotation vector (rad).
    #[must_use]
    pub fn from_rotation_vector(rotation_vector: &Vector3<f64>) -> Self {
        Self { rotation: rotation::exp(rotation_vector), translation: Vector3::zeros() }
    }

    /// The exponential of a twist: the motion at constant twist for unit time (Barfoot, eq. 8.33).
    #[must_use]
    pub fn exp(twist: &Twist) -> Self {
        let (rho, phi) = parts(twist);
        Self { rotation: rotation::exp(&phi), translation: rotation::left_jacobian(&phi) * rho }
    }

    /// The twist of smallest rotation whose [`Pose::exp`] is this pose.
    #[must_use]
    pub fn log(&self) -> Twist {
        let phi = rotation::log(&self.rotation);
        join(&(rotation::left_jacobian_inverse(&phi) * self.translation), &phi)
    }

    /// `b_from_a` of this `a_from_b`.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.inverse();
        Self { rotation, translation: -(rotation * self.translation) }
    }

    /// This pose perturbed on the right, `self * Exp(twist)`, with the quaternion normalised again so that
    /// any number of steps stays on the group.
    #[must_use]
    pub fn retract(&self, twist: &Twist) -> Self {
        let mut moved = *self * Self::exp(twist);
        moved.rotation.renormalize();
        moved
    }

    /// The rotation as a 3 x 3 matrix.
    #[must_use]
    pub fn rotation_matrix(&self) -> Matrix3<f64> {
        self.rotation.to_rotation_matrix().into_inner()
    }

    /// The 6 x 6 adjoint: `self * Exp(d) = Exp(self.adjoint() * d) * self`.
    #[must_use]
    pub fn adjoint(&self) -> Matrix6<f64> {
        let r = self.rotation_matrix();
        blocks(&r, &(skew(&self.translation) * r), &r)
    }

    /// The adjoint of the inverse, without forming the inverse.
    #[must_use]
    pub fn inverse_adjoint(&self) -> Matrix6<f64> {
        let r_t = self.rotation_matrix().transpose();
        blocks(&r_t, &(-r_t * skew(&self.translation)), &r_t)
    }

    /// The length of the translation (m) and the angle of the rotation (rad).
    #[must_use]
    pub fn magnitude(&self) -> (f64, f64) {
        (self.translation.norm(), rotation::log(&self.rotation).norm())
    }

    /// Whether every number is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.translation.iter().chain(self.rotation.coords.iter()).all(|x| x.is_finite())
    }
}

impl Mul for Pose {
    type Output = Self;
    fn mul(self, right: Self) -> Self {
        Self {
            rotation: self.rotation * right.rotation,
            translation: self.rotation * right.translation + self.translation,
        }
    }
}

impl Mul<Vector3<f64>> for Pose {
    type Output = Vector3<f64>;
    fn mul(self, point: Vector3<f64>) -> Vector3<f64> {
        self.rotation * point + self.translation
    }
}

/// The left Jacobian of SE(3): `Exp(x + d) = Exp(J_l(x) d) Exp(x)` to first order (Barfoot, eq. 8.91).
#[must_use]
pub fn left_jacobian(twist: &Twist) -> Matrix6<f64> {
    let (rho, phi) = parts(twist);
    let j = rotation::left_jacobian(&phi);
    blocks(&j, &coupling(&rho, &phi), &j)
}

/// The right Jacobian of SE(3): `Exp(x + d) = Exp(x) Exp(J_r(x) d)` to first order.
#[must_use]
pub fn right_jacobian(twist: &Twist) -> Matrix6<f64> {
    left_jacobian(&-twist)
}

/// The inverse of [`left_jacobian`].
#[must_use]
pub fn left_jacobian_inverse(twist: &Twist) -> Matrix6<f64> {
    let (rho, phi) = parts(twist);
    let j_inverse = rotation::left_jacobian_inverse(&phi);
    blocks(&j_inverse, &(-j_inverse * coupling(&rho, &phi) * j_inverse), &j_inverse)
}

/// The inverse of [`right_jacobian`].
#[must_use]
pub fn right_jacobian_inverse(twist: &Twist) -> Matrix6<f64> {
    left_jacobian_inverse(&-twist)
}

/// Barfoot's Q (eq. 8.91b): how the translational part of the left Jacobian depends on the rotation.
fn coupling(rho: &Vector3<f64>, phi: &Vector3<f64>) -> Matrix3<f64> {
    let angle = phi.norm();
    let t = angle * angle;
    let (b, c, d) = if angle < SERIES_ANGLE {
        (
            alternating_series(t, [6.0, 120.0, 5_040.0, 362_880.0, 39_916_800.0, 6_227_020_800.0]),
            alternating_series(t, [24.0, 720.0, 40_320.0, 3_628_800.0, 479_001_600.0, 87_178_291_200.0]),
            // (k + 1) / (2 k + 5)!
            alternating_series(t, [120.0, 2_520.0, 120_960.0, 9_979_200.0, 1_245_404_160.0, 217_945_728_000.0]),
        )
    } else {
        let (sin, cos) = angle.sin_cos();
        (
            (angle - sin) / (t * angle),
            (t + 2.0 * cos - 2.0) / (2.0 * t * t),
            (2.0 * angle - 3.0 * sin + angle * cos) / (2.0 * t * t * angle),
        )
    };
    let (r, p) = (skew(rho), skew(phi));
    let (pr, rp, prp) = (p * r, r * p, p * r * p);
    r * 0.5 + (pr + rp + prp) * b + (p * pr + rp * p - prp * 3.0) * c + (prp * p + p * prp) * d
}

/// The translational and rotational halves of a twist.
#[must_use]
pub fn parts(twist: &Twist) -> (Vector3<f64>, Vector3<f64>) {
    (twist.fixed_rows::<3>(0).into_owned(), twist.fixed_rows::<3>(3).into_owned())
}

/// A twist from its translational and rotational halves.
#[must_use]
pub fn join(translation: &Vector3<f64>, rotation: &Vector3<f64>) -> Twist {
    Twist::new(translation.x, translation.y, translation.z, rotation.x, rotation.y, rotation.z)
}

fn blocks(top_left: &Matrix3<f64>, top_right: &Matrix3<f64>, bottom_right: &Matrix3<f64>) -> Matrix6<f64> {
    let mut m = Matrix6::zeros();
    m.fixed_view_mut::<3, 3>(0, 0).copy_from(top_left);
    m.fixed_view_mut::<3, 3>(0, 3).copy_from(top_right);
    m.fixed_view_mut::<3, 3>(3, 3).copy_from(bottom_right);
    m
}
