//! After the first iteration the solver allocates nothing: not for linearising, not for trial costs.

#[path = "support/cells.rs"]
mod cells;

use std::alloc::System;

use cellmap::frames::FrameTree;
use cellmap::geometry::Pose;
use cellmap::recording::RobotMotion;
use cellmap::solve::{Assembler, Loss, Normal, Plan, Priors, State};
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

const CELL: &str = "
cellmap: 1
units: {length: m, angle: rad}
world: bench
cameras:
  eye:
    intrinsics: {model: brown, size: [1280, 960], focal: [900, 905], centre: [640, 479], distortion: [0.1, 0.02, 0.001, -0.001, 0.01]}
    refine: [focal, centre, distortion]
    pose: {xyz: [0.1, -1.6, 1.1], rpy: [-2.1, 0.05, 0.1], start: true}
  wrist:
    intrinsics: {model: kannala_brandt, size: [1280, 960], focal: [500, 500], centre: [640, 480], distortion: [0.01, -0.01, 0.004, 0.001]}
    mount: arm.flange
    pose: {xyz: [0.0, -0.08, 0.03], rpy: [0.2, 0.0, 0.1], start: true}
robots:
  arm:
    model: ur5e
    joints: joints.csv
    pose: {xyz: [0.4, 0.3, 0.05], rpy: [0.02, 0.01, 3.0]}
    identify: {joint_offsets: {sigma: 0.01}, lengths: {sigma: 0.002}}
targets:
  plate:
    tags: {dictionary: 6x6_250, grid: {columns: 3, rows: 2, size: 0.1, gap: 0.02, first_id: 0}}
    pose: {xyz: [0, 0, 0], rpy: [0, 0, 0.1], start: true}
";

#[test]
fn linearising_and_trial_costs_allocate_only_once() {
    let layout = cells::layout(CELL);
    let tree = FrameTree::new(&layout);
    let motions = vec![RobotMotion::Joints(cells::wander(&[3.2, -1.6, 1.9, -1.87, -1.57, 0.2], 0.5, 12, 2))];
    let recording = cells::record(&layout, motions, 0.5, 3);
    let plan = Plan::new(&layout, &tree, &recording).unwrap();
    assert!(plan.groups.len() >= 2);
    let state = State {
        static_poses: tree.static_edges.iter().map(|edge| edge.spec.pose().unwrap_or_default()).collect(),
        moving_poses: vec![vec![Pose::identity(); plan.configurations.len()]; tree.moving_edges.len()],
        corrections: vec![vec![0.001; 24]],
        lenses: layout.cameras.iter().map(|c| *c.intrinsics.as_ref().unwrap().parameters()).collect(),
    };
    // One thread, so that every allocation is made while this one waits; the pool's own bookkeeping is warm after the first round.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    for loss in [Loss::Squared, Loss::Huber(1.0), Loss::Cauchy(2.0)] {
        let mut assembler = Assembler::new(&layout, &recording, &plan, Priors::new(&tree, &plan.unknowns));
        assembler.set_loss(loss);
        let mut normal = Normal::default();
        let counted = pool.install(|| {
            assembler.linearise(&state, &mut normal);
            assembler.cost(&state);
            // The test's own harness may wake up and allocate meanwhile, but not time and again.
            let rounds = (0..5).map(|_| {
                let region = Region::new(ALLOCATOR);
                assembler.linearise(&state, &mut normal);
                assembler.cost(&state);
                let counted = region.change();
                counted.allocations + counted.reallocations
            });
            rounds.min()
        });
        assert_eq!(counted, Some(0), "{loss:?}");
    }
}
