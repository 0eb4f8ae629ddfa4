//! The two layouts of a simulated recording: what is true, and what a solver is told of it.

use nalgebra::Vector3;

use super::random::{Purpose, normal, normal3, stream};
use crate::complaint::Complaint;
use crate::geometry::{Pose, TargetGeometry};
use crate::layout::write::describe_places;
use crate::layout::{Layout, Motion, PoseSpec};
use crate::robot::{PARAMETERS_PER_LINK, ParameterKind};

/// Every pose and place that a simulation of the layout would have to know and does not.
#[must_use]
pub fn missing(layout: &Layout) -> Vec<Complaint> {
    let remedy = "a simulation needs every pose: give it, with `unknown: true` in it if the solver is to find it";
    let mut complaints = Vec::new();
    let mut complain = |line: usize, what: String| complaints.push(Complaint::at(&layout.file, line, what, remedy));
    let mut place = |line: usize, what: String, frame: &str, pose: &PoseSpec| {
        if frame != layout.world && pose.truth().is_none() {
            complain(line, format!("the pose of {what} is not known"));
        }
    };
    for camera in &layout.cameras {
        place(camera.line, format!("camera `{}`", camera.name), &camera.name, &camera.pose);
    }
    for robot in &layout.robots {
        place(robot.line, format!("robot `{}`", robot.name), &format!("{}.base", robot.name), &robot.pose);
    }
    for sensor in &layout.sensors {
        place(sensor.line, format!("sensor `{}`", sensor.name), &sensor.name, &sensor.pose);
    }
    for target in layout.targets.iter().filter(|target| !target.moves) {
        place(target.line, format!("target `{}`", target.name), &target.name, &target.pose);
    }
    for target in &layout.targets {
        match &target.true_geometry {
            TargetGeometry::Tags(faces) => {
                for face in faces.iter().filter(|face| face.target_from_tag.is_none()) {
                    complain(
                        target.line,
                        format!("the place of tag {} on target `{}` is not known", face.id, target.name),
                    );
                }
            }
            TargetGeometry::Points(points) => {
                for (name, _) in points.iter().filter(|(_, place)| place.is_none()) {
                    complain(
                        target.line,
                        format!("the place of point `{name}` on target `{}` is not known", target.name),
                    );
                }
            }
            TargetGeometry::None | TargetGeometry::Board { .. } => {}
        }
    }
    complaints.sort_by_key(|complaint| complaint.line);
    complaints
}

/// Whether the layout says of any pose or place that a solver is to find it. One that does not is a plain description: all of it is then hidden.
#[must_use]
pub fn is_marked(layout: &Layout) -> bool {
    let poses = layout.cameras.iter().map(|c| c.pose).chain(layout.robots.iter().map(|r| r.pose));
    let poses = poses.chain(layout.sensors.iter().map(|s| s.pose)).chain(layout.targets.iter().map(|t| t.pose));
    let mut poses = poses;
    poses.any(|pose| matches!(pose, PoseSpec::Hidden(_) | PoseSpec::Start(_) | PoseSpec::Prior(..)))
        || layout.targets.iter().any(|target| target.geometry != target.true_geometry)
}

/// What is true: every pose fixed where it is, every place known, links and lenses as drawn from the `simulate` section's errors. Files are named as in
/// the layout.
#[must_use]
pub fn truth(layout: &Layout, seed: u64) -> Layout {
    let mut truth = layout.clone();
    let world = layout.world.clone();
    each_pose(&mut truth, |frame, pose| {
        let known = pose.truth().map_or(PoseSpec::Unknown, PoseSpec::Fixed);
        if frame == world { PoseSpec::Fixed(Pose::identity()) } else { known }
    });
    let [focal, centre, distortion] = layout.simulate.lens_errors;
    for (index, camera) in truth.cameras.iter_mut().enumerate() {
        camera.refine.clear();
        let Some(lens) = camera.intrinsics.take() else { continue };
        let mut random = stream(seed, Purpose::Parts, [0, index as u64, 0]);
        let mut parameters = *lens.parameters();
        for (place, value) in parameters.iter_mut().enumerate().take(lens.model().parameter_count()) {
            let sigma = match place {
                0 | 1 => focal,
                2 | 3 => centre,
                _ => distortion,
            };
            *value += sigma * normal(&mut random);
        }
        camera.intrinsics = Some(lens.with_parameters(parameters));
    }
    let [offsets, lengths, angles] = layout.simulate.link_errors;
    for (index, robot) in truth.robots.iter_mut().enumerate() {
        robot.identify.clear();
        let Motion::Joints { .. } = &robot.motion else { continue };
        let mut random = stream(seed, Purpose::Parts, [1, index as u64, 0]);
        for link in robot.corrections.chunks_exact_mut(PARAMETERS_PER_LINK) {
            for (value, kind) in link.iter_mut().zip(ParameterKind::ALL) {
                let sigma = match kind {
                    ParameterKind::JointOffset => offsets,
                    ParameterKind::LengthD | ParameterKind::LengthA => lengths,
                    ParameterKind::TwistAlpha => angles,
                };
                *value += sigma * normal(&mut random);
            }
        }
    }
    for target in &mut truth.targets {
        if target.geometry != target.true_geometry {
            target.geometry = target.true_geometry.clone();
            describe(target, layout.units);
        }
    }
    truth
}

/// What a solver is told: fixed poses as they are, hidden ones not at all, priors off by a draw from their sigma; the nominal lenses and links.
#[must_use]
pub fn told(layout: &Layout, seed: u64) -> Layout {
    let mut told = layout.clone();
    let marked = is_marked(layout);
    let mut index = 0;
    each_pose(&mut told, |_, pose| {
        index += 1;
        match pose {
            PoseSpec::Hidden(_) => PoseSpec::Unknown,
            PoseSpec::Fixed(_) if !marked => PoseSpec::Unknown,
            PoseSpec::Prior(pose, sigma) => {
                let mut random = stream(seed, Purpose::Prior, [index, 0, 0]);
                let shift = normal3(&mut random).component_mul(&Vector3::from(sigma.translation));
                let turn = normal3(&mut random).component_mul(&Vector3::from(sigma.rotation));
                let turn = Pose::from_rotation_vector(&turn).rotation;
                PoseSpec::Prior(Pose::new(turn * pose.rotation, pose.translation + shift), sigma)
            }
            other => other,
        }
    });
    for target in &mut told.targets {
        if target.geometry != target.true_geometry {
            target.true_geometry = target.geometry.clone();
            describe(target, layout.units);
        }
    }
    told
}

/// Replaces the words for a target's geometry by ones that say where each tag or point is, or that it is unknown.
fn describe(target: &mut crate::layout::Target, units: crate::layout::Units) {
    if let Some(words) = describe_places(&target.geometry, target.pattern.as_ref(), units) {
        target.description = words;
    }
}

/// Changes the pose of every camera, robot, sensor and target.
fn each_pose(layout: &mut Layout, mut change: impl FnMut(&str, PoseSpec) -> PoseSpec) {
    for camera in &mut layout.cameras {
        camera.pose = change(&camera.name, camera.pose);
    }
    for robot in &mut layout.robots {
        robot.pose = change(&format!("{}.base", robot.name), robot.pose);
    }
    for sensor in &mut layout.sensors {
        sensor.pose = change(&sensor.name, sensor.pose);
    }
    for target in layout.targets.iter_mut().filter(|target| !target.moves) {
        target.pose = change(&target.name, target.pose);
    }
}
