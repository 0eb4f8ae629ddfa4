//! `cellmap new`.

use clap::Args;
use std::io::{BufRead, IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use super::output::{print_json, say};
use cellmap::complaint::{Complaint, InputError, list};
use cellmap::export::Document;
use cellmap::layout::builtin::robot_names;
use cellmap::recording::atomic;
use cellmap::robot::urdf::longest_chain;
use cellmap::workflow::new::{NewCell, NewError, NewKind, NewModel, NewRobot};

#[derive(Args, Debug)]
#[command(after_help = "Examples:\n  cellmap new cell.yaml --robots ur5e --cameras left,right,wrist@ur5e \\\n      \
    --targets table:grid,tool:cube@ur5e,pallet:tag\n  cellmap new cell.yaml --from-urdf kr6.urdf\n\
    What is not said is asked for on a terminal.")]
pub(super) struct New {
    /// The layout to write
    #[arg(default_value = "layout.yaml")]
    layout: PathBuf,
    /// Robots: MODEL (built in), NAME=MODEL, or NAME=reported
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    robots: Option<Vec<String>>,
    /// Cameras: NAME, or NAME@ROBOT for one on its flange
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    cameras: Option<Vec<String>>,
    /// Targets: NAME:KIND or NAME:KIND@ROBOT; the first that stands still
    /// is the world. Kinds: grid tag cube checkerboard charuco aprilgrid
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    targets: Option<Vec<String>>,
    /// Start with the robot of this URDF
    #[arg(long, value_name = "FILE")]
    from_urdf: Option<PathBuf>,
    /// Replace a file that is there
    #[arg(long)]
    force: bool,
    /// Print one JSON object on stdout and nothing else
    #[arg(long)]
    pub(super) json: bool,
}

impl New {
    pub(super) fn run(self) -> Result<ExitCode, InputError> {
        let refuse = |what: String, remedy: &str| InputError::from(Complaint::of(&self.layout, what, remedy));
        if self.layout.exists() && !self.force {
            return Err(refuse(
                "the file is there already".to_owned(),
                "choose another name, or replace it with `--force`",
            ));
        }
        let mut cell = NewCell::default();
        if let Some(file) = &self.from_urdf {
            cell.robots.push(from_urdf(file, &self.layout)?);
        }
        let asking = std::io::stdin().is_terminal() && !self.json;
        let failed = |error: NewError| refused(&self.layout, &error);
        // The robot of a URDF is the only one, unless more are named.
        if self.robots.is_some() || cell.robots.is_empty() {
            let question = "Robots: MODEL (ur3e, ur5e, ur10e...), NAME=MODEL, or NAME=reported";
            answer(&mut cell, NewCell::add_robots, self.robots.as_deref(), asking, question, "ur5e").map_err(failed)?;
        }
        let question = "Cameras: NAME, or NAME@ROBOT for one on its flange";
        answer(&mut cell, NewCell::add_cameras, self.cameras.as_deref(), asking, question, "left,right")
            .map_err(failed)?;
        let on_robot = cell.robots.first().map_or(String::new(), |robot| format!(",tool:cube@{}", robot.name));
        let question = "Targets: NAME:KIND or NAME:KIND@ROBOT\n  kinds: grid tag cube checkerboard charuco aprilgrid";
        let default = format!("table:grid{on_robot}");
        answer(&mut cell, NewCell::add_targets, self.targets.as_deref(), asking, question, &default).map_err(failed)?;
        let text = cell.layout().map_err(failed)?;
        // What is written must be a layout whatever names were given.
        cellmap::layout::parse_layout(&self.layout, &text, None)?;
        atomic::write(&self.layout, |out| out.write_all(text.as_bytes()))
            .map_err(|e| refuse(format!("the file cannot be written: {e}"), "say where else"))?;
        let file = self.layout.display().to_string();
        if self.json {
            print_json(&Document::map([("file", Document::text(file))]));
        } else {
            say!("wrote {file}. What next:");
            say!("  cellmap check {file}      what it says, and what is missing");
            say!("  cellmap print {file}      the targets as PDF");
            say!("  cellmap simulate {file} --out cell --pictures      a trial run");
        }
        Ok(ExitCode::SUCCESS)
    }
}

fn remedy(error: &NewError) -> String {
    match error {
        NewError::Kind(_) => format!("it is one of {}", list(NewKind::ALL.iter().map(|(name, _)| *name))),
        NewError::Name(_) => "use letters, digits, `_` and `-`".to_owned(),
        NewError::Model(name) => {
            format!("built in are {}; or write `{name}=reported`, or use `--from-urdf FILE`", list(robot_names()))
        }
        NewError::Mount(..) => "name the robot before, or leave the `@` out".to_owned(),
        NewError::Taken(_) => "give everything in the cell its own name".to_owned(),
        NewError::NoTarget => "name one, for example `--targets table:grid`".to_owned(),
    }
}

fn refused(layout: &Path, error: &NewError) -> InputError {
    Complaint::of(layout, error.to_string(), remedy(error)).into()
}

/// Adds what the flag says, or what is answered on a terminal, or the default. An answer that cannot be is asked for again.
fn answer(
    cell: &mut NewCell,
    add: fn(&mut NewCell, &[String]) -> Result<(), NewError>,
    flag: Option<&[String]>,
    asking: bool,
    question: &str,
    default: &str,
) -> Result<(), NewError> {
    if let Some(words) = flag {
        return add(cell, words);
    }
    loop {
        let mut line = String::new();
        if asking {
            eprint!("{question}\n  [{default}]: ");
            let _ = std::io::stderr().flush();
            if std::io::stdin().lock().read_line(&mut line).is_err() {
                line.clear();
            }
        }
        let given = if line.trim().is_empty() { default } else { line.trim() };
        let words: Vec<String> = given.split([',', ' ']).filter(|word| !word.is_empty()).map(str::to_owned).collect();
        let mut tried = cell.clone();
        match add(&mut tried, &words) {
            Ok(()) => {
                *cell = tried;
                return Ok(());
            }
            Err(error) if asking && !line.is_empty() => eprintln!("{error}: {}", remedy(&error)),
            Err(error) => return Err(error),
        }
    }
}

/// The robot of a URDF, with its file named from where the layout will stand.
fn from_urdf(file: &Path, layout: &Path) -> Result<NewRobot, InputError> {
    let (name, base, tip) = longest_chain(file)
        .map_err(|error| Complaint::of(file, error.to_string(), "give a URDF (not a xacro) of a robot with joints"))?;
    let plain: String =
        name.chars().map(|c| if c.is_ascii_alphanumeric() || "_-".contains(c) { c } else { '_' }).collect();
    let name = if plain.is_empty() || plain == "world" { "robot".to_owned() } else { plain };
    let folder = layout.parent().unwrap_or(Path::new(""));
    let path = match (std::path::absolute(file), std::path::absolute(folder)) {
        (Ok(file), Ok(folder)) => file.strip_prefix(&folder).map_or_else(|_| file.clone(), Path::to_owned),
        _ => file.to_owned(),
    };
    Ok(NewRobot { name, model: NewModel::Urdf(path.display().to_string(), base, tip) })
}
