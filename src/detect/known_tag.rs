//! A tag that was fitted in one picture, to be measured in others that show the same.
//!
//! A robot stands still and several pictures are taken: from one to the next a tag moves by hundredths of a pixel, and over so little the fit of all cells
//! ([`super::whole_tag`]) is linear. So the slopes of all pixels and the normal matrix are kept, and another picture costs two sums of
//! slopes times residuals: one to bring the residuals to where they can be judged, one with robust weights. Each picture is measured by its own
//! pixels alone: to first order nothing of the noise of the picture that the slopes are from is left.

use nalgebra::{SMatrix, SVector};

use super::all_cells::in_picture;
use super::edge_lines::{Refinement, Weakness};
use super::lens::{Bender, Lens};
use super::patterns::FoundTag;
use super::picture::GreyPicture;
use super::tag_pixels::Pixels;
use super::tag_sums::{Slopes, UNKNOWNS, gradient};
use super::tag_verdict::{BELIEVED, Judge, spread};
use super::whole_tag::{IdealCorner, State, corners, covariances};
use super::wide::Lanes;
use super::{Dictionary, ExpectedTag};

/// Corners that move farther than this (px) are not where the slopes are right.
const NEAR: f64 = 0.3;

/// Corners found farther than this (px) from the tag's are another's.
const SAME_PLACE: f64 = 1.0;

/// A tag that was measured by all of its cells in one picture, ready to be measured in others that show the same.
#[derive(Debug, Clone)]
pub struct KnownTag {
    tag: ExpectedTag,
    fit: Linear,
}

impl KnownTag {
    /// A tag whose corners were measured by a fit; `None` if one of them was not.
    pub(super) fn new(dictionary: Dictionary, id: u32, measured: &[Refinement; 4], fit: Linear) -> Option<Self> {
        let mut corners = [[0.0; 2]; 4];
        for (corner, measured) in corners.iter_mut().zip(measured) {
            let Refinement::Refined { pixel, .. } = measured else { return None };
            *corner = *pixel;
        }
        Some(Self { tag: ExpectedTag { dictionary, id, corners }, fit })
    }

    /// Where it was.
    #[must_use]
    pub fn tag(&self) -> &ExpectedTag {
        &self.tag
    }

    /// Whether a tag that was found is this one where it was.
    pub(super) fn is(&self, found: &FoundTag, dictionary: Dictionary) -> bool {
        let near = |(a, b): (&[f64; 2], &[f64; 2])| (a[0] - b[0]).hypot(a[1] - b[1]) < SAME_PLACE;
        (self.tag.dictionary, self.tag.id) == (dictionary, found.id)
            && self.tag.corners.iter().zip(&found.corners).all(near)
    }

    /// Its corners in a picture that shows the same.
    pub(super) fn measure(&self, picture: &GreyPicture, lens: Option<&dyn Lens>) -> Result<[Refinement; 4], Weakness> {
        in_picture(&Bender(lens), self.fit.measure(picture)?)
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
    fn measure(&self, picture: &GreyPicture) -> Result<[IdealCorner; 4], Weakness> {
        let pixels = self.pixels.of(picture).ok_or(Weakness::TooFewEdges)?;
        let mut residuals: Vec<Lanes> = pixels
            .groups
            .iter()
            .zip(&self.expected)
            .map(|(group, expected)| std::array::from_fn(|lane| group.value[lane] - expected[lane]))
            .collect();
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
        let judge = Judge { bright_inside: self.bright_inside, scale: spread(&residuals, pixels.count) };
        let variance = judge.variance(&pixels, &residuals, &state)?;
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
