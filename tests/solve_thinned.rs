//! A first search on a part of the measurements: it saves linearisations of all of them and changes nothing else.

#[path = "../benches/support/sizes.rs"]
mod sizes;

use cellmap::frames::FrameTree;
use cellmap::solve::{Assembler, Loss, Normal, Options, Plan, Priors, Report, State, minimise};
use rayon::ThreadPoolBuilder;
use sizes::{Board, Problem, Size};

const ONE_ROBOT: Size = Size { spaces: 1, robots: 1, cameras: 3, stops: 300, shots: 1, board: Board::Small, plates: 0 };
/// With a part as large as this a few thousand corners are many.
const PART: Option<usize> = Some(3000);

struct Ready {
    problem: Problem,
    tree: FrameTree,
    plan: Plan,
    start: State,
}

fn ready(size: Size, free: bool, change: impl FnOnce(&mut Problem)) -> Ready {
    let mut problem = sizes::problem(size, free);
    change(&mut problem);
    let tree = FrameTree::new(&problem.layout);
    let plan = Plan::new(&problem.layout, &tree, &problem.recording).unwrap();
    let start = sizes::wrong_start(&problem, &tree, &plan);
    Ready { problem, tree, plan, start }
}

impl Ready {
    fn search(&self, loss: Loss, thinned: Option<usize>) -> (State, Report) {
        let priors = Priors::new(&self.tree, &self.plan.unknowns);
        let mut assembler = Assembler::new(&self.problem.layout, &self.problem.recording, &self.plan, priors);
        assembler.set_loss(loss);
        let mut state = self.start.clone();
        let report = minimise(&mut assembler, &self.tree, &mut state, &Options { thinned, ..Options::default() });
        assert!(report.termination.converged(), "{report:?}");
        assert!(report.costs.windows(2).all(|pair| pair[1] <= pair[0]), "{report:?}");
        assert_eq!(report.costs[0], report.initial_cost);
        (state, report)
    }

    /// Both ways, which must end in the same place; returns the report of the search that had a part.
    fn same_end(&self, loss: Loss) -> Report {
        let ((all, plain), (thinned, report)) = (self.search(loss, None), self.search(loss, PART));
        assert_eq!(plain.thinned, 0);
        assert!((report.initial_cost - plain.initial_cost).abs() < 1e-12 * plain.initial_cost, "{plain:?} {report:?}");
        assert!((report.final_cost - plain.final_cost).abs() < 1e-11 * plain.final_cost, "{plain:?} {report:?}");
        for (a, b) in all.static_poses.iter().zip(&thinned.static_poses) {
            let (t, r) = (a.inverse() * *b).magnitude();
            assert!(t < 1e-8 && r < 1e-8, "{t:e} m, {r:e} rad");
        }
        report
    }
}

#[test]
fn a_part_saves_linearisations_of_all_and_leads_to_the_same_minimum() {
    for free in [false, true] {
        let ready = ready(ONE_ROBOT, free, |_| {});
        for loss in [Loss::Squared, Loss::Huber(1.5)] {
            let report = ready.same_end(loss);
            assert!(report.thinned > 2, "{free} {loss:?}: {report:?}");
            assert!(report.iterations <= if free { 4 } else { 3 }, "{free} {loss:?}: {report:?}");
        }
    }
}

/// Steps are judged by costs that a linearisation tells and by costs that were evaluated.
#[test]
fn a_linearisation_tells_the_same_cost_as_an_evaluation() {
    let stops = |problem: &mut Problem| problem.layout.robots[0].repeatability = Some([1e-4, 5e-4]);
    for ready in [ready(ONE_ROBOT, true, |_| {}), ready(ONE_ROBOT, false, stops)] {
        for loss in [Loss::Squared, Loss::Huber(1.5)] {
            let priors = Priors::new(&ready.tree, &ready.plan.unknowns);
            let mut assembler = Assembler::new(&ready.problem.layout, &ready.problem.recording, &ready.plan, priors);
            assembler.set_loss(loss);
            let told = assembler.linearise(&ready.start, &mut Normal::default());
            assert_eq!(told, assembler.cost(&ready.start), "{loss:?}");
        }
    }
}

#[test]
fn robots_that_take_turns_are_all_seen() {
    let report = ready(Size { robots: 3, cameras: 6, stops: 600, ..ONE_ROBOT }, false, |_| {}).same_end(Loss::Squared);
    assert!(report.thinned > 0 && report.iterations <= 3, "{report:?}");
}

#[test]
fn robots_that_stop_inexactly_are_no_hindrance() {
    let ready = ready(ONE_ROBOT, false, |problem| problem.layout.robots[0].repeatability = Some([1e-4, 5e-4]));
    let report = ready.same_end(Loss::Squared);
    assert!(report.thinned > 0 && report.iterations <= 4, "{report:?}");
}

#[test]
fn no_part_is_searched_where_targets_move_or_the_loss_forgets_or_little_was_measured() {
    let moving = ready(Size { robots: 0, cameras: 3, stops: 200, ..ONE_ROBOT }, false, |_| {});
    assert_eq!(moving.search(Loss::Squared, PART).1.thinned, 0);
    let still = ready(ONE_ROBOT, false, |_| {});
    let corners = still.plan.measurements.corner_count();
    for (loss, part) in [(Loss::Cauchy(1e4), PART), (Loss::Tukey(1e7), PART), (Loss::Squared, Some(corners / 3))] {
        assert_eq!(still.search(loss, part).1.thinned, 0, "{loss:?}");
    }
}

#[test]
fn a_good_start_is_left_alone() {
    let mut ready = ready(ONE_ROBOT, false, |_| {});
    ready.start = ready.search(Loss::Squared, None).0;
    for loss in [Loss::Squared, Loss::Huber(1.5)] {
        let ((_, plain), (_, report)) = (ready.search(loss, None), ready.search(loss, PART));
        assert_eq!((report.iterations, report.costs), (plain.iterations, plain.costs), "{loss:?}");
        assert!(report.thinned == 1, "{loss:?}");
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let ready = ready(ONE_ROBOT, true, |_| {});
    let on = |threads| {
        let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| ready.search(Loss::Squared, PART))
    };
    let (state, report) = on(1);
    for threads in [2, 5] {
        let (other, again) = on(threads);
        assert_eq!(state, other);
        assert_eq!(report.costs, again.costs);
    }
}
