//! From pixels to corners.
//!
//! Everything the solver knows of a picture it knows through the corners found here, and a corner
//! that is wrong in every picture alike cannot be averaged away later. This folder therefore does
//! two separate things: it *finds* patterns, which well-known libraries do well though slowly, and it *measures*
//! their corners, which they do badly (the common refinement pulls every corner of a tag a quarter
//! of a pixel towards its centre). Finding sits behind the [`Detector`] trait; measuring is our own:
//!
//! * [`picture`]: reads files into [`GreyPicture`]s, suspicious of sizes.
//! * [`edge_lines`]: a tag's corners, from straight lines fitted to its border's edges.
//! * `edge_tone`: what a camera's gamma and saturation do to edges, found and taken away.
//! * `whole_tag`: the same, from all cells at once, where cells are only a few blurs wide.
//! * `known_tag`, `known_lines`, `edge_kept`: either again in pictures that show the same.
//! * [`saddle`]: a board's corners, from the crossing of two edges.
//! * [`charuco`]: a ChArUco board's corners, from the tags on it.
//! * [`checkerboard`]: which corner of a checkerboard is the first, and whether that can be known.
//! * [`native`]: cellmap's own finder of tags and checkerboards.
//! * `opencv` (feature `opencv`): another, built on the system's OpenCV.
//! * [`patterns`]: what finders share.
//! * [`drawing`]: what was found, for the eye.
//!
//! **Pixels**: the centre of the top-left pixel is (0, 0). **Corners of a tag** are 0 top-left,
//! 1 top-right, 2 bottom-right, 3 bottom-left as printed; of a board, row * columns + column.

mod all_cells;
mod blurred_cells;
pub mod charuco;
pub mod checkerboard;
pub mod drawing;
mod edge_behind;
mod edge_fit;
mod edge_kept;
pub mod edge_lines;
mod edge_side;
mod edge_stations;
mod edge_step;
mod edge_tone;
mod known_lines;
mod known_tag;
mod lens;
pub mod native;
#[cfg(feature = "opencv")]
pub mod opencv;
pub mod patterns;
pub mod picture;
mod plane_map;
mod projection;
mod refinement;
pub mod saddle;
mod tag_pixels;
mod tag_sums;
mod tag_verdict;
mod whole_tag;
mod wide;

use thiserror::Error;

pub use crate::geometry::Pattern;
pub use crate::geometry::dictionary::Dictionary;
pub use edge_lines::Lens;
pub use known_tag::KnownTag;
pub use picture::{GreyPicture, PictureError};

/// One corner found in a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corner {
    /// Place of its pattern in the list that was asked for.
    pub pattern: usize,
    /// The tag's id; `None` for a board's own corner.
    pub tag: Option<u32>,
    /// Corner of the tag (0..4) or of the board (row * columns + column).
    pub corner: u32,
    /// Pixels, centre of the top-left pixel = (0, 0).
    pub pixel: [f64; 2],
    /// `[suu, suv, svv]` in px^2, where the detector can honestly tell.
    pub covariance: Option<[f64; 3]>,
}

/// Why a detection failed. Finding nothing is no failure.
#[derive(Debug, Error)]
pub enum DetectError {
    /// The pattern makes no sense, whatever the picture.
    #[error("pattern {pattern} cannot be looked for: {reason}")]
    Pattern {
        /// Its place in the list that was asked for.
        pattern: usize,
        /// Why.
        reason: String,
    },
    /// The detector does not know the dictionary.
    #[error("the {detector} detector does not know dictionary {dictionary}")]
    Dictionary {
        /// The detector's name.
        detector: &'static str,
        /// The dictionary.
        dictionary: Dictionary,
    },
    /// The library underneath gave up.
    #[error("{detector} failed while {doing}: {words}")]
    Library {
        /// The detector's name.
        detector: &'static str,
        /// What it was doing.
        doing: &'static str,
        /// The library's own words.
        words: String,
    },
}

/// A tag that must be in a picture, and where, by what is known of the cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExpectedTag {
    /// Its family.
    pub dictionary: Dictionary,
    /// Its number in its family.
    pub id: u32,
    /// Corners, px: 0 top-left .. 3 bottom-left as printed. A few pixels off does no harm.
    pub corners: [[f64; 2]; 4],
}

/// What must be in a picture.
#[derive(Debug, Clone, Default)]
pub struct Expected {
    /// The tags.
    pub tags: Vec<ExpectedTag>,
    /// Those of them that were fitted in a picture that shows the same.
    pub known: Vec<KnownTag>,
    /// Whether nothing else that is wanted can be in the picture.
    pub all: bool,
}

/// Finds patterns in pictures. One value serves all threads at once and keeps nothing between pictures.
pub trait Detector: Send + Sync {
    /// A short name for reports.
    fn name(&self) -> &'static str;

    /// Finds what is `wanted` in one picture.
    ///
    /// # Arguments
    /// * `lens` - the camera's distortion, if known: straight edges are straight only without it.
    /// * `wanted` - patterns; several may share a dictionary, which is then searched once.
    ///
    /// Returns corners sorted by pattern, tag and corner, the same on every run. Corners that could
    /// not be measured well are left out, tags whose id is seen twice are left out altogether.
    ///
    /// # Errors
    /// [`DetectError`]; finding nothing is an empty list.
    fn detect(
        &self,
        picture: &GreyPicture,
        lens: Option<&dyn Lens>,
        wanted: &[Pattern],
    ) -> Result<Vec<Corner>, DetectError>;

    /// As [`Detector::detect`], with a word on what must be in the picture. A tag that is where it was expected need not be searched
    /// for; if one is not, or if there may be others, the whole picture is searched as ever.
    ///
    /// # Errors
    /// As [`Detector::detect`].
    fn detect_expected(
        &self,
        picture: &GreyPicture,
        lens: Option<&dyn Lens>,
        wanted: &[Pattern],
        expected: &Expected,
    ) -> Result<Vec<Corner>, DetectError> {
        let _ = expected;
        self.detect(picture, lens, wanted)
    }

    /// As [`Detector::detect_expected`], and what the picture says of others that show the same: tags of which [`Expected::known`] saves a fit there.
    ///
    /// # Errors
    /// As [`Detector::detect`].
    fn detect_known(
        &self,
        picture: &GreyPicture,
        lens: Option<&dyn Lens>,
        wanted: &[Pattern],
        expected: &Expected,
    ) -> Result<(Vec<Corner>, Vec<KnownTag>), DetectError> {
        Ok((self.detect_expected(picture, lens, wanted, expected)?, Vec::new()))
    }
}
