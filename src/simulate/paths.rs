//! Paths for all robots of a cell: reachable, free of collisions, with something to see at every stop, and as varied as possible.

use rand::Rng;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::Arc;

use super::cell::Cell;
use super::obstacles::{Hit, Obstacles};
use super::random::{Purpose, stream};
use super::visible::visible;
use crate::complaint::{Complaint, list, nearest};
use crate::frames::{FrameId, FrameTree};
use crate::geometry::TargetGeometry;
use crate::layout::{Layout, Motion};
use crate::recording::{Recording, RobotMotion};
use crate::robot::JointKind;

/// Good joint values to choose the most different from, at each stop.
const CHOICE: usize = 6;
/// Joint values tried at once; the number is part of what a seed means.
const BATCH: usize = 64;
/// Batches tried before a stop is given up.
const MOST_BATCHES: usize = 150;
/// From this batch on, a stop is content with less: the robot's own camera need not see anything.
const CONTENT: usize = 60;
/// How often a stop is begun anew with other places of the robots that were placed first.
const RETRIES: u64 = 12;

/// How far a robot's joints may go (rad, m).
pub type Ranges = Vec<[f64; 2]>;

/// The joint ranges of every robot: those of the `simulate` section, else half a turn either way. A robot known by its flange poses alone has none.
///
/// # Errors
/// Ranges for a robot or of a number of joints that is not there; a sliding joint without a range.
pub fn joint_ranges(layout: &Layout) -> Result<Vec<Ranges>, Complaint> {
    let names: Vec<&str> = layout.robots.iter().map(|robot| robot.name.as_str()).collect();
    for given in &layout.simulate.joints {
        if !names.contains(&given.robot.as_str()) {
            let remedy = match nearest(&given.robot, names.iter().copied()) {
                Some(meant) => format!("did you mean `{meant}`?"),
                None => format!("the layout's robots are {}", list(names)),
            };
            let what = format!("`simulate` gives joint ranges of `{}`, which is no robot", given.robot);
            return Err(Complaint::at(&layout.file, given.line, what, remedy));
        }
    }
    let of_robot = |robot: &crate::layout::Robot| {
        let Motion::Joints { chain, .. } = &robot.motion else { return Ok(Vec::new()) };
        let given = layout.simulate.joints.iter().find(|given| given.robot == robot.name);
        if let Some(given) = given.filter(|given| given.ranges.len() != chain.joint_count()) {
            return Err(Complaint::at(
                &layout.file,
                given.line,
                format!(
                    "robot `{}` has {} joints but {} ranges stand here",
                    robot.name,
                    chain.joint_count(),
                    given.ranges.len()
                ),
                "give one `[least, greatest]` a joint",
            ));
        }
        chain
            .links
            .iter()
            .enumerate()
            .map(|(i, link)| match (given, link.joint) {
                (Some(given), JointKind::Revolute) => Ok(given.ranges[i].map(|value| value * layout.units.angle)),
                (Some(given), JointKind::Prismatic) => Ok(given.ranges[i].map(|value| value * layout.units.length)),
                (None, JointKind::Revolute) => Ok([-std::f64::consts::PI, std::f64::consts::PI]),
                (None, JointKind::Prismatic) => Err(Complaint::at(
                    &layout.file,
                    robot.line,
                    format!("joint {} of robot `{}` slides, and how far is not known", i + 1, robot.name),
                    "give `simulate: {joints: {NAME: [[least, greatest], ...]}}`",
                )),
            })
            .collect()
    };
    layout.robots.iter().map(of_robot).collect()
}

/// Generates `count` stops of all robots, numbered from one.
///
/// # Errors
/// [`joint_ranges`]' own; a robot without a kinematic model; a stop that could not be found, with what stood in the way.
pub fn generate(layout: &Layout, count: u64, seed: u64) -> Result<Vec<RobotMotion>, Complaint> {
    let ranges = joint_ranges(layout)?;
    if let Some(robot) = layout.robots.iter().find(|robot| matches!(robot.motion, Motion::FlangePoses { .. })) {
        return Err(Complaint::at(
            &layout.file,
            robot.line,
            format!("robot `{}` has no kinematic model, so no path can be made for it", robot.name),
            "give a `model`, or its recorded `flange_poses` file",
        ));
    }
    let empty = Recording::default();
    let cell = Cell::new(layout, &empty);
    let planner = Planner {
        layout,
        ranges,
        obstacles: Obstacles::new(&cell),
        watched: (0..layout.robots.len()).map(|robot| Watched::new(&cell, robot)).collect(),
        order: mounting_order(&cell),
        tree: Arc::clone(&cell.tree),
        seed,
    };
    let mut motions: Vec<BTreeMap<u64, Vec<f64>>> = vec![BTreeMap::new(); layout.robots.len()];
    for stop in 1..=count {
        let mut tries = (0..RETRIES).map(|attempt| planner.place_all(stop, attempt, &motions));
        let mut last = None;
        let placed = tries.find_map(|tried| tried.map_err(|failed| last = Some(failed)).ok());
        let (Some(placed), _) = (placed, &last) else {
            return Err(planner.no_path(stop, last.unwrap_or_default()));
        };
        for (motion, joints) in motions.iter_mut().zip(placed) {
            motion.insert(stop, joints);
        }
    }
    Ok(motions.into_iter().map(RobotMotion::Joints).collect())
}

/// Robots such that each comes after the one that carries it.
fn mounting_order(cell: &Cell<'_>) -> Vec<usize> {
    let mut order: Vec<usize> = (0..cell.layout.robots.len()).collect();
    order.sort_by_key(|robot| (cell.tree.frames[cell.tree.robots[*robot][0]].depth, *robot));
    order
}

/// What is to be seen of a robot, and by it.
struct Watched {
    /// Targets on its flange.
    targets: Vec<usize>,
    /// Cameras elsewhere that can see them.
    watchers: Vec<usize>,
    /// Cameras on its flange.
    cameras: Vec<usize>,
}

impl Watched {
    fn new(cell: &Cell<'_>, robot: usize) -> Self {
        let flange = cell.tree.robots[robot].last().copied().unwrap_or(0);
        let on_flange = |frame: FrameId| cell.tree.body(frame) == flange;
        let lenses = cell.layout.cameras.iter().enumerate().filter(|(_, camera)| camera.intrinsics.is_some());
        let (cameras, watchers) = lenses.map(|(i, _)| i).partition(|camera| on_flange(cell.tree.cameras[*camera]));
        let targets = (0..cell.layout.targets.len()).filter(|i| {
            let geometry = &cell.layout.targets[*i].true_geometry;
            on_flange(cell.tree.targets[*i]) && !matches!(geometry, TargetGeometry::None | TargetGeometry::Points(_))
        });
        Self { targets: targets.collect(), watchers, cameras }
    }
}

/// How many joint values failed for which reason, and for which robot.
#[derive(Clone, Copy, Debug, Default)]
struct Failed {
    robot: usize,
    floor: usize,
    collision: usize,
    unseen: usize,
}

/// Why joint values were not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Refusal {
    Hit(Hit),
    Unseen,
}

struct Planner<'a> {
    layout: &'a Layout,
    ranges: Vec<Ranges>,
    obstacles: Obstacles,
    watched: Vec<Watched>,
    order: Vec<usize>,
    tree: Arc<FrameTree>,
    seed: u64,
}

impl Planner<'_> {
    /// Joint values of all robots at a stop.
    fn place_all(&self, stop: u64, attempt: u64, earlier: &[BTreeMap<u64, Vec<f64>>]) -> Result<Vec<Vec<f64>>, Failed> {
        let mut joints: Vec<Option<Vec<f64>>> = vec![None; self.layout.robots.len()];
        for (place, &robot) in self.order.iter().enumerate() {
            let standing = &self.order[..place];
            joints[robot] = Some(self.place(robot, standing, &joints, (stop, attempt), &earlier[robot])?);
        }
        Ok(joints.into_iter().flatten().collect())
    }

    /// Joint values of one robot: of a few good ones, those farthest from all earlier stops.
    fn place(
        &self,
        robot: usize,
        standing: &[usize],
        joints: &[Option<Vec<f64>>],
        (stop, attempt): (u64, u64),
        earlier: &BTreeMap<u64, Vec<f64>>,
    ) -> Result<Vec<f64>, Failed> {
        let mut good: Vec<Vec<f64>> = Vec::new();
        let mut failed = Failed { robot, ..Failed::default() };
        for batch in 0..MOST_BATCHES {
            // Every second stop is for the robot's own camera too.
            let with_own_camera = stop.is_multiple_of(2) && batch < CONTENT;
            let tried: Vec<(Vec<f64>, Option<Refusal>)> = (0..BATCH)
                .into_par_iter()
                .map(|i| {
                    let which = [stop, (robot as u64) << 32 | attempt, (batch * BATCH + i) as u64];
                    let mut random = stream(self.seed, Purpose::Path, which);
                    let range = |[least, most]: &[f64; 2]| least + (most - least) * random.random::<f64>();
                    let values: Vec<f64> = self.ranges[robot].iter().map(range).collect();
                    let refusal = self.refuse(robot, standing, joints, &values, with_own_camera);
                    (values, refusal)
                })
                .collect();
            for (values, refusal) in tried {
                match refusal {
                    None => good.push(values),
                    Some(Refusal::Hit(Hit::Floor)) => failed.floor += 1,
                    Some(Refusal::Hit(_)) => failed.collision += 1,
                    Some(Refusal::Unseen) => failed.unseen += 1,
                }
            }
            if good.len() >= CHOICE || (!good.is_empty() && batch >= CONTENT) {
                break;
            }
        }
        good.truncate(CHOICE);
        let apart = |values: &Vec<f64>| {
            let to = |other: &Vec<f64>| values.iter().zip(other).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
            earlier.values().map(to).fold(f64::INFINITY, f64::min)
        };
        good.into_iter().max_by(|a, b| apart(a).total_cmp(&apart(b))).ok_or(failed)
    }

    /// Why a robot cannot stand at `values` while the robots before it stand where they do.
    fn refuse(
        &self,
        robot: usize,
        standing: &[usize],
        joints: &[Option<Vec<f64>>],
        values: &[f64],
        with_own_camera: bool,
    ) -> Option<Refusal> {
        let motion = |(i, given): (usize, &Option<Vec<f64>>)| {
            let values = if i == robot { Some(values.to_vec()) } else { given.clone() };
            RobotMotion::Joints(values.into_iter().map(|values| (0, values)).collect())
        };
        let recording = Recording { motions: joints.iter().enumerate().map(motion).collect(), ..Recording::default() };
        let cell = Cell::with_tree(self.layout, &recording, Arc::clone(&self.tree));
        if let Some(hit) = self.obstacles.collision(&cell, robot, standing, 0) {
            return Some(Refusal::Hit(hit));
        }
        let watched = &self.watched[robot];
        let shown = watched.targets.is_empty()
            || watched.watchers.is_empty()
            || watched
                .watchers
                .iter()
                .any(|camera| watched.targets.iter().any(|target| self.sees(&cell, *camera, *target)));
        let others = || (0..self.layout.targets.len()).filter(|target| !watched.targets.contains(target));
        let own_camera_needed = !watched.cameras.is_empty() && (with_own_camera || watched.targets.is_empty());
        let looks = || watched.cameras.iter().any(|camera| others().any(|target| self.sees(&cell, *camera, target)));
        (!(shown && (!own_camera_needed || looks()))).then_some(Refusal::Unseen)
    }

    fn sees(&self, cell: &Cell<'_>, camera: usize, target: usize) -> bool {
        let Some(intrinsics) = &self.layout.cameras[camera].intrinsics else { return false };
        let (from, to) = (self.tree.cameras[camera], self.tree.targets[target]);
        cell.pose(from, to, 0).is_some_and(|camera_from_target| {
            let seen = |bodies: &[_]| !visible(cell, intrinsics, &camera_from_target, target, bodies).is_empty();
            // What is not seen in an empty cell is not seen behind bodies either, which are slow to place.
            seen(&[]) && seen(&self.obstacles.hiding(cell, from, to, 0))
        })
    }

    fn no_path(&self, stop: u64, failed: Failed) -> Complaint {
        let robot = &self.layout.robots[failed.robot];
        let all = (failed.floor + failed.collision + failed.unseen).max(1);
        let percent = |count: usize| (100.0 * count as f64 / all as f64).round();
        Complaint::at(
            &self.layout.file,
            robot.line,
            format!(
                "no joint values were found for robot `{}` at configuration {stop}: of {all} tried, {} % go below its base, {} % collide, \
                 in {} % nothing is seen of what it carries or by its camera",
                robot.name,
                percent(failed.floor),
                percent(failed.collision),
                percent(failed.unseen)
            ),
            "give ranges in which it works: `simulate: {joints: {NAME: [[least, greatest], ...]}}`, check the poses, or allow it below its base with \
             `floor: none`",
        )
    }
}
