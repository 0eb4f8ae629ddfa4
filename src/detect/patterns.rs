//! From what a finder finds to what was wanted: the part that all finders share.
//!
//! A finder names tags and grids and says roughly where they are. Here tags whose id is seen twice are dropped, boards are put
//! together, and everything is measured.

use std::collections::BTreeMap;

use super::all_cells::Measured;
use super::charuco::CharucoBoard;
use super::edge_lines::{Refinement, RoughTag, measure_tags, refine_tag};
use super::known_lines::measure_lines;
use super::known_tag::{Fit, KnownTag};
use super::plane_map::PlaneMap;
use super::saddle::{RoughCorner, refine_saddle};
use super::{Corner, DetectError, Dictionary, GreyPicture, Lens, Pattern};

/// A tag as a finder reports it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FoundTag {
    /// Its number in its dictionary.
    pub id: u32,
    /// Rough corners in the picture, px: 0 top-left .. 3 bottom-left as printed.
    pub corners: [[f64; 2]; 4],
    /// Whether it is bright inside the edge that was found.
    pub bright_inside: bool,
    /// Whether the corners are within half a pixel; else they may be several pixels off.
    pub close: bool,
}

impl FoundTag {
    /// Measures its corners. Those of several tags of a picture are measured better together, by [`refine_found`].
    #[must_use]
    pub fn refine(&self, picture: &GreyPicture, lens: Option<&dyn Lens>, dictionary: Dictionary) -> [Refinement; 4] {
        let cells = self.cells(dictionary);
        refine_tag(picture, lens, &self.rough(dictionary, cells.as_deref()))
    }

    /// The cells within its edge: whether each has the shade of what is just outside the edge.
    fn cells(&self, dictionary: Dictionary) -> Option<Vec<bool>> {
        let edge = dictionary.edge_cells();
        let (side, around) = (dictionary.cells_per_side(), (dictionary.cells_per_side() - edge) / 2);
        let white_outside = !dictionary.data_around_border();
        dictionary.cells(self.id).map(|cells| {
            let within = (0..edge * edge).map(|k| (k / edge + around) * side + k % edge + around);
            within.map(|k| cells.get(k).is_some_and(|white| *white == white_outside)).collect()
        })
    }

    fn rough<'a>(&self, dictionary: Dictionary, cells: Option<&'a [bool]>) -> RoughTag<'a> {
        RoughTag {
            corners: self.corners,
            cells_per_side: dictionary.edge_cells(),
            bright_inside: self.bright_inside,
            close: self.close,
            cells,
        }
    }
}

/// Measures the corners of tags of one picture, which may be of several dictionaries; answers in their order.
#[must_use]
pub fn refine_found(
    picture: &GreyPicture,
    lens: Option<&dyn Lens>,
    tags: &[(FoundTag, Dictionary)],
) -> Vec<[Refinement; 4]> {
    measure_found(picture, lens, tags, false).into_iter().map(|(corners, _)| corners).collect()
}

/// The same; with `keep` also what of their fits holds in other pictures that show the same.
fn measure_found(
    picture: &GreyPicture,
    lens: Option<&dyn Lens>,
    tags: &[(FoundTag, Dictionary)],
    keep: bool,
) -> Vec<Measured> {
    let cells: Vec<Option<Vec<bool>>> = tags.iter().map(|(tag, dictionary)| tag.cells(*dictionary)).collect();
    let rough: Vec<RoughTag<'_>> =
        tags.iter().zip(&cells).map(|((tag, dictionary), cells)| tag.rough(*dictionary, cells.as_deref())).collect();
    measure_tags(picture, lens, &rough, keep)
}

/// The same for tags of which some are known from another picture.
fn measure_known(
    picture: &GreyPicture,
    lens: Option<&dyn Lens>,
    tags: &[(FoundTag, Dictionary)],
    known: &[KnownTag],
    keep: bool,
) -> Vec<Measured> {
    let mut measured: Vec<Option<[Refinement; 4]>> = vec![None; tags.len()];
    let (mut places, mut lines) = (Vec::new(), Vec::new());
    for (place, (tag, dictionary)) in tags.iter().enumerate() {
        match known.iter().find(|known| known.is(tag, *dictionary)).map(KnownTag::fit) {
            Some(Fit::Cells(fit)) => measured[place] = fit.measure(picture, lens).ok(),
            Some(Fit::Lines(fit)) => {
                places.push(place);
                lines.push(&**fit);
            }
            None => {}
        }
    }
    for (place, corners) in places.into_iter().zip(measure_lines(picture, lens, &lines).into_iter().flatten()) {
        measured[place] = Some(corners);
    }
    let unknown: Vec<_> =
        tags.iter().zip(&measured).filter(|(_, known)| known.is_none()).map(|(tag, _)| *tag).collect();
    let mut others = measure_found(picture, lens, &unknown, keep).into_iter();
    measured.into_iter().filter_map(|known| known.map(|corners| (corners, None)).or_else(|| others.next())).collect()
}

/// Finds patterns roughly.
pub(super) trait Finder {
    /// Every tag of some dictionaries, an id as often as it is seen; in the order of `dictionaries`.
    fn tags(&self, picture: &GreyPicture, dictionaries: &[Dictionary]) -> Result<Vec<Vec<FoundTag>>, DetectError>;

    /// A checkerboard's rough corners in canonical order, if a believable one is in the picture.
    fn checkerboard(
        &self,
        picture: &GreyPicture,
        columns: usize,
        rows: usize,
    ) -> Result<Option<Vec<[f64; 2]>>, DetectError>;
}

/// [`super::Detector::detect`] by means of a finder, with tags that are `known` from a picture that shows the same. Those that may be known in others are put
/// into `keep`.
pub(super) fn detect_with(
    finder: &dyn Finder,
    picture: &GreyPicture,
    lens: Option<&dyn Lens>,
    wanted: &[Pattern],
    known: &[KnownTag],
    mut keep: Option<&mut Vec<KnownTag>>,
) -> Result<Vec<Corner>, DetectError> {
    let mut dictionaries: Vec<Dictionary> = wanted
        .iter()
        .filter_map(|pattern| match pattern {
            Pattern::Tags { dictionary, .. } | Pattern::Charuco { dictionary, .. } => Some(*dictionary),
            Pattern::Checkerboard { .. } => None,
        })
        .collect();
    dictionaries.sort_unstable();
    dictionaries.dedup();
    let found: Vec<Vec<FoundTag>> = if dictionaries.is_empty() {
        Vec::new()
    } else {
        finder.tags(picture, &dictionaries)?.into_iter().map(without_doubles).collect()
    };
    let found_of = |dictionary: &Dictionary| {
        let place = dictionaries.iter().position(|one| one == dictionary);
        place.and_then(|place| found.get(place)).map_or(&[] as &[FoundTag], Vec::as_slice)
    };
    let mut corners = Vec::new();
    // Tags of all patterns and what pattern each belongs to.
    let (mut tags, mut patterns) = (Vec::new(), Vec::new());
    for (index, pattern) in wanted.iter().enumerate() {
        let refused = |reason: &str| DetectError::Pattern { pattern: index, reason: reason.to_owned() };
        match pattern {
            Pattern::Tags { dictionary, ids } => {
                let wanted = found_of(dictionary).iter().filter(|tag| ids.contains(&tag.id));
                tags.extend(wanted.map(|tag| (*tag, *dictionary)));
                patterns.resize(tags.len(), index);
            }
            Pattern::Checkerboard { columns, rows } => {
                if *columns < 3 || *rows < 3 {
                    return Err(refused("a checkerboard needs at least 3 x 3 inner corners"));
                }
                if let Some(grid) = finder.checkerboard(picture, *columns, *rows)? {
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
                    return Err(refused("the board has more markers than its dictionary has tags from first_id on"));
                }
                let board = CharucoBoard {
                    squares: *squares,
                    square: *square,
                    marker: *marker,
                    first_id: *first_id,
                    dictionary: *dictionary,
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
    let measured = measure_known(picture, lens, &tags, known, keep.is_some());
    for ((pattern, (tag, dictionary)), (refined, fit)) in patterns.iter().zip(&tags).zip(measured) {
        if let (Some(keep), Some(fit)) = (keep.as_deref_mut(), fit) {
            keep.extend(KnownTag::new(picture, tag, *dictionary, &refined, fit));
        }
        for (corner, refinement) in (0..).zip(refined) {
            if let Refinement::Refined { pixel, covariance } = refinement {
                let (tag, covariance) = (Some(tag.id), Some(covariance));
                corners.push(Corner { pattern: *pattern, tag, corner, pixel, covariance });
            }
        }
    }
    corners.sort_by_key(|corner| (corner.pattern, corner.tag, corner.corner));
    Ok(corners)
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
    let mut by_id: BTreeMap<u32, Vec<FoundTag>> = BTreeMap::new();
    for tag in tags {
        by_id.entry(tag.id).or_default().push(tag);
    }
    by_id
        .into_values()
        .filter_map(|mut places| {
            places.sort_by(|a, b| diagonal(&b.corners).total_cmp(&diagonal(&a.corners)));
            let largest = *places.first()?;
            let near = |tag: &FoundTag| {
                (0..4).all(|k| {
                    let (here, there) = (tag.corners[k], largest.corners[k]);
                    (here[0] - there[0]).hypot(here[1] - there[1]) < 0.25 * diagonal(&largest.corners)
                })
            };
            places.iter().all(near).then_some(largest)
        })
        .collect()
}

fn diagonal(corners: &[[f64; 2]; 4]) -> f64 {
    (corners[0][0] - corners[2][0]).hypot(corners[0][1] - corners[2][1])
}
