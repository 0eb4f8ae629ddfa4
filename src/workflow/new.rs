//! `new`: a commented layout to begin with.
//!
//! Every pose in it is marked `unknown: true`: a solver is not told it, but a simulation may use it, so that a new layout can be printed, simulated and
//! solved before anything is bolted down.

use nalgebra::{Matrix3, Vector3};
use thiserror::Error;

use crate::geometry::{Pose, rotation};
use crate::layout::builtin::robot_model;

/// A robot to be written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NewRobot {
    /// Its name.
    pub name: String,
    /// How its flange is known.
    pub model: NewModel,
}

/// How a robot's flange is known.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NewModel {
    /// A built-in model.
    BuiltIn(String),
    /// A URDF file, with base and tip.
    Urdf(String, String, String),
    /// Poses that its controller reports.
    Reported,
}

/// What a target is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NewKind {
    /// A flat board of tags.
    Grid,
    /// One tag.
    Tag,
    /// A cube of tags.
    Cube,
    /// A checkerboard.
    Checkerboard,
    /// A ChArUco board.
    Charuco,
    /// An AprilGrid.
    AprilGrid,
}

impl NewKind {
    /// The words for them.
    pub const ALL: [(&'static str, Self); 6] = [
        ("grid", Self::Grid),
        ("tag", Self::Tag),
        ("cube", Self::Cube),
        ("checkerboard", Self::Checkerboard),
        ("charuco", Self::Charuco),
        ("aprilgrid", Self::AprilGrid),
    ];
}

/// A camera or target: its name, and the flange it hangs on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Placed {
    /// Its name.
    pub name: String,
    /// The frame it hangs on; none for the world.
    pub mount: Option<String>,
}

/// What stands in the new cell.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct NewCell {
    /// Its robots.
    pub robots: Vec<NewRobot>,
    /// Its cameras.
    pub cameras: Vec<Placed>,
    /// Its targets.
    pub targets: Vec<(Placed, NewKind)>,
}

/// Words that describe no cell.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum NewError {
    /// A kind of target that does not exist.
    #[error("`{0}` is no kind of target")]
    Kind(String),
    /// A name that a layout cannot have.
    #[error("the name `{0}` has a character that names cannot have")]
    Name(String),
    /// A robot of which nothing is known.
    #[error("there is no built-in robot `{0}`")]
    Model(String),
    /// A mount that is no robot's.
    #[error("`{0}` is mounted on `{1}`, which is no robot of the cell")]
    Mount(String, String),
    /// A name that is given twice.
    #[error("the name `{0}` is taken")]
    Taken(String),
    /// Nothing to look at.
    #[error("the cell has no target")]
    NoTarget,
}

fn checked(name: &str) -> Result<String, NewError> {
    let fine =
        !name.is_empty() && name != "world" && name.chars().all(|c| c.is_ascii_alphanumeric() || "_-".contains(c));
    if fine { Ok(name.to_owned()) } else { Err(NewError::Name(name.to_owned())) }
}

impl NewCell {
    /// Adds robots from words such as `ur5e`, `left=ur5e` or `arm=reported`.
    ///
    /// # Errors
    /// A model that is not built in, a name that cannot be.
    pub fn add_robots(&mut self, words: &[String]) -> Result<(), NewError> {
        for word in words {
            let (name, model) = word.split_once('=').unwrap_or((word, word));
            let model = match model {
                "reported" => NewModel::Reported,
                _ if robot_model(model).is_some() => NewModel::BuiltIn(model.to_owned()),
                _ => return Err(NewError::Model(model.to_owned())),
            };
            let mut own = checked(name)?;
            let mut count = 2;
            while self.robots.iter().any(|robot| robot.name == own) {
                own = format!("{name}_{count}");
                count += 1;
            }
            self.robots.push(NewRobot { name: own, model });
        }
        Ok(())
    }

    /// Adds cameras from words such as `left` or `wrist@ur5e`.
    ///
    /// # Errors
    /// A mount that is no robot of the cell, a name that cannot be.
    pub fn add_cameras(&mut self, words: &[String]) -> Result<(), NewError> {
        for word in words {
            let placed = self.placed(word)?;
            self.free(&placed.name)?;
            self.cameras.push(placed);
        }
        Ok(())
    }

    /// Adds targets from words such as `table:grid`, `tool:cube@ur5e` or `pallet` (one tag).
    ///
    /// # Errors
    /// A kind that does not exist, a mount that is no robot of the cell, a name that cannot be.
    pub fn add_targets(&mut self, words: &[String]) -> Result<(), NewError> {
        for word in words {
            let (thing, mount) =
                word.split_once('@').map_or((word.as_str(), None), |(thing, mount)| (thing, Some(mount)));
            let (name, kind) = thing.split_once(':').unwrap_or((thing, "tag"));
            let found = NewKind::ALL.iter().find(|(known, _)| *known == kind);
            let (_, kind) = found.ok_or_else(|| NewError::Kind(kind.to_owned()))?;
            let whole = mount.map_or_else(|| name.to_owned(), |mount| format!("{name}@{mount}"));
            let placed = self.placed(&whole)?;
            self.free(&placed.name)?;
            self.targets.push((placed, *kind));
        }
        Ok(())
    }

    fn free(&self, name: &str) -> Result<(), NewError> {
        let robots = self.robots.iter().map(|robot| &robot.name);
        let things =
            self.cameras.iter().chain(self.targets.iter().map(|(placed, _)| placed)).map(|placed| &placed.name);
        if robots.chain(things).any(|known| known == name) { Err(NewError::Taken(name.to_owned())) } else { Ok(()) }
    }

    fn placed(&self, word: &str) -> Result<Placed, NewError> {
        let Some((name, mount)) = word.split_once('@') else { return Ok(Placed { name: checked(word)?, mount: None }) };
        let robot = mount.strip_suffix(".flange").unwrap_or(mount);
        if !self.robots.iter().any(|known| known.name == robot) {
            return Err(NewError::Mount(name.to_owned(), mount.to_owned()));
        }
        Ok(Placed { name: checked(name)?, mount: Some(format!("{robot}.flange")) })
    }

    /// The layout as YAML with comments.
    ///
    /// # Errors
    /// A cell without a target.
    pub fn layout(&self) -> Result<String, NewError> {
        if self.targets.is_empty() {
            return Err(NewError::NoTarget);
        }
        let standing =
            self.targets.iter().find(|(placed, _)| placed.mount.is_none()).map(|(placed, _)| placed.name.clone());
        let world = standing.clone().or_else(|| self.robots.first().map(|robot| format!("{}.base", robot.name)));
        let world = world.unwrap_or_else(|| self.targets[0].0.name.clone());
        // Everything is placed on a table, then told from the world.
        let first = self.targets.iter().find(|(placed, _)| placed.mount.is_none());
        let table_from_world = match first {
            Some((_, kind)) => table_from_target(*kind, 0),
            None => table_from_base(0, self.robots.len()),
        };
        let world_from_table = table_from_world.inverse();
        let mut text = format!(
            "# A workcell. Next: cellmap check, then cellmap print, then record (or cellmap simulate), cellmap detect and cellmap solve.\n\
             # Everything marked `unknown: true` is to be found: the numbers are only for a simulation, and a solver is never told\n\
             # them. In a cell of your own you may leave these poses out. A pose without the mark is taken as exact.\n\
             cellmap: 1\nunits: {{length: mm, angle: deg}}\nworld: {world:<32}# the frame whose pose is the identity\n"
        );
        self.write_cameras(&world_from_table, &mut text);
        self.write_robots(&world, &world_from_table, &mut text);
        self.write_targets(&world, &world_from_table, &mut text);
        text.push_str("solve: {loss: {huber: 1.5}, pixel_sigma: 0.1}\n");
        let built_in = |robot: &&NewRobot| matches!(&robot.model, NewModel::BuiltIn(_));
        text.push_str("simulate:                             # only for `cellmap simulate`\n  configurations: 20\n");
        if self.robots.iter().any(|robot| built_in(&robot)) {
            text.push_str(
                "  joints:                             # where a robot works: least and greatest value of each joint\n",
            );
            for robot in self.robots.iter().filter(built_in) {
                let ranges = if self.robots.len() == 1 {
                    "[[-140, -80], [-125, -75], [85, 135], [-140, -55], [-130, -50], [-65, 110]]"
                } else {
                    "[[-120, 60], [-150, -40], [40, 150], [-200, -20], [-120, -60], [-180, 180]]"
                };
                text.push_str(&format!("    {}: {ranges}\n", robot.name));
            }
        }
        Ok(text)
    }

    fn write_cameras(&self, world_from_table: &Pose, text: &mut String) {
        if self.cameras.is_empty() {
            return;
        }
        text.push_str("cameras:\n");
        let mut standing = 0;
        for camera in &self.cameras {
            text.push_str(&format!(
                "  {0}:\n    images: images/{0}/{{configuration:03}}.png\n    # Put your own lens here; `refine` then improves it.\n    \
                 intrinsics: {{model: brown, size: [1280, 720], focal: [1100, 1100], centre: [639.5, 359.5], distortion: [0, 0, 0, 0, 0]}}\n",
                camera.name
            ));
            match &camera.mount {
                Some(mount) => text.push_str(&format!(
                    "    mount: {mount:<30}# eye-in-hand\n    pose: {{xyz: [0, -75, 20], rpy: [12, 0, 0], unknown: true}}\n"
                )),
                None => {
                    text.push_str(&format!("    # refine: [focal, centre]         # find these too\n    pose: {}\n", words(&(*world_from_table * table_from_camera(standing)))));
                    standing += 1;
                }
            }
        }
    }

    fn write_robots(&self, world: &str, world_from_table: &Pose, text: &mut String) {
        if self.robots.is_empty() {
            return;
        }
        text.push_str("robots:\n");
        for (i, robot) in self.robots.iter().enumerate() {
            text.push_str(&format!("  {}:\n", robot.name));
            match &robot.model {
                NewModel::BuiltIn(model) => text.push_str(&format!(
                    "    model: {model:<30}# built in; or {{mdh: FILE}}, {{urdf: FILE, base: LINK, tip: LINK}}\n    joints: joints.csv                # configuration,robot,q1,q2...\n"
                )),
                NewModel::Urdf(file, base, tip) => text.push_str(&format!(
                    "    model: {{urdf: {}, base: {base}, tip: {tip}}}\n    joints: joints.csv                # configuration,robot,q1,q2...\n",
                    quoted(file)
                )),
                NewModel::Reported => {
                    text.push_str("    flange_poses: flange_poses.csv    # configuration,robot,x,y,z,qx,qy,qz,qw\n");
                }
            }
            if world != format!("{}.base", robot.name) {
                text.push_str(&format!(
                    "    pose: {}\n",
                    words(&(*world_from_table * table_from_base(i, self.robots.len())))
                ));
            }
        }
    }

    fn write_targets(&self, world: &str, world_from_table: &Pose, text: &mut String) {
        text.push_str("targets:\n");
        // Tags are numbered on, so that no two targets share one.
        let (mut next, mut standing) = (0, 0);
        for (placed, kind) in &self.targets {
            text.push_str(&format!("  {}:\n", placed.name));
            let (geometry, board, tags) = match kind {
                NewKind::Grid => (
                    format!(
                        "tags: {{dictionary: 6x6_250, grid: {{columns: 4, rows: 3, size: 42, gap: 12, first_id: {next}}}}}"
                    ),
                    false,
                    12,
                ),
                NewKind::Tag => (format!("tags: {{dictionary: 6x6_250, size: 100, ids: [{next}]}}"), false, 1),
                NewKind::Cube => {
                    let ids: Vec<String> = (next..next + 5).map(|id: u32| id.to_string()).collect();
                    (
                        format!(
                            "tags: {{dictionary: 6x6_250, cube: {{edge: 80, size: 56, ids: [{}]}}}}",
                            ids.join(", ")
                        ),
                        false,
                        5,
                    )
                }
                NewKind::Checkerboard => ("checkerboard: {corners: [8, 5], square: 28}".to_owned(), true, 0),
                NewKind::Charuco => {
                    ("charuco: {squares: [8, 5], square: 30, marker: 22, dictionary: 5x5_100}".to_owned(), true, 0)
                }
                NewKind::AprilGrid => {
                    ("april_grid: {columns: 4, rows: 3, size: 42, spacing: 0.3}".to_owned(), false, 0)
                }
            };
            text.push_str(&format!("    {geometry}\n"));
            next += tags;
            match &placed.mount {
                Some(mount) => {
                    let rpy = if board { "[180, 0, 44]" } else { "[1, -0.5, 44]" };
                    text.push_str(&format!(
                        "    mount: {mount}\n    pose: {{xyz: [2, 3, 110], rpy: {rpy}, unknown: true}}\n"
                    ));
                }
                None => {
                    if placed.name != *world {
                        let pose = *world_from_table * table_from_target(*kind, standing);
                        text.push_str(&format!("    pose: {}\n", words(&pose)));
                    }
                    standing += 1;
                }
            }
        }
    }
}

/// A path in YAML, in quotes where it needs them.
fn quoted(text: &str) -> String {
    let plain = text.chars().all(|c| c.is_ascii_alphanumeric() || "_-./".contains(c));
    if plain { text.to_owned() } else { format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\"")) }
}

/// A pose in a layout's words, rounded to what a tape measure gives.
fn words(pose: &Pose) -> String {
    let tenth = |value: f64| (value * 10.0).round() / 10.0 + 0.0;
    let (t, rpy) =
        (pose.translation.map(tenth), rotation::to_rpy(&pose.rotation).map(|angle| tenth(angle.to_degrees())));
    format!("{{xyz: [{}, {}, {}], rpy: [{}, {}, {}], unknown: true}}", t.x, t.y, t.z, rpy[0], rpy[1], rpy[2])
}

/// A pose (mm, deg) on the table.
fn at(xyz: [f64; 3], rpy: [f64; 3]) -> Pose {
    Pose::new(rotation::from_rpy(rpy.map(f64::to_radians)), Vector3::from(xyz))
}

/// Cameras stand around the table and look at its middle.
fn table_from_camera(index: usize) -> Pose {
    let angle = [-128.0, -40.0, 50.0, 140.0, -85.0, 5.0][index % 6_usize];
    let angle = f64::to_radians(angle + 11.0 * (index / 6) as f64);
    let at = Vector3::new(1150.0 * angle.cos(), 1050.0 * angle.sin(), 1000.0);
    let z = (Vector3::new(0.0, 150.0, 100.0) - at).normalize();
    let x = z.cross(&Vector3::z()).normalize();
    Pose::new(rotation::from_matrix(&Matrix3::from_columns(&[x, z.cross(&x), z])), at)
}

/// Robots stand around the table too.
fn table_from_base(index: usize, count: usize) -> Pose {
    if count == 1 {
        return at([120.0, 420.0, -35.0], [0.4, -0.3, 31.0]);
    }
    let angle = std::f64::consts::PI * (1.0 + 2.0 * index as f64 / count as f64);
    at([650.0 * angle.cos(), 650.0 * angle.sin() + 100.0, -20.0], [0.3, -0.2, angle.to_degrees() - 168.0])
}

/// Targets lie on it; the first in its middle. A board's frame looks into the board.
fn table_from_target(kind: NewKind, standing: usize) -> Pose {
    let board = matches!(kind, NewKind::Checkerboard | NewKind::Charuco);
    let over = if board { 180.0 } else { 0.0 };
    match standing.checked_sub(1) {
        None => at([0.0, 0.0, 0.0], [over, 0.0, 0.0]),
        Some(next) => {
            let place =
                [[-330.0, 60.0, 40.0], [320.0, 60.0, 30.0], [-250.0, -260.0, 25.0], [260.0, -280.0, 20.0]][next % 4];
            at(place, [over + 2.0, 1.0, 25.0])
        }
    }
}
