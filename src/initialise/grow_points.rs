//! Growing what is known by points rather than whole poses: what a tracker measures, and single points that cameras see.

use nalgebra::{Vector2, Vector3};

use super::grow::{Growth, Run};
use super::register::{RobotPoint, register_robot, rigid_fit, triangulate};
use crate::frames::{Freedom, Path};
use crate::geometry::Pose;
use crate::solve::GroupKind;

/// Points measured along one path.
pub(super) struct PointRelation {
    pub(super) path: Path,
    /// (configuration, place in the frame at the path's end, measured).
    pub(super) data: Vec<(usize, Vector3<f64>, Vector3<f64>)>,
    pub(super) spent: bool,
}

impl Growth<'_> {
    /// Places an edge from measured points whose paths are otherwise known.
    pub(super) fn place_by_points(&mut self) -> bool {
        let mut pairs: Vec<Vec<(Vector3<f64>, Vector3<f64>)>> = vec![Vec::new(); self.known.len()];
        for relation in &self.points {
            let Some((edge, at, inverse)) = self.single(&relation.path) else { continue };
            let steps = &relation.path.steps;
            for (configuration, place, measured) in &relation.data {
                let near = self.product(&steps[..at], *configuration).inverse() * *measured;
                let far = self.product(&steps[at + 1..], *configuration) * *place;
                pairs[edge].push(if inverse { (near, far) } else { (far, near) });
            }
        }
        for (edge, pairs) in pairs.iter().enumerate().filter(|(_, pairs)| !pairs.is_empty()) {
            let pose = match self.tree.static_edges[edge].freedom {
                Freedom::Translation => {
                    let sum: Vector3<f64> = pairs.iter().map(|(from, to)| to - from).sum();
                    Some(Pose::new(Default::default(), sum / pairs.len() as f64))
                }
                _ => rigid_fit(pairs),
            };
            if let Some(pose) = pose {
                self.set(edge, pose);
                return true;
            }
        }
        false
    }

    /// Places a point that cameras see and whose paths are otherwise known.
    pub(super) fn triangulate_one(&mut self) -> bool {
        let mut rays: Vec<Vec<(Vector3<f64>, Vector3<f64>)>> = vec![Vec::new(); self.known.len()];
        for group in &self.plan.groups {
            let GroupKind::Corners { camera } = group.kind else { continue };
            let Some(intrinsics) = &self.layout.cameras[camera].intrinsics else { continue };
            let Some((edge, at, false)) = self.single(&group.path) else { continue };
            if self.tree.static_edges[edge].freedom != Freedom::Translation {
                continue;
            }
            for block in &group.blocks {
                let parent_from_camera = self.product(&group.path.steps[..at], block.configuration).inverse();
                for i in block.start..block.end {
                    if let Ok(ray) = intrinsics.ray(&Vector2::from(self.plan.measurements.pixel(i))) {
                        rays[edge].push((parent_from_camera.translation, parent_from_camera.rotation * ray));
                    }
                }
            }
        }
        let found = rays.iter().enumerate().find_map(|(edge, rays)| triangulate(rays).map(|place| (edge, place)));
        if let Some((edge, place)) = found {
            self.set(edge, Pose::new(Default::default(), place));
            return true;
        }
        false
    }

    /// Registers a point sensor to a robot whose tool points are unknown.
    pub(super) fn register(&mut self) -> bool {
        for index in 0..self.points.len() {
            if self.points[index].spent {
                continue;
            }
            let Some([(a, b), (c, _)]) =
                self.runs(&self.points[index].path).as_deref().map(<[Run; 2]>::try_from).and_then(Result::ok)
            else {
                continue;
            };
            let first = &self.points[index].path;
            let ends = (first.stops[a], first.stops[b + 1]);
            // Everything that is seen across the same unknown run and the same robot helps.
            let (mut data, mut labels): (Vec<RobotPoint>, Vec<(usize, [u64; 3])>) = (Vec::new(), Vec::new());
            for other in index..self.points.len() {
                let relation = &self.points[other];
                let same = relation.path.steps.len() >= c && relation.path.steps[..c] == first.steps[..c];
                let runs = self.runs(&relation.path);
                if !same || relation.spent || runs.is_none_or(|runs| runs.len() != 2) {
                    continue;
                }
                for (configuration, place, measured) in &relation.data {
                    let label = (other, [place.x, place.y, place.z].map(f64::to_bits));
                    let point = labels.iter().position(|known| *known == label).unwrap_or_else(|| {
                        labels.push(label);
                        labels.len() - 1
                    });
                    let steps = &relation.path.steps;
                    let measured = self.product(&steps[..a], *configuration).inverse() * *measured;
                    data.push(RobotPoint { robot: self.product(&steps[b + 1..c], *configuration), point, measured });
                }
            }
            self.points[index].spent = true;
            if let Some((near, _)) = register_robot(&data, labels.len()) {
                self.relate(ends, near, data.len() as f64);
                return true;
            }
        }
        false
    }
}
