//! The finder built on the system's OpenCV: 4.6 and before with its contrib module `aruco`, 4.7 and after without.
//!
//! OpenCV only *finds*: rough quadrangles with ids, rough grids. All measuring is done by
//! [`crate::detect::edge_lines`] and [`crate::detect::saddle`] on the same pixels.
//!
//! OpenCV's own threads are switched off, since pictures are the unit of work and every core already has
//! one; each call has its own matrix, dictionary and parameters, so that nothing is shared between threads.

use std::sync::Once;

use ::opencv::boxed_ref::BoxedRef;
#[cfg(opencv_before_5)]
use ::opencv::calib3d as boards;
use ::opencv::core::{self, Mat, Point2f, Size, Vector};
#[cfg(not(opencv_before_5))]
use ::opencv::objdetect as boards;
use ::opencv::prelude::*;

use super::checkerboard;
use super::patterns::{Finder, FoundTag, detect_with};
use super::{Corner, DetectError, Detector, Dictionary, GreyPicture, Lens, Pattern};
#[cfg(opencv_before_4_7)]
use contrib as tags;
#[cfg(not(opencv_before_4_7))]
use objdetect as tags;

/// Sets the parameters that both of OpenCV's interfaces have.
macro_rules! usual_parameters {
    ($parameters:ident, $no_refinement:path) => {
        $parameters.set_corner_refinement_method($no_refinement as i32);
        // Read the middle third of each cell only, finely: the rough corners are up to a pixel off, and cells
        // of small tags are not much wider. Finds half as many tags again in the AprilTag photographs.
        $parameters.set_perspective_remove_pixel_per_cell(8);
        $parameters.set_perspective_remove_ignored_margin_per_cell(0.33);
    };
}

#[cfg(opencv_before_4_7)]
mod contrib;
#[cfg(not(opencv_before_4_7))]
mod objdetect;

const NAME: &str = "opencv";

/// Tags, checkerboards and ChArUco boards by OpenCV. Cheap to make and to share.
#[derive(Debug, Clone, Copy)]
pub struct OpenCvDetector(());

impl OpenCvDetector {
    /// # Errors
    /// [`DetectError::Library`] if OpenCV refuses to be told its number of threads.
    pub fn new() -> Result<Self, DetectError> {
        static ONCE: Once = Once::new();
        let mut outcome = Ok(());
        ONCE.call_once(|| outcome = core::set_num_threads(1));
        outcome.map_err(library("starting"))?;
        Ok(Self(()))
    }

    /// Every tag of one dictionary in the picture: id and rough corners, in the order OpenCV found them,
    /// an id as often as it was seen. Corners are 0 top-left .. 3 bottom-left as printed.
    ///
    /// # Errors
    /// [`DetectError::Library`].
    pub fn find_tags(&self, picture: &GreyPicture, dictionary: Dictionary) -> Result<Vec<FoundTag>, DetectError> {
        let failed = library("looking for tags");
        let Some(number) = dictionary.opencv_number().filter(|number| *number <= tags::LAST) else {
            return Err(DetectError::Dictionary { detector: NAME, dictionary });
        };
        let mat = borrow(picture).map_err(&failed)?;
        let (ids, corners) = tags::find(&mat, number).map_err(&failed)?;
        // OpenCV keeps AprilRobotics' families turned by half a turn.
        let turn = if dictionary.is_april_tag() { 2 } else { 0 };
        Ok(ids
            .iter()
            .zip(corners.iter())
            .filter_map(|(id, quad)| {
                let quad: [Point2f; 4] = quad.to_vec().try_into().ok()?;
                let corners = [0, 1, 2, 3].map(|corner: usize| quad[(corner + turn) % 4]);
                Some(FoundTag {
                    id: u32::try_from(id).ok()?,
                    corners: corners.map(|corner| [f64::from(corner.x), f64::from(corner.y)]),
                    bright_inside: false,
                    close: false,
                })
            })
            .collect())
    }

    /// A checkerboard's rough corners in canonical order, if a believable one is in the picture.
    ///
    /// # Errors
    /// [`DetectError::Library`].
    pub fn find_checkerboard(
        &self,
        picture: &GreyPicture,
        columns: usize,
        rows: usize,
    ) -> Result<Option<Vec<[f64; 2]>>, DetectError> {
        let failed = library("looking for a checkerboard");
        let mat = borrow(picture).map_err(&failed)?;
        let size = || Some(Size::new(i32::try_from(columns).ok()?, i32::try_from(rows).ok()?));
        let Some(size) = size() else { return Ok(None) };
        let grid = find_grid(&mat, size).map_err(&failed)?;
        Ok(grid
            .filter(|grid| checkerboard::plausible(picture, grid, columns, rows))
            .and_then(|grid| checkerboard::canonical(picture, &grid, columns, rows))
            .map(|canonical| canonical.corners))
    }
}

/// The classic finder with its quick test for absence first. Measured on 60 pictures of small boards (metric; half
/// of them show none) at 1920x1080: this finds 25 boards in 17 ms a picture; without the quick test 26 in 195 ms;
/// twice enlarged still 25 or 26, in 220 to 900 ms; `findChessboardCornersSB` of OpenCV 4.6 takes 350 to 490 ms and of
/// its 26 grids at most 10 are right, since it takes a small board's white rim for a row. On a large board
/// (kuka_2) all find all.
fn find_grid(mat: &impl core::ToInputArray, size: Size) -> ::opencv::Result<Option<Vec<[f64; 2]>>> {
    let mut corners = Vector::<Point2f>::new();
    let flags = boards::CALIB_CB_ADAPTIVE_THRESH | boards::CALIB_CB_NORMALIZE_IMAGE | boards::CALIB_CB_FAST_CHECK;
    let found = boards::find_chessboard_corners(mat, size, &mut corners, flags)?;
    Ok(found.then(|| corners.iter().map(|corner| [f64::from(corner.x), f64::from(corner.y)]).collect()))
}

impl Finder for OpenCvDetector {
    fn tags(&self, picture: &GreyPicture, dictionaries: &[Dictionary]) -> Result<Vec<Vec<FoundTag>>, DetectError> {
        dictionaries.iter().map(|dictionary| self.find_tags(picture, *dictionary)).collect()
    }

    fn checkerboard(
        &self,
        picture: &GreyPicture,
        columns: usize,
        rows: usize,
    ) -> Result<Option<Vec<[f64; 2]>>, DetectError> {
        self.find_checkerboard(picture, columns, rows)
    }
}

impl Detector for OpenCvDetector {
    fn name(&self) -> &'static str {
        NAME
    }

    fn detect(
        &self,
        picture: &GreyPicture,
        lens: Option<&dyn Lens>,
        wanted: &[Pattern],
    ) -> Result<Vec<Corner>, DetectError> {
        detect_with(self, picture, lens, wanted, &[], None)
    }
}

/// A picture as OpenCV sees it, without a copy.
fn borrow(picture: &GreyPicture) -> ::opencv::Result<BoxedRef<'_, Mat>> {
    Mat::new_rows_cols_with_data(i32::try_from(picture.height())?, i32::try_from(picture.width())?, picture.pixels())
}

fn library(doing: &'static str) -> impl Fn(::opencv::Error) -> DetectError {
    move |error| DetectError::Library { detector: NAME, doing, words: error.message.clone() }
}
