//! The list of all things that corners can be of.

use crate::geometry::{Feature, TargetGeometry};
use crate::layout::Layout;

/// Features of targets, each with a number of its own; the numbers are in the order of target and [`Feature`].
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Names {
    features: Vec<(usize, Feature)>,
    /// By target the number of its first; one more at the end.
    firsts: Vec<u32>,
}

impl Names {
    /// A list of these, in any order and any number of times: (target's place in the layout, feature).
    #[must_use]
    pub fn new(mut features: Vec<(usize, Feature)>) -> Self {
        features.sort_unstable();
        features.dedup();
        let targets = features.last().map_or(0, |(target, _)| target + 1);
        let first = |target: usize| features.partition_point(|(of, _)| *of < target) as u32;
        let firsts = (0..=targets).map(first).collect();
        Self { features, firsts }
    }

    /// All that a layout's targets can show.
    #[must_use]
    pub fn of(layout: &Layout) -> Self {
        let of = |geometry: &TargetGeometry| -> Vec<Feature> {
            match geometry {
                TargetGeometry::None => Vec::new(),
                TargetGeometry::Tags(faces) => {
                    faces.iter().flat_map(|face| (0..4).map(|corner| Feature::TagCorner(face.id, corner))).collect()
                }
                TargetGeometry::Board { columns, rows, .. } => {
                    (0..(columns * rows) as u32).map(Feature::BoardCorner).collect()
                }
                TargetGeometry::Points(points) => points.iter().map(|(name, _)| Feature::Point(name.clone())).collect(),
            }
        };
        let targets = layout.targets.iter().enumerate();
        Self::new(targets.flat_map(|(i, target)| of(&target.geometry).into_iter().map(move |one| (i, one))).collect())
    }

    /// The feature of a number.
    #[must_use]
    pub fn feature(&self, mark: u32) -> &Feature {
        &self.features[mark as usize].1
    }

    /// The number of a target's feature.
    #[must_use]
    pub fn mark(&self, target: usize, feature: &Feature) -> Option<u32> {
        let first = self.first(target)?;
        let own = &self.features[first as usize..self.firsts[target + 1] as usize];
        Some(first + own.binary_search_by(|(_, known)| known.cmp(feature)).ok()? as u32)
    }

    /// The number of a target's first feature.
    #[must_use]
    pub fn first(&self, target: usize) -> Option<u32> {
        self.firsts.get(target + 1).map(|_| self.firsts[target])
    }

    /// All in the order of their numbers: target's place in the layout, feature.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (usize, &Feature)> {
        self.features.iter().map(|(target, feature)| (*target, feature))
    }
}
