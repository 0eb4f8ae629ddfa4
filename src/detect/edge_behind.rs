//! The cells behind the border along one side of a tag that has been read.

use super::edge_fit::normal;
use super::projection::Projection;

/// Data cells along a side, at most.
const MOST_CELLS: usize = 12;

/// The cells behind a side's border, in the order of its corners.
#[derive(Debug, Clone, Copy)]
pub(super) struct Behind {
    /// How many of the places are used.
    count: usize,
    /// Whether each has the shade of the margin.
    bright: [bool; MOST_CELLS],
    /// Where each begins, and the last one ends, as a part of the side.
    places: [f64; MOST_CELLS + 1],
}

impl Behind {
    /// Those of one side of a tag whose cells are known, row by row. The places are as seen from the border's middle, where the blurs of its two edges meet.
    pub fn of(unit: &Projection, side: usize, per_side: usize, cells: &[bool]) -> Option<Self> {
        let (start, end) =
            (unit.map(Projection::on_side(side, 0.0, 0.0)), unit.map(Projection::on_side(side, 1.0, 0.0)));
        let along = [end[0] - start[0], end[1] - start[1]];
        let square = along[0] * along[0] + along[1] * along[1];
        Self::with_places(side, per_side, cells, |place| {
            let point = unit.map(Projection::on_side(side, place, 0.7 / per_side as f64));
            ((point[0] - start[0]) * along[0] + (point[1] - start[1]) * along[1]) / square
        })
    }

    /// The same with other places: `part` tells what part of the side a place along the tag is.
    pub fn with_places(side: usize, per_side: usize, cells: &[bool], part: impl Fn(f64) -> f64) -> Option<Self> {
        if cells.len() != per_side.checked_mul(per_side)? || per_side < 3 || per_side - 2 > MOST_CELLS {
            return None;
        }
        let count = per_side - 2;
        let last = per_side - 1;
        let at = |k: usize| match side {
            0 => (1, k),
            1 => (k, last - 1),
            2 => (last - 1, last - k),
            _ => (last - k, 1),
        };
        let mut behind = Self { count, bright: [false; MOST_CELLS], places: [0.0; MOST_CELLS + 1] };
        for k in 0..=count {
            if k < count {
                let (row, column) = at(k + 1);
                behind.bright[k] = cells.get(row * per_side + column).copied()?;
            }
            behind.places[k] = part((k + 1) as f64 / per_side as f64);
        }
        Some(behind)
    }

    /// Whether a place, as a part of the side, lies before a bright cell and so far from dark ones.
    pub fn is_bright(&self, place: f64, clearance: f64) -> bool {
        let bright = |k: usize| k < self.count && self.bright[k];
        (0..self.count).any(|k| {
            let (from, to) = (self.places[k], self.places[k + 1]);
            bright(k)
                && place >= if k > 0 && bright(k - 1) { from } else { from + clearance }
                && place < if bright(k + 1) { to } else { to - clearance }
        })
    }

    /// How much of the cell at a place is bright, with its neighbours blurred in. Place and blur are parts of the side.
    pub fn shine(&self, place: f64, blur: f64) -> f64 {
        let step = |at: f64| normal((place - at) / blur).0;
        let mut shine = 0.0;
        for (k, bright) in (0..self.count).zip(self.bright) {
            if bright {
                let (from, to) = (self.places[k], self.places[k + 1]);
                if (from - 4.0 * blur..to + 4.0 * blur).contains(&place) {
                    shine += step(from) - step(to);
                }
            }
        }
        shine
    }
}
