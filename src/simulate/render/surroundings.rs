//! What stands around: where up is, the table and the floor, stands under what would float, and clutter.
//!
//! A layout says nothing of all this, so it is read from what it does say: robots stand upright on the lowest thing in the cell, and that is the table. Clutter
//! never stands where a camera looks at a target or a robot moves; that is checked against the robots' motion.

use nalgebra::{Matrix3, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::solid::Shape;
use super::targets::THICKNESS;
use super::texture::{Finish, lettering};
use crate::frames::FrameId;
use crate::geometry::{Pose, rotation};
use crate::simulate::Cell;
use crate::simulate::bodies::{PlacedCapsule, segment_distance};

/// The table is this much larger than what stands on it, m.
const RIM: f64 = 0.35;
/// Height of the table, m.
const TABLE: f64 = 0.74;
/// At most this many configurations are looked at to keep clutter out of the way.
const MOST_STOPS: usize = 40;

/// The ground of a cell.
#[derive(Clone, Copy, Debug)]
pub struct Ground {
    /// `world_from_ground`: z up, origin on the table's top in its middle.
    pub pose: Pose,
    /// Half the table's edges, m.
    pub table: [f64; 2],
    /// Half the room's edges, m.
    pub room: f64,
    /// Floor and ceiling, m above the table.
    pub heights: [f64; 2],
    /// The light's place in the ground's frame.
    pub light: Vector3<f64>,
}

/// Where everything is that must not be hidden.
#[derive(Debug)]
pub struct Occupied {
    /// Lines of sight, and robots' bodies, as bars in the world.
    bars: Vec<PlacedCapsule>,
}

/// Places of frames in the world that do not depend on a configuration.
fn standing(cell: &Cell<'_>, frame: FrameId) -> Option<Pose> {
    (cell.tree.body(frame) == 0).then(|| cell.pose(0, frame, 0)).flatten()
}

/// Eight corners of a shape, or the ends of a bar, in its frame.
fn outline(shape: &Shape) -> Vec<Vector3<f64>> {
    match shape {
        Shape::Capsule { capsule, .. } => capsule.ends.to_vec(),
        Shape::Block { pose, half, .. } => (0..8)
            .map(|i| {
                let sign = |bit: usize| if i >> bit & 1 == 0 { -1.0 } else { 1.0 };
                *pose * Vector3::new(sign(0) * half.x, sign(1) * half.y, sign(2) * half.z)
            })
            .collect(),
    }
}

/// Which way is up: as most robots stand, else out of the target that faces up best, else as the cameras are held.
fn upwards(cell: &Cell<'_>) -> Vector3<f64> {
    let poses = |frames: &[FrameId]| frames.iter().filter_map(|f| standing(cell, *f)).collect::<Vec<Pose>>();
    let bases: Vec<FrameId> = cell.tree.robots.iter().filter_map(|frames| frames.first().copied()).collect();
    let cameras = poses(&cell.tree.cameras);
    let held: Vector3<f64> = cameras.iter().map(|pose| pose.rotation * -Vector3::y()).sum();
    let held = held.try_normalize(1e-6);
    let robots: Vector3<f64> = poses(&bases).iter().map(|pose| pose.rotation * Vector3::z()).sum();
    if let Some(up) = robots.try_normalize(1e-6) {
        // Robots that hang from above: then most cameras are held upside down against them.
        return if held.is_some_and(|held| held.dot(&up) < -0.5) { -up } else { up };
    }
    let looks: Vector3<f64> = cameras.iter().map(|pose| pose.rotation * -Vector3::z()).sum();
    let wanted = (held.unwrap_or_else(Vector3::zeros) + 0.9 * looks.try_normalize(1e-6).unwrap_or_else(Vector3::zeros))
        .try_normalize(1e-6)
        .unwrap_or_else(Vector3::z);
    let normals = poses(&cell.tree.targets).into_iter().flat_map(|pose| {
        let normal = pose.rotation * Vector3::z();
        [normal, -normal]
    });
    let best = normals.max_by(|a, b| a.dot(&wanted).total_cmp(&b.dot(&wanted)));
    match (best, held) {
        (Some(normal), _) if normal.dot(&wanted) > 0.8 => normal,
        (_, Some(held)) => held,
        _ => wanted,
    }
}

impl Ground {
    /// Reads the ground from a cell; `targets` are the shapes of each target in its frame.
    #[must_use]
    pub fn new(cell: &Cell<'_>, targets: &[Vec<Shape>], seed: u64) -> Self {
        let up = upwards(cell);
        let bases = cell.tree.robots.iter().filter_map(|frames| standing(cell, *frames.first()?));
        let mut low: Vec<Vector3<f64>> = bases.map(|pose| pose.translation).collect();
        for (frame, shapes) in cell.tree.targets.iter().zip(targets) {
            if let Some(pose) = standing(cell, *frame) {
                low.extend(shapes.iter().flat_map(outline).map(|corner| pose * corner));
            }
        }
        let cameras: Vec<Vector3<f64>> =
            cell.tree.cameras.iter().filter_map(|f| Some(standing(cell, *f)?.translation)).collect();
        if low.is_empty() {
            let below = cameras.iter().map(|c| c - 1.2 * up);
            low.extend(below);
        }
        if low.is_empty() {
            low.push(Vector3::zeros());
        }
        let bottom = low.iter().map(|p| p.dot(&up)).fold(f64::INFINITY, f64::min) - 1e-3;
        // Along the axis of the world that is most level, so that a cell described in its table's axes gets a table in these.
        let axis = [Vector3::x(), Vector3::y(), Vector3::z()]
            .into_iter()
            .map(|axis| axis - up * up.dot(&axis))
            .max_by(|a, b| a.norm().total_cmp(&b.norm()));
        let x = axis.and_then(|axis| axis.try_normalize(1e-6)).unwrap_or_else(Vector3::x);
        let turn = Matrix3::from_columns(&[x, up.cross(&x), up]);
        let flat = |p: &Vector3<f64>| turn.transpose() * p;
        let range = |axis: usize| {
            let values = || low.iter().map(|p| flat(p)[axis]);
            (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max))
        };
        let (rx, ry) = (range(0), range(1));
        let table = [rx, ry].map(|(from, to)| 0.5 * (to - from) + RIM);
        let middle = Vector3::new(0.5 * (rx.0 + rx.1), 0.5 * (ry.0 + ry.1), bottom);
        let pose = Pose::new(rotation::from_matrix(&turn), turn * middle);
        let placed: Vec<Vector3<f64>> = cameras.iter().map(|c| pose.inverse() * *c).collect();
        let wide = placed.iter().map(|c| c.x.abs().max(c.y.abs())).fold(table[0].max(table[1]), f64::max);
        let top = placed.iter().map(|c| c.z).fold(1.6, f64::max);
        let bottom = placed.iter().map(|c| c.z).fold(0.0, f64::min);
        let heights = [(bottom - 0.2).min(-TABLE), top + 0.9];
        let mut random = ChaCha8Rng::seed_from_u64(seed ^ 0x119e);
        let angle: f64 = random.random_range(0.0..std::f64::consts::TAU);
        let light = Vector3::new(1.1 * angle.cos(), 1.1 * angle.sin(), heights[1].max(2.2));
        Self { pose, table, room: wide + 1.7, heights, light }
    }

    /// The table.
    #[must_use]
    pub fn table_shape(&self) -> Shape {
        let half = Vector3::new(self.table[0], self.table[1], 0.02);
        block(Pose::from_translation(0.0, 0.0, -half.z), half, 0.5, Finish::Table)
    }

    /// What holds up things that stand still above the table: a plinth under a robot, a block or a post under a target. In the ground's frame.
    #[must_use]
    pub fn stands(&self, cell: &Cell<'_>, targets: &[Vec<Shape>]) -> Vec<Shape> {
        let ground_from_world = self.pose.inverse();
        let mut shapes = Vec::new();
        for frames in &cell.tree.robots {
            let Some(base) = frames.first().and_then(|frame| standing(cell, *frame)) else { continue };
            let base = ground_from_world * base;
            let upright = (base.rotation * Vector3::z()).z > 0.98;
            if upright && base.translation.z > 0.003 {
                let height = 0.5 * base.translation.z;
                let pose = Pose::new(base.rotation, Vector3::new(base.translation.x, base.translation.y, height));
                shapes.push(block(pose, Vector3::new(0.13, 0.13, height - 0.001), 0.3, Finish::Plain));
            }
        }
        for (frame, parts) in cell.tree.targets.iter().zip(targets) {
            let Some(pose) = standing(cell, *frame) else { continue };
            let ground_from_target = ground_from_world * pose;
            for part in parts {
                let Shape::Block { pose, half, .. } = part else { continue };
                let placed = ground_from_target * *pose;
                let lowest = outline(part).iter().map(|p| (ground_from_target * *p).z).fold(f64::INFINITY, f64::min);
                if lowest < 0.004 {
                    continue;
                }
                let flat = (placed.rotation * Vector3::z()).z;
                if flat > 0.9 && half.z <= THICKNESS && lowest < 0.3 {
                    // As deep as the table is below its middle, and a little narrower than the plate.
                    let depth = 0.5 * (placed.translation.z / flat - half.z) + 0.004;
                    let below = placed * Pose::from_translation(0.0, 0.0, -half.z - depth);
                    let size = Vector3::new(0.94 * half.x, 0.94 * half.y, depth - 5e-4);
                    shapes.push(block(below, size, 0.34, Finish::Plain));
                } else {
                    let top = placed * Vector3::new(0.0, 0.0, -half.z.min(0.01));
                    let foot = Vector3::new(top.x, top.y, 0.0);
                    shapes.push(bar([foot, top], 0.009, 0.22));
                    shapes.push(block(
                        Pose::from_translation(foot.x, foot.y, 0.006),
                        Vector3::new(0.045, 0.045, 0.006),
                        0.25,
                        Finish::Plain,
                    ));
                }
            }
        }
        shapes
    }

    /// Boxes, posts, cables and signs around the cell and on the table, out of everybody's way. In the ground's frame.
    #[must_use]
    pub fn clutter(&self, occupied: &Occupied, seed: u64) -> Vec<Shape> {
        let mut random = ChaCha8Rng::seed_from_u64(seed ^ 0xc1a7);
        let mut shapes = Vec::new();
        let floor = self.heights[0];
        self.signs(&mut random, &mut shapes);
        let outer = self.room - 0.1;
        let free = |middle: Vector3<f64>, radius: f64| occupied.is_free(&(self.pose * middle), radius);
        for _ in 0..34 {
            let (x, y) = (random.random_range(-outer..outer), random.random_range(-outer..outer));
            let turn = Vector3::new(0.0, 0.0, random.random_range(0.0..1.6));
            let half = Vector3::new(
                random.random_range(0.08..0.28),
                random.random_range(0.08..0.28),
                random.random_range(0.1..0.5),
            );
            let tone = [0.12, 0.35, 0.5, 0.7, 0.85][random.random_range(0..5)];
            let post = random.random_bool(0.35);
            if x.abs() < self.table[0] + 0.45 && y.abs() < self.table[1] + 0.45 {
                continue;
            }
            let middle = Vector3::new(x, y, floor + half.z);
            if post {
                let top = Vector3::new(x, y, floor + random.random_range(1.0..2.0));
                let (middle, radius) = (0.5 * (middle + top), 0.5 * (top.z - floor) + 0.1);
                if free(middle, radius) {
                    shapes.push(bar([Vector3::new(x, y, floor), top], random.random_range(0.02..0.06), tone));
                }
            } else if free(middle, half.norm()) {
                let pose = Pose::new(Pose::from_rotation_vector(&turn).rotation, middle);
                shapes.push(block(pose, half, tone, Finish::Plain));
            }
        }
        for _ in 0..60 {
            let at = self.table.map(|half| random.random_range(-half + 0.08..half - 0.08));
            let half = Vector3::new(
                random.random_range(0.015..0.05),
                random.random_range(0.015..0.07),
                random.random_range(0.008..0.035),
            );
            let turn = random.random_range(0.0..3.0);
            let tone = [0.06, 0.15, 0.5, 0.7][random.random_range(0..4)];
            let long = random.random_bool(0.3);
            let length = if long { random.random_range(0.05..0.25) } else { 0.02 };
            if !free(Vector3::new(at[0], at[1], half.z), half.norm() + length) || shapes.len() > 48 {
                continue;
            }
            let pose = Pose::from_translation(at[0], at[1], half.z)
                * Pose::from_rotation_vector(&Vector3::new(0.0, 0.0, turn));
            if long {
                let radius = 0.25 * half.z + 0.002;
                let end = |s: f64| pose * Vector3::new(s * length, 0.0, radius - half.z);
                shapes.push(bar([end(-1.0), end(1.0)], radius, tone));
            } else {
                shapes.push(block(pose, half, tone, Finish::Plain));
            }
        }
        self.cables(&mut random, &mut shapes);
        shapes
    }

    /// Boards with lettering, dark panels and pipes on the four walls.
    fn signs(&self, random: &mut ChaCha8Rng, shapes: &mut Vec<Shape>) {
        let [floor, ceiling] = self.heights;
        for side in 0..4 {
            let turn =
                Pose::from_rotation_vector(&Vector3::new(0.0, 0.0, f64::from(side) * std::f64::consts::FRAC_PI_2));
            // A frame on the wall: x along it, y up, z into the room.
            let upright = Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0);
            let upright = Pose::new(rotation::from_matrix(&upright), Vector3::zeros());
            let mut at = -self.room + 0.2;
            while at < self.room - 0.3 {
                let half = [random.random_range(0.15..0.45), random.random_range(0.1..0.4)];
                let height = random.random_range(floor + 0.5..ceiling - 0.4);
                let place = turn * Pose::from_translation(at + half[0], self.room - 0.012, height) * upright;
                let size = Vector3::new(half[0], half[1], 0.012);
                let mut sign = block(place, size, [0.08, 0.25, 0.55, 0.7][random.random_range(0..4)], Finish::Plain);
                if random.random_bool(0.6)
                    && let Shape::Block { faces, half, .. } = &mut sign
                {
                    half.y = 0.11 + 0.3 * half.x * 0.2;
                    let (paper, ink) = if random.random_bool(0.5) { (0.7, 0.12) } else { (0.3, 0.75) };
                    let letters = random.random_range(3..7);
                    faces[4] = Some(lettering(random, letters, [half.x, half.y], paper, ink));
                }
                shapes.push(sign);
                at += 2.0 * half[0] + random.random_range(0.1..0.8);
            }
            let height = random.random_range(0.4..ceiling - 0.1);
            let end = |s: f64| turn * Vector3::new(s * self.room, self.room - 0.05, height);
            shapes.push(bar([end(-1.0), end(1.0)], 0.03, 0.35));
        }
    }

    /// Cables on the floor around the table.
    fn cables(&self, random: &mut ChaCha8Rng, shapes: &mut Vec<Shape>) {
        for _ in 0..3 {
            let mut angle: f64 = random.random_range(0.0..std::f64::consts::TAU);
            let reach = self.table[0].max(self.table[1]);
            let mut at =
                Vector3::new((reach + 0.5) * angle.cos(), (reach + 0.5) * angle.sin(), self.heights[0] + 0.012);
            for _ in 0..5 {
                angle += random.random_range(0.2..0.6);
                let out = reach + random.random_range(0.3..0.9);
                let next = Vector3::new(out * angle.cos(), out * angle.sin(), at.z);
                shapes.push(bar([at, next], 0.01, 0.05));
                at = next;
            }
        }
    }
}

/// A box of one reflectance.
#[must_use]
pub fn block(pose: Pose, half: Vector3<f64>, tone: f32, finish: Finish) -> Shape {
    Shape::Block { pose, half, faces: Box::new([const { None }; 6]), tone, finish }
}

/// A bar of one reflectance.
#[must_use]
pub fn bar(ends: [Vector3<f64>; 2], radius: f64, tone: f32) -> Shape {
    Shape::Capsule { capsule: PlacedCapsule { ends, radius }, tone, lid: tone }
}

impl Occupied {
    /// Lines of sight from every camera to every target, and every robot's body, at some of the recorded configurations.
    #[must_use]
    pub fn new(cell: &Cell<'_>, targets: &[Vec<Shape>]) -> Self {
        let mut stops: Vec<u64> = cell.recording.motions.iter().flat_map(|motion| motion.configurations()).collect();
        stops.sort_unstable();
        stops.dedup();
        let step = stops.len().div_ceil(MOST_STOPS).max(1);
        let mut stops: Vec<u64> = stops.into_iter().step_by(step).collect();
        if stops.is_empty() {
            stops.push(0);
        }
        let mut bars = Vec::new();
        for stop in stops {
            let cameras: Vec<Vector3<f64>> =
                cell.tree.cameras.iter().filter_map(|f| Some(cell.pose(0, *f, stop)?.translation)).collect();
            for (frame, shapes) in cell.tree.targets.iter().zip(targets) {
                let Some(pose) = cell.pose(0, *frame, stop) else { continue };
                let corners: Vec<Vector3<f64>> = shapes.iter().flat_map(outline).map(|p| pose * p).collect();
                let middle = corners.iter().sum::<Vector3<f64>>() / corners.len().max(1) as f64;
                let radius = corners.iter().map(|p| (p - middle).norm()).fold(0.0, f64::max) + 0.03;
                bars.push(PlacedCapsule { ends: [middle; 2], radius });
                bars.extend(cameras.iter().map(|camera| PlacedCapsule { ends: [*camera, middle], radius }));
            }
            for robot in 0..cell.layout.robots.len() {
                for capsule in crate::simulate::bodies::robot_capsules(cell.layout, &cell.tree, robot) {
                    if let Some(placed) = capsule.place(|frame| cell.pose(0, frame, stop)) {
                        bars.push(PlacedCapsule { radius: placed.radius + 0.08, ..placed });
                    }
                }
            }
        }
        Self { bars }
    }

    /// Whether a ball in the world is in nobody's way.
    fn is_free(&self, middle: &Vector3<f64>, radius: f64) -> bool {
        self.bars.iter().all(|bar| segment_distance(&bar.ends, &[*middle, *middle]) > bar.radius + radius)
    }
}
