//! `demo`: makes a small recording, then does with it what a user does with a real one.

use std::path::Path;

use super::compare::{Comparison, compare};
use super::detect::{Detected, Watch, detect};
use super::solve::{SolveRequest, Solved, solve};
use crate::complaint::{Complaint, InputError};
use crate::detect::Detector;
use crate::layout::{parse_layout, read_layout};
use crate::recording::{DEFAULT_DETECTIONS, Recording, RobotMotion};
use crate::simulate::{Cell, PictureNoise, demo, plates};

/// The seed of the demo's path and noise.
const SEED: u64 = 2020;
/// What a decent industrial camera shows: slightly soft, two grey values of noise.
const NOISE: PictureNoise = PictureNoise { blur: 0.7, grey: 2.0, seed: SEED };

/// What the demo did.
#[derive(Debug)]
pub struct Demonstrated {
    /// Pictures rendered.
    pub pictures: usize,
    /// Seconds of rendering.
    pub rendering: f64,
    /// How detection went.
    pub detected: Detected,
    /// The solved cell.
    pub solved: Solved,
    /// Against the truth.
    pub comparison: Comparison,
}

/// Makes the demo's recording in `folder`, detects, solves, and compares with the truth. `write_solution` puts the solution
/// where it is told, so that this folder need not know how a solution is written.
///
/// # Errors
/// When the folder cannot be written to; otherwise only if something is broken.
pub fn demonstrate(
    folder: &Path,
    detector: &dyn Detector,
    write_solution: &dyn Fn(&Path, &Solved) -> std::io::Result<()>,
    rendered: &(dyn Fn(usize, usize) + Sync),
    watch: &Watch<'_>,
) -> Result<Demonstrated, InputError> {
    let began = std::time::Instant::now();
    let truth_file = folder.join("truth.yaml");
    let truth = parse_layout(&truth_file, demo::TRUTH, Some(folder))?;
    let stops = demo::path(&truth, SEED);
    let failed = |e: std::io::Error| {
        Complaint::of(folder, format!("the folder cannot be written to: {e}"), "say where else with `--out DIR`")
    };
    demo::write_description(folder, &truth, &stops).map_err(failed)?;
    let recording = Recording { motions: vec![RobotMotion::Joints(stops.clone())], ..Recording::default() };
    let cell = Cell::new(&truth, &recording);
    let plates = plates(&cell);
    let all = stops.len() * truth.cameras.len();
    let count = std::sync::atomic::AtomicUsize::new(0);
    let done = || rendered(count.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1, all);
    let pictures = demo::write_pictures(folder, &cell, &plates, NOISE, &done).map_err(failed)?;
    let rendering = began.elapsed().as_secs_f64();
    let layout_file = folder.join("layout.yaml");
    let layout = read_layout(&layout_file, None)?;
    let detected = detect(&layout, detector, &folder.join(DEFAULT_DETECTIONS), watch)?;
    let solved = solve(layout, &SolveRequest::default())?;
    let out = folder.join("solution.yaml");
    write_solution(&out, &solved).map_err(failed)?;
    let comparison = compare(&read_layout(&out, None)?, &truth)?;
    Ok(Demonstrated { pictures, rendering, detected, solved, comparison })
}
