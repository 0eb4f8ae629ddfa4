//! A tag that was measured in one picture, to be measured in others that show the same.
//!
//! A robot stands still and several pictures are taken: from one to the next a tag moves by hundredths of a pixel. It need not be read again: its cells are
//! looked at where they were, and must be as they were. And over so little the fit that measured it is linear: that of all cells
//! ([`super::whole_tag`]), of which the slopes of all pixels and the normal matrix are kept, so that another picture costs two sums of
//! slopes times residuals (one to bring the residuals to where they can be judged, one with robust weights); or that of lines along its sides
//! ([`super::known_lines`]). Each picture is measured by its own pixels alone: to first order nothing of the noise of the picture that the slopes are from
//! is left.

use std::sync::Arc;

use nalgebra::{SMatrix, SVector};

use super::all_cells::in_picture;
use super::edge_lines::{Refinement, Weakness};
use super::known_lines::KnownLines;
use super::lens::{Bender, Lens};
use super::patterns::FoundTag;
use super::picture::GreyPicture;
use super::projection::Projection;
use super::tag_pixels::{Neighbours, Pixels};
use super::tag_sums::{Slopes, UNKNOWNS, gradient};
use super::tag_verdict::{BELIEVED, Judge, spread};
use super::whole_tag::{IdealCorner, State, corners, covariances};
use super::wide::Lanes;
use super::{Dictionary, ExpectedTag};

/// Corners that move farther than this (px) are not where the slopes are right.
pub(super) const NEAR: f64 = 0.3;

/// Corners found farther than this (px) from the tag's are another's.
const SAME_PLACE: f64 = 1.0;

/// A tag that was measured in one picture, ready to be measured in others that show the same.
#[derive(Debug, Clone)]
pub struct KnownTag {
    tag: ExpectedTag,
    bright_inside: bool,
    cells: Arc<SeenCells>,
    fit: Arc<Fit>,
}

/// How a tag was measured.
#[derive(Debug)]
pub(super) enum Fit {
    /// By all of its cells at once.
    Cells(Box<Linear>),
    /// By lines along its sides.
    Lines(Box<KnownLines>),
}

impl KnownTag {
    /// A tag whose corners were measured in a picture by a fit; `None` if one of them was not, or if its cells cannot be seen.
    pub(super) fn new(
        picture: &GreyPicture,
        found: &FoundTag,
        dictionary: Dictionary,
        measured: &[Refinement; 4],
        fit: Fit,
    ) -> Option<Self> {
        let mut corners = [[0.0; 2]; 4];
        for (corner, measured) in corners.iter_mut().zip(measured) {
            let Refinement::Refined { pixel, .. } = measured else { return None };
            *corner = *pixel;
        }
        Some(Self {
            tag: ExpectedTag { dictionary, id: found.id, corners },
            bright_inside: found.bright_inside,
            cells: Arc::new(SeenCells::of(picture, corners, dictionary.edge_cells())?),
            fit: Arc::new(fit),
        })
    }

    /// Where it was.
    #[must_use]
    pub fn tag(&self) -> &ExpectedTag {
        &self.tag
    }

    /// The tag, if another picture shows the same cells in the same place.
    pub(super) fn found_in(&self, picture: &GreyPicture) -> Option<FoundTag> {
        let ExpectedTag { id, corners, .. } = self.tag;
        let found = FoundTag { id, corners, bright_inside: self.bright_inside, close: true };
        self.cells.are_in(picture).then_some(found)
    }

    /// Whether a tag that was found is this one where it was.
    pub(super) fn is(&self, found: &FoundTag, dictionary: Dictionary) -> bool {
        let near = |(a, b): (&[f64; 2], &[f64; 2])| (a[0] - b[0]).hypot(a[1] - b[1]) < SAME_PLACE;
        (self.tag.dictionary, self.tag.id) == (dictionary, found.id)
            && self.tag.corners.iter().zip(&found.corners).all(near)
    }

    /// How it is measured.
    pub(super) fn fit(&self) -> &Fit {
        &self.fit
    }
}

/// How the cells of a tag and of one ring around it look.
#[derive(Debug)]
struct SeenCells {
    /// Their middles in 1/65536 px, and their shades in 1/65536 grey levels.
    cells: Vec<([i64; 2], i32)>,
    /// How much a shade may change.
    most: i32,
}

impl SeenCells {
    /// Part of the step between dark and bright by which a cell may change: one that is another changes by all of it.
    const CHANGE: f64 = 0.4;

    fn of(picture: &GreyPicture, corners: [[f64; 2]; 4], edge: usize) -> Option<Self> {
        let map = Projection::from_unit_square(corners)?;
        let place = |k: usize| (k as f64 - 0.5) / edge as f64;
        let all = (0..edge + 2).flat_map(|row| (0..edge + 2).map(move |column| map.map([place(column), place(row)])));
        let cells: Vec<([i64; 2], i32)> = all
            .filter_map(|at| {
                let at = at.map(|place| (place * 65536.0) as i64);
                Some((at, picture.sample_fixed(at[0], at[1])?))
            })
            .collect();
        let mut shades: Vec<i32> = cells.iter().map(|cell| cell.1).collect();
        shades.sort_unstable();
        // The border and what is around it make up a quarter each, or more.
        let [dark, bright] = [shades.len() / 8, shades.len() * 7 / 8].map(|k: usize| shades.get(k).copied());
        Some(Self { cells, most: (Self::CHANGE * f64::from(bright? - dark?)) as i32 })
    }

    fn are_in(&self, picture: &GreyPicture) -> bool {
        self.cells
            .iter()
            .all(|([x, y], shade)| picture.sample_fixed(*x, *y).is_some_and(|here| (here - shade).abs() <= self.most))
    }
}

/// A fit of all cells, made linear.
#[derive(Debug, Clone)]
pub(super) struct Linear {
    pub per_side: usize,
    pub bright_inside: bool,
    /// Where places are counted from, ideal px.
    pub middle: [f64; 2],
    pub pixels: Pixels,
    pub neighbours: Neighbours,
    /// What the fit says of each pixel, and its slopes.
    pub expected: Vec<Lanes>,
    pub slopes: Vec<Slopes>,
    /// Of the normal matrix.
    pub inverse: SMatrix<f64, UNKNOWNS, UNKNOWNS>,
    pub state: State,
    /// Standard deviation of the residuals.
    pub scale: f64,
    /// How much the tone that is expected counts.
    pub certainty: f64,
}

impl Linear {
    /// The corners in another picture.
    pub fn measure(&self, picture: &GreyPicture, lens: Option<&dyn Lens>) -> Result<[Refinement; 4], Weakness> {
        in_picture(&Bender(lens), self.ideal_corners(picture)?)
    }

    fn ideal_corners(&self, picture: &GreyPicture) -> Result<[IdealCorner; 4], Weakness> {
        let values = self.pixels.values_in(picture).ok_or(Weakness::TooFewEdges)?;
        let residual = |(value, expected): (&Lanes, &Lanes)| std::array::from_fn(|lane| value[lane] - expected[lane]);
        let mut residuals: Vec<Lanes> = values.iter().zip(&self.expected).map(residual).collect();
        let first = self.step([0.0; UNKNOWNS], f64::INFINITY, &mut residuals);
        let second = self.step(first, BELIEVED * self.scale, &mut residuals);
        let total = [0, 1, 2, 3, 4, 5, 6, 7].map(|k: usize| first[k] + second[k]);
        let mut state = self.state.clone();
        state.map.add(total);
        state.light[3] += first[14] + second[14];
        let (before, after) = (corners(&self.state.map, self.per_side), corners(&state.map, self.per_side));
        let near = |k: usize| (before[k][0] - after[k][0]).hypot(before[k][1] - after[k][1]) < NEAR;
        if !(0..4).all(near) {
            return Err(Weakness::MovedTooFar);
        }
        let count = self.pixels.count;
        let judge = Judge { bright_inside: self.bright_inside, scale: spread(&residuals, count) };
        let variance = judge.variance(count, &self.neighbours, [&values, &residuals], &state)?;
        let covariances = covariances(&state.map, self.per_side, &self.inverse);
        Ok([0, 1, 2, 3].map(|k: usize| {
            let pixel = [after[k][0] + self.middle[0], after[k][1] + self.middle[1]];
            (pixel, covariances[k].map(|number| variance * number))
        }))
    }

    /// The step that follows on another, of which the residuals know nothing yet.
    fn step(&self, taken: [f64; UNKNOWNS], believed: f64, residuals: &mut [Lanes]) -> [f64; UNKNOWNS] {
        let mut gradient =
            SVector::from(gradient(&self.slopes, taken.map(|step| step as f32), believed as f32, residuals));
        gradient[15] -= self.certainty * (self.state.tone + taken[15]);
        (self.inverse * gradient).into()
    }
}
