//! Kalibr's camera chain: cameras that stand still to each other, each relative to the one before.

use super::camera_info::{FilesAndNotes, no_lens};
use super::cell::Cell;
use crate::complaint::{Complaint, InputError};
use crate::geometry::LensModel;
use crate::layout::Document;

pub(super) fn file(cell: &Cell<'_>) -> Result<FilesAndNotes, InputError> {
    let layout = cell.layout;
    let mut notes = Vec::new();
    let mut chain: Vec<(String, Document)> = Vec::new();
    let mut before: Option<usize> = None;
    for (index, camera) in layout.cameras.iter().enumerate() {
        let frame = cell.tree.cameras[index];
        let Some(lens) = &camera.intrinsics else {
            notes.push(format!("camera `{}` is left out: it has no lens", camera.name));
            continue;
        };
        let relative = match before {
            None => None,
            Some(before) => match cell.between(frame, cell.tree.cameras[before]) {
                Some(pose) => Some(pose),
                None => {
                    notes.push(format!("camera `{}` is left out: it moves against the cameras before it", camera.name));
                    continue;
                }
            },
        };
        let d = lens.distortion();
        let (model, distortion) = match lens.model() {
            LensModel::Pinhole => ("radtan", vec![0.0; 4]),
            LensModel::Brown if d[4] == 0.0 => ("radtan", d[..4].to_vec()),
            LensModel::KannalaBrandt => ("equidistant", d.to_vec()),
            LensModel::Brown | LensModel::Rational => {
                let what = format!("Kalibr's `radtan` has no k3 and beyond, but camera `{}` does", camera.name);
                let remedy =
                    "solve again with k3 = 0 and without `refine: [distortion]`, or export `opencv` or `camera-info`";
                return Err(Complaint::at(&layout.file, camera.line, what, remedy).into());
            }
        };
        let mut entries = vec![
            ("camera_model".to_owned(), Document::text("pinhole")),
            ("intrinsics".to_owned(), Document::numbers(&[lens.focal(), lens.centre()].concat())),
            ("distortion_model".to_owned(), Document::text(model)),
            ("distortion_coeffs".to_owned(), Document::numbers(&distortion)),
            (
                "resolution".to_owned(),
                Document::Row(lens.size().iter().map(|s| Document::Whole(u64::from(*s))).collect()),
            ),
            ("rostopic".to_owned(), Document::text(format!("/{}/image_raw", camera.name))),
        ];
        if let Some(pose) = relative {
            let (r, t) = (pose.rotation_matrix(), pose.translation);
            let mut rows: Vec<Document> =
                (0..3).map(|i| Document::numbers(&[r[(i, 0)], r[(i, 1)], r[(i, 2)], t[i]])).collect();
            rows.push(Document::numbers(&[0.0, 0.0, 0.0, 1.0]));
            entries.insert(0, ("T_cn_cnm1".to_owned(), Document::List(rows)));
        }
        chain.push((format!("cam{}", chain.len()), Document::Map(entries)));
        before = Some(index);
    }
    if chain.is_empty() {
        return Err(no_lens(layout));
    }
    let text = Document::Map(chain).to_yaml();
    let text = text.map_err(|e| Complaint::of(&layout.file, e.to_string(), "report this"))?;
    Ok((vec![("camchain.yaml".to_owned(), text)], notes))
}
