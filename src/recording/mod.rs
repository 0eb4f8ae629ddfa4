//! The files of a recording: joint values, flange poses, corners, whole poses, points and contacts.
//!
//! Every reader turns a CSV file into sorted rows in metres, radians and pixels, so that the order of the lines in a file never
//! reaches the numbers of a solution. A fault names file and line; no row is dropped in silence. Every writer goes through
//! [`atomic`]: a file appears whole or not at all.

pub mod atomic;
mod cells;
mod chunks;
pub mod corners;
pub mod detections;
mod evenly;
mod held;
mod index;
pub mod motion;
mod names;
mod swift;
pub mod table;
pub mod targets;
pub mod write;

use std::collections::BTreeMap;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use crate::complaint::{Complaint, InputError};
use crate::geometry::Pose;
use crate::layout::{Layout, Motion};

pub use chunks::Wanted;
pub use corners::{Appearance, CornerRow, Corners};
pub use detections::{
    detection_lines, read_detections, write_detection_lines, write_detections, write_exact_detections,
};
pub use evenly::Evenly;
pub use index::{CornerIndex, Pair};
pub use motion::{FlangePoses, JointValues, read_flange_poses, read_joints};
pub use names::Names;
pub use targets::{ContactRow, PointRow, PoseRow, read_contacts, read_points, read_target_poses};

/// Where detections go and come from unless something else is said.
pub const DEFAULT_DETECTIONS: &str = "detections.csv";

/// The SHA-256 of a file.
pub type Digest = [u8; 32];

/// How one robot moved.
#[derive(Clone, Debug, PartialEq)]
pub enum RobotMotion {
    /// Joint values (rad, m) by configuration.
    Joints(BTreeMap<u64, Vec<f64>>),
    /// `base_from_flange` by configuration.
    Flange(BTreeMap<u64, Pose>),
}

impl RobotMotion {
    /// Whether the robot's place at a configuration is known.
    #[must_use]
    pub fn knows(&self, configuration: u64) -> bool {
        match self {
            Self::Joints(values) => values.contains_key(&configuration),
            Self::Flange(poses) => poses.contains_key(&configuration),
        }
    }

    /// The same at the configurations of a range alone.
    #[must_use]
    pub fn during(&self, range: &RangeInclusive<u64>) -> Self {
        match self {
            Self::Joints(values) => Self::Joints(values.range(range.clone()).map(|(c, q)| (*c, q.clone())).collect()),
            Self::Flange(poses) => Self::Flange(poses.range(range.clone()).map(|(c, pose)| (*c, *pose)).collect()),
        }
    }

    /// The configurations in order.
    #[must_use]
    pub fn configurations(&self) -> Vec<u64> {
        match self {
            Self::Joints(values) => values.keys().copied().collect(),
            Self::Flange(poses) => poses.keys().copied().collect(),
        }
    }
}

/// All that was recorded, sorted.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recording {
    /// One a robot, in the layout's order.
    pub motions: Vec<RobotMotion>,
    /// Corners in pictures.
    pub corners: Corners,
    /// Whole poses measured by others.
    pub poses: Vec<PoseRow>,
    /// Points.
    pub points: Vec<PointRow>,
    /// Touching points.
    pub contacts: Vec<ContactRow>,
    /// The files that were read.
    pub files: Vec<PathBuf>,
    /// Of those whose bytes were all in memory, what they were.
    pub digests: BTreeMap<PathBuf, Digest>,
}

impl Recording {
    /// Reads the robots' motion alone.
    ///
    /// # Errors
    /// Faults of the files, all of them at once.
    pub fn read_motion(layout: &Layout) -> Result<Self, InputError> {
        let mut recording = Self::default();
        let mut complaints = Vec::new();
        for (index, robot) in layout.robots.iter().enumerate() {
            let (path, motion) = match &robot.motion {
                Motion::Joints { file, .. } => {
                    let path = layout.recording.join(file);
                    let motion = read_joints(&path, layout, index).map(RobotMotion::Joints);
                    (path, motion)
                }
                Motion::FlangePoses { file } => {
                    let path = layout.recording.join(file);
                    let motion = read_flange_poses(&path, layout, index).map(RobotMotion::Flange);
                    (path, motion)
                }
            };
            recording.note(path);
            match motion {
                Ok(motion) => recording.motions.push(motion),
                Err(InputError(found)) => complaints.extend(found),
            }
        }
        complaints.dedup();
        if complaints.is_empty() { Ok(recording) } else { Err(InputError(complaints)) }
    }

    /// Reads everything the layout names. `detections` takes the place of the layout's own corners. A layout without `observations` and
    /// without `detections` is looked for in `detections.csv`.
    ///
    /// # Errors
    /// Faults of the files; no measurement at all.
    pub fn read(layout: &Layout, detections: Option<&Path>) -> Result<Self, InputError> {
        let mut recording = Self::read_motion(layout)?;
        let corner_files = Self::corner_files(layout, detections)?;
        let mut parts = Vec::new();
        for path in corner_files {
            let (corners, digest) = detections::read_and_digest(&path, layout)?;
            parts.push(corners);
            recording.digests.extend(digest.map(|digest| (path.clone(), digest)));
            recording.note(path);
        }
        // Several files of one kind are one recording: their order must not matter, and none may repeat another.
        recording.corners = Corners::together(parts).ok_or_else(|| chunks::twice(layout))?;
        recording.read_others(layout)?;
        if recording.corners.is_empty()
            && recording.poses.is_empty()
            && recording.points.is_empty()
            && recording.contacts.is_empty()
        {
            return Err(Complaint::of(
                recording.files.last().unwrap_or(&layout.file),
                "the recording is empty: its files hold no measurement",
                "check that the detector found something and that the files are the right ones",
            )
            .into());
        }
        Ok(recording)
    }

    /// The files that hold the corners; see [`Recording::read`].
    ///
    /// # Errors
    /// Neither `observations` nor `detections.csv`.
    pub fn corner_files(layout: &Layout, detections: Option<&Path>) -> Result<Vec<PathBuf>, InputError> {
        let observations = &layout.observations;
        let default = layout.recording.join(DEFAULT_DETECTIONS);
        match detections {
            Some(path) => Ok(vec![path.to_owned()]),
            None if observations.given => {
                Ok(observations.detections.iter().map(|f| layout.recording.join(f)).collect())
            }
            None if default.exists() => Ok(vec![default]),
            None => Err(Complaint::of(
                &layout.file,
                "there is nothing to solve from: the layout has no `observations` and the recording no `detections.csv`",
                "run `cellmap detect` on the layout first",
            )
            .into()),
        }
    }

    /// Reads all measurements but corners.
    ///
    /// # Errors
    /// Faults of the files; a measurement that two files hold.
    pub fn read_others(&mut self, layout: &Layout) -> Result<(), InputError> {
        let observations = &layout.observations;
        for file in &observations.target_poses {
            let path = layout.recording.join(file);
            self.poses.extend(read_target_poses(&path, layout)?);
            self.note(path);
        }
        for file in &observations.points {
            let path = layout.recording.join(file);
            self.points.extend(read_points(&path, layout)?);
            self.note(path);
        }
        for file in &observations.contacts {
            let path = layout.recording.join(file);
            self.contacts.extend(read_contacts(&path, layout)?);
            self.note(path);
        }
        let twice = merge(&mut self.poses, |a, b| a.key().cmp(&b.key()))
            || merge(&mut self.points, |a, b| a.key().cmp(&b.key()))
            || merge(&mut self.contacts, |a, b| a.key().cmp(&b.key()));
        if twice { Err(chunks::twice(layout)) } else { Ok(()) }
    }

    /// What lies between two places of a robot's chain at a configuration (`from < to`, see [`crate::robot::Chain::flange_place`]), with the links
    /// as the layout has them; `None` where the robot was not recorded. A robot known by flange poses has the places 0 and 1 only.
    #[must_use]
    pub fn robot_segment(
        &self,
        layout: &Layout,
        robot: usize,
        configuration: u64,
        from: usize,
        to: usize,
    ) -> Option<Pose> {
        match (self.motions.get(robot)?, &layout.robots[robot].motion) {
            (RobotMotion::Joints(values), Motion::Joints { chain, .. }) => values
                .get(&configuration)
                .map(|joints| chain.segment(joints, &layout.robots[robot].corrections, from, to)),
            (RobotMotion::Flange(poses), _) => poses.get(&configuration).copied(),
            (RobotMotion::Joints(_), Motion::FlangePoses { .. }) => None,
        }
    }

    /// `base_from_flange` of a robot at a configuration, with the links as the layout has them.
    #[must_use]
    pub fn base_from_flange(&self, layout: &Layout, robot: usize, configuration: u64) -> Option<Pose> {
        let places = layout.robots[robot].frames().len() - 1;
        self.robot_segment(layout, robot, configuration, 0, places)
    }

    fn note(&mut self, path: PathBuf) {
        if !self.files.contains(&path) {
            self.files.push(path);
        }
    }
}

/// Sorts rows that came from several files; says whether two are of the same thing.
fn merge<T>(rows: &mut [T], order: impl Fn(&T, &T) -> std::cmp::Ordering) -> bool {
    rows.sort_by(&order);
    rows.windows(2).any(|pair| order(&pair[0], &pair[1]).is_eq())
}
