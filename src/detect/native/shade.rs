//! Tags in the shade beside something in the light: where they may be, and by what thresholds they are seen.
//!
//! A tile's threshold lies half-way between the darkest and the brightest around it ([`super::tiles`]). Beside a face in the sun that is above the white of
//! a face in the shade: a tag there is dark all over, or hardly shows. Its tiles tell: they have contrast of their own, all of it below their threshold,
//! and something as dark as ink. Their thresholds are then taken of such tiles alone, and the places around them are searched once more.
//! It has to be a second look: tags in the light stand beside such places too, and are seen by the thresholds of the light only.

use pulp::{Simd, WithSimd};

use super::tiles::{Extremes, TILE, Tiles, middle};
use crate::detect::picture::GreyPicture;
use crate::detect::wide::dispatch;

/// Grey levels between the darkest and the brightest of a tile in the shade, at least.
const LEAST_RANGE: u8 = 30;
/// Pixels of a tile that have to be paper in the shade.
const LEAST_PAPER: u8 = 2;
/// Pixels of a place that have to be: two cells of four px.
const LEAST_PAPER_TOGETHER: u32 = 32;
/// Tiles of 3 x 3 that show ink and paper.
const LEAST_TILES: usize = 3;
/// Tiles around a shaded place that are searched, at least; and at least as many as the place is long.
const LEAST_AROUND: usize = 2;

/// The thresholds of shaded places, which are lower than those of `tiles`, and those of `tiles` near such places; 0 elsewhere. `None` if nothing is in the shade.
pub(super) fn in_shade(picture: &GreyPicture, extremes: &Extremes, tiles: &Tiles) -> Option<Tiles> {
    let columns = tiles.columns;
    let rows = tiles.thresholds.len() / columns;
    // Pixels of paper.
    let mut shaded = vec![0; tiles.thresholds.len()];
    let mut places = Vec::new();
    dispatch(Shaded { picture, extremes, tiles, shaded: &mut shaded, places: &mut places });
    places.retain(|tile| enough(extremes, *tile, rows));
    if places.is_empty() {
        return None;
    }
    let mut left = vec![false; shaded.len()];
    places.iter().for_each(|tile| left[*tile] = true);
    let mut wanted = vec![false; shaded.len()];
    let mut thresholds = vec![0; tiles.thresholds.len()];
    let (mut darkest, mut brightest) = (vec![u8::MAX; thresholds.len()], vec![0; thresholds.len()]);
    let mut place = Vec::new();
    for first in &places {
        // What hangs together is one place.
        place.clear();
        if std::mem::take(&mut left[*first]) {
            place.push(*first);
        }
        let mut next = 0;
        while let Some(tile) = place.get(next).copied() {
            next += 1;
            let (low, high) = (extremes.darkest[tile], extremes.brightest[tile]);
            for beside in around(tile, columns, rows) {
                darkest[beside] = darkest[beside].min(low);
                brightest[beside] = brightest[beside].max(high);
                if std::mem::take(&mut left[beside]) {
                    place.push(beside);
                }
            }
        }
        let paper: u32 = place.iter().map(|tile| u32::from(shaded[*tile])).sum();
        if paper < LEAST_PAPER_TOGETHER {
            continue;
        }
        place.iter().for_each(|tile| wanted[*tile] = true);
        let extent = |at: fn(usize, usize) -> usize| {
            let places = || place.iter().map(|tile| at(*tile, columns));
            Some((places().min()?, places().max()?))
        };
        let (Some((west, east)), Some((north, south))) = (extent(|tile, n| tile % n), extent(|tile, n| tile / n))
        else {
            continue;
        };
        // A strip of shade along one side of a tag is as long as the tag is wide.
        let (across, down) = (LEAST_AROUND.max(south - north + 1), LEAST_AROUND.max(east - west + 1));
        for row in north.saturating_sub(down)..(south + down + 1).min(rows) {
            let part = row * columns + west.saturating_sub(across)..row * columns + (east + across + 1).min(columns);
            thresholds[part.clone()].copy_from_slice(&tiles.thresholds[part]);
        }
    }
    for tile in places.iter().flat_map(|place| around(*place, columns, rows)) {
        thresholds[tile] = middle(darkest[tile], brightest[tile]).min(thresholds[tile]);
    }
    Some(Tiles { columns, thresholds, wanted })
}

/// Tiles that show ink and paper in the shade.
struct Shaded<'a> {
    picture: &'a GreyPicture,
    extremes: &'a Extremes,
    tiles: &'a Tiles,
    /// Pixels of paper of each tile.
    shaded: &'a mut [u8],
    /// The tiles that have enough of it.
    places: &'a mut Vec<usize>,
}

impl WithSimd for Shaded<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { picture, extremes: Extremes { columns, darkest, brightest }, tiles, shaded, places } = self;
        for (((low, high), threshold), shaded) in
            darkest.iter().zip(brightest).zip(&tiles.thresholds).zip(shaded.iter_mut())
        {
            let range = high.saturating_sub(*low);
            // All but an eighth of its range is dark.
            *shaded = u8::from(
                (range >= LEAST_RANGE)
                    & (*threshold >= high.saturating_sub(range / 8))
                    & (*low <= as_dark_as_ink(*high)),
            );
        }
        // Few are left: most eights of tiles have none.
        let (eights, rest) = shaded.as_chunks_mut::<8>();
        let eights = eights.iter_mut().map(|eight| if u64::from_ne_bytes(*eight) == 0 { &mut [][..] } else { eight });
        for (eight, shaded) in eights.chain([rest]).enumerate() {
            for (k, shaded) in shaded.iter_mut().enumerate().filter(|(_, shaded)| **shaded > 0) {
                let tile = 8 * eight + k;
                let (low, high) = (darkest[tile], brightest[tile]);
                let light = tiles.thresholds[tile].max(high.saturating_add((high - low) / 8));
                *shaded = paper(picture, tile % columns, tile / columns, middle(low, high), light);
                if *shaded >= LEAST_PAPER {
                    places.push(tile);
                }
            }
        }
    }
}

/// Whether as many tiles at a place as a tag covers show ink and paper.
fn enough(extremes: &Extremes, tile: usize, rows: usize) -> bool {
    let (low, high) = (extremes.darkest[tile], extremes.brightest[tile]);
    let (ink, paper) = (as_dark_as_ink(high), middle(low, high));
    let shows = |tile: usize| usize::from((extremes.darkest[tile] <= ink) & (extremes.brightest[tile] >= paper));
    around(tile, extremes.columns, rows).map(shows).sum::<usize>() >= LEAST_TILES
}

/// Ink is at most three eighths as bright as the paper that it is on, light and shade being the same.
fn as_dark_as_ink(paper: u8) -> u8 {
    paper / 4 + paper / 8
}

/// Pixels of a tile that are no darker than `own`, and have none beside them that is in the light. The flank of an edge has none.
#[inline(always)]
fn paper(picture: &GreyPicture, column: usize, row: usize, own: u8, light: u8) -> u8 {
    // With the pixels beside it.
    const SIDE: usize = TILE + 2;
    let width = picture.width();
    let first = (row * TILE).checked_sub(1).and_then(|y| (y * width + column * TILE).checked_sub(1));
    let around = first.and_then(|first| picture.pixels().get(first..first + (SIDE - 1) * width + SIDE));
    // Places at the picture's edge have no surroundings.
    let Some(around) = around.filter(|_| column > 0 && column * TILE + TILE < width) else { return 0 };
    let [mut left, mut here, mut right] = [[0u8; SIDE * TILE]; 3];
    for (line, pixels) in around.chunks(width).enumerate() {
        let part = line * TILE..(line + 1) * TILE;
        left[part.clone()].copy_from_slice(&pixels[..TILE]);
        here[part.clone()].copy_from_slice(&pixels[1..=TILE]);
        right[part].copy_from_slice(&pixels[2..SIDE]);
    }
    for ((left, here), right) in left.iter_mut().zip(&here).zip(&right) {
        *left = (*left).max(*here).max(*right);
    }
    let (above, beside, below) = (&left[..TILE * TILE], &left[TILE..][..TILE * TILE], &left[2 * TILE..]);
    let mut count = 0;
    for (((above, beside), below), here) in above.iter().zip(beside).zip(below).zip(&here[TILE..]) {
        let brightest = (*above).max(*beside).max(*below);
        count += u8::from((*here >= own) & (brightest < light));
    }
    count
}

/// The tiles within a distance of one.
#[inline(always)]
fn around(tile: usize, columns: usize, rows: usize) -> impl Iterator<Item = usize> {
    let (column, row) = (tile % columns, tile / columns);
    let (west, east) = (column.saturating_sub(1), (column + 2).min(columns));
    (row.saturating_sub(1)..(row + 2).min(rows)).flat_map(move |row| row * columns + west..row * columns + east)
}

#[cfg(test)]
mod tests {
    use super::paper;
    use crate::detect::native::tiles::TILE;
    use crate::detect::picture::GreyPicture;

    /// Pixels of a tile that are at least `own` and have nothing within a pixel that is `light` or more, one after the other.
    fn counted(picture: &GreyPicture, column: usize, row: usize, own: u8, light: u8) -> u8 {
        let (width, height) = (picture.width(), picture.height());
        let grey = |x: usize, y: usize| picture.pixels()[y * width + x];
        if column == 0 || row == 0 || (column + 1) * TILE >= width || (row + 1) * TILE >= height {
            return 0;
        }
        let places = (0..TILE * TILE).map(|k| (column * TILE + k % TILE, row * TILE + k / TILE));
        let seen = places.filter(|(x, y)| {
            let brightest = (0..9).map(|k| grey(x + k % 3 - 1, y + k / 3 - 1)).max();
            grey(*x, *y) >= own && brightest < Some(light)
        });
        seen.count() as u8
    }

    #[test]
    fn paper_is_counted_pixel_by_pixel() {
        let mut value = 7_u32;
        for (width, height) in [(40, 40), (41, 33), (47, 26), (8, 8)] {
            let pixels = (0..width * height).map(|_| {
                value = value.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                // Few are in the light: else most tiles would have no paper.
                if value >> 27 == 0 { 200 } else { (value >> 24) as u8 % 150 }
            });
            let picture = GreyPicture::new(width, height, pixels.collect()).unwrap();
            let mut all = 0;
            for (column, row) in (0..width.div_ceil(TILE)).flat_map(|x| (0..height.div_ceil(TILE)).map(move |y| (x, y)))
            {
                let expected = counted(&picture, column, row, 70, 180);
                assert_eq!(paper(&picture, column, row, 70, 180), expected, "{width} x {height}, {column}, {row}");
                all += u32::from(expected);
            }
            assert!(all > 0 || width == 8);
        }
    }
}
