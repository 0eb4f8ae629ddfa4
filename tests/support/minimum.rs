//! Whether a search without a guess ends where one from the truth ends.
#![allow(dead_code)]

use cellmap::frames::FrameTree;
use cellmap::geometry::Pose;

use crate::random_cells::{Kind, cell, solve, solve_from};

/// The five kinds of cells that are tried.
pub const KINDS: [Kind; 5] = [Kind::OneRobot, Kind::TwoRobots, Kind::Lenses, Kind::Links, Kind::StopsTold];

/// Solves a cell from the closed-form start and from the truth: the relative difference of the final costs and the largest distance (m) and angle (rad)
/// of a pose. In a cell in which a direction is open, and named as such, the minimum is a valley: its floor alone is compared.
pub fn apart(kind: Kind, seed: u64) -> [f64; 3] {
    let simulated = cell(kind, seed, 18);
    let truth = FrameTree::new(&simulated.truth);
    let poses: Vec<(String, Pose)> =
        truth.static_edges.iter().filter_map(|edge| Some((edge.key.clone(), edge.spec.truth()?))).collect();
    let (free, guided) = (solve(&simulated), solve_from(&simulated, &poses));
    assert!(free.report.termination.converged() && guided.report.termination.converged(), "{kind:?} {seed}");
    let cost = (free.report.final_cost - guided.report.final_cost).abs() / guided.report.final_cost;
    let mut worst = [cost, 0.0, 0.0];
    if !free.undetermined.is_empty() {
        return worst;
    }
    for (edge, (a, b)) in
        free.tree.static_edges.iter().zip(free.state.static_poses.iter().zip(&guided.state.static_poses))
    {
        // What no camera saw in this cell stays where it was put.
        if free.unseen.contains(&edge.frame) {
            continue;
        }
        let (mut t, mut r) = (a.inverse() * *b).magnitude();
        // A plate whose pattern has two equal ends may come out turned by half a turn in its plane.
        if edge.key.contains("gauge") && r > 3.0 {
            (t, r) = (0.0, 0.0);
        }
        worst = [worst[0], worst[1].max(t), worst[2].max(r)];
    }
    worst
}
