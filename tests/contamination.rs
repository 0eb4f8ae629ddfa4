//! Gross contamination: nearly a third of all corners anywhere, or a tenth of all configurations wrong, and the cell is found all the same.

#[path = "support/cells.rs"]
mod cells;

use cellmap::recording::{Recording, RobotMotion};
use cellmap::trust::Source;
use cellmap::workflow::solve::Solved;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const SIGMA: f64 = 0.05;

fn clean(seed: u64) -> Recording {
    cells::record(&cells::layout(&cells::one_robot_truth()), cells::one_robot_path(24), SIGMA, seed)
}

fn solve(recording: &Recording) -> Solved {
    cells::solve(cells::layout(&cells::hidden(&cells::one_robot_truth())), recording)
}

/// Every pose against the truth: the largest error in mm, and in standard deviations.
fn worst(solved: &Solved) -> (f64, f64) {
    let truth = cells::layout(&cells::one_robot_truth());
    let (mut mm, mut sigmas) = (0.0_f64, 0.0_f64);
    for (index, edge) in solved.tree.static_edges.iter().enumerate().filter(|(_, edge)| edge.freedom.count() == 6) {
        let Some(block) = solved.plan.unknowns.edge(index) else { continue };
        let (found, right) = (solved.state.static_poses[index], cells::true_pose(&truth, &edge.key));
        let off = found.translation - right.translation;
        let sigma = solved.covariance.pose_sigma(
            &solved.tree,
            &solved.state,
            &solved.plan.unknowns.blocks[block],
            Source::Both,
        );
        mm = mm.max(off.norm() * 1e3);
        for i in 0..3 {
            sigmas = sigmas.max(off[i].abs() / sigma[i].unwrap());
        }
    }
    (mm, sigmas)
}

/// A share of all corners anywhere within 200 px of where they belong, but at least 5 px off.
fn spoil_corners(recording: &mut Recording, share: f64, seed: u64) -> usize {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut count = 0;
    recording.corners.edit(|rows| {
        for row in rows {
            if random.random::<f64>() < share {
                let (far, angle) = (random.random_range(5.0..200.0), random.random_range(0.0..std::f64::consts::TAU));
                row.pixel = [row.pixel[0] + far * f64::cos(angle), row.pixel[1] + far * f64::sin(angle)];
                count += 1;
            }
        }
    });
    count
}

#[test]
fn three_corners_in_ten_anywhere() {
    for seed in 0..5 {
        let mut recording = clean(seed);
        let spoilt = spoil_corners(&mut recording, 0.3, 100 + seed);
        let solved = solve(&recording);
        let (mm, sigmas) = worst(&solved);
        println!("seed {seed}: {spoilt} spoilt, {:?} set aside, {mm:.3} mm, {sigmas:.2} sigma", solved.rejected);
        assert!(mm < 1.0 && sigmas < 5.0, "seed {seed}: {mm} mm, {sigmas} sigma");
        assert!(solved.rejected.corners >= spoilt && solved.rejected.corners < spoilt + spoilt / 20);
        assert!(!solved.trustworthy(), "so much set aside is worth a second look");
    }
}

#[test]
fn one_configuration_in_ten_wrong() {
    for seed in 0..6 {
        let mut recording = clean(20 + seed);
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let RobotMotion::Joints(values) = &mut recording.motions[0] else { panic!("joints") };
        let wrong: Vec<u64> = (0..2).map(|i| 1 + 12 * i + random.random_range(0..12)).collect();
        for id in &wrong {
            for q in values.get_mut(id).unwrap() {
                *q += random.random_range(-0.5..0.5);
            }
        }
        let solved = solve(&recording);
        let (mm, sigmas) = worst(&solved);
        println!("seed {seed}: {wrong:?} wrong, {:?} set aside, {mm:.3} mm, {sigmas:.2} sigma", solved.rejected);
        assert!(mm < 1.0 && sigmas < 5.0, "seed {seed}: {mm} mm, {sigmas} sigma");
        let named = solved.faults.iter().any(|fault| wrong.iter().all(|id| fault.what.contains(&id.to_string())));
        assert!(named, "{wrong:?} {:#?}", solved.faults);
    }
}
