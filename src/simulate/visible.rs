//! Which features of a target a camera sees: whole tags and whole boards only, as detectors report them.

use nalgebra::{Vector2, Vector3};

use super::bodies::PlacedCapsule;
use super::cell::Cell;
use crate::geometry::target::tag_corners;
use crate::geometry::{Feature, Intrinsics, Pose, TargetGeometry};

/// The features of target `target` that a camera sees when it stands at `camera_from_target`, and where. `hidden_by` are bodies in the **camera's** frame.
/// Otherwise faces hide nothing but what they carry themselves: a tag seen from behind or too slanted ([`Cell::slanted`]) is not reported.
#[must_use]
pub fn visible(
    cell: &Cell<'_>,
    intrinsics: &Intrinsics,
    camera_from_target: &Pose,
    target: usize,
    hidden_by: &[PlacedCapsule],
) -> Vec<(Feature, Vector2<f64>)> {
    let sees = |point: &Vector3<f64>, normal: Option<&Vector3<f64>>| {
        let pixel = cell.sees(intrinsics, point, normal)?;
        let sight = PlacedCapsule { ends: [Vector3::zeros(), *point], radius: 0.0 };
        hidden_by.iter().all(|body| body.clearance(&sight) > 0.0).then_some(pixel)
    };
    let whole = |points: &mut dyn Iterator<Item = Vector3<f64>>, normal: &Vector3<f64>| -> Vec<Vector2<f64>> {
        let pixels: Option<Vec<_>> = points.map(|point| sees(&(*camera_from_target * point), Some(normal))).collect();
        pixels.unwrap_or_default()
    };
    let mut found = Vec::new();
    match &cell.layout.targets[target].true_geometry {
        TargetGeometry::None => {}
        TargetGeometry::Tags(faces) => {
            for face in faces {
                let Some(target_from_tag) = face.target_from_tag else { continue };
                let normal = camera_from_target.rotation * (target_from_tag.rotation * Vector3::z());
                let mut corners = tag_corners(face.size).into_iter().map(|corner| target_from_tag * corner);
                let pixels = whole(&mut corners, &normal);
                found.extend((0..).zip(pixels).map(|(i, p)| (Feature::TagCorner(face.id, i), p)));
            }
        }
        TargetGeometry::Board { columns, rows, square, .. } => {
            // The board looks along -z: its z axis points into it.
            let normal = camera_from_target.rotation * -Vector3::z();
            let place = |i: usize| Vector3::new((i % columns) as f64 * square, (i / columns) as f64 * square, 0.0);
            let pixels = whole(&mut (0..columns * rows).map(place), &normal);
            found.extend((0..).zip(pixels).map(|(i, p)| (Feature::BoardCorner(i), p)));
        }
        TargetGeometry::Points(points) => {
            for (name, place) in points {
                if let Some(pixel) = place.and_then(|place| sees(&(*camera_from_target * place), None)) {
                    found.push((Feature::Point(name.clone()), pixel));
                }
            }
        }
    }
    found
}
