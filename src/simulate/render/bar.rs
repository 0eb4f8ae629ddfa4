//! A round bar, and what a pixel sees of it.

use nalgebra::Vector3;

use super::coverage::half_plane;
use super::face::Patch;
use super::rays::Ray;
use crate::simulate::bodies::PlacedCapsule;

/// Between a ray from the origin (unit direction) and a bar's axis: distance, vector from the ray to the axis, and how far along the ray.
#[inline]
pub(super) fn ray_to_segment(direction: &Vector3<f64>, capsule: &PlacedCapsule) -> (f64, Vector3<f64>, f64) {
    let [a, b] = capsule.ends;
    let along = b - a;
    let flat_a = a - direction * direction.dot(&a);
    let flat = along - direction * direction.dot(&along);
    let length = flat.norm_squared();
    let s = if length > 1e-18 { (-flat_a.dot(&flat) / length).clamp(0.0, 1.0) } else { 0.0 };
    let nearest = a + along * s;
    let depth = direction.dot(&nearest);
    let apart = nearest - direction * depth;
    (apart.norm(), apart, depth)
}

/// The surface of a bar in a pixel; its outline is replaced by its tangent.
pub(super) fn capsule_patch(capsule: &PlacedCapsule, tone: f32, lid: f32, ray: &Ray) -> Option<Patch> {
    let (apart, towards, depth) = ray_to_segment(&ray.direction, capsule);
    if depth <= 0.0 {
        return None;
    }
    let outside = apart - capsule.radius;
    let pixel = depth * ray.width;
    if outside > pixel {
        return None;
    }
    let covered = if outside < -pixel {
        1.0
    } else {
        let unit = towards / -apart.max(1e-12);
        half_plane(outside, [unit.dot(&ray.right) * depth, unit.dot(&ray.down) * depth])
    };
    if covered <= 0.0 {
        return None;
    }
    let (depth, normal) = if outside < 0.0 {
        let depth = capsule_depth(capsule, &ray.direction).unwrap_or(depth);
        let point = ray.direction * depth;
        let axis = capsule.ends[1] - capsule.ends[0];
        let s = ((point - capsule.ends[0]).dot(&axis) / axis.norm_squared().max(1e-18)).clamp(0.0, 1.0);
        (depth, (point - capsule.ends[0] - axis * s) / capsule.radius)
    } else {
        (depth, -towards / apart)
    };
    let axis = (capsule.ends[1] - capsule.ends[0]).try_normalize(1e-9).unwrap_or_else(Vector3::zeros);
    let end = ((normal.dot(&axis).abs() - 0.72) * 40.0).clamp(0.0, 1.0);
    let tone = f64::from(tone) + end * f64::from(lid - tone);
    Some(Patch { covered, tone: covered * tone, depth, normal })
}

/// Where a ray enters a bar.
///
/// Source: the quadratic of the infinite cylinder, then of the ball at the nearer end.
fn capsule_depth(capsule: &PlacedCapsule, direction: &Vector3<f64>) -> Option<f64> {
    let [a, b] = capsule.ends;
    let axis = b - a;
    let (length, lean, offset) = (axis.norm_squared(), axis.dot(direction), -axis.dot(&a));
    let squared = capsule.radius * capsule.radius;
    let k2 = length - lean * lean;
    if k2 > 1e-12 * length.max(1e-12) {
        let k1 = -length * a.dot(direction) - offset * lean;
        let k0 = length * a.norm_squared() - offset * offset - squared * length;
        let h = k1 * k1 - k2 * k0;
        if h >= 0.0 {
            let depth = (-k1 - h.sqrt()) / k2;
            let along = offset + depth * lean;
            if along > 0.0 && along < length {
                return (depth > 0.0).then_some(depth);
            }
        }
    }
    let ball = |end: &Vector3<f64>| {
        let middle = end.dot(direction);
        let h = middle * middle - end.norm_squared() + squared;
        (h >= 0.0).then(|| middle - h.sqrt())
    };
    let first = [ball(&a), ball(&b)].into_iter().flatten().fold(f64::INFINITY, f64::min);
    (first.is_finite() && first > 0.0).then_some(first)
}
