//! The solved cell in the files of other programs.
//!
//! Every format starts from the same [`Cell`]: frames, each with its parent and `parent_from_child`, in metres. What a format cannot hold is never
//! dropped in silence: it is a complaint where the result would be wrong without it, and a note otherwise.

mod camera_info;
mod cell;
mod kalibr;
mod makers;
mod opencv;
mod ros2;
mod tables;
mod text;
mod urdf;

use std::path::PathBuf;

use crate::complaint::InputError;
use crate::layout::Layout;

pub use cell::{Cell, Joint, JointMotion};
pub use makers::{abb_orientation, fanuc_pose, kuka_frame, ur_pose};

/// A format that [`export`] writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// One robot description of the whole cell.
    Urdf,
    /// The same as a macro with a prefix and a parent.
    Xacro,
    /// A ROS 2 launch file of static transforms and the same as YAML.
    Ros2,
    /// A ROS camera calibration file a camera.
    CameraInfo,
    /// OpenCV FileStorage YAML.
    OpenCv,
    /// Kalibr's camera chain.
    Kalibr,
    /// All frames as JSON.
    Json,
    /// All frames as CSV.
    Csv,
    /// Universal Robots: URScript pose variables.
    Ur,
    /// KUKA: KRL frames.
    Kuka,
    /// ABB: a RAPID module with tools and work objects.
    Abb,
    /// FANUC: user frames and tool frames.
    Fanuc,
}

impl Format {
    /// All of them.
    pub const ALL: [Self; 12] = [
        Self::Urdf,
        Self::Xacro,
        Self::Ros2,
        Self::CameraInfo,
        Self::OpenCv,
        Self::Kalibr,
        Self::Json,
        Self::Csv,
        Self::Ur,
        Self::Kuka,
        Self::Abb,
        Self::Fanuc,
    ];

    /// The word on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Urdf => "urdf",
            Self::Xacro => "xacro",
            Self::Ros2 => "ros2",
            Self::CameraInfo => "camera-info",
            Self::OpenCv => "opencv",
            Self::Kalibr => "kalibr",
            Self::Json => "json",
            Self::Csv => "csv",
            Self::Ur => "ur",
            Self::Kuka => "kuka",
            Self::Abb => "abb",
            Self::Fanuc => "fanuc",
        }
    }

    /// What it is, in a few words.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::Urdf => "robots, cameras with optical frames and targets as one URDF",
            Self::Xacro => "the same as a xacro macro with a prefix and a parent",
            Self::Ros2 => "static transforms: a launch file and the same as YAML",
            Self::CameraInfo => "a ROS camera calibration file a camera",
            Self::OpenCv => "lenses and poses as OpenCV FileStorage YAML",
            Self::Kalibr => "cameras that stand still to each other as a Kalibr camchain",
            Self::Json => "every frame with its parent, pose and standard deviations",
            Self::Csv => "the same as a table",
            Self::Ur => "bases and tools as URScript poses: m, rotation vector",
            Self::Kuka => "bases and tools as KRL frames: mm, A B C",
            Self::Abb => "bases and tools as a RAPID module: mm, quaternion",
            Self::Fanuc => "bases and tools as X Y Z W P R: mm, deg",
        }
    }
}

/// One file to be written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Exported {
    /// Its name unless the user says another.
    pub name: PathBuf,
    /// What it holds.
    pub text: String,
}

/// What an export gave.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Export {
    /// The files.
    pub files: Vec<Exported>,
    /// What was left out, and why.
    pub notes: Vec<String>,
}

/// Writes a solved layout in a format.
///
/// # Errors
/// When the layout holds nothing that the format can tell, or something that it would tell wrongly.
pub fn export(layout: &Layout, format: Format) -> Result<Export, InputError> {
    let cell = Cell::new(layout);
    let (files, mut notes) = match format {
        Format::Urdf => (vec![("cell.urdf".to_owned(), urdf::urdf(&cell))], Vec::new()),
        Format::Xacro => (vec![("cell.urdf.xacro".to_owned(), urdf::xacro(&cell))], Vec::new()),
        Format::Ros2 => (ros2::files(&cell)?, Vec::new()),
        Format::CameraInfo => camera_info::files(layout)?,
        Format::OpenCv => (vec![("cell_opencv.yml".to_owned(), opencv::file(&cell)?)], Vec::new()),
        Format::Kalibr => kalibr::file(&cell)?,
        Format::Json => (vec![("cell.json".to_owned(), tables::json(&cell)?)], Vec::new()),
        Format::Csv => (vec![("cell.csv".to_owned(), tables::csv(&cell)?)], Vec::new()),
        Format::Ur | Format::Kuka | Format::Abb | Format::Fanuc => makers::file(&cell, format)?,
    };
    notes.splice(0..0, cell.left_out());
    let files = files.into_iter().map(|(name, text)| Exported { name: name.into(), text }).collect();
    Ok(Export { files, notes })
}
