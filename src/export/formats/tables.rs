//! Every frame with its parent, pose and standard deviations, as JSON and as CSV. Metres, radians.

use super::cell::Cell;
use crate::complaint::{Complaint, InputError};
use crate::geometry::Pose;
use crate::layout::Document;

/// One frame.
struct Row {
    key: String,
    parent: String,
    child: String,
    pose: Pose,
    sigma: [Option<f64>; 6],
}

fn rows(cell: &Cell<'_>) -> Vec<Row> {
    let name = |frame: usize| cell.tree.frames[frame].name.clone();
    let one = |edge: &crate::frames::StaticEdge| {
        let pose = edge.spec.pose().filter(|_| cell.has(edge.frame))?;
        let parent = name(cell.tree.frames[edge.frame].parent?);
        let sigma = cell.layout.solved.iter().find(|solved| solved.key == edge.key).map_or([None; 6], |s| s.sigma);
        Some(Row { key: edge.key.clone(), parent, child: name(edge.frame), pose, sigma })
    };
    cell.tree.static_edges.iter().filter_map(one).collect()
}

fn nothing(cell: &Cell<'_>) -> InputError {
    Complaint::of(
        &cell.layout.file,
        "no frame of the layout has a pose",
        "export a solution: `cellmap solve` writes it",
    )
    .into()
}

pub(super) fn json(cell: &Cell<'_>) -> Result<String, InputError> {
    let rows = rows(cell);
    if rows.is_empty() {
        return Err(nothing(cell));
    }
    let one = |row: &Row| {
        let (t, q, r) = (row.pose.translation, row.pose.rotation.coords, row.pose.rotation_matrix());
        let matrix = (0..3).map(|i| Document::numbers(&[r[(i, 0)], r[(i, 1)], r[(i, 2)], t[i]]));
        let last = Document::numbers(&[0.0, 0.0, 0.0, 1.0]);
        let entry = Document::map([
            ("parent", Document::text(&row.parent)),
            ("child", Document::text(&row.child)),
            ("xyz_m", Document::numbers(t.as_slice())),
            ("quat_xyzw", Document::numbers(q.as_slice())),
            ("matrix", Document::List(matrix.chain(std::iter::once(last)).collect())),
            ("sigma_xyz_m", Document::known(&row.sigma[..3])),
            ("sigma_rotvec_rad", Document::known(&row.sigma[3..])),
        ]);
        (row.key.clone(), entry)
    };
    let document = Document::map([
        ("cellmap", Document::text(crate::VERSION)),
        ("world", Document::text(&cell.layout.world)),
        ("poses", Document::Map(rows.iter().map(one).collect())),
    ]);
    let text = document.to_json().map_err(|e| Complaint::of(&cell.layout.file, e.to_string(), "report this"))?;
    Ok(text + "\n")
}

pub(super) fn csv(cell: &Cell<'_>) -> Result<String, InputError> {
    let rows = rows(cell);
    if rows.is_empty() {
        return Err(nothing(cell));
    }
    let fail = |e: csv::Error| Complaint::of(&cell.layout.file, e.to_string(), "report this");
    let mut writer = csv::Writer::from_writer(Vec::new());
    let header = ["parent", "child", "x", "y", "z", "qx", "qy", "qz", "qw", "sx", "sy", "sz", "srx", "sry", "srz"];
    writer.write_record(header).map_err(fail)?;
    for row in rows {
        let (t, q) = (row.pose.translation, row.pose.rotation.coords);
        let numbers = [t.x, t.y, t.z, q.x, q.y, q.z, q.w].map(|value| value.to_string());
        let sigma = row.sigma.map(|value| value.map_or_else(String::new, |value| value.to_string()));
        let record = [row.parent, row.child].into_iter().chain(numbers).chain(sigma);
        writer.write_record(record.collect::<Vec<_>>()).map_err(fail)?;
    }
    let bytes = writer.into_inner().map_err(|e| Complaint::of(&cell.layout.file, e.to_string(), "report this"))?;
    String::from_utf8(bytes).map_err(|e| Complaint::of(&cell.layout.file, e.to_string(), "report this").into())
}
