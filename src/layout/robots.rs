//! Reading robots: entries of a layout and robot model files.

use std::path::Path;

use super::builtin;
use super::fields::{Fields, Gathered};
use super::model::{LinkParameters, ModelSource, Motion, Robot, Units};
use super::poses::{read_pose, read_units};
use super::read::{Context, read_mount, read_text_file};
use super::yaml::{self, Node, Value};
use crate::complaint::{Complaint, list, nearest};
use crate::geometry::Pose;
use crate::robot::{Chain, JointKind, Link, LinkShape, PARAMETERS_PER_LINK, ParameterKind, urdf};

pub(super) fn read_robot(context: &Context<'_>, name: &str, node: &Node) -> Option<Robot> {
    let to = context.to;
    let fields = Fields::open(to, node, format!("robot `{name}`"))?;
    let model = fields.get("model");
    let joints = fields.get("joints").map(|node| fields.text(node, "`joints`"));
    let flange_poses = fields.get("flange_poses").map(|node| fields.text(node, "`flange_poses`"));
    let mount = read_mount(&fields);
    let pose = context.read_pose_of(&fields);
    let corrections = fields.get("corrections");
    let identify = fields.get("identify").map(|node| read_identify(to, name, node));
    let repeatability = fields.get("repeatability").map(|node| read_repeatability(context, name, node));
    let line = fields.line;
    let motion = match (model, joints, flange_poses) {
        (Some(model), Some(joints), None) => {
            let model = read_model(context, name, model);
            model.zip(joints).map(|((chain, source), file)| (Motion::Joints { chain, file: file.to_owned() }, source))
        }
        (None, None, Some(file)) => {
            file.map(|file| (Motion::FlangePoses { file: file.to_owned() }, ModelSource::Reported))
        }
        (Some(_), None, None) => to.complain(
            line,
            format!("robot `{name}` has a model but no `joints`"),
            "add `joints: joints.csv`, or give `flange_poses:` in place of the model",
        ),
        (None, Some(_), None) => to.complain(
            line,
            format!("robot `{name}` has joint values but no `model`"),
            "add `model: ur5e`, `model: {mdh: FILE}` or `model: {urdf: FILE, base: LINK, tip: LINK}`",
        ),
        (None, None, None) => to.complain(
            line,
            format!("robot `{name}` has neither `model` and `joints` nor `flange_poses`"),
            "say how its flange is known",
        ),
        _ => to.complain(
            line,
            format!("robot `{name}` has both joint values and `flange_poses`"),
            "keep `model` with `joints`, or `flange_poses` alone",
        ),
    };
    fields.finish();
    let identify = identify.unwrap_or(Some(Vec::new()));
    let repeatability = repeatability.map_or(Some(None), |read| read.map(Some))?;
    let (motion, model_source) = motion?;
    let identify = identify?;
    let corrections = match (corrections, &motion) {
        (Some(node), _) => read_corrections(to, name, node, &motion, context.units)?,
        (None, Motion::Joints { chain, .. }) => vec![0.0; chain.joint_count() * PARAMETERS_PER_LINK],
        (None, Motion::FlangePoses { .. }) => Vec::new(),
    };
    if !identify.is_empty() && matches!(motion, Motion::FlangePoses { .. }) {
        return to.complain(
            line,
            format!("robot `{name}` is to be identified but has no kinematic model"),
            "give `model` and `joints`",
        );
    }
    let name = name.to_owned();
    let (mount, pose) = (mount?, pose?);
    Some(Robot { name, line, motion, mount, pose, identify, repeatability, corrections, model_source })
}

/// `{xyz, rotation}`: both positive, since a robot that stops exactly needs no such key.
fn read_repeatability(context: &Context<'_>, name: &str, node: &Node) -> Option<[f64; 2]> {
    let fields = Fields::open(context.to, node, format!("`repeatability` of robot `{name}`"))?;
    let read = |key: &'static str, scale: f64| {
        let node = fields.require(key, "0.05")?;
        Some(fields.positive(node, &format!("`{key}`"))? * scale)
    };
    let (xyz, rotation) = (read("xyz", context.units.length), read("rotation", context.units.angle));
    fields.finish();
    Some([xyz?, rotation?])
}

fn read_identify(to: &Gathered<'_>, name: &str, node: &Node) -> Option<Vec<LinkParameters>> {
    let fields = Fields::open(to, node, format!("`identify` of robot `{name}`"))?;
    let families: [(&'static str, &[ParameterKind]); 3] = [
        ("joint_offsets", &[ParameterKind::JointOffset]),
        ("lengths", &[ParameterKind::LengthD, ParameterKind::LengthA]),
        ("angles", &[ParameterKind::TwistAlpha]),
    ];
    let mut wanted = Vec::new();
    let mut fine = true;
    for (key, kinds) in families {
        let Some(node) = fields.get(key) else { continue };
        let Some(inner) = Fields::open(to, node, format!("`{key}` of robot `{name}`")) else {
            fine = false;
            continue;
        };
        let sigma = match inner.get("sigma") {
            None => None,
            Some(node) => match inner.positive(node, "`sigma`") {
                Some(sigma) => Some(sigma),
                None => {
                    fine = false;
                    None
                }
            },
        };
        inner.finish();
        wanted.extend(kinds.iter().map(|&kind| LinkParameters { kind, sigma }));
    }
    fields.finish();
    fine.then_some(wanted)
}

/// What an earlier solution found of the links: one `[offset, d, a, alpha]` a joint.
fn read_corrections(to: &Gathered<'_>, name: &str, node: &Node, motion: &Motion, units: Units) -> Option<Vec<f64>> {
    let remedy = "write one `[offset, d, a, alpha]` a joint, as `cellmap solve` does";
    let (Motion::Joints { chain, .. }, Value::Sequence(rows)) = (motion, &node.value) else {
        return to.complain(node.line, format!("the corrections of robot `{name}` do not fit its links"), remedy);
    };
    if rows.len() != chain.joint_count() {
        return to.complain(
            node.line,
            format!("robot `{name}` has {} joints but {} rows of corrections", chain.joint_count(), rows.len()),
            remedy,
        );
    }
    let rows: Option<Vec<Vec<f64>>> = rows
        .iter()
        .map(|row| super::fields::number_list(to, row, &format!("a correction of robot `{name}`")))
        .collect();
    let mut values = Vec::new();
    for (row, link) in rows?.iter().zip(&chain.links) {
        let [offset, d, a, alpha] = row[..] else {
            return to.complain(
                node.line,
                format!("a row of the corrections of robot `{name}` has {} numbers", row.len()),
                remedy,
            );
        };
        let scale = if link.joint == JointKind::Revolute { units.angle } else { units.length };
        values.extend([offset * scale, d * units.length, a * units.length, alpha * units.angle]);
    }
    Some(values)
}

/// A built-in name, `{mdh: FILE}`, `{dh: FILE}` or `{urdf: FILE, base:, tip:}`.
fn read_model(context: &Context<'_>, name: &str, node: &Node) -> Option<(Chain, ModelSource)> {
    let to = context.to;
    if let Some(text) = node.text() {
        let Some(source) = builtin::robot_model(text) else {
            let known = builtin::robot_names();
            let remedy = match nearest(text, known.clone()) {
                Some(meant) => format!("did you mean `{meant}`?"),
                None => {
                    format!("built in are {}; or give `{{mdh: FILE}}` or `{{urdf: FILE, base:, tip:}}`", list(known))
                }
            };
            return to.complain(node.line, format!("robot `{name}` has the unknown model `{text}`"), remedy);
        };
        let file = Path::new("built-in").join(format!("{text}.yaml"));
        return match parse_model(&file, source, None) {
            Ok(chain) => Some((chain, ModelSource::BuiltIn(text.to_owned()))),
            Err(complaints) => to.adopt(complaints),
        };
    }
    let fields = Fields::open(to, node, format!("the model of robot `{name}`"))?;
    let (mdh, dh, urdf) = (fields.get("mdh"), fields.get("dh"), fields.get("urdf"));
    let (base, tip) = (fields.get("base"), fields.get("tip"));
    let result = match (mdh, dh, urdf) {
        (Some(node), None, None) => fields.text(node, "`mdh`").and_then(|file| {
            read_model_file(context, node.line, file, "mdh").map(|chain| (chain, ModelSource::Mdh(file.to_owned())))
        }),
        (None, Some(node), None) => fields.text(node, "`dh`").and_then(|file| {
            read_model_file(context, node.line, file, "dh").map(|chain| (chain, ModelSource::Dh(file.to_owned())))
        }),
        (None, None, Some(node)) => {
            let file = fields.text(node, "`urdf`");
            let base = base.and_then(|node| fields.text(node, "`base`"));
            let tip = tip.and_then(|node| fields.text(node, "`tip`"));
            match (file, base, tip) {
                (Some(file), Some(base), Some(tip)) => read_urdf(context, node.line, file, base, tip),
                _ => to.complain(
                    fields.line,
                    format!("the URDF model of robot `{name}` does not say which links to use"),
                    "write `{urdf: FILE, base: base_link, tip: tool0}`",
                ),
            }
        }
        _ => to.complain(
            fields.line,
            format!("the model of robot `{name}` does not name exactly one file"),
            "write `{mdh: FILE}`, `{dh: FILE}` or `{urdf: FILE, base: LINK, tip: LINK}`",
        ),
    };
    fields.finish();
    result
}

fn read_urdf(context: &Context<'_>, line: usize, file: &str, base: &str, tip: &str) -> Option<(Chain, ModelSource)> {
    let path = context.resolve(file);
    match urdf::read_chain(&path, base, tip) {
        Ok(chain) => {
            context.to.read.borrow_mut().push(path);
            Some((chain, ModelSource::Urdf(file.to_owned(), base.to_owned(), tip.to_owned())))
        }
        Err(error) => {
            let remedy = match &error {
                urdf::UrdfError::NoSuchLink { name, links } => match nearest(name, links.iter().map(String::as_str)) {
                    Some(meant) => format!("did you mean `{meant}`?"),
                    None => format!("its links are {}", list(links.iter().map(String::as_str))),
                },
                urdf::UrdfError::NotAChain { .. } => "name a base above the tip".to_owned(),
                urdf::UrdfError::UnsupportedJoint(_) => {
                    "use fixed, revolute, continuous and prismatic joints only".to_owned()
                }
                urdf::UrdfError::Unreadable(_) => format!("check the file `{}`", path.display()),
            };
            context.to.complain(line, error.to_string(), remedy)
        }
    }
}

fn read_model_file(context: &Context<'_>, line: usize, file: &str, convention: &'static str) -> Option<Chain> {
    let path = context.resolve(file);
    let text = read_text_file(context.to, line, &path)?;
    match parse_model(&path, &text, Some(convention)) {
        Ok(chain) => Some(chain),
        Err(complaints) => context.to.adopt(complaints),
    }
}

/// Parses a robot model file. `expected` is the convention that the layout says the file has.
///
/// # Errors
/// Everything that is wrong with the file.
pub fn parse_model(file: &Path, text: &str, expected: Option<&str>) -> Result<Chain, Vec<Complaint>> {
    let root = yaml::parse(text).map_err(|e| vec![Complaint::at(file, e.line, e.what, e.remedy)])?;
    let to = Gathered::new(file);
    let chain = parse_model_node(&to, &root, expected);
    let complaints = to.complaints.into_inner();
    match chain {
        Some(chain) if complaints.is_empty() => Ok(chain),
        _ => Err(complaints),
    }
}

fn parse_model_node(to: &Gathered<'_>, root: &Node, expected: Option<&str>) -> Option<Chain> {
    let fields = Fields::open(to, root, "the robot model")?;
    let version = fields.require("cellmap_robot", "1").and_then(|node| fields.whole(node, "`cellmap_robot`", 1, 1));
    let units = read_units(&fields);
    let convention = fields.require("convention", "mdh").and_then(|node| {
        let text = fields.text(node, "`convention`")?;
        if !["mdh", "dh"].contains(&text) {
            return to.complain(
                node.line,
                format!("the convention is `{text}`"),
                "it is `mdh` (Craig) or `dh` (classic)",
            );
        }
        match expected {
            Some(expected) if expected != text => to.complain(
                node.line,
                format!("the layout calls this an `{expected}` file but its convention is `{text}`"),
                format!("write `{{{text}: FILE}}` in the layout"),
            ),
            _ => Some(text),
        }
    });
    let units_or_si = units.unwrap_or(Units::SI);
    let frame = |key: &'static str| match fields.get(key) {
        None => Some(Pose::identity()),
        Some(node) => read_pose(to, node, &format!("`{key}`"), units_or_si),
    };
    let (base, flange) = (frame("base"), frame("flange"));
    let rows = fields.require("joints", "[{alpha: 0, a: 0, theta: 0, d: 0.1}]");
    fields.finish();
    let (_, units, convention, rows) = (version?, units?, convention?, rows?);
    let Value::Sequence(rows) = &rows.value else {
        return to.complain(rows.line, "`joints` is no list", "write one `{alpha, a, theta, d}` a joint");
    };
    if rows.is_empty() {
        return to.complain(root.line, "the robot has no joints", "write one `{alpha, a, theta, d}` a joint");
    }
    let links: Vec<Option<Link>> = rows
        .iter()
        .enumerate()
        .map(|(index, row)| {
            let fields = Fields::open(to, row, format!("joint {}", index + 1))?;
            let read = |key: &'static str, scale: f64| {
                fields.require(key, "0").and_then(|node| fields.number(node, key)).map(|value| value * scale)
            };
            let numbers = [
                read("alpha", units.angle),
                read("a", units.length),
                read("theta", units.angle),
                read("d", units.length),
            ];
            let joint = match fields.get("type").map(|node| (node.line, node.text())) {
                None | Some((_, Some("revolute"))) => Some(JointKind::Revolute),
                Some((_, Some("prismatic"))) => Some(JointKind::Prismatic),
                Some((line, _)) => to.complain(line, "this joint's type is unknown", "it is `revolute` or `prismatic`"),
            };
            fields.finish();
            let [alpha, a, theta, d] = numbers;
            let numbers = [alpha?, a?, theta?, d?];
            let shape = if convention == "mdh" { LinkShape::Mdh(numbers) } else { LinkShape::Dh(numbers) };
            Some(Link { shape, joint: joint? })
        })
        .collect();
    let links: Option<Vec<Link>> = links.into_iter().collect();
    Some(Chain { base_from_first: base?, links: links?, last_from_flange: flange? })
}
