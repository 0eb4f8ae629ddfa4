//! Bodies in the camera's frame, and what a pixel sees of one of them.

use nalgebra::Vector3;

use super::bar::{capsule_patch, ray_to_segment};
use super::coverage::Grid;
use super::face::{Face, Patch};
use super::rays::Ray;
use super::texture::{Finish, Textures};
use crate::geometry::Pose;
use crate::simulate::bodies::{PlacedCapsule, segment_distance};

/// A box, or a round bar, as it hangs on some frame.
#[derive(Clone, Debug)]
pub enum Shape {
    /// A box: place of its middle in its frame, half its edges, and what is printed on its faces in the order +x, -x, +y, -y, +z, -z.
    Block {
        /// `frame_from_middle`.
        pose: Pose,
        /// Half the edges, m.
        half: Vector3<f64>,
        /// One a face; `None`: plain.
        faces: Box<[Option<Grid>; 6]>,
        /// Reflectance of plain faces.
        tone: f32,
        /// Texture of the +z face; the others are smooth.
        finish: Finish,
    },
    /// A bar with round ends, placed.
    Capsule {
        /// Its ends and radius.
        capsule: PlacedCapsule,
        /// Reflectance.
        tone: f32,
        /// Reflectance of the round ends, as the lids on a robot's joints.
        lid: f32,
    },
}

/// The frame of each face of a box: x, y and outward normal as columns of signed axes.
const FACES: [[[f64; 3]; 3]; 6] = [
    [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]],
    [[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]],
    [[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]],
    [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]],
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]],
];

/// The x axis, y axis and outward normal of a box's face in the box's frame.
#[must_use]
pub fn face_axes(face: usize) -> [Vector3<f64>; 3] {
    FACES[face].map(Vector3::from)
}

/// A body placed in the camera's frame.
#[derive(Debug)]
pub struct Solid<'a> {
    /// What it is.
    pub body: Body<'a>,
    /// Middle of a ball around it.
    pub middle: Vector3<f64>,
    /// Radius of that ball.
    pub radius: f64,
    /// Bodies of one group cast no shadow on each other unless their links are two or more apart.
    pub group: usize,
    /// The link, for a robot's bodies.
    pub link: usize,
}

/// See [`Shape`].
#[derive(Debug)]
pub enum Body<'a> {
    /// All six faces of a box.
    Block(Vec<Face<'a>>),
    /// A bar, with the reflectance of its side and its ends.
    Capsule(PlacedCapsule, f32, f32),
}

impl<'a> Solid<'a> {
    /// Places a shape in the camera's frame.
    #[must_use]
    pub fn new(shape: &'a Shape, camera_from_frame: &Pose, group: usize, link: usize) -> Self {
        match shape {
            Shape::Capsule { capsule, tone, lid } => {
                let ends = capsule.ends.map(|end| *camera_from_frame * end);
                Self::capsule(PlacedCapsule { ends, radius: capsule.radius }, *tone, *lid, group, link)
            }
            Shape::Block { pose, half, faces, tone, finish } => {
                let camera_from_box = *camera_from_frame * *pose;
                let turn = camera_from_box.rotation_matrix();
                let face = |index: usize| {
                    let local = face_axes(index);
                    let [hx, hy, hz] = local.map(|axis| axis.component_mul(half).abs().sum());
                    let axes = local.map(|axis| turn * axis);
                    let origin = camera_from_box.translation + axes[2] * hz;
                    let finish = if index == 4 { *finish } else { Finish::Plain };
                    Face::new(faces[index].as_ref(), [hx, hy], origin, axes, *tone, finish)
                };
                let faces = (0..6).map(face).collect();
                let middle = camera_from_box.translation;
                Self { body: Body::Block(faces), middle, radius: half.norm(), group, link }
            }
        }
    }

    /// A bar already in the camera's frame.
    #[must_use]
    pub fn capsule(capsule: PlacedCapsule, tone: f32, lid: f32, group: usize, link: usize) -> Self {
        let middle = 0.5 * (capsule.ends[0] + capsule.ends[1]);
        let radius = 0.5 * (capsule.ends[1] - capsule.ends[0]).norm() + capsule.radius;
        Self { body: Body::Capsule(capsule, tone, lid), middle, radius, group, link }
    }

    /// Whether the camera's lens is inside the body.
    #[must_use]
    pub fn swallows_camera(&self) -> bool {
        match &self.body {
            Body::Block(faces) => faces.iter().all(|face| face.axes[2].dot(&face.origin) > 0.0),
            Body::Capsule(capsule, ..) => {
                segment_distance(&capsule.ends, &[Vector3::zeros(), Vector3::zeros()]) < capsule.radius
            }
        }
    }

    /// Whether a cone of rays from the camera (unit axis, half angle as its tangent) may touch the body; may say yes too often.
    #[must_use]
    pub fn near_cone(&self, axis: &Vector3<f64>, tangent: f64) -> bool {
        match &self.body {
            Body::Block(_) => {
                let along = axis.dot(&self.middle);
                let apart = (self.middle - axis * along).norm();
                let reach = self.radius + (along.abs() + self.radius) * tangent;
                apart < reach && along > -self.radius || self.middle.norm() < self.radius
            }
            Body::Capsule(capsule, ..) => {
                let (apart, _, depth) = ray_to_segment(axis, capsule);
                let far = capsule.ends[0].norm().max(capsule.ends[1].norm()) + capsule.radius;
                apart < capsule.radius + far * tangent && depth > -(capsule.radius + far * tangent)
            }
        }
    }

    /// Whether none of the rays between four at the corners of a small part of the picture meets the body; may say no too often.
    #[must_use]
    pub fn misses(&self, corners: &[Vector3<f64>; 4]) -> bool {
        match &self.body {
            Body::Block(faces) => faces.iter().all(|face| face.misses(corners)),
            Body::Capsule(..) => false,
        }
    }

    /// Whether the body may stand in the light of anything within a ball, given how wide the light is.
    #[must_use]
    pub fn near_shaft(&self, middle: &Vector3<f64>, radius: f64, light: &Vector3<f64>, light_radius: f64) -> bool {
        let ends = match &self.body {
            Body::Block(_) => ([self.middle; 2], self.radius),
            Body::Capsule(capsule, ..) => (capsule.ends, capsule.radius),
        };
        let far = (ends.0[0] - middle).norm().max((ends.0[1] - middle).norm());
        let soft = light_radius * far / (light - middle).norm().max(1e-3);
        segment_distance(&ends.0, &[*middle, *light]) < ends.1 + radius + soft + 0.005
    }

    /// The surfaces of the body in a pixel. A convex body's surfaces do not overlap, so their areas add up.
    pub fn patches(&self, ray: &Ray, textures: &Textures, mut found: impl FnMut(Patch)) {
        match &self.body {
            Body::Block(faces) => {
                for face in faces.iter().filter(|face| face.depth < 0.0) {
                    if let Some(mut patch) = face.patch(ray, textures) {
                        let middle = self.middle.dot(&ray.direction);
                        patch.depth = patch.depth.clamp((middle - self.radius).max(1e-6), middle + self.radius);
                        found(patch);
                    }
                }
            }
            Body::Capsule(capsule, tone, lid) => {
                if let Some(patch) = capsule_patch(capsule, *tone, *lid, ray) {
                    found(patch);
                }
            }
        }
    }

    /// How much of a light the body takes from a point, `distance` away in unit `direction`: 0 none, 1 all. The light's width makes the shadow's edge soft.
    #[must_use]
    pub fn shade(&self, point: &Vector3<f64>, direction: &Vector3<f64>, distance: f64, light_radius: f64) -> f64 {
        let softness = |along: f64| (light_radius * along / distance).max(0.003);
        match &self.body {
            Body::Capsule(capsule, ..) => {
                let moved = PlacedCapsule { ends: capsule.ends.map(|end| end - point), radius: capsule.radius };
                let (apart, _, along) = ray_to_segment(direction, &moved);
                if along <= 0.0 || along >= distance {
                    return 0.0;
                }
                let soft = softness(along);
                smooth((capsule.radius + soft - apart) / (2.0 * soft))
            }
            Body::Block(faces) => {
                let mut taken = 0.0;
                for face in faces {
                    let slope = face.axes[2].dot(direction);
                    let along = face.axes[2].dot(&(face.origin - point)) / slope;
                    // The faces towards the light; together they are the body's outline as the light sees it.
                    if slope > 1e-6 && along > 1e-6 && along < distance {
                        let at = point + direction * along - face.origin;
                        let inside = (face.half[0] - face.axes[0].dot(&at).abs())
                            .min(face.half[1] - face.axes[1].dot(&at).abs());
                        let soft = softness(along);
                        taken += smooth((inside + soft) / (2.0 * soft));
                    }
                }
                taken.min(1.0)
            }
        }
    }
}

/// A smooth step from 0 at 0 to 1 at 1.
fn smooth(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
