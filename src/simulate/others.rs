//! Whole poses and points as other instruments would report them, from truth and noise.

use nalgebra::Vector3;

use super::cell::Cell;
use super::random::{Purpose, normal3, stream};
use crate::geometry::{Feature, Pose, TargetGeometry};
use crate::recording::{PointRow, PoseRow};

/// `camera_from_target` of every target from every camera that has no lens and is therefore known through whole poses alone, in every shot. `sigma` is
/// the noise of the translation (m) and of the rotation vector (rad) per axis. Sorted by [`PoseRow::key`].
#[must_use]
pub fn whole_poses(
    cell: &Cell<'_>,
    configurations: &[u64],
    shots: std::ops::Range<u64>,
    sigma: [f64; 2],
    seed: u64,
) -> Vec<PoseRow> {
    let mut rows = Vec::new();
    for camera in (0..cell.layout.cameras.len()).filter(|camera| cell.layout.cameras[*camera].intrinsics.is_none()) {
        for target in 0..cell.layout.targets.len() {
            if matches!(cell.layout.targets[target].true_geometry, TargetGeometry::Points(_)) {
                continue;
            }
            for &configuration in configurations {
                let frames = (cell.tree.cameras[camera], cell.tree.targets[target]);
                let Some(pose) = cell.pose(frames.0, frames.1, configuration) else { continue };
                for shot in shots.clone() {
                    let which = [configuration, shot, (camera as u64) << 32 | target as u64];
                    let mut random = stream(seed, Purpose::Measurement, which);
                    let shift = normal3(&mut random) * sigma[0];
                    let turn = Pose::from_rotation_vector(&(normal3(&mut random) * sigma[1])).rotation;
                    let pose = Pose::new(pose.rotation * turn, pose.translation + shift);
                    rows.push(PoseRow { configuration, shot, camera, target, pose });
                }
            }
        }
    }
    rows.sort_by(|a, b| a.key().cmp(&b.key()));
    rows
}

/// Every named point as every sensor measures it, in every shot, with `sigma` (m) of noise per axis. Sorted by [`PointRow::key`].
#[must_use]
pub fn points(
    cell: &Cell<'_>,
    configurations: &[u64],
    shots: std::ops::Range<u64>,
    sigma: f64,
    seed: u64,
) -> Vec<PointRow> {
    let mut rows = Vec::new();
    for sensor in 0..cell.layout.sensors.len() {
        for (target, described) in cell.layout.targets.iter().enumerate() {
            let TargetGeometry::Points(named) = &described.true_geometry else { continue };
            for &configuration in configurations {
                let frames = (cell.tree.sensors[sensor], cell.tree.targets[target]);
                let Some(pose) = cell.pose(frames.0, frames.1, configuration) else { continue };
                for shot in shots.clone() {
                    // Sensors and cameras count apart.
                    let which = [configuration, shot, 1 << 63 | (sensor as u64) << 32 | target as u64];
                    let mut random = stream(seed, Purpose::Measurement, which);
                    for (name, place) in named {
                        let noise: Vector3<f64> = normal3(&mut random) * sigma;
                        let Some(place) = place else { continue };
                        let position = pose * *place + noise;
                        let feature = Feature::Point(name.clone());
                        rows.push(PointRow { configuration, shot, sensor, target, feature, position });
                    }
                }
            }
        }
    }
    rows.sort_by(|a, b| a.key().cmp(&b.key()));
    rows
}
