//! Reading a layout file as a whole.

use std::path::{Path, PathBuf};

use super::cameras::read_camera;
use super::fields::{Fields, Gathered};
use super::model::{Layout, LossSetting, Mount, Observations, PoseSpec, Sensor, SolveSettings, SolvedPose, Units};
use super::poses::{read_pose_spec, read_units};
use super::robots::read_robot;
use super::simulate::{SimulateSettings, read_simulate};
use super::targets::read_target;
use super::yaml::{self, Node, Value};
use super::{names, yaml::YamlError};
use crate::complaint::{Complaint, InputError};

/// No layout, robot or target file is larger than this (bytes); a solution of a large cell is about one megabyte.
const LARGEST_FILE: u64 = 64 << 20;

/// What readers of parts need to know of the whole.
pub(super) struct Context<'a> {
    /// Where to complain.
    pub(super) to: &'a Gathered<'a>,
    /// The layout's units.
    pub(super) units: Units,
    /// The recording's folder.
    pub(super) recording: &'a Path,
    /// The layout's own folder.
    pub(super) folder: &'a Path,
}

impl Context<'_> {
    /// Where a description file (robot, target, lens) is: in the recording or, failing that, beside the layout.
    pub(super) fn resolve(&self, file: &str) -> PathBuf {
        let in_recording = self.recording.join(file);
        if in_recording.exists() { in_recording } else { self.folder.join(file) }
    }

    /// The `pose` of the thing that `fields` describes.
    pub(super) fn read_pose_of(&self, fields: &Fields<'_>) -> Option<PoseSpec> {
        match fields.get("pose") {
            None => Some(PoseSpec::Unknown),
            Some(node) => read_pose_spec(self.to, node, &fields.what, self.units),
        }
    }
}

/// The `mount` of the thing that `fields` describes; the world if it says nothing.
pub(super) fn read_mount(fields: &Fields<'_>) -> Option<Mount> {
    match fields.get("mount") {
        None => Some(Mount { parent: "world".to_owned(), line: fields.line }),
        Some(node) => Some(Mount { parent: fields.text(node, "`mount`")?.to_owned(), line: node.line }),
    }
}

/// The text of a file that a layout names on `line`.
pub(super) fn read_text_file(to: &Gathered<'_>, line: usize, path: &Path) -> Option<String> {
    match read_bounded(path) {
        Ok(text) => {
            to.read.borrow_mut().push(path.to_owned());
            Some(text)
        }
        Err(what) => to.complain(
            line,
            format!("the file `{}` {what}", path.display()),
            "paths are relative to the recording's folder, by default the layout's own",
        ),
    }
}

fn read_bounded(path: &Path) -> Result<String, String> {
    let size = std::fs::metadata(path).map_err(|e| format!("cannot be read: {}", plain(&e)))?.len();
    if size > LARGEST_FILE {
        return Err(format!("is {} MB large; nothing of this kind is", size >> 20));
    }
    std::fs::read_to_string(path).map_err(|e| format!("cannot be read: {}", plain(&e)))
}

/// The operating system's reason in plain words, without its error number.
#[must_use]
pub fn plain(error: &std::io::Error) -> String {
    match error.kind() {
        std::io::ErrorKind::NotFound => "it does not exist".to_owned(),
        std::io::ErrorKind::PermissionDenied => "permission denied".to_owned(),
        std::io::ErrorKind::InvalidData => "it is not text in UTF-8".to_owned(),
        std::io::ErrorKind::IsADirectory => "it is a folder".to_owned(),
        _ => error.to_string(),
    }
}

/// Reads and checks a layout. `recording` is the folder that data files are relative to, by default the layout's own.
///
/// # Errors
/// Every complaint about the layout and about the robot, target and lens files that it names.
pub fn read_layout(file: &Path, recording: Option<&Path>) -> Result<Layout, InputError> {
    let text = read_bounded(file).map_err(|what| {
        Complaint::of(file, format!("the layout {what}"), "give the path of a layout; examples are in `layouts/`")
    })?;
    parse_layout(file, &text, recording)
}

/// As [`read_layout`], from text.
///
/// # Errors
/// As [`read_layout`].
pub fn parse_layout(file: &Path, text: &str, recording: Option<&Path>) -> Result<Layout, InputError> {
    let folder = file.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let recording = recording.unwrap_or(folder);
    let root = yaml::parse(text)
        .map_err(|YamlError { line, what, remedy }| InputError::from(Complaint::at(file, line, what, remedy)))?;
    let to = Gathered::new(file);
    let mut layout = read_root(&to, &root, folder, recording);
    if let Some(layout) = &mut layout {
        names::check(&to, layout);
        layout.files = to.read.take();
    }
    let complaints = to.complaints.into_inner();
    match layout {
        Some(layout) if complaints.is_empty() => Ok(layout),
        _ => Err(InputError(complaints)),
    }
}

fn read_root(to: &Gathered<'_>, root: &Node, folder: &Path, recording: &Path) -> Option<Layout> {
    let fields = Fields::open(to, root, "the layout")?;
    let version = fields.require("cellmap", "1").and_then(|node| fields.whole(node, "`cellmap`", 1, 1));
    let units = read_units(&fields);
    let world = match fields.get("world") {
        Some(node) => fields.text(node, "`world`").map(str::to_owned),
        None => to.complain(
            fields.line,
            "the layout does not define the world",
            "add `world: NAME`: the frame whose pose is the identity, for example a board on the table or `ur3.base`",
        ),
    };
    let context = Context { to, units: units.unwrap_or(Units::SI), recording, folder };
    let cameras = section(to, &fields, "cameras", |name, node| read_camera(&context, name, node));
    let robots = section(to, &fields, "robots", |name, node| read_robot(&context, name, node));
    let sensors = section(to, &fields, "sensors", |name, node| read_sensor(&context, name, node));
    let targets = section(to, &fields, "targets", |name, node| read_target(&context, name, node));
    let observations = match fields.get("observations") {
        None => Some(Observations::default()),
        Some(node) => read_observations(to, node),
    };
    let solve = match fields.get("solve") {
        None => Some(SolveSettings::default()),
        Some(node) => read_solve(to, node, context.units),
    };
    let simulate = match fields.get("simulate") {
        None => Some(SimulateSettings::default()),
        Some(node) => read_simulate(to, node, context.units),
    };
    let solved = match fields.get("solution") {
        None => Some(Vec::new()),
        Some(node) => read_solved(to, node),
    };
    fields.finish();
    version?;
    Some(Layout {
        file: to.file.to_owned(),
        recording: recording.to_owned(),
        units: units?,
        world: world?,
        cameras: cameras?,
        robots: robots?,
        sensors: sensors?,
        targets: targets?,
        files: Vec::new(),
        observations: observations?,
        solve: solve?,
        simulate: simulate?,
        solved: solved?,
    })
}

/// Reads a mapping of names; a name with a fault is complained about and the rest is read all the same.
fn section<T>(
    to: &Gathered<'_>,
    fields: &Fields<'_>,
    key: &'static str,
    mut read: impl FnMut(&str, &Node) -> Option<T>,
) -> Option<Vec<T>> {
    let Some(node) = fields.get(key) else { return Some(Vec::new()) };
    let section = Fields::open(to, node, format!("`{key}`"))?;
    let items: Vec<Option<T>> = section.names().iter().map(|(name, _, node)| read(name, node)).collect();
    items.into_iter().collect()
}

fn read_sensor(context: &Context<'_>, name: &str, node: &Node) -> Option<Sensor> {
    let fields = Fields::open(context.to, node, format!("sensor `{name}`"))?;
    let measures = fields.require("measures", "points").and_then(|node| match node.text() {
        Some("points") => Some(()),
        _ => context.to.complain(
            node.line,
            format!("sensor `{name}` measures something unknown"),
            "write `measures: points`",
        ),
    });
    let mount = read_mount(&fields);
    let pose = context.read_pose_of(&fields);
    let line = fields.line;
    fields.finish();
    measures?;
    Some(Sensor { name: name.to_owned(), line, mount: mount?, pose: pose? })
}

fn read_observations(to: &Gathered<'_>, node: &Node) -> Option<Observations> {
    let fields = Fields::open(to, node, "`observations`")?;
    let read = |key: &'static str| match fields.get(key) {
        None => Some(Vec::new()),
        Some(node) => match &node.value {
            Value::Sequence(items) => items.iter().map(|item| fields.text(item, key).map(str::to_owned)).collect(),
            _ => fields.text(node, key).map(|text| vec![text.to_owned()]),
        },
    };
    let (detections, target_poses) = (read("detections"), read("target_poses"));
    let (points, contacts) = (read("points"), read("contacts"));
    fields.finish();
    Some(Observations {
        detections: detections?,
        target_poses: target_poses?,
        points: points?,
        contacts: contacts?,
        given: true,
    })
}

fn read_solve(to: &Gathered<'_>, node: &Node, units: Units) -> Option<SolveSettings> {
    let fields = Fields::open(to, node, "`solve`")?;
    let defaults = SolveSettings::default();
    let loss = fields.get("loss").map_or(Some(defaults.loss), |node| read_loss(to, node));
    let sigma = |key: &'static str, scale: f64, default: f64| {
        fields.get(key).map_or(Some(default), |node| fields.positive(node, key).map(|value| value * scale))
    };
    let pixel_sigma = sigma("pixel_sigma", 1.0, defaults.pixel_sigma);
    let point_sigma = sigma("point_sigma", units.length, defaults.point_sigma);
    let contact_sigma = sigma("contact_sigma", units.length, defaults.contact_sigma);
    let pose_sigma = match fields.get("pose_sigma") {
        None => Some(defaults.pose_sigma),
        Some(node) => Fields::open(to, node, "`pose_sigma`").and_then(|inner| {
            let read = |key: &'static str, scale: f64| {
                inner.require(key, "3").and_then(|node| inner.positive(node, key)).map(|value| value * scale)
            };
            let (xyz, rotation) = (read("xyz", units.length), read("rotation", units.angle));
            inner.finish();
            Some([xyz?, rotation?])
        }),
    };
    fields.finish();
    Some(SolveSettings {
        loss: loss?,
        pixel_sigma: pixel_sigma?,
        point_sigma: point_sigma?,
        pose_sigma: pose_sigma?,
        contact_sigma: contact_sigma?,
        solver: defaults.solver,
    })
}

fn read_loss(to: &Gathered<'_>, node: &Node) -> Option<LossSetting> {
    let remedy = "write `squared`, `{huber: 1.5}`, `{cauchy: 2}` or `{tukey: 5}`";
    if let Some(text) = node.text() {
        return match text {
            "squared" => Some(LossSetting::Squared),
            _ => to.complain(node.line, format!("the loss `{text}` is unknown"), remedy),
        };
    }
    let fields = Fields::open(to, node, "`loss`")?;
    let mut found = Vec::new();
    let mut read = |key: &'static str, make: fn(f64) -> LossSetting| {
        if let Some(node) = fields.get(key) {
            found.push(fields.positive(node, key).map(make));
        }
    };
    read("huber", LossSetting::Huber);
    read("cauchy", LossSetting::Cauchy);
    read("tukey", LossSetting::Tukey);
    let line = fields.line;
    fields.finish();
    match found[..] {
        [loss] => loss,
        _ => to.complain(line, "`loss` does not name exactly one kind", remedy),
    }
}

/// The standard deviations that a solution carries, so that it can be compared.
fn read_solved(to: &Gathered<'_>, node: &Node) -> Option<Vec<SolvedPose>> {
    let Value::Mapping(entries) = &node.value else {
        return to.complain(
            node.line,
            "`solution` is no mapping",
            "it is written by `cellmap solve`; leave it as it was",
        );
    };
    let Some((_, _, poses)) = entries.iter().find(|(key, _, _)| key == "poses") else { return Some(Vec::new()) };
    let poses = Fields::open(to, poses, "the poses of the solution")?;
    let degree = std::f64::consts::PI / 180.0;
    let solved: Vec<SolvedPose> = poses
        .names()
        .iter()
        .map(|(key, _, node)| {
            let part = |name: &str, scale: f64| -> [Option<f64>; 3] {
                let list = match &node.value {
                    Value::Mapping(entries) => entries.iter().find(|(k, _, _)| k == name).map(|(_, _, node)| node),
                    _ => None,
                };
                let number = |index: usize| match list.map(|node| &node.value) {
                    Some(Value::Sequence(items)) => {
                        let value = items.get(index)?.text()?.parse::<f64>().ok()?;
                        value.is_finite().then_some(value * scale)
                    }
                    _ => None,
                };
                [number(0), number(1), number(2)]
            };
            let (t, r) = (part("sigma_xyz_mm", 1e-3), part("sigma_rotvec_deg", degree));
            SolvedPose { key: key.clone(), sigma: [t[0], t[1], t[2], r[0], r[1], r[2]] }
        })
        .collect();
    Some(solved)
}
