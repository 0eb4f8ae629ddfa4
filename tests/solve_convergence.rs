//! How the search behaves: few linearisations from wrong starts, never uphill, and what it does when the equations cannot be solved as they are.

#[path = "support/cells.rs"]
mod cells;

use cellmap::frames::{FrameTree, Freedom};
use cellmap::geometry::Pose;
use cellmap::geometry::pose::Twist;
use cellmap::initialise::initialise;
use cellmap::layout::{Layout, SolverChoice};
use cellmap::recording::Recording;
use cellmap::solve::{Assembler, Loss, Options, Plan, Priors, Report, State, Termination, minimise};
use nalgebra::Vector3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// The truth of a layout as a state.
fn truth_of(layout: &Layout, tree: &FrameTree, plan: &Plan) -> State {
    State {
        static_poses: tree.static_edges.iter().map(|edge| edge.spec.pose().unwrap_or_default()).collect(),
        moving_poses: vec![vec![Pose::identity(); plan.configurations.len()]; tree.moving_edges.len()],
        corrections: layout.robots.iter().map(|robot| vec![0.0; 4 * robot.frames().len()]).collect(),
        lenses: layout
            .cameras
            .iter()
            .map(|c| c.intrinsics.as_ref().map_or([0.0; 12], |lens| *lens.parameters()))
            .collect(),
    }
}

/// Every pose to be found, moved by `metres` and `degrees` in a random direction.
fn displaced(tree: &FrameTree, state: &State, metres: f64, degrees: f64, seed: u64) -> State {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut direction = || Vector3::from_fn(|_, _| random.random_range(-1.0..1.0_f64)).normalize();
    let mut wrong = state.clone();
    for (pose, edge) in wrong.static_poses.iter_mut().zip(&tree.static_edges) {
        if edge.freedom == Freedom::Pose {
            let (t, r) = (direction() * metres, direction() * degrees.to_radians());
            *pose = *pose * Pose::exp(&Twist::new(t.x, t.y, t.z, r.x, r.y, r.z));
        }
    }
    wrong
}

fn check(report: &Report) {
    assert!(report.costs.windows(2).all(|pair| pair[1] <= pair[0]), "{report:?}");
    assert!(report.costs.iter().all(|cost| cost.is_finite()), "{report:?}");
}

/// The two-robot cell: the poses that a solver would find are to be found, the start is the truth.
fn two_robots() -> (Layout, Layout) {
    let truth = cells::layout(&cells::two_robot_truth());
    let hidden = cells::layout(&cells::hidden(cells::TWO_ROBOTS));
    (truth, hidden)
}

fn with_outliers(recording: &mut Recording, every: usize) {
    for (i, row) in recording.corners.iter_mut().enumerate() {
        if i % every == 0 {
            let i = i as f64;
            row.pixel = [row.pixel[0] + 15.0 * i.sin(), row.pixel[1] + 15.0 * (1.3 * i).cos()];
        }
    }
}

#[test]
fn wrong_starts_of_50_mm_and_3_degrees_take_few_linearisations() {
    let (truth, hidden) = two_robots();
    let tree = FrameTree::new(&hidden);
    let clean = cells::record(&truth, cells::two_robot_motion(25), 0.1, 9);
    let mut spoiled = clean.clone();
    with_outliers(&mut spoiled, 20);
    let cases = [(&clean, Loss::Squared, 8), (&clean, Loss::Huber(1.5), 20), (&spoiled, Loss::Huber(1.5), 20)];
    for (recording, loss, most) in cases {
        let mut plan = Plan::new(&hidden, &tree, recording).unwrap();
        let good = initialise(&hidden, &tree, recording, &mut plan, &[]).unwrap().state;
        let mut found = None;
        for seed in 0..5 {
            let mut state = displaced(&tree, &good, 0.05, 3.0, seed);
            let priors = Priors::new(&tree, &plan.unknowns);
            let mut assembler = Assembler::new(&hidden, recording, &plan, priors);
            assembler.set_loss(loss);
            let report = minimise(&mut assembler, &tree, &mut state, &Options::default());
            check(&report);
            assert!(report.termination.converged(), "{loss:?} {seed}: {report:?}");
            assert!(report.termination.words().starts_with("converged: "));
            assert!(report.iterations <= most, "{loss:?} {seed}: {report:?}");
            let lowest = *found.get_or_insert(report.final_cost);
            assert!((report.final_cost - lowest).abs() < 1e-6 * lowest, "{loss:?} {seed}: {lowest} {report:?}");
        }
    }
}

/// A camera and a plate of which nothing says where they are: six directions of the equations are empty.
const FLOATING: &str = "
cellmap: 1
units: {length: m, angle: rad}
world: bench
cameras:
  eye:
    intrinsics: {model: brown, size: [1280, 960], focal: [900, 905], centre: [640, 479], distortion: [0.1, 0.02, 0.001, -0.001, 0.01]}
    pose: {xyz: [0.1, -1.6, 1.1], rpy: [-2.1, 0.05, 0.1], start: true}
robots:
  arm: {model: ur5e, joints: joints.csv, pose: {xyz: [0.4, 0.3, 0.05], rpy: [0.02, 0.01, 3.0]}}
targets:
  plate:
    tags: {dictionary: 6x6_250, grid: {columns: 3, rows: 2, size: 0.1, gap: 0.02, first_id: 0}}
    pose: {xyz: [0, 0, 0], rpy: [0, 0, 0.1], start: true}
";

/// The form of the equations must not matter to what is told of them.
const FORMS: [SolverChoice; 2] = [SolverChoice::Dense, SolverChoice::Sparse];

fn floating(solver: SolverChoice) -> (Layout, Recording) {
    let mut layout = cells::layout(FLOATING);
    layout.solve.solver = solver;
    let motions =
        vec![cellmap::recording::RobotMotion::Joints(cells::wander(&[3.2, -1.6, 1.9, -1.87, -1.57, 0.2], 0.1, 3, 2))];
    let recording = cells::record(&layout, motions, 0.3, 3);
    (layout, recording)
}

#[test]
fn equations_that_are_not_positive_definite_raise_the_damping_and_nothing_else() {
    FORMS.into_iter().for_each(not_positive_definite);
}

fn not_positive_definite(solver: SolverChoice) {
    let (layout, recording) = floating(solver);
    let tree = FrameTree::new(&layout);
    let plan = Plan::new(&layout, &tree, &recording).unwrap();
    let mut state = displaced(&tree, &truth_of(&layout, &tree, &plan), 0.05, 3.0, 4);
    let mut assembler = Assembler::new(&layout, &recording, &plan, Priors::default());
    assembler.set_loss(Loss::Squared);
    // Without damping the matrix is singular: rounding decides whether a pivot or the size of the step betrays it.
    let options = Options { damping: 0.0, ..Options::default() };
    let report = minimise(&mut assembler, &tree, &mut state, &options);
    check(&report);
    assert!(report.refused + report.rejected > 0, "{report:?}");
    assert!(report.termination.converged() && state.is_finite(), "{report:?}");
    let mut other = truth_of(&layout, &tree, &plan);
    let usual = minimise(&mut assembler, &tree, &mut other, &Options::default());
    assert!((report.final_cost - usual.final_cost).abs() < 1e-6 * usual.final_cost, "{report:?} {usual:?}");
}

#[test]
fn from_far_away_steps_are_refused_until_damping_makes_them_short() {
    FORMS.into_iter().for_each(from_far_away);
}

fn from_far_away(solver: SolverChoice) {
    let (layout, recording) = floating(solver);
    let tree = FrameTree::new(&layout);
    let plan = Plan::new(&layout, &tree, &recording).unwrap();
    let mut rejected = 0;
    for seed in 0..8 {
        let mut state = displaced(&tree, &truth_of(&layout, &tree, &plan), 0.6, 50.0, seed);
        let mut assembler = Assembler::new(&layout, &recording, &plan, Priors::default());
        assembler.set_loss(Loss::Squared);
        let report = minimise(&mut assembler, &tree, &mut state, &Options::default());
        check(&report);
        assert!(report.final_cost <= report.initial_cost && state.is_finite());
        rejected += report.rejected;
    }
    assert!(rejected > 0);
}

#[test]
fn a_start_that_is_no_number_is_said_to_be_none() {
    let (layout, recording) = floating(SolverChoice::Auto);
    let tree = FrameTree::new(&layout);
    let plan = Plan::new(&layout, &tree, &recording).unwrap();
    for spoil in [f64::NAN, f64::INFINITY] {
        let mut state = truth_of(&layout, &tree, &plan);
        state.static_poses[0].translation.x = spoil;
        let mut assembler = Assembler::new(&layout, &recording, &plan, Priors::default());
        let report = minimise(&mut assembler, &tree, &mut state, &Options::default());
        assert_eq!(report.termination, Termination::BadStart);
        assert!(report.termination.words().contains("not a number"));
    }
}
