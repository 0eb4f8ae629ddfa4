//! Bodies in the camera's frame, and what a pixel sees of one of them.

use nalgebra::Vector3;

use super::coverage::{Footprint, Grid, half_plane};
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

/// A face of a box turned towards the camera or the light.
#[derive(Debug)]
pub struct Face<'a> {
    printed: Option<&'a Grid>,
    half: [f64; 2],
    origin: Vector3<f64>,
    axes: [Vector3<f64>; 3],
    /// With a ray's direction d: x = (by_x . d) / (normal . d), and so for y.
    by_x: Vector3<f64>,
    by_y: Vector3<f64>,
    /// Lengths of the two, to bound how wide a pixel is on the face.
    lengths: [f64; 2],
    /// Along the normal from the camera to the plane; negative if the camera is before the face.
    depth: f64,
    tone: f32,
    finish: Finish,
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

impl Face<'_> {
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

    fn patch(&self, ray: &Ray, textures: &Textures) -> Option<Patch> {
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

/// Between a ray from the origin (unit direction) and a bar's axis: distance, vector from the ray to the axis, and how far along the ray.
#[inline]
fn ray_to_segment(direction: &Vector3<f64>, capsule: &PlacedCapsule) -> (f64, Vector3<f64>, f64) {
    let [a, b] = capsule.ends;
    let along = b - a;
    let flat_a = a - direction * direction.dot(&a);
    let flat = along - direction * direction.dot(&along);
    let length = flat.norm_squared();
    let s = if length > 1e-18 { (-flat_a.dot(&flat) / length).clamp(0.0, 1.0) } else { 0.0 };
    let nearest = a + along * s;
    let depth = direction.dot(&nearest);
    let apart = nearest - direction * depth;
    (apart.norm(), apart, depth)
}

/// The surface of a bar in a pixel; its outline is replaced by its tangent.
fn capsule_patch(capsule: &PlacedCapsule, tone: f32, lid: f32, ray: &Ray) -> Option<Patch> {
    let (apart, towards, depth) = ray_to_segment(&ray.direction, capsule);
    if depth <= 0.0 {
        return None;
    }
    let outside = apart - capsule.radius;
    let pixel = depth * ray.width;
    if outside > pixel {
        return None;
    }
    let covered = if outside < -pixel {
        1.0
    } else {
        let unit = towards / -apart.max(1e-12);
        half_plane(outside, [unit.dot(&ray.right) * depth, unit.dot(&ray.down) * depth])
    };
    if covered <= 0.0 {
        return None;
    }
    let (depth, normal) = if outside < 0.0 {
        let depth = capsule_depth(capsule, &ray.direction).unwrap_or(depth);
        let point = ray.direction * depth;
        let axis = capsule.ends[1] - capsule.ends[0];
        let s = ((point - capsule.ends[0]).dot(&axis) / axis.norm_squared().max(1e-18)).clamp(0.0, 1.0);
        (depth, (point - capsule.ends[0] - axis * s) / capsule.radius)
    } else {
        (depth, -towards / apart)
    };
    let axis = (capsule.ends[1] - capsule.ends[0]).try_normalize(1e-9).unwrap_or_else(Vector3::zeros);
    let end = ((normal.dot(&axis).abs() - 0.72) * 40.0).clamp(0.0, 1.0);
    let tone = f64::from(tone) + end * f64::from(lid - tone);
    Some(Patch { covered, tone: covered * tone, depth, normal })
}

/// Where a ray enters a bar.
///
/// Source: the quadratic of the infinite cylinder, then of the ball at the nearer end.
fn capsule_depth(capsule: &PlacedCapsule, direction: &Vector3<f64>) -> Option<f64> {
    let [a, b] = capsule.ends;
    let axis = b - a;
    let (length, lean, offset) = (axis.norm_squared(), axis.dot(direction), -axis.dot(&a));
    let squared = capsule.radius * capsule.radius;
    let k2 = length - lean * lean;
    if k2 > 1e-12 * length.max(1e-12) {
        let k1 = -length * a.dot(direction) - offset * lean;
        let k0 = length * a.norm_squared() - offset * offset - squared * length;
        let h = k1 * k1 - k2 * k0;
        if h >= 0.0 {
            let depth = (-k1 - h.sqrt()) / k2;
            let along = offset + depth * lean;
            if along > 0.0 && along < length {
                return (depth > 0.0).then_some(depth);
            }
        }
    }
    let ball = |end: &Vector3<f64>| {
        let middle = end.dot(direction);
        let h = middle * middle - end.norm_squared() + squared;
        (h >= 0.0).then(|| middle - h.sqrt())
    };
    let first = [ball(&a), ball(&b)].into_iter().flatten().fold(f64::INFINITY, f64::min);
    (first.is_finite() && first > 0.0).then_some(first)
}

impl<'a> Face<'a> {
    fn new(
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
    fn misses(&self, corners: &[Vector3<f64>; 4]) -> bool {
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
}
