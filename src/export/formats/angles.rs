//! Three angles of a rotation, well conditioned everywhere.

use crate::geometry::Pose;

/// URDF's roll, pitch and yaw (rad): `R = Rz(yaw) Ry(pitch) Rx(roll)`.
///
/// Yaw is taken first and divided out, so that roll and pitch come from entries of full size: straight up and down, where the usual formula loses half
/// its digits, the three still compose to the rotation within rounding.
///
/// ```
/// use cellmap::export::formats::angles::roll_pitch_yaw;
/// use cellmap::geometry::{Pose, rotation};
/// let pose = Pose { rotation: rotation::from_rpy([0.4, std::f64::consts::FRAC_PI_2, 0.1]), ..Pose::identity() };
/// let again = rotation::from_rpy(roll_pitch_yaw(&pose));
/// assert!(pose.rotation.angle_to(&again) < 1e-12);
/// ```
#[must_use]
pub fn roll_pitch_yaw(pose: &Pose) -> [f64; 3] {
    let r = pose.rotation_matrix();
    let yaw = if r[(0, 0)].hypot(r[(1, 0)]) < 1e-9 { 0.0 } else { r[(1, 0)].atan2(r[(0, 0)]) };
    let (sin, cos) = yaw.sin_cos();
    // Rz(-yaw) R = Ry(pitch) Rx(roll).
    let top = cos * r[(0, 0)] + sin * r[(1, 0)];
    let middle = |column: usize| cos * r[(1, column)] - sin * r[(0, column)];
    let pitch = (-r[(2, 0)]).atan2(top);
    let roll = (-middle(2)).atan2(middle(1));
    [roll, pitch, yaw]
}

/// The shortest text that is read back as the same number, with what is nothing but rounding written as 0.
#[must_use]
pub(super) fn number(value: f64) -> String {
    if value.abs() < 1e-15 { "0".to_owned() } else { value.to_string() }
}

/// Numbers with something between them.
#[must_use]
pub(super) fn numbers(values: &[f64], between: &str) -> String {
    values.iter().map(|value| number(*value)).collect::<Vec<_>>().join(between)
}
