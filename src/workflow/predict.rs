//! What a solution says must be in a picture.

use std::collections::BTreeMap;
use std::path::Path;

use crate::complaint::InputError;
use crate::detect::{Expected, ExpectedTag, Pattern};
use crate::geometry::Feature;
use crate::layout::{Layout, read_layout};
use crate::recording::Recording;
use crate::simulate::{Cell, CornerNoise, corners};

/// Beyond this angle (rad) between a face's normal and the line of sight no tag is found: 85 degrees.
const HARDLY_SEEN: f64 = 1.484;

/// A solution, and the motion that the recording in hand has.
#[derive(Debug)]
pub struct Prediction {
    solution: Layout,
    recording: Recording,
}

impl Prediction {
    /// Reads a solution; its recording is that of `layout`.
    ///
    /// # Errors
    /// Faults of the solution or of the motion.
    pub fn read(solution: &Path, layout: &Layout) -> Result<Self, InputError> {
        let solution = read_layout(solution, Some(&layout.recording))?;
        let recording = Recording::read_motion(&solution)?;
        Ok(Self { solution, recording })
    }

    /// The tags that a camera must see at a configuration: all of a tag's corners in the picture, none too slanted. They are all that there is to be seen if
    /// everything that is looked for is a tag whose place the solution knows, and none is so slanted, or so near the picture's edge, that it may be seen or not.
    #[must_use]
    pub fn of(&self, layout: &Layout, camera: usize, configuration: u64) -> Expected {
        let cell = Cell::new(&self.solution, &self.recording);
        let name = &layout.cameras[camera].name;
        let Some(camera) = self.solution.cameras.iter().position(|one| one.name == *name) else {
            return Expected::default();
        };
        let tags = self.whole_tags(&cell, camera, configuration);
        let known = |name: &str| {
            let target = self.solution.targets.iter().position(|target| target.name == name);
            target.is_some_and(|target| {
                matches!(self.solution.targets[target].pattern, Some(Pattern::Tags { .. }))
                    && cell.pose(cell.tree.cameras[camera], cell.tree.targets[target], configuration).is_some()
            })
        };
        let all = layout.targets.iter().filter(|target| target.pattern.is_some()).all(|target| known(&target.name));
        let most = Cell {
            slanted: HARDLY_SEEN,
            margin: 0.0,
            ..Cell::with_tree(&self.solution, &self.recording, cell.tree.clone())
        };
        let all = all && self.whole_tags(&most, camera, configuration).len() == tags.len();
        Expected { tags, all, ..Expected::default() }
    }

    /// The tags all of whose corners a camera of the solution sees.
    fn whole_tags(&self, cell: &Cell<'_>, camera: usize, configuration: u64) -> Vec<ExpectedTag> {
        let mut seen: BTreeMap<(usize, u32), [Option<[f64; 2]>; 4]> = BTreeMap::new();
        let exact = CornerNoise { pixel_sigma: 0.0, seed: 0 };
        for row in corners(cell, &[configuration], exact).into_iter().filter(|row| row.camera == camera) {
            if let Feature::TagCorner(tag, corner) = row.feature
                && let Some(place) = seen.entry((row.target, tag)).or_default().get_mut(usize::from(corner))
            {
                *place = Some(row.pixel);
            }
        }
        let tags = seen.into_iter().filter_map(|((target, id), corners)| {
            let Some(Pattern::Tags { dictionary, .. }) = &self.solution.targets[target].pattern else { return None };
            let [Some(a), Some(b), Some(c), Some(d)] = corners else { return None };
            Some(ExpectedTag { dictionary: *dictionary, id, corners: [a, b, c, d] })
        });
        tags.collect()
    }
}
