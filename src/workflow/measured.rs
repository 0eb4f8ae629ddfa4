//! What each picture says of each target, against the solution.
//!
//! A picture's corners alone place its target before the camera; with the camera where the solution has it, that is where this picture sees the
//! target. The paper compares that with where the robot carries it, path by path. Starting at the solution, the
//! picture's own pose is a few Gauss-Newton steps away, without the two-fold ambiguity of a plane.

use nalgebra::{Matrix6, Vector3, Vector6};

use super::place::Places;
use crate::frames::FrameId;
use crate::geometry::lens::{Lens, with_lens};
use crate::geometry::{LensModel, Pose};
use crate::solve::{Assembler, GroupKind, Priors};

/// One target in one picture, or one measured point.
#[derive(Clone, Debug)]
pub(crate) struct Sight {
    /// The camera or sensor.
    pub(crate) by: FrameId,
    /// The target, tag or point.
    pub(crate) of: FrameId,
    /// Index into the plan's configurations.
    pub(crate) configuration: usize,
    /// `world_from_target` as this picture sees it.
    pub(crate) measured: Pose,
    /// `world_from_target` as the solution has it.
    pub(crate) computed: Pose,
    /// Whether the rotation was measured too.
    pub(crate) turned: bool,
}

/// Everything that was accepted, in the order of the plan.
pub(crate) fn sights(places: &Places<'_>) -> Vec<Sight> {
    let s = places.solved;
    let mut assembler = Assembler::new(&s.layout, places.recording, &s.plan, Priors::default());
    let poses = assembler.block_poses(&s.state);
    drop(assembler);
    let m = &s.plan.measurements;
    let mut all = Vec::new();
    for (group, poses) in s.plan.groups.iter().zip(&poses) {
        let (by, of) = (group.path.from, group.path.to);
        for (block, sensor_from_target) in group.blocks.iter().zip(poses) {
            let configuration = block.configuration;
            let Some(world_from_sensor) = places.world_from(by, configuration) else { continue };
            let computed = world_from_sensor * *sensor_from_target;
            let sight = |measured: Pose, turned| Sight { by, of, configuration, measured, computed, turned };
            match group.kind {
                GroupKind::Corners { camera } => {
                    for (range, _) in m.appearances(block.start..block.end) {
                        let corners: Vec<usize> = range.filter(|i| m.is_kept(*i)).collect();
                        if let Some(pose) = own_pose(places, camera, &corners, sensor_from_target) {
                            all.push(sight(world_from_sensor * pose, true));
                        }
                    }
                }
                GroupKind::Poses => {
                    let measured = m.poses[block.start..block.end].iter().flatten();
                    all.extend(measured.map(|pose| sight(world_from_sensor * *pose, true)));
                }
                GroupKind::Points => {
                    for (place, seen) in m.points[block.start..block.end].iter().flatten() {
                        let at = |p: Vector3<f64>| Pose { translation: p, ..Pose::identity() };
                        let computed = at(computed * *place);
                        let measured = at(world_from_sensor * *seen);
                        all.push(Sight { by, of, configuration, measured, computed, turned: false });
                    }
                }
                GroupKind::Contacts => {}
            }
        }
    }
    all
}

/// `camera_from_target` that fits these corners best, from the solution's; none for fewer than four corners or if it wanders off.
fn own_pose(places: &Places<'_>, camera: usize, corners: &[usize], start: &Pose) -> Option<Pose> {
    if corners.len() < 4 {
        return None;
    }
    let s = places.solved;
    let m = &s.plan.measurements;
    let model = s.layout.cameras[camera].intrinsics.as_ref().map_or(LensModel::Pinhole, |lens| lens.model());
    let lens = &s.state.lenses[camera];
    let mut pose = *start;
    for _ in 0..4 {
        let (mut hessian, mut gradient) = (Matrix6::zeros(), Vector6::zeros());
        let turn = pose.rotation_matrix().transpose();
        for &i in corners {
            let place = Vector3::from(m.place(i));
            let point: [f64; 3] = (pose * place).into();
            let projection = with_lens!(model, L => L::project_with_derivatives(lens, &point))?;
            for axis in 0..2 {
                let along = turn * Vector3::from(projection.by_point[axis]);
                let about = place.cross(&along);
                let row = Vector6::new(along.x, along.y, along.z, about.x, about.y, about.z);
                let residual = projection.pixel[axis] - m.pixel(i)[axis];
                hessian += row * row.transpose();
                gradient += row * residual;
            }
        }
        let step = -hessian.cholesky()?.solve(&gradient);
        pose = pose.retract(&step);
        if step.norm() < 1e-9 {
            break;
        }
    }
    let (moved, turned) = (start.inverse() * pose).magnitude();
    (pose.is_finite() && moved < 0.5 && turned < 0.5).then_some(pose)
}
