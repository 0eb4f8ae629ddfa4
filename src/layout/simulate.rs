//! The `simulate` section: how a recording is made from a layout whose poses are known.

use std::rc::Rc;

use super::fields::{Fields, Gathered, shown};
use super::model::Units;
use super::yaml::{Node, Value};

/// How to simulate. Everything has a default: a section that says nothing gives forty clean configurations.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulateSettings {
    /// Places at which all robots stop, when the path is generated.
    pub configurations: u64,
    /// Pictures a camera takes, or measurements a sensor makes, at each.
    pub shots: u64,
    /// Where joint values come from.
    pub path: PathSource,
    /// How far each joint may go (rad, m), by robot; a robot without an entry turns by 180 degrees either way.
    pub joints: Vec<JointRanges>,
    /// The least height (m) of a robot's links above the plane of its base; none: the robots may be anywhere.
    pub floor: Option<f64>,
    /// Standard deviations of the measurements; none: as the `solve` section believes them to be.
    pub noise: Noise,
    /// Standard deviation of where a robot really stops: translation (m) and rotation (rad) per axis, a draw a robot and configuration.
    pub repeatability: [f64; 2],
    /// The share of pictures, or of a sensor's measurements, that do not exist.
    pub missing: f64,
    /// What goes wrong in real recordings.
    pub outliers: Outliers,
    /// Standard deviations of the real links about the model: joint offsets (rad or m), lengths `a` and `d` (m), twists `alpha` (rad).
    pub link_errors: [f64; 3],
    /// Standard deviations of the real lenses about the layout's: focal lengths (px), centre (px), distortion coefficients.
    pub lens_errors: [f64; 3],
    /// What pictures look like.
    pub picture: PictureSettings,
}

/// Where joint values come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PathSource {
    /// From the robots' files if all are there, else generated.
    #[default]
    Either,
    /// From the robots' files.
    Recorded,
    /// Generated.
    Generated,
}

/// How far the joints of one robot may go.
#[derive(Clone, Debug, PartialEq)]
pub struct JointRanges {
    /// The robot's name.
    pub robot: String,
    /// The line that says so.
    pub line: usize,
    /// Least and greatest value of each joint, in the layout's units of angle: what a unit means depends on the joint.
    pub ranges: Vec<[f64; 2]>,
}

/// Standard deviations of measurements that differ from the `solve` section's.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Noise {
    /// Of a corner per axis, px.
    pub pixel: Option<f64>,
    /// Of a point per axis, m.
    pub point: Option<f64>,
    /// Of a whole pose's translation (m) and rotation vector (rad) per axis.
    pub pose: Option<[f64; 2]>,
}

/// Faults of the kinds that real recordings have.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outliers {
    /// The share of tags that carry another tag's id.
    pub wrong_id: f64,
    /// The share of tags whose corners begin a quarter or half turn off, and of whole poses that are the mirrored solution.
    pub flipped: f64,
    /// The share of tags or boards of which a corner is dragged away, as a shadow or a reflection does.
    pub dragged: f64,
    /// The robot whose joint log is off by one configuration from the middle of the recording on.
    pub shifted_log: Option<(String, usize)>,
    /// A frame (a target or a camera) that somebody bumps at the middle of the recording.
    pub moved: Option<MovedFrame>,
}

/// A thing that moves half-way.
#[derive(Clone, Debug, PartialEq)]
pub struct MovedFrame {
    /// Its name.
    pub frame: String,
    /// The line that says so.
    pub line: usize,
    /// How far it moves, m.
    pub translation: f64,
    /// How far it turns, rad.
    pub rotation: f64,
}

/// What rendered pictures look like.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PictureSettings {
    /// Standard deviation of the defocus, px.
    pub blur: f64,
    /// Length of the motion blur, px; its direction differs from picture to picture.
    pub motion_blur: f64,
    /// Standard deviation of the noise, grey values.
    pub noise: f64,
    /// Brightness: 1 is well exposed.
    pub exposure: f64,
    /// How much darker the corners of a picture are than its middle: 0 to 1.
    pub vignetting: f64,
    /// Walls, floor and things that stand about.
    pub clutter: bool,
    /// Quality of JPEG files, 1 to 100; other kinds have none.
    pub jpeg_quality: u8,
}

impl Default for PictureSettings {
    fn default() -> Self {
        Self {
            blur: 0.7,
            motion_blur: 0.0,
            noise: 2.0,
            exposure: 1.0,
            vignetting: 0.15,
            clutter: true,
            jpeg_quality: 92,
        }
    }
}

impl Default for SimulateSettings {
    fn default() -> Self {
        Self {
            configurations: 40,
            shots: 1,
            path: PathSource::default(),
            joints: Vec::new(),
            floor: Some(0.0),
            noise: Noise::default(),
            repeatability: [0.0; 2],
            missing: 0.0,
            outliers: Outliers::default(),
            link_errors: [0.0; 3],
            lens_errors: [0.0; 3],
            picture: PictureSettings::default(),
        }
    }
}

/// More configurations than any robot drives to.
const MOST: u32 = 1_000_000;

/// A number of at least zero times `scale`; `default` where the key is not there.
fn not_negative(fields: &Fields<'_>, key: &'static str, scale: f64, default: f64) -> Option<f64> {
    let Some(node) = fields.get(key) else { return Some(default) };
    let value = fields.number(node, &format!("`{key}`"))?;
    if value >= 0.0 {
        return Some(value * scale);
    }
    fields.to.complain(node.line, format!("`{key}` of {} is {value}", fields.what), "it must not be negative")
}

/// A share between 0 and 1.
fn share(fields: &Fields<'_>, key: &'static str, default: f64) -> Option<f64> {
    let value = not_negative(fields, key, 1.0, default)?;
    if value <= 1.0 {
        return Some(value);
    }
    fields.to.complain(
        fields.get(key).map_or(fields.line, |node| node.line),
        format!("`{key}` of {} is {value}", fields.what),
        "it is a share: from 0 to 1",
    )
}

/// Reads an inner mapping; its default where it is not there.
fn inner<T>(
    to: &Gathered<'_>,
    fields: &Fields<'_>,
    key: &'static str,
    default: T,
    read: impl FnOnce(&Fields<'_>) -> Option<T>,
) -> Option<T> {
    let Some(node) = fields.get(key) else { return Some(default) };
    let inner = Fields::open(to, node, format!("`{key}` of `simulate`"))?;
    let value = read(&inner);
    inner.finish();
    value
}

/// `{xyz, rotation}` of a pose's noise.
fn pose_noise(fields: &Fields<'_>, units: Units) -> Option<[f64; 2]> {
    let xyz = not_negative(fields, "xyz", units.length, 0.0);
    let rotation = not_negative(fields, "rotation", units.angle, 0.0);
    Some([xyz?, rotation?])
}

pub(super) fn read_simulate(to: &Gathered<'_>, node: &Node, units: Units) -> Option<SimulateSettings> {
    let fields = Fields::open(to, node, "`simulate`")?;
    let defaults = SimulateSettings::default();
    let count = |key: &'static str, default: u64| {
        fields.get(key).map_or(Some(default), |node| fields.whole(node, key, 1, MOST).map(u64::from))
    };
    let (configurations, shots) = (count("configurations", defaults.configurations), count("shots", defaults.shots));
    let path = match fields.get("path") {
        None => Some(PathSource::Either),
        Some(node) => match node.text() {
            Some("recorded") => Some(PathSource::Recorded),
            Some("generated") => Some(PathSource::Generated),
            _ => to.complain(
                node.line,
                format!("`path` of `simulate` is {}", shown(node)),
                "write `recorded` (the robots' own files) or `generated`, or leave it out",
            ),
        },
    };
    let joints = match fields.get("joints") {
        None => Some(Vec::new()),
        Some(node) => read_ranges(to, node),
    };
    let floor = match fields.get("floor") {
        None => Some(defaults.floor),
        Some(node) if node.text() == Some("none") => Some(None),
        Some(node) => fields.number(node, "`floor`").map(|value| Some(value * units.length)),
    };
    let optional = |key: &'static str, scale: f64| match fields.get(key) {
        None => Some(None),
        Some(_) => not_negative(&fields, key, scale, 0.0).map(Some),
    };
    let (pixel, point) = (optional("pixel_sigma", 1.0), optional("point_sigma", units.length));
    let pose = inner(to, &fields, "pose_sigma", None, |fields| pose_noise(fields, units).map(Some));
    let repeatability = inner(to, &fields, "repeatability", defaults.repeatability, |f| pose_noise(f, units));
    let missing = share(&fields, "missing", 0.0);
    let outliers = inner(to, &fields, "outliers", defaults.outliers, |fields| read_outliers(to, fields, units));
    let link_errors = inner(to, &fields, "link_errors", defaults.link_errors, |fields| {
        let offsets = not_negative(fields, "joint_offsets", units.angle, 0.0);
        let lengths = not_negative(fields, "lengths", units.length, 0.0);
        let angles = not_negative(fields, "angles", units.angle, 0.0);
        Some([offsets?, lengths?, angles?])
    });
    let lens_errors = inner(to, &fields, "lens_errors", defaults.lens_errors, |fields| {
        let each = ["focal", "centre", "distortion"].map(|key| not_negative(fields, key, 1.0, 0.0));
        Some([each[0]?, each[1]?, each[2]?])
    });
    let picture = inner(to, &fields, "picture", defaults.picture, read_picture);
    fields.finish();
    Some(SimulateSettings {
        configurations: configurations?,
        shots: shots?,
        path: path?,
        joints: joints?,
        floor: floor?,
        noise: Noise { pixel: pixel?, point: point?, pose: pose? },
        repeatability: repeatability?,
        missing: missing?,
        outliers: outliers?,
        link_errors: link_errors?,
        lens_errors: lens_errors?,
        picture: picture?,
    })
}

fn read_ranges(to: &Gathered<'_>, node: &Node) -> Option<Vec<JointRanges>> {
    let fields = Fields::open(to, node, "`joints` of `simulate`")?;
    let read = |(robot, line, node): &(String, usize, Rc<Node>)| {
        let Value::Sequence(items) = &node.value else {
            return to.complain(
                node.line,
                format!("the joint ranges of `{robot}` are {}", node.kind()),
                "write one `[least, greatest]` a joint",
            );
        };
        let one = |item: &Node| {
            let [least, greatest] = fields.numbers::<2>(item, &format!("a joint range of `{robot}`"))?;
            if least <= greatest {
                return Some([least, greatest]);
            }
            to.complain(
                item.line,
                format!("a joint range of `{robot}` ends before it begins"),
                "write `[least, greatest]`",
            )
        };
        let ranges: Option<Vec<[f64; 2]>> = items.iter().map(|item| one(item)).collect();
        Some(JointRanges { robot: robot.clone(), line: *line, ranges: ranges? })
    };
    fields.names().iter().map(read).collect()
}

fn read_outliers(to: &Gathered<'_>, fields: &Fields<'_>, units: Units) -> Option<Outliers> {
    let shares = ["wrong_id", "flipped", "dragged"].map(|key| share(fields, key, 0.0));
    let shifted_log = match fields.get("shifted_log") {
        None => Some(None),
        Some(node) => fields.text(node, "`shifted_log`").map(|name| Some((name.to_owned(), node.line))),
    };
    let moved = match fields.get("moved") {
        None => Some(None),
        Some(node) => Fields::open(to, node, "`moved` of `outliers`").and_then(|inner| {
            let frame = inner.require("frame", "pallet").and_then(|node| inner.text(node, "`frame`"));
            let by = pose_noise(&inner, units);
            let line = inner.line;
            inner.finish();
            let ([translation, rotation], frame) = (by?, frame?.to_owned());
            Some(Some(MovedFrame { frame, line, translation, rotation }))
        }),
    };
    let [wrong_id, flipped, dragged] = shares;
    Some(Outliers {
        wrong_id: wrong_id?,
        flipped: flipped?,
        dragged: dragged?,
        shifted_log: shifted_log?,
        moved: moved?,
    })
}

fn read_picture(fields: &Fields<'_>) -> Option<PictureSettings> {
    let d = PictureSettings::default();
    let blur = not_negative(fields, "blur", 1.0, d.blur);
    let motion_blur = not_negative(fields, "motion_blur", 1.0, d.motion_blur);
    let noise = not_negative(fields, "noise", 1.0, d.noise);
    let exposure = fields.get("exposure").map_or(Some(d.exposure), |node| fields.positive(node, "`exposure`"));
    let vignetting = share(fields, "vignetting", d.vignetting);
    let clutter = fields.get("clutter").map_or(Some(d.clutter), |node| fields.flag(node, "`clutter`"));
    let quality = fields
        .get("jpeg_quality")
        .map_or(Some(u32::from(d.jpeg_quality)), |node| fields.whole(node, "`jpeg_quality`", 1, 100));
    Some(PictureSettings {
        blur: blur?,
        motion_blur: motion_blur?,
        noise: noise?,
        exposure: exposure?,
        vignetting: vignetting?,
        clutter: clutter?,
        jpeg_quality: quality? as u8,
    })
}
