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
    dispatch(Shaded { picture, extremes, tiles, shaded: &mut shaded });
    let places: Vec<usize> =
        (0..shaded.len()).filter(|tile| shaded[*tile] > 0 && enough(extremes, *tile, rows)).collect();
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
            for beside in around(tile, columns, rows, 1) {
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
    for (threshold, (low, high)) in thresholds.iter_mut().zip(darkest.iter().zip(&brightest)) {
        if low < high {
            *threshold = middle(*low, *high).min(*threshold);
        }
    }
    Some(Tiles { columns, thresholds, wanted })
}

/// Tiles that show ink and paper in the shade.
struct Shaded<'a> {
    picture: &'a GreyPicture,
    extremes: &'a Extremes,
    tiles: &'a Tiles,
    shaded: &'a mut [u8],
}

impl WithSimd for Shaded<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { picture, extremes: Extremes { columns, darkest, brightest }, tiles, shaded } = self;
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
        for (eight, shaded) in shaded.chunks_mut(8).enumerate().filter(|(_, eight)| eight.contains(&1)) {
            for (k, shaded) in shaded.iter_mut().enumerate().filter(|(_, shaded)| **shaded > 0) {
                let tile = 8 * eight + k;
                let (low, high) = (darkest[tile], brightest[tile]);
                let light = tiles.thresholds[tile].max(high.saturating_add((high - low) / 8));
                let paper = paper(picture, tile % columns, tile / columns, middle(low, high), light);
                *shaded = if paper >= LEAST_PAPER { paper } else { 0 };
            }
        }
    }
}

/// Whether as many tiles at a place as a tag covers show ink and paper.
fn enough(extremes: &Extremes, tile: usize, rows: usize) -> bool {
    let (low, high) = (extremes.darkest[tile], extremes.brightest[tile]);
    let (ink, paper) = (as_dark_as_ink(high), middle(low, high));
    let shows = |tile: &usize| extremes.darkest[*tile] <= ink && extremes.brightest[*tile] >= paper;
    around(tile, extremes.columns, rows, 1).filter(shows).count() >= LEAST_TILES
}

/// Ink is at most three eighths as bright as the paper that it is on, light and shade being the same.
fn as_dark_as_ink(paper: u8) -> u8 {
    paper / 4 + paper / 8
}

/// Pixels of a tile that are no darker than `own`, and have none beside them that is in the light. The flank of an edge has none.
#[inline(always)]
fn paper(picture: &GreyPicture, column: usize, row: usize, own: u8, light: u8) -> u8 {
    const SIDE: usize = TILE + 2;
    let width = picture.width();
    let mut rows = [[0u8; SIDE]; SIDE];
    for (line, values) in rows.iter_mut().enumerate() {
        // Places at the picture's edge have no surroundings.
        let Some(first) = (row * TILE + line).checked_sub(1).and_then(|y| (y * width + column * TILE).checked_sub(1))
        else {
            return 0;
        };
        match picture.pixels().get(first..first + SIDE) {
            Some(pixels) if column > 0 && column * TILE + TILE < width => values.copy_from_slice(pixels),
            _ => return 0,
        }
    }
    let beside = rows.map(|row| {
        let mut most = [0u8; TILE];
        for (k, most) in most.iter_mut().enumerate() {
            *most = row[k].max(row[k + 1]).max(row[k + 2]);
        }
        most
    });
    let mut counts = [0; TILE];
    for line in 0..TILE {
        for (k, count) in counts.iter_mut().enumerate() {
            let brightest = beside[line][k].max(beside[line + 1][k]).max(beside[line + 2][k]);
            *count += u8::from((rows[line + 1][k + 1] >= own) & (brightest < light));
        }
    }
    counts.iter().sum()
}

/// The tiles within a distance of one.
fn around(tile: usize, columns: usize, rows: usize, reach: usize) -> impl Iterator<Item = usize> {
    let (column, row) = (tile % columns, tile / columns);
    (row.saturating_sub(reach)..(row + reach + 1).min(rows)).flat_map(move |row| {
        (column.saturating_sub(reach)..(column + reach + 1).min(columns)).map(move |column| row * columns + column)
    })
}
