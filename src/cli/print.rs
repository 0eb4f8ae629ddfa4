//! `cellmap print`.

use clap::{Args, ValueEnum, builder::PossibleValue};
use std::path::PathBuf;
use std::process::ExitCode;

use super::LayoutArguments;
use super::output::{print_json, say, shown};
use cellmap::complaint::{Complaint, InputError, list};
use cellmap::export::Document;
use cellmap::layout::Layout;
use cellmap::print::{Paper, PrintError, PrintOptions, Printed, print};
use cellmap::recording::atomic;

#[derive(Args, Debug)]
#[command(after_help = "Example:\n  cellmap print layout.yaml --paper a3 --out targets.pdf\n\
    Print at 100 % (no fit to page), then measure what each caption says.")]
pub(super) struct Print {
    #[command(flatten)]
    pub(super) common: LayoutArguments,
    /// The paper; `tag` is one page a tag
    #[arg(long, value_name = "PAPER", default_value = "a4")]
    paper: PaperName,
    /// Only this target; may be repeated [default: all]
    #[arg(long = "target", value_name = "NAME")]
    targets: Vec<String>,
    /// Spread what is larger than the paper over several pages
    #[arg(long)]
    tile: bool,
    /// Where the PDF goes [default: targets.pdf in the recording]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

/// A [`Paper`] on the command line.
#[derive(Clone, Copy, Debug)]
struct PaperName(Paper);

static PAPERS: [PaperName; Paper::ALL.len()] = {
    let mut all = [PaperName(Paper::A4); Paper::ALL.len()];
    let mut i = 0;
    while i < all.len() {
        all[i] = PaperName(Paper::ALL[i]);
        i += 1;
    }
    all
};

impl ValueEnum for PaperName {
    fn value_variants<'a>() -> &'a [Self] {
        &PAPERS
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(PossibleValue::new(self.0.name()))
    }
}

impl Print {
    pub(super) fn run(self) -> Result<ExitCode, InputError> {
        let layout = self.common.read()?;
        let out = self.out.clone().unwrap_or_else(|| layout.recording.join("targets.pdf"));
        let options = PrintOptions { paper: self.paper.0, targets: self.targets.clone(), tile: self.tile };
        let printed = print(&layout, &options).map_err(|error| refused(&layout, &error))?;
        atomic::write(&out, |file| file.write_all(&printed.pdf)).map_err(|e| {
            Complaint::of(&out, format!("the file cannot be written: {e}"), "say where else with `--out FILE`")
        })?;
        if self.common.json {
            print_json(&as_json(&printed, &out));
        } else {
            for (i, page) in printed.pages.iter().enumerate() {
                say!("page {}, {:.0} x {:.0} mm: {}", i + 1, page.size[0], page.size[1], page.plates.join(", "));
            }
            for note in &printed.notes {
                say!("note: {note}");
            }
            say!("wrote {}; print it at 100 % and measure it", shown(&out));
        }
        Ok(ExitCode::SUCCESS)
    }
}

fn refused(layout: &Layout, error: &PrintError) -> Complaint {
    let remedy = match error {
        PrintError::NoSuchTarget(_) => {
            format!("its targets are {}", list(layout.targets.iter().map(|target| target.name.as_str())))
        }
        PrintError::Nothing => "give a target `tags`, `checkerboard`, `charuco` or `april_grid`".to_owned(),
        PrintError::TooLarge { fits: Some(fits), .. } => {
            format!("print with `--paper {fits}`, or over several pages with `--tile`")
        }
        PrintError::TooLarge { fits: None, .. } => "print it over several pages with `--tile`".to_owned(),
    };
    Complaint::of(&layout.file, error.to_string(), remedy)
}

fn as_json(printed: &Printed, out: &std::path::Path) -> Document {
    let page = |page: &cellmap::print::PrintedPage| {
        let tag = |tag: &cellmap::print::PrintedTag| {
            let corners = tag.corners.iter().map(|corner| Document::numbers(corner)).collect();
            Document::map([
                ("target", Document::text(&tag.target)),
                ("dictionary", Document::text(tag.dictionary.name())),
                ("id", Document::Whole(u64::from(tag.id))),
                ("corners_mm", Document::Row(corners)),
            ])
        };
        Document::map([
            ("size_mm", Document::numbers(&page.size)),
            ("plates", Document::Row(page.plates.iter().map(Document::text).collect())),
            ("tags", Document::List(page.tags.iter().map(tag).collect())),
        ])
    };
    Document::map([
        ("file", Document::text(out.display().to_string())),
        ("pages", Document::List(printed.pages.iter().map(page).collect())),
        ("notes", Document::List(printed.notes.iter().map(Document::text).collect())),
    ])
}
