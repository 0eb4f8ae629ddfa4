//! `demo`: the paper's simulation B from pictures to numbers, as a user would do it with a real cell.

use std::path::Path;
use std::time::Instant;

use super::compare::{Comparison, compare};
use super::detect::{Detected, Watch, detect};
use super::published::published;
use super::simulate::{Made, SimulateRequest, make, prepare};
use super::solve::{SolveRequest, Solved, solve};
use crate::complaint::{Complaint, InputError};
use crate::detect::Detector;
use crate::layout::{Layout, read_layout};
use crate::recording::{DEFAULT_DETECTIONS, Recording};

/// The cell, with the files that it names.
const FILES: [(&str, &str); 3] = [
    ("paper_simulation_b.yaml", include_str!("../../layouts/paper_simulation_b.yaml")),
    ("gridboard_base.yaml", include_str!("../../layouts/gridboard_base.yaml")),
    ("gridboard_tool.yaml", include_str!("../../layouts/gridboard_tool.yaml")),
];
/// The seed of the demo's path and noise.
const SEED: u64 = 2020;

/// What the demo is to do.
#[derive(Clone, Copy, Debug)]
pub struct DemoRequest<'a> {
    /// Where its files go.
    pub folder: &'a Path,
    /// Replace an earlier demo there.
    pub force: bool,
    /// In the place of 250.
    pub configurations: Option<u64>,
}

/// How far a method's answer is from the truth: the largest of three components each, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Errors {
    /// Of the base's origin.
    pub base: f64,
    /// Of the tool.
    pub tool: f64,
}

/// The errors that the paper reports of its simulation B (Table 3), m.
pub const PAPER: Errors = Errors { base: 2.59e-3, tool: 1.22e-3 };

/// What the demo did.
#[derive(Debug)]
pub struct Demonstrated {
    /// What was rendered.
    pub made: Made,
    /// Seconds of rendering.
    pub rendering: f64,
    /// How detection went.
    pub detected: Detected,
    /// The published method on the same pictures.
    pub published: Option<Errors>,
    /// The joint solve.
    pub joint: Errors,
    /// The solved cell.
    pub solved: Solved,
    /// Against the truth.
    pub comparison: Comparison,
}

/// Renders the demo's recording, detects, solves, and compares with the truth. `write_solution` puts the solution where it is told, so that
/// this folder need not know how a solution is written. `None` if the caller stopped it.
///
/// # Errors
/// When the folder cannot be written to or is in use; otherwise only if something is broken.
pub fn demonstrate(
    request: &DemoRequest<'_>,
    detector: &dyn Detector,
    write_solution: &dyn Fn(&Path, &Solved) -> std::io::Result<()>,
    rendering: &Watch<'_>,
    detecting: &Watch<'_>,
) -> Result<Option<Demonstrated>, InputError> {
    let folder = request.folder;
    let failed = |error: std::io::Error| {
        Complaint::of(folder, format!("the folder cannot be written to: {error}"), "say where else with `--out DIR`")
    };
    let source = tempfile::tempdir().map_err(failed)?;
    for (name, text) in FILES {
        std::fs::write(source.path().join(name), text).map_err(failed)?;
    }
    let cell = read_layout(&source.path().join(FILES[0].0), None)?;
    let began = Instant::now();
    let prepared = prepare(
        cell,
        SimulateRequest {
            out: folder.to_owned(),
            seed: SEED,
            pictures: true,
            force: request.force,
            noise: 1.0,
            configurations: request.configurations,
            shots: None,
        },
    )?;
    let made = make(&prepared, rendering)?;
    if made.interrupted {
        return Ok(None);
    }
    let seconds = began.elapsed().as_secs_f64();
    let layout_file = folder.join(super::simulate::LAYOUT);
    let layout = read_layout(&layout_file, None)?;
    let truth = read_layout(&folder.join(super::simulate::TRUTH), None)?;
    let detected = detect(&layout, detector, &folder.join(DEFAULT_DETECTIONS), detecting)?;
    if detected.interrupted {
        return Ok(None);
    }
    let recording = Recording::read(&layout, None)?;
    let by_paper = published(&layout, &recording, 0, 0, 1).map(|found| errors(&truth, found.origin, found.tool));
    let solved = solve(layout, &SolveRequest::default())?;
    let out = folder.join("solution.yaml");
    write_solution(&out, &solved).map_err(failed)?;
    let solution = read_layout(&out, None)?;
    let place = |pose: Option<crate::geometry::Pose>| pose.map(|pose| pose.translation).unwrap_or_default();
    let joint = errors(&truth, place(solution.robots[0].pose.pose()), place(solution.targets[1].pose.pose()));
    let comparison = compare(&solution, &truth)?;
    Ok(Some(Demonstrated {
        made,
        rendering: seconds,
        detected,
        published: by_paper.flatten(),
        joint: joint.unwrap_or(Errors { base: f64::NAN, tool: f64::NAN }),
        solved,
        comparison,
    }))
}

/// The largest component of what base and tool are off by; `None` if the truth does not give them.
fn errors(truth: &Layout, base: nalgebra::Vector3<f64>, tool: nalgebra::Vector3<f64>) -> Option<Errors> {
    let true_base = truth.robots.first()?.pose.pose()?.translation;
    let true_tool = truth.targets.get(1)?.pose.pose()?.translation;
    Some(Errors { base: (base - true_base).abs().max(), tool: (tool - true_tool).abs().max() })
}
