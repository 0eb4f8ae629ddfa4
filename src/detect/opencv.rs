//! The finder built on the system's OpenCV (4.6 with contrib `aruco`).
//!
//! OpenCV only *finds*: rough quadrangles with ids, rough grids. All measuring is done by
//! [`super::edge_lines`] and [`super::saddle`] on the same pixels.
//!
//! OpenCV's own threads are switched off, since pictures are the unit of work and every core already has
//! one; each call has its own matrix, dictionary and parameters, so that nothing is shared between threads.

use std::collections::BTreeMap;
use std::sync::Once;

use ::opencv::boxed_ref::BoxedRef;
use ::opencv::core::{Mat, Point2f, Ptr, Size, Vector};
use ::opencv::prelude::*;
use ::opencv::{aruco, calib3d, core};

use super::charuco::{CharucoBoard, FoundTag};
use super::checkerboard;
use super::edge_lines::{Refinement, refine_quad};
use super::plane_map::PlaneMap;
use super::saddle::{RoughCorner, refine_saddle};
use super::{Corner, DetectError, Detector, Dictionary, GreyPicture, Lens, Pattern};

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
        // OpenCV before 4.7 ends here.
        let number = dictionary.opencv_number().filter(|number| *number <= Dictionary::AprilTag36h11 as i32);
        let Some(number) = number else {
            return Err(DetectError::Dictionary { detector: "opencv", dictionary });
        };
        let mat = borrow(picture).map_err(&failed)?;
        let tags = (|| {
            let family = aruco::get_predefined_dictionary_i32(number)?;
            let mut parameters = aruco::DetectorParameters::default()?;
            parameters.set_corner_refinement_method(aruco::CornerRefineMethod::CORNER_REFINE_NONE as i32);
            // Read the middle third of each cell only, finely: the rough corners are up to a pixel off, and cells
            // of small tags are not much wider. Finds half as many tags again in the AprilTag photographs.
            parameters.set_perspective_remove_pixel_per_cell(8);
            parameters.set_perspective_remove_ignored_margin_per_cell(0.33);
            // Two tags side by side are not one tag twice until they nearly coincide.
            parameters.set_min_marker_distance_rate(0.02);
            let parameters = Ptr::new(parameters);
            let (mut corners, mut rejected) = (Vector::<Vector<Point2f>>::new(), Vector::<Vector<Point2f>>::new());
            let mut ids = Vector::<i32>::new();
            aruco::detect_markers(&mat, &family, &mut corners, &mut ids, &parameters, &mut rejected)?;
            Ok::<_, ::opencv::Error>(
                ids.iter().zip(corners.iter()).map(|(id, quad)| (id, quad.to_vec())).collect::<Vec<_>>(),
            )
        })()
        .map_err(&failed)?;
        // OpenCV keeps AprilRobotics' families turned by half a turn.
        let turn = if dictionary.is_april_tag() { 2 } else { 0 };
        Ok(tags
            .into_iter()
            .filter_map(|(id, quad)| {
                let quad: [Point2f; 4] = quad.try_into().ok()?;
                let corners = [0, 1, 2, 3].map(|corner: usize| quad[(corner + turn) % 4]);
                Some((u32::try_from(id).ok()?, corners.map(|corner| [f64::from(corner.x), f64::from(corner.y)])))
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
    let flags = calib3d::CALIB_CB_ADAPTIVE_THRESH | calib3d::CALIB_CB_NORMALIZE_IMAGE | calib3d::CALIB_CB_FAST_CHECK;
    let found = calib3d::find_chessboard_corners(mat, size, &mut corners, flags)?;
    Ok(found.then(|| corners.iter().map(|corner| [f64::from(corner.x), f64::from(corner.y)]).collect()))
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
        let mut tags: BTreeMap<Dictionary, Vec<FoundTag>> = BTreeMap::new();
        for pattern in wanted {
            if let Pattern::Tags { dictionary, .. } | Pattern::Charuco { dictionary, .. } = pattern
                && !tags.contains_key(dictionary)
            {
                tags.insert(*dictionary, without_doubles(self.find_tags(picture, *dictionary)?));
            }
        }
        let found_of = |dictionary: &Dictionary| tags.get(dictionary).map_or(&[] as &[FoundTag], Vec::as_slice);
        let mut corners = Vec::new();
        for (index, pattern) in wanted.iter().enumerate() {
            let refused = |reason: &str| DetectError::Pattern { pattern: index, reason: reason.to_owned() };
            match pattern {
                Pattern::Tags { dictionary, ids } => {
                    for (id, rough) in found_of(dictionary).iter().filter(|(id, _)| ids.contains(id)) {
                        let refined = refine_quad(picture, lens, *rough, dictionary.cells_per_side());
                        for (corner, refinement) in (0..).zip(refined) {
                            if let Refinement::Refined { pixel, covariance } = refinement {
                                corners.push(Corner {
                                    pattern: index,
                                    tag: Some(*id),
                                    corner,
                                    pixel,
                                    covariance: Some(covariance),
                                });
                            }
                        }
                    }
                }
                Pattern::Checkerboard { columns, rows } => {
                    // OpenCV's own limit: it throws below three.
                    if *columns < 3 || *rows < 3 {
                        return Err(refused("a checkerboard needs at least 3 x 3 inner corners"));
                    }
                    if let Some(grid) = self.find_checkerboard(picture, *columns, *rows)? {
                        corners.extend(measure_grid(picture, &grid, *columns, *rows, index));
                    }
                }
                Pattern::Charuco { squares, square, marker, dictionary, first_id } => {
                    if squares[0] < 2 || squares[1] < 2 || !(*marker > 0.0 && marker < square && square.is_finite()) {
                        return Err(refused(
                            "a ChArUco board needs at least 2 x 2 squares and markers smaller than its squares",
                        ));
                    }
                    // Also keeps an absurd number of squares from costing an absurd amount of memory.
                    let markers = squares[0].checked_mul(squares[1]).map(|squares| squares / 2);
                    let last = markers.and_then(|markers| markers.checked_add(*first_id as usize));
                    if last.is_none_or(|last| last > dictionary.tag_count() as usize) {
                        return Err(refused(
                            "the board has more markers than its dictionary has tags from first_id on",
                        ));
                    }
                    let cells_per_side = dictionary.cells_per_side();
                    let board = CharucoBoard {
                        squares: *squares,
                        square: *square,
                        marker: *marker,
                        first_id: *first_id,
                        cells_per_side,
                    };
                    corners.extend(board.corners(picture, lens, found_of(dictionary)).into_iter().map(
                        |(corner, pixel, covariance)| Corner {
                            pattern: index,
                            tag: None,
                            corner,
                            pixel,
                            covariance: Some(covariance),
                        },
                    ));
                }
            }
        }
        corners.sort_by_key(|corner| (corner.pattern, corner.tag, corner.corner));
        Ok(corners)
    }
}

/// Measures each corner of a grid where its edges cross.
fn measure_grid(picture: &GreyPicture, grid: &[[f64; 2]], columns: usize, rows: usize, pattern: usize) -> Vec<Corner> {
    let places: Vec<[f64; 2]> = (0..grid.len()).map(|k| [(k % columns) as f64, (k / columns) as f64]).collect();
    debug_assert_eq!(grid.len(), columns * rows);
    let Some(map) = PlaneMap::fit(&places, grid) else { return Vec::new() };
    (0..)
        .zip(grid.iter().zip(places))
        .filter_map(|(corner, (pixel, place))| {
            let rough = RoughCorner { pixel: *pixel, square: map.square(place), margin: 0.5, black_ahead: None };
            match refine_saddle(picture, &rough) {
                Refinement::Refined { pixel, covariance } => {
                    Some(Corner { pattern, tag: None, corner, pixel, covariance: Some(covariance) })
                }
                Refinement::Weak(_) => None,
            }
        })
        .collect()
}

/// Drops tags whose id is seen at two places: one of them is somewhere else (a reflection, a second print, a
/// misreading), nothing says which, and one wrong tag does more harm than a missing one. The same
/// tag found twice, by its inner and outer contour, is one tag: the larger is its border.
fn without_doubles(tags: Vec<FoundTag>) -> Vec<FoundTag> {
    let mut by_id: BTreeMap<u32, Vec<[[f64; 2]; 4]>> = BTreeMap::new();
    for (id, corners) in tags {
        by_id.entry(id).or_default().push(corners);
    }
    by_id
        .into_iter()
        .filter_map(|(id, mut places)| {
            places.sort_by(|a, b| diagonal(b).total_cmp(&diagonal(a)));
            let largest = *places.first()?;
            let near = |corners: &[[f64; 2]; 4]| {
                (0..4).all(|k| {
                    (corners[k][0] - largest[k][0]).hypot(corners[k][1] - largest[k][1]) < 0.25 * diagonal(&largest)
                })
            };
            places.iter().all(near).then_some((id, largest))
        })
        .collect()
}

fn diagonal(corners: &[[f64; 2]; 4]) -> f64 {
    (corners[0][0] - corners[2][0]).hypot(corners[0][1] - corners[2][1])
}

/// A picture as OpenCV sees it, without a copy.
fn borrow(picture: &GreyPicture) -> ::opencv::Result<BoxedRef<'_, Mat>> {
    Mat::new_rows_cols_with_data(i32::try_from(picture.height())?, i32::try_from(picture.width())?, picture.pixels())
}

fn library(doing: &'static str) -> impl Fn(::opencv::Error) -> DetectError {
    move |error| DetectError::Library { detector: NAME, doing, words: error.message.clone() }
}
