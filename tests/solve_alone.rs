//! A small problem is solved by the thread that asks: no other is started, which would take longer than the search and memory of its own.

#[path = "../benches/support/problem_file.rs"]
mod problem_file;
#[path = "../benches/support/sizes.rs"]
mod sizes;

use cellmap::frames::FrameTree;
use cellmap::solve::{Assembler, Options, Plan, Priors, minimise};
use sizes::{Board, Size};

/// The threads of this process; none where the system does not say.
fn threads() -> Option<usize> {
    Some(std::fs::read_dir("/proc/self/task").ok()?.count())
}

#[test]
fn a_small_problem_starts_no_thread_and_comes_back_from_its_file() {
    let at_first = threads();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("problem");
    // Making the recording is shared among threads: of a pool of its own, that is gone afterwards.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    let made = pool.install(|| {
        let size = Size { spaces: 1, robots: 2, cameras: 3, stops: 120, shots: 1, board: Board::Small, plates: 0 };
        let problem = sizes::problem(size, true);
        let tree = FrameTree::new(&problem.layout);
        let plan = Plan::new(&problem.layout, &tree, &problem.recording).unwrap();
        let start = sizes::wrong_start(&problem, &tree, &plan);
        problem_file::write(std::fs::File::create(&file).unwrap(), &problem.text, &problem.recording, &start).unwrap();
        (problem.recording, start)
    });
    drop(pool);
    let given = problem_file::read(&file).unwrap();
    assert!(given.recording == made.0 && given.start == made.1);
    let tree = FrameTree::new(&given.layout);
    let plan = Plan::new(&given.layout, &tree, &given.recording).unwrap();
    assert!((5_000..16_384).contains(&plan.measurements.corner_count()), "{}", plan.measurements.corner_count());
    let mut state = given.start.clone();
    let mut assembler = Assembler::new(&given.layout, &given.recording, &plan, Priors::default());
    let report = minimise(&mut assembler, &tree, &mut state, &Options::default());
    assert!(report.termination.converged(), "{report:?}");
    // Threads of the pool above may still be ending.
    let ended = (0..200).any(|_| {
        std::thread::sleep(std::time::Duration::from_millis(10));
        threads() <= at_first
    });
    assert!(ended, "{at_first:?} threads have become {:?}", threads());
}
