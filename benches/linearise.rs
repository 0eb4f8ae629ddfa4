//! Linearisation, trial cost, the closed-form start and the whole solve for the paper's size: one robot, three cameras, 7500 pictures of 40 corners.
//! Once as the paper took them (250 configurations, ten shots each), once with every picture at a configuration of its own.

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use std::hint::black_box;
use std::path::Path;

use cellmap::frames::{FrameTree, Freedom};
use cellmap::geometry::Pose;
use cellmap::geometry::pose::Twist;
use cellmap::initialise::initialise;
use cellmap::layout::{Layout, parse_layout};
use cellmap::recording::Recording;
use cellmap::simulate::paper_size;
use cellmap::solve::{Assembler, Loss, Normal, Options, Plan, Priors, State, minimise};

fn cell(refine: bool, configurations: u64, shots: u64) -> (Layout, Recording) {
    let truth = parse_layout(Path::new("truth.yaml"), &paper_size::truth(), None).expect("the layout is fine");
    let hidden = parse_layout(Path::new("layout.yaml"), &paper_size::hidden(refine), None).expect("the layout is fine");
    (hidden, paper_size::record(&truth, configurations, shots, 0.1))
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

fn bench(criterion: &mut Criterion) {
    let cases = [
        ("fixed lens", false, 250, 10),
        ("free lens", true, 250, 10),
        ("fixed lens, one shot", false, 2500, 1),
        ("free lens, one shot", true, 2500, 1),
    ];
    for (name, refine, configurations, shots) in cases {
        let (layout, recording) = cell(refine, configurations, shots);
        let tree = FrameTree::new(&layout);
        let plan = Plan::new(&layout, &tree, &recording).expect("every configuration is recorded");
        let find = || initialise(&layout, &tree, &recording, &mut plan.clone(), &[]).expect("a start is found").state;
        let start = find();
        let wrong = displaced(&tree, &start);
        let priors = Priors::new(&tree, &plan.unknowns);
        let corners = plan.measurements.corner_pixels.len();
        let mut group = criterion.benchmark_group(format!("{corners} corners, {name}"));
        group.sample_size(20);
        group.bench_function("closed-form start", |b| b.iter(|| black_box(find())));
        for (of, loss) in [("least squares", Loss::Squared), ("Huber", Loss::Huber(1.5))] {
            let mut assembler = Assembler::new(&layout, &recording, &plan, priors.clone());
            assembler.set_loss(loss);
            let mut normal = Normal::default();
            let id = |what: &str| BenchmarkId::new(what, of);
            group.bench_function(id("linearise"), |b| b.iter(|| black_box(assembler.linearise(&start, &mut normal))));
            group.bench_function(id("trial cost"), |b| b.iter(|| black_box(assembler.cost(&start))));
            // From the plan on, as every solve does: laying out the corners is part of it.
            group.bench_function(id("whole solve, 50 mm and 3 degrees off"), |b| {
                b.iter(|| {
                    let mut assembler = Assembler::new(&layout, &recording, &plan, priors.clone());
                    assembler.set_loss(loss);
                    let mut state = wrong.clone();
                    let report = minimise(&mut assembler, &tree, &mut state, &Options::default());
                    assert!(report.termination.converged(), "{report:?}");
                    black_box(report)
                });
            });
            let mut state = wrong.clone();
            let report = minimise(&mut assembler, &tree, &mut state, &Options::default());
            let s = report.seconds;
            println!(
                "{name}, {of}: {} linearisations, {} costs, {:.1} ms linearising, {:.1} factorising, {:.1} evaluating",
                report.iterations,
                report.costs.len(),
                s.linearise * 1e3,
                s.factorise * 1e3,
                s.evaluate * 1e3
            );
        }
        group.finish();
    }
}

criterion_group!(benches, bench);
criterion_main!(benches);
