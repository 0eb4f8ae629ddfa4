//! One problem for two solvers, written to files.
//!
//! `cargo run --release --example solver_problem -- SIZE fixed|free FILE` writes FILE for another program and FILE.cellmap for `solver_peer`. Sizes: small, paper,
//! single, cell, moving, hall, floor. `benches/peers/ceres/run.py` runs both sides.

#[path = "../benches/support/problem_file.rs"]
mod problem_file;
#[path = "../benches/support/sizes.rs"]
mod sizes;

use std::fs::File;
use std::io::{BufWriter, Write};

use cellmap::frames::{FrameTree, Step};
use cellmap::geometry::Pose;
use cellmap::layout::Layout;
use cellmap::recording::Recording;
use cellmap::solve::{GroupKind, Plan, State};
use problem_file::{numbers, pose};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [size, lens, file] = arguments.as_slice() else { return Err("SIZE fixed|free FILE".into()) };
    let problem = sizes::problem(sizes::size(size).ok_or("no such size")?, lens == "free");
    let tree = FrameTree::new(&problem.layout);
    let plan = Plan::new(&problem.layout, &tree, &problem.recording)?;
    let start = sizes::wrong_start(&problem, &tree, &plan);
    let out = BufWriter::new(File::create(file)?);
    write(out, &problem.layout, &problem.recording, &plan, &start, lens == "free")?;
    let own = BufWriter::new(File::create(format!("{file}.cellmap"))?);
    Ok(problem_file::write(own, &problem.text, &problem.recording, &start)?)
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
