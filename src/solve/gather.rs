//! Sorting measurements by kind, path and configuration, before they are compiled.

use nalgebra::Vector3;
use rayon::prelude::*;
use std::collections::BTreeMap;

use super::plan::{GroupKind, PlanError};
use super::unknowns::Unknowns;
use crate::frames::{FrameId, FrameTree, Path, Step};
use crate::layout::Layout;
use crate::recording::{CornerRow, Recording};

/// Rows of one kind and path while the plan is being made: by configuration, the rows' numbers.
pub(super) type Gathering = BTreeMap<(GroupKind, FrameId, FrameId), BTreeMap<u64, Vec<usize>>>;

/// All measurements by kind and path.
pub(super) struct Gathered {
    pub(super) rows: Gathering,
    /// Where each corner of the recording is: the frame it stands in, and its place there.
    pub(super) located: Vec<(FrameId, Vector3<f64>)>,
}

/// Gathers a recording.
pub(super) fn gather(layout: &Layout, tree: &FrameTree, recording: &Recording) -> Gathered {
    let mut gathered: Gathering = BTreeMap::new();
    let locate = |corner: &CornerRow| {
        let located = tree.locate(layout, corner.target, &corner.feature);
        located.unwrap_or((tree.targets[corner.target], Vector3::zeros()))
    };
    let located: Vec<(FrameId, Vector3<f64>)> = recording.corners.par_iter().map(locate).collect();
    gather_corners(tree, recording, &located, &mut gathered);
    let mut add = |kind, from, to, configuration, row| {
        gathered.entry((kind, from, to)).or_default().entry(configuration).or_default().push(row);
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
    Gathered { rows: gathered, located }
}

/// Gathers corners. Neighbouring rows are mostly of one block, which is looked up once.
fn gather_corners(
    tree: &FrameTree,
    recording: &Recording,
    located: &[(FrameId, Vector3<f64>)],
    gathered: &mut Gathering,
) {
    let of = |row: usize| {
        let corner = &recording.corners[row];
        (
            (GroupKind::Corners { camera: corner.camera }, tree.cameras[corner.camera], located[row].0),
            corner.configuration,
        )
    };
    let mut start = 0;
    while start < recording.corners.len() {
        let (key, configuration) = of(start);
        let rest = start + 1..recording.corners.len();
        let end = rest.clone().find(|row| of(*row) != (key, configuration)).unwrap_or(rest.end);
        gathered.entry(key).or_default().entry(configuration).or_default().extend(start..end);
        start = end;
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
