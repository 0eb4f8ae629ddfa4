//! Where in a picture there is contrast, and what is dark there.
//!
//! One threshold for a whole picture fails at the first shadow, one for every pixel (a box mean, as `adaptiveThreshold`
//! takes it) costs more than all the rest of the search. So the picture is cut into tiles of 8 x 8 pixels; a tile's threshold lies half-way
//! between the darkest and the brightest of the 3 x 3 tiles around it, and a tile whose surroundings are flat has none
//! and is never looked at again. Most of most pictures is flat.
//!
//! Extremes are taken of the mean of 2 x 2 pixels: it halves the noise, so that noise alone is not contrast.

use std::ops::Range;

use pulp::{Simd, WithSimd};

use crate::detect::picture::GreyPicture;
use crate::detect::wide::dispatch;

/// Edge of a tile, px.
pub(super) const TILE: usize = 8;
/// Grey levels between the darkest and the brightest around a tile below which it is flat.
pub(super) const FLAT: u8 = 18;

/// A threshold a tile.
#[derive(Debug, Default)]
pub(super) struct Tiles {
    /// Tiles a row; the last may be cut by the picture's edge.
    pub columns: usize,
    /// Row by row: a pixel darker than this is dark. 0 where it is flat.
    pub thresholds: Vec<u8>,
    /// Tiles of which a patch has to have one; empty if it need not.
    pub wanted: Vec<bool>,
}

impl Tiles {
    /// Whether a patch may reach into a tile that is wanted: by the box around it, of pixels.
    pub fn want(&self, across: Range<u32>, down: Range<u32>) -> bool {
        let tiles = |range: Range<u32>| range.start as usize / TILE..(range.end as usize).div_ceil(TILE);
        let (across, mut down) = (tiles(across), tiles(down));
        self.wanted.is_empty()
            || down.any(|row| {
                let part = row * self.columns + across.start..row * self.columns + across.end;
                self.wanted.get(part).is_some_and(|tiles| tiles.contains(&true))
            })
    }
}

/// Darkest and brightest 2 x 2 mean of each tile, row by row.
pub(super) struct Extremes {
    pub columns: usize,
    pub darkest: Vec<u8>,
    pub brightest: Vec<u8>,
}

/// Cuts a picture into tiles. One pass over the pixels.
pub(super) fn tile_extremes(picture: &GreyPicture) -> Extremes {
    let (width, height) = (picture.width(), picture.height());
    let (columns, rows) = (width.div_ceil(TILE), height.div_ceil(TILE));
    let padded = columns * TILE;
    let mut darkest = vec![u8::MAX; columns * rows];
    let mut brightest = vec![0; columns * rows];
    // Padding can win neither way.
    let (mut low, mut high) = (vec![u8::MAX; padded], vec![0; padded]);
    let mut scratch = vec![0; padded];
    for (row, (darkest, brightest)) in
        darkest.chunks_exact_mut(columns).zip(brightest.chunks_exact_mut(columns)).enumerate()
    {
        let first = row * TILE * width;
        let band = picture.pixels().get(first..(first + TILE * width).min(width * height)).unwrap_or(&[]);
        dispatch(Band { band, width, low: &mut low, high: &mut high, scratch: &mut scratch, darkest, brightest });
    }
    Extremes { columns, darkest, brightest }
}

/// The tiles' thresholds.
pub(super) fn tiles(extremes: &Extremes) -> Tiles {
    let columns = extremes.columns;
    let (mut darkest, mut brightest) = (extremes.darkest.clone(), extremes.brightest.clone());
    widen::<false>(&mut darkest, columns);
    widen::<true>(&mut brightest, columns);
    let thresholds = darkest
        .iter()
        .zip(&brightest)
        .map(|(low, high)| if high.saturating_sub(*low) < FLAT { 0 } else { middle(*low, *high) });
    Tiles { columns, thresholds: thresholds.collect(), wanted: Vec::new() }
}

/// Half-way between dark and bright: a pixel darker than this is dark.
pub(super) fn middle(low: u8, high: u8) -> u8 {
    low + (high - low) / 2 + 1
}

/// The extremes of one row of tiles. (A type and not a closure: only so does all of it get the wide instructions.)
struct Band<'a> {
    band: &'a [u8],
    width: usize,
    low: &'a mut [u8],
    high: &'a mut [u8],
    scratch: &'a mut [u8],
    darkest: &'a mut [u8],
    brightest: &'a mut [u8],
}

impl WithSimd for Band<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        extremes(self.band, self.width, self.low, self.high);
        fold_eights::<false>(self.low, self.scratch, self.darkest);
        fold_eights::<true>(self.high, self.scratch, self.brightest);
    }
}

#[inline(always)]
fn mean(a: u8, b: u8) -> u8 {
    // The form that compilers turn into one instruction.
    ((u16::from(a) + u16::from(b) + 1) >> 1) as u8
}

/// Lowest and highest 2 x 2 mean of a column of a band of rows.
#[inline(always)]
fn extremes(band: &[u8], width: usize, low: &mut [u8], high: &mut [u8]) {
    let (low, high) = (&mut low[..width], &mut high[..width]);
    low.fill(u8::MAX);
    high.fill(0);
    let n = width - 1;
    if n == 0 || band.len() < 2 * width {
        // A picture one pixel wide or a band one row high has no 2 x 2 pixels.
        for row in band.chunks_exact(width) {
            for ((low, high), value) in low.iter_mut().zip(high.iter_mut()).zip(row) {
                *low = (*low).min(*value);
                *high = (*high).max(*value);
            }
        }
        return;
    }
    let mut quads = band.chunks_exact(4 * width);
    for four in &mut quads {
        let (a, b, c, d) = (&four[..width], &four[width..2 * width], &four[2 * width..3 * width], &four[3 * width..]);
        let (a0, b0, c0, d0) = (&a[..n], &b[..n], &c[..n], &d[..n]);
        let (a1, b1, c1, d1) = (&a[1..=n], &b[1..=n], &c[1..=n], &d[1..=n]);
        let (low, high) = (&mut low[..n], &mut high[..n]);
        for i in 0..n {
            let upper = mean(mean(a0[i], b0[i]), mean(a1[i], b1[i]));
            let lower = mean(mean(c0[i], d0[i]), mean(c1[i], d1[i]));
            low[i] = low[i].min(upper.min(lower));
            high[i] = high[i].max(upper.max(lower));
        }
    }
    for two in quads.remainder().chunks_exact(2 * width) {
        let (a, b) = two.split_at(width);
        let (a0, b0, a1, b1) = (&a[..n], &b[..n], &a[1..=n], &b[1..=n]);
        for i in 0..n {
            let here = mean(mean(a0[i], b0[i]), mean(a1[i], b1[i]));
            low[i] = low[i].min(here);
            high[i] = high[i].max(here);
        }
    }
}

#[inline(always)]
fn extreme<const HIGHEST: bool>(a: u8, b: u8) -> u8 {
    if HIGHEST { a.max(b) } else { a.min(b) }
}

/// The extreme of each eight, by halving the row three times: no step has more to do than the one before, and each is one that compilers turn into wide
/// instructions.
#[inline(always)]
fn fold_eights<const HIGHEST: bool>(values: &mut [u8], scratch: &mut [u8], folded: &mut [u8]) {
    let n = values.len();
    halve::<HIGHEST>(values, &mut scratch[..n / 2]);
    halve::<HIGHEST>(&scratch[..n / 2], &mut values[..n / 4]);
    halve::<HIGHEST>(&values[..n / 4], folded);
}

/// The extreme of each two.
#[inline(always)]
fn halve<const HIGHEST: bool>(values: &[u8], halved: &mut [u8]) {
    for (halved, two) in halved.iter_mut().zip(values.chunks_exact(2)) {
        *halved = extreme::<HIGHEST>(two[0], two[1]);
    }
}

/// The extreme of the 3 x 3 tiles around each.
#[inline(always)]
fn widen<const HIGHEST: bool>(values: &mut [u8], columns: usize) {
    let mut along = values.to_vec();
    for (along, row) in along.chunks_exact_mut(columns).zip(values.chunks_exact(columns)) {
        for (a, b) in along.iter_mut().zip(row.get(1..).unwrap_or(&[])) {
            *a = extreme::<HIGHEST>(*a, *b);
        }
        for (a, b) in along.get_mut(1..).unwrap_or(&mut []).iter_mut().zip(row) {
            *a = extreme::<HIGHEST>(*a, *b);
        }
    }
    values.copy_from_slice(&along);
    for (value, below) in values.iter_mut().zip(along.get(columns..).unwrap_or(&[])) {
        *value = extreme::<HIGHEST>(*value, *below);
    }
    for (value, above) in values.get_mut(columns..).unwrap_or(&mut []).iter_mut().zip(&along) {
        *value = extreme::<HIGHEST>(*value, *above);
    }
}
