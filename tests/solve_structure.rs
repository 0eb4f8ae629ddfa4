//! Dense and sparse equations: which are chosen, and that the answer is the same.

#[path = "../benches/support/sizes.rs"]
mod sizes;

use cellmap::frames::FrameTree;
use cellmap::geometry::Pose;
use cellmap::layout::SolverChoice;
use cellmap::solve::{Assembler, Normal, Options, Plan, Priors, Report, State, minimise};
use sizes::{Board, Problem, Size};

const SMALL: Size = Size { spaces: 1, robots: 1, cameras: 2, stops: 12, shots: 1, board: Board::Small, plates: 0 };

fn solve(problem: &mut Problem, solver: SolverChoice, threads: usize) -> (Plan, State, Report) {
    let (plan, state, report) = search(problem, solver, threads, &Options::default());
    assert!(report.termination.converged(), "{report:?}");
    (plan, state, report)
}

fn search(problem: &mut Problem, solver: SolverChoice, threads: usize, options: &Options) -> (Plan, State, Report) {
    problem.layout.solve.solver = solver;
    let tree = FrameTree::new(&problem.layout);
    let plan = Plan::new(&problem.layout, &tree, &problem.recording).unwrap();
    let mut state = sizes::wrong_start(problem, &tree, &plan);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let report = pool.install(|| {
        let priors = Priors::new(&tree, &plan.unknowns);
        let mut assembler = Assembler::new(&problem.layout, &problem.recording, &plan, priors);
        minimise(&mut assembler, &tree, &mut state, options)
    });
    (plan, state, report)
}

/// The largest difference of two states' poses, m and rad.
fn apart(a: &State, b: &State) -> f64 {
    let all = |state: &State| -> Vec<Pose> {
        state.static_poses.iter().chain(state.moving_poses.iter().flatten()).copied().collect()
    };
    let difference = |(a, b): (Pose, Pose)| {
        let twist = (a.inverse() * b).log();
        twist.amax()
    };
    all(a).into_iter().zip(all(b)).map(difference).fold(0.0, f64::max)
}

fn agree(mut problem: Problem) {
    let (plan, _, report) = solve(&mut problem, SolverChoice::Dense, 2);
    assert!(!plan.solver().sparse && plan.solver().words().ends_with("as asked"));
    let (plan, _, other) = solve(&mut problem, SolverChoice::Sparse, 2);
    assert!(plan.solver().sparse);
    assert!((report.final_cost - other.final_cost).abs() <= 1e-10 * report.final_cost, "{report:?} {other:?}");
    // Step by step, before the search ends somewhere within what it calls converged.
    let steps = Options { iterations: 3, ..Options::default() };
    let [dense, sparse] =
        [SolverChoice::Dense, SolverChoice::Sparse].map(|solver| search(&mut problem, solver, 2, &steps).1);
    let apart = apart(&dense, &sparse);
    assert!(apart < 1e-10, "{apart}");
}

#[test]
fn a_hall_of_many_cells_is_sparse_and_solves_like_a_full_matrix() {
    let mut problem = sizes::problem(Size { spaces: 8, robots: 2, cameras: 3, stops: 20, plates: 2, ..SMALL }, false);
    let (plan, chosen, _) = solve(&mut problem, SolverChoice::Auto, 2);
    let solver = plan.solver();
    assert!(solver.sparse && solver.sparse_work.unwrap() < 0.05 * solver.dense_work(), "{}", solver.words());
    assert!(solver.words().contains("million multiplications"));
    // The same bits on one thread.
    let (_, alone, _) = solve(&mut problem, SolverChoice::Auto, 1);
    assert_eq!(chosen, alone);
    agree(problem);
}

#[test]
fn few_unknowns_are_dense() {
    let (plan, ..) = solve(&mut sizes::problem(SMALL, false), SolverChoice::Auto, 2);
    assert!(!plan.solver().sparse && plan.solver().sparse_work.is_none());
    assert!(plan.solver().words().ends_with("are few"), "{}", plan.solver().words());
}

#[test]
fn what_moves_and_what_stops_inexactly_is_eliminated_from_sparse_equations_too() {
    agree(sizes::problem(Size { robots: 0, cameras: 4, stops: 40, ..SMALL }, false));
    let mut inexact = sizes::problem(Size { spaces: 8, robots: 1, cameras: 3, ..SMALL }, false);
    for robot in &mut inexact.layout.robots {
        robot.repeatability = Some([1e-4, 1e-3]);
    }
    agree(inexact);
}

#[test]
fn sparse_equations_have_the_entries_of_full_ones() {
    let mut problem = sizes::problem(Size { spaces: 3, robots: 2, cameras: 2, plates: 3, stops: 6, ..SMALL }, true);
    let tree = FrameTree::new(&problem.layout);
    let mut linearise = |solver: SolverChoice| {
        problem.layout.solve.solver = solver;
        let plan = Plan::new(&problem.layout, &tree, &problem.recording).unwrap();
        let state = sizes::wrong_start(&problem, &tree, &plan);
        let mut normal = Normal::default();
        let mut assembler = Assembler::new(&problem.layout, &problem.recording, &plan, Priors::default());
        assembler.linearise(&state, &mut normal);
        normal
    };
    let (dense, sparse) = (linearise(SolverChoice::Dense), linearise(SolverChoice::Sparse));
    assert_eq!((dense.cost, &dense.gradient), (sparse.cost, &sparse.gradient));
    assert!(sparse.hessian.len() < dense.hessian.len() / 4);
    for i in 0..dense.gradient.len() {
        for j in 0..dense.gradient.len() {
            assert_eq!(dense.entry(i, j), sparse.entry(i, j), "{i} {j}");
        }
    }
}
