//! Reads a problem, solves it and says how long that took and how much memory.
//!
//! `cargo run --release --example solver_peer -- FILE.cellmap POSES`, of a file that `solver_problem` wrote. That one makes the problem, in a process of its own: here is
//! nothing but what solving needs. `benches/peers/ceres/run.py` runs both, and the other side.

#[path = "../benches/support/problem_file.rs"]
mod problem_file;
#[path = "../benches/support/processor.rs"]
mod processor;

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::time::Instant;

use cellmap::frames::FrameTree;
use cellmap::solve::{Assembler, Options, Plan, Priors, State, minimise};
use processor::processor_seconds;

/// Seconds over which the processor's time is counted, at least.
const COUNTED: f64 = 0.2;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [file, found] = arguments.as_slice() else { return Err("FILE.cellmap POSES".into()) };
    let given = problem_file::read(Path::new(file))?;
    let tree = FrameTree::new(&given.layout);
    let plan = Plan::new(&given.layout, &tree, &given.recording)?;
    let (clock, processor) = (Instant::now(), processor_seconds());
    let solve = || {
        let mut state = given.start.clone();
        let mut assembler = Assembler::new(&given.layout, &given.recording, &plan, Priors::default());
        let report = minimise(&mut assembler, &tree, &mut state, &Options::default());
        (state, report)
    };
    let (state, report) = solve();
    let seconds = clock.elapsed().as_secs_f64();
    // All that the process ever held, reading included.
    let status = std::fs::read_to_string("/proc/self/status")?;
    let megabytes = |what: &str| {
        let kilobytes = |line: &str| line.strip_prefix(what)?.trim().strip_suffix(" kB")?.parse::<f64>().ok();
        status.lines().find_map(kilobytes).map_or(0.0, |kilobytes| kilobytes / 1024.0)
    };
    let (peak, mapped) = (megabytes("VmHWM:"), megabytes("RssFile:"));
    // The system counts a thread's time in ticks of milliseconds: a shorter solve is repeated until many have passed.
    let mut solves = 1.0;
    while clock.elapsed().as_secs_f64() < COUNTED {
        solve();
        solves += 1.0;
    }
    let processor = (processor_seconds() - processor) / solves;
    println!(
        "{{\"who\": \"cellmap\", \"seconds\": {seconds}, \"processor_seconds\": {processor}, \"iterations\": {}, \"cost\": {:e}, \"peak_mb\": {peak}, \"own_mb\": {}, \"corners\": {}, \"words\": \"{}\"}}",
        report.iterations,
        report.final_cost,
        peak - mapped,
        plan.measurements.corner_count(),
        report.termination.words()
    );
    poses(BufWriter::new(File::create(found)?), &state)?;
    Ok(())
}

/// All poses, static edges first, then moving ones configuration by configuration.
fn poses(mut out: impl Write, state: &State) -> std::io::Result<()> {
    state
        .static_poses
        .iter()
        .chain(state.moving_poses.iter().flatten())
        .try_for_each(|p| problem_file::pose(&mut out, p))?;
    out.flush()
}
