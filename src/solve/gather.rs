//! Sorting measurements by kind, path and configuration, before they are compiled.

use nalgebra::Vector3;
use std::collections::BTreeMap;
use std::ops::Range;

use super::plan::{GroupKind, PlanError};
use super::unknowns::Unknowns;
use crate::frames::{FrameId, FrameTree, Path, Step};
use crate::layout::Layout;
use crate::recording::Recording;

/// Rows of one kind and path while the plan is being made: by configuration, the rows' numbers, ascending.
pub(super) type Gathering = BTreeMap<(GroupKind, FrameId, FrameId), BTreeMap<u64, Vec<Range<usize>>>>;

/// All measurements by kind and path.
pub(super) struct Gathered {
    pub(super) rows: Gathering,
    /// By number of the corners' names: place in the frame it stands in, m.
    pub(super) places: Vec<[f64; 3]>,
}

/// Gathers a recording.
pub(super) fn gather(layout: &Layout, tree: &FrameTree, recording: &Recording) -> Gathered {
    let mut gathered: Gathering = BTreeMap::new();
    // Each name is looked up once, however many pictures show it.
    let located = recording.corners.names().iter().map(|(target, feature)| {
        let located = tree.locate(layout, target, feature);
        located.unwrap_or((tree.targets[target], Vector3::zeros()))
    });
    let (frames, places): (Vec<FrameId>, Vec<[f64; 3]>) =
        located.map(|(frame, place)| (frame, <[f64; 3]>::from(place))).unzip();
    gather_corners(tree, recording, &frames, &mut gathered);
    let mut add = |kind, from, to, configuration, row| {
        push(gathered.entry((kind, from, to)).or_default().entry(configuration).or_default(), row..row + 1);
    };
    for (row, pose) in recording.poses.iter().enumerate() {
        add(GroupKind::Poses, tree.cameras[pose.camera], tree.targets[pose.target], pose.configuration, row);
    }
    for (row, point) in recording.points.iter().enumerate() {
        let located = tree.locate(layout, point.target, &point.feature);
        let frame = located.map_or(tree.targets[point.target], |(frame, _)| frame);
        add(GroupKind::Points, tree.sensors[point.sensor], frame, point.configuration, row);
    }
    for (row, contact) in recording.contacts.iter().enumerate() {
        let [a, b] = [0, 1].map(|i| {
            let (target, feature) = &contact.points[i];
            tree.locate(layout, *target, feature).map_or(tree.targets[*target], |(frame, _)| frame)
        });
        add(GroupKind::Contacts, a, b, contact.configuration, row);
    }
    Gathered { rows: gathered, places }
}

/// Gathers corners; `frames` has by number of a name the frame it stands in. Neighbouring rows are mostly of one block, which is looked up once.
fn gather_corners(tree: &FrameTree, recording: &Recording, frames: &[FrameId], gathered: &mut Gathering) {
    let frame = |corner: usize| frames[recording.corners.marks()[corner] as usize];
    for one in recording.corners.appearances() {
        let (kind, from) = (GroupKind::Corners { camera: one.camera }, tree.cameras[one.camera]);
        let mut rows = one.corners();
        while let Some(start) = rows.next() {
            let to = frame(start);
            let end = rows.clone().find(|row| frame(*row) != to).unwrap_or(rows.end);
            push(gathered.entry((kind, from, to)).or_default().entry(one.configuration).or_default(), start..end);
            rows.start = end;
        }
    }
}

/// Appends rows, to the last ones if they follow on them.
fn push(all: &mut Vec<Range<usize>>, rows: Range<usize>) {
    match all.last_mut().filter(|last| last.end == rows.start) {
        Some(last) => last.end = rows.end,
        None => all.push(rows),
    }
}

/// Every robot on a path must have been recorded wherever something was measured along it.
pub(super) fn check_motion(
    layout: &Layout,
    tree: &FrameTree,
    recording: &Recording,
    gathered: &Gathering,
    paths: &[Path],
) -> Result<(), PlanError> {
    for (((_, from, _), rows), path) in gathered.iter().zip(paths) {
        for robot in path.robots() {
            if let Some(&configuration) = rows.keys().find(|c| !recording.motions[robot].knows(**c)) {
                return Err(PlanError::NoMotion {
                    configuration,
                    sensor: tree.frames[*from].name.clone(),
                    robot: layout.robots[robot].name.clone(),
                });
            }
        }
    }
    Ok(())
}

/// The unknowns that some measurement or prior speaks of; the others would make every step singular and are reported apart.
pub(super) fn seen_unknowns<'a>(
    layout: &Layout,
    tree: &FrameTree,
    groups: impl Iterator<Item = (GroupKind, &'a Path)>,
) -> Unknowns {
    let mut edges = vec![false; tree.static_edges.len()];
    let mut robots = vec![false; layout.robots.len()];
    let mut lenses = vec![false; layout.cameras.len()];
    for (kind, path) in groups {
        if let GroupKind::Corners { camera } = kind {
            lenses[camera] = true;
        }
        for step in &path.steps {
            match step {
                Step::Static { edge, .. } => edges[*edge] = true,
                Step::Robot { robot, .. } => robots[*robot] = true,
                Step::Moving { .. } => {}
            }
        }
    }
    Unknowns::new(layout, tree, &edges, &robots, &lenses)
}
