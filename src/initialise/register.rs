//! Registering points: rigid fits, and a tracker to a robot whose tool point is unknown.

use nalgebra::{Matrix3, Vector3};

use crate::geometry::{Pose, rotation};

/// The rigid transform with `to = transform * from`, least squares (Kabsch 1976, Umeyama 1991); `None` for fewer than three pairs or
/// points on a line.
pub(super) fn rigid_fit(pairs: &[(Vector3<f64>, Vector3<f64>)]) -> Option<Pose> {
    if pairs.len() < 3 {
        return None;
    }
    let count = pairs.len() as f64;
    let from_centre = pairs.iter().map(|(from, _)| from).sum::<Vector3<f64>>() / count;
    let to_centre = pairs.iter().map(|(_, to)| to).sum::<Vector3<f64>>() / count;
    let cross: Matrix3<f64> = pairs.iter().map(|(from, to)| (to - to_centre) * (from - from_centre).transpose()).sum();
    let turn = rotation::nearest_rotation(&cross)?;
    Some(Pose::new(turn, to_centre - turn * from_centre))
}

/// One measured point on the far side of a robot.
#[derive(Clone, Copy, Debug)]
pub(super) struct RobotPoint {
    /// The robot's known transform `K`.
    pub(super) robot: Pose,
    /// Which of several unknown points.
    pub(super) point: usize,
    /// Where the sensor saw it.
    pub(super) measured: Vector3<f64>,
}

/// `X` and points `q` with `measured = X K q`, starting from `q = 0` (the flange itself) and alternating between a rigid fit and the mean of the points. A
/// tool is short against an arm's reach, so the start is good; the solver brings the last digits.
pub(super) fn register_robot(data: &[RobotPoint], points: usize) -> Option<(Pose, Vec<Vector3<f64>>)> {
    let mut places = vec![Vector3::zeros(); points];
    let mut near = Pose::identity();
    for round in 0..500 {
        let pairs: Vec<_> = data.iter().map(|d| (d.robot * places[d.point], d.measured)).collect();
        // All points in one place (a robot that only turned about its tool) leave the turn open: any will do to start.
        near = rigid_fit(&pairs).unwrap_or(near);
        let inverse = near.inverse();
        let mut sums = vec![(Vector3::zeros(), 0.0); points];
        for d in data {
            let (sum, count) = &mut sums[d.point];
            *sum += d.robot.inverse() * (inverse * d.measured);
            *count += 1.0;
        }
        let next: Vec<Vector3<f64>> = sums.iter().map(|(sum, count)| sum / f64::max(*count, 1.0)).collect();
        let change = next.iter().zip(&places).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        places = next;
        if round > 3 && change < 1e-6 {
            break;
        }
    }
    (near.is_finite() && places.iter().all(|p| p.iter().all(|x| x.is_finite()))).then_some((near, places))
}

/// The point nearest to a bundle of rays (origin, unit direction); `None` if they are parallel.
pub(super) fn triangulate(rays: &[(Vector3<f64>, Vector3<f64>)]) -> Option<Vector3<f64>> {
    let (mut gram, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for (origin, direction) in rays {
        let across = Matrix3::identity() - direction * direction.transpose();
        gram += across;
        right += across * origin;
    }
    let eigen = gram.symmetric_eigenvalues();
    if eigen.min() < 1e-6 * rays.len() as f64 {
        return None;
    }
    gram.try_inverse().map(|inverse| inverse * right)
}
