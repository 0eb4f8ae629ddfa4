//! A checked layout: what stands in the cell, in metres and radians, every name resolved.

use std::path::PathBuf;

use super::simulate::SimulateSettings;
use crate::geometry::{Intrinsics, Pattern, Pose, TargetGeometry};
use crate::robot::{Chain, ParameterKind};

/// The units a layout and the CSV files it names are written in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Units {
    /// Metres per unit of length.
    pub length: f64,
    /// Radians per unit of angle.
    pub angle: f64,
}

impl Units {
    /// Metres and radians.
    pub const SI: Self = Self { length: 1.0, angle: 1.0 };

    /// The names of the two units as a layout writes them.
    #[must_use]
    pub fn names(&self) -> (&'static str, &'static str) {
        let length = LENGTHS.iter().find(|(_, scale)| *scale == self.length).map_or("m", |(name, _)| name);
        let angle = ANGLES.iter().find(|(_, scale)| *scale == self.angle).map_or("rad", |(name, _)| name);
        (length, angle)
    }
}

/// Units of length and what they are in metres.
pub const LENGTHS: [(&str, f64); 4] = [("m", 1.0), ("mm", 1e-3), ("cm", 1e-2), ("in", 0.0254)];
/// Units of angle and what they are in radians.
pub const ANGLES: [(&str, f64); 2] = [("rad", 1.0), ("deg", std::f64::consts::PI / 180.0)];

/// A Gaussian belief about a pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseSigma {
    /// Standard deviation of each component of the translation in the parent's axes, metres.
    pub translation: [f64; 3],
    /// Standard deviation of each component of the rotation vector, radians.
    pub rotation: [f64; 3],
}

/// What a layout says of a pose `parent_from_child`.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub enum PoseSpec {
    /// Nothing: to be found.
    #[default]
    Unknown,
    /// Known exactly.
    Fixed(Pose),
    /// To be found, starting here.
    Start(Pose),
    /// To be found, believed to be near.
    Prior(Pose, PoseSigma),
    /// To be found: where it really is, for a simulation, which tells nobody.
    Hidden(Pose),
}

impl PoseSpec {
    /// The pose that the layout gives to a solver, whatever it means by it.
    #[must_use]
    pub fn pose(&self) -> Option<Pose> {
        match self {
            Self::Unknown | Self::Hidden(_) => None,
            Self::Fixed(pose) | Self::Start(pose) | Self::Prior(pose, _) => Some(*pose),
        }
    }

    /// The pose that the layout gives to a simulation, which knows the hidden ones too.
    #[must_use]
    pub fn truth(&self) -> Option<Pose> {
        match self {
            Self::Hidden(pose) => Some(*pose),
            _ => self.pose(),
        }
    }
}

/// A whole cell as its layout describes it.
#[derive(Clone, Debug)]
pub struct Layout {
    /// The layout file.
    pub file: PathBuf,
    /// The folder of the recording, against which data files are resolved.
    pub recording: PathBuf,
    /// Units of the layout and of the CSV files.
    pub units: Units,
    /// The frame whose pose is the identity.
    pub world: String,
    /// In the order of the file.
    pub cameras: Vec<Camera>,
    /// In the order of the file.
    pub robots: Vec<Robot>,
    /// In the order of the file.
    pub sensors: Vec<Sensor>,
    /// In the order of the file.
    pub targets: Vec<Target>,
    /// Robot, target and lens files that were read.
    pub files: Vec<PathBuf>,
    /// Which files hold measurements.
    pub observations: Observations,
    /// How to solve.
    pub solve: SolveSettings,
    /// How to simulate.
    pub simulate: SimulateSettings,
    /// Standard deviations of a solution that this file carries, keyed `parent_from_child`.
    pub solved: Vec<SolvedPose>,
}

/// What a solution file adds to a layout for one pose.
#[derive(Clone, Debug, PartialEq)]
pub struct SolvedPose {
    /// `parent_from_child`.
    pub key: String,
    /// Standard deviations of the translation (m) and of the rotation vector (rad); `None` where undetermined.
    pub sigma: [Option<f64>; 6],
}

/// Where something hangs.
#[derive(Clone, Debug, PartialEq)]
pub struct Mount {
    /// The parent's frame.
    pub parent: String,
    /// The line that says so (or where the thing is described).
    pub line: usize,
}

/// A camera.
#[derive(Clone, Debug)]
pub struct Camera {
    /// Its name, which is its frame.
    pub name: String,
    /// Line of the layout.
    pub line: usize,
    /// Where its pictures are, with `{configuration}` and `{shot}`.
    pub images: Option<String>,
    /// Its lens, unless only whole poses are known from it.
    pub intrinsics: Option<Intrinsics>,
    /// Which lens parameters (places in the lens model's order) are to be found too.
    pub refine: Vec<usize>,
    /// What it hangs on.
    pub mount: Mount,
    /// `parent_from_camera`.
    pub pose: PoseSpec,
}

/// A robot.
#[derive(Clone, Debug)]
pub struct Robot {
    /// Its name; its frames are `name.base`, `name.link1`..., `name.flange`.
    pub name: String,
    /// Line of the layout.
    pub line: usize,
    /// How it moves.
    pub motion: Motion,
    /// What its base hangs on.
    pub mount: Mount,
    /// `parent_from_base`.
    pub pose: PoseSpec,
    /// Which link parameters are to be found.
    pub identify: Vec<LinkParameters>,
    /// How far from its log it really stops: standard deviation of the flange's translation (m) and rotation vector (rad) per axis, drawn anew at each
    /// configuration; none where the log is exact.
    pub repeatability: Option<[f64; 2]>,
    /// What an earlier solution found of the links ([`crate::robot::PARAMETERS_PER_LINK`] a link), added to the model; zeros otherwise.
    pub corrections: Vec<f64>,
    /// What the layout called the model, to write it out again.
    pub model_source: ModelSource,
}

impl Robot {
    /// The names of the frames along it: base, one a link, flange.
    #[must_use]
    pub fn frames(&self) -> Vec<String> {
        let links = match &self.motion {
            Motion::Joints { chain, .. } => chain.joint_count(),
            Motion::FlangePoses { .. } => 0,
        };
        let mut frames = vec![format!("{}.base", self.name)];
        frames.extend((1..=links).map(|i| format!("{}.link{i}", self.name)));
        frames.push(format!("{}.flange", self.name));
        frames
    }
}

/// How a robot's flange pose is known.
#[derive(Clone, Debug)]
pub enum Motion {
    /// By a kinematic model and joint values.
    Joints {
        /// The model.
        chain: Chain,
        /// The file of joint values.
        file: String,
    },
    /// By reported poses.
    FlangePoses {
        /// The file of `base_from_flange`.
        file: String,
    },
}

/// Where a kinematic model came from.
#[derive(Clone, Debug, PartialEq)]
pub enum ModelSource {
    /// A built-in name.
    BuiltIn(String),
    /// A model file in MDH convention.
    Mdh(String),
    /// A model file in DH convention.
    Dh(String),
    /// A URDF file with base and tip links.
    Urdf(String, String, String),
    /// Reported flange poses.
    Reported,
}

/// A family of link parameters to be found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkParameters {
    /// Which correction of every link.
    pub kind: ParameterKind,
    /// Standard deviation of the prior about the nominal value, in the layout's units of angle or length as the parameter demands; none: no prior.
    pub sigma: Option<f64>,
}

/// A source of points, such as a laser tracker.
#[derive(Clone, Debug)]
pub struct Sensor {
    /// Its name, which is its frame.
    pub name: String,
    /// Line of the layout.
    pub line: usize,
    /// What it hangs on.
    pub mount: Mount,
    /// `parent_from_sensor`.
    pub pose: PoseSpec,
}

/// A rigid body that carries something to look at.
#[derive(Clone, Debug)]
pub struct Target {
    /// Its name, which is its frame.
    pub name: String,
    /// Line of the layout.
    pub line: usize,
    /// What can be seen of it, and where.
    pub geometry: TargetGeometry,
    /// The same with the places that are hidden from a solver, for a simulation.
    pub true_geometry: TargetGeometry,
    /// How a detector finds it; none for a target that is not looked for in pictures.
    pub pattern: Option<Pattern>,
    /// What it hangs on.
    pub mount: Mount,
    /// `parent_from_target`.
    pub pose: PoseSpec,
    /// Whether it has a new unknown pose at each configuration.
    pub moves: bool,
    /// The layout's own words for its geometry, to be written out again in a solution.
    pub description: Description,
}

/// A piece of a layout as plain data, kept so that a solution can repeat it.
#[derive(Clone, Debug, PartialEq)]
pub enum Description {
    /// A scalar as text.
    Scalar {
        /// The text.
        text: String,
        /// In quotes.
        quoted: bool,
    },
    /// A list.
    List(Vec<Description>),
    /// A mapping in order.
    Mapping(Vec<(String, Description)>),
}

/// Measurement files, relative to the recording.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Observations {
    /// Corners.
    pub detections: Vec<String>,
    /// Whole poses.
    pub target_poses: Vec<String>,
    /// Points.
    pub points: Vec<String>,
    /// Touching points.
    pub contacts: Vec<String>,
    /// Whether the layout has an `observations` key at all.
    pub given: bool,
}

/// How strongly a residual that does not fit is still listened to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LossSetting {
    /// Plain least squares.
    Squared,
    /// Linear beyond `k` standard deviations.
    Huber(f64),
    /// Logarithmic beyond `k` standard deviations.
    Cauchy(f64),
    /// Constant beyond `k` standard deviations.
    Tukey(f64),
}

/// The `solve` section.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SolveSettings {
    /// Robust loss of corners, points and whole poses.
    pub loss: LossSetting,
    /// Standard deviation of a corner per axis, px; added in quadrature to a corner's own covariance.
    pub pixel_sigma: f64,
    /// Standard deviation of a measured point per axis, m.
    pub point_sigma: f64,
    /// Standard deviation of a measured pose's translation per axis, m, and rotation vector per axis, rad.
    pub pose_sigma: [f64; 2],
    /// Standard deviation of a touching distance, m.
    pub contact_sigma: f64,
    /// How the equations are solved: no key of a layout, but an option of the program.
    pub solver: SolverChoice,
}

/// How the shared equations are to be solved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SolverChoice {
    /// By counted work.
    #[default]
    Auto,
    /// As a full matrix.
    Dense,
    /// As a sparse one.
    Sparse,
}

impl Default for SolveSettings {
    fn default() -> Self {
        Self {
            loss: LossSetting::Huber(1.5),
            pixel_sigma: 0.1,
            point_sigma: 1e-3,
            pose_sigma: [3e-3, 0.01],
            contact_sigma: 1e-3,
            solver: SolverChoice::Auto,
        }
    }
}
