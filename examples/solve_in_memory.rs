//! A cell described in the program, simulated and solved through the library alone: no file is read or written.
//!
//! `cargo run --release --example solve_in_memory`

use std::path::Path;
use std::time::Instant;

use cellmap::layout::parse_layout;
use cellmap::simulate::{paths, simulate};
use cellmap::workflow::solve::solve_recording;

/// Cameras on a ring around the table, looking at its middle, as entries of a layout.
fn cameras(count: usize) -> String {
    let entry = |i: usize| {
        let around = 360.0 * i as f64 / count as f64;
        let (x, y) = (1200.0 * around.to_radians().cos(), 1200.0 * around.to_radians().sin());
        // z forward and 35 degrees down, x to the right: a turn of -125 degrees about x, then one about the vertical.
        format!(
            "  ring{i}:\n    intrinsics: {{model: pinhole, size: [1280, 720], focal: [900, 900], centre: [639.5, 359.5]}}\n    \
             pose: {{xyz: [{x}, {y}, 950], rpy: [-125, 0, {}], unknown: true}}\n",
            around + 90.0
        )
    };
    (0..count).map(entry).collect()
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let text = format!(
        "cellmap: 1\nunits: {{length: mm, angle: deg}}\nworld: table\ncameras:\n{}robots:\n  arm: {{model: ur5e, joints: joints.csv, pose: \
         {{xyz: [0, 350, 0], rpy: [0, 0, 90], unknown: true}}}}\ntargets:\n  table: {{tags: {{dictionary: 6x6_250, grid: {{columns: 3, rows: 2, size: \
         80, gap: 20}}}}}}\n  tool: {{tags: {{dictionary: 6x6_250, cube: {{edge: 80, size: 60, ids: [20, 21, 22, 23, 24]}}}}, mount: arm.flange, pose: \
         {{xyz: [0, 0, 90], rpy: [0, 0, 0], unknown: true}}}}\nsolve: {{pixel_sigma: 0.05}}\n",
        cameras(4)
    );
    let cell = parse_layout(Path::new("cell.yaml"), &text, None)?;

    // Thirty stops at which some camera sees the tool, and what the cameras would report.
    let motions = paths::generate(&cell, 30, 1)?;
    let simulated = simulate(&cell, motions, 1, 1.0)?;

    // What a solver is told has none of the poses.
    let solved = solve_recording(simulated.told.clone(), &simulated.recording, &[], Vec::new(), Instant::now())?;
    println!("{}", solved.report.termination.words());
    for frame in ["ring0", "ring1", "ring2", "ring3", "arm.base"] {
        let tree = simulated.cell().tree;
        let truth = tree.frames.iter().position(|f| f.name == frame).and_then(|id| simulated.cell().pose(0, id, 1));
        if let (Some(found), Some(truth)) = (solved.world_from(frame), truth) {
            let (t, off) = (found.translation * 1e3, (found.translation - truth.translation).norm() * 1e3);
            println!("world_from_{frame}: {:8.2} {:8.2} {:8.2} mm, off by {off:.3} mm", t.x, t.y, t.z);
        }
    }
    Ok(())
}
