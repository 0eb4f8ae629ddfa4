//! The pose of a target from its corners in one picture.

use nalgebra::{Matrix3, Matrix6, UnitQuaternion, Vector2, Vector3, Vector6};

use super::planar::{homography, plane_rotations};
use crate::geometry::{Pose, rotation};

/// A pose that explains a picture, and how well.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseCandidate {
    /// `camera_from_target`.
    pub pose: Pose,
    /// Root mean square of the reprojection error per axis on the normalised image plane.
    pub rms: f64,
}

/// The target counts as flat when it is thinner than this fraction of its width.
const FLAT: f64 = 1e-4;
/// A second solution is dropped when it fits this many times worse than the first and worse than [`CLEARLY_WORSE`].
const RATIO: f64 = 8.0;
/// A reprojection error (normalised; about 2 px at 1000 px focal length) that noise does not explain.
const CLEARLY_WORSE: f64 = 2e-3;

/// A relative decrease of the squared error below which a pose is as good as it gets.
const SETTLED: f64 = 1e-6;

/// Candidate poses of a target from its points (m) and where they appear on the normalised image plane, the best first: for a flat target
/// both that the two-fold ambiguity of a plane leaves, for a solid one the best of many starts. Empty for fewer than four points or points on a line.
#[must_use]
pub fn poses_from_points(points: &[Vector3<f64>], image: &[Vector2<f64>]) -> Vec<PoseCandidate> {
    if points.len() < 4 || points.len() != image.len() {
        return Vec::new();
    }
    let count = points.len() as f64;
    let centre = points.iter().sum::<Vector3<f64>>() / count;
    let scatter: Matrix3<f64> = points.iter().map(|p| (p - centre) * (p - centre).transpose()).sum();
    let eigen = scatter.symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    let extent = |i: usize| eigen.eigenvalues[order[i]].max(0.0).sqrt();
    if extent(1) <= 1e-6 * extent(0) || extent(0) == 0.0 {
        return Vec::new();
    }
    let starts = if extent(2) <= FLAT * extent(0) {
        let x = eigen.eigenvectors.column(order[0]).into_owned();
        let y = eigen.eigenvectors.column(order[1]).into_owned();
        flat_starts(points, image, &centre, &x, &y)
    } else {
        solid_starts(points, image)
    };
    let mut found: Vec<PoseCandidate> = Vec::new();
    for rotation in starts {
        let Some(start) = with_translation(rotation, points, image) else { continue };
        let Some(candidate) = refine(start, points, image) else { continue };
        let same = |known: &PoseCandidate| (known.pose.inverse() * candidate.pose).magnitude().1 < 1e-3;
        if !found.iter().any(same) {
            found.push(candidate);
        }
    }
    found.sort_by(|a, b| a.rms.total_cmp(&b.rms));
    found.truncate(2);
    if let [first, second] = found[..]
        && second.rms > RATIO * first.rms
        && second.rms > CLEARLY_WORSE
    {
        found.truncate(1);
    }
    found
}

fn flat_starts(
    points: &[Vector3<f64>],
    image: &[Vector2<f64>],
    centre: &Vector3<f64>,
    x: &Vector3<f64>,
    y: &Vector3<f64>,
) -> Vec<UnitQuaternion<f64>> {
    let plane: Vec<Vector2<f64>> =
        points.iter().map(|p| Vector2::new((p - centre).dot(x), (p - centre).dot(y))).collect();
    let target_from_plane = Matrix3::from_columns(&[*x, *y, x.cross(y)]);
    let rotations = homography(&plane, image).and_then(|h| plane_rotations(&h));
    rotations
        .into_iter()
        .flatten()
        .filter_map(|camera_from_plane| {
            rotation::nearest_rotation(&(camera_from_plane * target_from_plane.transpose()))
        })
        .collect()
}

/// The starts of a solid target: of the 24 rotations of a cube, the eight whose best translation explains the picture best.
fn solid_starts(points: &[Vector3<f64>], image: &[Vector2<f64>]) -> Vec<UnitQuaternion<f64>> {
    let mut scored: Vec<(f64, UnitQuaternion<f64>)> = cube_rotations()
        .into_iter()
        .filter_map(|rotation| {
            let pose = with_translation(rotation, points, image)?;
            Some((mean_square(&pose, points, image)?, rotation))
        })
        .collect();
    scored.sort_by(|a, b| a.0.total_cmp(&b.0));
    scored.into_iter().take(8).map(|(_, rotation)| rotation).collect()
}

/// The 24 rotations that map a cube to itself: no rotation is further than 63 degrees from all of them.
pub(super) fn cube_rotations() -> Vec<UnitQuaternion<f64>> {
    let axes = [Vector3::x(), Vector3::y(), Vector3::z(), -Vector3::x(), -Vector3::y(), -Vector3::z()];
    let mut all = Vec::with_capacity(24);
    for x in &axes {
        for y in axes.iter().filter(|y| y.dot(x) == 0.0) {
            all.push(rotation::from_matrix(&Matrix3::from_columns(&[*x, *y, x.cross(y)])));
        }
    }
    all
}

/// The translation that fits best for a given rotation: linear in the unknowns once each equation is multiplied by the depth.
fn with_translation(rotation: UnitQuaternion<f64>, points: &[Vector3<f64>], image: &[Vector2<f64>]) -> Option<Pose> {
    let (mut gram, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for (point, at) in points.iter().zip(image) {
        let p = rotation * point;
        for (row, value) in
            [(Vector3::new(1.0, 0.0, -at.x), at.x * p.z - p.x), (Vector3::new(0.0, 1.0, -at.y), at.y * p.z - p.y)]
        {
            gram += row * row.transpose();
            right += row * value;
        }
    }
    let mut translation = gram.try_inverse()? * right;
    // The mirror image behind the camera fits a far target equally well.
    if translation.z < 0.0 {
        translation = -translation;
    }
    translation.iter().all(|x| x.is_finite()).then(|| Pose::new(rotation, translation))
}

fn mean_square(pose: &Pose, points: &[Vector3<f64>], image: &[Vector2<f64>]) -> Option<f64> {
    let mut sum = 0.0;
    for (point, at) in points.iter().zip(image) {
        let p = *pose * *point;
        if p.z < 1e-6 {
            return None;
        }
        sum += (Vector2::new(p.x / p.z, p.y / p.z) - at).norm_squared();
    }
    Some(sum / (2.0 * points.len() as f64))
}

/// Levenberg-Marquardt on the normalised reprojection error.
fn refine(start: Pose, points: &[Vector3<f64>], image: &[Vector2<f64>]) -> Option<PoseCandidate> {
    let mut pose = start;
    let mut square = mean_square(&pose, points, image)?;
    let mut lambda = 1e-4;
    for _ in 0..30 {
        let (mut hessian, mut gradient) = (Matrix6::zeros(), Vector6::zeros());
        let r = pose.rotation_matrix();
        for (point, at) in points.iter().zip(image) {
            let p = pose * *point;
            let w = 1.0 / p.z;
            for (slope, residual) in [
                (Vector3::new(w, 0.0, -p.x * w * w), p.x * w - at.x),
                (Vector3::new(0.0, w, -p.y * w * w), p.y * w - at.y),
            ] {
                let along = r.transpose() * slope;
                let turn = point.cross(&along);
                let row = Vector6::new(along.x, along.y, along.z, turn.x, turn.y, turn.z);
                hessian += row * row.transpose();
                gradient += row * residual;
            }
        }
        let damped = hessian + Matrix6::from_diagonal(&(hessian.diagonal() * lambda).add_scalar(1e-15));
        let Some(factor) = damped.cholesky() else { break };
        let step = -factor.solve(&gradient);
        let trial = pose.retract(&step);
        match mean_square(&trial, points, image) {
            Some(trial_square) if trial_square <= square => {
                // Steps converge quadratically: what the next would bring is far below the noise.
                let done = square - trial_square <= SETTLED * square;
                (pose, square) = (trial, trial_square);
                lambda = (lambda * 0.1).max(1e-12);
                if done {
                    break;
                }
            }
            _ => lambda *= 10.0,
        }
        if lambda > 1e6 {
            break;
        }
    }
    Some(PoseCandidate { pose, rms: square.sqrt() })
}
