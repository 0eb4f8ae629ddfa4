//! `cellmap export`.

use clap::{Args, ValueEnum};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use super::LayoutArguments;
use super::output::{print_json, say, shown};
use cellmap::complaint::{Complaint, InputError};
use cellmap::export::Document;
use cellmap::export::formats::{Export as Exported, Format, export};
use cellmap::recording::atomic;

#[derive(Args, Debug)]
#[command(after_help = "Formats:\n  \
    urdf xacro           robots, cameras with optical frames, targets; or as a macro\n  \
    ros2                 static transforms: a launch file and the same as YAML\n  \
    camera-info          a ROS calibration file a camera\n  \
    opencv kalibr        lenses and poses as FileStorage YAML; a camchain\n  \
    json csv             every frame: parent, pose, standard deviations\n  \
    ur kuka abb fanuc    bases and tools as the controller writes them\n\n\
    Example:\n  cellmap export solution.yaml --to urdf --out cell.urdf")]
pub(super) struct Export {
    #[command(flatten)]
    pub(super) common: LayoutArguments,
    /// The format, one of those below
    #[arg(long, value_name = "FORMAT", hide_possible_values = true)]
    to: FormatName,
    /// A file, or a folder for several files [default: here]
    #[arg(long, value_name = "PATH")]
    out: Option<PathBuf>,
}

/// A [`Format`] on the command line.
#[derive(Clone, Copy, Debug)]
struct FormatName(Format);

/// The names of all formats, as long as clap wants them.
static NAMES: [FormatName; Format::ALL.len()] = {
    let mut all = [FormatName(Format::Urdf); Format::ALL.len()];
    let mut i = 0;
    while i < all.len() {
        all[i] = FormatName(Format::ALL[i]);
        i += 1;
    }
    all
};

impl ValueEnum for FormatName {
    fn value_variants<'a>() -> &'a [Self] {
        &NAMES
    }

    fn to_possible_value(&self) -> Option<clap::builder::PossibleValue> {
        Some(clap::builder::PossibleValue::new(self.0.name()).help(self.0.words()))
    }
}

impl Export {
    pub(super) fn run(self) -> Result<ExitCode, InputError> {
        let layout = self.common.read()?;
        let exported = export(&layout, self.to.0)?;
        let paths = destinations(&exported, self.out.as_deref());
        for (path, file) in paths.iter().zip(&exported.files) {
            atomic::write(path, |out| out.write_all(file.text.as_bytes())).map_err(|e| {
                Complaint::of(path, format!("the file cannot be written: {e}"), "say where else with `--out PATH`")
            })?;
        }
        if self.common.json {
            let texts = |list: Vec<String>| Document::List(list.into_iter().map(Document::Text).collect());
            print_json(&Document::map([
                ("format", Document::text(self.to.0.name())),
                ("files", texts(paths.iter().map(|path| path.display().to_string()).collect())),
                ("notes", texts(exported.notes.clone())),
            ]));
        } else {
            for path in &paths {
                say!("wrote {}", shown(path));
            }
            for note in &exported.notes {
                say!("note: {note}");
            }
        }
        Ok(ExitCode::SUCCESS)
    }
}

/// A single file goes where `out` says unless that is a folder; several go into the folder `out`.
fn destinations(exported: &Exported, out: Option<&Path>) -> Vec<PathBuf> {
    match (&exported.files[..], out) {
        ([_], Some(out)) if !out.is_dir() && !out.as_os_str().to_string_lossy().ends_with('/') => vec![out.to_owned()],
        (files, out) => {
            let folder = out.unwrap_or(Path::new(""));
            files.iter().map(|file| folder.join(&file.name)).collect()
        }
    }
}
