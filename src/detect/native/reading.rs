//! Is a quadrangle a tag, and which?
//!
//! A quadrangle must look like a tag before its cells are looked up: a ring inside its edge all of one shade, a ring outside all of the other, as
//! the margin that every printed tag needs, and a clear step between them on every side. In a small dictionary a
//! random pattern is a tag's code surprisingly often (one in twenty for 4x4_50 with one wrong cell mended), so it is
//! the rings that keep window frames, letters and boxes out. Cells that are neither dark nor bright count
//! as wrong ones, since ink is one or the other.

use super::codebook::Codebook;
use super::outline::{self, Quad};
use crate::detect::picture::GreyPicture;
use crate::detect::projection::Projection;

/// Grey levels between the shades of the two rings below which there is no tag.
const LEAST_CONTRAST: f64 = 14.0;
/// Cells up to this size (px) never reach full shade and are sharpened: what blur takes from a cell its neighbours have. Larger ones are only if they
/// cannot be read as they are.
const SHARPENED_BELOW: f64 = 3.5;
/// From this size on (px) cells are even to near their corners.
const EVEN_FROM: f64 = 3.5;
/// The rim of a cell (px) that blur takes away.
const CELL_RIM: f64 = 0.56;
/// Below this size of its cells (px) nothing tells a tag that looks like a box with a label from such a box.
const PLAIN_FROM: f64 = 2.0;
/// Cells smaller than this (px) are not seen one by one.
const SMALLEST_CELL: f64 = 1.0;

/// A tag that was read.
#[derive(Debug, Clone, Copy)]
pub(super) struct Read {
    pub id: u32,
    /// Corners from the printed pattern's first one on.
    pub corners: Quad,
}

/// Scratch for one reading.
#[derive(Debug, Default)]
pub(super) struct Reader {
    /// Values of the cells of the pattern and of one ring around it, row by row; NaN outside the picture.
    values: Vec<f64>,
    sharpened: Vec<f64>,
    cells: Vec<bool>,
}

impl Reader {
    /// Reads one quadrangle as a tag of one family.
    ///
    /// `bright` tells whether the quadrangle is bright inside its edge. A `doubtful` one, which hardly shows, is believed only if
    /// no cell need be mended, and of a small dictionary only if its cells keep their shade up to their corners.
    pub fn read(
        &mut self,
        picture: &GreyPicture,
        quad: Quad,
        bright: bool,
        book: &Codebook,
        doubtful: bool,
    ) -> Option<Read> {
        let around = (book.side - book.edge) / 2;
        // With the margin, where the pattern has no data around its border.
        let rim = if around == 0 { 1 } else { around };
        let side = book.edge + 2 * rim;
        let size = cell_size(&quad, book.edge);
        if size < SMALLEST_CELL {
            return None;
        }
        let map = Projection::from_unit_square(quad)?;
        self.sample(picture, &map, book.edge, rim, size);
        // Dark inside, bright outside, whatever was printed.
        if bright {
            self.values.iter_mut().for_each(|value| *value = 255.0 - *value);
        }
        let shades = Shades::of(&self.values, side, rim, book.edge)?;
        let bits = book.bits();
        // Of a small dictionary nothing is forgiven.
        let forgiven = if bits >= 25 { 0.08 } else { 0.0 };
        let judged = |values: &[f64], ring: usize, dark: bool| {
            let (mut wrong, mut all) = (0.0, 0.0);
            for (k, value) in ring_values(values, side, ring) {
                all += 1.0;
                let place = shades.place(value, k, side);
                if (place < 0.0) != dark {
                    wrong += 1.0;
                }
            }
            (wrong, all)
        };
        let (wrong_inside, inside) = judged(&self.values, rim, true);
        let (wrong_outside, outside) = judged(&self.values, rim - 1, false);
        if wrong_inside > forgiven * inside
            || wrong_outside > (2.0 * forgiven + 0.05) * outside
            || outside < 2.0 * book.edge as f64
        {
            return None;
        }
        let most_wrong = if doubtful { 0 } else { book.most_wrong };
        let soft = size < SHARPENED_BELOW;
        let plain = self.identify(&shades, book, side, rim, false, soft, most_wrong);
        let found = match plain {
            Some(found) if found.2 == 0 || !soft => Some(found),
            // Small, or out of focus. Of a small dictionary chance reads too much into what is sharpened.
            other if soft || bits >= 25 => {
                self.sharpen(side);
                let sharp = self.identify(&shades, book, side, rim, true, true, most_wrong);
                match (other, sharp) {
                    (Some(a), Some(b)) => Some(if b.2 < a.2 { b } else { a }),
                    (a, b) => a.or(b),
                }
            }
            other => other,
        };
        let (id, turns, _) = found?;
        // A dark box with a white label is a tag of a small dictionary, but for where its edges lie. Some tags look like nothing else.
        let plain = book.is_plain(id) || (doubtful && bits < 25);
        if plain && size < PLAIN_FROM {
            return None;
        }
        if plain || (bits < 25 && size >= EVEN_FROM) {
            let reach = (0.5 - CELL_RIM / size).min(0.34);
            let [wrong, all] = self.uneven(picture, &map, &shades, side, rim, book, bright, reach);
            if wrong * if plain { 100 } else { 25 } > all {
                return None;
            }
        }
        Some(Read { id, corners: [0, 1, 2, 3].map(|k: usize| quad[(k + turns) % 4]) })
    }

    /// Grey values of all cells and of the ring around them.
    fn sample(&mut self, picture: &GreyPicture, map: &Projection, edge: usize, rim: usize, size: f64) {
        let side = edge + 2 * rim;
        self.values.clear();
        let cell = 1.0 / edge as f64;
        let fixed = |value: f64| (value * 65536.0) as i64;
        let at = |x: i64, y: i64| picture.sample_fixed(x, y).map_or(f64::NAN, |grey| f64::from(grey) / 65536.0);
        // Four places a cell where it is large enough that they see nothing of its neighbours: a fifth of a cell to either side,
        // which may be that of the middle cell for all.
        let [here, right, down] = [[0.5, 0.5], [0.5 + cell, 0.5], [0.5, 0.5 + cell]].map(|place| map.map(place));
        let part = |to: [f64; 2], from: [f64; 2]| [fixed(0.2 * (to[0] - from[0])), fixed(0.2 * (to[1] - from[1]))];
        let (a, b) = (part(right, here), part(down, here));
        for row in 0..side {
            for column in 0..side {
                let (x, y) = (column as f64 + 0.5 - rim as f64, row as f64 + 0.5 - rim as f64);
                let [u, v] = map.map([x * cell, y * cell]);
                let (u, v) = (fixed(u), fixed(v));
                self.values.push(if size > 5.0 {
                    0.25 * (at(u + a[0] + b[0], v + a[1] + b[1])
                        + at(u - a[0] + b[0], v - a[1] + b[1])
                        + at(u + a[0] - b[0], v + a[1] - b[1])
                        + at(u - a[0] - b[0], v - a[1] - b[1]))
                } else {
                    at(u, v)
                });
            }
        }
    }

    /// At how many places near the corners of the cells that were just identified they have not their shade, and at how many it was looked.
    #[allow(clippy::too_many_arguments)]
    fn uneven(
        &self,
        picture: &GreyPicture,
        map: &Projection,
        shades: &Shades,
        side: usize,
        rim: usize,
        book: &Codebook,
        bright: bool,
        reach: f64,
    ) -> [usize; 2] {
        let skip = (side - book.side) / 2;
        let (mut wrong, mut all) = (0, 0);
        for (k, cell) in self.cells.iter().enumerate() {
            let (row, column) = (k / book.side + skip, k % book.side + skip);
            for (dx, dy) in [(-reach, -reach), (reach, -reach), (reach, reach), (-reach, reach)] {
                let unit = |at: usize, d: f64| (at as f64 + 0.5 + d - rim as f64) / book.edge as f64;
                let [x, y] = map.map([unit(column, dx), unit(row, dy)]);
                let Some(grey) = picture.sample(x, y) else { continue };
                let place = shades.place(if bright { 255.0 - grey } else { grey }, row * side + column, side);
                wrong += usize::from((place > 0.0) != (*cell != book.bright_inside));
                all += 1;
            }
        }
        [wrong, all]
    }

    /// Undoes some of the blur of small cells.
    fn sharpen(&mut self, side: usize) {
        self.sharpened.clear();
        self.sharpened.extend_from_slice(&self.values);
        for row in 1..side - 1 {
            for column in 1..side - 1 {
                let k = row * side + column;
                let beside = self.values[k - 1] + self.values[k + 1] + self.values[k - side] + self.values[k + side];
                if !beside.is_nan() {
                    self.sharpened[k] = self.values[k] + 0.25 * (4.0 * self.values[k] - beside);
                }
            }
        }
    }

    /// Id, turns, wrong cells.
    #[allow(clippy::too_many_arguments)]
    fn identify(
        &mut self,
        shades: &Shades,
        book: &Codebook,
        side: usize,
        rim: usize,
        sharp: bool,
        soft: bool,
        most_wrong: u32,
    ) -> Option<(u32, usize, u32)> {
        let values = if sharp { &self.sharpened } else { &self.values };
        let skip = (side - book.side) / 2;
        self.cells.clear();
        let (mut doubtful, mut clarity, mut count) = (0u32, 0.0, 0.0);
        let small = book.bits() < 25;
        let doubt = if soft { 0.08 } else { 0.25 } + if small { 0.2 } else { 0.0 };
        for row in skip..side - skip {
            for column in skip..side - skip {
                let k = row * side + column;
                let place = shades.place(values[k], k, side);
                if place.is_nan() {
                    return None;
                }
                // Shades are counted from the ring inside the edge, which some families print bright.
                self.cells.push((place > 0.0) != book.bright_inside);
                let ring = ring_of(k, side);
                if ring != rim && ring + 1 != rim {
                    doubtful += u32::from(place.abs() < doubt);
                    clarity += place.abs().min(1.0);
                    count += 1.0;
                }
            }
        }
        let clarity = clarity / f64::max(count, 1.0);
        // Real cells are clearly one or the other; a texture is not.
        if clarity < if soft && !small { 0.35 } else { 0.6 } {
            return None;
        }
        let (id, turns, wrong) = book.identify(&self.cells, most_wrong)?;
        (wrong.max(doubtful) <= most_wrong.max(u32::from(book.bits() > 16)).max(if soft && !small { 2 } else { 0 }))
            .then_some((id, turns, wrong))
    }
}

/// Whether a quadrangle is large enough for the cells along its edge to be seen.
pub(super) fn large_enough(quad: &Quad, edge: usize) -> bool {
    cell_size(quad, edge) >= SMALLEST_CELL
}

/// Mean edge of a cell, px: the shorter of the two directions.
fn cell_size(quad: &Quad, edge: usize) -> f64 {
    let side = |k: usize| {
        let (a, b) = (quad[k], quad[(k + 1) % 4]);
        outline::distance(a, b)
    };
    f64::min(side(0) + side(2), side(1) + side(3)) / 2.0 / edge as f64
}

/// Number of the ring that a place of a square of cells lies on, from 0 outside.
fn ring_of(place: usize, side: usize) -> usize {
    let (row, column) = (place / side, place % side);
    row.min(column).min(side - 1 - row).min(side - 1 - column)
}

/// The places of a ring of a square of cells, row by row, with their values, as far as they are in the picture.
fn ring_values(values: &[f64], side: usize, ring: usize) -> impl Iterator<Item = (usize, f64)> {
    let (first, last) = (ring, side - 1 - ring);
    let rows = (first..=last).flat_map(move |row| {
        let step = if row == first || row == last { 1 } else { last - first };
        (first..=last).step_by(step).map(move |column| row * side + column)
    });
    rows.map(|place| (place, values[place])).filter(|(_, value)| !value.is_nan())
}

/// The grey of dark and of bright, each a plane across the tag: light falls off.
struct Shades {
    dark: [f64; 3],
    bright: [f64; 3],
}

impl Shades {
    /// From the ring inside the edge and the ring outside. `None` if they differ too little.
    fn of(values: &[f64], side: usize, rim: usize, edge: usize) -> Option<Self> {
        let dark = plane(values, side, rim)?;
        let bright = plane(values, side, rim - 1)?;
        let shades = Self { dark, bright };
        let half = edge as f64 / 2.0;
        // At all four corners, not only on average.
        [[-half, -half], [half, -half], [half, half], [-half, half]]
            .iter()
            .all(|at| value(&shades.bright, *at) - value(&shades.dark, *at) > LEAST_CONTRAST)
            .then_some(shades)
    }

    /// -1 dark, +1 bright, 0 half-way.
    fn place(&self, grey: f64, k: usize, side: usize) -> f64 {
        let at = centred(k, side);
        let (dark, bright) = (value(&self.dark, at), value(&self.bright, at));
        2.0 * (grey - dark) / (bright - dark) - 1.0
    }
}

fn centred(k: usize, side: usize) -> [f64; 2] {
    let middle = (side as f64 - 1.0) / 2.0;
    [(k % side) as f64 - middle, (k / side) as f64 - middle]
}

fn value(plane: &[f64; 3], at: [f64; 2]) -> f64 {
    plane[0] + plane[1] * at[0] + plane[2] * at[1]
}

/// Least squares over a ring. The ring is symmetric, so the three sums are independent unless a part of it is outside the picture.
fn plane(values: &[f64], side: usize, ring: usize) -> Option<[f64; 3]> {
    let (mut n, mut sum, mut sx, mut sy, mut xx, mut yy) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    let (mut xs, mut ys) = (0.0, 0.0);
    for (k, value) in ring_values(values, side, ring) {
        let [x, y] = centred(k, side);
        n += 1.0;
        sum += value;
        sx += x;
        sy += y;
        xx += x * x;
        yy += y * y;
        xs += x * value;
        ys += y * value;
    }
    if n < 8.0 {
        return None;
    }
    let (mx, my, mean) = (sx / n, sy / n, sum / n);
    let slope = |xx: f64, xs: f64, mx: f64| {
        let spread = xx - n * mx * mx;
        if spread > 1e-6 { (xs - n * mx * mean) / spread } else { 0.0 }
    };
    let (a, b) = (slope(xx, xs, mx), slope(yy, ys, my));
    Some([mean - a * mx - b * my, a, b])
}

#[cfg(test)]
mod tests {
    use super::{ring_of, ring_values};

    #[test]
    fn rings_are_walked_row_by_row() {
        for side in 6..12 {
            let values: Vec<f64> = (0..side * side).map(|k| if k % 7 == 3 { f64::NAN } else { k as f64 }).collect();
            for ring in 0..2 {
                let walked: Vec<(usize, f64)> = ring_values(&values, side, ring).collect();
                let plain = values.iter().copied().enumerate();
                let plain = plain.filter(|(k, value)| ring_of(*k, side) == ring && !value.is_nan());
                assert_eq!(walked, plain.collect::<Vec<_>>(), "{side} {ring}");
            }
        }
    }
}
