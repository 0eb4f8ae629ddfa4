//! Where four squares of a checkerboard meet: candidates, with the directions of the two edges that cross there.
//!
//! Around such a place the picture changes from dark to bright and back exactly twice, and what lies opposite is alike. The first
//! look is at eight neighbours in black and white, a few instructions a pixel and only where there is contrast; the few places that
//! pass are looked at again on a ring of 16 grey values.

use super::tiles::{TILE, Tiles};
use crate::detect::picture::GreyPicture;

/// A ring of radius 3, clockwise as seen.
const RING: [[isize; 2]; 16] = [
    [3, 0],
    [3, 1],
    [2, 2],
    [1, 3],
    [0, 3],
    [-1, 3],
    [-2, 2],
    [-3, 1],
    [-3, 0],
    [-3, -1],
    [-2, -2],
    [-1, -3],
    [0, -3],
    [1, -3],
    [2, -2],
    [3, -1],
];
/// Candidates of one checkerboard and its surroundings, at most: the strongest are kept.
const MOST: usize = 3000;

/// A place where two edges cross.
#[derive(Debug, Clone, Copy)]
pub(super) struct Crossing {
    pub pixel: [f64; 2],
    /// Unit vectors along the two edges; turning clockwise from the first to the second one passes through a dark square.
    pub edges: [[f64; 2]; 2],
    strength: f64,
}

/// All candidates in a picture.
pub(super) fn crossings(picture: &GreyPicture, tiles: &Tiles) -> Vec<Crossing> {
    let (width, height) = (picture.width(), picture.height());
    if width < 9 || height < 9 {
        return Vec::new();
    }
    let mut found: Vec<Crossing> = Vec::new();
    let pixels = picture.pixels();
    for row in 4..height - 4 {
        let thresholds = &tiles.thresholds[row / TILE * tiles.columns..][..tiles.columns];
        for (tile, threshold) in thresholds.iter().enumerate() {
            if *threshold == 0 {
                continue;
            }
            let columns = (tile * TILE).max(4)..((tile + 1) * TILE).min(width - 4);
            for column in columns {
                let dark = |dx: isize, dy: isize| {
                    let at = (row as isize + dy) as usize * width + (column as isize + dx) as usize;
                    pixels[at] < *threshold
                };
                let upright = dark(0, -3) == dark(0, 3) && dark(-3, 0) == dark(3, 0) && dark(0, -3) != dark(3, 0);
                let slanted = dark(-2, -2) == dark(2, 2) && dark(2, -2) == dark(-2, 2) && dark(2, 2) != dark(2, -2);
                if (upright || slanted)
                    && let Some(crossing) = look(picture, column, row)
                {
                    found.push(crossing);
                }
            }
        }
    }
    strongest_of_neighbours(found)
}

/// The ring around one place.
fn look(picture: &GreyPicture, column: usize, row: usize) -> Option<Crossing> {
    let width = picture.width();
    let pixels = picture.pixels();
    let at = |dx: isize, dy: isize| {
        let place = (row as isize + dy) as usize * width + (column as isize + dx) as usize;
        f64::from(pixels.get(place).copied().unwrap_or(0))
    };
    let ring = RING.map(|[dx, dy]| at(dx, dy));
    let mean = ring.iter().sum::<f64>() / 16.0;
    let (mut saddle, mut lean) = (0.0, 0.0);
    for k in 0..4 {
        saddle += (ring[k] + ring[k + 8] - ring[k + 4] - ring[k + 12]).abs();
    }
    for k in 0..8 {
        lean += (ring[k] - ring[k + 8]).abs();
    }
    let middle = (at(0, 0) + at(1, 0) + at(-1, 0) + at(0, 1) + at(0, -1)) / 5.0;
    let strength = saddle - lean - 4.0 * (middle - mean).abs();
    if strength < 40.0 {
        return None;
    }
    // Exactly four changes, and opposite ones nearly in line.
    let mut changes = [0.0; 4];
    let mut count = 0;
    let mut first_darkens = false;
    for k in 0..16 {
        let (a, b) = (ring[k] - mean, ring[(k + 1) % 16] - mean);
        if (a < 0.0) != (b < 0.0) {
            if count == 4 {
                return None;
            }
            if count == 0 {
                first_darkens = b < 0.0;
            }
            let [p, q] = [RING[k], RING[(k + 1) % 16]];
            let t = a / (a - b);
            let (x, y) = (p[0] as f64 + t * (q[0] - p[0]) as f64, p[1] as f64 + t * (q[1] - p[1]) as f64);
            changes[count] = y.atan2(x);
            count += 1;
        }
    }
    if count != 4 {
        return None;
    }
    let unit = |k: usize| [changes[k].cos(), changes[k].sin()];
    let edge = |k: usize| -> Option<[f64; 2]> {
        let (a, b) = (unit(k), unit(k + 2));
        let sum = [a[0] - b[0], a[1] - b[1]];
        let length = sum[0].hypot(sum[1]);
        // 2 for opposite directions.
        (length > 1.7).then(|| [sum[0] / length, sum[1] / length])
    };
    let (first, second) = (edge(0)?, edge(1)?);
    let edges = if first_darkens { [first, second] } else { [second, [-first[0], -first[1]]] };
    Some(Crossing { pixel: [column as f64, row as f64], edges, strength })
}

/// One candidate a place: neighbours are united at their weighted middle.
fn strongest_of_neighbours(mut found: Vec<Crossing>) -> Vec<Crossing> {
    const NEAR: f64 = 3.0;
    found.sort_by(|a, b| b.strength.total_cmp(&a.strength));
    let mut kept: Vec<Crossing> = Vec::new();
    let mut taken: std::collections::HashMap<[i64; 2], Vec<usize>> = std::collections::HashMap::new();
    for crossing in found {
        let key = crossing.pixel.map(|value| (value / NEAR) as i64);
        let near = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| [key[0] + dx, key[1] + dy])).any(|key| {
            taken.get(&key).is_some_and(|places| {
                places.iter().any(|place| {
                    let other = kept[*place].pixel;
                    (other[0] - crossing.pixel[0]).hypot(other[1] - crossing.pixel[1]) <= NEAR
                })
            })
        });
        if !near {
            if kept.len() == MOST {
                break;
            }
            taken.entry(key).or_default().push(kept.len());
            kept.push(crossing);
        }
    }
    kept
}
