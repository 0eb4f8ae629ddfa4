//! The commands. Only this folder prints.

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "this is where the program speaks")]

mod check;
mod compare;
mod completions;
mod demo;
mod detect;
mod export;
mod findings;
mod identify;
mod new;
mod output;
mod print;
mod report;
mod schema;
mod simulate;
mod solve;
mod validate;

use clap::{Args, Parser, Subcommand};
use std::path::PathBuf;
use std::process::ExitCode;

use cellmap::complaint::InputError;
use cellmap::layout::{Layout, read_layout};

/// Maps a robotic workcell from camera pictures and joint values.
#[derive(Parser, Debug)]
#[command(name = "cellmap", version, about, max_term_width = 80)]
// One screen of 80 x 24: the options of the program itself, -h and -V, are left out.
#[command(help_template = "{about}\n\n{usage-heading} {usage}\n\nCommands:\n{subcommands}{after-help}")]
#[command(after_help = "Example: cellmap new a.yaml && cellmap check a.yaml && cellmap print a.yaml\n         \
                        cellmap detect a.yaml && cellmap solve a.yaml --report report.html")]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand, Debug)]
enum Command {
    /// Write a layout to begin with
    New(new::New),
    /// Explain a layout in words and say what is missing
    Check(check::Check),
    /// Draw the targets in true size as PDF
    Print(print::Print),
    /// Make a recording with known truth, of a layout with known poses
    Simulate(simulate::Simulate),
    /// Find the corners of all targets in all pictures
    Detect(detect::Detect),
    /// Find where everything is
    Solve(solve::Solve),
    /// Judge an answer by what it was not fitted to
    Validate(validate::Validate),
    /// The published method: base and tool of a robot from points
    Identify(identify::Identify),
    /// Compare the poses of two layouts, or of a solution with a truth
    Compare(compare::Compare),
    /// Show a solution as one HTML file with figures
    Report(report::Report),
    /// Write the solved cell for other programs and controllers
    Export(export::Export),
    /// Render the paper's simulation, solve it, compare with the truth
    Demo(demo::Demo),
    /// The JSON Schema of the files, for editors
    Schema(schema::Schema),
    /// Completions for a shell
    Completions(completions::Completions),
    /// The manual page
    Man(completions::Man),
}

/// What every command on a layout takes.
#[derive(Args, Debug, Clone)]
struct LayoutArguments {
    /// The layout of the cell (YAML)
    layout: PathBuf,
    /// Folder of the recording [default: the layout's own]
    #[arg(long, value_name = "DIR")]
    recording: Option<PathBuf>,
    /// Print one JSON object on stdout and nothing else
    #[arg(long)]
    json: bool,
}

impl LayoutArguments {
    fn read(&self) -> Result<Layout, InputError> {
        read_layout(&self.layout, self.recording.as_deref())
    }
}

/// The answer is there but is not to be trusted.
const NOT_TRUSTWORTHY: u8 = 1;
/// The input is wrong.
const BAD_INPUT: u8 = 2;

/// Runs the program and returns its exit code: 0 fine, 1 the answer is not trustworthy, 2 the input is wrong.
pub fn run() -> ExitCode {
    let cli = Cli::parse();
    output::exit_cleanly_on_interrupt();
    let (json, outcome) = match cli.command {
        Command::New(command) => (command.json, command.run()),
        Command::Check(command) => (command.common.json, command.run()),
        Command::Print(command) => (command.common.json, command.run()),
        Command::Simulate(command) => (command.common.json, command.run()),
        Command::Detect(command) => (command.common.json, command.run()),
        Command::Solve(command) => (command.common.json, command.run()),
        Command::Validate(command) => (command.common.json, command.run()),
        Command::Identify(command) => (command.common.json, command.run()),
        Command::Compare(command) => (command.json, command.run()),
        Command::Report(command) => (command.common.json, command.run()),
        Command::Export(command) => (command.common.json, command.run()),
        Command::Demo(command) => (command.json, command.run()),
        Command::Schema(command) => (false, command.run()),
        Command::Completions(command) => (false, command.run()),
        Command::Man(command) => (false, command.run()),
    };
    match outcome {
        Ok(code) => code,
        Err(error) => {
            output::show_error(&error, json);
            ExitCode::from(BAD_INPUT)
        }
    }
}

/// Sets the number of worker threads for the whole process.
fn use_threads(threads: Option<usize>) {
    if let Some(threads) = threads {
        // Fails only if a pool exists already, which then simply stays.
        let _ = rayon::ThreadPoolBuilder::new().num_threads(threads.max(1)).build_global();
    }
}
