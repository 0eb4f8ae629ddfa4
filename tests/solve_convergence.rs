//! How the search behaves: few linearisations from wrong starts, never uphill, and what it does when the equations cannot be solved as they are.

#[path = "support/cells.rs"]
mod cells;

use cellmap::frames::{FrameTree, Freedom};
use cellmap::geometry::Pose;
use cellmap::geometry::pose::Twist;
use cellmap::initialise::initialise;
use cellmap::layout::{Layout, SolverChoice, parse_layout};
use cellmap::recording::Recording;
use cellmap::simulate::paper_size;
use cellmap::solve::{Assembler, Loss, Options, Plan, Priors, Report, State, Termination, minimise};
use nalgebra::Vector3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::path::Path;

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
    recording.corners.edit(|rows| {
        for (i, row) in rows.iter_mut().enumerate().step_by(every) {
            let i = i as f64;
            row.pixel = [row.pixel[0] + 15.0 * i.sin(), row.pixel[1] + 15.0 * (1.3 * i).cos()];
        }
    });
}

/// Linearisations at most, under either loss, from 50 mm and 3 degrees off and from the closed form.
const MOST: usize = 8;

#[test]
fn the_benchmark_cells_take_few_linearisations_and_end_at_the_minimum() {
    let parse = |text: &str| parse_layout(Path::new("layout.yaml"), text, None).unwrap();
    for (refine, shots) in [(false, 1), (true, 1), (false, 3), (true, 3)] {
        let (truth, layout) = (parse(&paper_size::truth()), parse(&paper_size::hidden(refine)));
        let recording = paper_size::record(&truth, 30, shots, 40, 0.1);
        let tree = FrameTree::new(&layout);
        let mut plan = Plan::new(&layout, &tree, &recording).unwrap();
        let start = initialise(&layout, &tree, &recording, &mut plan, &[]).unwrap().state;
        for loss in [Loss::Squared, Loss::Huber(1.5)] {
            let wrong = (1..=6).map(|seed| displaced(&tree, &start, 0.05, 3.0, seed));
            for begin in std::iter::once(start.clone()).chain(wrong) {
                let mut assembler = Assembler::new(&layout, &recording, &plan, Priors::new(&tree, &plan.unknowns));
                assembler.set_loss(loss);
                let mut state = begin;
                let report = minimise(&mut assembler, &tree, &mut state, &Options::default());
                check(&report);
                assert!(report.termination.converged(), "{loss:?}: {report:?}");
                assert!(report.iterations <= MOST, "{refine} {shots} {loss:?}: {report:?}");
                // Going on from there with no regard to what is worth it moves nothing by a nanometre or ten nanoradians.
                let mut further = state.clone();
                let more = Options { step: 1e-12, decrease: 0.0, ..Options::default() };
                minimise(&mut assembler, &tree, &mut further, &more);
                for (a, b) in state.static_poses.iter().zip(&further.static_poses) {
                    let (t, r) = (a.inverse() * *b).magnitude();
                    assert!(t < 1e-9 && r < 1e-8, "{refine} {shots} {loss:?}: {t:e} m, {r:e} rad");
                }
            }
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
    for (recording, loss) in [(&clean, Loss::Squared), (&clean, Loss::Huber(1.5)), (&spoiled, Loss::Huber(1.5))] {
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
            assert!(report.iterations <= MOST, "{loss:?} {seed}: {report:?}");
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
fn every_end_of_the_search_has_its_words() {
    let (truth, layout) = two_robots();
    let tree = FrameTree::new(&layout);
    let recording = cells::record(&truth, cells::two_robot_motion(15), 0.1, 9);
    let mut plan = Plan::new(&layout, &tree, &recording).unwrap();
    let good = initialise(&layout, &tree, &recording, &mut plan, &[]).unwrap().state;
    let ends = |options: Options| {
        let mut state = displaced(&tree, &good, 0.05, 3.0, 4);
        let mut assembler = Assembler::new(&layout, &recording, &plan, Priors::new(&tree, &plan.unknowns));
        assembler.set_loss(Loss::Squared);
        minimise(&mut assembler, &tree, &mut state, &options).termination
    };
    let usual = Options::default();
    let cases = [
        (Options { step: 1e-3, decrease: 0.0, ..usual }, Termination::SmallStep, true),
        (Options { step: 0.0, ..usual }, Termination::CostUnchanged, true),
        (Options { iterations: 2, ..usual }, Termination::IterationLimit, false),
        // Any step is taken for small, but only heavy damping makes it so.
        (Options { step: 1e9, damping: 1.0, ..usual }, Termination::Stuck, false),
    ];
    for (options, expected, converged) in cases {
        let found = ends(options);
        assert_eq!(found, expected);
        assert_eq!(found.converged(), converged);
    }
    let words = [
        (Termination::SmallStep, "converged: the last step was too small to matter"),
        (Termination::CostUnchanged, "converged: the cost no longer changes"),
        (Termination::NoUnknowns, "converged: everything is known"),
        (Termination::Stuck, "not converged: no step lowers the cost"),
        (Termination::IterationLimit, "not converged: the iterations ran out"),
        (Termination::BadStart, "not converged: the cost at the start is not a number"),
    ];
    words.into_iter().for_each(|(end, words)| assert_eq!(end.words(), words));
    let (_, recording) = floating(SolverChoice::Auto);
    let known = cells::layout(&FLOATING.replace(", start: true", ""));
    let tree = FrameTree::new(&known);
    let plan = Plan::new(&known, &tree, &recording).unwrap();
    let mut state = truth_of(&known, &tree, &plan);
    let mut assembler = Assembler::new(&known, &recording, &plan, Priors::default());
    let report = minimise(&mut assembler, &tree, &mut state, &usual);
    assert_eq!(report.termination, Termination::NoUnknowns);
    assert!(report.termination.converged());
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
