//! Writing a layout: the inverse of [`super::read_layout`], but for comments.

use super::document::Document;
use super::model::{
    Camera, Description, Layout, LinkParameters, LossSetting, ModelSource, Motion, Mount, PoseSigma, PoseSpec, Robot,
    Target, Units,
};
use super::paths::Paths;
use crate::geometry::{Pattern, Pose, TagFace, TargetGeometry};
use crate::robot::{JointKind, Link, PARAMETERS_PER_LINK, ParameterKind};

/// The sections of a layout, with files named so that they are found from where `paths` says that it will stand. What is
/// unknown stays so; poses are in the layout's units, rotations quaternions, lenses written out.
#[must_use]
pub fn sections(layout: &Layout, paths: &Paths<'_>) -> Vec<(String, Document)> {
    let (length, angle) = layout.units.names();
    let mut root = vec![
        ("cellmap".to_owned(), Document::Whole(1)),
        ("units".to_owned(), Document::map([("length", Document::text(length)), ("angle", Document::text(angle))])),
        ("world".to_owned(), Document::text(&layout.world)),
    ];
    let mut section = |name: &str, entries: Vec<(String, Document)>| {
        if !entries.is_empty() {
            root.push((name.to_owned(), Document::Map(entries)));
        }
    };
    section("cameras", layout.cameras.iter().map(|c| (c.name.clone(), camera(layout, paths, c))).collect());
    section("robots", layout.robots.iter().map(|r| (r.name.clone(), robot(layout, paths, r))).collect());
    let sensor = |s: &super::Sensor| {
        let mut entries = vec![("measures".to_owned(), Document::text("points"))];
        place(&mut entries, layout, &s.name, &s.mount, &s.pose);
        (s.name.clone(), Document::Map(entries))
    };
    section("sensors", layout.sensors.iter().map(sensor).collect());
    section("targets", layout.targets.iter().map(|t| (t.name.clone(), target(layout, paths, t))).collect());
    let files = |list: &[String]| Document::Row(list.iter().map(|file| paths.data(file)).collect());
    let observed = &layout.observations;
    let kinds = [
        ("detections", &observed.detections),
        ("target_poses", &observed.target_poses),
        ("points", &observed.points),
        ("contacts", &observed.contacts),
    ];
    section(
        "observations",
        kinds.into_iter().filter(|(_, list)| !list.is_empty()).map(|(k, list)| (k.to_owned(), files(list))).collect(),
    );
    root.push(("solve".to_owned(), settings(layout)));
    root
}

/// A pose in the layout's units.
#[must_use]
pub fn pose_document(pose: &Pose, units: Units) -> Document {
    Document::Map(pose_entries(pose, units))
}

fn pose_entries(pose: &Pose, units: Units) -> Vec<(String, Document)> {
    let t: [f64; 3] = (pose.translation / units.length).into();
    let q = pose.rotation.coords;
    vec![("xyz".to_owned(), Document::numbers(&t)), ("quat_xyzw".to_owned(), Document::numbers(&[q.x, q.y, q.z, q.w]))]
}

fn number(value: f64) -> Document {
    Document::Number(value)
}

/// `mount` and `pose` of a thing.
fn place(entries: &mut Vec<(String, Document)>, layout: &Layout, frame: &str, mount: &Mount, pose: &PoseSpec) {
    if mount.parent != "world" {
        entries.push(("mount".to_owned(), Document::text(&mount.parent)));
    }
    if frame == layout.world {
        return;
    }
    let with = |pose: &Pose, more: Option<(&str, Document)>| {
        let mut map = pose_entries(pose, layout.units);
        map.extend(more.map(|(key, value)| (key.to_owned(), value)));
        ("pose".to_owned(), Document::Map(map))
    };
    match pose {
        PoseSpec::Unknown => {}
        PoseSpec::Fixed(pose) => entries.push(with(pose, None)),
        PoseSpec::Start(pose) => entries.push(with(pose, Some(("start", Document::Flag(true))))),
        PoseSpec::Hidden(pose) => entries.push(with(pose, Some(("unknown", Document::Flag(true))))),
        PoseSpec::Prior(pose, sigma) => entries.push(with(pose, Some(("sigma", sigma_document(sigma, layout.units))))),
    }
}

fn sigma_document(sigma: &PoseSigma, units: Units) -> Document {
    Document::map([
        ("xyz", Document::numbers(&sigma.translation.map(|s| s / units.length))),
        ("rotation", Document::numbers(&sigma.rotation.map(|s| s / units.angle))),
    ])
}

fn camera(layout: &Layout, paths: &Paths<'_>, camera: &Camera) -> Document {
    let mut entries = Vec::new();
    if let Some(images) = &camera.images {
        entries.push(("images".to_owned(), paths.data(images)));
    }
    if let Some(lens) = &camera.intrinsics {
        let mut map = vec![
            ("model".to_owned(), Document::text(lens.model().name())),
            ("size".to_owned(), Document::Row(lens.size().iter().map(|s| Document::Whole(u64::from(*s))).collect())),
            ("focal".to_owned(), Document::numbers(&lens.focal())),
            ("centre".to_owned(), Document::numbers(&lens.centre())),
        ];
        if !lens.distortion().is_empty() {
            map.push(("distortion".to_owned(), Document::numbers(lens.distortion())));
        }
        entries.push(("intrinsics".to_owned(), Document::Map(map)));
        let groups = super::cameras::refined_groups(lens, &camera.refine);
        if !groups.is_empty() {
            entries.push(("refine".to_owned(), Document::Row(groups.into_iter().map(Document::text).collect())));
        }
    }
    place(&mut entries, layout, &camera.name, &camera.mount, &camera.pose);
    Document::Map(entries)
}

fn robot(layout: &Layout, paths: &Paths<'_>, robot: &Robot) -> Document {
    let mut entries = Vec::new();
    let text = Document::text;
    let model = match &robot.model_source {
        ModelSource::BuiltIn(name) => Some(text(name)),
        ModelSource::Mdh(file) => Some(Document::map([("mdh", paths.description(file))])),
        ModelSource::Dh(file) => Some(Document::map([("dh", paths.description(file))])),
        ModelSource::Urdf(file, base, tip) => {
            Some(Document::map([("urdf", paths.description(file)), ("base", text(base)), ("tip", text(tip))]))
        }
        ModelSource::Reported => None,
    };
    if let Some(model) = model {
        entries.push(("model".to_owned(), model));
    }
    match &robot.motion {
        Motion::Joints { file, .. } => entries.push(("joints".to_owned(), paths.data(file))),
        Motion::FlangePoses { file } => entries.push(("flange_poses".to_owned(), paths.data(file))),
    }
    let units = layout.units;
    if let Motion::Joints { chain, .. } = &robot.motion
        && robot.corrections.iter().any(|c| *c != 0.0)
    {
        let row = |(link, c): (&Link, &[f64])| {
            let offset = if link.joint == JointKind::Revolute { units.angle } else { units.length };
            Document::numbers(&[c[0] / offset, c[1] / units.length, c[2] / units.length, c[3] / units.angle])
        };
        let rows = chain.links.iter().zip(robot.corrections.chunks_exact(PARAMETERS_PER_LINK)).map(row);
        entries.push(("corrections".to_owned(), Document::List(rows.collect())));
    }
    if !robot.identify.is_empty() {
        entries.push(("identify".to_owned(), identify(&robot.identify)));
    }
    if let Some([xyz, rotation]) = robot.repeatability {
        let sigmas = [("xyz", number(xyz / units.length)), ("rotation", number(rotation / units.angle))];
        entries.push(("repeatability".to_owned(), Document::map(sigmas)));
    }
    place(&mut entries, layout, &format!("{}.base", robot.name), &robot.mount, &robot.pose);
    Document::Map(entries)
}

/// `{joint_offsets: {sigma: s}, lengths: {}, angles: {}}`.
fn identify(parameters: &[LinkParameters]) -> Document {
    let key = |kind: ParameterKind| match kind {
        ParameterKind::JointOffset => "joint_offsets",
        ParameterKind::LengthD | ParameterKind::LengthA => "lengths",
        ParameterKind::TwistAlpha => "angles",
    };
    let mut entries: Vec<(String, Document)> = Vec::new();
    for parameter in parameters {
        let name = key(parameter.kind);
        if !entries.iter().any(|(known, _)| known == name) {
            let sigma = parameter.sigma.map(|sigma| ("sigma".to_owned(), number(sigma)));
            entries.push((name.to_owned(), Document::Map(sigma.into_iter().collect())));
        }
    }
    Document::Map(entries)
}

fn target(layout: &Layout, paths: &Paths<'_>, target: &Target) -> Document {
    let mut entries = match Document::from(&target.description) {
        Document::Map(entries) => entries,
        _ => Vec::new(),
    };
    for (key, value) in &mut entries {
        if let (true, Document::Map(inner)) = (key == "tags", value) {
            for (_, file) in inner.iter_mut().filter(|(key, _)| key == "file") {
                if let Document::Text(name) = file {
                    *file = paths.description(name);
                }
            }
        }
    }
    if target.moves {
        entries.push(("moves".to_owned(), Document::Flag(true)));
    }
    place(&mut entries, layout, &target.name, &target.mount, &target.pose);
    Document::Map(entries)
}

/// A geometry in a layout's words: its tags or points one by one, each with its place or `unknown`. `None` for a board, which the layout's own words
/// describe whole.
#[must_use]
pub fn describe_places(geometry: &TargetGeometry, pattern: Option<&Pattern>, units: Units) -> Option<Description> {
    let scalar = |text: String| Description::Scalar { text, quoted: false };
    let numbers = |values: &[f64]| Description::List(values.iter().map(|v| scalar(v.to_string())).collect());
    let unknown = || scalar("unknown".to_owned());
    let map = |entries: Vec<(&str, Description)>| {
        Description::Mapping(entries.into_iter().map(|(key, value)| (key.to_owned(), value)).collect())
    };
    match (geometry, pattern) {
        (TargetGeometry::Points(points), _) => {
            let place = |(name, place): &(String, Option<nalgebra::Vector3<f64>>)| {
                let value = place.map_or_else(unknown, |p| numbers((p / units.length).as_slice()));
                (name.clone(), value)
            };
            Some(map(vec![("points", Description::Mapping(points.iter().map(place).collect()))]))
        }
        (TargetGeometry::Tags(faces), Some(Pattern::Tags { dictionary, .. })) => {
            let one = |face: &TagFace| {
                let pose = face.target_from_tag.map_or_else(unknown, |pose| {
                    let q = pose.rotation.coords;
                    let xyz = numbers((pose.translation / units.length).as_slice());
                    map(vec![("xyz", xyz), ("quat_xyzw", numbers(&[q.x, q.y, q.z, q.w]))])
                });
                let size = scalar((face.size / units.length).to_string());
                map(vec![("id", scalar(face.id.to_string())), ("size", size), ("pose", pose)])
            };
            let places = Description::List(faces.iter().map(one).collect());
            let name = scalar(dictionary.name().to_owned());
            Some(map(vec![("tags", map(vec![("dictionary", name), ("places", places)]))]))
        }
        _ => None,
    }
}

fn settings(layout: &Layout) -> Document {
    let (s, units) = (&layout.solve, layout.units);
    let loss = match s.loss {
        LossSetting::Squared => Document::text("squared"),
        LossSetting::Huber(k) => Document::map([("huber", number(k))]),
        LossSetting::Cauchy(k) => Document::map([("cauchy", number(k))]),
        LossSetting::Tukey(k) => Document::map([("tukey", number(k))]),
    };
    Document::map([
        ("loss", loss),
        ("pixel_sigma", number(s.pixel_sigma)),
        ("point_sigma", number(s.point_sigma / units.length)),
        (
            "pose_sigma",
            Document::map([
                ("xyz", number(s.pose_sigma[0] / units.length)),
                ("rotation", number(s.pose_sigma[1] / units.angle)),
            ]),
        ),
        ("contact_sigma", number(s.contact_sigma / units.length)),
    ])
}
