//! The cell in three dimensions, as numbers for the script.

use nalgebra::{Matrix3, Vector2, Vector3};
use serde_json::{Value, json};

use super::ReportInput;
use crate::frames::{Edge, FrameId};
use crate::geometry::target::tag_corners;
use crate::geometry::{Intrinsics, Pose, TargetGeometry};
use crate::solve::UnknownKind;
use crate::workflow::place::Places;

/// Configurations that the slider offers at most, spread evenly.
const MOST_STOPS: usize = 120;

/// Rounds to `decimals` places, to keep the file small.
pub(super) fn round(value: f64, decimals: i32) -> Value {
    let scale = 10f64.powi(decimals);
    let rounded = (value * scale).round() / scale;
    if rounded.is_finite() { json!(rounded) } else { Value::Null }
}

/// Evenly spread indices, no more than `most` of `count`.
pub(super) fn spread(count: usize, most: usize) -> Vec<usize> {
    if count <= most { (0..count).collect() } else { (0..most).map(|i| i * (count - 1) / (most - 1).max(1)).collect() }
}

fn pose(pose: &Pose) -> Value {
    let (t, q) = (pose.translation, pose.rotation.coords);
    Value::Array([t.x, t.y, t.z, q.x, q.y, q.z, q.w].iter().map(|v| round(*v, 5)).collect())
}

fn point(p: &Vector3<f64>) -> Value {
    Value::Array(p.iter().map(|v| round(*v, 5)).collect())
}

/// The scene: frames with their poses, what hangs on them, and how far each is known.
pub(super) fn scene(input: &ReportInput<'_>, places: &Places<'_>) -> Value {
    let s = input.solved;
    let tree = &s.tree;
    let stops = spread(s.plan.configurations.len(), MOST_STOPS);
    let mut frames = Vec::new();
    for (id, frame) in tree.frames.iter().enumerate() {
        let kind = kind(input, id);
        let standing = if places.stands(id) { places.world_from(id, 0) } else { None };
        let moving = (!places.stands(id)).then(|| {
            stops.iter().map(|stop| places.world_from(id, *stop).map_or(Value::Null, |p| pose(&p))).collect::<Vec<_>>()
        });
        frames.push(json!({
            "name": frame.name,
            "kind": kind,
            "parent": frame.parent,
            "pose": standing.map(|p| pose(&p)),
            "poses": moving,
        }));
    }
    let cameras: Vec<Value> = s
        .layout
        .cameras
        .iter()
        .zip(&tree.cameras)
        .map(|(camera, frame)| {
            let corners = camera.intrinsics.as_ref().map(frustum);
            json!({"frame": frame, "corners": corners})
        })
        .collect();
    let targets: Vec<Value> = s
        .layout
        .targets
        .iter()
        .zip(&tree.targets)
        .map(|(target, frame)| json!({"frame": frame, "name": target.name, "outlines": outlines(&target.geometry)}))
        .collect();
    let robots: Vec<Value> = s
        .layout
        .robots
        .iter()
        .zip(&tree.robots)
        .map(|(robot, frames)| json!({"name": robot.name, "frames": frames, "links": frames.len() > 2}))
        .collect();
    let stops: Vec<u64> = stops.iter().map(|stop| s.plan.configurations[*stop]).collect();
    json!({"frames": frames, "cameras": cameras, "targets": targets, "robots": robots, "stops": stops, "ellipsoids": ellipsoids(input)})
}

fn kind(input: &ReportInput<'_>, id: FrameId) -> &'static str {
    let tree = &input.solved.tree;
    if id == 0 {
        "world"
    } else if tree.cameras.contains(&id) {
        "camera"
    } else if tree.targets.contains(&id) {
        "target"
    } else if tree.sensors.contains(&id) {
        "sensor"
    } else if tree.robots.iter().any(|frames| frames.first() == Some(&id)) {
        "base"
    } else if tree.robots.iter().any(|frames| frames.last() == Some(&id)) {
        "flange"
    } else if matches!(tree.frames[id].edge, Edge::Link { .. }) {
        "link"
    } else {
        "part"
    }
}

/// Rays through the picture's corners, at depth one.
fn frustum(lens: &Intrinsics) -> Vec<Value> {
    let [width, height] = lens.size().map(f64::from);
    let corners = [[-0.5, -0.5], [width - 0.5, -0.5], [width - 0.5, height - 0.5], [-0.5, height - 0.5]];
    corners
        .iter()
        .map(|[u, v]| {
            let plane = |u: f64, v: f64| {
                let at = lens.undistort(&Vector2::new(u, v)).ok()?;
                Some(Vector3::new(at.x, at.y, 1.0))
            };
            // A corner that no ray reaches is drawn as if the lens were a pinhole.
            let straight =
                Vector3::new((u - lens.centre()[0]) / lens.focal()[0], (v - lens.centre()[1]) / lens.focal()[1], 1.0);
            point(&plane(*u, *v).unwrap_or(straight))
        })
        .collect()
}

/// Squares and other outlines in the target's frame.
fn outlines(geometry: &TargetGeometry) -> Vec<Value> {
    match geometry {
        TargetGeometry::Tags(faces) => faces
            .iter()
            .filter_map(|face| {
                let pose = face.target_from_tag?;
                Some(Value::Array(tag_corners(face.size).iter().map(|corner| point(&(pose * *corner))).collect()))
            })
            .collect(),
        TargetGeometry::Board { columns, rows, square, .. } => {
            let (x, y) = (*columns as f64 * square, *rows as f64 * square);
            let corners = [[-square, -square], [x, -square], [x, y], [-square, y]];
            vec![Value::Array(corners.iter().map(|[x, y]| point(&Vector3::new(*x, *y, 0.0))).collect())]
        }
        TargetGeometry::Points(_) | TargetGeometry::None => Vec::new(),
    }
}

/// One standard deviation of every found place: the frame, and a matrix that maps the unit sphere to the ellipsoid, metres, world axes.
fn ellipsoids(input: &ReportInput<'_>) -> Vec<Value> {
    let s = input.solved;
    let mut all = Vec::new();
    for (index, edge) in s.tree.static_edges.iter().enumerate() {
        let Some(parent) = s.tree.frames[edge.frame].parent else { continue };
        let covariance = match s.plan.unknowns.edge(index) {
            Some(block) => {
                let block = &s.plan.unknowns.blocks[block];
                if !matches!(block.kind, UnknownKind::Edge(_)) || s.covariance.units().len() < block.start + 3 {
                    continue;
                }
                // Of the child's right perturbation, in mm; the parent's axes are turned by the pose.
                let own: Matrix3<f64> = s.covariance.own(block.start, 3).fixed_view::<3, 3>(0, 0) * 1e-6;
                let r = s.state.static_poses[index].rotation_matrix();
                r * own * r.transpose()
            }
            None => match s.layout.solved.iter().find(|solved| solved.key == edge.key).map(|solved| solved.sigma) {
                Some([Some(x), Some(y), Some(z), ..]) if x + y + z > 0.0 => {
                    Matrix3::from_diagonal(&Vector3::new(x * x, y * y, z * z))
                }
                _ => continue,
            },
        };
        let eigen = covariance.symmetric_eigen();
        let axes = eigen.eigenvectors * Matrix3::from_diagonal(&eigen.eigenvalues.map(|v| v.max(0.0).sqrt()));
        if axes.iter().all(|v| v.is_finite()) && axes.norm() > 0.0 {
            let columns: Vec<Value> =
                (0..3).map(|i| Value::Array(axes.column(i).iter().map(|v| round(*v, 9)).collect())).collect();
            all.push(json!({"frame": edge.frame, "parent": parent, "axes": columns}));
        }
    }
    all
}
