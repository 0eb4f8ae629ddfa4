//! What the first two pictures at a configuration say of the others.

use std::collections::BTreeMap;

use crate::detect::native::Sight;
use crate::detect::{Corner, Expected, ExpectedTag, GreyPicture, Pattern};

/// What a camera's first two pictures at a configuration show.
#[derive(Debug)]
pub struct Neighbour {
    sight: Sight,
    expected: Expected,
}

impl Neighbour {
    /// Two pictures and their corners. Two, since a tag at the limit of what can be read is read in some pictures and in others not: one that either shows is
    /// expected in the others.
    ///
    /// `None` if they say nothing of other pictures: where the two do not show the same, something else than tags is looked for, or a tag was measured
    /// at all four corners in neither, so that another picture may show more of it.
    #[must_use]
    pub fn of([first, second]: [&(GreyPicture, Vec<Corner>); 2], wanted: &[Pattern]) -> Option<Self> {
        if !wanted.iter().all(|pattern| matches!(pattern, Pattern::Tags { .. })) {
            return None;
        }
        let sight = Sight::of(&first.0);
        if !sight.is_of(&second.0) {
            return None;
        }
        let mut tags = BTreeMap::new();
        for corners in [&second.1, &first.1] {
            for four in corners.chunk_by(|a, b| (a.pattern, a.tag) == (b.pattern, b.tag)) {
                let tag = four.first()?;
                let (Pattern::Tags { dictionary, .. }, Some(id)) = (wanted.get(tag.pattern)?, tag.tag) else {
                    return None;
                };
                let known = tags.entry((tag.pattern, id)).or_insert(None);
                if let [a, b, c, d] = four {
                    let corners = [a.pixel, b.pixel, c.pixel, d.pixel];
                    *known = Some(ExpectedTag { dictionary: *dictionary, id, corners });
                }
            }
        }
        let tags = tags.into_values().collect::<Option<Vec<ExpectedTag>>>()?;
        Some(Self { sight, expected: Expected { tags, all: true } })
    }

    /// What must be in another picture; `None` if it does not show the same.
    #[must_use]
    pub fn expected_in(&self, picture: &GreyPicture) -> Option<&Expected> {
        self.sight.is_of(picture).then_some(&self.expected)
    }
}
