//! The pose of a target in a picture of which some corners are grossly wrong.
//!
//! All corners are believed at first. Where they contradict each other, poses from four corners at a time (Fischler and Bolles, *Random sample consensus*,
//! Comm. ACM 24, 1981; here not at random but neighbours, which are mostly one tag's, and corners spread over the whole) are judged by how many
//! others agree, and the best is computed anew from those.

use nalgebra::{Vector2, Vector3};

use super::pose_from_points::{PoseCandidate, poses_from_points};
use crate::geometry::Pose;

/// A reprojection error (normalised, root mean square) above which corners contradict each other: 3 px at 1000 px focal length.
const CONTRADICTION: f64 = 3e-3;
/// A corner agrees with a pose that is no further than this from it (normalised).
const AGREES: f64 = 4e-3;
/// Samples of four corners at most.
const SAMPLES: usize = 60;
/// Corners beyond the four that must agree.
const MORE: usize = 2;

/// As [`poses_from_points`], for corners some of which may be anywhere.
#[must_use]
pub(super) fn robust_poses_from_points(points: &[Vector3<f64>], image: &[Vector2<f64>]) -> Vec<PoseCandidate> {
    let all = poses_from_points(points, image);
    let count = points.len();
    if count < 4 + MORE || all.first().is_some_and(|first| first.rms < CONTRADICTION) {
        return all;
    }
    let neighbours = (0..count - 3).map(|i| [i, i + 1, i + 2, i + 3]);
    let spread = (0..count / 4).map(|i| [i, i + count / 4, i + count / 2, i + 3 * count / 4]);
    let samples: Vec<[usize; 4]> = neighbours.chain(spread).collect();
    let stride = samples.len().div_ceil(SAMPLES).max(1);
    let mut best: Vec<usize> = Vec::new();
    for sample in samples.iter().step_by(stride) {
        let of = |i: &usize| (points[*i], image[*i]);
        let (some, seen): (Vec<_>, Vec<_>) = sample.iter().map(of).unzip();
        for candidate in poses_from_points(&some, &seen) {
            let agreeing = agreeing(&candidate.pose, points, image);
            if agreeing.len() > best.len() {
                best = agreeing;
            }
        }
    }
    if best.len() < 4 + MORE {
        return all;
    }
    let (some, seen): (Vec<_>, Vec<_>) = best.iter().map(|i| (points[*i], image[*i])).unzip();
    let found = poses_from_points(&some, &seen);
    if found.is_empty() { all } else { found }
}

fn agreeing(pose: &Pose, points: &[Vector3<f64>], image: &[Vector2<f64>]) -> Vec<usize> {
    let near = |i: &usize| {
        let p = *pose * points[*i];
        p.z > 1e-6 && (Vector2::new(p.x / p.z, p.y / p.z) - image[*i]).norm() < AGREES
    };
    (0..points.len()).filter(near).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_third_of_the_corners_may_be_anywhere() {
        let pose = Pose::from_translation(0.05, -0.1, 1.2) * Pose::from_rotation_vector(&Vector3::new(0.4, -0.3, 1.0));
        let tags = (0..6).flat_map(|tag| {
            let at = Vector3::new(0.12 * f64::from(tag % 3), 0.12 * f64::from(tag / 3), 0.0);
            [(0.0, 0.0), (0.08, 0.0), (0.08, 0.08), (0.0, 0.08)].map(|(x, y)| at + Vector3::new(x, y, 0.0))
        });
        let points: Vec<Vector3<f64>> = tags.collect();
        let mut image: Vec<Vector2<f64>> = points
            .iter()
            .map(|point| {
                let p = pose * *point;
                Vector2::new(p.x / p.z, p.y / p.z)
            })
            .collect();
        for (i, at) in image.iter_mut().enumerate().filter(|(i, _)| [1, 4, 5, 10, 15, 16, 22].contains(i)) {
            at.x += 0.1 * (7.0 * i as f64).sin();
            at.y -= 0.1 * (3.0 * i as f64).cos();
        }
        let found = robust_poses_from_points(&points, &image);
        let (t, r) = (pose.inverse() * found[0].pose).magnitude();
        assert!(t < 1e-6 && r < 1e-6, "{t} m {r} rad");
        let plain = poses_from_points(&points, &image);
        assert!((pose.inverse() * plain[0].pose).magnitude().0 > 1e-3, "the plain one is misled");
    }
}
