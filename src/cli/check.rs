//! `cellmap check`.

use clap::Args;
use std::process::ExitCode;

use super::output::{print_json, say};
use super::{LayoutArguments, NOT_TRUSTWORTHY};
use cellmap::complaint::InputError;
use cellmap::export::Document;
use cellmap::workflow::check::{check, tree_of};

#[derive(Args, Debug)]
#[command(after_help = "Example:\n  cellmap check layout.yaml")]
pub(super) struct Check {
    #[command(flatten)]
    pub(super) common: LayoutArguments,
}

impl Check {
    pub(super) fn run(self) -> Result<ExitCode, InputError> {
        let layout = self.common.read()?;
        let checked = check(&layout).inspect_err(|_| {
            // A layout is worth explaining before its recording is complete.
            if !self.common.json {
                tree_of(&layout).iter().for_each(|line| say!("{line}"));
            }
        })?;
        if self.common.json {
            let texts = |list: &[String]| Document::List(list.iter().map(Document::text).collect());
            print_json(&Document::map([
                ("known", Document::Whole(checked.known as u64)),
                ("unknown", Document::Whole(checked.unknown as u64)),
                ("pictures", Document::Whole(checked.pictures as u64)),
                ("configurations", Document::Whole(checked.configurations as u64)),
                ("unreached", texts(&checked.unreached)),
                ("tree", texts(&checked.tree)),
                ("facts", texts(&checked.facts)),
                ("warnings", texts(&checked.warnings)),
            ]));
        } else {
            for line in &checked.tree {
                say!("{line}");
            }
            say!("");
            for fact in &checked.facts {
                say!("{fact}");
            }
            say!("poses: {} known, {} to be found", checked.known, checked.unknown);
            for warning in &checked.warnings {
                say!("warning: {warning}");
            }
            if checked.warnings.is_empty() {
                say!("The layout is fine.");
            }
        }
        Ok(if checked.warnings.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(NOT_TRUSTWORTHY) })
    }
}
