//! Cells searched from many wrong starts, with a first search on a part of the measurements and without: how many end in the same minimum, and what that takes.
//!
//! `cargo run --release --example thinned_start -- [STARTS]` (20 of each kind unless something else is said)

#[path = "../benches/support/sizes.rs"]
mod sizes;

use cellmap::frames::{FrameTree, Freedom};
use cellmap::geometry::Pose;
use cellmap::geometry::pose::Twist;
use cellmap::layout::LinkParameters;
use cellmap::robot::ParameterKind;
use cellmap::solve::{Assembler, Loss, Options, Plan, Priors, Report, State, minimise};
use nalgebra::Vector3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use sizes::{Board, Problem, Size};

const ONE: Size = Size { spaces: 1, robots: 1, cameras: 3, stops: 300, shots: 1, board: Board::Small, plates: 0 };
/// Corners of the part: few, so that as much as possible depends on where they lead.
const PART: usize = 3000;
/// How far off: m and degrees.
const OFF: [(f64, f64); 2] = [(0.05, 3.0), (0.3, 20.0)];

/// Every pose that is to be found, moved in a random direction.
fn displaced(tree: &FrameTree, state: &State, (metres, degrees): (f64, f64), seed: u64) -> State {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut direction = || Vector3::from_fn(|_, _| random.random_range(-1.0..1.0_f64)).normalize();
    let mut wrong = state.clone();
    for (pose, edge) in wrong.static_poses.iter_mut().zip(&tree.static_edges) {
        if edge.freedom == Freedom::Pose {
            let truth = edge.spec.pose().unwrap_or_default();
            let (t, r) = (metres * direction(), degrees.to_radians() * direction());
            *pose = truth * Pose::exp(&Twist::new(t.x, t.y, t.z, r.x, r.y, r.z));
        }
    }
    wrong
}

/// The kinds of cells by name.
fn problems() -> [(&'static str, Problem); 6] {
    let with = |mut problem: Problem, change: &dyn Fn(&mut Problem)| {
        change(&mut problem);
        problem
    };
    let one = || sizes::problem(ONE, false);
    [
        ("one robot", one()),
        ("with lenses", sizes::problem(ONE, true)),
        ("three robots in turn", sizes::problem(Size { robots: 3, cameras: 6, stops: 600, ..ONE }, false)),
        (
            "with link parameters",
            with(one(), &|problem| {
                let kinds = [ParameterKind::JointOffset, ParameterKind::LengthD, ParameterKind::LengthA];
                let links = kinds.map(|kind| LinkParameters { kind, sigma: Some(0.3) }).to_vec();
                problem.layout.robots[0].identify = links;
            }),
        ),
        ("inexact stops", with(one(), &|problem| problem.layout.robots[0].repeatability = Some([1e-4, 5e-4]))),
        (
            "one corner of ten 30 px off",
            with(one(), &|problem| {
                problem.recording.corners.edit(|rows| {
                    for (i, row) in rows.iter_mut().enumerate().filter(|(i, _)| i % 10 == 0) {
                        let i = i as f64;
                        row.pixel = [row.pixel[0] + 30.0 * i.sin(), row.pixel[1] + 30.0 * (1.3 * i).cos()];
                    }
                });
            }),
        ),
    ]
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let starts: u64 = std::env::args().nth(1).map_or(Ok(20), |text| text.parse())?;
    println!(
        "| cell | loss | off by | same cost | lower without a part | with | converged without | with | linearisations without | with |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    for (name, problem) in problems() {
        let tree = FrameTree::new(&problem.layout);
        let plan = Plan::new(&problem.layout, &tree, &problem.recording)?;
        let mut truth = sizes::wrong_start(&problem, &tree, &plan);
        truth.corrections = problem.layout.robots.iter().map(|robot| vec![0.0; 4 * robot.frames().len()]).collect();
        let priors = Priors::new(&tree, &plan.unknowns);
        for (words, loss) in [("least squares", Loss::Squared), ("Huber", Loss::Huber(1.5))] {
            for off in OFF {
                let both = |seed: u64| {
                    let start = displaced(&tree, &truth, off, seed);
                    [None, Some(PART)].map(|thinned| {
                        let mut assembler = Assembler::new(&problem.layout, &problem.recording, &plan, priors.clone());
                        assembler.set_loss(loss);
                        minimise(&mut assembler, &tree, &mut start.clone(), &Options { thinned, ..Options::default() })
                    })
                };
                let all: Vec<[Report; 2]> = (0..starts).into_par_iter().map(both).collect();
                let count = |of: &dyn Fn(&Report, &Report) -> bool| all.iter().filter(|[a, b]| of(a, b)).count();
                let mean =
                    |which: usize| all.iter().map(|pair| pair[which].iterations as f64).sum::<f64>() / starts as f64;
                let lower = |a: &Report, b: &Report| a.final_cost < b.final_cost * (1.0 - 1e-6);
                println!(
                    "| {name} | {words} | {} mm, {} deg | {} | {} | {} | {} | {} | {:.1} | {:.1} |",
                    1e3 * off.0,
                    off.1,
                    count(&|a, b| !lower(a, b) && !lower(b, a)),
                    count(&lower),
                    count(&|a, b| lower(b, a)),
                    count(&|a, _| a.termination.converged()),
                    count(&|_, b| b.termination.converged()),
                    mean(0),
                    mean(1)
                );
            }
        }
    }
    Ok(())
}
