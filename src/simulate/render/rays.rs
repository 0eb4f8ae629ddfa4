//! The ray of every pixel of a camera.
//!
//! Inverting a lens costs far more than anything else that is done for a pixel, and a lens never changes: so it is done once a camera. Single precision keeps
//! a ray to 5e-5 px.

use nalgebra::{Vector2, Vector3};

use crate::geometry::Intrinsics;

/// The ray of a pixel and how it changes.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Unit vector in the camera's frame.
    pub direction: Vector3<f64>,
    /// Change per pixel to the right.
    pub right: Vector3<f64>,
    /// Change per pixel down.
    pub down: Vector3<f64>,
    /// A bound on how far the directions within the pixel are from its middle's.
    pub width: f64,
}

/// The rays of all pixels, with a rim of one pixel for differences.
#[derive(Debug)]
pub struct RayTable {
    /// Columns and rows of the picture.
    pub size: [usize; 2],
    rays: Vec<[f32; 3]>,
}

const NOWHERE: [f32; 3] = [f32::NAN; 3];

impl RayTable {
    /// Inverts the lens at every pixel.
    #[must_use]
    pub fn new(intrinsics: &Intrinsics) -> Self {
        let size = intrinsics.size().map(|n| n as usize);
        let [width, height] = [size[0] + 2, size[1] + 2];
        let mut rays = vec![NOWHERE; width * height];
        for (index, ray) in rays.iter_mut().enumerate() {
            let pixel = Vector2::new((index % width) as f64 - 1.0, (index / width) as f64 - 1.0);
            if let Ok(direction) = intrinsics.ray(&pixel) {
                *ray = [direction.x as f32, direction.y as f32, direction.z as f32];
            }
        }
        Self { size, rays }
    }

    /// The direction at a pixel; columns and rows may be one outside the picture, counted from -1 there (so 0 here). `None` where the lens shows nothing.
    fn at(&self, column: usize, row: usize) -> Option<Vector3<f64>> {
        let ray = self.rays[row * (self.size[0] + 2) + column];
        (!ray[0].is_nan()).then(|| Vector3::from(ray.map(f64::from)))
    }

    /// The direction of a pixel; `None` where the lens shows nothing.
    #[must_use]
    pub fn direction(&self, column: usize, row: usize) -> Option<Vector3<f64>> {
        self.at(column + 1, row + 1)
    }

    /// The ray of a pixel with its derivatives; `None` where the lens shows nothing.
    #[must_use]
    pub fn ray(&self, column: usize, row: usize) -> Option<Ray> {
        let (c, r) = (column + 1, row + 1);
        let direction = self.at(c, r)?;
        // At the rim of what a lens shows there is a neighbour on one side only.
        let slope = |before: Option<Vector3<f64>>, after: Option<Vector3<f64>>| match (before, after) {
            (Some(before), Some(after)) => 0.5 * (after - before),
            (Some(before), None) => direction - before,
            (None, Some(after)) => after - direction,
            (None, None) => Vector3::zeros(),
        };
        let right = slope(self.at(c - 1, r), self.at(c + 1, r));
        let down = slope(self.at(c, r - 1), self.at(c, r + 1));
        let width = right.norm() + down.norm();
        Some(Ray { direction, right, down, width })
    }
}
