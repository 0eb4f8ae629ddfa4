//! Small changes of a recording or its description, to see whether they explain what does not fit.

use std::collections::BTreeMap;

use crate::frames::{FrameId, FrameTree};
use crate::geometry::{Feature, TargetGeometry};
use crate::layout::Layout;
use crate::recording::{Recording, RobotMotion};

/// What of a target has another size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sizes {
    /// Its tags, at the places that the layout gives.
    Tags,
    /// The tags and their places, as if it had been printed at another scale.
    Whole,
}

/// At most so many configurations, spread evenly, and one shot at each.
pub(super) fn thin(recording: &Recording, most: usize) -> Recording {
    let mut ids: Vec<u64> = recording.corners.appearances().iter().map(|one| one.configuration).collect();
    ids.extend(recording.poses.iter().map(|row| row.configuration));
    ids.extend(recording.points.iter().map(|row| row.configuration));
    ids.extend(recording.contacts.iter().map(|row| row.configuration));
    ids.sort_unstable();
    ids.dedup();
    let stride = ids.len().div_ceil(most).max(1);
    let kept: Vec<u64> = ids.into_iter().step_by(stride).collect();
    let wanted = |id: u64| kept.binary_search(&id).is_ok();
    let mut thin = recording.clone();
    let mut shots: BTreeMap<(usize, u64), u64> = BTreeMap::new();
    let seen = recording.corners.appearances().iter().map(|one| one.picture());
    for (camera, id, shot) in seen.chain(recording.poses.iter().map(|row| (row.camera, row.configuration, row.shot))) {
        let first = shots.entry((camera, id)).or_insert(shot);
        *first = shot.min(*first);
    }
    let first = |camera: usize, id: u64, shot: u64| wanted(id) && shots.get(&(camera, id)) == Some(&shot);
    thin.corners.retain(|one| first(one.camera, one.configuration, one.shot));
    thin.poses.retain(|row| first(row.camera, row.configuration, row.shot));
    thin.points.retain(|row| wanted(row.configuration));
    thin.contacts.retain(|row| wanted(row.configuration));
    thin
}

/// Leaves out measurements along paths that `crosses` names, at configurations that `at` names.
pub(super) fn without(
    layout: &Layout,
    tree: &FrameTree,
    recording: &Recording,
    crosses: impl Fn(FrameId, FrameId) -> bool,
    at: impl Fn(u64) -> bool,
) -> Recording {
    let frame = |target: usize, feature: &Feature| {
        tree.locate(layout, target, feature).map_or(tree.targets[target], |(f, _)| f)
    };
    let mut left = recording.clone();
    let mut known: BTreeMap<(FrameId, FrameId), bool> = BTreeMap::new();
    let mut crosses = |from, to| *known.entry((from, to)).or_insert_with(|| crosses(from, to));
    let corners = recording.corners.clone();
    left.corners.retain_each(|one, corner| {
        !(at(one.configuration) && crosses(tree.cameras[one.camera], frame(one.target, corners.feature(corner))))
    });
    left.poses.retain(|row| !(at(row.configuration) && crosses(tree.cameras[row.camera], tree.targets[row.target])));
    left.points
        .retain(|row| !(at(row.configuration) && crosses(tree.sensors[row.sensor], frame(row.target, &row.feature))));
    left.contacts.retain(|row| {
        let [a, b] = [0, 1].map(|i| frame(row.points[i].0, &row.points[i].1));
        !(at(row.configuration) && crosses(a, b))
    });
    left
}

/// From configuration `from` on, each configuration gets the values that stand `lines` later; measurements across the robot where there are none are
/// left out.
pub(super) fn shift_back(
    layout: &Layout,
    tree: &FrameTree,
    recording: &Recording,
    robot: usize,
    from: u64,
    lines: isize,
) -> Recording {
    fn shifted<T: Clone>(values: &BTreeMap<u64, T>, from: u64, lines: isize) -> BTreeMap<u64, T> {
        let ids: Vec<u64> = values.keys().copied().collect();
        let place = |i: usize| i.checked_add_signed(lines).and_then(|i| ids.get(i)).and_then(|id| values.get(id));
        let moved = |(i, id): (usize, &u64)| match *id < from {
            true => Some((*id, values[id].clone())),
            false => place(i).map(|value| (*id, value.clone())),
        };
        ids.iter().enumerate().filter_map(moved).collect()
    }
    let mut mended = recording.clone();
    mended.motions[robot] = match &recording.motions[robot] {
        RobotMotion::Joints(values) => RobotMotion::Joints(shifted(values, from, lines)),
        RobotMotion::Flange(poses) => RobotMotion::Flange(shifted(poses, from, lines)),
    };
    let known = mended.motions[robot].clone();
    let crosses = |a, b| tree.path(a, b).robots().any(|walked| walked == robot);
    without(layout, tree, &mended, crosses, |id| !known.knows(id))
}

/// The measurements of two cameras exchanged.
pub(super) fn exchange_cameras(recording: &Recording, a: usize, b: usize) -> Recording {
    let other = |camera: usize| match camera {
        _ if camera == a => b,
        _ if camera == b => a,
        _ => camera,
    };
    let mut mended = recording.clone();
    mended.corners = recording.corners.with_cameras(other);
    mended.poses.iter_mut().for_each(|row| row.camera = other(row.camera));
    mended.poses.sort_by_key(crate::recording::PoseRow::key);
    mended
}

/// The size of a target's tags or squares, in units of `scale` a metre.
pub(super) fn size_of(geometry: &TargetGeometry, scale: f64) -> f64 {
    scale
        * match geometry {
            TargetGeometry::Tags(faces) => faces.first().map_or(0.0, |face| face.size),
            TargetGeometry::Board { square, .. } => *square,
            TargetGeometry::None | TargetGeometry::Points(_) => 0.0,
        }
}

/// The layout with a target of another size; none where that would be the same as another kind of change.
pub(super) fn resized(layout: &Layout, target: usize, factor: f64, sizes: Sizes) -> Option<Layout> {
    let mut layout = layout.clone();
    match (&mut layout.targets[target].geometry, sizes) {
        (TargetGeometry::Tags(faces), Sizes::Tags) => faces.iter_mut().for_each(|face| face.size *= factor),
        (TargetGeometry::Tags(faces), Sizes::Whole) if faces.len() > 1 => {
            for face in faces {
                face.size *= factor;
                if let Some(pose) = &mut face.target_from_tag {
                    pose.translation *= factor;
                }
            }
        }
        (TargetGeometry::Board { square, .. }, Sizes::Whole) => *square *= factor,
        _ => return None,
    }
    Some(layout)
}

/// The recording with all measured distances divided by `1 + excess`, and the layout with all targets made larger for corners to say the same.
pub(super) fn rescaled(layout: &Layout, recording: &Recording, excess: f64) -> (Layout, Recording) {
    let (mut layout, mut recording) = (layout.clone(), recording.clone());
    for target in 0..layout.targets.len() {
        let geometry = &layout.targets[target].geometry;
        let sizes = match geometry {
            TargetGeometry::Tags(faces) if faces.len() == 1 => Sizes::Tags,
            _ => Sizes::Whole,
        };
        layout = resized(&layout, target, 1.0 / (1.0 + excess), sizes).unwrap_or(layout);
    }
    recording.poses.iter_mut().for_each(|row| row.pose.translation /= 1.0 + excess);
    (layout, recording)
}
