//! A cell built, simulated and solved through the library alone: no file is read or written.
//!
//! `cargo run --release --example solve_in_memory`

use std::path::Path;
use std::time::Instant;

use cellmap::layout::parse_layout;
use cellmap::recording::{Recording, RobotMotion};
use cellmap::simulate::{Cell, CornerNoise, corners, demo};
use cellmap::workflow::solve::solve_recording;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // The truth: a layout whose poses are all given, and a path for its robot.
    let truth = parse_layout(Path::new("truth.yaml"), demo::TRUTH, None)?;
    let mut recording = Recording { motions: vec![RobotMotion::Joints(demo::path(&truth, 1))], ..Recording::default() };
    let stops = recording.motions[0].configurations();

    // What its cameras would report, with a twentieth of a pixel of noise.
    let seen = corners(&Cell::new(&truth, &recording), &stops, CornerNoise { pixel_sigma: 0.05, seed: 1 });
    recording.corners = seen;

    // The same cell with its poses hidden, solved without a guess.
    let layout = parse_layout(Path::new("layout.yaml"), &demo::hidden_layout(), None)?;
    let solved = solve_recording(layout, &recording, &[], Vec::new(), Instant::now())?;
    println!("{}", solved.report.termination.words());
    for frame in ["left", "right", "ur5e.base", "pallet"] {
        if let Some(pose) = solved.world_from(frame) {
            let t = pose.translation * 1e3;
            println!("world_from_{frame}: {:8.2} {:8.2} {:8.2} mm", t.x, t.y, t.z);
        }
    }
    Ok(())
}
