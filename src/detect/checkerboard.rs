//! Which corner of a checkerboard is the first?
//!
//! A finder returns a grid of corners that starts wherever it happened to start. Two pictures of one
//! board must agree, or the solver is told that the board turned. What can be told from a picture:
//!
//! * **Handedness**: x along columns, y along rows, z into the board. Seen from the front, as a board
//!   always is, columns then turn clockwise into rows; a grid that runs the other way is mirrored back.
//! * **Colours**: the square between the first four corners shall be black. Half a turn moves the last
//!   square there, which has the same colour if columns + rows is even, so:
//!
//! | inner corners | orientations that remain |
//! |---|---|
//! | one odd, one even | 1 |
//! | both odd or both even | 2 |
//! | n x n, n odd (a quarter turn swaps the colours) | 2 |
//! | n x n, n even (a quarter turn keeps them) | 4 |
//!
//! A board with both counts odd or both even may have a white first square whichever way it is turned;
//! then colours decide nothing and the answer is the same: two orientations. Where several
//! remain the one whose first corner is nearest to the picture's top-left is given, and the count
//! says that it was only a choice: the robot's motion must decide.
//!
//! Nothing here needs a finder: pictures and corners in, corners out.

use super::picture::GreyPicture;
use super::plane_map::PlaneMap;

/// A grid in canonical order.
#[derive(Debug, Clone, PartialEq)]
pub struct CanonicalGrid {
    /// `columns * rows` pixels, corner = row * columns + column.
    pub corners: Vec<[f64; 2]>,
    /// How many orders of the corners look alike: 1, 2 or 4.
    pub orientations: usize,
}

/// How many ways a board of `columns` x `rows` inner corners can be turned and look the same.
#[must_use]
pub fn orientations(columns: usize, rows: usize) -> usize {
    match (columns == rows, (columns + rows).is_multiple_of(2), columns.is_multiple_of(2)) {
        (true, _, true) => 4,
        (_, true, _) => 2,
        _ => 1,
    }
}

/// Puts a found grid into canonical order.
///
/// # Arguments
/// * `corners` - as found, row by row, each row `columns` long; mirrored or turned, but complete.
///
/// `None` if the number of corners is wrong, a side has fewer than 2, or the colours of its squares
/// do not alternate (then it is no checkerboard).
#[must_use]
pub fn canonical(picture: &GreyPicture, corners: &[[f64; 2]], columns: usize, rows: usize) -> Option<CanonicalGrid> {
    if columns < 2 || rows < 2 || columns.checked_mul(rows)? != corners.len() {
        return None;
    }
    let mut grid = corners.to_vec();
    // Twice the signed area of the board's outline: positive if it runs clockwise as seen (y down).
    let outline = [grid[0], grid[columns - 1], grid[columns * rows - 1], grid[columns * (rows - 1)]];
    let area: f64 =
        (0..4).map(|k| outline[k][0] * outline[(k + 1) % 4][1] - outline[(k + 1) % 4][0] * outline[k][1]).sum();
    if area < 0.0 {
        grid.chunks_exact_mut(columns).for_each(<[_]>::reverse);
    }
    let black_first = first_is_black(picture, &grid, columns, rows)?;

    let mut half_turn = grid.clone();
    half_turn.reverse();
    let mut candidates = vec![grid, half_turn];
    if columns == rows {
        // New columns run along the old rows; mirrored so that the hand stays the same.
        let quarter = |grid: &[[f64; 2]]| -> Vec<[f64; 2]> {
            (0..columns * rows)
                .filter_map(|k| grid.get((columns - 1 - k % columns) * columns + k / columns).copied())
                .collect()
        };
        let turned = [quarter(&candidates[0]), quarter(&candidates[1])];
        candidates.extend(turned);
    }
    // Which of them start with a black square follows from the counts; no need to look again.
    let same_after_half = (columns + rows).is_multiple_of(2);
    let same_after_quarter = columns.is_multiple_of(2);
    let black = [
        black_first,
        black_first == same_after_half,
        black_first == same_after_quarter,
        black_first == (same_after_quarter == same_after_half),
    ];
    let any_black = candidates.iter().zip(black).any(|(_, black)| black);
    let corners = candidates
        .into_iter()
        .zip(black)
        .filter(|(_, black)| *black || !any_black)
        .map(|(grid, _)| grid)
        .min_by(|a, b| (a[0][0] + a[0][1]).total_cmp(&(b[0][0] + b[0][1])))?;
    Some(CanonicalGrid { corners, orientations: orientations(columns, rows) })
}

/// Whether the square at the first corner is of the darker colour; `None` if there are no two colours.
fn first_is_black(picture: &GreyPicture, grid: &[[f64; 2]], columns: usize, rows: usize) -> Option<bool> {
    let (mut even, mut odd) = (Vec::new(), Vec::new());
    for row in 0..rows - 1 {
        for column in 0..columns - 1 {
            let first = row * columns + column;
            let four = [grid[first], grid[first + 1], grid[first + columns + 1], grid[first + columns]];
            let list = if (row + column).is_multiple_of(2) { &mut even } else { &mut odd };
            list.extend(square_value(picture, four));
        }
    }
    if odd.is_empty() {
        // A 2 x 2 grid has one whole square. Those across its sides have the other colour: half of each
        // lies within half a square outside.
        let four = [*grid.first()?, *grid.get(1)?, *grid.get(3)?, *grid.get(2)?];
        let centre = [0, 1].map(|axis: usize| four.iter().map(|corner| corner[axis]).sum::<f64>() / 4.0);
        for side in 0..4 {
            let middle = [0, 1].map(|axis: usize| (four[side][axis] + four[(side + 1) % 4][axis]) / 2.0);
            odd.extend(picture.sample(1.5 * middle[0] - 0.5 * centre[0], 1.5 * middle[1] - 0.5 * centre[1]));
        }
    }
    let (even, odd) = (mean(&even)?, mean(&odd)?);
    ((even - odd).abs() >= 4.0).then_some(even < odd)
}

/// Mean grey value of a square away from its edges.
fn square_value(picture: &GreyPicture, [a, b, c, d]: [[f64; 2]; 4]) -> Option<f64> {
    let mut values = Vec::with_capacity(9);
    for u in [0.35, 0.5, 0.65] {
        for v in [0.35, 0.5, 0.65] {
            let at =
                |axis: usize| (1.0 - v) * ((1.0 - u) * a[axis] + u * b[axis]) + v * ((1.0 - u) * d[axis] + u * c[axis]);
            values.extend(picture.sample(at(0), at(1)));
        }
    }
    mean(&values)
}

fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// Whether a found grid can be a flat checkerboard: its corners are a perspective picture of a grid to
/// within a tenth of a square, and every inner square differs in colour from those beside it.
///
/// Finders return wrong grids from clutter; a wrong grid does far more harm than a missed one.
#[must_use]
pub fn plausible(picture: &GreyPicture, corners: &[[f64; 2]], columns: usize, rows: usize) -> bool {
    regular(corners, columns, rows) && alternates(picture, corners, columns, rows)
}

fn regular(corners: &[[f64; 2]], columns: usize, rows: usize) -> bool {
    if columns < 2 || rows < 2 || columns.checked_mul(rows) != Some(corners.len()) {
        return false;
    }
    let places: Vec<[f64; 2]> = (0..corners.len()).map(|k| [(k % columns) as f64, (k / columns) as f64]).collect();
    let Some(plane) = PlaneMap::fit(&places, corners) else { return false };
    places.iter().zip(corners).all(|(place, corner)| {
        let expected = plane.map(*place);
        let [along, across] = plane.square(*place);
        let spacing = along[0].hypot(along[1]).min(across[0].hypot(across[1]));
        // A strong lens bends a large board by some pixels; a wrong corner is off by half a square.
        let allowed = (0.1 * spacing).max(1.0) + 0.01 * (columns.max(rows) as f64) * spacing;
        spacing >= 3.0 && (expected[0] - corner[0]).hypot(expected[1] - corner[1]) < allowed
    })
}

fn alternates(picture: &GreyPicture, corners: &[[f64; 2]], columns: usize, rows: usize) -> bool {
    let value = |column: usize, row: usize| {
        let first = row * columns + column;
        square_value(
            picture,
            [corners[first], corners[first + 1], corners[first + columns + 1], corners[first + columns]],
        )
    };
    let squares: Vec<Option<f64>> =
        (0..(columns - 1) * (rows - 1)).map(|k| value(k % (columns - 1), k / (columns - 1))).collect();
    let mut sign = 0.0;
    for row in 0..rows - 1 {
        for column in 0..columns - 1 {
            let here = row * (columns - 1) + column;
            let mut beside = Vec::with_capacity(2);
            if column + 2 < columns {
                beside.push(here + 1);
            }
            if row + 2 < rows {
                beside.push(here + columns - 1);
            }
            for other in beside {
                let (Some(this), Some(that)) = (squares[here], squares[other]) else { return false };
                let difference = if (row + column).is_multiple_of(2) { that - this } else { this - that };
                if difference.abs() < 4.0 || difference * sign < 0.0 {
                    return false;
                }
                sign = difference.signum();
            }
        }
    }
    true
}
