//! A tag that was measured by lines along its sides in one picture, in others that show the same.
//!
//! The estimator of [`super::edge_lines`] with all that is not a matter of a picture's grey values decided once: which pixels belong to which station, the
//! blur, the tone, the lens about its corners. Edges, the lines through them, what belongs to a line, the shift by the camera's answer to light and the
//! covariances are each picture's own.

use super::edge_fit::SideFit;
use super::edge_kept::KeptStations;
use super::edge_lines::{Lines, Refinement, RoughTag, Weakness, judged};
use super::edge_side::{Side, edges};
use super::edge_stations::{Profile, Stations};
use super::edge_tone::{Shift, Tone, inner_sides};
use super::known_tag::NEAR;
use super::lens::{Bender, Lens};
use super::picture::GreyPicture;
use super::projection::cross;
use super::wide::Lanes;

/// A place of a side's line at one of its ends.
#[derive(Debug, Clone, Copy)]
struct End {
    /// Distance outside the side, px.
    offset: f64,
    /// Ideal pixel, and how it moves with the distance.
    ideal: [f64; 2],
    slope: [f64; 2],
}

/// What of a tag's lines holds in other pictures.
#[derive(Debug)]
pub(super) struct KnownLines {
    rough: [[f64; 2]; 4],
    cells_per_side: usize,
    tone: f64,
    sides: [KnownSide; 4],
}

#[derive(Debug)]
struct KnownSide {
    side: Side,
    stations: KeptStations,
    /// Those of the border's inner edge.
    inner: Option<KeptStations>,
    ends: [End; 2],
}

/// The lines of one tag in one picture.
struct NewLines {
    fits: [SideFit; 4],
    shift: Option<Shift>,
}

impl KnownLines {
    /// From the lines of a tag of which all sides are measured.
    pub fn of(
        lines: &Lines,
        picture: &GreyPicture,
        bender: &Bender<'_>,
        tag: &RoughTag<'_>,
        stations: &mut Stations,
    ) -> Result<Box<Self>, Weakness> {
        let tone = lines.expected.tone;
        let inner = inner_sides(bender, tag, lines.ideal).unwrap_or_default();
        let mut sides = Vec::with_capacity(4);
        for ((k, side), inner) in lines.sides.iter().enumerate().zip(&inner) {
            let fit = lines.fits[k]?;
            let neighbours = [&lines.sides[(k + 3) % 4], &lines.sides[(k + 1) % 4]];
            let profile = Profile { blur: fit.blur, tone };
            sides.push(KnownSide {
                side: side.clone(),
                stations: side.keep(picture, neighbours, lines.expected, stations),
                inner: inner.as_ref().map(|inner| inner.keep_bright_cells(picture, profile, stations)),
                ends: [End::of(bender, side, &fit, 0.0)?, End::of(bender, side, &fit, side.length)?],
            });
        }
        let sides = sides.try_into().map_err(|_| Weakness::TooFewEdges)?;
        Ok(Box::new(Self { rough: lines.rough, cells_per_side: tag.cells_per_side, tone, sides }))
    }

    /// The lines in another picture; `None` if a side cannot be measured, or is not where it was.
    fn look(&self, picture: &GreyPicture, values: &mut Vec<Lanes>) -> Option<NewLines> {
        let mut fits = Vec::with_capacity(4);
        let mut inner = Vec::with_capacity(4);
        for known in &self.sides {
            let KnownSide { side, stations, ends, .. } = known;
            let steps = stations.steps(picture, values)?;
            let fit = side.line(&steps, stations.count, stations.blur).ok()?;
            let near = |(end, u): (&End, f64)| (fit.at(u) - end.offset).abs() < NEAR;
            if !ends.iter().zip([0.0, side.length]).all(near) {
                return None;
            }
            if let Some(stations) = &known.inner {
                inner.push((edges(&stations.steps(picture, values)?).unwrap_or_default(), fit));
            }
            fits.push(fit);
        }
        let shift = Shift::of_edges(inner.into_iter(), self.cells_per_side);
        Some(NewLines { fits: fits.try_into().ok()?, shift })
    }

    /// Its corners, the tone's shift taken away.
    fn corners(&self, bender: &Bender<'_>, found: &NewLines, tone: &Tone) -> Option<[Refinement; 4]> {
        let shift = tone.shift(found.shift);
        let fits = found.fits.map(|fit| shift.taken_from(fit));
        let lines = [0, 1, 2, 3].map(|k: usize| {
            let KnownSide { side, ends, .. } = &self.sides[k];
            [ends[0].moved(fits[k].at(0.0)), ends[1].moved(fits[k].at(side.length))]
        });
        let mut pixels = [[0.0; 2]; 4];
        for (corner, pixel) in pixels.iter_mut().enumerate() {
            *pixel = bender.distort(cross(lines[(corner + 3) % 4], lines[corner])?).ok()?;
        }
        let sides = [0, 1, 2, 3].map(|k: usize| &self.sides[k].side);
        Some(judged(self.rough, pixels, sides, &fits.map(Ok)))
    }
}

impl End {
    /// Of a side's line, at a place along the side.
    fn of(bender: &Bender<'_>, side: &Side, fit: &SideFit, u: f64) -> Result<Self, Weakness> {
        const STEP: f64 = 0.25;
        let at = |offset: f64| bender.undistort(side.point(u, offset));
        let offset = fit.at(u);
        let ideal = at(offset)?;
        let [before, after] = [at(offset - STEP)?, at(offset + STEP)?];
        let slope = [0, 1].map(|axis: usize| (after[axis] - before[axis]) / (2.0 * STEP));
        Ok(Self { offset, ideal, slope })
    }

    /// The ideal pixel at another distance.
    fn moved(&self, offset: f64) -> [f64; 2] {
        [0, 1].map(|axis: usize| self.ideal[axis] + (offset - self.offset) * self.slope[axis])
    }
}

/// Corners of tags of one picture, together, since they share the camera's tone; `None` if one of them is not where it was.
pub(super) fn measure_lines(
    picture: &GreyPicture,
    lens: Option<&dyn Lens>,
    tags: &[&KnownLines],
) -> Option<Vec<[Refinement; 4]>> {
    let bender = Bender(lens);
    let mut values = Vec::new();
    let found: Vec<NewLines> = tags.iter().map(|tag| tag.look(picture, &mut values)).collect::<Option<_>>()?;
    let tone = tags.first().map_or(0.0, |tag| tag.tone);
    let tone = Tone::of(tone, found.iter().filter_map(|found| found.shift));
    tags.iter().zip(&found).map(|(tag, found)| tag.corners(&bender, found, &tone)).collect()
}
