//! `cellmap report`.

use clap::Args;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use super::LayoutArguments;
use super::output::{print_json, say, shown};
use cellmap::complaint::{Complaint, InputError};
use cellmap::export::Document;
use cellmap::report::{report_file, write};

#[derive(Args, Debug)]
#[command(after_help = "Example:\n  cellmap report solution.yaml --out report.html\n\
    `cellmap solve LAYOUT --report FILE` makes the same with correlations and times.")]
pub(super) struct Report {
    #[command(flatten)]
    pub(super) common: LayoutArguments,
    /// Where the report goes [default: report.html in the recording]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

impl Report {
    pub(super) fn run(self) -> Result<ExitCode, InputError> {
        let html = report_file(&self.common.layout, self.common.recording.as_deref())?;
        let beside = self.common.layout.parent().unwrap_or(Path::new(""));
        let folder = self.common.recording.as_deref().unwrap_or(beside);
        let out = self.out.unwrap_or_else(|| folder.join("report.html"));
        put(&out, &html)?;
        if self.common.json {
            let bytes = Document::Whole(html.len() as u64);
            print_json(&Document::map([("file", Document::text(out.display().to_string())), ("bytes", bytes)]));
        } else {
            say!("wrote {}: open it in a browser", shown(&out));
        }
        Ok(ExitCode::SUCCESS)
    }
}

/// Writes a report or complains.
pub(super) fn put(out: &Path, html: &str) -> Result<(), InputError> {
    write(out, html).map_err(|e| {
        Complaint::of(out, format!("the file cannot be written: {e}"), "say where else the report goes").into()
    })
}
