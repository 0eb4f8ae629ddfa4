//! From crossings to a grid.
//!
//! Each crossing looks along its two edges, both ways, for the nearest crossing whose edges run alike and whose dark squares lie the
//! other way round, as neighbours on a checkerboard do. Two that choose each other are linked; links spread coordinates over
//! all that hang together. Nothing is believed that was not chosen from both sides, so clutter makes holes, not wrong grids.

use std::collections::{BTreeMap, VecDeque};

use super::crossings::Crossing;
use crate::detect::plane_map::PlaneMap;

/// Cosine of the largest angle between an edge and the way to the next crossing: 14 degrees.
const ALONG: f64 = 0.97;
/// Cosine of the largest angle between the edges of neighbours: 25 degrees.
const ALIKE: f64 = 0.906;

/// Finds a grid of `columns` x `rows` crossings: rough pixels, row by row, each row `columns` long, in either hand.
pub(super) fn grid(crossings: &[Crossing], columns: usize, rows: usize) -> Option<Vec<[f64; 2]>> {
    let wanted = columns.checked_mul(rows)?;
    if crossings.len() < wanted * 3 / 4 {
        return None;
    }
    let links = links(crossings);
    let mut seen = vec![false; crossings.len()];
    let mut best: Option<(usize, Vec<[f64; 2]>)> = None;
    for seed in 0..crossings.len() {
        if seen[seed] {
            continue;
        }
        let places = spread(crossings, &links, seed, &mut seen);
        if places.len() * 4 < wanted * 3 {
            continue;
        }
        for turned in [false, true] {
            let places: BTreeMap<[i32; 2], usize> =
                places.iter().map(|(k, v)| (if turned { [k[1], k[0]] } else { *k }, *v)).collect();
            if let Some((count, grid)) = cut_out(crossings, &places, columns, rows)
                && best.as_ref().is_none_or(|best| count > best.0)
            {
                best = Some((count, grid));
            }
        }
    }
    best.map(|(_, grid)| grid)
}

fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

/// The four neighbours of each crossing: along the first edge and against it, along the second and against it.
fn links(crossings: &[Crossing]) -> Vec<[Option<usize>; 4]> {
    let nearest: Vec<[Option<usize>; 4]> = crossings
        .iter()
        .enumerate()
        .map(|(this, crossing)| {
            let mut best = [(f64::MAX, None); 4];
            for (other, candidate) in crossings.iter().enumerate() {
                let way = [candidate.pixel[0] - crossing.pixel[0], candidate.pixel[1] - crossing.pixel[1]];
                let square = dot(way, way);
                if other == this || square > 160_000.0 {
                    continue;
                }
                for (k, best) in best.iter_mut().enumerate() {
                    if square >= best.0 {
                        continue;
                    }
                    let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
                    let along = sign * dot(way, crossing.edges[k / 2]);
                    // What is dark between the edges of one is bright between those of the other: first and second change places.
                    if along > 0.0
                        && along * along > ALONG * ALONG * square
                        && dot(candidate.edges[0], crossing.edges[1]).abs() > ALIKE
                        && dot(candidate.edges[1], crossing.edges[0]).abs() > ALIKE
                    {
                        *best = (square, Some(other));
                    }
                }
            }
            best.map(|(_, other)| other)
        })
        .collect();
    // Both must have chosen each other.
    nearest
        .iter()
        .enumerate()
        .map(|(this, four)| four.map(|other| other.filter(|other| nearest[*other].contains(&Some(this)))))
        .collect()
}

/// Coordinates of all that hang together with a seed.
fn spread(
    crossings: &[Crossing],
    links: &[[Option<usize>; 4]],
    seed: usize,
    seen: &mut [bool],
) -> BTreeMap<[i32; 2], usize> {
    let mut places = BTreeMap::from([([0, 0], seed)]);
    let mut queue = VecDeque::from([(seed, [0, 0], crossings[seed].edges)]);
    seen[seed] = true;
    while let Some((this, place, axes)) = queue.pop_front() {
        for other in links[this].iter().flatten() {
            if seen[*other] {
                continue;
            }
            let way = [0, 1].map(|k: usize| crossings[*other].pixel[k] - crossings[this].pixel[k]);
            let (a, b) = (dot(way, axes[0]), dot(way, axes[1]));
            let step = if a.abs() > b.abs() { [a.signum() as i32, 0] } else { [0, b.signum() as i32] };
            let there = [place[0] + step[0], place[1] + step[1]];
            if places.contains_key(&there) {
                continue;
            }
            seen[*other] = true;
            places.insert(there, *other);
            // The same axes as they run there.
            let edges = crossings[*other].edges;
            let like = |axis: [f64; 2]| {
                let edge = if dot(edges[0], axis).abs() > dot(edges[1], axis).abs() { edges[0] } else { edges[1] };
                if dot(edge, axis) < 0.0 { [-edge[0], -edge[1]] } else { edge }
            };
            queue.push_back((*other, there, [like(axes[0]), like(axes[1])]));
        }
    }
    places
}

/// The rectangle of `columns` x `rows` that holds most of the places, if there is only one such; what is missing is filled in from the rest.
fn cut_out(
    crossings: &[Crossing],
    places: &BTreeMap<[i32; 2], usize>,
    columns: usize,
    rows: usize,
) -> Option<(usize, Vec<[f64; 2]>)> {
    let (width, height) = (i32::try_from(columns).ok()?, i32::try_from(rows).ok()?);
    let bound = |axis: usize| {
        let values = places.keys().map(move |place| place[axis]);
        Some((values.clone().min()?, values.max()?))
    };
    let ((left, right), (top, bottom)) = (bound(0)?, bound(1)?);
    let mut best = (0, [0, 0], 0);
    for y in top..=(bottom - height + 1) {
        for x in left..=(right - width + 1) {
            let inside =
                places.keys().filter(|p| p[0] >= x && p[0] < x + width && p[1] >= y && p[1] < y + height).count();
            if inside > best.0 {
                best = (inside, [x, y], 1);
            } else if inside == best.0 {
                best.2 += 1;
            }
        }
    }
    let (inside, [x, y], ways) = best;
    let wanted = columns * rows;
    if ways != 1 || inside * 20 < wanted * 17 {
        return None;
    }
    // Each side must be seen, or the board might as well be one further.
    let sides = [(0, x), (0, x + width - 1), (1, y), (1, y + height - 1)];
    if sides.iter().any(|(axis, at)| !places.keys().any(|place| place[*axis] == *at)) {
        return None;
    }
    let cells: Vec<[i32; 2]> = (0..wanted as i32).map(|k| [x + k % width, y + k / width]).collect();
    let known: Vec<([i32; 2], [f64; 2])> =
        cells.iter().filter_map(|cell| Some((*cell, crossings.get(*places.get(cell)?)?.pixel))).collect();
    let grid = cells
        .iter()
        .map(|cell| {
            if let Some((_, pixel)) = known.iter().find(|(place, _)| place == cell) {
                return Some(*pixel);
            }
            // From the nearest twelve, since a lens bends the whole.
            let mut near: Vec<&([i32; 2], [f64; 2])> = known.iter().collect();
            near.sort_by_key(|(place, _)| (place[0] - cell[0]).pow(2) + (place[1] - cell[1]).pow(2));
            near.truncate(12);
            let at: Vec<[f64; 2]> = near.iter().map(|(place, _)| place.map(f64::from)).collect();
            let pixels: Vec<[f64; 2]> = near.iter().map(|(_, pixel)| *pixel).collect();
            Some(PlaneMap::fit(&at, &pixels)?.map(cell.map(f64::from)))
        })
        .collect::<Option<Vec<[f64; 2]>>>()?;
    Some((inside, grid))
}
