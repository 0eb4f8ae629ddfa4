//! What each cluster of measurements says of the shared unknowns, of a factor on each camera's distance to each target, and of one on its focal length.
//!
//! A factor `1 + s` on the translation of `sensor_from_target` is, seen by a camera, a target smaller by that factor; for a measured pose it is a wrong
//! ruler. Its derivative is a twist at the path's end like any other: `R^T t` along the translation. So the equations of a solve are set up once more with
//! one more column a camera and target, from the blocks' small matrices ([`crate::solve::kernels`]), cluster by cluster.

use nalgebra::{DMatrix, DVector, Vector3};
use rayon::prelude::*;
use std::collections::BTreeMap;

use super::scale::ScaleKind;
use super::sightings::step_value;
use super::undetermined::Evidence;
use crate::frames::{FrameId, Path, Step};
use crate::geometry::lens::{Lens, with_lens};
use crate::geometry::pose::Twist;
use crate::geometry::{LensModel, Pose};
use crate::layout::Motion;
use crate::recording::RobotMotion;
use crate::solve::kernels::{self, Condensed};
use crate::solve::{Block, Group, GroupKind, Loss, UnknownKind};

/// An added column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Added {
    pub(super) kind: ScaleKind,
    /// Who measures.
    pub(super) from: FrameId,
    /// What is measured; of a focal length, which is the same for all targets, the camera itself.
    pub(super) to: FrameId,
    pub(super) column: usize,
}

/// What one cluster says.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Term {
    /// Columns, ascending; those after the shared ones are factors on distances.
    pub(super) columns: Vec<usize>,
    /// `J^T W J` over them.
    pub(super) information: DMatrix<f64>,
    /// `J^T W r`.
    pub(super) gradient: DVector<f64>,
}

/// The clusters (one a configuration, and one for what stands still before a sensor that stands still) and the added columns; none where
/// targets move by themselves or touch, whose unknowns are no shared ones.
pub(super) fn terms(evidence: &Evidence<'_>) -> Option<(Vec<Term>, Vec<Added>)> {
    let plan = evidence.plan;
    let moving = |group: &Group| group.path.steps.iter().any(|step| matches!(step, Step::Moving { .. }));
    if plan.groups.iter().any(|group| moving(group) || group.kind == GroupKind::Contacts) {
        return None;
    }
    let mut added: Vec<Added> = Vec::new();
    let mut work: BTreeMap<u64, Vec<Work<'_>>> = BTreeMap::new();
    for (index, (group, poses)) in plan.groups.iter().zip(evidence.poses).enumerate() {
        let column = matches!(group.kind, GroupKind::Corners { .. } | GroupKind::Poses).then(|| {
            let column = plan.unknowns.count + added.len();
            added.push(Added { kind: ScaleKind::Distances, from: group.path.from, to: group.path.to, column });
            column
        });
        let focal = focal_column(evidence, group, &mut added);
        let still = group.path.is_static();
        for (block, pose) in group.blocks.iter().zip(poses) {
            let cluster = if still { 1 << 40 | index as u64 } else { block.configuration as u64 };
            work.entry(cluster).or_default().push((group, block, pose, [column, focal]));
        }
    }
    // Cluster by cluster, so that the parts of all blocks never stand side by side.
    let clusters: Vec<Vec<Work<'_>>> = work.into_values().collect();
    let one = |work: &Vec<Work<'_>>| {
        let part = |(group, block, pose, added): &Work<'_>| part(evidence, group, block, pose, *added);
        let parts: Vec<Part> = work.iter().filter_map(part).collect();
        (!parts.is_empty()).then(|| gathered(&parts))
    };
    Some((clusters.par_iter().filter_map(one).collect(), added))
}

/// The column of a camera's focal length, unless that is sought anyway.
fn focal_column(evidence: &Evidence<'_>, group: &Group, added: &mut Vec<Added>) -> Option<usize> {
    let GroupKind::Corners { camera } = group.kind else { return None };
    if evidence.layout.cameras[camera].refine.iter().any(|place| *place < 2) {
        return None;
    }
    let from = group.path.from;
    let known = added.iter().find(|column| column.kind == ScaleKind::Focal && column.from == from);
    Some(known.map(|column| column.column).unwrap_or_else(|| {
        let column = evidence.plan.unknowns.count + added.len();
        added.push(Added { kind: ScaleKind::Focal, from, to: from, column });
        column
    }))
}

/// A block, where it is seen, and its added columns (distance, focal length).
type Work<'a> = (&'a Group, &'a Block, &'a Pose, [Option<usize>; 2]);

/// A block over its own columns, residual last.
struct Part {
    columns: Vec<usize>,
    matrix: DMatrix<f64>,
}

fn gathered(parts: &[Part]) -> Term {
    let mut columns: Vec<usize> = parts.iter().flat_map(|part| part.columns.iter().copied()).collect();
    columns.sort_unstable();
    columns.dedup();
    let k = columns.len();
    let (mut information, mut gradient) = (DMatrix::zeros(k, k), DVector::zeros(k));
    for part in parts {
        let at: Vec<usize> = part.columns.iter().map(|c| columns.binary_search(c).unwrap_or(0)).collect();
        let last = at.len();
        for (i, &a) in at.iter().enumerate() {
            gradient[a] += part.matrix[(i, last)];
            for (j, &b) in at.iter().enumerate() {
                information[(a, b)] += part.matrix[(i, j)];
            }
        }
    }
    Term { columns, information, gradient }
}

fn part(evidence: &Evidence<'_>, group: &Group, block: &Block, pose: &Pose, added: [Option<usize>; 2]) -> Option<Part> {
    let (m, s) = (&evidence.plan.measurements, &evidence.plan.settings);
    let range = block.start..block.end;
    let mut condensed = Condensed::default();
    let mut lens: (&[usize], usize) = (&[], 0);
    match group.kind {
        GroupKind::Corners { camera } => {
            if let Some(place) = evidence.plan.unknowns.lens(camera)
                && let UnknownKind::Lens { places, .. } = &evidence.plan.unknowns.blocks[place].kind
            {
                lens = (places, evidence.plan.unknowns.blocks[place].start);
            }
            corners(evidence, camera, range, pose, &mut condensed);
        }
        GroupKind::Poses => {
            kernels::condense_poses(&m.poses[range], pose, s.pose_sigma, (Loss::Squared, false), &mut condensed)
        }
        GroupKind::Points => {
            kernels::condense_points(&m.points[range], pose, s.point_sigma, (Loss::Squared, false), &mut condensed)
        }
        GroupKind::Contacts => return None,
    }
    let mut twists = path_columns(evidence, &group.path, block.configuration)?;
    if let Some(column) = added[0] {
        let along = pose.rotation.inverse() * pose.translation;
        twists.push((column, Twist::new(along.x, along.y, along.z, 0.0, 0.0, 0.0)));
    }
    let mut columns: Vec<usize> = twists.iter().map(|(column, _)| *column).collect();
    columns.extend((0..lens.0.len()).map(|i| lens.1 + i));
    columns.extend(added[1]);
    // From (twist, lens, residual) to the block's own columns.
    let last = condensed.size - 1;
    let mut map = DMatrix::zeros(condensed.size, columns.len() + 1);
    for (j, (_, twist)) in twists.iter().enumerate() {
        map.view_mut((0, j), (6, 1)).copy_from(twist);
    }
    for (i, place) in lens.0.iter().enumerate() {
        map[(6 + place, twists.len() + i)] = 1.0;
    }
    if let (Some(_), GroupKind::Corners { camera }) = (added[1], group.kind) {
        for place in 0..2 {
            map[(6 + place, columns.len() - 1)] = evidence.state.lenses[camera][place];
        }
    }
    map[(last, columns.len())] = 1.0;
    let small = DMatrix::from_fn(condensed.size, condensed.size, |i, j| condensed.matrix[i.min(j)][i.max(j)]);
    Some(Part { columns, matrix: map.transpose() * small * map })
}

/// Condenses a block's corners over the twist, the whole lens and the residual.
fn corners(evidence: &Evidence<'_>, camera: usize, range: std::ops::Range<usize>, pose: &Pose, out: &mut Condensed) {
    let m = &evidence.plan.measurements;
    let parameters = &evidence.state.lenses[camera];
    let model = evidence.layout.cameras[camera].intrinsics.as_ref().map_or(LensModel::Pinhole, |lens| lens.model());
    let turn = pose.rotation_matrix().transpose();
    with_lens!(model, L => {
        let size = 7 + <L as Lens>::COUNT;
        out.size = size;
        for i in range {
            let [a, b, c] = m.whitener(i);
            let place = Vector3::from(m.place(i));
            let seen = L::project_with_derivatives(parameters, &(*pose * place).into());
            let (true, Some(at)) = (a != 0.0, seen) else { continue };
            let off = [at.pixel[0] - m.pixel(i)[0], at.pixel[1] - m.pixel(i)[1]];
            for [wu, wv] in [[a, 0.0], [b, c]] {
                let along = turn * (Vector3::from(at.by_point[0]) * wu + Vector3::from(at.by_point[1]) * wv);
                let about = place.cross(&along);
                let mut row = [0.0; kernels::WIDEST];
                row[..3].copy_from_slice(along.as_slice());
                row[3..6].copy_from_slice(about.as_slice());
                for (k, (u, v)) in at.by_parameter[0].iter().zip(&at.by_parameter[1]).enumerate().take(size - 7) {
                    row[6 + k] = wu * u + wv * v;
                }
                row[size - 1] = wu * off[0] + wv * off[1];
                for i in 0..size {
                    for j in i..size {
                        out.matrix[i][j] += row[i] * row[j];
                    }
                }
            }
        }
    });
}

/// The twist at the path's end per unit of each shared unknown on the way (`A Exp(d) B = A B Exp(Ad(B^-1) d)`).
fn path_columns(evidence: &Evidence<'_>, path: &Path, configuration: usize) -> Option<Vec<(usize, Twist)>> {
    let unknowns = &evidence.plan.unknowns;
    let mut columns = Vec::new();
    let mut after = Pose::identity();
    for step in path.steps.iter().rev() {
        let with = step_value(evidence, step, configuration)? * after;
        let adjoint = |inverse: bool| if inverse { -with.inverse_adjoint() } else { after.inverse_adjoint() };
        match *step {
            Step::Static { edge, inverse } => {
                if let Some(block) = unknowns.edge(edge) {
                    let (block, adjoint) = (&unknowns.blocks[block], adjoint(inverse));
                    columns.extend((0..block.count()).map(|c| (block.start + c, adjoint.column(c).into_owned())));
                }
            }
            Step::Robot { robot, from, to, inverse } => {
                if let Some(block) = unknowns.links(robot)
                    && let UnknownKind::Links { places, .. } = &unknowns.blocks[block].kind
                    && let Motion::Joints { chain, .. } = &evidence.layout.robots[robot].motion
                    && let RobotMotion::Joints(values) = &evidence.recording.motions[robot]
                {
                    let joints = values.get(&evidence.plan.configurations[configuration])?;
                    let corrections = &evidence.state.corrections[robot];
                    let links = chain.segment_with_parameters(joints, corrections, from, to, places).1;
                    let (start, adjoint) = (unknowns.blocks[block].start, adjoint(inverse));
                    columns.extend((0..places.len()).map(|c| (start + c, adjoint * links.column(c))));
                }
            }
            Step::Moving { .. } => return None,
        }
        after = with;
    }
    Some(columns)
}
