//! What a camera that does not answer to light in proportion does to edges, and how it is taken away.
//!
//! Blur is symmetric in light. A camera that shows light by a curve (gamma, as nearly every camera that writes JPEG; white that is saturated) makes it lopsided
//! in grey values: the grey half-way between black and white is then not where the edge is. Every edge moves towards its bright
//! side (or its dark side) by the same fraction of the blur, so that a tag looks too large (or too small), in every picture alike. The
//! shape of one edge hardly shows it, but a tag has edges of both kinds, black within white and white within
//! black: the border looks thicker (or thinner) than the cells that it is printed with. The border's outer edge and the inner one, where the
//! cells behind it are bright, are measured by the same means, and from the difference the shift is known to a hundredth of a blur from one
//! tag, without an idea of what the curve is. Ink that runs is found by the same token.
//!
//! The curve belongs to the camera and the blur to the side, so the shift *in blurs* is nearly common to the tags of a picture. Tags are therefore put
//! together, by the usual random-effects estimate (DerSimonian and Laird 1986), which tells apart how much tags differ from how well each is known. A shift that may well be
//! none is taken for none, by its probability: a proportional camera must not pay for the others.

use super::edge_behind::Behind;
use super::edge_fit::{Edge, SideFit};
use super::edge_lines::{RoughTag, Weakness};
use super::edge_side::{Bend, Side};
use super::edge_stations::{Profile, Stations};
use super::lens::Bender;
use super::picture::GreyPicture;
use super::projection::Projection;

/// Probability beforehand that a camera answers in proportion.
const PROPORTIONAL: f64 = 0.5;
/// Standard deviation of the shift, in blurs, of cameras that do not.
const USUAL_SHIFT: f64 = 0.4;
/// Standard deviation of one tag's shift, in blurs, that its stations' scatter does not show.
const SHIFT_FLOOR: f64 = 0.006;

/// Shift, in blurs, by a tone of -1: that of the best symmetric step through a lopsided one.
const SHIFT_OF_TONE: f64 = 0.6;
/// Bound of the tone: beyond it grey would not grow with light.
const STEEPEST: f64 = 0.95;
/// Shifts beyond this, in blurs, are much.
const MUCH: f64 = 0.02;

/// How far edges are moved towards their bright side, in blurs.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shift {
    value: f64,
    variance: f64,
}

impl Shift {
    /// What one tag says of which all sides are measured: their lines meet at `ideal`.
    pub fn of_tag(
        picture: &GreyPicture,
        bender: &Bender<'_>,
        tag: &RoughTag<'_>,
        ideal: [[f64; 2]; 4],
        fits: &[Result<SideFit, Weakness>; 4],
        tone: f64,
        stations: &mut Stations,
    ) -> Option<Self> {
        let inner = inner_sides(bender, tag, ideal)?;
        let found = inner.iter().zip(fits).filter_map(|(inner, fit)| {
            let (inner, fit) = (inner.as_ref()?, fit.as_ref().ok()?);
            Some((inner.fit_bright_cells(picture, Profile { blur: fit.blur, tone }, stations), *fit))
        });
        Self::of_edges(found, tag.cells_per_side)
    }

    /// From the inner edges of sides and their outer lines.
    pub fn of_edges(found: impl Iterator<Item = (Vec<Edge>, SideFit)>, cells_per_side: usize) -> Option<Self> {
        // A tag that looks larger by a shift on each side has its inner edges expected farther out by so much of it, and they have moved inwards.
        let seen = 2.0 - 2.0 / cells_per_side as f64;
        // Edges in blurs, and what the outer lines' errors add to their mean.
        let (mut edges, mut outer, mut sum) = (Vec::new(), 0.0, 0.0);
        for (found, fit) in found {
            let scale = seen * fit.blur;
            let weight: f64 = found.iter().map(|edge| edge.weight * scale * scale).sum();
            outer += weight * weight * fit.offset_variance / (scale * scale);
            sum += weight;
            edges.extend(found.iter().map(|edge| Edge {
                offset: edge.offset / scale,
                weight: edge.weight * scale * scale,
                ..*edge
            }));
        }
        let (value, variance) = robust_mean(&mut edges)?;
        Some(Self { value, variance: variance + outer / (sum * sum) + SHIFT_FLOOR.powi(2) })
    }

    /// A side's line without the shift.
    pub fn taken_from(&self, fit: SideFit) -> SideFit {
        SideFit {
            offset: fit.offset - self.value * fit.blur,
            offset_variance: fit.offset_variance + self.variance * fit.blur * fit.blur,
            ..fit
        }
    }
}

/// The border's inner edges along the sides of a tag whose cells are known and whose outer lines meet at `ideal`.
pub(super) fn inner_sides(bender: &Bender<'_>, tag: &RoughTag<'_>, ideal: [[f64; 2]; 4]) -> Option<[Option<Side>; 4]> {
    let unit = Projection::from_unit_square(ideal)?;
    let cells = tag.cells?;
    Some([0, 1, 2, 3].map(|side: usize| inner_side(bender, &unit, side, tag, cells)))
}

/// The border's inner edge along one side, looked at from the border: bright cells lie outside of it.
fn inner_side(bender: &Bender<'_>, unit: &Projection, side: usize, tag: &RoughTag<'_>, cells: &[bool]) -> Option<Side> {
    let cell = 1.0 / tag.cells_per_side as f64;
    let at = |place: f64, depth: f64| bender.distort(unit.map(Projection::on_side(side, place, depth))).ok();
    let (start, end) = (at(cell, cell)?, at(1.0 - cell, cell)?);
    let length = (end[0] - start[0]).hypot(end[1] - start[1]);
    let along = [(end[0] - start[0]) / length, (end[1] - start[1]) / length];
    let across = |point: [f64; 2]| (point[1] - start[1]) * along[0] - (point[0] - start[0]) * along[1];
    let inwards = across(at(0.5, 2.0 * cell)?).signum();
    let outward = [-along[1] * inwards, along[0] * inwards];
    let part = |point: [f64; 2]| (point[0] - start[0]) * along[0] + (point[1] - start[1]) * along[1];
    let bend = match bender.0 {
        None => None,
        Some(_) => {
            let mut points = [[0.0; 2]; 5];
            for (step, point) in points.iter_mut().enumerate() {
                let bent = at(cell + step as f64 / 4.0 * (1.0 - 2.0 * cell), cell)?;
                *point = [part(bent), inwards * across(bent)];
            }
            Some(Bend::through(points))
        }
    };
    let width = |place: f64, depth: f64| Some(across(at(place, depth)?).abs());
    let inner_cell = [width(cell, 0.0)?, width(1.0 - cell, 0.0)?];
    let outer_cell = [width(cell, 2.0 * cell)?, width(1.0 - cell, 2.0 * cell)?];
    let behind = Behind::with_places(side, tag.cells_per_side, cells, |place| {
        at(place, cell).map_or(f64::NAN, |point| part(point) / length)
    })?;
    let bright_inside = tag.bright_inside;
    Some(Side { start, along, outward, length, bend, inner_cell, outer_cell, bright_inside, behind: Some(behind) })
}

/// Weighted mean and its variance, without what lies far off.
fn robust_mean(edges: &mut Vec<Edge>) -> Option<(f64, f64)> {
    const FEWEST: usize = 4;
    if edges.len() < FEWEST {
        return None;
    }
    let middle = edges.len() / 2;
    let median = edges.select_nth_unstable_by(middle, |a, b| a.offset.total_cmp(&b.offset)).1.offset;
    let mut distances: Vec<f64> = edges.iter().map(|edge| (edge.offset - median).abs()).collect();
    let scale = 1.4826 * *distances.select_nth_unstable_by(middle, f64::total_cmp).1;
    edges.retain(|edge| (edge.offset - median).abs() <= 3.5 * scale.max(0.02));
    if edges.len() < FEWEST {
        return None;
    }
    let total: f64 = edges.iter().map(|edge| edge.weight).sum();
    let mean = edges.iter().map(|edge| edge.weight * edge.offset).sum::<f64>() / total;
    let squares: f64 = edges.iter().map(|edge| edge.weight * (edge.offset - mean).powi(2)).sum();
    // As for lines: the noise in the pixels counts as three edges' worth of scatter.
    let scatter = (squares + 3.0) / (edges.len() as f64 - 1.0 + 3.0);
    Some((mean, scatter / total))
}

/// Probability that there is a shift and not none, after one was measured: by how likely either makes what was measured.
fn probability_of_some(value: f64, variance: f64) -> f64 {
    let wide = variance + USUAL_SHIFT.powi(2);
    let odds = (1.0 - PROPORTIONAL) / PROPORTIONAL
        * (variance / wide).sqrt()
        // Less than what overflows.
        * (0.5 * value * value * (1.0 / variance - 1.0 / wide)).min(600.0).exp();
    odds / (1.0 + odds)
}

/// What the tags of a picture say together.
#[derive(Debug)]
pub(super) struct Tone {
    /// The tone that the edges were fitted with.
    value: f64,
    /// The common shift.
    common: Shift,
    /// Variance of tags' own shifts about it.
    between: f64,
}

impl Tone {
    /// From what tags say whose edges were fitted with a tone.
    pub fn of(tone: f64, shifts: impl Iterator<Item = Shift>) -> Self {
        let shifts: Vec<Shift> = shifts.collect();
        if shifts.is_empty() {
            // As likely as not there is none, and nothing tells.
            return Self { value: tone, common: Shift { value: 0.0, variance: 0.0 }, between: 0.0 };
        }
        let mean = |between: f64| {
            let (mut total, mut sum, mut squares) = (0.0, 0.0, 0.0);
            for shift in &shifts {
                let weight = 1.0 / (shift.variance + between);
                total += weight;
                sum += weight * shift.value;
                squares += weight * weight;
            }
            (sum / total, total, squares)
        };
        let (plain, total, squares) = mean(0.0);
        let heterogeneity: f64 = shifts.iter().map(|shift| (shift.value - plain).powi(2) / shift.variance).sum();
        let spare = heterogeneity - (shifts.len() as f64 - 1.0);
        let between = if shifts.len() > 1 { (spare / (total - squares / total)).max(0.0) } else { 0.0 };
        let (value, total, _) = mean(between);
        let variance = 1.0 / total;
        let some = if tone == 0.0 { probability_of_some(value, variance) } else { 1.0 };
        let common = Shift { value: some * value, variance: some * variance + some * (1.0 - some) * value * value };
        Self { value: tone, common, between }
    }

    /// A tone that leaves less to be shifted, if there is much.
    pub fn better(&self) -> Option<f64> {
        let tone = (self.value - self.common.value / SHIFT_OF_TONE).clamp(-STEEPEST, STEEPEST);
        (self.common.value.abs() > MUCH && tone != self.value).then_some(tone)
    }

    /// A tag's shift, given what it says itself.
    pub fn shift(&self, own: Option<Shift>) -> Shift {
        let Some(own) = own.filter(|_| self.between > 0.0) else {
            return Shift { variance: self.common.variance + self.between, ..self.common };
        };
        let share = self.between / (self.between + own.variance);
        Shift {
            value: self.common.value + share * (own.value - self.common.value),
            variance: share * own.variance + (1.0 - share).powi(2) * self.common.variance,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Shift, Tone};

    fn shifts(values: &[f64], deviation: f64) -> Vec<Shift> {
        values.iter().map(|value| Shift { value: *value, variance: deviation * deviation }).collect()
    }

    #[test]
    fn what_may_well_be_nothing_is_nothing() {
        let tone = Tone::of(0.0, shifts(&[0.006, -0.004, 0.01, 0.001], 0.006).into_iter());
        let shift = tone.shift(None);
        assert!(shift.value.abs() < 5e-4 && shift.variance < 1e-5 && tone.better().is_none(), "{tone:?}");
        let none = Tone::of(0.0, std::iter::empty()).shift(None);
        assert_eq!((none.value, none.variance), (0.0, 0.0));
    }

    #[test]
    fn tags_that_agree_are_put_together() {
        let tone = Tone::of(0.0, shifts(&[0.300, 0.306, 0.294, 0.300], 0.006).into_iter());
        let shift = tone.shift(Some(Shift { value: 0.306, variance: 3.6e-5 }));
        assert!((shift.value - 0.3).abs() < 1e-3 && (shift.variance - 9e-6).abs() < 1e-6, "{tone:?}");
        assert!((tone.better().unwrap() + 0.5).abs() < 0.01);
    }

    #[test]
    fn tags_that_differ_keep_their_own() {
        let tone = Tone::of(0.0, shifts(&[0.0, 0.3, 0.1, 0.2], 0.006).into_iter());
        for own in shifts(&[0.0, 0.3], 0.006) {
            let shift = tone.shift(Some(own));
            assert!(
                (shift.value - own.value).abs() < 0.002 && (shift.variance - own.variance).abs() < 1e-6,
                "{tone:?}"
            );
        }
        let unknown = tone.shift(None);
        assert!((0.0..0.2).contains(&unknown.value) && unknown.variance > 0.1_f64.powi(2), "{tone:?}");
    }
}
