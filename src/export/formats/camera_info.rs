//! ROS camera calibration files, as `camera_calibration_parsers` reads them.

use super::Export;
use crate::complaint::{Complaint, InputError};
use crate::geometry::{Intrinsics, LensModel};
use crate::layout::{Document, Layout};

/// Files with their texts, and notes.
pub(super) type FilesAndNotes = (Vec<(String, String)>, Vec<String>);

pub(super) fn files(layout: &Layout) -> Result<FilesAndNotes, InputError> {
    let mut out = Export::default();
    let mut files = Vec::new();
    for camera in &layout.cameras {
        let Some(lens) = &camera.intrinsics else {
            out.notes.push(format!("camera `{}` is left out: it has no lens", camera.name));
            continue;
        };
        let text = document(&camera.name, lens).to_yaml();
        let text = text.map_err(|e| Complaint::of(&layout.file, e.to_string(), "report this"))?;
        files.push((format!("{}_camera_info.yaml", camera.name), text));
    }
    if files.is_empty() {
        return Err(no_lens(layout));
    }
    Ok((files, out.notes))
}

pub(super) fn no_lens(layout: &Layout) -> InputError {
    Complaint::of(&layout.file, "no camera of the cell has a lens", "give a camera `intrinsics`").into()
}

fn document(name: &str, lens: &Intrinsics) -> Document {
    let ([width, height], [fx, fy], [cx, cy]) = (lens.size(), lens.focal(), lens.centre());
    let (model, distortion) = match lens.model() {
        LensModel::Pinhole => ("plumb_bob", vec![0.0; 5]),
        LensModel::Brown => ("plumb_bob", lens.distortion().to_vec()),
        LensModel::Rational => ("rational_polynomial", lens.distortion().to_vec()),
        LensModel::KannalaBrandt => ("equidistant", lens.distortion().to_vec()),
    };
    let matrix = |rows: u64, columns: u64, data: &[f64]| {
        Document::map([
            ("rows", Document::Whole(rows)),
            ("cols", Document::Whole(columns)),
            ("data", Document::numbers(data)),
        ])
    };
    let count = distortion.len() as u64;
    Document::map([
        ("image_width", Document::Whole(u64::from(width))),
        ("image_height", Document::Whole(u64::from(height))),
        ("camera_name", Document::text(name)),
        ("camera_matrix", matrix(3, 3, &[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0])),
        ("distortion_model", Document::text(model)),
        ("distortion_coefficients", matrix(1, count, &distortion)),
        ("rectification_matrix", matrix(3, 3, &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])),
        ("projection_matrix", matrix(3, 4, &[fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0])),
    ])
}
