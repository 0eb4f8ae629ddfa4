//! Compiling a layout and its recording into arrays and column numbers.
//!
//! After this, nothing in the loop speaks of names: measurements are grouped by path and kind, and within a group by configuration, so that all
//! shots of one target by one camera at one configuration are one block with one transform.

use nalgebra::Vector3;
use std::collections::HashMap;
use thiserror::Error;

use super::assemble::shape;
use super::equations::{Equations, Solver};
use super::gather::{Gathered, check_motion, gather, seen_unknowns};
use super::measurements::{Contact, Measurements};
use super::robots::stops;
use super::unknowns::Unknowns;
use crate::frames::{FrameId, FrameTree, Freedom, Path, Step};
use crate::geometry::Feature;
use crate::layout::{Layout, PoseSigma, SolveSettings};
use crate::recording::{ContactRow, PointRow, Recording};

/// A step of a path with the places of its unknowns among the path's own columns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CompiledStep {
    /// A static edge; `column` is (first, count) if it is to be found.
    Static {
        /// Index into the tree's static edges.
        edge: usize,
        /// Walked upwards.
        inverse: bool,
        /// Its place among the path's columns.
        column: Option<(usize, usize)>,
    },
    /// A moving edge: six columns.
    Moving {
        /// Index into the tree's moving edges.
        edge: usize,
        /// Walked upwards.
        inverse: bool,
        /// Its first column.
        column: usize,
    },
    /// A robot segment; `column` is (first, count) if its links are to be found.
    Robot {
        /// Index into [`Plan::segments`].
        segment: usize,
        /// Walked towards the base.
        inverse: bool,
        /// Its place among the path's columns.
        column: Option<(usize, usize)>,
    },
}

/// A path ready for the loop.
#[derive(Clone, Debug, PartialEq)]
pub struct CompiledPath {
    /// The factors.
    pub steps: Vec<CompiledStep>,
    /// Shared columns first: (first path column, first shared column, count).
    pub shared: Vec<(usize, usize, usize)>,
    /// Then moving edges: (first path column, moving edge).
    pub moving: Vec<(usize, usize)>,
    /// All columns.
    pub columns: usize,
}

/// A part of a robot that some path walks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Segment {
    /// The robot's place in the layout.
    pub robot: usize,
    /// Nearer the base.
    pub from: usize,
    /// Nearer the flange.
    pub to: usize,
}

/// A robot that does not stop quite where its log says: a small twist of its flange at each configuration, treated like a moving edge with a belief
/// about it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stop {
    /// The robot's place in the layout.
    pub robot: usize,
    /// Standard deviations of the twist.
    pub sigma: PoseSigma,
}

/// What kind of measurement a group holds; ranges of its blocks point into the arrays of that kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum GroupKind {
    /// Corners seen by a camera.
    Corners {
        /// The camera's place in the layout.
        camera: usize,
    },
    /// Whole poses.
    Poses,
    /// Points.
    Points,
    /// Contacts.
    Contacts,
}

/// Measurements of one kind along one path.
#[derive(Clone, Debug)]
pub struct Group {
    /// The path.
    pub path: Path,
    /// The path with columns.
    pub compiled: CompiledPath,
    /// What is measured.
    pub kind: GroupKind,
    /// By configuration.
    pub blocks: Vec<Block>,
}

/// All measurements of a group at one configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Block {
    /// Its number among all blocks of the plan.
    pub place: usize,
    /// Index into [`Plan::configurations`].
    pub configuration: usize,
    /// Range in the arrays of the group's kind.
    pub start: usize,
    /// End of the range.
    pub end: usize,
}

/// A problem ready to be solved.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Every configuration that has a measurement, in order.
    pub configurations: Vec<u64>,
    /// In the order of kinds and paths.
    pub groups: Vec<Group>,
    /// The numbers.
    pub measurements: Measurements,
    /// The shared unknowns.
    pub unknowns: Unknowns,
    /// Moving edges of the frame tree; those of [`Plan::stops`] are counted on from there.
    pub moving_edges: usize,
    /// Robots that stop inexactly.
    pub stops: Vec<Stop>,
    /// Robot segments that paths walk.
    pub segments: Vec<Segment>,
    /// The layout's `solve` section.
    pub settings: SolveSettings,
    /// Whether the shared equations are dense or sparse.
    pub(crate) equations: Equations,
}

/// A measurement that cannot be placed.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum PlanError {
    /// The robot's place at the configuration is not recorded.
    #[error(
        "configuration {configuration} has a measurement by `{sensor}` but robot `{robot}` has no joint values there"
    )]
    NoMotion {
        /// The configuration.
        configuration: u64,
        /// Who measured.
        sensor: String,
        /// Which robot's place is missing.
        robot: String,
    },
}

impl Plan {
    /// Compiles a recording.
    ///
    /// # Errors
    /// [`PlanError::NoMotion`] for a measurement at a configuration where a robot on its path was not recorded.
    pub fn new(layout: &Layout, tree: &FrameTree, recording: &Recording) -> Result<Self, PlanError> {
        Self::of(layout, tree, recording, None)
    }

    /// Other measurements of the same unknowns, with the same equations.
    ///
    /// # Errors
    /// As [`Plan::new`].
    pub fn part(&self, layout: &Layout, tree: &FrameTree, recording: &Recording) -> Result<Self, PlanError> {
        Self::of(layout, tree, recording, Some(self))
    }

    fn of(layout: &Layout, tree: &FrameTree, recording: &Recording, whole: Option<&Self>) -> Result<Self, PlanError> {
        let Gathered { rows: gathered, places } = gather(layout, tree, recording);
        let mut configurations: Vec<u64> = gathered.values().flat_map(|by| by.keys().copied()).collect();
        configurations.sort_unstable();
        configurations.dedup();
        let paths: Vec<Path> = gathered.keys().map(|(_, from, to)| tree.path(*from, *to)).collect();
        check_motion(layout, tree, recording, &gathered, &paths)?;
        let seen = || seen_unknowns(layout, tree, gathered.keys().map(|key| key.0).zip(&paths));
        let unknowns = whole.map_or_else(seen, |whole| whole.unknowns.clone());
        let mut plan = Self {
            configurations,
            groups: Vec::new(),
            measurements: Measurements::new(&recording.corners, places, layout.solve.pixel_sigma),
            unknowns,
            moving_edges: tree.moving_edges.len(),
            stops: stops(layout),
            segments: Vec::new(),
            settings: layout.solve,
            equations: Equations::default(),
        };
        let mut known: HashMap<Segment, usize> = HashMap::new();
        let mut count = 0;
        for (((kind, ..), rows), path) in gathered.into_iter().zip(paths) {
            let compiled = plan.compile(tree, &path, &mut known);
            let mut blocks = Vec::with_capacity(rows.len());
            for (configuration, rows) in rows {
                let start = plan.length(kind);
                for rows in rows {
                    plan.store(layout, tree, recording, kind, rows);
                }
                let configuration = plan.configurations.binary_search(&configuration).unwrap_or(0);
                blocks.push(Block { place: count, configuration, start, end: plan.length(kind) });
                count += 1;
            }
            plan.groups.push(Group { path, compiled, kind, blocks });
        }
        let shapes: Vec<_> = plan.groups.iter().map(|group| shape(&plan.unknowns, group)).collect();
        let choose = || Equations::new(&plan.unknowns, &plan.groups, &shapes, layout.solve.solver);
        plan.equations = whole.map_or_else(choose, |whole| whole.equations.clone());
        Ok(plan)
    }

    /// How the shared equations are solved, and why.
    #[must_use]
    pub fn solver(&self) -> Solver {
        self.equations.solver
    }

    fn length(&self, kind: GroupKind) -> usize {
        let m = &self.measurements;
        match kind {
            GroupKind::Corners { .. } => m.corner_count(),
            GroupKind::Poses => m.poses.len(),
            GroupKind::Points => m.points.len(),
            GroupKind::Contacts => m.contacts.len(),
        }
    }

    fn store(
        &mut self,
        layout: &Layout,
        tree: &FrameTree,
        recording: &Recording,
        kind: GroupKind,
        rows: std::ops::Range<usize>,
    ) {
        let m = &mut self.measurements;
        let place = |target: usize, feature: &Feature| {
            tree.locate(layout, target, feature).map_or_else(Vector3::zeros, |(_, place)| place)
        };
        match kind {
            GroupKind::Corners { .. } => m.add_corners(rows),
            GroupKind::Poses => m.poses.extend(recording.poses[rows].iter().map(|row| Some(row.pose))),
            GroupKind::Points => {
                let point = |row: &PointRow| Some((place(row.target, &row.feature), row.position));
                m.points.extend(recording.points[rows].iter().map(point));
            }
            GroupKind::Contacts => {
                let contact = |row: &ContactRow| {
                    let [(ta, fa), (tb, fb)] = &row.points;
                    Some(Contact { a: place(*ta, fa), b: place(*tb, fb), distance: row.distance })
                };
                m.contacts.extend(recording.contacts[rows].iter().map(contact));
            }
        }
    }

    /// A path ready for [`super::Assembler::along`]; robot segments that no measurement walks are added to the plan.
    pub fn path(&mut self, tree: &FrameTree, from: FrameId, to: FrameId) -> CompiledPath {
        let mut known = self.segments.iter().enumerate().map(|(place, segment)| (*segment, place)).collect();
        self.compile(tree, &tree.path(from, to), &mut known)
    }

    fn compile(&mut self, tree: &FrameTree, path: &Path, known: &mut HashMap<Segment, usize>) -> CompiledPath {
        let (mut shared, mut moving, mut columns) = (Vec::new(), Vec::new(), 0);
        let mut take = |unknowns: &Unknowns, block: Option<usize>| {
            let block = &unknowns.blocks[block?];
            let place = (columns, block.count());
            shared.push((columns, block.start, block.count()));
            columns += block.count();
            Some(place)
        };
        let mut steps: Vec<CompiledStep> = Vec::with_capacity(path.steps.len());
        for step in &path.steps {
            match *step {
                Step::Static { edge, inverse } => {
                    let column = take(&self.unknowns, self.unknowns.edge(edge));
                    debug_assert!(column.is_none() || tree.static_edges[edge].freedom != Freedom::Fixed);
                    steps.push(CompiledStep::Static { edge, inverse, column });
                }
                Step::Moving { edge, inverse } => steps.push(CompiledStep::Moving { edge, inverse, column: 0 }),
                Step::Robot { robot, from, to, inverse } => {
                    let column = take(&self.unknowns, self.unknowns.links(robot));
                    let next = self.segments.len();
                    let segment = *known.entry(Segment { robot, from, to }).or_insert(next);
                    if segment == next {
                        self.segments.push(Segment { robot, from, to });
                    }
                    steps.push(CompiledStep::Robot { segment, inverse, column });
                    // What moves is the flange, so a path that leaves the robot at a link before it knows nothing of it.
                    let at_flange = to + 1 == tree.robots[robot].len();
                    if let (true, Some(stop)) = (at_flange, self.stops.iter().position(|stop| stop.robot == robot)) {
                        let twist = CompiledStep::Moving { edge: self.moving_edges + stop, inverse, column: 0 };
                        steps.insert(steps.len() - usize::from(inverse), twist);
                    }
                }
            }
        }
        for step in &mut steps {
            if let CompiledStep::Moving { edge, column, .. } = step {
                *column = columns;
                moving.push((columns, *edge));
                columns += 6;
            }
        }
        CompiledPath { steps, shared, moving, columns }
    }

    /// The number of blocks of all groups.
    #[must_use]
    pub fn block_count(&self) -> usize {
        self.groups.iter().map(|group| group.blocks.len()).sum()
    }

    /// Moving edges and inexact stops together: how many poses a state has for each configuration.
    #[must_use]
    pub fn moving_count(&self) -> usize {
        self.moving_edges + self.stops.len()
    }

    /// The number of scalar measurements that have not been rejected.
    #[must_use]
    pub fn scalar_count(&self) -> usize {
        self.measurements.scalar_count()
    }
}
