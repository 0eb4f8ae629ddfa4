//! The published method on a recording of corners: each picture gives the pose of both boards, hence one position of the tool in the world; the 15
//! parameters follow from the positions alone.

use nalgebra::{Vector2, Vector3};
use rayon::prelude::*;

use crate::geometry::{Feature, Pose, TargetGeometry};
use crate::identify::{FreeIdentification, Sample, free};
use crate::initialise::poses_from_points;
use crate::layout::Layout;
use crate::recording::{Appearance, Corners, Recording};

/// A single flat tag has two poses that fit it about equally; two tags of a solid board have one.
const FEWEST_CORNERS: usize = 8;

/// The published method for robot `robot` with the target `world` on which the world stands and the target `tool` on the robot's flange. `None` where too few
/// pictures show both.
#[must_use]
pub fn published(
    layout: &Layout,
    recording: &Recording,
    robot: usize,
    world: usize,
    tool: usize,
) -> Option<FreeIdentification> {
    let samples = samples(layout, recording, robot, world, tool);
    free(&samples.into_iter().map(|(_, sample)| sample).collect::<Vec<_>>())
}

/// The two boards that the published method looks at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Boards {
    /// The robot.
    pub robot: usize,
    /// The target that stands still and whose frame is the method's world.
    pub world: usize,
    /// The target on the robot's flange.
    pub tool: usize,
}

/// The boards of a layout to which the method applies: one on the flange of its first robot that carries one, one that stands still (the world itself
/// if it is a board), each with enough corners for a pose from one picture.
#[must_use]
pub fn boards(layout: &Layout) -> Option<Boards> {
    let enough = |target: &crate::layout::Target| match &target.geometry {
        TargetGeometry::Tags(faces) => {
            faces.iter().filter(|f| f.target_from_tag.is_some()).count() * 4 >= FEWEST_CORNERS
        }
        TargetGeometry::Board { columns, rows, .. } => columns * rows >= FEWEST_CORNERS,
        TargetGeometry::Points(_) | TargetGeometry::None => false,
    };
    let on = |parent: &str| {
        let mut carried =
            layout.targets.iter().enumerate().filter(|(_, t)| !t.moves && t.mount.parent == parent && enough(t));
        let found = carried.clone().find(|(_, t)| t.name == layout.world).or_else(|| carried.next());
        found.map(|(target, _)| target)
    };
    let world = on("world").or_else(|| on(&layout.world))?;
    let (robot, tool) = layout
        .robots
        .iter()
        .enumerate()
        .find_map(|(robot, described)| Some((robot, on(&format!("{}.flange", described.name))?)))?;
    Some(Boards { robot, world, tool })
}

/// The method's measurements with their configurations: the tool board's place on the world board wherever one picture of a camera shows both.
#[must_use]
pub fn samples(layout: &Layout, recording: &Recording, robot: usize, world: usize, tool: usize) -> Vec<(u64, Sample)> {
    let appearances = recording.corners.appearances();
    // Neighbours are of one picture, in the order of cameras, configurations and shots.
    let pictures: Vec<&[Appearance]> = appearances.chunk_by(|a, b| a.picture() == b.picture()).collect();
    let sample = |picture: &&[Appearance]| {
        let (camera, configuration) = (picture[0].camera, picture[0].configuration);
        let board = |target: usize| {
            let one = picture.iter().find(|one| one.target == target)?;
            board(layout, camera, target, &recording.corners, one)
        };
        let (camera_from_world, camera_from_tool) = (board(world)?, board(tool)?);
        let world_point = camera_from_world.inverse() * camera_from_tool.translation;
        let base_from_flange = recording.base_from_flange(layout, robot, configuration)?;
        Some((configuration, Sample { base_from_flange, world_point }))
    };
    pictures.par_iter().map(sample).collect::<Vec<_>>().into_iter().flatten().collect()
}

/// `camera_from_target` from one picture.
fn board(layout: &Layout, camera: usize, target: usize, corners: &Corners, seen: &Appearance) -> Option<Pose> {
    let intrinsics = layout.cameras[camera].intrinsics.as_ref()?;
    let geometry = &layout.targets[target].geometry;
    let mut points: Vec<Vector3<f64>> = Vec::new();
    let mut image: Vec<Vector2<f64>> = Vec::new();
    for corner in seen.corners() {
        let feature = corners.feature(corner);
        if let (Some(place), Ok(ideal), false) = (
            geometry.place(feature),
            intrinsics.undistort(&Vector2::from(corners.pixels()[corner])),
            matches!(feature, Feature::Point(_)),
        ) {
            points.push(place);
            image.push(ideal);
        }
    }
    if points.len() < FEWEST_CORNERS {
        return None;
    }
    poses_from_points(&points, &image).first().map(|candidate| candidate.pose)
}
