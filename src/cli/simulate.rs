//! `cellmap simulate`.

use clap::Args;
use std::path::PathBuf;
use std::process::ExitCode;

use super::output::{print_json, progress_bar, say, stop_requested};
use super::{LayoutArguments, use_threads};
use cellmap::complaint::InputError;
use cellmap::layout::Document;
use cellmap::workflow::detect::Watch;
use cellmap::workflow::simulate::{Made, SimulateRequest, make, prepare, size};

#[derive(Args, Debug)]
#[command(after_help = "Example:\n  cellmap simulate layouts/workcell.yaml --out cell --pictures\n  \
                        cellmap detect cell/layout.yaml && cellmap solve cell/layout.yaml\n  \
                        cellmap compare cell/solution.yaml cell/truth.yaml")]
pub(super) struct Simulate {
    #[command(flatten)]
    pub(super) common: LayoutArguments,
    /// The folder of the recording that is made
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// The same seed gives the same files
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Render pictures for `cellmap detect`
    #[arg(long)]
    pictures: bool,
    /// Replace an earlier simulation in the folder
    #[arg(long)]
    force: bool,
    /// Multiply all noise; 0 is exact
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = not_negative)]
    noise: f64,
    /// Stops of the robots [default: the layout's]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    configurations: Option<u64>,
    /// Pictures a camera at a stop [default: the layout's, or 1]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    shots: Option<u64>,
    /// Worker threads [default: one a core]
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
}

fn not_negative(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value >= 0.0 && value.is_finite() => Ok(value),
        _ => Err("a number of at least zero is needed".to_owned()),
    }
}

impl Simulate {
    pub(super) fn run(self) -> Result<ExitCode, InputError> {
        use_threads(self.threads);
        let json = self.common.json;
        let layout = self.common.read()?;
        let request = SimulateRequest {
            out: self.out.clone(),
            seed: self.seed,
            pictures: self.pictures,
            force: self.force,
            noise: self.noise,
            configurations: self.configurations,
            shots: self.shots,
        };
        let prepared = prepare(layout, request)?;
        if !json {
            let path = if prepared.recorded_path { "the robots' own files" } else { "made up" };
            let pictures =
                if self.pictures { format!("up to {} pictures, ", prepared.pictures) } else { String::new() };
            say!("path: {path}; {pictures}about {} on disk", size(prepared.bytes));
            if prepared.hides_all {
                say!("no pose is marked `unknown: true`: every pose is hidden from the solver");
            }
        }
        let bar = progress_bar("rendering");
        let progress = |done: usize, all: usize| {
            bar.set_length(all as u64);
            bar.set_position(done as u64);
        };
        let made = make(
            &prepared,
            &Watch { progress: &progress, stop: stop_requested(), draw: None, predict: None, search_all: false },
        )?;
        bar.finish_and_clear();
        if made.interrupted {
            eprintln!("stopped; nothing was written");
            return Ok(ExitCode::from(130));
        }
        if json {
            print_json(&as_json(&made, prepared.bytes));
        } else {
            show(&made, &self.out);
        }
        for camera in &made.blind {
            eprintln!("warning: camera `{camera}` never sees anything: check its pose (x right, y down, z forward)");
        }
        for target in &made.unseen {
            eprintln!("warning: target `{target}` is never seen: check its pose, and which way its face looks");
        }
        Ok(ExitCode::SUCCESS)
    }
}

fn show(made: &Made, out: &std::path::Path) {
    let mut parts = vec![format!("{} configurations", made.configurations)];
    let counts =
        [(made.pictures, "pictures"), (made.corners, "corners"), (made.poses, "whole poses"), (made.points, "points")];
    parts.extend(counts.iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}")));
    say!("{}", parts.join(", "));
    for words in &made.spoilt {
        say!("spoilt: {words}");
    }
    let out = out.display();
    say!("wrote {out}/layout.yaml (what a solver is told) and {out}/truth.yaml");
    let next = if made.pictures > 0 { "detect" } else { "solve" };
    say!("next: cellmap {next} {out}/layout.yaml");
}

fn as_json(made: &Made, bytes: u64) -> Document {
    let whole = |n: usize| Document::Whole(n as u64);
    let names = |list: &[String]| Document::List(list.iter().map(Document::text).collect());
    Document::map([
        ("configurations", whole(made.configurations)),
        ("pictures", whole(made.pictures)),
        ("corners", whole(made.corners)),
        ("target_poses", whole(made.poses)),
        ("points", whole(made.points)),
        ("estimated_bytes", Document::Whole(bytes)),
        ("blind_cameras", names(&made.blind)),
        ("unseen_targets", names(&made.unseen)),
        ("spoilt", names(&made.spoilt)),
    ])
}
