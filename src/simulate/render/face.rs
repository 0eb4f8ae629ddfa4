//! One flat face of a body, and what a pixel sees of it.

use nalgebra::Vector3;

use super::coverage::{Footprint, Grid};
use super::rays::Ray;
use super::texture::{Finish, Textures};
use crate::geometry::Pose;

/// One surface of a body in a pixel.
#[derive(Clone, Copy, Debug)]
pub struct Patch {
    /// The part of the pixel covered.
    pub covered: f64,
    /// Reflectance times covered part.
    pub tone: f64,
    /// Distance along the ray, m.
    pub depth: f64,
    /// Outward normal.
    pub normal: Vector3<f64>,
}

/// A face of a box turned towards the camera or the light.
#[derive(Debug)]
pub struct Face<'a> {
    printed: Option<&'a Grid>,
    pub(super) half: [f64; 2],
    pub(super) origin: Vector3<f64>,
    pub(super) axes: [Vector3<f64>; 3],
    /// With a ray's direction d: x = (by_x . d) / (normal . d), and so for y.
    by_x: Vector3<f64>,
    by_y: Vector3<f64>,
    /// Lengths of the two, to bound how wide a pixel is on the face.
    lengths: [f64; 2],
    /// Along the normal from the camera to the plane; negative if the camera is before the face.
    pub(super) depth: f64,
    tone: f32,
    finish: Finish,
}

impl<'a> Face<'a> {
    pub(super) fn new(
        printed: Option<&'a Grid>,
        half: [f64; 2],
        origin: Vector3<f64>,
        axes: [Vector3<f64>; 3],
        tone: f32,
        finish: Finish,
    ) -> Self {
        let depth = axes[2].dot(&origin);
        let by_x = axes[0] * depth - axes[2] * axes[0].dot(&origin);
        let by_y = axes[1] * depth - axes[2] * axes[1].dot(&origin);
        Face { printed, half, origin, axes, by_x, by_y, lengths: [by_x.norm(), by_y.norm()], depth, tone, finish }
    }

    /// An endless plane through a frame's x and y axes, facing along its z.
    #[must_use]
    pub fn plane(camera_from_plane: &Pose, tone: f32, finish: Finish) -> Self {
        let turn = camera_from_plane.rotation_matrix();
        let axes = [0, 1, 2].map(|i| turn.column(i).into_owned());
        Self::new(None, [f64::INFINITY; 2], camera_from_plane.translation, axes, tone, finish)
    }

    /// Whether none of the rays between four at the corners of a small part of the picture meets the face; may say no too often.
    pub(super) fn misses(&self, corners: &[Vector3<f64>; 4]) -> bool {
        if self.depth >= 0.0 {
            return true;
        }
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for direction in corners {
            let slope = self.axes[2].dot(direction);
            if slope > -1e-6 {
                return false;
            }
            for (axis, by) in [&self.by_x, &self.by_y].into_iter().enumerate() {
                let at = by.dot(direction) / slope;
                (low[axis], high[axis]) = (low[axis].min(at), high[axis].max(at));
            }
        }
        // Room for the outer half of the pixels, and for what a lens bends a line within so small a part.
        (0..2).any(|i| {
            let room = 0.15 * (high[i] - low[i]);
            low[i] - room > self.half[i] || high[i] + room < -self.half[i]
        })
    }

    /// How far along a ray the face's plane is met from the front.
    #[must_use]
    pub fn distance(&self, direction: &Vector3<f64>) -> Option<f64> {
        let slope = self.axes[2].dot(direction);
        (self.depth < 0.0 && slope < -1e-9).then(|| self.depth / slope)
    }

    /// The plane in a pixel that it fills.
    #[must_use]
    pub fn plane_patch(&self, ray: &Ray, textures: &Textures) -> Option<Patch> {
        let (footprint, depth) = self.footprint(ray)?;
        let tone = f64::from(self.tone * textures.sample(self.finish, &footprint));
        Some(Patch { covered: 1.0, tone, depth, normal: self.axes[2] })
    }

    /// Where a ray meets the face's plane, if from the front and not surely beside the face.
    #[inline]
    fn footprint(&self, ray: &Ray) -> Option<(Footprint, f64)> {
        if self.depth >= 0.0 {
            return None;
        }
        let normal = &self.axes[2];
        let slope = normal.dot(&ray.direction);
        // Seen edge-on within the pixel: nothing of it is visible.
        if slope + ray.width >= 0.0 {
            return None;
        }
        let scale = 1.0 / slope;
        let centre = [self.by_x.dot(&ray.direction) * scale, self.by_y.dot(&ray.direction) * scale];
        let is_beside = |axis: usize| {
            let beside = centre[axis].abs() - self.half[axis];
            beside > 0.0 && beside > (self.lengths[axis] + centre[axis].abs()) * ray.width * -scale
        };
        if is_beside(0) || is_beside(1) {
            return None;
        }
        let (turn_right, turn_down) = (normal.dot(&ray.right), normal.dot(&ray.down));
        let right = [
            (self.by_x.dot(&ray.right) - centre[0] * turn_right) * scale,
            (self.by_y.dot(&ray.right) - centre[1] * turn_right) * scale,
        ];
        let down = [
            (self.by_x.dot(&ray.down) - centre[0] * turn_down) * scale,
            (self.by_y.dot(&ray.down) - centre[1] * turn_down) * scale,
        ];
        Some((Footprint { centre, right, down }, self.depth * scale))
    }

    pub(super) fn patch(&self, ray: &Ray, textures: &Textures) -> Option<Patch> {
        let (footprint, depth) = self.footprint(ray)?;
        let [hx, hy] = self.half;
        let (covered, tone) = if let Some(grid) = self.printed {
            grid.mean(&footprint)?
        } else {
            let Footprint { centre, right, down } = &footprint;
            let (sx, sy) = (0.5 * (right[0].abs() + down[0].abs()), 0.5 * (right[1].abs() + down[1].abs()));
            let (x, y) = (centre[0].abs(), centre[1].abs());
            if x - sx >= hx || y - sy >= hy {
                return None;
            }
            let covered = if x + sx <= hx && y + sy <= hy {
                1.0
            } else {
                Grid::plain([-hx, -hy], [hx, hy], 1.0).mean(&footprint)?.0
            };
            (covered, covered * f64::from(self.tone * textures.sample(self.finish, &footprint)))
        };
        Some(Patch { covered, tone, depth, normal: self.axes[2] })
    }
}
