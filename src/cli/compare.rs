//! `cellmap compare`.

use clap::Args;
use std::path::PathBuf;
use std::process::ExitCode;

use super::output::{print_json, print_table, say, say_wrapped};
use cellmap::complaint::InputError;
use cellmap::export::Document;
use cellmap::layout::read_layout;
use cellmap::workflow::compare::{Comparison, compare};

#[derive(Args, Debug)]
#[command(after_help = "Example:\n  cellmap compare cell/solution.yaml cell/truth.yaml")]
pub(super) struct Compare {
    /// The first layout, usually a solution
    first: PathBuf,
    /// The second layout, usually a truth
    second: PathBuf,
    /// Print one JSON object on stdout and nothing else
    #[arg(long)]
    pub(super) json: bool,
}

impl Compare {
    pub(super) fn run(self) -> Result<ExitCode, InputError> {
        let (first, second) = (read_layout(&self.first, None)?, read_layout(&self.second, None)?);
        let comparison = compare(&first, &second)?;
        if self.json {
            print_json(&as_json(&comparison))
        } else {
            show(&comparison)
        }
        Ok(ExitCode::SUCCESS)
    }
}

fn as_json(comparison: &Comparison) -> Document {
    let one = |pose: &cellmap::workflow::compare::PoseDifference| {
        let entries = Document::map([
            ("translation_mm", Document::Number(pose.translation * 1e3)),
            ("rotation_deg", Document::Number(pose.rotation.to_degrees())),
            ("within_sigma", pose.within_sigma.map_or(Document::Null, Document::Number)),
        ]);
        (pose.key.clone(), entries)
    };
    Document::map([
        ("poses", Document::Map(comparison.poses.iter().map(one).collect())),
        ("missing", Document::Row(comparison.missing.iter().map(Document::text).collect())),
        ("worst_translation_mm", Document::Number(comparison.worst_translation() * 1e3)),
        ("worst_rotation_deg", Document::Number(comparison.worst_rotation().to_degrees())),
        ("worst_sigmas", comparison.farthest().map_or(Document::Null, |(_, sigmas)| Document::Number(sigmas))),
    ])
}

/// A difference of more standard deviations than this is no chance.
const BY_CHANCE: f64 = 4.0;

/// Prints the differences as a table.
pub(super) fn show(comparison: &Comparison) {
    let rows: Vec<Vec<String>> = comparison
        .poses
        .iter()
        .map(|pose| {
            vec![
                pose.key.clone(),
                format!("{:.4}", pose.translation * 1e3),
                format!("{:.5}", pose.rotation.to_degrees()),
                pose.within_sigma.map_or_else(|| "-".to_owned(), |s| format!("{s:.2}")),
            ]
        })
        .collect();
    print_table(&["pose", "mm", "deg", "sigmas"], &rows);
    say!("worst: {:.4} mm, {:.5} deg", comparison.worst_translation() * 1e3, comparison.worst_rotation().to_degrees());
    if let Some((key, sigmas)) = comparison.farthest() {
        let verdict = if sigmas > BY_CHANCE {
            "no chance: one of the two is wrong, or its sigma too small"
        } else {
            "as chance has it"
        };
        say_wrapped("farthest: ", 10, &format!("{key}, {sigmas:.1} standard deviations ({verdict})"));
    }
    for key in &comparison.missing {
        say!("only in the first: {key}");
    }
}
