//! Corners as they are held: each once, in arrays.
//!
//! A recording has millions of corners, but only thousands of pictures and hundreds of things to be seen in them. So what the corners of one target in
//! one picture have in common stands once, in an [`Appearance`]; which corner of its target each is, is a number into a list of [`Names`]; and what
//! remains of a corner is that number and its pixel: 20 bytes, and 24 more where a detector gave covariances.

use std::collections::BTreeSet;
use std::ops::Range;
use std::sync::Arc;

use super::held::Held;
use super::names::Names;
use crate::geometry::Feature;
use crate::layout::Layout;

/// One corner as a detector reports it.
#[derive(Clone, Debug, PartialEq)]
pub struct CornerRow {
    /// Where all robots stand.
    pub configuration: u64,
    /// Which of several pictures taken there.
    pub shot: u64,
    /// The camera's place in the layout.
    pub camera: usize,
    /// The target's place in the layout.
    pub target: usize,
    /// Which corner.
    pub feature: Feature,
    /// (u, v), px.
    pub pixel: [f64; 2],
    /// (suu, suv, svv), px^2.
    pub covariance: Option<[f64; 3]>,
}

impl CornerRow {
    /// The order of rows that everything downstream relies on.
    #[must_use]
    pub fn key(&self) -> (usize, u64, u64, usize, &Feature) {
        (self.camera, self.configuration, self.shot, self.target, &self.feature)
    }
}

/// One target in one picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Appearance {
    /// Where all robots stand.
    pub configuration: u64,
    /// Which of several pictures taken there.
    pub shot: u64,
    /// The camera's place in the layout.
    pub camera: usize,
    /// The target's place in the layout.
    pub target: usize,
    pub(super) start: u32,
    pub(super) end: u32,
}

impl Appearance {
    /// The numbers of its corners.
    #[must_use]
    pub fn corners(&self) -> Range<usize> {
        self.start as usize..self.end as usize
    }

    /// The order in which a recording has them.
    #[must_use]
    pub fn key(&self) -> (usize, u64, u64, usize) {
        (self.camera, self.configuration, self.shot, self.target)
    }

    /// Which picture of which camera: camera, configuration, shot.
    #[must_use]
    pub fn picture(&self) -> (usize, u64, u64) {
        (self.camera, self.configuration, self.shot)
    }
}

/// All corners of a recording, in the order of [`CornerRow::key`]. A copy shares them; a change makes new ones.
#[derive(Clone, Debug, Default)]
pub struct Corners {
    names: Arc<Names>,
    held: Arc<Held>,
}

impl Corners {
    /// Corners in order, by numbers of `names`.
    pub(super) fn new(names: Arc<Names>, mut held: Held) -> Self {
        held.appearances.shrink_to_fit();
        held.marks.shrink_to_fit();
        held.pixels.shrink_to_fit();
        held.covariances.shrink_to_fit();
        Self { names, held: Arc::new(held) }
    }

    /// Rows in order, whose features are all among the `names`.
    pub(super) fn named<'a>(names: Arc<Names>, rows: impl Iterator<Item = &'a CornerRow>) -> Self {
        let mut held = Held::default();
        held.reserve(rows.size_hint().0);
        for row in rows {
            let CornerRow { configuration, shot, camera, target, .. } = *row;
            let one = Appearance { configuration, shot, camera, target, ..Appearance::default() };
            if let Some(mark) = names.mark(target, &row.feature) {
                held.push(&one, mark, row.pixel, row.covariance);
            }
        }
        Self::new(names, held)
    }

    /// Corners that come one by one, ascending by [`CornerRow::key`], of targets of a layout: all rows are never in memory at once. None if one is out of order or
    /// of something that the layout does not have.
    #[must_use]
    pub fn ascending(layout: &Layout, rows: impl IntoIterator<Item = CornerRow>) -> Option<Self> {
        let names = Arc::new(Names::of(layout));
        let (rows, mut held) = (rows.into_iter(), Held::default());
        held.reserve(rows.size_hint().0);
        for CornerRow { configuration, shot, camera, target, feature, pixel, covariance } in rows {
            let one = Appearance { configuration, shot, camera, target, ..Appearance::default() };
            held.push(&one, names.mark(target, &feature)?, pixel, covariance);
        }
        held.is_ascending().then(|| Self::new(names, held))
    }

    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.held.marks.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.held.marks.is_empty()
    }

    /// What was seen in which picture, in order.
    #[must_use]
    pub fn appearances(&self) -> &[Appearance] {
        &self.held.appearances
    }

    /// The place among the appearances of what a corner belongs to. O(log n).
    #[must_use]
    pub fn place_of(&self, corner: usize) -> usize {
        self.held.appearances.partition_point(|one| one.corners().end <= corner)
    }

    /// What [`Corners::marks`] stand for.
    #[must_use]
    pub fn names(&self) -> &Names {
        &self.names
    }

    /// By corner: its number among the [`Corners::names`].
    #[must_use]
    pub fn marks(&self) -> &[u32] {
        &self.held.marks
    }

    /// By corner: (u, v), px.
    #[must_use]
    pub fn pixels(&self) -> &[[f64; 2]] {
        &self.held.pixels
    }

    /// Which corner of its target a corner is.
    #[must_use]
    pub fn feature(&self, corner: usize) -> &Feature {
        self.names.feature(self.held.marks[corner])
    }

    /// A corner's covariance (suu, suv, svv), px^2.
    #[must_use]
    pub fn covariance(&self, corner: usize) -> Option<[f64; 3]> {
        self.held.covariances.get(corner).copied().filter(|covariance| covariance[0] != 0.0)
    }

    /// Whether any corner has a covariance.
    #[must_use]
    pub fn have_covariances(&self) -> bool {
        !self.held.covariances.is_empty()
    }

    /// The corners one by one.
    pub fn iter(&self) -> impl Iterator<Item = CornerRow> + '_ {
        self.held.appearances.iter().flat_map(|one| {
            one.corners().map(|corner| CornerRow {
                configuration: one.configuration,
                shot: one.shot,
                camera: one.camera,
                target: one.target,
                feature: self.feature(corner).clone(),
                pixel: self.held.pixels[corner],
                covariance: self.covariance(corner),
            })
        })
    }

    /// Leaves out what was seen in a picture of a target where `keep` does not hold.
    pub fn retain(&mut self, mut keep: impl FnMut(&Appearance) -> bool) {
        if !self.held.appearances.iter().all(&mut keep) {
            self.retain_each(|one, _| keep(one));
        }
    }

    /// Leaves out corners for which `keep` does not hold; it is given what the corner belongs to and the corner's number.
    pub fn retain_each(&mut self, mut keep: impl FnMut(&Appearance, usize) -> bool) {
        let mut kept = Held::default();
        for one in &self.held.appearances {
            for corner in one.corners().filter(|corner| keep(one, *corner)) {
                kept.push(one, self.held.marks[corner], self.held.pixels[corner], self.covariance(corner));
            }
        }
        self.held = Arc::new(kept);
    }

    /// Changes rows at will; afterwards they are in order again.
    pub fn edit<R>(&mut self, change: impl FnOnce(&mut Vec<CornerRow>) -> R) -> R {
        let mut rows = self.iter().collect();
        let result = change(&mut rows);
        *self = rows.into();
        result
    }

    /// Exchanges names of cameras: `camera` gives each one's new place.
    #[must_use]
    pub fn with_cameras(&self, camera: impl Fn(usize) -> usize) -> Self {
        let renamed = |one: &Appearance| Appearance { camera: camera(one.camera), ..*one };
        let mut held = Held {
            appearances: self.held.appearances.iter().map(renamed).collect(),
            marks: self.held.marks.clone(),
            pixels: self.held.pixels.clone(),
            covariances: self.held.covariances.clone(),
        };
        held.order();
        Self { names: Arc::clone(&self.names), held: Arc::new(held) }
    }

    /// Those of several parts or files of one recording; none if two are of the same thing.
    pub(super) fn together(mut parts: Vec<Self>) -> Option<Self> {
        if parts.len() == 1 {
            return parts.pop();
        }
        let mut all = Held::default();
        all.reserve(parts.iter().map(Self::len).sum());
        let names = parts.first().map(|first| Arc::clone(&first.names)).unwrap_or_default();
        for part in parts.drain(..) {
            all.append(&part.held);
        }
        all.order().then(|| Self::new(names, all))
    }
}

impl From<Vec<CornerRow>> for Corners {
    fn from(mut rows: Vec<CornerRow>) -> Self {
        rows.sort_by(|a, b| a.key().cmp(&b.key()));
        let different: BTreeSet<(usize, &Feature)> = rows.iter().map(|row| (row.target, &row.feature)).collect();
        let names = Names::new(different.into_iter().map(|(target, feature)| (target, feature.clone())).collect());
        Self::named(Arc::new(names), rows.iter())
    }
}

impl<'a> IntoIterator for &'a Corners {
    type Item = CornerRow;
    type IntoIter = Box<dyn Iterator<Item = CornerRow> + 'a>;

    fn into_iter(self) -> Self::IntoIter {
        Box::new(self.iter())
    }
}

/// The same corners, whatever lists their names stand in.
impl PartialEq for Corners {
    fn eq(&self, other: &Self) -> bool {
        self.len() == other.len() && self.iter().eq(other.iter())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Corners of two targets in a few pictures, in no order; every third has a covariance.
    fn rows() -> Vec<CornerRow> {
        let row = |i: u64| CornerRow {
            configuration: i * 7 % 5,
            shot: i % 2,
            camera: (i / 3 % 2) as usize,
            target: (i / 6 % 2) as usize,
            feature: match i / 6 % 2 {
                0 => Feature::BoardCorner(i as u32),
                _ => Feature::Point(format!("p{i}")),
            },
            pixel: [i as f64, 0.5],
            covariance: i.is_multiple_of(3).then_some([1.0, 0.0, 2.0]),
        };
        (0..60).map(row).collect()
    }

    #[test]
    fn rows_that_ascend_need_not_be_held_at_once() {
        let text = "cellmap: 1\nunits: {length: mm, angle: deg}\nworld: hall\ncameras:\n  eye: {intrinsics: {model: pinhole, size: [640, 480], \
                    focal: [500, 500], centre: [320, 240]}, pose: {xyz: [0, 0, 0], rpy: [0, 0, 0]}}\ntargets:\n  board: {checkerboard: {corners: [4, 3], \
                    square: 6}, pose: {xyz: [0, 0, 500], rpy: [0, 0, 0]}}\n";
        let layout = crate::layout::parse_layout(std::path::Path::new("layout.yaml"), text, None).unwrap();
        let row = |i: u64| CornerRow {
            configuration: i / 24,
            shot: i / 12 % 2,
            camera: 0,
            target: 0,
            feature: Feature::BoardCorner((i % 12) as u32),
            pixel: [i as f64, 0.5],
            covariance: i.is_multiple_of(5).then_some([1.0, 0.0, 2.0]),
        };
        let rows: Vec<CornerRow> = (0..60).map(row).collect();
        let corners = Corners::ascending(&layout, rows.iter().cloned()).unwrap();
        assert_eq!(corners, Corners::from(rows.clone()));
        assert_eq!(Corners::ascending(&layout, rows.iter().rev().cloned()), None);
        assert_eq!(Corners::ascending(&layout, rows.iter().chain([&rows[59]]).cloned()), None);
        let strange = CornerRow { feature: Feature::BoardCorner(12), ..row(60) };
        assert_eq!(Corners::ascending(&layout, rows.into_iter().chain([strange])), None);
    }

    #[test]
    fn rows_come_back_in_order_and_changes_are_those_of_rows() {
        let mut sorted = rows();
        sorted.sort_by(|a, b| a.key().cmp(&b.key()));
        let corners = Corners::from(rows());
        assert_eq!(corners.iter().collect::<Vec<_>>(), sorted);
        let place = |corner: usize| corners.appearances()[corners.place_of(corner)];
        assert!((0..60).all(|corner| place(corner).corners().contains(&corner)));
        let mut some = corners.clone();
        some.retain(|one| one.camera == 1);
        some.retain_each(|_, corner| some_odd(corner));
        let kept = sorted.iter().filter(|row| row.camera == 1).enumerate().filter(|(i, _)| some_odd(*i));
        assert_eq!(some.iter().collect::<Vec<_>>(), kept.map(|(_, row)| row.clone()).collect::<Vec<_>>());
        let mut swapped = corners.clone();
        swapped.edit(|rows| rows.iter_mut().for_each(|row| row.camera = 1 - row.camera));
        assert_eq!(corners.with_cameras(|camera| 1 - camera), swapped);
        assert_ne!(corners, swapped);
    }

    fn some_odd(corner: usize) -> bool {
        corner % 2 == 1
    }

    #[test]
    fn two_files_are_one_recording_unless_they_repeat_each_other() {
        let all = Corners::from(rows());
        let (mut even, mut odd) = (all.clone(), all.clone());
        even.retain_each(|_, corner| !some_odd(corner));
        odd.retain_each(|_, corner| some_odd(corner));
        assert_eq!(Corners::together(vec![odd.clone(), even]), Some(all.clone()));
        assert_eq!(Corners::together(vec![all, odd]), None);
        assert_eq!(Corners::together(Vec::new()), Some(Corners::default()));
    }
}
