//! OpenCV FileStorage YAML: lenses of all cameras, and every frame as a 4 x 4 matrix.

use super::cell::Cell;
use super::text::numbers;
use crate::complaint::InputError;
use crate::geometry::{LensModel, Pose};

pub(super) fn file(cell: &Cell<'_>) -> Result<String, InputError> {
    let mut text = format!(
        "%YAML:1.0\n---\n# Written by cellmap {}. Pixels, metres; x_from_y maps points of y into x.\n",
        crate::VERSION
    );
    let mut any = false;
    for (index, camera) in cell.layout.cameras.iter().enumerate() {
        let Some(lens) = &camera.intrinsics else { continue };
        any = true;
        let name = key(&camera.name);
        let ([fx, fy], [cx, cy]) = (lens.focal(), lens.centre());
        // OpenCV's order is k1 k2 p1 p2 k3 (k4 k5 k6), or k1..k4 of its fisheye module.
        let distortion = if lens.model() == LensModel::Pinhole { vec![0.0; 5] } else { lens.distortion().to_vec() };
        text.push_str(&format!("{name}:\n   image_width: {}\n   image_height: {}\n", lens.size()[0], lens.size()[1]));
        let fisheye = u8::from(lens.model() == LensModel::KannalaBrandt);
        text.push_str(&format!("   fisheye: {fisheye}\n"));
        matrix(&mut text, "   ", "camera_matrix", 3, 3, &[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]);
        matrix(&mut text, "   ", "distortion", 1, distortion.len(), &distortion);
        if let Some(pose) = cell.between(0, cell.tree.cameras[index]) {
            matrix(&mut text, "   ", "world_from_camera", 4, 4, &homogeneous(&pose));
        }
    }
    if !any {
        return Err(super::camera_info::no_lens(cell.layout));
    }
    text.push_str("poses:\n");
    for edge in &cell.tree.static_edges {
        if let (Some(pose), true) = (edge.spec.pose(), cell.has(edge.frame)) {
            matrix(&mut text, "   ", &key(&edge.key), 4, 4, &homogeneous(&pose));
        }
    }
    Ok(text)
}

/// FileStorage keys begin with a letter or `_` and hold letters, digits, `_`, `-` only.
fn key(name: &str) -> String {
    let plain: String = name.chars().map(|c| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' }).collect();
    if plain.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_') { plain } else { format!("_{plain}") }
}

fn homogeneous(pose: &Pose) -> [f64; 16] {
    let (r, t) = (pose.rotation_matrix(), pose.translation);
    let row = |i: usize| [r[(i, 0)], r[(i, 1)], r[(i, 2)], t[i]];
    let mut all = [0.0; 16];
    for i in 0..3 {
        all[4 * i..4 * i + 4].copy_from_slice(&row(i));
    }
    all[15] = 1.0;
    all
}

fn matrix(text: &mut String, indent: &str, name: &str, rows: usize, columns: usize, data: &[f64]) {
    text.push_str(&format!(
        "{indent}{name}: !!opencv-matrix\n{indent}   rows: {rows}\n{indent}   cols: {columns}\n{indent}   dt: d\n"
    ));
    text.push_str(&format!("{indent}   data: [ {} ]\n", numbers(data, ", ")));
}
