//! Whether two pictures show the same.
//!
//! A robot stands still and several pictures are taken: but for noise they are one picture. What one of them shows, and where, need not be
//! searched for in the others, if it is sure that nothing else has come into view. The tiles' extremes tell: a tag is not found where the
//! picture is flat, so that a tag that comes, or is no longer hidden, changes a tile by half of what a tile needs not to be flat, or by more.

use super::tiles::{Extremes, FLAT, tile_extremes};
use crate::detect::picture::GreyPicture;

/// Grey levels by which a tile of the same picture may differ: noise and a robot that stops a hundredth of a pixel elsewhere make five or six.
const ALIKE: u8 = FLAT / 2;

/// What a picture shows, to be compared with another. A 32nd part of the picture's memory.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Sight {
    size: [usize; 2],
    darkest: Vec<u8>,
    brightest: Vec<u8>,
}

impl Sight {
    /// One pass over the pixels.
    #[must_use]
    pub fn of(picture: &GreyPicture) -> Self {
        let Extremes { darkest, brightest, .. } = tile_extremes(picture);
        Self { size: [picture.width(), picture.height()], darkest, brightest }
    }

    /// Whether a picture shows the same: no tag has come into view, none has moved by a tenth of a pixel or so.
    #[must_use]
    pub fn is_of(&self, picture: &GreyPicture) -> bool {
        let other = Self::of(picture);
        let alike = |a: &[u8], b: &[u8]| {
            a.len() == b.len() && a.iter().zip(b).fold(0, |most, (a, b)| a.abs_diff(*b).max(most)) <= ALIKE
        };
        self.size == other.size && alike(&self.darkest, &other.darkest) && alike(&self.brightest, &other.brightest)
    }
}
