//! Where the time and the memory of a whole solve go, from a recording in memory to poses with their standard deviations and all that is looked for.
//!
//! `cargo run --release --example whole_solve -- auto|dense|sparse SIZE...` with the sizes of `benches/support/sizes.rs`, or a number of pictures of one robot and
//! three cameras.

#[path = "../benches/support/sizes.rs"]
mod sizes;

use std::time::Instant;

use cellmap::layout::SolverChoice;
use cellmap::workflow::solve::solve_recording;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (how, names) = arguments.split_first().ok_or("auto|dense|sparse SIZE...")?;
    let solver = match how.as_str() {
        "auto" => SolverChoice::Auto,
        "dense" => SolverChoice::Dense,
        "sparse" => SolverChoice::Sparse,
        _ => return Err("auto|dense|sparse SIZE...".into()),
    };
    println!(
        "| size | corners | unknowns | compile, s | start, s | search, s | covariance, s | look, s | all, s | peak memory, MB |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    for name in names {
        let size = match name.parse::<u64>() {
            Ok(pictures) => {
                let board = sizes::Board::Small;
                sizes::Size { spaces: 1, robots: 1, cameras: 3, stops: pictures / 3, shots: 1, board, plates: 0 }
            }
            Err(_) => sizes::size(name).ok_or("no such size")?,
        };
        let mut problem = sizes::problem(size, false);
        problem.layout.solve.solver = solver;
        let corners = problem.recording.corners.len();
        // The peak of the solve, not that of the recording's making.
        std::fs::write("/proc/self/clear_refs", "5")?;
        let solved = solve_recording(problem.layout, &problem.recording, &[], Vec::new(), Instant::now())?;
        let s = &solved.seconds;
        println!(
            "| {name} | {corners} | {} | {:.2} | {:.2} | {:.2} | {:.2} | {:.2} | {:.2} | {:.0} |",
            solved.unknowns,
            s.read,
            s.initialise,
            s.linearise + s.factorise + s.evaluate,
            s.covariance,
            s.diagnose,
            s.total,
            peak()?
        );
        println!("{}", solved.plan.solver().words());
        for told in solved.undetermined.iter().chain(&solved.weak).take(5) {
            println!("{}", told.reason);
        }
        println!("{} after {} linearisations", solved.report.termination.words(), solved.report.iterations);
    }
    Ok(())
}

/// The peak of this process' memory, MB.
fn peak() -> Result<f64, Box<dyn std::error::Error>> {
    let status = std::fs::read_to_string("/proc/self/status")?;
    let peak =
        status.lines().find_map(|line| line.strip_prefix("VmHWM:")?.trim().strip_suffix(" kB")?.parse::<f64>().ok());
    Ok(peak.ok_or("the system does not say how much memory is used")? * 1024.0 / 1e6)
}
