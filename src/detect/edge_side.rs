//! One side of a tag: where exactly is the edge between its black border and the white around it?
//!
//! The edge is measured on the pixels themselves, never on interpolated ones: interpolation blurs by
//! an amount that changes with the place between pixels, and that alone moves an edge by hundredths
//! of a pixel. Every pixel near the side has a distance `d` from it, positive outwards, and a value.
//! Pixels are gathered in *stations*, a few columns (or rows) each along the side, and at each station
//! a blurred step is fitted by least squares (see [`super::edge_stations`]): the normal distribution's integral, since optics, the area of a
//! pixel and a printer's ink add up to something near it, and since it is symmetric an imperfect
//! blur does not move the edge. The blur is common to the side; dark, contrast and edge belong to the
//! station, since light changes along a side. Only a rise outwards counts (for a bright border: a fall).
//!
//! Stations share no pixels, so their errors are independent, and the scatter of their edges about
//! the straight line is an honest measure of how well the line is known. That needs no idea of the
//! camera's noise.
//!
//! What must be kept out: the data cells, which may be white and begin one cell inside the edge;
//! whatever lies beyond the white margin, which may be one cell wide only; and the tag's corners,
//! which are round in a blurred picture. The first two limit `d`, the last is a clearance from the
//! neighbouring sides.

use super::edge_behind::Behind;
use super::edge_fit::{Edge, SideFit, fit_line};
use super::edge_kept::KeptStations;
use super::edge_lines::Weakness;
use super::edge_stations::{Profile, Stations, Step};
use super::picture::GreyPicture;

/// Fewer stations than this are no line.
const MINIMUM_STATIONS: usize = 4;
/// Grey levels between border and margin below which an edge is no edge.
const MINIMUM_CONTRAST: f64 = 8.0;
/// Bounds of the edge's blur, px: a pixel's own area alone gives 0.29.
const BLUR_BOUNDS: [f64; 2] = [0.35, 4.0];
/// Half the width, in pixels, of the band of pixels that is looked at; beyond it there is only noise.
const WIDEST_GATE: f64 = 3.0;
/// Passes over the samples of a side.
const SWEEPS: usize = 3;
/// Blurs between a station at a bright cell and the next dark one.
const CELL_CLEARANCE: f64 = 2.0;
/// Systematic error allowed for at one station, px: print, Bayer pattern, JPEG.
const STATION_FLOOR: f64 = 0.01;

/// A side as it is known before a fit.
#[derive(Debug, Clone)]
pub(super) struct Side {
    /// First corner, pixels.
    pub start: [f64; 2],
    /// Unit vector from the first corner to the second.
    pub along: [f64; 2],
    /// Unit vector across, away from the tag.
    pub outward: [f64; 2],
    /// Distance between the two corners, px.
    pub length: f64,
    /// How far the lens bends the side outwards.
    pub bend: Option<Bend>,
    /// Width across the side of the border's cell inside, and of the margin's cell outside, at the
    /// first and the second corner, px.
    pub inner_cell: [f64; 2],
    pub outer_cell: [f64; 2],
    /// Whether the border is bright and what is around it dark.
    pub bright_inside: bool,
    /// The cells behind the border, where the tag has been read.
    pub behind: Option<Behind>,
}

/// A bent side as a polynomial of the place along it, through five points.
#[derive(Debug, Clone)]
pub(crate) struct Bend {
    places: [f64; 5],
    coefficients: [f64; 5],
}

impl Bend {
    /// Newton's divided differences through (place along, distance outside). The places are where the points
    /// *are*: a lens moves points along a side too, by pixels, and a bend at the wrong place is a wrong bend.
    pub fn through(points: [[f64; 2]; 5]) -> Self {
        let places = points.map(|point| point[0]);
        let mut coefficients = points.map(|point| point[1]);
        for order in 1..5 {
            for k in (order..5).rev() {
                let apart = places[k] - places[k - order];
                coefficients[k] = (coefficients[k] - coefficients[k - 1]) / apart;
            }
        }
        Self { places, coefficients }
    }

    /// Value and slope.
    fn at(&self, u: f64) -> (f64, f64) {
        self.coefficients.iter().zip(&self.places).rev().fold((0.0, 0.0), |(value, slope), (coefficient, place)| {
            (value * (u - place) + coefficient, slope * (u - place) + value)
        })
    }
}

impl Side {
    /// Distance of a point outside the straight line through the two corners, px.
    fn outside(&self, point: [f64; 2]) -> f64 {
        (point[0] - self.start[0]) * self.outward[0] + (point[1] - self.start[1]) * self.outward[1]
    }

    /// The pixel at a place along the straight line, so far outside of it.
    pub fn point(&self, u: f64, outside: f64) -> [f64; 2] {
        [0, 1].map(|axis: usize| self.start[axis] + u * self.along[axis] + outside * self.outward[axis])
    }

    /// The bend at u px from the start, and its slope.
    fn bend_at(&self, u: f64) -> (f64, f64) {
        self.bend.as_ref().map_or((0.0, 0.0), |bend| bend.at(u))
    }

    fn lerp(&self, ends: [f64; 2], u: f64) -> f64 {
        ends[0] + (ends[1] - ends[0]) * (u / self.length).clamp(0.0, 1.0)
    }

    /// A rough fit that forgives a start several pixels off: at places along the side the steepest
    /// rise outwards within reach, then a robust line. `None` leaves the side where it is.
    pub fn fit_roughly(&self, picture: &GreyPicture) -> Option<SideFit> {
        const PLACES: usize = 16;
        const STEP: f64 = 0.5;
        let mut edges = Vec::with_capacity(PLACES);
        for place in 0..PLACES {
            let u = self.length * (0.12 + 0.76 * place as f64 / (PLACES - 1) as f64);
            // Less than a cell either way, or the next black cell or another tag would be in reach.
            let inner = (0.8 * self.lerp(self.inner_cell, u)).clamp(1.5, 8.0);
            let outer = (0.8 * self.lerp(self.outer_cell, u)).clamp(1.5, 8.0);
            let (bend, _) = self.bend_at(u);
            let sign = if self.bright_inside { -1.0 } else { 1.0 };
            let value = |d: f64| {
                let d = d + bend;
                picture
                    .sample(
                        self.start[0] + u * self.along[0] + d * self.outward[0],
                        self.start[1] + u * self.along[1] + d * self.outward[1],
                    )
                    .map(|value| sign * value)
            };
            let mut best = (MINIMUM_CONTRAST / 2.0, None);
            for step in 0..=((inner + outer) / STEP) as usize {
                let d = -inner + step as f64 * STEP;
                if let (Some(outside), Some(inside)) = (value(d + 0.75), value(d - 0.75))
                    && outside - inside > best.0
                {
                    best = (outside - inside, Some(d));
                }
            }
            if let Some(d) = best.1 {
                edges.push(Edge { u, offset: d, weight: 1.0 });
            }
        }
        if edges.len() < PLACES / 2 {
            return None;
        }
        let (line, _) = fit_line(&mut edges, 0.25)?;
        Some(line)
    }

    /// The exact fit; see the module's head. The side must be within a pixel or two of the edge.
    ///
    /// `neighbours` are the two sides it meets, `expected` is a first idea of the edge's blur and the camera's tone.
    pub fn fit(
        &self,
        picture: &GreyPicture,
        neighbours: [&Side; 2],
        expected: Profile,
        stations: &mut Stations,
    ) -> Result<SideFit, Weakness> {
        let blur = self.fit_stations(picture, neighbours, expected, stations);
        self.line(&stations.steps(), stations.len(), blur)
    }

    /// The stations of an exact fit, to be measured in other pictures.
    pub fn keep(
        &self,
        picture: &GreyPicture,
        neighbours: [&Side; 2],
        expected: Profile,
        stations: &mut Stations,
    ) -> KeptStations {
        let blur = self.fit_stations(picture, neighbours, expected, stations);
        stations.keep(Profile { blur, ..expected }, widest(expected.blur), self.bright_inside, picture)
    }

    /// Fits the stations; returns the side's blur.
    fn fit_stations(
        &self,
        picture: &GreyPicture,
        neighbours: [&Side; 2],
        expected: Profile,
        stations: &mut Stations,
    ) -> f64 {
        let blur = expected.blur;
        let clearance = (3.0 * blur).max(2.0);
        let clear = |_: f64, ends: [[f64; 2]; 2]| {
            ends.iter().all(|end| neighbours.iter().all(|side| side.outside(*end) < -clearance))
        };
        let shine = |u: f64| {
            self.behind.as_ref().map_or(0.0, |behind| behind.shine(u / self.length, blur / self.length) as f32)
        };
        self.gather(picture, widest(blur), stations, clear, shine);
        stations.fit(expected, BLUR_BOUNDS, widest(blur), SWEEPS)
    }

    /// The line through what stations found, of which there were so many.
    pub fn line(&self, steps: &[Step], count: usize, blur: f64) -> Result<SideFit, Weakness> {
        let mut edges = edges(steps).ok_or(Weakness::TooFewEdges)?;
        if edges.len() < MINIMUM_STATIONS {
            return Err(if edges.len() * 2 < count { Weakness::NoContrast } else { Weakness::TooFewEdges });
        }
        let (line, scatter) = fit_line(&mut edges, 0.02).ok_or(Weakness::TooFewEdges)?;
        if edges.len() < MINIMUM_STATIONS || edges.len() * 2 < count {
            return Err(Weakness::NotStraight);
        }
        let (first, last) =
            edges.iter().fold((f64::MAX, f64::MIN), |(low, high), edge| (edge.u.min(low), edge.u.max(high)));
        // A line known at one end only says nothing about the corner at the other.
        if last - first < 0.4 * self.length {
            return Err(Weakness::TooFewEdges);
        }
        if scatter > 0.6 {
            return Err(Weakness::NotStraight);
        }
        Ok(SideFit { blur, ..line })
    }

    /// The edges between the border and the bright cells behind it, for a side that is the border's inner one (its [`Behind`] lies outside then).
    /// The side must be within a fraction of a pixel of them.
    pub fn fit_bright_cells(&self, picture: &GreyPicture, expected: Profile, stations: &mut Stations) -> Vec<Edge> {
        self.fit_bright_stations(picture, expected, stations);
        edges(&stations.steps()).unwrap_or_default()
    }

    /// The stations of these edges, to be measured in other pictures.
    pub fn keep_bright_cells(&self, picture: &GreyPicture, expected: Profile, stations: &mut Stations) -> KeptStations {
        let blur = self.fit_bright_stations(picture, expected, stations);
        stations.keep(Profile { blur, ..expected }, widest(expected.blur), self.bright_inside, picture)
    }

    fn fit_bright_stations(&self, picture: &GreyPicture, expected: Profile, stations: &mut Stations) -> f64 {
        let clearance = CELL_CLEARANCE * expected.blur / self.length;
        // The margin is what lies beyond the border.
        let clear = |u: f64, _: [[f64; 2]; 2]| {
            self.behind.as_ref().is_some_and(|behind| behind.is_bright(u / self.length, clearance))
        };
        self.gather(picture, widest(expected.blur), stations, clear, |_| 1.0);
        stations.fit(expected, BLUR_BOUNDS, widest(expected.blur), SWEEPS)
    }

    /// The pixels near the side, in stations: from the rows or columns that are clear, by their place along the side and their first and last pixel. `shine` is
    /// the part of what lies behind the border that is bright at a place along the side.
    fn gather(
        &self,
        picture: &GreyPicture,
        widest: f64,
        stations: &mut Stations,
        clear: impl Fn(f64, [[f64; 2]; 2]) -> bool,
        shine: impl Fn(f64) -> f32,
    ) {
        stations.clear();
        let major = usize::from(self.along[0].abs() < self.along[1].abs());
        let minor = 1 - major;
        let end = [self.start[0] + self.length * self.along[0], self.start[1] + self.length * self.along[1]];
        let extent = [picture.width(), picture.height()];
        let per_station = (self.length / 80.0).ceil().max(2.0) as usize;
        let shade = |value: u8| f32::from(if self.bright_inside { u8::MAX - value } else { value });
        let stride = if minor == 0 { 1 } else { picture.width() };

        let (low, high) = (self.start[major].min(end[major]), self.start[major].max(end[major]));
        let mut lines_in_station = 0;
        for line in whole_numbers(low, high, extent[major]) {
            // Where this row or column crosses the side.
            let u = (line as f64 - self.start[major]) / self.along[major];
            let (bend, lean) = self.bend_at(u);
            let centre = self.start[minor] + u * self.along[minor];
            // One pixel further: along the side, and outside the (bent) side.
            let (du, dd) = (self.along[minor], self.outward[minor] - lean * self.along[minor]);
            if dd.abs() < 0.3 {
                continue;
            }
            let (inner, outer) = (self.lerp(self.inner_cell, u), self.lerp(self.outer_cell, u));
            let reach = |cell: f64| cell.min(widest);
            let (a, b) = (centre + (bend - reach(inner)) / dd, centre + (bend + reach(outer)) / dd);
            let places = whole_numbers(a.min(b), a.max(b), extent[minor]);
            let point = |place: usize| {
                if major == 0 { [line as f64, place as f64] } else { [place as f64, line as f64] }
            };
            if places.is_empty() || !clear(u, [point(places.start), point(places.end - 1)]) {
                continue;
            }
            let first =
                if major == 0 { places.start * picture.width() + line } else { line * picture.width() + places.start };
            let from_centre = places.start as f64 - centre;
            let values = picture.pixels().get(first..).unwrap_or(&[]).iter().step_by(stride).take(places.len());
            stations.push(
                [(u + from_centre * du) as f32, (from_centre * dd - bend) as f32],
                [du as f32, dd as f32],
                [first, stride],
                values.map(|value| shade(*value)),
            );
            lines_in_station += 1;
            if lines_in_station >= per_station && stations.filling() >= 8 {
                let u = f64::from(stations.place());
                let (inner, outer) = (self.lerp(self.inner_cell, u), self.lerp(self.outer_cell, u));
                stations.complete(inner as f32, outer as f32, shine(u));
                lines_in_station = 0;
            }
        }
        stations.abandon();
    }
}

/// How far pixels may be from a side to be looked at, px.
fn widest(blur: f64) -> f64 {
    WIDEST_GATE.max(3.0 * blur)
}

/// The edges that stations found, with their weights.
pub(super) fn edges(steps: &[Step]) -> Option<Vec<Edge>> {
    let noise = pixel_noise(steps)?;
    let believed = |step: &Step| {
        let variance = step.information_inverse * noise + STATION_FLOOR.powi(2);
        (step.contrast > MINIMUM_CONTRAST && step.contrast > 3.0 * noise.sqrt() && variance < 0.25).then(|| Edge {
            u: step.u,
            offset: step.edge,
            weight: 1.0 / variance,
        })
    };
    Some(steps.iter().filter_map(believed).collect())
}

/// Variance of a grey value about the fitted steps; the median station, so that a few bad ones do
/// not spoil the weights of all.
fn pixel_noise(steps: &[Step]) -> Option<f64> {
    let mut variances: Vec<f64> = steps.iter().map(|step| step.noise).collect();
    if variances.is_empty() {
        return None;
    }
    let middle = variances.len() / 2;
    // A quarter of a grey level squared: rounding to whole grey levels alone is a twelfth.
    Some(variances.select_nth_unstable_by(middle, f64::total_cmp).1.max(0.25))
}

/// The whole numbers from `low` to `high` that are rows or columns of a picture.
fn whole_numbers(low: f64, high: f64, extent: usize) -> std::ops::Range<usize> {
    // Conversion to integers cuts towards zero and saturates, so that NaN and far-away places give an empty range.
    let first = low.max(0.0) as usize;
    let first = if (first as f64) < low { first.saturating_add(1) } else { first };
    let end = if high >= 0.0 { (high as usize).saturating_add(1) } else { 0 };
    first..end.min(extent)
}

#[cfg(test)]
mod tests {
    use super::whole_numbers;

    #[test]
    fn a_side_may_lie_anywhere() {
        assert_eq!(whole_numbers(1.5, 3.5, 10), 2..4);
        assert_eq!(whole_numbers(-3.0, 20.0, 10), 0..10);
        for (low, high) in [
            (1e30, 2e30),
            (f64::NAN, f64::NAN),
            (-2e30, -1e30),
            (-f64::INFINITY, f64::NEG_INFINITY),
            (1e30, f64::INFINITY),
        ] {
            assert!(whole_numbers(low, high, 10).is_empty(), "{low} to {high}");
        }
    }
}
