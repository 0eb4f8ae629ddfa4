//! Reading poses, units and sigmas.

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

use super::fields::{Fields, Gathered, shown};
use super::model::{ANGLES, LENGTHS, PoseSigma, PoseSpec, Units};
use super::yaml::{Node, Value};
use crate::complaint::list;
use crate::geometry::{Pose, rotation};

/// The rotation keys, of which a pose has exactly one.
const ROTATION_KEYS: [&str; 5] = ["rpy", "rotvec", "quat_xyzw", "quat_wxyz", "matrix"];
/// How far a rotation matrix may be from orthonormal: the rounding of a file with four digits.
const ORTHONORMAL: f64 = 2e-4;
/// How far a quaternion's length may be from one.
const UNIT_LENGTH: f64 = 1e-3;

/// The `units` of a file; both must be said.
pub(super) fn read_units(fields: &Fields<'_>) -> Option<Units> {
    let node = fields.require("units", "{length: mm, angle: deg}")?;
    let units = Fields::open(fields.to, node, "`units`")?;
    let pick = |key: &'static str, known: &[(&'static str, f64)]| {
        let names = || list(known.iter().map(|(name, _)| *name));
        let Some(node) = units.get(key) else {
            let remedy = format!("add `{key}`: one of {}", names());
            return fields.to.complain(units.line, format!("`units` does not say the unit of {key}"), remedy);
        };
        match node.text().and_then(|text| known.iter().find(|(name, _)| *name == text)) {
            Some((_, scale)) => Some(*scale),
            None => fields.to.complain(
                node.line,
                format!("the unit of {key} is {}", shown(node)),
                format!("it is one of {}", names()),
            ),
        }
    };
    let (length, angle) = (pick("length", &LENGTHS), pick("angle", &ANGLES));
    units.finish();
    Some(Units { length: length?, angle: angle? })
}

/// `parent_from_child` as `{xyz, <one rotation key>}`, optionally with one of `sigma`, `start` and `unknown`.
pub(super) fn read_pose_spec(to: &Gathered<'_>, node: &Node, what: &str, units: Units) -> Option<PoseSpec> {
    if node.text() == Some("unknown") {
        return Some(PoseSpec::Unknown);
    }
    let fields = Fields::open(to, node, format!("the pose of {what}"))?;
    let pose = read_pose_parts(&fields, units);
    let start = fields.get("start").map(|node| fields.flag(node, "start"));
    let unknown = fields.get("unknown").map(|node| fields.flag(node, "unknown"));
    let sigma_line = fields.get("sigma").map(|node| (node.line, read_sigma(to, node, what, units)));
    let line = fields.line;
    fields.finish();
    let pose = pose?;
    let given: Vec<&str> =
        [("sigma", sigma_line.is_some()), ("start", start.is_some()), ("unknown", unknown.is_some())]
            .iter()
            .filter(|(_, given)| *given)
            .map(|(key, _)| *key)
            .collect();
    if let [first, second, ..] = given[..] {
        return to.complain(
            sigma_line.map_or(line, |(line, _)| line),
            format!("the pose of {what} has both `{first}` and `{second}`"),
            "`sigma` makes it a prior, `start` a starting value only, `unknown` hides it from the solver: keep one",
        );
    }
    Some(match (start, unknown, sigma_line) {
        (Some(start), ..) if start? => PoseSpec::Start(pose),
        (_, Some(unknown), _) if unknown? => PoseSpec::Hidden(pose),
        (.., Some((_, sigma))) => PoseSpec::Prior(pose, sigma?),
        _ => PoseSpec::Fixed(pose),
    })
}

/// A plain pose, for description files.
pub(super) fn read_pose(to: &Gathered<'_>, node: &Node, what: &str, units: Units) -> Option<Pose> {
    let fields = Fields::open(to, node, what)?;
    let pose = read_pose_parts(&fields, units);
    fields.finish();
    pose
}

fn read_pose_parts(fields: &Fields<'_>, units: Units) -> Option<Pose> {
    let translation = fields.require("xyz", "[0, 0, 0]").and_then(|node| fields.numbers::<3>(node, "`xyz`"));
    let given: Vec<(&'static str, &Node)> =
        ROTATION_KEYS.iter().filter_map(|key| fields.get(key).map(|node| (*key, node))).collect();
    let rotation = match given[..] {
        [] => fields.to.complain(
            fields.line,
            format!("{} has no rotation", fields.what),
            format!("add exactly one of {}", list(ROTATION_KEYS)),
        ),
        [(key, node)] => read_rotation(fields, key, node, units),
        [(first, _), (second, node), ..] => fields.to.complain(
            node.line,
            format!("{} has two rotations, `{first}` and `{second}`", fields.what),
            "keep exactly one of them",
        ),
    };
    Some(Pose::new(rotation?, Vector3::from(translation?) * units.length))
}

fn read_rotation(fields: &Fields<'_>, key: &str, node: &Node, units: Units) -> Option<UnitQuaternion<f64>> {
    match key {
        "rpy" => Some(rotation::from_rpy(fields.numbers::<3>(node, "`rpy`")?.map(|angle| angle * units.angle))),
        "rotvec" => Some(rotation::exp(&(Vector3::from(fields.numbers::<3>(node, "`rotvec`")?) * units.angle))),
        "quat_xyzw" => {
            let [x, y, z, w] = fields.numbers::<4>(node, "`quat_xyzw`")?;
            unit(fields, node, Quaternion::new(w, x, y, z))
        }
        "quat_wxyz" => {
            let [w, x, y, z] = fields.numbers::<4>(node, "`quat_wxyz`")?;
            unit(fields, node, Quaternion::new(w, x, y, z))
        }
        _ => read_matrix(fields, node),
    }
}

fn unit(fields: &Fields<'_>, node: &Node, q: Quaternion<f64>) -> Option<UnitQuaternion<f64>> {
    checked_unit(q).or_else(|| {
        fields.to.complain(
            node.line,
            format!("the quaternion of {} has length {:.4}", fields.what, q.norm()),
            "a rotation has length 1: check the order of the four numbers",
        )
    })
}

/// A quaternion of length one within the rounding of files, normalised.
pub(crate) fn checked_unit(q: Quaternion<f64>) -> Option<UnitQuaternion<f64>> {
    ((q.norm() - 1.0).abs() <= UNIT_LENGTH).then(|| UnitQuaternion::from_quaternion(q))
}

fn read_matrix(fields: &Fields<'_>, node: &Node) -> Option<UnitQuaternion<f64>> {
    let rows: Vec<f64> = match &node.value {
        Value::Sequence(rows) if rows.len() == 3 => {
            let rows: Option<Vec<[f64; 3]>> =
                rows.iter().map(|row| fields.numbers::<3>(row, "a row of `matrix`")).collect();
            rows?.concat()
        }
        _ => fields.numbers::<9>(node, "`matrix`")?.to_vec(),
    };
    let matrix = Matrix3::from_row_slice(&rows);
    let defect = (matrix.transpose() * matrix - Matrix3::identity()).abs().max();
    if defect > ORTHONORMAL || matrix.determinant() < 0.0 {
        let what = format!("the rotation matrix of {} is not orthonormal", fields.what);
        let remedy = if matrix.determinant() < 0.0 {
            "it mirrors (determinant -1): check the signs of one axis".to_owned()
        } else {
            format!(
                "its columns miss length 1 or right angles by {defect:.3}: check for scale, units or a typing error"
            )
        };
        return fields.to.complain(node.line, what, remedy);
    }
    rotation::nearest_rotation(&matrix)
}

fn read_sigma(to: &Gathered<'_>, node: &Node, what: &str, units: Units) -> Option<PoseSigma> {
    let fields = Fields::open(to, node, format!("the sigma of {what}"))?;
    let read = |key: &'static str, scale: f64| {
        let node = fields.require(key, "1")?;
        let values = match &node.value {
            Value::Scalar { .. } => [fields.number(node, key)?; 3],
            _ => fields.numbers::<3>(node, key)?,
        };
        if values.iter().all(|value| *value > 0.0) {
            return Some(values.map(|value| value * scale));
        }
        to.complain(
            node.line,
            format!("`{key}` in the sigma of {what} is not positive"),
            "leave `sigma` out to fix the pose exactly",
        )
    };
    let (translation, rotation) = (read("xyz", units.length), read("rotation", units.angle));
    fields.finish();
    Some(PoseSigma { translation: translation?, rotation: rotation? })
}
