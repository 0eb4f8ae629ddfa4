//! `cellmap demo`.

use clap::Args;
use std::process::ExitCode;

use cellmap::complaint::InputError;

#[derive(Args, Debug)]
pub(super) struct Demo {
    /// Print one machine-readable object on stdout and nothing else
    #[arg(long)]
    pub(super) json: bool,
}

impl Demo {
    pub(super) fn run(self) -> Result<ExitCode, InputError> {
        Ok(ExitCode::SUCCESS)
    }
}
