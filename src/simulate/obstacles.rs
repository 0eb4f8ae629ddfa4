//! The bodies of all robots of a cell at a configuration: what they hit and what they hide.

use nalgebra::Vector3;

use super::bodies::{Capsule, PlacedCapsule, robot_capsules};
use super::cell::Cell;
use crate::frames::FrameId;
use crate::geometry::{Pose, TargetGeometry};

/// The capsules of every robot and what robots must not run into.
#[derive(Debug)]
pub struct Obstacles {
    /// By robot.
    capsules: Vec<Vec<Capsule>>,
    /// Points (in a frame) that nothing may come near: corners of targets, cameras.
    points: Vec<(FrameId, Vector3<f64>)>,
}

/// Bodies of links come nearer to each other than their stand-ins: between links of one arm the radii count by this factor.
const OWN: f64 = 0.6;
/// Links of one arm that are this near in the chain cannot be kept apart by choosing joint values.
const NEIGHBOURS: usize = 2;
/// Links at the end of an arm that are too near to what the flange carries to hide it.
const LAST_LINKS: usize = 3;
/// What robots keep from cameras and targets, m.
const CLEARANCE: f64 = 0.03;

impl Obstacles {
    /// The bodies of a cell's robots.
    #[must_use]
    pub fn new(cell: &Cell<'_>) -> Self {
        let robots = 0..cell.layout.robots.len();
        let capsules = robots.map(|robot| robot_capsules(cell.layout, &cell.tree, robot)).collect();
        let mut points: Vec<(FrameId, Vector3<f64>)> =
            cell.tree.cameras.iter().map(|frame| (*frame, Vector3::zeros())).collect();
        for (target, frame) in cell.layout.targets.iter().zip(&cell.tree.targets) {
            points.extend(extremes(&target.true_geometry).into_iter().map(|point| (*frame, point)));
        }
        Self { capsules, points }
    }

    /// The bodies of all robots in the frame of a camera, without the last links of the arms that carry the camera or the target: what a flange carries
    /// hides itself, not its flange.
    #[must_use]
    pub fn hiding(&self, cell: &Cell<'_>, camera: FrameId, target: FrameId, configuration: u64) -> Vec<PlacedCapsule> {
        let last_links = |frame: FrameId| {
            let body = cell.tree.body(frame);
            let robot = cell.tree.robots.iter().find(|frames| frames.contains(&body));
            robot.map_or(&[] as &[FrameId], |frames| &frames[frames.len().saturating_sub(LAST_LINKS)..])
        };
        let (by_camera, by_target) = (last_links(camera), last_links(target));
        let all = self.capsules.iter().flatten();
        let kept =
            all.filter(|c| c.frames.iter().all(|frame| !by_camera.contains(frame) && !by_target.contains(frame)));
        kept.filter_map(|c| c.place(|frame| cell.pose(camera, frame, configuration))).collect()
    }

    /// What robot `robot` runs into at a configuration, `None` if nothing. Only the robots `standing` are there yet.
    #[must_use]
    pub fn collision(&self, cell: &Cell<'_>, robot: usize, standing: &[usize], configuration: u64) -> Option<Hit> {
        let frames = &cell.tree.robots[robot];
        let in_world = |c: &Capsule| c.place(|frame| cell.pose(0, frame, configuration));
        let own: Vec<(usize, PlacedCapsule)> =
            self.capsules[robot].iter().filter_map(|c| Some((c.link, in_world(c)?))).collect();
        let base_from_world = cell.pose(frames[0], 0, configuration)?;
        let carried: Vec<Vector3<f64>> = self
            .points
            .iter()
            .filter(|(frame, _)| frames[1..].contains(&cell.tree.body(*frame)))
            .filter_map(|(frame, point)| Some(cell.pose(0, *frame, configuration)? * *point))
            .collect();
        if let Some(floor) = cell.layout.simulate.floor {
            let height = |point: &Vector3<f64>| (base_from_world * *point).z - floor;
            let low = |(link, c): &(usize, PlacedCapsule)| *link > 1 && c.ends.iter().any(|end| height(end) < c.radius);
            if own.iter().any(low) || carried.iter().any(|point| height(point) < 0.0) {
                return Some(Hit::Floor);
            }
        }
        let thin = |c: &PlacedCapsule| PlacedCapsule { radius: OWN * c.radius, ..*c };
        let itself = own.iter().enumerate().any(|(i, (a, first))| {
            let far = own[..i].iter().filter(|(b, _)| a.abs_diff(*b) > NEIGHBOURS);
            far.map(|(_, second)| thin(first).clearance(&thin(second))).any(|clearance| clearance < 0.0)
        });
        let inner = own.iter().filter(|(link, _)| link + LAST_LINKS < frames.len());
        if itself || inner.clone().any(|(_, c)| carried.iter().any(|point| c.clearance(&ball(point)) < 0.0)) {
            return Some(Hit::Itself);
        }
        for other in standing {
            for theirs in self.capsules[*other].iter().filter_map(in_world) {
                if own.iter().any(|(_, mine)| mine.clearance(&theirs) < CLEARANCE)
                    || carried.iter().any(|point| theirs.clearance(&ball(point)) < CLEARANCE)
                {
                    return Some(Hit::Robot(*other));
                }
            }
        }
        for (frame, point) in self.points.iter().filter(|(frame, _)| cell.tree.body(*frame) == 0) {
            let at = cell.pose(0, *frame, configuration)? * *point;
            if own.iter().any(|(link, mine)| *link > 1 && mine.clearance(&ball(&at)) < CLEARANCE)
                || carried.iter().any(|point| (point - at).norm() < CLEARANCE)
            {
                return Some(Hit::Thing);
            }
        }
        None
    }
}

/// What a robot runs into.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hit {
    /// The plane of its own base.
    Floor,
    /// Its own links or what it carries.
    Itself,
    /// Another robot.
    Robot(usize),
    /// A camera or a target.
    Thing,
}

/// A point as a body.
fn ball(centre: &Vector3<f64>) -> PlacedCapsule {
    PlacedCapsule { ends: [*centre; 2], radius: 0.0 }
}

/// Points that span a target.
pub(super) fn extremes(geometry: &TargetGeometry) -> Vec<Vector3<f64>> {
    match geometry {
        TargetGeometry::None => vec![Vector3::zeros()],
        TargetGeometry::Tags(faces) => {
            let places: Vec<(Pose, f64)> =
                faces.iter().filter_map(|face| Some((face.target_from_tag?, face.size))).collect();
            places
                .iter()
                .flat_map(|(pose, size)| crate::geometry::target::tag_corners(*size).map(|corner| *pose * corner))
                .collect()
        }
        TargetGeometry::Board { columns, rows, square, .. } => {
            let (right, down) = (*columns as f64 * square, *rows as f64 * square);
            [(-square, -square), (right, -square), (right, down), (-square, down)]
                .map(|(x, y)| Vector3::new(x, y, 0.0))
                .to_vec()
        }
        TargetGeometry::Points(points) => points.iter().filter_map(|(_, place)| *place).collect(),
    }
}
