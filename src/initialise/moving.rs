//! Targets that move: what they tell of the sensors that see them together, and where they were themselves.

use std::collections::BTreeMap;

use super::consensus::{Votes, consensus};
use super::grow::{Growth, Relation};
use super::observe::Observation;
use crate::frames::Step;
use crate::geometry::Pose;
use crate::solve::Plan;

impl Growth<'_> {
    /// Two views of one moving target at one configuration relate their sensors (or two of its parts, seen by one sensor).
    pub(super) fn relate_through_moving(&mut self) {
        let crossing: Vec<usize> = (0..self.relations.len())
            .filter(|&i| self.relations[i].path.steps.iter().any(|step| matches!(step, Step::Moving { .. })))
            .collect();
        let mut derived = Vec::new();
        for (n, &first) in crossing.iter().enumerate() {
            for &second in &crossing[n + 1..] {
                let (a, b) = (&self.relations[first], &self.relations[second]);
                let same_target = a.path.to == b.path.to;
                let same_sensor = a.path.from == b.path.from;
                if same_target == same_sensor {
                    continue;
                }
                let path = if same_target {
                    self.tree.path(a.path.from, b.path.from)
                } else {
                    self.tree.path(a.path.to, b.path.to)
                };
                let mut observations = Vec::new();
                for left in &a.observations {
                    for right in b.observations.iter().filter(|right| right.configuration == left.configuration) {
                        let pair = |x: &Pose, y: &Pose| if same_target { *x * y.inverse() } else { x.inverse() * *y };
                        let candidates = left.votes.candidates.iter();
                        let candidates =
                            candidates.flat_map(|x| right.votes.candidates.iter().map(move |y| pair(x, y)));
                        observations.push(Observation {
                            configuration: left.configuration,
                            votes: Votes {
                                candidates: candidates.collect(),
                                weight: left.votes.weight.min(right.votes.weight),
                                distance: left.votes.distance.max(right.votes.distance),
                            },
                        });
                    }
                }
                if !observations.is_empty() {
                    derived.push(Relation { path, observations, spent: false });
                }
            }
        }
        self.relations.extend(derived);
    }

    /// Places every moving edge at every configuration where something shows enough of it; says where that was, by edge and configuration. What stands on
    /// something that moves is placed after it.
    pub(super) fn place_moving(&mut self) -> Vec<Vec<bool>> {
        let mut placed = vec![vec![false; self.plan.configurations.len()]; self.tree.moving_edges.len()];
        loop {
            let mut votes: BTreeMap<(usize, usize), Vec<Votes>> = BTreeMap::new();
            for relation in &self.relations {
                let steps = &relation.path.steps;
                for observation in &relation.observations {
                    let at = observation.configuration;
                    let mut open = steps.iter().enumerate().filter_map(|(i, step)| match step {
                        Step::Moving { edge, inverse } if !placed[*edge][at] => Some((i, *edge, *inverse)),
                        _ => None,
                    });
                    let (Some((i, edge, inverse)), None) = (open.next(), open.next()) else { continue };
                    let (before, after) =
                        (self.product(&steps[..i], at).inverse(), self.product(&steps[i + 1..], at).inverse());
                    let place = |z: &Pose| {
                        let value = before * *z * after;
                        if inverse { value.inverse() } else { value }
                    };
                    let candidates = observation.votes.candidates.iter().map(place).collect();
                    votes.entry((edge, at)).or_default().push(Votes { candidates, ..observation.votes.clone() });
                }
            }
            let before: usize = placed.iter().flatten().filter(|placed| **placed).count();
            for ((edge, configuration), votes) in votes {
                if let Some((pose, _)) = consensus(&votes) {
                    self.state.moving_poses[edge][configuration] = pose;
                    placed[edge][configuration] = true;
                }
            }
            if placed.iter().flatten().filter(|placed| **placed).count() == before {
                return placed;
            }
        }
    }
}

/// Takes blocks out of the plan whose path crosses a moving edge that has no start there; counts their measurements.
pub(super) fn drop_unplaced(plan: &mut Plan, placed: &[Vec<bool>]) -> usize {
    let mut dropped = 0;
    for group in &mut plan.groups {
        let edges: Vec<usize> = group.compiled.moving.iter().map(|(_, edge)| *edge).collect();
        group.blocks.retain(|block| {
            // Where a robot really stops starts at its log and needs no placing.
            let keep = edges.iter().all(|edge| placed.get(*edge).is_none_or(|at| at[block.configuration]));
            dropped += if keep { 0 } else { block.end - block.start };
            keep
        });
    }
    dropped
}
