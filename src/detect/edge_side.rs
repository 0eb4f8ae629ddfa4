//! One side of a tag: where exactly is the edge between its black border and the white around it?
//!
//! The edge is measured on the pixels themselves, never on interpolated ones: interpolation blurs by
//! an amount that changes with the place between pixels, and that alone moves an edge by hundredths
//! of a pixel. Every pixel near the side has a distance `d` from it, positive outwards, and a value.
//! Pixels are gathered in *stations*, a few columns (or rows) each along the side, and at each station
//! a blurred step
//!
//! ```text
//! value(d) = dark + contrast * Phi((d - edge) / blur)
//! ```
//!
//! is fitted by least squares. `Phi` is the normal distribution's integral: optics, the area of a
//! pixel and a printer's ink add up to something near it, and since it is symmetric an imperfect
//! `blur` does not move the edge. `blur` is common to the side, the other three belong to the
//! station, since light changes along a side. Only a rise outwards counts.
//!
//! Stations share no pixels, so their errors are independent, and the scatter of their edges about
//! the straight line is an honest measure of how well the line is known. That needs no idea of the
//! camera's noise.
//!
//! What must be kept out: the data cells, which may be white and begin one cell inside the edge;
//! whatever lies beyond the white margin, which may be one cell wide only; and the tag's corners,
//! which are round in a blurred picture. The first two limit `d`, the last is a clearance from the
//! neighbouring sides.

use super::edge_fit::{Edge, SideFit, Station, better_blur, fit_line, fit_steps, pixel_noise};
use super::edge_lines::Weakness;
use super::picture::GreyPicture;

/// Fewer stations than this are no line.
const MINIMUM_STATIONS: usize = 4;
/// Grey levels between border and margin below which an edge is no edge.
pub(super) const MINIMUM_CONTRAST: f64 = 8.0;
/// Half the width, in pixels, of the band of pixels that is looked at; beyond it there is only noise.
pub(super) const WIDEST_GATE: f64 = 3.5;
/// Systematic error allowed for at one station, px: print, Bayer pattern, JPEG.
const STATION_FLOOR: f64 = 0.01;

/// A side as it is known before a fit.
#[derive(Debug, Clone)]
pub(crate) struct Side {
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
}

/// A bent side as a polynomial of the place along it, through five points.
#[derive(Debug, Clone)]
pub(crate) struct Bend {
    places: [f64; 5],
    coefficients: [f64; 5],
    /// The largest of the five, px.
    widest: f64,
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
        Self { places, coefficients, widest: points.iter().fold(0.0, |most, point| most.max(point[1].abs())) }
    }

    fn at(&self, u: f64) -> f64 {
        self.coefficients
            .iter()
            .zip(&self.places)
            .rev()
            .fold(0.0, |sum, (coefficient, place)| sum * (u - place) + coefficient)
    }
}

impl Side {
    /// Place along the side and distance outside it, px.
    fn place(&self, point: [f64; 2]) -> [f64; 2] {
        let delta = [point[0] - self.start[0], point[1] - self.start[1]];
        let u = delta[0] * self.along[0] + delta[1] * self.along[1];
        let d = delta[0] * self.outward[0] + delta[1] * self.outward[1];
        [u, d - self.bend_at(u)]
    }

    /// Distance of a point outside the straight line through the two corners, px.
    fn outside(&self, point: [f64; 2]) -> f64 {
        (point[0] - self.start[0]) * self.outward[0] + (point[1] - self.start[1]) * self.outward[1]
    }

    /// The bend at u px from the start.
    fn bend_at(&self, u: f64) -> f64 {
        self.bend.as_ref().map_or(0.0, |bend| bend.at(u))
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
            let bend = self.bend_at(u);
            let value = |d: f64| {
                let d = d + bend;
                picture.sample(
                    self.start[0] + u * self.along[0] + d * self.outward[0],
                    self.start[1] + u * self.along[1] + d * self.outward[1],
                )
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
    /// `neighbours` are the two sides it meets, `blur` a first idea of the edge's blur in px.
    pub fn fit(&self, picture: &GreyPicture, neighbours: [&Side; 2], blur: f64) -> Result<SideFit, Weakness> {
        let stations = self.gather(picture, neighbours, blur);
        let mut steps = vec![None; stations.len()];
        fit_steps(&stations, &mut steps, blur, 2);
        // The blur is the side's own. One step settles it, since a pass begins where the last one ended.
        let blur = better_blur(&stations, &steps, blur);
        fit_steps(&stations, &mut steps, blur, 1);
        let noise = pixel_noise(&stations, &steps).ok_or(Weakness::TooFewEdges)?;
        let mut edges: Vec<Edge> = stations
            .iter()
            .zip(&steps)
            .filter_map(|(station, step)| {
                let step = step.as_ref()?;
                let variance = step.information_inverse * noise + STATION_FLOOR.powi(2);
                (step.contrast > MINIMUM_CONTRAST && step.contrast > 3.0 * noise.sqrt() && variance < 0.25)
                    .then(|| Edge { u: station.middle, offset: step.edge, weight: 1.0 / variance })
            })
            .collect();
        if edges.len() < MINIMUM_STATIONS {
            return Err(if edges.len() * 2 < stations.len() { Weakness::NoContrast } else { Weakness::TooFewEdges });
        }
        let (line, scatter) = fit_line(&mut edges, 0.02).ok_or(Weakness::TooFewEdges)?;
        if edges.len() < MINIMUM_STATIONS || edges.len() * 2 < stations.len() {
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

    /// The pixels near the side, in stations.
    fn gather(&self, picture: &GreyPicture, neighbours: [&Side; 2], blur: f64) -> Vec<Station> {
        let major = usize::from(self.along[0].abs() < self.along[1].abs());
        let minor = 1 - major;
        let end = [self.start[0] + self.length * self.along[0], self.start[1] + self.length * self.along[1]];
        let extent = [picture.width(), picture.height()];
        let widest_bend = self.bend.as_ref().map_or(0.0, |bend| bend.widest);
        let half = (WIDEST_GATE + widest_bend) / self.along[major].abs().max(0.5);
        let clearance = (3.0 * blur).max(2.0);
        let per_station = (self.length / 80.0).ceil().max(2.0) as usize;

        let (low, high) = (self.start[major].min(end[major]), self.start[major].max(end[major]));
        let mut stations = Vec::new();
        let mut station = Station::default();
        let mut lines_in_station = 0;
        for line in whole_numbers(low, high, extent[major]) {
            let u = (line as f64 - self.start[major]) / self.along[major];
            let centre = self.start[minor] + u * self.along[minor];
            for place in whole_numbers(centre - half, centre + half, extent[minor]) {
                let point = if major == 0 { [line as f64, place as f64] } else { [place as f64, line as f64] };
                let [u, d] = self.place(point);
                let inner = gate(self.lerp(self.inner_cell, u), blur);
                let outer = gate(self.lerp(self.outer_cell, u), blur);
                if d < -inner || d > outer || neighbours.iter().any(|side| side.outside(point) > -clearance) {
                    continue;
                }
                if let Some(value) = picture.pixel(point[0] as usize, point[1] as usize) {
                    station.samples.push([d, f64::from(value)]);
                    station.middle += u;
                }
            }
            lines_in_station += 1;
            if lines_in_station >= per_station && station.samples.len() >= 8 {
                station.middle /= station.samples.len() as f64;
                stations.push(std::mem::take(&mut station));
                lines_in_station = 0;
            }
        }
        stations
    }
}

/// How far from the edge pixels may be used, px: to where the next edge, one cell away, has faded.
fn gate(cell: f64, blur: f64) -> f64 {
    (cell - 2.0 * blur).max(0.55 * cell).min(WIDEST_GATE.min(4.5 * blur))
}

/// The whole numbers from `low` to `high` that are rows or columns of a picture.
fn whole_numbers(low: f64, high: f64, extent: usize) -> std::ops::Range<usize> {
    // Float to integer conversion saturates, so that NaN and far-away places give an empty range.
    low.ceil().max(0.0) as usize..((high.floor() + 1.0).max(0.0) as usize).min(extent)
}
