//! What was measured, by number, as the loop reads it.

use nalgebra::Vector3;
use std::ops::Range;

use crate::geometry::{Feature, Pose};
use crate::recording::{Appearance, Corners};

/// Two points at a known distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// The first, in the frame the path starts in, m.
    pub a: Vector3<f64>,
    /// The second, in the frame at the path's end, m.
    pub b: Vector3<f64>,
    /// m.
    pub distance: f64,
}

/// All measurements, flat. Corners stay where the recording has them, and a place on a target stands once: of a corner, the plan holds nine bytes.
#[derive(Clone, Debug, Default)]
pub struct Measurements {
    /// The recording's corners.
    corners: Corners,
    /// By number among the recording's names, and some more: place in the frame at the end of a path, m.
    places: Vec<[f64; 3]>,
    /// By corner: the row of the recording, the number of its place, and whether it was set aside.
    rows: Vec<u32>,
    place_of: Vec<u32>,
    aside: Vec<bool>,
    /// Added in quadrature to every covariance, px.
    floor: f64,
    /// The whitener of a corner without a covariance.
    plain: [f64; 3],
    /// Whole poses, `sensor_from_target`; none where rejected.
    pub poses: Vec<Option<Pose>>,
    /// Points: place in the frame at the path's end, and measured position in the sensor's frame (m); none where rejected.
    pub points: Vec<Option<(Vector3<f64>, Vector3<f64>)>>,
    /// Contacts; none where rejected.
    pub contacts: Vec<Option<Contact>>,
}

impl Measurements {
    /// None yet, of corners that are at `places` by the numbers of their names; `floor` is the detector's standard deviation, px.
    pub(super) fn new(corners: &Corners, places: Vec<[f64; 3]>, floor: f64) -> Self {
        Self {
            corners: corners.clone(),
            places,
            rows: Vec::with_capacity(corners.len()),
            place_of: Vec::with_capacity(corners.len()),
            aside: Vec::with_capacity(corners.len()),
            floor,
            plain: whitener([0.0; 3], floor),
            ..Self::default()
        }
    }

    /// Takes up neighbouring corners of the recording.
    pub(super) fn add_corners(&mut self, rows: Range<usize>) {
        self.rows.extend(rows.start as u32..rows.end as u32);
        self.place_of.extend_from_slice(&self.corners.marks()[rows]);
        self.aside.resize(self.rows.len(), false);
    }

    /// How many corners there are, those set aside included.
    #[must_use]
    pub fn corner_count(&self) -> usize {
        self.rows.len()
    }

    /// The row of the recording that corner `i` is.
    #[must_use]
    pub fn row(&self, i: usize) -> usize {
        self.rows[i] as usize
    }

    /// Which corner of its target corner `i` was read as.
    #[must_use]
    pub fn feature(&self, i: usize) -> &Feature {
        self.corners.feature(self.row(i))
    }

    /// Where corner `i` is in the frame at the path's end, m.
    #[inline]
    #[must_use]
    pub fn place(&self, i: usize) -> [f64; 3] {
        self.places[self.place_of[i] as usize]
    }

    /// Whether two runs of corners show the same places in the same order, with the same ones set aside.
    pub(super) fn show_alike(&self, a: Range<usize>, b: Range<usize>) -> bool {
        self.place_of[a.clone()] == self.place_of[b.clone()] && self.aside[a] == self.aside[b]
    }

    /// The pixel of corner `i`.
    #[inline]
    #[must_use]
    pub fn pixel(&self, i: usize) -> [f64; 2] {
        self.corners.pixels()[self.rows[i] as usize]
    }

    /// Whether corner `i` has not been set aside.
    #[inline]
    #[must_use]
    pub fn is_kept(&self, i: usize) -> bool {
        !self.aside[i]
    }

    /// `[a, b, c]` with the whitened residual `(a du, b du + c dv)` of corner `i`; zeros if it was set aside.
    #[inline]
    #[must_use]
    pub fn whitener(&self, i: usize) -> [f64; 3] {
        if self.aside[i] {
            return [0.0; 3];
        }
        match self.corners.covariance(self.rows[i] as usize) {
            Some(covariance) => whitener(covariance, self.floor),
            None => self.plain,
        }
    }

    /// The squared whitened norm of a residual (px) of corner `i`.
    #[must_use]
    pub fn whitened(&self, i: usize, d: [f64; 2]) -> f64 {
        let [a, b, c] = self.whitener(i);
        let (u, v) = (a * d[0], b * d[0] + c * d[1]);
        u * u + v * v
    }

    /// Sets corner `i` aside.
    pub fn set_aside(&mut self, i: usize) {
        self.aside[i] = true;
    }

    /// Adds places for [`Measurements::put_at`]; returns the number of the first.
    pub(crate) fn add_places(&mut self, places: impl Iterator<Item = [f64; 3]>) -> u32 {
        let first = self.places.len() as u32;
        self.places.extend(places);
        first
    }

    /// Takes corner `i` for the one at another place, by its number.
    pub(crate) fn put_at(&mut self, i: usize, place: u32) {
        self.place_of[i] = place;
    }

    /// Neighbouring corners by what they belong to in the recording: numbers, and the appearance.
    pub fn appearances(&self, range: Range<usize>) -> impl Iterator<Item = (Range<usize>, &Appearance)> {
        let mut start = range.start;
        let mut likely = 0;
        std::iter::from_fn(move || {
            let row = self.row(*Some(&start).filter(|start| **start < range.end)?);
            let known = self.corners.appearances();
            // Mostly the next one.
            let one = match known.get(likely).filter(|one| one.corners().contains(&row)) {
                Some(one) => one,
                None => {
                    likely = self.corners.place_of(row);
                    &known[likely]
                }
            };
            likely += 1;
            // Rows of a block ascend, so those of one appearance are next to each other.
            let rest = &self.rows[start..range.end];
            let count = rest.iter().take_while(|row| one.corners().contains(&(**row as usize))).count();
            let found = start..start + count;
            start += count;
            Some((found, one))
        })
    }

    /// The number of scalar measurements that have not been rejected.
    pub(super) fn scalar_count(&self) -> usize {
        2 * self.aside.iter().filter(|aside| !**aside).count()
            + 6 * self.poses.iter().flatten().count()
            + 3 * self.points.iter().flatten().count()
            + self.contacts.iter().flatten().map(|contact| if contact.distance == 0.0 { 3 } else { 1 }).sum::<usize>()
    }
}

/// `[a, b, c]` with `W^T W` the inverse of the covariance: the transposed inverse Cholesky factor. `floor` (px) is added in quadrature.
fn whitener([suu, suv, svv]: [f64; 3], floor: f64) -> [f64; 3] {
    let (suu, svv) = (suu + floor * floor, svv + floor * floor);
    let l11 = suu.sqrt();
    let l21 = suv / l11;
    let l22 = (svv - l21 * l21).max(1e-12).sqrt();
    [1.0 / l11, -l21 / (l11 * l22), 1.0 / l22]
}
