//! Growing what is known from the world outwards.

use nalgebra::{Vector2, Vector3};
use thiserror::Error;

use super::consensus::{Votes, consensus};
use super::hand_eye::{self, HandEyeVote};
use super::moving::drop_unplaced;
use super::observe::{Observation, observe, renumber_boards};
use super::register::{RobotPoint, register_robot, rigid_fit, triangulate};
use crate::frames::{FrameId, FrameTree, Freedom, Path, Step};
use crate::geometry::{Intrinsics, Pose};
use crate::layout::Layout;
use crate::recording::Recording;
use crate::solve::{GroupKind, Plan, State};

/// Why no start was found although everything hangs together.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("no starting value was found for {}", .edges.join(", "))]
pub struct InitialiseError {
    /// The poses without a start, `parent_from_child`.
    pub edges: Vec<String>,
}

/// Whole poses measured along one path.
pub(super) struct Relation {
    pub(super) path: Path,
    /// None: the same at every configuration.
    pub(super) observations: Vec<Observation>,
    /// Hand-eye has had its turn.
    pub(super) spent: bool,
}

/// Points measured along one path.
struct PointRelation {
    path: Path,
    /// (configuration, place in the frame at the path's end, measured).
    data: Vec<(usize, Vector3<f64>, Vector3<f64>)>,
    spent: bool,
}

pub(super) struct Growth<'a> {
    layout: &'a Layout,
    pub(super) tree: &'a FrameTree,
    recording: &'a Recording,
    pub(super) plan: &'a Plan,
    pub(super) state: State,
    known: Vec<bool>,
    /// Edges whose start was given, which nobody moves.
    given: Vec<bool>,
    pub(super) relations: Vec<Relation>,
    points: Vec<PointRelation>,
}

/// A run of unknown static steps on a path with nothing known to vary in between: its first and last step.
type Run = (usize, usize);

/// Where the search starts.
#[derive(Clone, Debug, PartialEq)]
pub struct Start {
    /// A value for everything.
    pub state: State,
    /// Measurements of moving targets that were taken out of the plan, because at their configuration nothing shows enough of the target for a pose.
    pub dropped: usize,
}

/// Finds a start for every unknown that measurements reach, and numbers symmetric boards. `start` gives starting poses by key that take
/// the place of what the layout says.
///
/// # Errors
/// When some pose stays without a start: too few points in every picture, or three unknown poses in one loop.
pub fn initialise(
    layout: &Layout,
    tree: &FrameTree,
    recording: &Recording,
    plan: &mut Plan,
    start: &[(String, Pose)],
) -> Result<Start, InitialiseError> {
    let start_of = |edge: &crate::frames::StaticEdge| {
        let given = start.iter().find(|(key, _)| *key == edge.key && edge.freedom != Freedom::Fixed);
        given.map(|(_, pose)| *pose).or(edge.spec.pose())
    };
    let starts: Vec<Option<Pose>> = tree.static_edges.iter().map(start_of).collect();
    let lens = |intrinsics: &Option<Intrinsics>| intrinsics.as_ref().map_or([0.0; 12], |i| *i.parameters());
    let mut growth = Growth {
        layout,
        tree,
        recording,
        plan,
        known: starts.iter().map(Option::is_some).collect(),
        given: starts.iter().map(Option::is_some).collect(),
        state: State {
            static_poses: starts.into_iter().map(Option::unwrap_or_default).collect(),
            moving_poses: vec![vec![Pose::identity(); plan.configurations.len()]; plan.moving_count()],
            corrections: layout.robots.iter().map(|robot| robot.corrections.clone()).collect(),
            lenses: layout.cameras.iter().map(|camera| lens(&camera.intrinsics)).collect(),
        },
        relations: Vec::new(),
        points: Vec::new(),
    };
    let symmetric = layout.targets.iter().any(|target| target.geometry.symmetries().len() > 1);
    let complete = growth.wanted().is_empty() && tree.moving_edges.is_empty();
    if !complete || symmetric {
        growth.gather();
        while growth.place_one() || growth.hand_eye() || growth.register() {}
        growth.settle();
    }
    let missing = growth.wanted();
    if !missing.is_empty() {
        return Err(InitialiseError {
            edges: missing.into_iter().map(|edge| tree.static_edges[edge].key.clone()).collect(),
        });
    }
    let placed = growth.place_moving();
    let poses = growth.block_poses();
    let state = growth.state;
    renumber_boards(layout, tree, recording, plan, &poses);
    Ok(Start { state, dropped: drop_unplaced(plan, &placed) })
}

impl Growth<'_> {
    /// The unknown edges that some measurement crosses and that have no value yet.
    fn wanted(&self) -> Vec<usize> {
        let crossed = |edge: usize| {
            self.plan.groups.iter().any(|group| {
                group.path.steps.iter().any(|step| matches!(step, Step::Static { edge: e, .. } if *e == edge))
            })
        };
        (0..self.known.len()).filter(|&edge| !self.known[edge] && crossed(edge)).collect()
    }

    /// Takes candidate poses and points from all measurements.
    fn gather(&mut self) {
        for group in &self.plan.groups {
            let observations = observe(self.layout, self.tree, self.recording, self.plan, group);
            if !observations.is_empty() {
                self.relations.push(Relation { path: group.path.clone(), observations, spent: false });
            }
            if group.kind == GroupKind::Points {
                let data = group.blocks.iter().flat_map(|block| {
                    let points = &self.plan.measurements.points[block.start..block.end];
                    points.iter().flatten().map(|(place, measured)| (block.configuration, *place, *measured))
                });
                self.points.push(PointRelation { path: group.path.clone(), data: data.collect(), spent: false });
            }
        }
        self.relate_through_moving();
    }

    /// The runs of unknown steps on a path; `None` if a moving edge is among the steps.
    fn runs(&self, path: &Path) -> Option<Vec<Run>> {
        let mut runs: Vec<Run> = Vec::new();
        let mut varied = true;
        for (i, step) in path.steps.iter().enumerate() {
            match step {
                Step::Static { edge, .. } if !self.known[*edge] => {
                    match runs.last_mut() {
                        Some(run) if !varied => run.1 = i,
                        _ => runs.push((i, i)),
                    }
                    varied = false;
                }
                Step::Static { .. } => {}
                Step::Robot { .. } => varied = true,
                Step::Moving { .. } => return None,
            }
        }
        Some(runs)
    }

    fn value(&self, step: &Step, configuration: usize) -> Pose {
        let (pose, inverse) = match *step {
            Step::Static { edge, inverse } => (self.state.static_poses[edge], inverse),
            Step::Moving { edge, inverse } => (self.state.moving_poses[edge][configuration], inverse),
            Step::Robot { robot, from, to, inverse } => {
                let id = self.plan.configurations[configuration];
                (self.recording.robot_segment(self.layout, robot, id, from, to).unwrap_or_default(), inverse)
            }
        };
        if inverse { pose.inverse() } else { pose }
    }

    pub(super) fn product(&self, steps: &[Step], configuration: usize) -> Pose {
        steps.iter().fold(Pose::identity(), |pose, step| pose * self.value(step, configuration))
    }

    /// The one unknown edge of a path, where it stands, and whether it is walked upwards.
    fn single(&self, path: &Path) -> Option<(usize, usize, bool)> {
        let runs = self.runs(path)?;
        let [(first, last)] = runs[..] else { return None };
        let mut unknown = (first..=last).filter_map(|i| match path.steps[i] {
            Step::Static { edge, inverse } if !self.known[edge] => Some((edge, i, inverse)),
            _ => None,
        });
        let only = unknown.next()?;
        unknown.next().is_none().then_some(only)
    }

    /// Candidate values for every edge that is the only unknown of some relation.
    fn votes_for(&self, wanted: impl Fn(&Path) -> Option<(usize, usize, bool)>) -> Vec<Vec<Votes>> {
        let mut votes: Vec<Vec<Votes>> = vec![Vec::new(); self.known.len()];
        for relation in &self.relations {
            let Some((edge, at, inverse)) = wanted(&relation.path) else { continue };
            let steps = &relation.path.steps;
            for observation in &relation.observations {
                let before = self.product(&steps[..at], observation.configuration).inverse();
                let after = self.product(&steps[at + 1..], observation.configuration).inverse();
                let place = |measured: &Pose| {
                    let value = before * *measured * after;
                    if inverse { value.inverse() } else { value }
                };
                let candidates = observation.votes.candidates.iter().map(place).collect();
                votes[edge].push(Votes { candidates, ..observation.votes.clone() });
            }
        }
        votes
    }

    /// Places the edge with the most measurements behind it among those whose paths are otherwise known.
    fn place_one(&mut self) -> bool {
        let votes = self.votes_for(|path| self.single(path));
        let weight = |votes: &[Votes]| votes.iter().map(|vote| vote.weight).sum::<f64>();
        let best = (0..votes.len()).max_by(|a, b| weight(&votes[*a]).total_cmp(&weight(&votes[*b])).then(b.cmp(a)));
        if let Some(edge) = best
            && let Some((pose, _)) = consensus(&votes[edge])
        {
            self.set(edge, pose);
            return true;
        }
        self.place_by_points() || self.triangulate_one()
    }

    fn set(&mut self, edge: usize, pose: Pose) {
        self.state.static_poses[edge] = match self.tree.static_edges[edge].freedom {
            Freedom::Translation => Pose::new(self.state.static_poses[edge].rotation, pose.translation),
            _ => pose,
        };
        self.known[edge] = true;
    }

    /// Places an edge from measured points whose paths are otherwise known.
    fn place_by_points(&mut self) -> bool {
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
    fn triangulate_one(&mut self) -> bool {
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
                for pixel in &self.plan.measurements.corner_pixels[block.start..block.end] {
                    if let Ok(ray) = intrinsics.ray(&Vector2::from(*pixel)) {
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

    /// Solves the pair of unknown runs around a robot that most pictures see, and keeps both as relations.
    fn hand_eye(&mut self) -> bool {
        let mut order: Vec<usize> = (0..self.relations.len()).filter(|&i| !self.relations[i].spent).collect();
        order.sort_by_key(|&i| (std::cmp::Reverse(self.relations[i].observations.len()), i));
        for index in order {
            let relation = &self.relations[index];
            let Some(runs) = self.runs(&relation.path) else { continue };
            let [(a, b), (c, d)] = runs[..] else { continue };
            let steps = &relation.path.steps;
            let votes: Vec<HandEyeVote> = relation
                .observations
                .iter()
                .map(|observation| {
                    let at = observation.configuration;
                    let (before, after) =
                        (self.product(&steps[..a], at).inverse(), self.product(&steps[d + 1..], at).inverse());
                    let candidates = observation.votes.candidates.iter().map(|z| before * *z * after).collect();
                    HandEyeVote {
                        robot: self.product(&steps[b + 1..c], at),
                        votes: Votes { candidates, ..observation.votes.clone() },
                    }
                })
                .collect();
            let stops = &relation.path.stops;
            let ends = [(stops[a], stops[b + 1]), (stops[c], stops[d + 1])];
            self.relations[index].spent = true;
            let Some(solution) = hand_eye::solve(&votes) else { continue };
            let weight = votes.iter().map(|vote| vote.votes.weight * (1.0 - solution.disagreement)).sum();
            self.relate(ends[0], solution.near, weight);
            self.relate(ends[1], solution.far, weight);
            return true;
        }
        false
    }

    /// Adds a pose between two frames of one rigid body as a relation.
    fn relate(&mut self, (from, to): (FrameId, FrameId), pose: Pose, weight: f64) {
        let distance = pose.translation.norm().max(0.1);
        let votes = Votes { candidates: vec![pose], weight: weight.max(1e-3), distance };
        let observations = vec![Observation { configuration: 0, votes }];
        self.relations.push(Relation { path: self.tree.path(from, to), observations, spent: true });
    }

    /// Registers a point sensor to a robot whose tool points are unknown.
    fn register(&mut self) -> bool {
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

    /// Looks at every edge once more in the light of all the others: a flip that one picture could not decide is decided by the rest.
    fn settle(&mut self) {
        for _ in 0..2 {
            for edge in 0..self.known.len() {
                let free = !self.given[edge] && self.known[edge];
                if !free || self.tree.static_edges[edge].freedom != Freedom::Pose {
                    continue;
                }
                self.known[edge] = false;
                let votes = self.votes_for(|path| self.single(path).filter(|(found, ..)| *found == edge));
                self.known[edge] = true;
                let now = Votes { candidates: vec![self.state.static_poses[edge]], weight: 1e-9, distance: 1.0 };
                let mut with_now = vec![now];
                with_now.extend(votes[edge].iter().cloned());
                if let Some((pose, _)) = consensus(&with_now) {
                    self.state.static_poses[edge] = pose;
                }
            }
        }
    }

    fn block_poses(&self) -> Vec<Vec<Pose>> {
        let pose = |path: &Path, configuration| self.product(&path.steps, configuration);
        let groups = self.plan.groups.iter();
        groups.map(|g| g.blocks.iter().map(|b| pose(&g.path, b.configuration)).collect()).collect()
    }
}
