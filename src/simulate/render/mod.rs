//! Pictures of a cell, without a graphics card.
//!
//! What a detector measures is exact: a pixel of a tag is the mean of the printed pattern over the pixel's area (see [`coverage`]), seen through the exact perspective and
//! lens of its camera. All else - the room, the robots' paint, shadows - is there so that a detector meets what it meets in a real cell, and so that a person sees one.
//!
//! A [`Scene`] is made once and shared by all threads. It keeps, for each camera, the ray of every pixel, and for a camera that does not move, what everything
//! that stands still looks like; a picture then costs only what moves. [`render`] uses one thread; take many pictures at once to use more.

mod bar;
pub mod coverage;
mod encode;
mod exposure;
mod face;
mod layer;
mod rays;
mod shadows;
mod solid;
mod surroundings;
mod targets;
mod texture;
mod tile;

use nalgebra::{Matrix3, Vector3};
use std::sync::OnceLock;

pub use encode::{PictureFormat, encode};
pub use exposure::Exposure;

use super::bodies::{Capsule, PlacedCapsule, robot_capsules};
use super::cell::Cell;
use crate::detect::GreyPicture;
use crate::frames::{Edge, FrameId};
use crate::geometry::{Pose, rotation};
use face::Face;
use layer::{Layer, Light, View};
use rays::RayTable;
use solid::{Shape, Solid};
use surroundings::{Ground, Occupied, bar, block};
use texture::{Finish, Textures};

/// What there is to see beside the things of the layout.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Look {
    /// Decides textures, clutter, where the lamp hangs, and all noise.
    pub seed: u64,
    /// A room with a table, and stands under what would float.
    pub room: bool,
    /// Boxes, posts, cables, signs.
    pub clutter: bool,
    /// Whether the lamp casts shadows.
    pub shadows: bool,
}

impl Look {
    /// A cell as it is.
    #[must_use]
    pub fn full(seed: u64) -> Self {
        Self { seed, room: true, clutter: true, shadows: true }
    }

    /// Robots and targets before an even grey, without shadows.
    #[must_use]
    pub fn plain(seed: u64) -> Self {
        Self { seed, room: false, clutter: false, shadows: false }
    }
}

/// Radius of the lamp, m.
const LAMP: f64 = 0.16;

/// A shape on a frame.
#[derive(Debug)]
struct Part {
    frame: FrameId,
    shape: Shape,
    group: usize,
    /// The camera that this is the housing of, which does not see it.
    camera: Option<usize>,
}

/// A robot's capsule with its paint.
#[derive(Debug)]
struct Limb {
    capsule: Capsule,
    group: usize,
    paint: [f32; 2],
}

/// Everything that pictures of one cell have in common. Memory: per camera that was used 12 bytes a pixel for its lens, and 12 more if it is fixed.
#[derive(Debug)]
pub struct Scene {
    look: Look,
    ground: Ground,
    textures: Textures,
    /// Shapes in the ground's frame.
    fixtures: Vec<Shape>,
    parts: Vec<Part>,
    limbs: Vec<Limb>,
    rays: Vec<OnceLock<RayTable>>,
    still: Vec<OnceLock<Layer>>,
}

impl Scene {
    /// The scene of a cell. Clutter keeps out of the way of the motion in the cell's recording.
    #[must_use]
    pub fn new(cell: &Cell<'_>, look: &Look) -> Self {
        let targets: Vec<Vec<Shape>> = cell.layout.targets.iter().map(targets::target_shapes).collect();
        let ground = Ground::new(cell, &targets, look.seed);
        let mut fixtures = Vec::new();
        if look.room {
            fixtures.push(ground.table_shape());
            fixtures.extend(ground.stands(cell, &targets));
        }
        if look.clutter {
            let occupied = Occupied::new(cell, &targets);
            fixtures.extend(ground.clutter(&occupied, look.seed).into_iter().filter(|_| look.room));
        }
        let mut limbs = Vec::new();
        for robot in 0..cell.layout.robots.len() {
            let paint = [[0.62, 0.28], [0.5, 0.16], [0.7, 0.35]][robot % 3];
            let capsules = robot_capsules(cell.layout, &cell.tree, robot);
            limbs.extend(capsules.into_iter().map(|capsule| Limb { capsule, group: robot, paint }));
        }
        let robots = cell.layout.robots.len();
        let mut parts = Vec::new();
        for (target, shapes) in targets.into_iter().enumerate() {
            let (frame, group) = (cell.tree.targets[target], robots + target);
            let middle = shapes.iter().map(shape_middle).sum::<Vector3<f64>>() / shapes.len().max(1) as f64;
            parts.extend(holder(cell, frame, middle, group, None));
            parts.extend(shapes.into_iter().map(|shape| Part { frame, shape, group, camera: None }));
        }
        for (camera, &frame) in cell.tree.cameras.iter().enumerate() {
            if cell.tree.body(frame) == 0 {
                continue;
            }
            let group = robots + cell.layout.targets.len() + camera;
            let middle = Vector3::new(0.0, 0.0, -0.03);
            parts.extend(holder(cell, frame, middle, group, Some(camera)));
            let pose = Pose::new(rotation::from_matrix(&Matrix3::identity()), middle);
            let shape = block(pose, Vector3::new(0.022, 0.022, 0.026), 0.12, Finish::Plain);
            parts.push(Part { frame, shape, group, camera: Some(camera) });
        }
        let cameras = cell.layout.cameras.len();
        Self {
            look: *look,
            ground,
            textures: Textures::new(ground.table, look.seed),
            fixtures,
            parts,
            limbs,
            rays: (0..cameras).map(|_| OnceLock::new()).collect(),
            still: (0..cameras).map(|_| OnceLock::new()).collect(),
        }
    }

    /// Floor, ceiling and walls in the camera's frame.
    fn room(&self, camera_from_ground: &Pose) -> Vec<Face<'static>> {
        if !self.look.room {
            return Vec::new();
        }
        let Ground { room, heights: [floor, ceiling], .. } = self.ground;
        let plane = |x: Vector3<f64>, y: Vector3<f64>, place: Vector3<f64>, tone, finish| {
            let turn = Matrix3::from_columns(&[x, y, x.cross(&y)]);
            let pose = Pose::new(rotation::from_matrix(&turn), place);
            Face::plane(&(*camera_from_ground * pose), tone, finish)
        };
        let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
        vec![
            plane(x, y, z * floor, 0.42, Finish::Floor),
            plane(y, x, z * ceiling, 0.6, Finish::Wall),
            plane(y, z, x * -room, 0.55, Finish::Wall),
            plane(-y, z, x * room, 0.5, Finish::Wall),
            plane(-x, z, y * -room, 0.58, Finish::Wall),
            plane(x, z, y * room, 0.46, Finish::Wall),
        ]
    }
}

/// The middle of a shape in its frame.
fn shape_middle(shape: &Shape) -> Vector3<f64> {
    match shape {
        Shape::Block { pose, .. } => pose.translation,
        Shape::Capsule { capsule, .. } => 0.5 * (capsule.ends[0] + capsule.ends[1]),
    }
}

/// A rod from a moving frame to what is mounted on it.
fn holder(cell: &Cell<'_>, frame: FrameId, middle: Vector3<f64>, group: usize, camera: Option<usize>) -> Option<Part> {
    let Edge::Static(edge) = cell.tree.frames[frame].edge else { return None };
    let parent = cell.tree.frames[frame].parent?;
    if cell.tree.body(frame) == 0 {
        return None;
    }
    let to = cell.tree.static_edges[edge].spec.truth()? * middle;
    Some(Part { frame: parent, shape: bar([Vector3::zeros(), to], 0.011, 0.25), group, camera })
}

/// The picture that a camera takes at a configuration: the same bits for the same cell, scene and arguments, whatever was rendered before or beside it.
///
/// `None` if the camera has no lens, or is not placed at that configuration.
#[must_use]
pub fn render(
    cell: &Cell<'_>,
    scene: &Scene,
    camera: usize,
    configuration: u64,
    shot: u64,
    exposure: &Exposure,
) -> Option<GreyPicture> {
    let (size, light) = light(cell, scene, camera, configuration)?;
    let parts = [scene.look.seed, camera as u64, configuration, shot];
    let seed = parts.iter().fold(0x9e37_79b9_7f4a_7c15, |seed: u64, part| {
        // SplitMix64: pictures that differ in one number have nothing in common.
        let mixed = (seed ^ part).wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    });
    exposure.take(size, light, seed)
}

/// The light before the lens at each pixel, row by row, with the picture's columns and rows; see [`render`]. 1 is a white surface in full light.
#[must_use]
pub fn light(cell: &Cell<'_>, scene: &Scene, camera: usize, configuration: u64) -> Option<([usize; 2], Vec<f32>)> {
    let intrinsics = cell.layout.cameras.get(camera)?.intrinsics.as_ref()?;
    let frame = cell.tree.cameras[camera];
    let camera_from_world = cell.pose(frame, 0, configuration)?;
    let rays = scene.rays[camera].get_or_init(|| RayTable::new(intrinsics));
    let camera_from_ground = camera_from_world * scene.ground.pose;
    let room = scene.room(&camera_from_ground);
    let lamp = scene.ground.light;
    let light = Light {
        place: camera_from_ground * lamp,
        up: camera_from_ground.rotation * Vector3::z(),
        radius: LAMP,
        nominal: lamp.norm(),
    };
    let view = View { rays, light, shadows: scene.look.shadows, room: &room, textures: &scene.textures };
    let from = |frame: FrameId| cell.pose(cell.tree.cameras[camera], frame, configuration);
    let groups = cell.layout.robots.len() + cell.layout.targets.len() + cell.layout.cameras.len();
    let is_still = |frame: FrameId| cell.tree.body(frame) == 0;
    let (mut still, mut moving) = (Vec::new(), Vec::new());
    for (index, shape) in scene.fixtures.iter().enumerate() {
        still.push(Solid::new(shape, &camera_from_ground, groups + index, 0));
    }
    for part in scene.parts.iter().filter(|part| part.camera != Some(camera)) {
        if let Some(pose) = from(part.frame) {
            let solid = Solid::new(&part.shape, &pose, part.group, 0);
            if is_still(part.frame) { still.push(solid) } else { moving.push(solid) }
        }
    }
    for limb in &scene.limbs {
        if let Some(PlacedCapsule { ends, radius }) = limb.capsule.place(from) {
            let placed = PlacedCapsule { ends, radius };
            let solid = Solid::capsule(placed, limb.paint[0], limb.paint[1], limb.group, limb.capsule.link);
            if limb.capsule.frames.iter().all(|f| is_still(*f)) { still.push(solid) } else { moving.push(solid) }
        }
    }
    still.retain(|solid| !solid.swallows_camera());
    moving.retain(|solid| !solid.swallows_camera());
    let own;
    let layer = if is_still(frame) {
        scene.still[camera].get_or_init(|| view.still(&still))
    } else {
        own = view.still(&still);
        &own
    };
    Some((rays.size, view.compose(layer, &still, &moving)))
}
