//! Tags and boards in pictures, corner by corner.

use nalgebra::Vector3;
use std::collections::{BTreeMap, BTreeSet};

use super::undetermined::Evidence;
use crate::geometry::Feature;
use crate::recording::Appearance;
use crate::solve::GroupKind;

/// One tag or board in one picture.
pub(super) struct Thing<'a> {
    /// The target in the picture.
    pub(super) of: &'a Appearance,
    /// Its corners, as the recording numbers them.
    pub(super) rows: Vec<usize>,
    /// How far each corner is from where the solution has it, px; none if the camera could not see it there.
    pub(super) off: Vec<Option<f64>>,
    /// Which corners were set aside.
    pub(super) aside: Vec<bool>,
    /// Index into the plan's configurations.
    pub(super) configuration: usize,
}

impl Thing<'_> {
    /// Whether all of it was set aside.
    pub(super) fn wholly_aside(&self) -> bool {
        self.aside.iter().all(|aside| *aside)
    }

    /// Its first corner, as the recording has it.
    pub(super) fn first<'a>(&self, evidence: &Evidence<'a>) -> &'a Feature {
        evidence.recording.corners.feature(self.rows[0])
    }

    /// Its corners: row of the recording, and what it was read as.
    pub(super) fn features<'a>(&self, evidence: &Evidence<'a>) -> impl Iterator<Item = (usize, &'a Feature)> {
        self.rows.iter().map(|row| (*row, evidence.recording.corners.feature(*row)))
    }

    /// Its name and its target's.
    pub(super) fn name(&self, evidence: &Evidence<'_>) -> String {
        name(evidence, self.of.target, self.first(evidence))
    }

    /// The picture it is in, in words.
    pub(super) fn picture(&self, evidence: &Evidence<'_>) -> String {
        format!("configuration {} of `{}`", self.of.configuration, evidence.layout.cameras[self.of.camera].name)
    }
}

/// The name of the tag, board or point that a feature belongs to, and its target's.
pub(super) fn name(evidence: &Evidence<'_>, target: usize, feature: &Feature) -> String {
    let name = &evidence.layout.targets[target].name;
    match feature {
        Feature::TagCorner(id, _) => format!("tag {id} of `{name}`"),
        Feature::BoardCorner(_) => format!("`{name}`"),
        Feature::Point(point) => format!("point `{point}` of `{name}`"),
    }
}

/// Camera, configuration, shot, target.
type AppearanceKey = (usize, u64, u64, usize);

/// All tags and boards in the pictures of which something was set aside.
pub(super) fn things<'a>(evidence: &Evidence<'a>) -> Vec<Thing<'a>> {
    let m = &evidence.plan.measurements;
    let all = evidence.plan.groups.iter().flat_map(|group| group.blocks.iter().map(move |block| (group, block)));
    let corners = all.filter(|(group, _)| matches!(group.kind, GroupKind::Corners { .. }));
    let doubtful: BTreeSet<(usize, u64, u64)> = corners
        .flat_map(|(_, block)| m.appearances(block.start..block.end))
        .filter(|(range, _)| range.clone().any(|i| !m.is_kept(i)))
        .map(|(_, of)| of.picture())
        .collect();
    let mut things: BTreeMap<(AppearanceKey, Option<u32>), Thing<'a>> = BTreeMap::new();
    for (group, poses) in evidence.plan.groups.iter().zip(evidence.poses) {
        let GroupKind::Corners { camera } = group.kind else { continue };
        let Some(lens) = &evidence.layout.cameras[camera].intrinsics else { continue };
        let lens = lens.with_parameters(evidence.state.lenses[camera]);
        for (block, pose) in group.blocks.iter().zip(poses) {
            let appearances = m.appearances(block.start..block.end).filter(|(_, of)| doubtful.contains(&of.picture()));
            for (i, of) in appearances.flat_map(|(range, of)| range.map(move |i| (i, of))) {
                let at = lens.project(&(*pose * Vector3::from(m.place(i))));
                let off = at.map(|at| (at.x - m.pixel(i)[0]).hypot(at.y - m.pixel(i)[1]));
                let key = (of.key(), tag_of(m.feature(i)));
                let thing = things.entry(key).or_insert_with(|| Thing {
                    of,
                    rows: Vec::new(),
                    off: Vec::new(),
                    aside: Vec::new(),
                    configuration: block.configuration,
                });
                thing.rows.push(m.row(i));
                thing.off.push(off);
                thing.aside.push(!m.is_kept(i));
            }
        }
    }
    things.into_values().collect()
}

/// In how many pictures each tag was read, by name.
pub(super) fn tags_seen(evidence: &Evidence<'_>) -> BTreeMap<String, usize> {
    let m = &evidence.plan.measurements;
    let mut counts: BTreeMap<(usize, u32), usize> = BTreeMap::new();
    for group in evidence.plan.groups.iter().filter(|group| matches!(group.kind, GroupKind::Corners { .. })) {
        for (range, of) in group.blocks.iter().flat_map(|block| m.appearances(block.start..block.end)) {
            let mut last = None;
            // The corners of a tag are next to each other.
            for tag in range.map(|i| tag_of(m.feature(i))) {
                if let Some(tag) = tag.filter(|_| tag != last) {
                    *counts.entry((of.target, tag)).or_default() += 1;
                }
                last = tag;
            }
        }
    }
    let named = |((target, tag), count)| (name(evidence, target, &Feature::TagCorner(tag, 0)), count);
    counts.into_iter().map(named).collect()
}

/// The number of the tag that a feature is a corner of.
pub(super) fn tag_of(feature: &Feature) -> Option<u32> {
    match feature {
        Feature::TagCorner(id, _) => Some(*id),
        _ => None,
    }
}
