//! Board corners against exact truth, and the order of a checkerboard's corners.

#[path = "support/rendering.rs"]
mod common;
use cellmap::detect::GreyPicture;
use cellmap::detect::checkerboard::{canonical, orientations, plausible};
use cellmap::detect::edge_lines::Refinement;
use cellmap::detect::saddle::{RoughCorner, refine_saddle};
use common::{Random, View, render};

/// A board of `columns` x `rows` inner corners at whole numbers; the square between the first four is black.
fn board_value([x, y]: [f64; 2], columns: usize, rows: usize) -> f64 {
    let inside = x > -1.0 && y > -1.0 && x < columns as f64 && y < rows as f64;
    if inside && (x.floor() as i64 + y.floor() as i64).rem_euclid(2) == 0 { 40.0 } else { 210.0 }
}

fn rendered(
    random: &mut Random,
    columns: usize,
    rows: usize,
    square: f64,
    tilt: f64,
) -> (GreyPicture, Vec<[f64; 2]>, View) {
    let extent = (square * (columns.max(rows) as f64 + 2.0) * 1.6) as usize;
    let mut view =
        View::random(random, [extent as f64 / 2.0 + random.0 as f64 % 0.37, extent as f64 / 2.0], square, tilt);
    // The board's middle to the picture's middle.
    let middle = view.ideal([(columns as f64 - 1.0) / 2.0, (rows as f64 - 1.0) / 2.0]);
    view.centre = [0, 1].map(|axis: usize| 2.0 * view.centre[axis] - middle[axis]);
    let picture = render(random, extent, extent, 0.7, 2.0, |pixel| board_value(view.plane(pixel), columns, rows));
    let corners = (0..columns * rows).map(|k| view.ideal([(k % columns) as f64, (k / columns) as f64])).collect();
    (picture, corners, view)
}

#[test]
fn saddles_are_exact_and_their_covariance_is_honest() {
    let mut random = Random(3);
    let (mut count, mut weak, mut squares, mut normalised, mut offset) = (0.0, 0.0, 0.0, 0.0, [0.0; 2]);
    for _ in 0..16 {
        let size = random.between(14.0, 35.0);
        let (picture, truth, view) = rendered(&mut random, 3, 4, size, 0.9);
        for (k, truth) in truth.iter().enumerate() {
            let place = [(k % 3) as f64, (k / 3) as f64];
            let beside = [view.ideal([place[0] + 1.0, place[1]]), view.ideal([place[0], place[1] + 1.0])];
            let rough = RoughCorner {
                pixel: [truth[0] + 0.7 * random.normal(), truth[1] + 0.7 * random.normal()],
                square: beside.map(|next| [next[0] - truth[0], next[1] - truth[1]]),
                margin: 0.5,
                black_ahead: Some((k % 3 + k / 3) % 2 == 0),
            };
            let Refinement::Refined { pixel, covariance: [suu, suv, svv] } = refine_saddle(&picture, &rough) else {
                weak += 1.0;
                continue;
            };
            let e = [pixel[0] - truth[0], pixel[1] - truth[1]];
            count += 1.0;
            squares += e[0] * e[0] + e[1] * e[1];
            offset = [offset[0] + e[0], offset[1] + e[1]];
            normalised +=
                (e[0] * e[0] * svv - 2.0 * e[0] * e[1] * suv + e[1] * e[1] * suu) / (suu * svv - suv * suv) / 2.0;
            let wrong = RoughCorner { black_ahead: rough.black_ahead.map(|black| !black), ..rough };
            assert!(
                matches!(refine_saddle(&picture, &wrong), Refinement::Weak(_)),
                "the colours are the other way round"
            );
        }
    }
    let rms = (squares / count / 2.0_f64).sqrt();
    println!(
        "saddles {count} weak {weak} rms {rms:.4} px an axis, offset {:+.4} {:+.4}, normalised {:.2}",
        offset[0] / count,
        offset[1] / count,
        normalised / count
    );
    assert!(rms < 0.03 && weak <= 0.05 * count);
    assert!((0.5..2.0).contains(&(normalised / count)));
    assert!(offset.iter().all(|sum| sum.abs() / count < 0.006));
}

#[test]
fn every_found_order_becomes_the_one_order() {
    let mut random = Random(11);
    let (columns, rows) = (3, 4);
    let (picture, truth, _) = rendered(&mut random, columns, rows, 20.0, 0.5);
    assert!(plausible(&picture, &truth, columns, rows));
    let mirrored =
        |grid: &[[f64; 2]]| grid.chunks(columns).flat_map(|row| row.iter().rev().copied()).collect::<Vec<_>>();
    let turned = |grid: &[[f64; 2]]| grid.iter().rev().copied().collect::<Vec<_>>();
    for found in [truth.clone(), turned(&truth), mirrored(&truth), turned(&mirrored(&truth))] {
        let canonical = canonical(&picture, &found, columns, rows).unwrap();
        assert_eq!(canonical.corners, truth);
        assert_eq!(canonical.orientations, 1);
    }
    let mut shifted = truth.clone();
    shifted[5][0] += 12.0;
    assert!(!plausible(&picture, &shifted, columns, rows));
    assert!(canonical(&picture, &truth, 4, 4).is_none(), "the number of corners is wrong");
    let blank = GreyPicture::new(picture.width(), picture.height(), vec![90; picture.pixels().len()]).unwrap();
    assert!(!plausible(&blank, &truth, columns, rows));
    assert!(canonical(&blank, &truth, columns, rows).is_none());
}

#[test]
fn what_cannot_be_known_is_counted() {
    assert_eq!(
        [(3, 4), (4, 3), (4, 6), (3, 5), (5, 5), (4, 4), (2, 2)].map(|(c, r)| orientations(c, r)),
        [1, 1, 2, 2, 2, 4, 4]
    );
    let mut random = Random(5);
    for (n, quarter_is_alike) in [(4, true), (5, false)] {
        let (picture, truth, _) = rendered(&mut random, n, n, 18.0, 0.3);
        let turn = |grid: &[[f64; 2]]| (0..n * n).map(|k| grid[(n - 1 - k % n) * n + k / n]).collect::<Vec<_>>();
        let first = canonical(&picture, &truth, n, n).unwrap();
        // The same choice from wherever the finder starts.
        let mut grid = truth.clone();
        for _ in 0..4 {
            grid = turn(&grid);
            assert_eq!(canonical(&picture, &grid, n, n).unwrap(), first);
        }
        let alike = [truth.clone(), turn(&truth), turn(&turn(&truth)), turn(&turn(&turn(&truth)))];
        let at = alike.iter().position(|grid| *grid == first.corners).unwrap();
        assert!(quarter_is_alike || at % 2 == 0, "a quarter turn of an odd board would start with white");
    }
}
