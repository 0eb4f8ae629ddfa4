//! A solved cell as a layout: everything that was found in the place of what was unknown.

use super::solve::Solved;
use crate::frames::Edge;
use crate::geometry::{Pose, TargetGeometry};
use crate::layout::write::describe_places;
use crate::layout::{Layout, PoseSpec};

/// The layout with everything that was found in the place of what was unknown. A frame that nothing measured stays unknown.
#[must_use]
pub fn solved_layout(solved: &Solved) -> Layout {
    let mut layout = solved.layout.clone();
    let pose = |frame: usize, spec: PoseSpec| match solved.tree.frames[frame].edge {
        _ if solved.unseen.contains(&frame) => PoseSpec::Unknown,
        Edge::Static(edge) => PoseSpec::Fixed(solved.state.static_poses[edge]),
        _ => spec,
    };
    for (index, camera) in layout.cameras.iter_mut().enumerate() {
        camera.intrinsics = camera.intrinsics.take().map(|lens| lens.with_parameters(solved.state.lenses[index]));
        camera.refine.clear();
        camera.pose = pose(solved.tree.cameras[index], camera.pose);
    }
    for (index, robot) in layout.robots.iter_mut().enumerate() {
        robot.corrections.clone_from(&solved.state.corrections[index]);
        robot.identify.clear();
        robot.pose = pose(solved.tree.robots[index][0], robot.pose);
    }
    for (index, sensor) in layout.sensors.iter_mut().enumerate() {
        sensor.pose = pose(solved.tree.sensors[index], sensor.pose);
    }
    for (index, target) in layout.targets.iter_mut().enumerate() {
        target.pose = pose(solved.tree.targets[index], target.pose);
        let name = target.name.clone();
        let mut filled = false;
        match &mut target.geometry {
            TargetGeometry::Points(points) => {
                for (point, place) in points.iter_mut().filter(|(_, place)| place.is_none()) {
                    filled = true;
                    *place = part(solved, &format!("{name}.{point}")).map(|pose| pose.translation);
                }
            }
            TargetGeometry::Tags(faces) => {
                for face in faces.iter_mut().filter(|face| face.target_from_tag.is_none()) {
                    filled = true;
                    face.target_from_tag = part(solved, &format!("{name}.tag{}", face.id));
                }
            }
            TargetGeometry::None | TargetGeometry::Board { .. } => {}
        }
        if let (true, Some(words)) = (filled, describe_places(&target.geometry, target.pattern.as_ref(), layout.units))
        {
            target.description = words;
        }
    }
    layout
}

/// The pose of a tag or point that was to be found.
fn part(solved: &Solved, name: &str) -> Option<Pose> {
    let frame = solved.tree.frames.iter().position(|frame| frame.name == name)?;
    match solved.tree.frames[frame].edge {
        Edge::Static(edge) if !solved.unseen.contains(&frame) => Some(solved.state.static_poses[edge]),
        _ => None,
    }
}
