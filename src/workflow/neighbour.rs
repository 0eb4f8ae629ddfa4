//! What the first pictures at a configuration say of the others.

use std::collections::BTreeMap;

use crate::detect::native::Sight;
use crate::detect::{Corner, Expected, ExpectedTag, GreyPicture, KnownTag, Pattern};

/// A picture that was looked at.
#[derive(Debug)]
pub struct Shown {
    /// Itself.
    pub picture: GreyPicture,
    /// What was found in it.
    pub corners: Vec<Corner>,
    /// Of which tags it says more than that.
    pub known: Vec<KnownTag>,
}

/// What a camera's first pictures at a configuration show.
#[derive(Debug)]
pub struct Neighbour {
    sight: Sight,
    expected: Expected,
}

impl Neighbour {
    /// The first pictures, and what was found in them: what any of them shows is expected in the others.
    ///
    /// `None` if they say nothing of other pictures: where they do not show the same, something else than tags is looked for, or a tag was measured
    /// at all four corners in none of them, so that another picture may show more of it.
    #[must_use]
    pub fn of(firsts: &[Shown], wanted: &[Pattern]) -> Option<Self> {
        if !wanted.iter().all(|pattern| matches!(pattern, Pattern::Tags { .. })) {
            return None;
        }
        let (first, others) = firsts.split_first()?;
        let sight = Sight::of(&first.picture);
        if !others.iter().all(|other| sight.is_of(&other.picture)) {
            return None;
        }
        let mut tags = BTreeMap::new();
        for shown in firsts.iter().rev() {
            for four in shown.corners.chunk_by(|a, b| (a.pattern, a.tag) == (b.pattern, b.tag)) {
                let tag = four.first()?;
                let (Pattern::Tags { dictionary, .. }, Some(id)) = (wanted.get(tag.pattern)?, tag.tag) else {
                    return None;
                };
                let known = tags.entry((tag.pattern, id)).or_insert(None);
                if let [a, b, c, d] = four {
                    let corners = [a.pixel, b.pixel, c.pixel, d.pixel];
                    let fit = shown.known.iter().find(|fit| (fit.tag().dictionary, fit.tag().id) == (*dictionary, id));
                    *known = Some((ExpectedTag { dictionary: *dictionary, id, corners }, fit));
                }
            }
        }
        let tags = tags.into_values().collect::<Option<Vec<(ExpectedTag, Option<&KnownTag>)>>>()?;
        let known = tags.iter().filter_map(|(_, fit)| fit.cloned()).collect();
        let tags = tags.into_iter().map(|(tag, _)| tag).collect();
        Some(Self { sight, expected: Expected { tags, known, all: true } })
    }

    /// What must be in another picture; `None` if it does not show the same.
    #[must_use]
    pub fn expected_in(&self, picture: &GreyPicture) -> Option<&Expected> {
        self.sight.is_of(picture).then_some(&self.expected)
    }
}
