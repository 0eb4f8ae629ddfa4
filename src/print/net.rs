//! A cube of tags as a net to fold and glue.
//!
//! ```text
//!            +----+
//!            | +z |
//!       +----+----+----+----+
//!       | -x | -y | +x | +y |
//!       +----+----+----+----+
//!            | -z |
//!            +----+
//! ```

use nalgebra::Vector3;

use super::plate::{Plate, PrintedTag, tag};
use super::shapes::{Point, Shape, words, wrap};
use crate::geometry::dictionary::Dictionary;
use crate::geometry::{Pose, TagFace, target::tag_corners};
use crate::layout::Target;

/// Height of words, mm.
const WORDS: f64 = 2.5;

/// A face on the paper: column and row in the net, outward normal, and the directions in the target's frame of the paper's right and up.
struct Face {
    name: &'static str,
    cell: [f64; 2],
    right: Vector3<f64>,
    up: Vector3<f64>,
}

fn faces() -> [Face; 6] {
    let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
    // Right of a side face is up x normal; top and bottom hang on the -y face, whose right is +x.
    [
        Face { name: "-x", cell: [0.0, 1.0], right: -y, up: z },
        Face { name: "-y", cell: [1.0, 1.0], right: x, up: z },
        Face { name: "+x", cell: [2.0, 1.0], right: y, up: z },
        Face { name: "+y", cell: [3.0, 1.0], right: -x, up: z },
        Face { name: "+z", cell: [1.0, 0.0], right: x, up: y },
        Face { name: "-z", cell: [1.0, 2.0], right: x, up: -y },
    ]
}

/// The net of a cube of edge `edge` (mm).
pub(super) fn net(target: &Target, tag_faces: &[TagFace], dictionary: Dictionary, edge: f64) -> Plate {
    // Wide enough to hold glue, narrow enough to fold in.
    let flap = (0.12 * edge).clamp(5.0, 12.0);
    let origin = [flap, flap];
    let corner_of = |cell: [f64; 2]| [origin[0] + cell[0] * edge, origin[1] + cell[1] * edge];
    let mut shapes = Vec::new();
    let mut tags: Vec<PrintedTag> = Vec::new();
    for face in faces() {
        let [left, top] = corner_of(face.cell);
        let middle = [left + 0.5 * edge, top + 0.5 * edge];
        let normal = face.right.cross(&face.up);
        let on_it = tag_faces.iter().filter(|tag| {
            tag.target_from_tag.is_some_and(|pose: Pose| (pose.rotation * Vector3::z()).dot(&normal) > 0.99)
        });
        for one in on_it {
            let pose = one.target_from_tag.unwrap_or_default();
            let corners = tag_corners(one.size).map(|corner| {
                let p = (pose * corner) * 1e3;
                [middle[0] + p.dot(&face.right), middle[1] - p.dot(&face.up)]
            });
            shapes.push(tag(dictionary, one.id, &corners));
            tags.push(PrintedTag { target: target.name.clone(), dictionary, id: one.id, corners });
        }
        let ids: Vec<String> = tags
            .iter()
            .filter(|tag| {
                tag.corners.iter().all(|p| p[0] > left && p[0] < left + edge && p[1] > top && p[1] < top + edge)
            })
            .map(|tag| format!("  id {}", tag.id))
            .collect();
        shapes.push(words([left + 1.0, top + 2.4], 1.8, 0.6, format!("{}{}", face.name, ids.concat())));
    }
    folds(origin, edge, &mut shapes);
    outline(origin, edge, flap, &mut shapes);
    let size = [4.0 * edge + 2.0 * flap, 3.0 * edge + 2.0 * flap];
    let tag_size = tag_faces.first().map_or(0.0, |face| face.size * 1e3);
    let caption = [
        format!("{}: cube of {edge:.2} mm, tags of {}", target.name, dictionary.name()),
        "cut along the outline, fold along the dashes, glue the flaps; +z is the lid".to_owned(),
        format!(
            "measure after printing: each black square {tag_size:.2} mm, four faces side by side {:.2} mm",
            4.0 * edge
        ),
    ];
    // The net leaves room beside the lid.
    let left = origin[0] + 2.0 * edge + 2.0 * flap;
    let lines = caption.iter().flat_map(|text| wrap(text, WORDS, 2.0 * edge - 2.0 * flap)).enumerate();
    shapes.extend(lines.map(|(i, text)| words([left, flap + 3.4 * (i + 1) as f64], WORDS, 0.25, text)));
    Plate { title: target.name.clone(), caption: Vec::new(), size, shapes, tags, crop: false, axes: Vec::new() }
}

/// Dashed lines between faces and at flaps.
fn folds(origin: Point, edge: f64, shapes: &mut Vec<Shape>) {
    let at = |x: f64, y: f64| [origin[0] + x * edge, origin[1] + y * edge];
    let lines = [
        ([0.0, 1.0], [4.0, 1.0]),
        ([0.0, 2.0], [4.0, 2.0]),
        ([0.0, 1.0], [0.0, 2.0]),
        ([1.0, 0.0], [1.0, 3.0]),
        ([2.0, 0.0], [2.0, 3.0]),
        ([3.0, 1.0], [3.0, 2.0]),
        ([1.0, 0.0], [2.0, 0.0]),
        ([1.0, 3.0], [2.0, 3.0]),
    ];
    for (a, b) in lines {
        let points = vec![at(a[0], a[1]), at(b[0], b[1])];
        shapes.push(Shape::Line { points, width: 0.15, grey: 0.55, dash: Some(2.0) });
    }
}

/// The line to cut along: seven flaps, one for each pair of edges that meet.
fn outline(origin: Point, edge: f64, flap: f64, shapes: &mut Vec<Shape>) {
    let (f, s) = (flap / edge, 0.6 * flap / edge);
    // Once around, clockwise from the top left of the lid. Flaps on the lid's and the bottom's three free edges and on the left of -x.
    let around: [[f64; 2]; 27] = [
        [1.0, 0.0],
        [1.0 + s, -f],
        [2.0 - s, -f],
        [2.0, 0.0],
        [2.0 + f, s],
        [2.0 + f, 1.0 - s],
        [2.0, 1.0],
        [4.0, 1.0],
        [4.0, 2.0],
        [2.0, 2.0],
        [2.0 + f, 2.0 + s],
        [2.0 + f, 3.0 - s],
        [2.0, 3.0],
        [2.0 - s, 3.0 + f],
        [1.0 + s, 3.0 + f],
        [1.0, 3.0],
        [1.0 - f, 3.0 - s],
        [1.0 - f, 2.0 + s],
        [1.0, 2.0],
        [0.0, 2.0],
        [-f, 2.0 - s],
        [-f, 1.0 + s],
        [0.0, 1.0],
        [1.0, 1.0],
        [1.0 - f, 1.0 - s],
        [1.0 - f, s],
        [1.0, 0.0],
    ];
    let points = around.iter().map(|p| [origin[0] + p[0] * edge, origin[1] + p[1] * edge]).collect();
    shapes.push(Shape::Line { points, width: 0.2, grey: 0.0, dash: None });
    let glue = [[1.5, -0.5 * f], [1.5, 3.0 + 0.6 * f]];
    for [x, y] in glue {
        shapes.push(words([origin[0] + x * edge - 2.5, origin[1] + y * edge], 1.8, 0.6, "glue"));
    }
}
