//! The solution: the layout again, with every pose found, and beside it how far each can be trusted.
//!
//! A solution is itself a layout: its poses are fixed ones, its lenses and links the ones found, and the section `solution` holds what a layout
//! has no place for. No time and no thread count stands in it: the same input gives the same bytes.

use std::path::Path;

use super::findings::{faults, fit, parameters, poses, remarks, scales, streamed, undetermined, weak};
use crate::layout::write::sections;
use crate::layout::{Document, Paths};
use crate::recording::atomic;
use crate::workflow::solve::Solved;
use crate::workflow::solved_layout::solved_layout;

/// Writes `path` and, beside it, the same as JSON. A path that ends in `.json` gets JSON alone.
///
/// # Errors
/// When a file cannot be written; older files then stand untouched.
pub fn write(path: &Path, solved: &Solved) -> std::io::Result<()> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let document = document(solved, folder);
    let json = document.to_json()?;
    if path.extension().is_some_and(|e| e == "json") {
        return atomic::write(path, |out| writeln!(out, "{json}"));
    }
    let yaml = document.to_yaml()?;
    atomic::write(path, |out| {
        writeln!(
            out,
            "# Written by cellmap {}. A layout whose poses are the ones found; see `solution` at the end.",
            crate::VERSION
        )?;
        out.write_all(yaml.as_bytes())
    })?;
    atomic::write(&path.with_extension("json"), |out| writeln!(out, "{json}"))
}

/// The whole solution as a document, with paths that hold in `folder`.
#[must_use]
pub fn document(solved: &Solved, folder: &Path) -> Document {
    let layout = solved_layout(solved);
    let mut root = sections(&layout, &Paths::new(&solved.layout, folder));
    root.push(("solution".to_owned(), found(solved)));
    Document::Map(root)
}

fn found(solved: &Solved) -> Document {
    let mut entries = vec![("poses".to_owned(), Document::Map(poses(solved)))];
    let parameters = parameters(solved);
    if !parameters.is_empty() {
        entries.push(("parameters".to_owned(), Document::Map(parameters)));
    }
    let moving = moving(solved);
    if !moving.is_empty() {
        entries.push(("moving".to_owned(), Document::Map(moving)));
    }
    entries.push(("fit".to_owned(), Document::Map(fit(solved))));
    entries.extend(streamed(solved).map(|streamed| ("streamed".to_owned(), streamed)));
    entries.push(("faults".to_owned(), faults(&solved.faults)));
    entries.push(("undetermined".to_owned(), undetermined(solved)));
    entries.push(("weak".to_owned(), weak(solved)));
    entries.push(("remarks".to_owned(), remarks(solved)));
    entries.push(("scales".to_owned(), scales(solved)));
    let inputs = solved
        .inputs
        .iter()
        .map(|(file, hash)| Document::map([("file", Document::text(file)), ("sha256", Document::text(hash))]));
    entries.push((
        "provenance".to_owned(),
        Document::map([("cellmap", Document::text(crate::VERSION)), ("inputs", Document::List(inputs.collect()))]),
    ));
    Document::Map(entries)
}

/// The poses of targets that move, by configuration.
fn moving(solved: &Solved) -> Vec<(String, Document)> {
    let units = solved.layout.units;
    let edges = solved.tree.moving_edges.iter().enumerate();
    edges
        .map(|(index, edge)| {
            let rows = solved.moved.get(index).into_iter().flatten().map(|&configuration| {
                let pose = &solved.state.moving_poses[index][configuration];
                let t = pose.translation / units.length;
                let q = pose.rotation.coords;
                let id = Document::Whole(solved.plan.configurations[configuration]);
                let mut row = vec![id];
                row.extend([t.x, t.y, t.z, q.x, q.y, q.z, q.w].map(Document::Number));
                Document::Row(row)
            });
            (edge.key.clone(), Document::List(rows.collect()))
        })
        .collect()
}
