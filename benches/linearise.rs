//! Linearisation, trial cost and the whole solve for the paper's size: one robot, three cameras, 250 configurations x 10 shots x 40 corners.

use criterion::{Criterion, criterion_group, criterion_main};
use std::hint::black_box;
use std::path::Path;

use cellmap::frames::FrameTree;
use cellmap::initialise::initialise;
use cellmap::layout::{Layout, parse_layout};
use cellmap::recording::Recording;
use cellmap::simulate::paper_size;
use cellmap::solve::{Assembler, Normal, Options, Plan, Priors, minimise};

fn layout(refine: bool) -> (Layout, Recording) {
    let truth = parse_layout(Path::new("truth.yaml"), &paper_size::truth(), None).expect("the layout is fine");
    let hidden = parse_layout(Path::new("layout.yaml"), &paper_size::hidden(refine), None).expect("the layout is fine");
    (hidden, paper_size::record(&truth, 250, 10, 0.1))
}

fn bench(criterion: &mut Criterion) {
    for (name, refine) in [("fixed lens", false), ("free lens", true)] {
        let (layout, recording) = layout(refine);
        let tree = FrameTree::new(&layout);
        let mut plan = Plan::new(&layout, &tree, &recording).expect("every configuration is recorded");
        let start = initialise(&layout, &tree, &recording, &mut plan, &[]).expect("a start is found").state;
        let corners = plan.measurements.corner_pixels.len();
        let priors = Priors::new(&tree, &plan.unknowns);
        let mut assembler = Assembler::new(&layout, &recording, &plan, priors);
        let mut normal = Normal::default();
        let mut group = criterion.benchmark_group(format!("{corners} corners, {name}"));
        group.sample_size(20);
        group.bench_function("linearise", |b| b.iter(|| black_box(assembler.linearise(&start, &mut normal))));
        group.bench_function("trial cost", |b| b.iter(|| black_box(assembler.cost(&start))));
        group.bench_function("whole minimisation", |b| {
            b.iter(|| {
                let mut state = start.clone();
                black_box(minimise(&mut assembler, &tree, &mut state, &Options::default()))
            });
        });
        group.finish();
    }
}

criterion_group!(benches, bench);
criterion_main!(benches);
