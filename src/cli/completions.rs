//! `cellmap completions`, `cellmap man`: what shells and manuals want, made from the commands themselves.

use clap::{Args, CommandFactory};
use clap_complete::Shell;
use std::process::ExitCode;

use super::Cli;
use cellmap::complaint::{Complaint, InputError};

#[derive(Args, Debug)]
#[command(after_help = "Example:\n  cellmap completions bash > ~/.local/share/bash-completion/completions/cellmap")]
pub(super) struct Completions {
    /// The shell
    shell: Shell,
}

impl Completions {
    pub(super) fn run(self) -> Result<ExitCode, InputError> {
        let mut text = Vec::new();
        clap_complete::generate(self.shell, &mut Cli::command(), "cellmap", &mut text);
        put(&text)
    }
}

#[derive(Args, Debug)]
#[command(
    after_help = "Examples:\n  cellmap man > cellmap.1 && man ./cellmap.1\n  cellmap man solve > cellmap-solve.1"
)]
pub(super) struct Man {
    /// One command's page [default: the program's]
    command: Option<String>,
}

impl Man {
    pub(super) fn run(self) -> Result<ExitCode, InputError> {
        let mut command = Cli::command();
        command.build();
        let page = match &self.command {
            None => command,
            Some(name) => match command.get_subcommands().find(|sub| sub.get_name() == name) {
                Some(sub) => sub.clone(),
                None => {
                    let what = format!("there is no command `{name}`");
                    return Err(Complaint::of("cellmap".as_ref(), what, "see `cellmap --help`").into());
                }
            },
        };
        let mut text = Vec::new();
        clap_mangen::Man::new(page)
            .render(&mut text)
            .map_err(|e| Complaint::of("cellmap".as_ref(), e.to_string(), "report this"))?;
        put(&text)
    }
}

fn put(text: &[u8]) -> Result<ExitCode, InputError> {
    super::output::line(format_args!("{}", String::from_utf8_lossy(text).trim_end()));
    Ok(ExitCode::SUCCESS)
}
