//! The published method on a recording of corners: each picture gives the pose of both boards, hence one position of the tool in the world; the 15
//! parameters follow from the positions alone.

use nalgebra::{Vector2, Vector3};
use std::collections::BTreeMap;

use crate::geometry::{Feature, Pose};
use crate::identify::{FreeIdentification, Sample, free};
use crate::initialise::poses_from_points;
use crate::layout::Layout;
use crate::recording::{CornerRow, Recording};

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
    let mut pictures: BTreeMap<(usize, u64, u64), Vec<&CornerRow>> = BTreeMap::new();
    for row in &recording.corners {
        pictures.entry((row.camera, row.configuration, row.shot)).or_default().push(row);
    }
    let sample = |((camera, configuration, _), rows): (&(usize, u64, u64), &Vec<&CornerRow>)| {
        let camera_from_world = board(layout, *camera, world, rows)?;
        let camera_from_tool = board(layout, *camera, tool, rows)?;
        let world_point = camera_from_world.inverse() * camera_from_tool.translation;
        let base_from_flange = recording.base_from_flange(layout, robot, *configuration)?;
        Some(Sample { base_from_flange, world_point })
    };
    let samples: Vec<Sample> = pictures.iter().filter_map(sample).collect();
    free(&samples)
}

/// `camera_from_target` from one picture.
fn board(layout: &Layout, camera: usize, target: usize, rows: &[&CornerRow]) -> Option<Pose> {
    let intrinsics = layout.cameras[camera].intrinsics.as_ref()?;
    let geometry = &layout.targets[target].geometry;
    let mut points: Vec<Vector3<f64>> = Vec::new();
    let mut image: Vec<Vector2<f64>> = Vec::new();
    for row in rows.iter().filter(|row| row.target == target && !matches!(row.feature, Feature::Point(_))) {
        if let (Some(place), Ok(ideal)) =
            (geometry.place(&row.feature), intrinsics.undistort(&Vector2::from(row.pixel)))
        {
            points.push(place);
            image.push(ideal);
        }
    }
    if points.len() < FEWEST_CORNERS {
        return None;
    }
    poses_from_points(&points, &image).first().map(|candidate| candidate.pose)
}
