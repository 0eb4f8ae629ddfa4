//! `cellmap demo`.

use clap::Args;
use std::path::PathBuf;
use std::process::ExitCode;

use super::NOT_TRUSTWORTHY;
use super::output::{print_json, print_table, progress_bar, say, stop_requested};
use cellmap::complaint::InputError;
use cellmap::export::solution;
use cellmap::layout::Document;
use cellmap::workflow::demo::{DemoRequest, Demonstrated, Errors, PAPER, demonstrate};
use cellmap::workflow::detect::Watch;

#[derive(Args, Debug)]
#[command(after_help = "Example:\n  cellmap demo                       the whole of it, about a minute\n  \
                        cellmap demo --configurations 25   a tenth of it, a few seconds")]
pub(super) struct Demo {
    /// Where the demo's files go
    #[arg(long, value_name = "DIR", default_value = "cellmap-demo")]
    out: PathBuf,
    /// Stops of the robot
    #[arg(long, value_name = "N", default_value_t = 250, value_parser = clap::value_parser!(u64).range(10..=10_000))]
    configurations: u64,
    /// Print one JSON object on stdout and nothing else
    #[arg(long)]
    pub(super) json: bool,
}

impl Demo {
    pub(super) fn run(self) -> Result<ExitCode, InputError> {
        let detector = super::detect::Finder::default().make(false, &self.out)?;
        let (drawing, detecting) = (progress_bar("rendering"), progress_bar("detecting"));
        let move_to = |bar: &indicatif::ProgressBar, done: usize, all: usize| {
            bar.set_length(all as u64);
            bar.set_position(done as u64);
        };
        let rendered = |done: usize, all: usize| move_to(&drawing, done, all);
        let detected = |done: usize, all: usize| move_to(&detecting, done, all);
        if !self.json {
            say!("The simulation B of the paper that cellmap grew out of: a UR3 carries a solid");
            say!("board of tags past one camera, {} times. Its pictures are rendered, then", self.configurations);
            say!("everything is forgotten and found again from them...");
        }
        // A demo is run again and again: what an earlier one left is replaced.
        let force = self.out.join(cellmap::workflow::simulate::TRUTH).exists();
        let request = DemoRequest { folder: &self.out, force, configurations: Some(self.configurations) };
        let stop = stop_requested();
        let shown = demonstrate(
            &request,
            detector.as_ref(),
            &solution::write,
            &Watch { progress: &rendered, stop, draw: None, predict: None, search_all: false },
            &Watch { progress: &detected, stop, draw: None, predict: None, search_all: false },
        )?;
        drawing.finish_and_clear();
        detecting.finish_and_clear();
        let Some(shown) = shown else {
            eprintln!("stopped");
            return Ok(ExitCode::from(130));
        };
        if self.json {
            print_json(&as_json(&shown));
        } else {
            show(&shown, &self.out);
        }
        Ok(if shown.solved.trustworthy() { ExitCode::SUCCESS } else { ExitCode::from(NOT_TRUSTWORTHY) })
    }
}

fn as_json(shown: &Demonstrated) -> Document {
    let errors = |errors: &Errors| {
        Document::map([
            ("base_mm", Document::Number(errors.base * 1e3)),
            ("tool_mm", Document::Number(errors.tool * 1e3)),
        ])
    };
    Document::map([
        ("pictures", Document::Whole(shown.made.pictures as u64)),
        ("corners", Document::Whole(shown.detected.corners as u64)),
        ("rendering_seconds", Document::Number(shown.rendering)),
        ("detecting_seconds", Document::Number(shown.detected.seconds)),
        ("solving_seconds", Document::Number(shown.solved.seconds.total)),
        ("rms_px", shown.solved.summary.rms_px().map_or(Document::Null, Document::Number)),
        ("paper", errors(&PAPER)),
        ("published_method", shown.published.as_ref().map_or(Document::Null, errors)),
        ("joint_solve", errors(&shown.joint)),
        ("worst_translation_mm", Document::Number(shown.comparison.worst_translation() * 1e3)),
        ("worst_rotation_deg", Document::Number(shown.comparison.worst_rotation().to_degrees())),
    ])
}

fn show(shown: &Demonstrated, out: &std::path::Path) {
    let (d, s) = (&shown.detected, &shown.solved);
    say!("");
    say!(
        "rendered {} pictures in {:.1} s, found {} corners in {:.1} s,\nsolved {} unknowns in {:.3} s",
        shown.made.pictures,
        shown.rendering,
        d.corners,
        d.seconds,
        s.unknowns,
        s.seconds.total
    );
    if let Some(rms) = s.summary.rms_px() {
        say!("residual {rms:.3} px; every pose against the truth:");
    }
    super::compare::show(&shown.comparison);
    say!("");
    let row = |name: &str, errors: Option<Errors>| {
        let cell = |value: f64| format!("{:.3}", value * 1e3);
        let cells = errors.map_or(["-".to_owned(), "-".to_owned()], |errors| [cell(errors.base), cell(errors.tool)]);
        vec![name.to_owned(), cells[0].clone(), cells[1].clone()]
    };
    let rows = [
        row("the paper, on its pictures (Table 3)", Some(PAPER)),
        row("the paper's method, on these pictures", shown.published),
        row("cellmap, on these pictures", Some(shown.joint)),
    ];
    print_table(&["largest error, mm", "base", "tool"], &rows);
    say!("");
    let out = out.display();
    say!("Files are in {out}/: layout.yaml (what was known), truth.yaml, images/,");
    say!("detections.csv, solution.yaml. What next:");
    say!("  cellmap check {out}/layout.yaml");
}
