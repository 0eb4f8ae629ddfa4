//! From a patch's extents to a quadrangle, or to the knowledge that it is none.
//!
//! The convex hull of the extents is a few dozen points at most. A patch that is a square in perspective fills its hull, and
//! the hull is filled by the largest quadrangle in it; letters, scratches and shadows fail one or the other, and that
//! costs them well under a microsecond. What is left is settled on the grey values: each side is moved to where
//! the grey passes half-way between inside and outside, which the binary picture knows only to a pixel.

use super::components::Patch;
use crate::detect::picture::GreyPicture;
use crate::detect::projection::cross;

/// A quadrangle's corners, clockwise as seen (y down), px.
pub(super) type Quad = [[f64; 2]; 4];

/// Sides shorter than this (px) carry nothing that can be read.
const SHORTEST_SIDE: f64 = 5.0;
/// Places along a side at which it is settled.
const PLACES: usize = 12;
/// Grey levels between inside and outside at one place below which there is no side.
const LEAST_RISE: f64 = 10.0;

/// The largest quadrangle of a patch that is one, to within a pixel or so.
pub(super) fn quadrangle(patch: &Patch<'_>, hull: &mut Vec<[i64; 2]>) -> Option<Quad> {
    let filled: u64 =
        patch.left.iter().zip(patch.right).map(|(left, right)| u64::from(right.saturating_sub(*left))).sum();
    let filled = filled as f64;
    // Nothing white within: no code. A tag's border alone is two fifths of it or more, less what blur takes away.
    let area = f64::from(patch.area);
    if area > 0.985 * filled || area < 0.2 * filled {
        return None;
    }
    convex_hull(patch, hull);
    let hull = hull.as_slice();
    let hull_area = polygon_area(hull);
    // Of its box, at most a third longer than the hull's own.
    let across = i64::from(patch.right.iter().copied().max()?) - i64::from(patch.left.iter().copied().min()?);
    let perimeter = 2.0 * (across as f64 + patch.left.len() as f64);
    // Steps of slanted sides leave half a pixel between extents and hull, a thin border that is broken here and there another.
    if filled < 0.94 * hull_area - perimeter {
        return None;
    }
    let corners = largest_quadrangle(hull)?;
    let area = quad_area(&corners);
    // Corners that blur has rounded off cost a pixel or two each.
    if area < 0.9 * hull_area - 0.5 * perimeter || area < 0.7 * hull_area {
        return None;
    }
    // From the corners of pixels to their centres.
    let corners = corners.map(|corner| corner.map(|value| value as f64 - 0.5));
    let shortest = (0..4).map(|k| distance(corners[k], corners[(k + 1) % 4])).fold(f64::MAX, f64::min);
    (shortest >= SHORTEST_SIDE).then_some(corners)
}

/// Whether two quadrangles are one, which may have been found a pixel or two differently: by their middles and their areas.
pub(super) fn same(one: &Quad, other: &Quad) -> bool {
    let middle = |quad: &Quad| [0, 1].map(|axis: usize| quad.iter().map(|corner| corner[axis]).sum::<f64>() / 4.0);
    let cross = |a: [f64; 2], b: [f64; 2]| a[0] * b[1] - a[1] * b[0];
    let area = |quad: &Quad| (0..4).map(|k| cross(quad[k], quad[(k + 1) % 4])).sum::<f64>().abs() / 2.0;
    let [smaller, larger] = [area(one).min(area(other)), area(one).max(area(other))];
    2.0 * smaller > larger && distance(middle(one), middle(other)) < 0.25 * smaller.sqrt()
}

/// Twice the signed area of a triangle; positive if it runs clockwise as seen (y down).
fn turn(a: [i64; 2], b: [i64; 2], c: [i64; 2]) -> i64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Between two points, px. Nothing here is so large or so small that its square is not a number.
pub(super) fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    let [x, y] = [a[0] - b[0], a[1] - b[1]];
    (x * x + y * y).sqrt()
}

/// The hull of a patch's pixels, clockwise as seen, in corners of pixels (the first pixel reaches from 0 to 1).
fn convex_hull(patch: &Patch<'_>, hull: &mut Vec<[i64; 2]>) {
    hull.clear();
    let rows = patch.left.len();
    let top = i64::from(patch.top);
    // Down the right side, then up the left one. Between two rows the farther of the two counts.
    let mut chain = |base: usize, point: [i64; 2]| {
        while hull.len() >= base + 2 && turn(hull[hull.len() - 2], hull[hull.len() - 1], point) <= 0 {
            hull.pop();
        }
        hull.push(point);
    };
    for line in 0..=rows {
        let x = patch.right[line.saturating_sub(1)].max(patch.right[line.min(rows - 1)]);
        chain(0, [i64::from(x), top + line as i64]);
    }
    let base = hull.len();
    let mut chain = |point: [i64; 2]| {
        while hull.len() >= base + 2 && turn(hull[hull.len() - 2], hull[hull.len() - 1], point) <= 0 {
            hull.pop();
        }
        hull.push(point);
    };
    for line in (0..=rows).rev() {
        let x = patch.left[line.saturating_sub(1)].min(patch.left[line.min(rows - 1)]);
        chain([i64::from(x), top + line as i64]);
    }
}

fn polygon_area(points: &[[i64; 2]]) -> f64 {
    let n = points.len();
    let twice: i64 =
        (0..n).map(|k| points[k][0] * points[(k + 1) % n][1] - points[(k + 1) % n][0] * points[k][1]).sum();
    twice.abs() as f64 / 2.0
}

fn quad_area(quad: &[[i64; 2]; 4]) -> f64 {
    polygon_area(quad)
}

/// The largest quadrangle with corners among a hull's points, or one as good as it.
fn largest_quadrangle(hull: &[[i64; 2]]) -> Option<[[i64; 2]; 4]> {
    let n = hull.len();
    if n < 4 {
        return None;
    }
    let farthest = |from: [i64; 2]| {
        (0..n).max_by_key(|k| (hull[*k][0] - from[0]).pow(2) + (hull[*k][1] - from[1]).pow(2)).unwrap_or(0)
    };
    let first = farthest(hull[0]);
    let third = farthest(hull[first]);
    let from_line = |a: usize, b: usize| (0..n).max_by_key(|k| turn(hull[a], hull[b], hull[*k]).abs()).unwrap_or(0);
    let second = from_line(first, third);
    let mut three = [first, second, third];
    three.sort_unstable();
    if three[0] == three[1] || three[1] == three[2] {
        return None;
    }
    // The fourth lies farthest outside the triangle. The hull runs clockwise, outside is to the left.
    let mut best = (0, 0, 0);
    for side in 0..3 {
        let (a, b) = (three[side], three[(side + 1) % 3]);
        let mut k = (a + 1) % n;
        while k != b {
            let outside = -turn(hull[a], hull[b], hull[k]);
            if outside > best.0 {
                best = (outside, k, side);
            }
            k = (k + 1) % n;
        }
    }
    if best.0 == 0 {
        return None;
    }
    let mut four = [three[0], three[1], three[2], best.1];
    four.sort_unstable();
    // Each corner goes to the point farthest from the line between its neighbours; area only grows.
    for _ in 0..4 {
        let before = four;
        for corner in 0..4 {
            let (a, b) = (four[(corner + 3) % 4], four[(corner + 1) % 4]);
            let mut best = (-turn(hull[a], hull[b], hull[four[corner]]), four[corner]);
            let mut k = (a + 1) % n;
            while k != b {
                let outside = -turn(hull[a], hull[b], hull[k]);
                if outside > best.0 {
                    best = (outside, k);
                }
                k = (k + 1) % n;
            }
            four[corner] = best.1;
        }
        if four == before {
            break;
        }
    }
    Some(four.map(|k| hull[k]))
}

/// Moves each side to where the grey passes half-way between inside and outside, and crosses them anew.
///
/// `bright` says which of the two is inside. `None` where a side has no such rise: then this is no tag.
pub(super) fn settle(picture: &GreyPicture, quad: Quad, bright: bool) -> Option<Quad> {
    let mut lines = [[[0.0; 2]; 2]; 4];
    let mut reach = 0.0_f64;
    for side in 0..4 {
        let (start, end) = (quad[side], quad[(side + 1) % 4]);
        let length = distance(start, end);
        let along = [(end[0] - start[0]) / length, (end[1] - start[1]) / length];
        // Clockwise as seen: outside is to the left of the way.
        let outward = [along[1], -along[0]];
        // How far the opposite side is, in the middle; the cells of most families are between a sixth and a ninth of it.
        let (c, d) = (quad[(side + 2) % 4], quad[(side + 3) % 4]);
        let across = [(c[0] + d[0]) / 2.0 - start[0], (c[1] + d[1]) / 2.0 - start[1]];
        let width = -(across[0] * outward[0] + across[1] * outward[1]);
        let gate = (width / 7.5).clamp(1.25, 3.0);
        reach = reach.max(gate);
        let (offset, slope) = side_line(picture, start, along, outward, length, gate, bright)?;
        let moved = |u: f64| {
            let d = offset + slope * (u - length / 2.0);
            [start[0] + u * along[0] + d * outward[0], start[1] + u * along[1] + d * outward[1]]
        };
        lines[side] = [moved(0.0), moved(length)];
    }
    let mut settled = quad;
    for corner in 0..4 {
        let met = cross(lines[(corner + 3) % 4], lines[corner])?;
        if distance(met, quad[corner]) > 2.5 * reach + 1.0 {
            return None;
        }
        settled[corner] = met;
    }
    Some(settled)
}

/// A side's offset outwards in its middle and its slope, from half-way points along it.
fn side_line(
    picture: &GreyPicture,
    start: [f64; 2],
    along: [f64; 2],
    outward: [f64; 2],
    length: f64,
    gate: f64,
    bright: bool,
) -> Option<(f64, f64)> {
    const MOST: usize = 9;
    let fixed = |value: f64| (value * 65536.0) as i64;
    let unit = if bright { -1.0 / 65536.0 } else { 1.0 / 65536.0 };
    let steps = (2.0 * gate).ceil() as usize;
    let step = 2.0 * gate / steps as f64;
    let (dx, dy) = (fixed(step * outward[0]), fixed(step * outward[1]));
    let places = (length as usize).clamp(5, PLACES);
    let mut points = [[0.0; 2]; PLACES];
    let mut found = 0;
    for place in 0..places {
        // A quarter of a side may be hidden or spoilt.
        if (place - found) * 4 > places {
            return None;
        }
        let u = length * (0.1 + 0.8 * (place as f64 + 0.5) / places as f64);
        let mut x = fixed(start[0] + u * along[0] - gate * outward[0]);
        let mut y = fixed(start[1] + u * along[1] - gate * outward[1]);
        let mut values = [0.0; MOST];
        let mut inside = true;
        for value in values.iter_mut().take(steps + 1) {
            match picture.sample_fixed(x, y) {
                Some(here) => *value = unit * f64::from(here),
                None => inside = false,
            }
            x += dx;
            y += dy;
        }
        if !inside {
            continue;
        }
        let values = &values[..=steps];
        let middle = steps.div_ceil(2);
        let low = values[..=middle].iter().copied().fold(f64::INFINITY, f64::min);
        let high = values[middle..].iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if high - low < LEAST_RISE {
            continue;
        }
        let level = (low + high) / 2.0;
        // Of several rises the one nearest to the side.
        let mut best: Option<f64> = None;
        for k in 0..steps {
            if values[k] < level && values[k + 1] >= level {
                let d = -gate + step * (k as f64 + (level - values[k]) / (values[k + 1] - values[k]));
                if best.is_none_or(|best| d.abs() < best.abs()) {
                    best = Some(d);
                }
            }
        }
        if let Some(d) = best {
            points[found] = [u - length / 2.0, d];
            found += 1;
        }
    }
    if found * 4 < places * 3 {
        return None;
    }
    let points = &mut points[..found];
    let (mut offset, mut slope) = line(points)?;
    // Twice without the worst quarter, so that what is hidden does not turn the side.
    for _ in 0..2 {
        let kept = (found * 3).div_ceil(4).max(4).min(found);
        let off = |p: &[f64; 2]| (p[1] - offset - slope * p[0]).abs();
        // Three are left out at most.
        for last in (kept..found).rev() {
            let worst = (0..=last).max_by(|a, b| off(&points[*a]).total_cmp(&off(&points[*b])));
            points.swap(worst.unwrap_or(last), last);
        }
        (offset, slope) = line(&points[..kept])?;
        let worst = points[..kept].iter().map(|p| (p[1] - offset - slope * p[0]).abs()).fold(0.0, f64::max);
        if worst > 1.0 + 0.01 * length {
            return None;
        }
    }
    Some((offset, slope))
}

/// Least squares: value at 0 and slope.
fn line(points: &[[f64; 2]]) -> Option<(f64, f64)> {
    let n = points.len() as f64;
    let (x, y) = points.iter().fold((0.0, 0.0), |(x, y), p| (x + p[0], y + p[1]));
    let (x, y) = (x / n, y / n);
    let (xx, xy) =
        points.iter().fold((0.0, 0.0), |(xx, xy), p| (xx + (p[0] - x) * (p[0] - x), xy + (p[0] - x) * (p[1] - y)));
    (xx > 1e-9).then(|| {
        let slope = xy / xx;
        (y - slope * x, slope)
    })
}
