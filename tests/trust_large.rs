//! What a large cell is judged by, from sparse factors, against the whole matrices of the same cell.

#[path = "support/cells.rs"]
mod cells;
#[path = "support/random_cells.rs"]
mod random_cells;
#[path = "../benches/support/sizes.rs"]
mod sizes;

use cellmap::layout::{Layout, SolverChoice};
use cellmap::recording::{Recording, RobotMotion};
use cellmap::trust::Source;
use cellmap::workflow::solve::Solved;
use nalgebra::DMatrix;
use random_cells::Kind;
use sizes::Board;
use std::collections::{BTreeMap, BTreeSet};

/// The same cell by whole matrices and by sparse factors.
fn both(layout: &Layout, recording: &Recording) -> [Solved; 2] {
    [SolverChoice::Dense, SolverChoice::Sparse].map(|solver| {
        let mut layout = layout.clone();
        layout.solve.solver = solver;
        let solved = cells::solve(layout, recording);
        assert_eq!(solved.covariance.is_whole(), solver == SolverChoice::Dense);
        solved
    })
}

fn like(a: Option<f64>, b: Option<f64>, within: f64) -> bool {
    match (a, b) {
        (Some(a), Some(b)) => (a - b).abs() <= within * a.abs().max(1e-12),
        (a, b) => a.is_none() && b.is_none(),
    }
}

/// Everything that is told of how sure an answer is.
fn alike([whole, large]: &[Solved; 2], within: f64) {
    // The same directions are open, in whatever basis; and so are their causes.
    let causes = |s: &Solved| s.undetermined.iter().map(|u| u.cause.name()).collect::<BTreeSet<_>>();
    assert_eq!((whole.undetermined.len(), causes(whole)), (large.undetermined.len(), causes(large)));
    assert_eq!(whole.covariance.open.len(), large.covariance.open.len());
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    for direction in &whole.covariance.open {
        let held: f64 = large.covariance.open.iter().map(|other| dot(direction, other).powi(2)).sum();
        assert!((held - 1.0).abs() < 1e-6, "{held}");
    }
    let reasons = |s: &Solved| s.weak.iter().map(|u| u.reason.clone()).collect::<Vec<_>>();
    assert_eq!(reasons(whole).len(), reasons(large).len());
    if whole.undetermined.is_empty() {
        assert_eq!(reasons(whole), reasons(large));
    }
    for source in [Source::Information, Source::Clusters, Source::Both] {
        for (a, b) in whole.plan.unknowns.blocks.iter().zip(&large.plan.unknowns.blocks) {
            let sigma = |s: &Solved, block| s.covariance.pose_sigma(&s.tree, &s.state, block, source);
            let (of_a, of_b) = (sigma(whole, a), sigma(large, b));
            for i in 0..6 {
                assert!(like(of_a[i], of_b[i], within), "{} {source:?} {i}: {of_a:?} {of_b:?}", a.name);
            }
            for column in a.start..a.start + a.count() {
                let sigma = |s: &Solved| s.covariance.column_sigma(column, source);
                assert!(like(sigma(whole), sigma(large), within), "{} {source:?} {column}", a.name);
            }
        }
    }
    // A function of all unknowns.
    let units = whole.covariance.units();
    let jacobian = DMatrix::from_fn(3, units.len(), |i, j| ((1 + i + 3 * j) as f64).sin() / units[j]);
    for (a, b) in whole.covariance.of(&jacobian).iter().zip(&large.covariance.of(&jacobian)) {
        assert!((a - b).norm() <= within * a.norm(), "{a} {b}");
    }
    let scatter = |s: &Solved| [s.covariance.clusters.configurations, s.covariance.clusters.corners];
    for (a, b) in scatter(whole).iter().zip(&scatter(large)) {
        assert_eq!((a.groups, a.shown()), (b.groups, b.shown()));
        assert!(
            like(Some(a.found), Some(b.found), within) && like(Some(a.spread), Some(b.spread), within),
            "{a:?} {b:?}"
        );
    }
    assert_eq!(whole.scales.len(), large.scales.len());
    for (a, b) in whole.scales.iter().zip(&large.scales) {
        assert_eq!((a.kind, &a.of), (b.kind, &b.of));
        assert!(
            (a.excess - b.excess).abs() < 1e-3 * a.sigma && like(Some(a.sigma), Some(b.sigma), 1e-3),
            "{a:?} {b:?}"
        );
    }
}

#[test]
fn well_determined_cells_are_judged_alike() {
    for kind in [Kind::OneRobot, Kind::Lenses, Kind::Links, Kind::StopsTold, Kind::StillCorners] {
        let simulated = random_cells::cell(kind, 5, 20);
        let solved = both(&simulated.told, &simulated.recording);
        assert!(solved[0].undetermined.is_empty(), "{kind:?}");
        alike(&solved, 1e-3);
    }
}

#[test]
fn cells_that_share_nothing_are_judged_like_one_matrix() {
    let size = sizes::Size { spaces: 3, robots: 1, cameras: 2, stops: 24, shots: 1, board: Board::Small, plates: 2 };
    let mut problem = sizes::problem(size, false);
    for shared in [false, true] {
        if shared {
            // All that is seen at a configuration is off by the same.
            problem.recording.corners.edit(|rows| {
                rows.iter_mut().for_each(|row| row.pixel[0] += 0.4 * (7.0 * row.configuration as f64).sin());
            });
        }
        let solved = both(&problem.layout, &problem.recording);
        assert!(solved[0].undetermined.is_empty(), "{:?}", solved[0].undetermined);
        assert_eq!(solved[1].covariance.clusters.configurations.shown(), shared);
        alike(&solved, 1e-3);
    }
}

#[test]
fn open_directions_are_the_same_and_have_the_same_causes() {
    // One robot, two cameras, a tool of unknown pose; all motions turn about one axis, or there are too few.
    let text = cells::one_robot_truth();
    let wrist = &text[text.find("  wrist:").unwrap()..text.find("robots:").unwrap()];
    let pallet = &text[text.find("  pallet:").unwrap()..text.find("solve:").unwrap()];
    let text = text.replace(wrist, "").replace(pallet, "");
    let turning: BTreeMap<u64, Vec<f64>> =
        (0..10).map(|i| (1 + i, vec![-2.3 + 0.08 * i as f64, -1.75, 1.9, -1.7, -1.55, 0.4])).collect();
    let RobotMotion::Joints(seen) = cells::one_robot_path(2).remove(0) else { panic!("a path of joints") };
    let few: BTreeMap<u64, Vec<f64>> = seen.into_iter().take(2).collect();
    for (joints, words) in [(turning, "turn about one axis"), (few, "in only 2 configurations")] {
        let recording = cells::record(&cells::layout(&text), vec![RobotMotion::Joints(joints)], 0.05, 11);
        let solved = both(&cells::layout(&cells::hidden(&text)), &recording);
        for solved in &solved {
            assert!(solved.undetermined.iter().any(|u| u.reason.contains(words)), "{:?}", solved.undetermined);
        }
        alike(&solved, 1e-2);
    }
}
