//! `cellmap schema`.

use clap::{Args, ValueEnum, builder::PossibleValue};
use std::process::ExitCode;

use super::output::say;
use cellmap::complaint::{Complaint, InputError};
use cellmap::schema::{File, json_schema, markdown};

#[derive(Args, Debug)]
#[command(after_help = "Example:\n  cellmap schema > layout.schema.json\n\
    Then write in the first line of a layout, for editors:\n  # yaml-language-server: $schema=layout.schema.json")]
pub(super) struct Schema {
    /// The kind of file
    #[arg(default_value = "layout")]
    file: FileName,
    /// The key page of the book in place of the schema
    #[arg(long)]
    page: bool,
}

/// A [`File`] on the command line.
#[derive(Clone, Copy, Debug)]
struct FileName(File);

static FILES: [FileName; 4] =
    [FileName(File::Layout), FileName(File::Robot), FileName(File::Target), FileName(File::Intrinsics)];

impl ValueEnum for FileName {
    fn value_variants<'a>() -> &'a [Self] {
        &FILES
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(PossibleValue::new(match self.0 {
            File::Layout => "layout",
            File::Robot => "robot",
            File::Target => "target",
            File::Intrinsics => "intrinsics",
        }))
    }
}

impl Schema {
    pub(super) fn run(self) -> Result<ExitCode, InputError> {
        if self.page {
            say!("{}", markdown().trim_end());
            return Ok(ExitCode::SUCCESS);
        }
        let text = serde_json::to_string_pretty(&json_schema(self.file.0))
            .map_err(|e| Complaint::of("cellmap".as_ref(), e.to_string(), "report this"))?;
        say!("{text}");
        Ok(ExitCode::SUCCESS)
    }
}
