//! Growing what is known from the world outwards.

use rayon::prelude::*;
use thiserror::Error;

use super::consensus::{Votes, consensus};
use super::grow_points::PointRelation;
use super::hand_eye::{self, HandEyeVote};
use super::moving::drop_unplaced;
use super::observe::{Observation, observe, renumber_boards};
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

pub(super) struct Growth<'a> {
    pub(super) layout: &'a Layout,
    pub(super) tree: &'a FrameTree,
    recording: &'a Recording,
    pub(super) plan: &'a Plan,
    pub(super) state: State,
    pub(super) known: Vec<bool>,
    /// Edges whose start was given, which nobody moves.
    given: Vec<bool>,
    pub(super) relations: Vec<Relation>,
    pub(super) points: Vec<PointRelation>,
}

/// A run of unknown static steps on a path with nothing known to vary in between: its first and last step.
pub(super) type Run = (usize, usize);

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
    let poses = symmetric.then(|| growth.block_poses());
    let state = growth.state;
    if let Some(poses) = poses {
        renumber_boards(layout, tree, plan, &poses);
    }
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
            let observations = observe(self.layout, self.tree, self.plan, group);
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
    pub(super) fn runs(&self, path: &Path) -> Option<Vec<Run>> {
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
    pub(super) fn single(&self, path: &Path) -> Option<(usize, usize, bool)> {
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
            let one = |observation: &Observation| {
                let before = self.product(&steps[..at], observation.configuration).inverse();
                let after = self.product(&steps[at + 1..], observation.configuration).inverse();
                let place = |measured: &Pose| {
                    let value = before * *measured * after;
                    if inverse { value.inverse() } else { value }
                };
                let candidates = observation.votes.candidates.iter().map(place).collect();
                Votes { candidates, ..observation.votes.clone() }
            };
            votes[edge].par_extend(relation.observations.par_iter().map(one));
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

    pub(super) fn set(&mut self, edge: usize, pose: Pose) {
        self.state.static_poses[edge] = match self.tree.static_edges[edge].freedom {
            Freedom::Translation => Pose::new(self.state.static_poses[edge].rotation, pose.translation),
            _ => pose,
        };
        self.known[edge] = true;
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
                .par_iter()
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
    pub(super) fn relate(&mut self, (from, to): (FrameId, FrameId), pose: Pose, weight: f64) {
        let distance = pose.translation.norm().max(0.1);
        let votes = Votes { candidates: vec![pose], weight: weight.max(1e-3), distance };
        let observations = vec![Observation { configuration: 0, votes }];
        self.relations.push(Relation { path: self.tree.path(from, to), observations, spent: true });
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
