//! What a solve of the paper's size takes: one robot, three cameras, 7500 pictures of a board of 64 corners, 480 000 corners in all.
//!
//! Once as the paper took them (250 configurations, ten shots each), once with every picture at a configuration of its own; with lenses fixed and free;
//! under plain least squares and Huber's loss; on two threads and one, in turn, so that whatever else the machine does meets both. First what two threads
//! gain here where nothing holds them up. Prints medians and the quickest as a table in Markdown. `cargo bench --bench linearise -- 30` takes 30 rounds.

use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

use cellmap::frames::{FrameTree, Freedom};
use cellmap::geometry::Pose;
use cellmap::geometry::pose::Twist;
use cellmap::initialise::initialise;
use cellmap::layout::{Layout, parse_layout};
use cellmap::recording::Recording;
use cellmap::simulate::paper_size;
use cellmap::solve::{Assembler, Loss, Normal, Options, Plan, Priors, State, minimise};
use rayon::{ThreadPool, ThreadPoolBuilder};

/// A board of 64 corners in the place of the layout's of 40.
fn large(text: &str) -> String {
    text.replace("squares: [9, 6], square: 14, marker: 10", "squares: [9, 9], square: 11, marker: 8")
}

fn cell(refine: bool, configurations: u64, shots: u64) -> (Layout, Recording) {
    let parse = |text: &str| parse_layout(Path::new("layout.yaml"), &large(text), None).expect("the layout is fine");
    let (truth, hidden) = (parse(&paper_size::truth()), parse(&paper_size::hidden(refine)));
    (hidden, paper_size::record(&truth, configurations, shots, 64, 0.1))
}

/// Every unknown pose moved by 50 mm and 3 degrees, in directions that depend on its number.
fn displaced(tree: &FrameTree, state: &State) -> State {
    let mut wrong = state.clone();
    for (i, pose) in wrong.static_poses.iter_mut().enumerate() {
        if tree.static_edges[i].freedom == Freedom::Pose {
            let direction = |phase: f64| {
                let a = i as f64 + phase;
                nalgebra::Vector3::new(a.sin(), (1.7 * a).cos(), (2.3 * a).sin()).normalize()
            };
            let (t, r) = (0.05 * direction(0.3), 3f64.to_radians() * direction(1.1));
            *pose = *pose * Pose::exp(&Twist::new(t.x, t.y, t.z, r.x, r.y, r.z));
        }
    }
    wrong
}

/// So many steps of multiplying alone, which need no memory.
fn multiply(steps: usize) -> [[f64; 8]; 8] {
    let mut numbers = [[1.0; 8]; 8];
    for step in 0..steps {
        let more = (step & 1) as f64 * 1e-3;
        numbers.iter_mut().flatten().for_each(|number| *number = *number * 0.999 + more);
    }
    numbers
}

/// Times work on both pools in turn; prints the median and the quickest in milliseconds, two threads first, and how many times quicker two are.
fn time<T>(pools: &[ThreadPool; 2], rounds: usize, of: &str, what: &str, mut work: impl FnMut() -> T + Send) {
    let mut taken = [Vec::new(), Vec::new()];
    for round in 0..=rounds {
        for (pool, taken) in pools.iter().zip(&mut taken) {
            let seconds = pool.install(|| {
                let start = Instant::now();
                black_box(work());
                start.elapsed().as_secs_f64()
            });
            // The first round makes room.
            if round > 0 {
                taken.push(seconds * 1e3);
            }
        }
    }
    taken.iter_mut().for_each(|taken| taken.sort_by(f64::total_cmp));
    let [two, one] = taken.map(|taken| (taken[taken.len() / 2], taken[0]));
    println!("| {of} | {what} | {:.2} | {:.2} | {:.2} | {:.2} | {:.2} |", two.0, one.0, two.1, one.1, one.1 / two.1);
}

fn main() {
    // Cargo adds flags of its own.
    let rounds = std::env::args().skip(1).find_map(|word| word.parse().ok()).unwrap_or(15);
    let pools = [2, 1].map(|threads| ThreadPoolBuilder::new().num_threads(threads).build().expect("threads start"));
    println!(
        "| cell | what | two threads, ms | one | quickest of two | of one | one / two |\n|---|---|---|---|---|---|---|"
    );
    // How many times quicker two threads can be while the machine does what it does.
    time(&pools, 10 * rounds, "no cell", "multiplying alone", || {
        rayon::join(|| multiply(250_000), || multiply(250_000))
    });
    let mut counts = Vec::new();
    let cases = [
        ("ten shots a stop, fixed lenses", false, 250, 10),
        ("ten shots a stop, free lenses", true, 250, 10),
        ("one shot a stop, fixed lenses", false, 2500, 1),
        ("one shot a stop, free lenses", true, 2500, 1),
    ];
    for (name, refine, configurations, shots) in cases {
        let (layout, recording) = cell(refine, configurations, shots);
        let tree = FrameTree::new(&layout);
        let plan = Plan::new(&layout, &tree, &recording).expect("every configuration is recorded");
        let find = || initialise(&layout, &tree, &recording, &mut plan.clone(), &[]).expect("a start is found").state;
        let start = find();
        let wrong = displaced(&tree, &start);
        let priors = Priors::new(&tree, &plan.unknowns);
        time(&pools, rounds, name, "closed-form start", find);
        for (of, loss) in [("least squares", Loss::Squared), ("Huber", Loss::Huber(1.5))] {
            let mut assembler = Assembler::new(&layout, &recording, &plan, priors.clone());
            assembler.set_loss(loss);
            let mut normal = Normal::default();
            let what = |what: &str| format!("{what}, {of}");
            time(&pools, 2 * rounds, name, &what("linearise"), || assembler.linearise(&start, &mut normal));
            time(&pools, 2 * rounds, name, &what("trial cost"), || assembler.cost(&start));
            for (from, begin) in [("50 mm and 3 degrees off", &wrong), ("the closed form", &start)] {
                // From the plan on, as every solve does: laying out the corners is part of it.
                let solve = || {
                    let mut assembler = Assembler::new(&layout, &recording, &plan, priors.clone());
                    assembler.set_loss(loss);
                    let mut state = begin.clone();
                    minimise(&mut assembler, &tree, &mut state, &Options::default())
                };
                time(&pools, rounds, name, &what(&format!("whole solve from {from}")), solve);
                let report = solve();
                assert!(report.termination.converged(), "{report:?}");
                counts.push(format!("| {name} | {of} | {from} | {} | {} |", report.iterations, report.costs.len() - 1));
            }
        }
        assert_eq!(plan.measurements.corner_count(), 480_000, "every camera sees the whole board");
    }
    println!("\n| cell | loss | from | linearisations | steps |\n|---|---|---|---|---|\n{}", counts.join("\n"));
}
