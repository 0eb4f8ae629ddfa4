//! The report: one HTML file that shows whether a cell was solved well, and where not.
//!
//! Everything is in the file: the figures' numbers as JSON, the plotting library (plotly.js, out of the `plotly` crate), pictures as JPEG. It
//! opens without a network, in light and dark, on a phone, and prints. Words and tables are plain HTML made here, so that they are there before and
//! without any script; [`figures`] makes the numbers that the script `report.js` draws.
//!
//! | file | what |
//! |---|---|
//! | [`scene`] | the cell in three dimensions |
//! | [`figures`] | paths, clouds, boxes, residuals, correlations |
//! | [`tables`] | everything in words and tables |
//! | [`pictures`] | the worst pictures, with their residuals |
//! | [`page`] | the file around all of it |

mod carried;
mod figures;
mod markup;
mod page;
mod pictures;
mod scene;
mod tables;

use std::path::Path;
use std::time::Instant;

use crate::complaint::InputError;
use crate::export::solution::document;
use crate::layout::read_layout;
use crate::recording::{Recording, atomic};
use crate::workflow::solve::{SolveRequest, Solved, solve};

/// What a report is made from.
#[derive(Debug)]
pub struct ReportInput<'a> {
    /// The solved cell.
    pub solved: &'a Solved,
    /// The recording that it was solved from.
    pub recording: &'a Recording,
    /// The section `solution` of the solution file, in the fixed units of reports.
    pub findings: serde_json::Value,
    /// Whether the cell was solved just now, so that times and correlations are known; else only the solution was read and evaluated.
    pub fresh: bool,
}

/// The report of a cell that has just been solved, as HTML.
///
/// # Errors
/// Faults of the recording, which is read again unless it does not fit into memory.
pub fn report_solved(solved: &Solved, request: &SolveRequest) -> Result<String, InputError> {
    let read;
    let recording = match &solved.streamed {
        Some(streamed) => &streamed.recording,
        None => {
            read = Recording::read(&solved.layout, request.detections.as_deref())?;
            &read
        }
    };
    let whole = serde_json::to_value(document(solved, Path::new("."))).unwrap_or_default();
    let findings = whole.get("solution").cloned().unwrap_or_default();
    Ok(page::page(&ReportInput { solved, recording, findings, fresh: true }))
}

/// The report of a solution file: the recording is read and everything is evaluated at the poses found.
///
/// # Errors
/// Faults of the solution or of its recording; a layout that is no solution.
pub fn report_file(file: &Path, recording: Option<&Path>) -> Result<String, InputError> {
    let layout = read_layout(file, recording)?;
    let findings = carried::findings(file)?;
    let began = Instant::now();
    let recording = Recording::read(&layout, None)?;
    // Nothing is unknown in a solution but what moves by itself: to solve it is to evaluate it.
    let solved = crate::workflow::solve::solve_recording(layout, &recording, &[], Vec::new(), began)?;
    Ok(page::page(&ReportInput { solved: &solved, recording: &recording, findings, fresh: false }))
}

/// Solves a layout and makes its report.
///
/// # Errors
/// As [`solve`].
pub fn solve_and_report(file: &Path, request: &SolveRequest) -> Result<(Solved, String), InputError> {
    let solved = solve(read_layout(file, None)?, request)?;
    let html = report_solved(&solved, request)?;
    Ok((solved, html))
}

/// Writes a report, whole or not at all.
///
/// # Errors
/// When the file cannot be written.
pub fn write(path: &Path, html: &str) -> std::io::Result<()> {
    atomic::write(path, |out| out.write_all(html.as_bytes()))
}
