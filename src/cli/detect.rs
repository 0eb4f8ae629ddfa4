//! `cellmap detect`.

use clap::Args;
use std::path::PathBuf;
use std::process::ExitCode;

use super::findings::show_faults;
use super::output::{print_json, progress_bar, say, shown, stop_requested};
use super::{LayoutArguments, NOT_TRUSTWORTHY, use_threads};
use cellmap::complaint::InputError;
use cellmap::detect::Detector;
use cellmap::detect::native::NativeDetector;
use cellmap::export::Document;
use cellmap::recording::DEFAULT_DETECTIONS;
use cellmap::workflow::detect::{Detected, Watch, detect};

#[derive(Args, Debug)]
#[command(
    after_help = "Examples:\n  cellmap detect layout.yaml\n  cellmap detect layout.yaml --recording monday --out monday.csv"
)]
pub(super) struct Detect {
    #[command(flatten)]
    pub(super) common: LayoutArguments,
    /// Where the corners go [default: detections.csv in the recording]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Worker threads [default: one a core]
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// Who finds patterns: `native`, or `opencv` where built with it
    #[arg(long, value_enum, default_value_t, value_name = "NAME", hide_possible_values = true)]
    detector: Finder,
    /// Also find tags printed with black and white exchanged
    #[arg(long)]
    inverted: bool,
    /// Changes nothing: tags in the shade, beside what is lit, are always looked for
    #[arg(long)]
    shade: bool,
    /// A solution of this cell: tags are first looked for where it says that they are
    #[arg(long, value_name = "SOLUTION")]
    predict: Option<PathBuf>,
    /// Search every picture, even one that shows the same as the first of its configuration
    #[arg(long)]
    search_all: bool,
    /// Also draw what was found into the pictures, in this folder
    #[arg(long, value_name = "DIR")]
    draw: Option<PathBuf>,
}

/// How many unusable pictures are named one by one.
const NAMED_FAILURES: usize = 10;

impl Detect {
    pub(super) fn run(self) -> Result<ExitCode, InputError> {
        use_threads(self.threads);
        if self.shade {
            eprintln!("note: --shade changes nothing any more: tags in the shade are always looked for");
        }
        let layout = self.common.read()?;
        let out = self.out.clone().unwrap_or_else(|| layout.recording.join(DEFAULT_DETECTIONS));
        let detector = self.detector.make(self.inverted, &layout.file)?;
        let bar = progress_bar("detecting");
        let progress = |done: usize, all: usize| {
            bar.set_length(all as u64);
            bar.set_position(done as u64);
        };
        let watch = Watch {
            progress: &progress,
            stop: stop_requested(),
            draw: self.draw.as_deref(),
            predict: self.predict.as_deref(),
            search_all: self.search_all,
        };
        let found = detect(&layout, detector.as_ref(), &out, &watch)?;
        bar.finish_and_clear();
        if found.interrupted {
            eprintln!("stopped after {} pictures; run the same command again to go on from there", found.pictures);
            return Ok(ExitCode::from(130));
        }
        if self.common.json {
            print_json(&as_json(&found))
        } else {
            show(&found, &out)
        }
        if found.corners == 0 {
            eprintln!("warning: nothing was found: check the targets' dictionary and ids against what is printed");
        }
        if found.corners == 0 || !found.faults.is_empty() {
            return Ok(ExitCode::from(NOT_TRUSTWORTHY));
        }
        Ok(ExitCode::SUCCESS)
    }
}

/// Who finds the patterns. Corners are measured by cellmap itself in either case.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Finder {
    /// cellmap's own
    #[default]
    Native,
    /// The system's OpenCV, where cellmap was built with it
    Opencv,
}

impl Finder {
    /// # Errors
    /// When the program was built without it, or it cannot find inverted tags.
    pub(super) fn make(self, inverted: bool, layout: &std::path::Path) -> Result<Box<dyn Detector>, InputError> {
        match self {
            Self::Native => {
                let detector = if inverted { NativeDetector::with_inverted() } else { NativeDetector::new() };
                Ok(Box::new(detector))
            }
            Self::Opencv if inverted => Err(cellmap::complaint::Complaint::of(
                layout,
                "inverted tags are not looked for with OpenCV",
                "use `--detector native`",
            )
            .into()),
            #[cfg(feature = "opencv")]
            Self::Opencv => {
                let detector = cellmap::detect::opencv::OpenCvDetector::new().map_err(|error| {
                    cellmap::complaint::Complaint::of(layout, error.to_string(), "check the system's OpenCV")
                })?;
                Ok(Box::new(detector))
            }
            #[cfg(not(feature = "opencv"))]
            Self::Opencv => Err(cellmap::complaint::Complaint::of(
                layout,
                "this build of cellmap comes without OpenCV",
                "use `--detector native`, or build cellmap with `--features opencv`",
            )
            .into()),
        }
    }
}

fn show(found: &Detected, out: &std::path::Path) {
    let rate = (found.pictures - found.resumed) as f64 / found.seconds.max(1e-9);
    say!(
        "{} pictures, {} with something in them: {} tags or boards, {} corners",
        found.pictures,
        found.pictures_with_detections,
        found.tags,
        found.corners
    );
    say!("{:.2} s, {rate:.0} pictures a second, detector {}", found.seconds, found.detector);
    if found.resumed > 0 {
        say!("{} pictures were done by an earlier run", found.resumed);
    }
    for failure in found.failed.iter().take(NAMED_FAILURES) {
        say!("skipped: {}", failure.reason);
    }
    if found.failed.len() > NAMED_FAILURES {
        say!("skipped: {} more", found.failed.len() - NAMED_FAILURES);
    }
    show_faults(&found.faults);
    say!("wrote {}", shown(out));
}

fn as_json(found: &Detected) -> Document {
    let whole = |n: usize| Document::Whole(n as u64);
    let failed = found.failed.iter().map(|failure| {
        Document::map([
            ("picture", Document::text(failure.picture.display().to_string())),
            ("reason", Document::text(&failure.reason)),
        ])
    });
    Document::map([
        ("pictures", whole(found.pictures)),
        ("pictures_with_detections", whole(found.pictures_with_detections)),
        ("tags", whole(found.tags)),
        ("corners", whole(found.corners)),
        ("detector", Document::text(&found.detector)),
        ("seconds", Document::Number(found.seconds)),
        ("pictures_per_second", Document::Number((found.pictures - found.resumed) as f64 / found.seconds.max(1e-9))),
        ("resumed", whole(found.resumed)),
        ("failed", Document::List(failed.collect())),
        ("faults", cellmap::export::findings::faults(&found.faults)),
    ])
}
