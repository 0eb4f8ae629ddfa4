//! `cellmap demo`.

use clap::Args;
use std::path::PathBuf;
use std::process::ExitCode;

use super::NOT_TRUSTWORTHY;
use super::output::{print_json, progress_bar, say};
use cellmap::complaint::InputError;
use cellmap::export::{Document, solution};
use cellmap::workflow::demo::{Demonstrated, demonstrate};
use cellmap::workflow::detect::Watch;

#[derive(Args, Debug)]
pub(super) struct Demo {
    /// Where the demo's files go
    #[arg(long, value_name = "DIR", default_value = "cellmap-demo")]
    out: PathBuf,
    /// Print one machine-readable object on stdout and nothing else
    #[arg(long)]
    pub(super) json: bool,
}

impl Demo {
    pub(super) fn run(self) -> Result<ExitCode, InputError> {
        let detector = super::detect::Finder::default().make(&self.out)?;
        let drawing = progress_bar("rendering");
        let detecting = progress_bar("detecting");
        let move_to = |bar: &indicatif::ProgressBar, done: usize, all: usize| {
            bar.set_length(all as u64);
            bar.set_position(done as u64);
        };
        let rendered = |done: usize, all: usize| move_to(&drawing, done, all);
        let detected = |done: usize, all: usize| move_to(&detecting, done, all);
        // A demo that is interrupted simply ends: every file in its folder is whole.
        let never = std::sync::atomic::AtomicBool::new(false);
        let watch = Watch { progress: &detected, stop: &never, draw: None };
        if !self.json {
            say!("A made-up cell: a robot with a cube of tags, a tagged table, a pallet,");
            say!("two cameras on tripods and one on the wrist. Rendering its pictures,");
            say!("then forgetting where everything is and finding it again...");
        }
        let shown = demonstrate(&self.out, detector.as_ref(), &solution::write, &rendered, &watch)?;
        drawing.finish_and_clear();
        detecting.finish_and_clear();
        if self.json {
            print_json(&as_json(&shown))
        } else {
            show(&shown, &self.out)
        }
        Ok(if shown.solved.trustworthy() { ExitCode::SUCCESS } else { ExitCode::from(NOT_TRUSTWORTHY) })
    }
}

fn as_json(shown: &Demonstrated) -> Document {
    Document::map([
        ("pictures", Document::Whole(shown.pictures as u64)),
        ("corners", Document::Whole(shown.detected.corners as u64)),
        ("rendering_seconds", Document::Number(shown.rendering)),
        ("detecting_seconds", Document::Number(shown.detected.seconds)),
        ("solving_seconds", Document::Number(shown.solved.seconds.total)),
        ("rms_px", shown.solved.residuals.rms_px().map_or(Document::Null, Document::Number)),
        ("worst_translation_mm", Document::Number(shown.comparison.worst_translation() * 1e3)),
        ("worst_rotation_deg", Document::Number(shown.comparison.worst_rotation().to_degrees())),
    ])
}

fn show(shown: &Demonstrated, out: &std::path::Path) {
    let (d, s) = (&shown.detected, &shown.solved);
    say!("");
    say!(
        "rendered {} pictures in {:.1} s, found {} corners in {:.1} s,\nsolved {} unknowns in {:.3} s",
        shown.pictures,
        shown.rendering,
        d.corners,
        d.seconds,
        s.unknowns,
        s.seconds.total
    );
    if let Some(rms) = s.residuals.rms_px() {
        say!("residual {rms:.3} px; every pose against the truth:");
    }
    super::compare::show(&shown.comparison);
    say!("");
    say!("Files are in {}/: layout.yaml (what was known), truth.yaml,", out.display());
    say!("images/, detections.csv, solution.yaml. What next:");
    say!("  cellmap check {}/layout.yaml", out.display());
}
