//! The solution: the layout again, with every pose found, and beside it how far each can be trusted.
//!
//! A solution is itself a layout: its poses are fixed ones, its lenses and links the ones found, and the section `solution` holds what a layout
//! has no place for. No time and no thread count stands in it: the same input gives the same bytes.

use std::path::Path;

use super::document::Document;
use super::findings::{fit, parameters, poses, undetermined};
use super::paths::Paths;
use crate::frames::Edge;
use crate::geometry::{Pattern, Pose, TagFace, TargetGeometry};
use crate::layout::{Camera, LossSetting, ModelSource, Motion, Mount, Robot, Target, Units};
use crate::recording::atomic;
use crate::robot::{JointKind, Link, PARAMETERS_PER_LINK};
use crate::workflow::solve::Solved;

/// Writes `path` and, beside it, the same as JSON. A path that ends in `.json` gets JSON alone.
///
/// # Errors
/// When a file cannot be written; older files then stand untouched.
pub fn write(path: &Path, solved: &Solved) -> std::io::Result<()> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let document = document(solved, folder);
    let json = document.to_json()?;
    if path.extension().is_some_and(|e| e == "json") {
        return atomic::write(path, |out| writeln!(out, "{json}"));
    }
    let yaml = document.to_yaml()?;
    atomic::write(path, |out| {
        writeln!(
            out,
            "# Written by cellmap {}. A layout whose poses are the ones found; see `solution` at the end.",
            crate::VERSION
        )?;
        out.write_all(yaml.as_bytes())
    })?;
    atomic::write(&path.with_extension("json"), |out| writeln!(out, "{json}"))
}

/// The whole solution as a document, with paths that hold in `folder`.
#[must_use]
pub fn document(solved: &Solved, folder: &Path) -> Document {
    let layout = &solved.layout;
    let paths = &Paths::new(layout, folder);
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
    let cameras = layout.cameras.iter().enumerate();
    section("cameras", cameras.map(|(i, c)| (c.name.clone(), camera(solved, paths, i, c))).collect());
    let robots = layout.robots.iter().enumerate();
    section("robots", robots.map(|(i, r)| (r.name.clone(), robot(solved, paths, i, r))).collect());
    let sensors = layout.sensors.iter().enumerate();
    let sensor = |(i, s): (usize, &crate::layout::Sensor)| {
        let mut entries = vec![("measures".to_owned(), Document::text("points"))];
        place(&mut entries, &s.mount, solved, solved.tree.sensors[i]);
        (s.name.clone(), Document::Map(entries))
    };
    section("sensors", sensors.map(sensor).collect());
    let targets = layout.targets.iter().enumerate();
    section("targets", targets.map(|(i, t)| (t.name.clone(), target(solved, paths, i, t))).collect());
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
    root.push(("solve".to_owned(), settings(solved)));
    root.push(("solution".to_owned(), found(solved)));
    Document::Map(root)
}

fn number(value: f64) -> Document {
    Document::Number(value)
}

/// A pose in the layout's units.
fn pose_document(pose: &Pose, units: Units) -> Document {
    let t: [f64; 3] = (pose.translation / units.length).into();
    let q = pose.rotation.coords;
    Document::map([("xyz", Document::numbers(&t)), ("quat_xyzw", Document::numbers(&[q.x, q.y, q.z, q.w]))])
}

/// `mount` and `pose` of a thing.
fn place(entries: &mut Vec<(String, Document)>, mount: &Mount, solved: &Solved, frame: usize) {
    if mount.parent != "world" {
        entries.push(("mount".to_owned(), Document::text(&mount.parent)));
    }
    let Edge::Static(edge) = solved.tree.frames[frame].edge else { return };
    let is_world = solved.tree.frames[frame].name == solved.layout.world;
    // A frame that nothing measured stays unknown.
    if !is_world && !solved.unseen.contains(&frame) {
        entries.push(("pose".to_owned(), pose_document(&solved.state.static_poses[edge], solved.layout.units)));
    }
}

fn camera(solved: &Solved, paths: &Paths<'_>, index: usize, camera: &Camera) -> Document {
    let mut entries = Vec::new();
    if let Some(images) = &camera.images {
        entries.push(("images".to_owned(), paths.data(images)));
    }
    if let Some(intrinsics) = &camera.intrinsics {
        let lens = intrinsics.with_parameters(solved.state.lenses[index]);
        let size = lens.size();
        let mut map = vec![
            ("model".to_owned(), Document::text(lens.model().name())),
            ("size".to_owned(), Document::Row(size.iter().map(|s| Document::Whole(u64::from(*s))).collect())),
            ("focal".to_owned(), Document::numbers(&lens.focal())),
            ("centre".to_owned(), Document::numbers(&lens.centre())),
        ];
        if !lens.distortion().is_empty() {
            map.push(("distortion".to_owned(), Document::numbers(lens.distortion())));
        }
        entries.push(("intrinsics".to_owned(), Document::Map(map)));
    }
    place(&mut entries, &camera.mount, solved, solved.tree.cameras[index]);
    Document::Map(entries)
}

fn robot(solved: &Solved, paths: &Paths<'_>, index: usize, robot: &Robot) -> Document {
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
    let corrections = &solved.state.corrections[index];
    if let Motion::Joints { chain, .. } = &robot.motion
        && corrections.iter().any(|c| *c != 0.0)
    {
        let units = solved.layout.units;
        let row = |(link, c): (&Link, &[f64])| {
            let offset = if link.joint == JointKind::Revolute { units.angle } else { units.length };
            Document::numbers(&[c[0] / offset, c[1] / units.length, c[2] / units.length, c[3] / units.angle])
        };
        let rows = chain.links.iter().zip(corrections.chunks_exact(PARAMETERS_PER_LINK)).map(row);
        entries.push(("corrections".to_owned(), Document::List(rows.collect())));
    }
    place(&mut entries, &robot.mount, solved, solved.tree.robots[index][0]);
    Document::Map(entries)
}

fn target(solved: &Solved, paths: &Paths<'_>, index: usize, target: &Target) -> Document {
    let units = solved.layout.units;
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
    // Places that were unknown stand in the solution as found.
    match &target.geometry {
        TargetGeometry::Points(points) if points.iter().any(|(_, place)| place.is_none()) => {
            let places = points.iter().map(|(name, place)| {
                let found =
                    place.map_or_else(|| part(solved, &format!("{}.{name}", target.name)).map(|p| p.translation), Some);
                let value = found.map_or(Document::text("unknown"), |p| {
                    Document::numbers(&[p.x / units.length, p.y / units.length, p.z / units.length])
                });
                (name.clone(), value)
            });
            entries = vec![("points".to_owned(), Document::Map(places.collect()))];
        }
        TargetGeometry::Tags(faces) if faces.iter().any(|face| face.target_from_tag.is_none()) => {
            let one = |face: &TagFace| {
                let pose = face.target_from_tag.or_else(|| part(solved, &format!("{}.tag{}", target.name, face.id)));
                Document::map([
                    ("id", Document::Whole(u64::from(face.id))),
                    ("size", number(face.size / units.length)),
                    ("pose", pose.map_or(Document::text("unknown"), |pose| pose_document(&pose, units))),
                ])
            };
            let all: Vec<Document> = faces.iter().map(one).collect();
            if let Some(Pattern::Tags { dictionary, .. }) = &target.pattern {
                let tags =
                    Document::map([("dictionary", Document::text(dictionary.name())), ("places", Document::List(all))]);
                entries = vec![("tags".to_owned(), tags)];
            }
        }
        _ => {}
    }
    if target.moves {
        entries.push(("moves".to_owned(), Document::Flag(true)));
    }
    place(&mut entries, &target.mount, solved, solved.tree.targets[index]);
    Document::Map(entries)
}

/// The pose of a tag or point that was to be found.
fn part(solved: &Solved, name: &str) -> Option<Pose> {
    let frame = solved.tree.frames.iter().position(|frame| frame.name == name)?;
    match solved.tree.frames[frame].edge {
        Edge::Static(edge) if !solved.unseen.contains(&frame) => Some(solved.state.static_poses[edge]),
        _ => None,
    }
}

fn settings(solved: &Solved) -> Document {
    let (s, units) = (&solved.layout.solve, solved.layout.units);
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

fn found(solved: &Solved) -> Document {
    let mut entries = vec![("poses".to_owned(), Document::Map(poses(solved)))];
    let parameters = parameters(solved);
    if !parameters.is_empty() {
        entries.push(("parameters".to_owned(), Document::Map(parameters)));
    }
    let moving = moving(solved);
    if !moving.is_empty() {
        entries.push(("moving".to_owned(), Document::Map(moving)));
    }
    entries.push(("fit".to_owned(), Document::Map(fit(solved))));
    entries.push(("undetermined".to_owned(), undetermined(solved)));
    let inputs = solved
        .inputs
        .iter()
        .map(|(file, hash)| Document::map([("file", Document::text(file)), ("sha256", Document::text(hash))]));
    entries.push((
        "provenance".to_owned(),
        Document::map([("cellmap", Document::text(crate::VERSION)), ("inputs", Document::List(inputs.collect()))]),
    ));
    Document::Map(entries)
}

/// The poses of targets that move, by configuration.
fn moving(solved: &Solved) -> Vec<(String, Document)> {
    let units = solved.layout.units;
    let edges = solved.tree.moving_edges.iter().enumerate();
    edges
        .map(|(index, edge)| {
            let rows = solved.moved.get(index).into_iter().flatten().map(|&configuration| {
                let pose = &solved.state.moving_poses[index][configuration];
                let t = pose.translation / units.length;
                let q = pose.rotation.coords;
                let id = Document::Whole(solved.plan.configurations[configuration]);
                let mut row = vec![id];
                row.extend([t.x, t.y, t.z, q.x, q.y, q.z, q.w].map(Document::Number));
                Document::Row(row)
            });
            (edge.key.clone(), Document::List(rows.collect()))
        })
        .collect()
}
