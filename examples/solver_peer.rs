//! One problem for two solvers: writes it to a file for another program, or solves it and says how long that took.
//!
//! `cargo run --release --example solver_peer -- write SIZE fixed|free FILE`, `... -- solve SIZE fixed|free POSES`. Sizes: small, paper, single, cell,
//! moving, hall, floor. `benches/peers/ceres/run.py` runs both sides.

#[path = "../benches/support/sizes.rs"]
mod sizes;

use std::io::Write;
use std::time::Instant;

use cellmap::frames::{FrameTree, Step};
use cellmap::geometry::Pose;
use cellmap::layout::Layout;
use cellmap::recording::Recording;
use cellmap::solve::{Assembler, GroupKind, Options, Plan, Priors, State, minimise};

/// Seconds over which the processor's time is counted, at least.
const COUNTED: f64 = 0.2;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [what, name, lens, file] = arguments.as_slice() else { return Err("write|solve SIZE fixed|free FILE".into()) };
    let size = sizes::size(name).ok_or("no such size")?;
    let problem = sizes::problem(size, lens == "free");
    let tree = FrameTree::new(&problem.layout);
    let plan = Plan::new(&problem.layout, &tree, &problem.recording)?;
    let start = sizes::wrong_start(&problem, &tree, &plan);
    let out = std::io::BufWriter::new(std::fs::File::create(file)?);
    if what == "write" {
        write(out, &problem.layout, &problem.recording, &plan, &start, lens == "free")?;
        return Ok(());
    }
    std::fs::write("/proc/self/clear_refs", "5").ok();
    let (clock, processor) = (Instant::now(), processor_seconds());
    let solve = || {
        let mut state = start.clone();
        let mut assembler = Assembler::new(&problem.layout, &problem.recording, &plan, Priors::default());
        let report = minimise(&mut assembler, &tree, &mut state, &Options::default());
        (state, report)
    };
    let (state, report) = solve();
    let seconds = clock.elapsed().as_secs_f64();
    let peak = std::fs::read_to_string("/proc/self/status")?
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:")?.trim().strip_suffix(" kB")?.parse::<f64>().ok());
    // The system counts a thread's time in ticks of milliseconds: a shorter solve is repeated until many have passed.
    let mut solves = 1.0;
    while clock.elapsed().as_secs_f64() < COUNTED {
        solve();
        solves += 1.0;
    }
    let processor = (processor_seconds() - processor) / solves;
    println!(
        "{{\"who\": \"cellmap\", \"seconds\": {seconds}, \"processor_seconds\": {processor}, \"iterations\": {}, \"cost\": {:e}, \"peak_mb\": {}, \"corners\": {}, \"words\": \"{}\"}}",
        report.iterations,
        report.final_cost,
        peak.unwrap_or(0.0) / 1024.0,
        plan.measurements.corner_count(),
        report.termination.words()
    );
    poses(out, &state)?;
    Ok(())
}

/// Time that all threads have spent on a processor; nothing where the system does not say.
fn processor_seconds() -> f64 {
    let threads = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    let spent = threads.filter_map(|thread| {
        let text = std::fs::read_to_string(thread.path().join("schedstat")).ok()?;
        text.split_whitespace().next()?.parse::<f64>().ok()
    });
    spent.sum::<f64>() * 1e-9
}

fn numbers(out: &mut impl Write, values: &[f64]) -> std::io::Result<()> {
    values.iter().try_for_each(|value| out.write_all(&value.to_le_bytes()))
}

fn pose(out: &mut impl Write, pose: &Pose) -> std::io::Result<()> {
    let (q, t) = (pose.rotation.coords, pose.translation);
    numbers(out, &[q.x, q.y, q.z, q.w, t.x, t.y, t.z])
}

/// All poses, static edges first, then moving ones configuration by configuration.
fn poses(mut out: impl Write, state: &State) -> std::io::Result<()> {
    state.static_poses.iter().chain(state.moving_poses.iter().flatten()).try_for_each(|p| pose(&mut out, p))?;
    out.flush()
}

/// The problem in little-endian doubles: counts, poses, lenses, then for each block its camera, its chain and its corners. A chain is a known pose, then for
/// each unknown its number, whether it is inverted, and the known pose after it.
fn write(
    mut out: impl Write,
    layout: &Layout,
    recording: &Recording,
    plan: &Plan,
    state: &State,
    free: bool,
) -> Result<(), Box<dyn std::error::Error>> {
    let statics = state.static_poses.len();
    let count = statics + state.moving_poses.iter().map(Vec::len).sum::<usize>();
    let blocks: usize = plan.groups.iter().map(|group| group.blocks.len()).sum();
    let header = [count as f64, layout.cameras.len() as f64, blocks as f64, f64::from(u8::from(free))];
    numbers(&mut out, &header)?;
    state.static_poses.iter().chain(state.moving_poses.iter().flatten()).try_for_each(|p| pose(&mut out, p))?;
    state.lenses.iter().try_for_each(|lens| numbers(&mut out, &lens[..9]))?;
    for group in &plan.groups {
        let GroupKind::Corners { camera } = group.kind else { return Err("only corners can be written".into()) };
        for block in &group.blocks {
            let mut known = vec![Pose::identity()];
            let mut unknown = Vec::new();
            for step in &group.path.steps {
                let (value, number, inverse) = match *step {
                    Step::Static { edge, inverse } => {
                        (state.static_poses[edge], plan.unknowns.edge(edge).map(|_| edge), inverse)
                    }
                    Step::Moving { edge, inverse } => {
                        let number = statics + edge * plan.configurations.len() + block.configuration;
                        (state.moving_poses[edge][block.configuration], Some(number), inverse)
                    }
                    Step::Robot { robot, from, to, inverse } => {
                        let id = plan.configurations[block.configuration];
                        (recording.robot_segment(layout, robot, id, from, to).ok_or("not recorded")?, None, inverse)
                    }
                };
                if let Some(number) = number {
                    unknown.push([number as f64, f64::from(u8::from(inverse))]);
                    known.push(Pose::identity());
                } else if let Some(last) = known.last_mut() {
                    *last = *last * if inverse { value.inverse() } else { value };
                }
            }
            numbers(&mut out, &[camera as f64, unknown.len() as f64, (block.end - block.start) as f64])?;
            pose(&mut out, &known[0])?;
            for (which, after) in unknown.iter().zip(&known[1..]) {
                numbers(&mut out, which)?;
                pose(&mut out, after)?;
            }
            let m = &plan.measurements;
            for i in block.start..block.end {
                numbers(&mut out, &m.place(i))?;
                numbers(&mut out, &m.pixel(i))?;
                // No covariances: the whitener is one number times the identity.
                numbers(&mut out, &m.whitener(i)[..1])?;
            }
        }
    }
    out.flush()?;
    Ok(())
}
