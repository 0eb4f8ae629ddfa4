//! A ChArUco board's corners, from the tags found on it.
//!
//! The tags say which corner is which and, through a perspective map fitted to a few of them, about where
//! it is; the corner itself is then measured where two edges cross (see [`super::saddle`]). The map
//! is fitted anew for every corner from the nearest tags, since a lens that is not known bends the
//! board by more than a corner can be wrong.
//!
//! Two ways of laying out a board exist. OpenCV from 4.7 on: the top-left square is black, tags are
//! numbered from there row by row. Before ("legacy"): counted from the bottom, so that with an even
//! number of rows the top-left square is white. The tags' places tell which it is.
//!
//! Frame and numbering are those of OpenCV from 4.7 on: corner = row * (columns - 1) + column, from the
//! top-left, whichever way the board was printed.

use super::edge_lines::Refinement;
use super::patterns::FoundTag;
use super::picture::GreyPicture;
use super::plane_map::PlaneMap;
use super::saddle::{RoughCorner, refine_saddle};
use super::{Dictionary, Lens};

/// A board's measures; `marker` and `square` are edges in any one unit.
#[derive(Debug, Clone, Copy)]
pub struct CharucoBoard {
    /// Squares along x and y, each at least 2.
    pub squares: [usize; 2],
    /// Edge of a square.
    pub square: f64,
    /// Edge of a marker, less than that of a square.
    pub marker: f64,
    /// Id of the first marker.
    pub first_id: u32,
    /// The markers' dictionary.
    pub dictionary: Dictionary,
}

/// A board's corner: its number, pixel and covariance `[suu, suv, svv]`.
pub type BoardCorner = (u32, [f64; 2], [f64; 3]);

/// A tag with its corners on the board (in squares) and in the picture (px).
struct Placed {
    board: [[f64; 2]; 4],
    picture: [[f64; 2]; 4],
}

impl CharucoBoard {
    /// Number of markers on the board, printed the new or the legacy way.
    #[must_use]
    pub fn markers(&self, legacy: bool) -> usize {
        (0..self.squares[1])
            .map(|row| {
                (0..self.squares[0]).filter(|column| carries_marker(*column, row, legacy, self.squares[1])).count()
            })
            .sum()
    }

    /// A marker's four corners on the board, in squares, in id order.
    fn marker_corners(&self, legacy: bool) -> Vec<[[f64; 2]; 4]> {
        let margin = self.margin();
        let mut markers = Vec::new();
        for row in 0..self.squares[1] {
            for column in (0..self.squares[0]).filter(|column| carries_marker(*column, row, legacy, self.squares[1])) {
                let (left, top) = (column as f64 + margin, row as f64 + margin);
                let (right, bottom) = (column as f64 + 1.0 - margin, row as f64 + 1.0 - margin);
                markers.push([[left, top], [right, top], [right, bottom], [left, bottom]]);
            }
        }
        markers
    }

    /// White margin around a marker, in squares.
    fn margin(&self) -> f64 {
        (1.0 - self.marker / self.square) / 2.0
    }

    /// Measures the board's corners from the tags found in the picture; ids that are not the board's are ignored.
    ///
    /// An empty list if no two tags agree on where the board lies.
    #[must_use]
    pub fn corners(&self, picture: &GreyPicture, lens: Option<&dyn Lens>, tags: &[FoundTag]) -> Vec<BoardCorner> {
        let refined: Vec<FoundTag> = tags
            .iter()
            .map(|tag| FoundTag { corners: refined_or_rough(picture, lens, tag, self.dictionary), ..*tag })
            .collect();
        let new = self.place(&refined, false);
        // With an odd number of rows both ways of printing are one.
        let legacy = if self.squares[1].is_multiple_of(2) { self.place(&refined, true) } else { Vec::new() };
        let is_legacy = legacy.len() > new.len();
        let placed = if is_legacy { legacy } else { new };
        if placed.len() < 2 {
            return Vec::new();
        }
        let (columns, rows) = (self.squares[0].saturating_sub(1), self.squares[1].saturating_sub(1));
        let mut found = Vec::new();
        for row in 0..rows {
            for column in 0..columns {
                let place = [column as f64 + 1.0, row as f64 + 1.0];
                let Some(map) = near_map(&placed, place) else { continue };
                // The square beyond this corner, towards the last one.
                let black_ahead = !carries_marker(column + 1, row + 1, is_legacy, self.squares[1]);
                let rough = RoughCorner {
                    pixel: map.map(place),
                    square: map.square(place),
                    margin: self.margin(),
                    black_ahead: Some(black_ahead),
                };
                if let Refinement::Refined { pixel, covariance } = refine_saddle(picture, &rough) {
                    found.push(((row * columns + column) as u32, pixel, covariance));
                }
            }
        }
        found
    }

    /// The tags that lie where the board has them, as most of them see it.
    fn place(&self, tags: &[FoundTag], legacy: bool) -> Vec<Placed> {
        let markers = self.marker_corners(legacy);
        let candidates: Vec<Placed> = tags
            .iter()
            .filter_map(|tag| {
                let marker = tag.id.checked_sub(self.first_id)? as usize;
                Some(Placed { board: *markers.get(marker)?, picture: tag.corners })
            })
            .collect();
        // Every tag alone gives a map of the whole board. The one that most others agree with is believed;
        // a wrong id, or a tag of another board, agrees with nobody.
        let mut best: Vec<usize> = Vec::new();
        for candidate in &candidates {
            let Some(map) = PlaneMap::fit(&candidate.board, &candidate.picture) else { continue };
            let agreeing: Vec<usize> =
                (0..candidates.len()).filter(|other| agrees(&map, candidate, &candidates[*other])).collect();
            if agreeing.len() > best.len() {
                best = agreeing;
            }
        }
        candidates.into_iter().enumerate().filter(|(k, _)| best.contains(k)).map(|(_, placed)| placed).collect()
    }
}

/// Whether a tag lies where another tag's map puts it; the farther away the worse that map may be.
fn agrees(map: &PlaneMap, by: &Placed, tag: &Placed) -> bool {
    let (from, to) = (middle(&by.board), middle(&tag.board));
    let far = (from[0] - to[0]).hypot(from[1] - to[1]);
    let (expected, found) = (map.map(to), middle(&tag.picture));
    let size = (tag.picture[0][0] - tag.picture[2][0]).hypot(tag.picture[0][1] - tag.picture[2][1]);
    (expected[0] - found[0]).hypot(expected[1] - found[1]) < size * (0.3 + 0.15 * far)
}

/// The map fitted to the four tags nearest to a place on the board. `None` where no tag is near: far from
/// all tags it would only guess.
fn near_map(placed: &[Placed], place: [f64; 2]) -> Option<PlaneMap> {
    let distance = |tag: &Placed| {
        let centre = middle(&tag.board);
        (centre[0] - place[0]).hypot(centre[1] - place[1])
    };
    let mut nearest: Vec<&Placed> = placed.iter().collect();
    nearest.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
    nearest.truncate(4);
    // sqrt(1/2) is the distance of the tags beside a corner; 1.6 is the next but one.
    if nearest.first().is_none_or(|tag| distance(tag) > 1.7) {
        return None;
    }
    let board: Vec<[f64; 2]> = nearest.iter().flat_map(|tag| tag.board).collect();
    let picture: Vec<[f64; 2]> = nearest.iter().flat_map(|tag| tag.picture).collect();
    PlaneMap::fit(&board, &picture)
}

fn middle(corners: &[[f64; 2]; 4]) -> [f64; 2] {
    [0, 1].map(|axis: usize| corners.iter().map(|corner| corner[axis]).sum::<f64>() / 4.0)
}

/// Whether a square is white and carries a marker. Legacy boards count rows from the bottom.
fn carries_marker(column: usize, row: usize, legacy: bool, rows: usize) -> bool {
    let row = if legacy { rows - 1 + row } else { row };
    !(column + row).is_multiple_of(2)
}

/// The tag's corners, each refined where it can be: here they only say where to look.
fn refined_or_rough(
    picture: &GreyPicture,
    lens: Option<&dyn Lens>,
    tag: &FoundTag,
    dictionary: Dictionary,
) -> [[f64; 2]; 4] {
    let refined = tag.refine(picture, lens, dictionary);
    [0, 1, 2, 3].map(|corner: usize| match refined[corner] {
        Refinement::Refined { pixel, .. } => pixel,
        Refinement::Weak(_) => tag.corners[corner],
    })
}
