//! Residuals of whole tags, boards and measured poses, with what they may follow.

use nalgebra::{Vector2, Vector3};
use rayon::prelude::*;

use super::residuals::Residuals;
use super::undetermined::Evidence;
use crate::geometry::{Feature, Pose};
use crate::solve::{Block, GroupKind};

/// What is left over of one tag or board in one picture, or of one measured pose.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Response {
    /// The camera's place in the layout.
    pub(super) camera: usize,
    /// Whether it is a measured pose (m) rather than corners (px).
    pub(super) pose: bool,
    /// Index into the plan's configurations.
    pub(super) configuration: usize,
    /// What shares its error.
    pub(super) cluster: u64,
    /// Index into the plan's groups.
    pub(super) group: usize,
    /// m.
    pub(super) distance: f64,
    /// Between the line of sight and the face's normal, rad.
    pub(super) angle: Option<f64>,
    /// In the picture, 0 to 1 each way from the upper left.
    pub(super) place: [f64; 2],
    /// Measured minus computed: right, down (px; m), and how much larger it appears (mean outward shift of its corners, px) or how much farther it
    /// is (m).
    pub(super) value: [f64; 3],
}

/// The responses of a group of the plan, in the order of its blocks.
pub(super) fn responses(evidence: &Evidence<'_>, residuals: &Residuals, index: usize) -> Vec<Response> {
    let group = &evidence.plan.groups[index];
    let blocks = group.blocks.par_iter().zip(&evidence.poses[index]);
    match group.kind {
        GroupKind::Corners { camera } => {
            blocks.flat_map_iter(|(block, pose)| corners(evidence, residuals, index, block, pose, camera)).collect()
        }
        GroupKind::Poses => {
            let camera = evidence.tree.cameras.iter().position(|frame| *frame == group.path.from);
            camera.map_or(Vec::new(), |camera| {
                blocks.flat_map_iter(|(block, pose)| poses_of(evidence, index, block, pose, camera)).collect()
            })
        }
        GroupKind::Points | GroupKind::Contacts => Vec::new(),
    }
}

fn tag_of(feature: &Feature) -> u64 {
    match feature {
        Feature::TagCorner(id, _) => 1 + u64::from(*id),
        Feature::BoardCorner(_) | Feature::Point(_) => 0,
    }
}

fn corners(
    evidence: &Evidence<'_>,
    residuals: &Residuals,
    group: usize,
    block: &Block,
    pose: &Pose,
    camera: usize,
) -> Vec<Response> {
    let Some(lens) = &evidence.layout.cameras[camera].intrinsics else { return Vec::new() };
    let size = lens.size().map(f64::from);
    let m = &evidence.plan.measurements;
    let tag = |i: usize| tag_of(m.feature(i));
    let still = evidence.plan.groups[group].path.is_static();
    let indices: Vec<usize> = (block.start..block.end).collect();
    // One appearance is one target in one picture.
    let appearances = m.appearances(block.start..block.end).map(|(range, _)| range);
    let things = appearances.flat_map(|range| {
        indices[range.start - block.start..range.end - block.start].chunk_by(|a, b| tag(*a) == tag(*b))
    });
    things
        .filter_map(|thing| {
            let kept: Vec<(usize, Vector2<f64>)> =
                thing.iter().filter_map(|i| Some((*i, -Vector2::from(residuals.corner(*i)?)))).collect();
            if kept.len() < 4 {
                return None;
            }
            let count = kept.len() as f64;
            let mean: Vector2<f64> = kept.iter().map(|(_, d)| d).sum::<Vector2<f64>>() / count;
            let centre = kept.iter().map(|(i, _)| Vector2::from(m.pixel(*i))).sum::<Vector2<f64>>() / count;
            let pull = kept.iter().map(|(i, d)| {
                let out = Vector2::from(m.pixel(*i)) - centre;
                out.try_normalize(1e-6).map_or(0.0, |out| out.dot(d))
            });
            let points: Vec<Vector3<f64>> = kept.iter().map(|(i, _)| *pose * Vector3::from(m.place(*i))).collect();
            let middle = points.iter().sum::<Vector3<f64>>() / count;
            let normal = (points[1] - points[0]).cross(&(points[kept.len() - 1] - points[0]));
            let angle = normal.try_normalize(1e-12).map(|n| n.dot(&middle.normalize()).abs().min(1.0).acos());
            let cluster = if still { tag(thing[0]) << 32 } else { block.configuration as u64 };
            Some(Response {
                camera,
                pose: false,
                configuration: block.configuration,
                cluster,
                group,
                distance: middle.norm(),
                angle,
                place: [centre.x / size[0], centre.y / size[1]],
                value: [mean.x, mean.y, pull.sum::<f64>() / count],
            })
        })
        .collect()
}

fn poses_of(evidence: &Evidence<'_>, group: usize, block: &Block, pose: &Pose, camera: usize) -> Vec<Response> {
    let m = &evidence.plan.measurements;
    // A target that stands still before a camera is one cluster: it says nothing of what its error follows.
    let cluster = if evidence.plan.groups[group].path.is_static() { 1 << 32 } else { block.configuration as u64 };
    let one = |measured: &Pose| {
        let apart = measured.translation - pose.translation;
        let sight = pose.translation.try_normalize(1e-9)?;
        Some(Response {
            camera,
            pose: true,
            configuration: block.configuration,
            cluster,
            group,
            distance: pose.translation.norm(),
            angle: None,
            // Without a lens the picture's rim is not known: half a metre to the side at a metre's distance counts as such.
            place: [0.5 + sight.x / sight.z.max(1e-3), 0.5 + sight.y / sight.z.max(1e-3)],
            value: [apart.x, apart.y, apart.dot(&sight)],
        })
    };
    m.poses[block.start..block.end].iter().flatten().filter_map(one).collect()
}
