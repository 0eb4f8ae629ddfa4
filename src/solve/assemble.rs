//! From condensed blocks to the normal equations of the shared unknowns.
//!
//! The work is cut into *units* by the data alone: a run of blocks of one group, or, where targets move, everything at one configuration.
//! Each unit fills its own compact matrix, in parallel; the sums are folded in the order of units, so the bits do not depend on how many threads
//! there were.

use rayon::prelude::*;

use super::chain::{SegmentValues, pose_along, pose_and_jacobian};
use super::expand::{add_compact, expand_condensed};
use super::kernels::{self, Condensed, Corners};
use super::local::{LocalUnit, local_units};
use super::loss::Loss;
use super::plan::{Block, CompiledPath, Group, GroupKind, Plan};
use super::prior::Priors;
use super::state::State;
use super::unknowns::UnknownKind;
use crate::geometry::lens::with_lens;
use crate::geometry::{Intrinsics, LensModel, Pose};
use crate::layout::{Layout, Motion};
use crate::recording::{Recording, RobotMotion};
use crate::robot::Chain;

/// Corners a unit holds at most, in whole blocks: enough to hide the cost of a task, few enough to share out evenly.
const UNIT_MEASUREMENTS: usize = 4096;

/// The normal equations of the shared unknowns, moving targets included as they were condensed.
#[derive(Clone, Debug, Default)]
pub struct Normal {
    /// `J^T W J`, row-major, both triangles; local unknowns not yet eliminated.
    pub hessian: Vec<f64>,
    /// `J^T W r`.
    pub gradient: Vec<f64>,
    /// The robust cost.
    pub cost: f64,
}

/// A run of blocks of one group with a compact matrix of its own.
#[derive(Clone, Debug)]
struct Unit {
    group: usize,
    blocks: std::ops::Range<usize>,
    /// Row-major over (path columns, active lens columns, residual).
    matrix: Vec<f64>,
    cost: f64,
}

/// How a robot's joints are known, ready for the loop.
#[derive(Clone, Debug)]
struct RobotData<'a> {
    chain: Option<&'a Chain>,
    /// By configuration of the plan.
    joints: Vec<&'a [f64]>,
    flange: Vec<Pose>,
    /// Correction places that are unknown.
    wanted: Vec<usize>,
}

/// Linearises and evaluates a plan.
#[derive(Debug)]
pub struct Assembler<'a> {
    pub(super) plan: &'a Plan,
    pub(super) loss: Loss,
    lens_models: Vec<LensModel>,
    /// For each camera, its unknown lens parameters and their first shared column.
    lens_columns: Vec<(Vec<usize>, usize)>,
    robots: Vec<RobotData<'a>>,
    pub(super) priors: Priors,
    units: Vec<Unit>,
    pub(super) local: Vec<LocalUnit>,
    segments: Vec<SegmentValues>,
    trial_segments: Vec<SegmentValues>,
}

impl<'a> Assembler<'a> {
    /// Prepares the loop: everything it needs is allocated here.
    #[must_use]
    pub fn new(layout: &'a Layout, recording: &'a Recording, plan: &'a Plan, priors: Priors) -> Self {
        let model = |intrinsics: &Option<Intrinsics>| intrinsics.as_ref().map_or(LensModel::Pinhole, Intrinsics::model);
        let lens_columns = (0..layout.cameras.len()).map(|camera| {
            plan.unknowns.lens(camera).map_or((Vec::new(), 0), |block| match &plan.unknowns.blocks[block].kind {
                UnknownKind::Lens { places, .. } => (places.clone(), plan.unknowns.blocks[block].start),
                _ => (Vec::new(), 0),
            })
        });
        let mut assembler = Self {
            plan,
            loss: plan.settings.loss.into(),
            lens_models: layout.cameras.iter().map(|camera| model(&camera.intrinsics)).collect(),
            lens_columns: lens_columns.collect(),
            robots: robot_data(layout, recording, plan),
            priors,
            units: Vec::new(),
            local: local_units(plan),
            segments: Vec::new(),
            trial_segments: Vec::new(),
        };
        assembler.units = assembler.cut_units();
        let widths: Vec<usize> = plan.groups.iter().map(|group| assembler.width(group)).collect();
        assembler.local.iter_mut().for_each(|local| local.size_buffers(&widths));
        assembler.segments = vec![SegmentValues::default(); plan.segments.len()];
        assembler.trial_segments = assembler.segments.clone();
        assembler
    }

    /// Sets the loss, for a first pass that is more forgiving than the layout asks for.
    pub fn set_loss(&mut self, loss: Loss) {
        self.loss = loss;
    }

    fn cut_units(&self) -> Vec<Unit> {
        let mut units = Vec::new();
        for (index, group) in self.plan.groups.iter().enumerate().filter(|(_, group)| group.compiled.moving.is_empty())
        {
            let width = self.width(group);
            let mut start = 0;
            while start < group.blocks.len() {
                let (mut end, mut count) = (start, 0);
                while end < group.blocks.len() && (end == start || count < UNIT_MEASUREMENTS) {
                    count += group.blocks[end].end - group.blocks[end].start;
                    end += 1;
                }
                units.push(Unit { group: index, blocks: start..end, matrix: vec![0.0; width * width], cost: 0.0 });
                start = end;
            }
        }
        units
    }

    /// Columns of a group's compact matrix: its path's, its lens', the residual.
    pub(super) fn width(&self, group: &Group) -> usize {
        group.compiled.columns + self.lens_of(group).0.len() + 1
    }

    fn lens_of(&self, group: &Group) -> (&[usize], usize) {
        match group.kind {
            GroupKind::Corners { camera } => (&self.lens_columns[camera].0, self.lens_columns[camera].1),
            _ => (&[], 0),
        }
    }

    /// The shared columns behind a group's compact columns: (compact, shared, count).
    pub(super) fn shared_columns(&self, group: &Group) -> Vec<(usize, usize, usize)> {
        let mut columns = group.compiled.shared.clone();
        let (lens, start) = self.lens_of(group);
        if !lens.is_empty() {
            columns.push((group.compiled.columns, start, lens.len()));
        }
        columns
    }

    /// Linearises at `state`: fills the normal equations and every local unit. Returns the cost.
    pub fn linearise(&mut self, state: &State, normal: &mut Normal) -> f64 {
        let mut segments = std::mem::take(&mut self.segments);
        self.fill_segments(state, true, &mut segments);
        let (mut units, mut local) = (std::mem::take(&mut self.units), std::mem::take(&mut self.local));
        let this: &Self = self;
        units.par_iter_mut().for_each_init(Scratch::default, |scratch, unit| {
            unit.matrix.fill(0.0);
            unit.cost = 0.0;
            let group = &this.plan.groups[unit.group];
            for block in &group.blocks[unit.blocks.clone()] {
                unit.cost += this.expand(group, block, state, &segments, scratch, &mut unit.matrix);
            }
        });
        local.par_iter_mut().for_each_init(Scratch::default, |scratch, unit| {
            unit.fill(this, |group, block, matrix| this.expand(group, block, state, &segments, scratch, matrix));
        });
        let n = this.plan.unknowns.count;
        normal.hessian.clear();
        normal.hessian.resize(n * n, 0.0);
        normal.gradient.clear();
        normal.gradient.resize(n, 0.0);
        normal.cost = 0.0;
        for unit in &units {
            let group = &this.plan.groups[unit.group];
            add_compact(&unit.matrix, this.width(group), &this.shared_columns(group), normal);
            normal.cost += unit.cost;
        }
        for unit in &local {
            unit.add_shared(normal);
        }
        this.priors.add(state, normal);
        (self.units, self.local, self.segments) = (units, local, segments);
        normal.cost
    }

    /// The information matrix of the shared unknowns at the last linearisation with local ones marginalised, row-major.
    #[must_use]
    pub fn information(&self, normal: &Normal) -> Vec<f64> {
        let n = normal.gradient.len();
        let mut matrix = normal.hessian.clone();
        for unit in &self.local {
            let block = unit.marginal();
            for (i, &a) in unit.shared().iter().enumerate() {
                for (j, &b) in unit.shared().iter().enumerate() {
                    matrix[a * n + b] -= block[(i, j)];
                }
            }
        }
        matrix
    }

    /// For each moving edge, the configurations (of the plan) at which something sees it.
    #[must_use]
    pub fn moved(&self) -> Vec<Vec<usize>> {
        let edges = self.local.iter().flat_map(|unit| unit.edges.iter()).max().map_or(0, |edge| edge + 1);
        let at = |edge: usize| {
            self.local.iter().filter(move |unit| unit.edges.contains(&edge)).map(|unit| unit.configuration)
        };
        (0..edges).map(|edge| at(edge).collect()).collect()
    }

    /// The robust cost at `state`, and nothing else.
    pub fn cost(&mut self, state: &State) -> f64 {
        let mut segments = std::mem::take(&mut self.trial_segments);
        self.fill_segments(state, false, &mut segments);
        let this: &Self = self;
        let block_cost = |group: &Group, block: &Block| this.block_cost(group, block, state, &segments);
        let costs: Vec<f64> = this
            .units
            .par_iter()
            .map(|unit| {
                let group = &this.plan.groups[unit.group];
                group.blocks[unit.blocks.clone()].iter().map(|block| block_cost(group, block)).sum()
            })
            .collect();
        let local: Vec<f64> = this.local.par_iter().map(|unit| unit.cost_of(this.plan, &block_cost)).collect();
        let total = costs.iter().sum::<f64>() + local.iter().sum::<f64>() + this.priors.cost(state);
        self.trial_segments = segments;
        total
    }

    fn fill_segments(&self, state: &State, derivatives: bool, out: &mut [SegmentValues]) {
        let count = self.plan.configurations.len();
        for (segment, values) in self.plan.segments.iter().zip(out) {
            let robot = &self.robots[segment.robot];
            // A robot that is not identified stands where it stands: computed once.
            if robot.wanted.is_empty() && values.poses.len() == count {
                continue;
            }
            let corrections = &state.corrections[segment.robot];
            match robot.chain {
                None => values.poses.clone_from(&robot.flange),
                Some(chain) => {
                    let one = |joints: &&[f64]| {
                        if joints.is_empty() {
                            (Pose::identity(), nalgebra::Matrix6xX::zeros(robot.wanted.len()))
                        } else if derivatives && !robot.wanted.is_empty() {
                            chain.segment_with_parameters(joints, corrections, segment.from, segment.to, &robot.wanted)
                        } else {
                            let pose = chain.segment(joints, corrections, segment.from, segment.to);
                            (pose, nalgebra::Matrix6xX::zeros(0))
                        }
                    };
                    (values.poses, values.jacobians) = robot.joints.par_iter().map(one).unzip();
                }
            }
        }
    }

    /// Condenses a block and adds its expansion to a compact matrix; returns its cost.
    fn expand(
        &self,
        group: &Group,
        block: &Block,
        state: &State,
        segments: &[SegmentValues],
        scratch: &mut Scratch,
        matrix: &mut [f64],
    ) -> f64 {
        let path: &CompiledPath = &group.compiled;
        scratch.jacobian.resize(path.columns, [0.0; 6]);
        let pose = pose_and_jacobian(path, block.configuration, state, segments, &mut scratch.jacobian);
        self.condense(group, block, &pose, state, &mut scratch.condensed);
        let (lens, _) = self.lens_of(group);
        expand_condensed(&scratch.condensed, &scratch.jacobian, lens, &mut scratch.product, matrix);
        scratch.condensed.cost
    }

    fn condense(&self, group: &Group, block: &Block, pose: &Pose, state: &State, out: &mut Condensed) {
        let (m, s) = (&self.plan.measurements, &self.plan.settings);
        let range = block.start..block.end;
        match group.kind {
            GroupKind::Corners { camera } => {
                let corners = self.corners(range);
                let lens = &state.lenses[camera];
                let free = !self.lens_columns[camera].0.is_empty();
                with_lens!(self.lens_models[camera], L => {
                    if free {
                        kernels::condense_corners::<L, { 7 + <L as crate::geometry::lens::Lens>::COUNT }>(corners, pose, lens, self.loss, out);
                    } else {
                        kernels::condense_corners::<L, 7>(corners, pose, lens, self.loss, out);
                    }
                });
            }
            GroupKind::Poses => kernels::condense_poses(&m.poses[range], pose, s.pose_sigma, self.loss, out),
            GroupKind::Points => kernels::condense_points(&m.points[range], pose, s.point_sigma, self.loss, out),
            GroupKind::Contacts => {
                kernels::condense_contacts(&m.contacts[range], pose, s.contact_sigma, self.loss, out)
            }
        }
    }

    fn block_cost(&self, group: &Group, block: &Block, state: &State, segments: &[SegmentValues]) -> f64 {
        let pose = pose_along(&group.compiled, block.configuration, state, segments);
        let (m, s) = (&self.plan.measurements, &self.plan.settings);
        let range = block.start..block.end;
        match group.kind {
            GroupKind::Corners { camera } => {
                let corners = self.corners(range);
                with_lens!(self.lens_models[camera], L => kernels::corner_cost::<L>(corners, &pose, &state.lenses[camera], self.loss))
            }
            GroupKind::Poses => kernels::pose_cost(&m.poses[range], &pose, s.pose_sigma, self.loss),
            GroupKind::Points => kernels::point_cost(&m.points[range], &pose, s.point_sigma, self.loss),
            GroupKind::Contacts => kernels::contact_cost(&m.contacts[range], &pose, s.contact_sigma, self.loss),
        }
    }

    fn corners(&self, range: std::ops::Range<usize>) -> Corners<'_> {
        let m = &self.plan.measurements;
        Corners {
            points: &m.corner_points[range.clone()],
            pixels: &m.corner_pixels[range.clone()],
            whiteners: &m.corner_whiteners[range],
        }
    }

    /// The transform of every block at `state`: `poses[group][block]` is `sensor_from_target`.
    #[must_use]
    pub fn block_poses(&mut self, state: &State) -> Vec<Vec<Pose>> {
        let mut segments = std::mem::take(&mut self.trial_segments);
        self.fill_segments(state, false, &mut segments);
        let pose = |group: &Group, block: &Block| pose_along(&group.compiled, block.configuration, state, &segments);
        let poses = self.plan.groups.iter().map(|g| g.blocks.iter().map(|b| pose(g, b)).collect()).collect();
        self.trial_segments = segments;
        poses
    }
}

/// Buffers of one thread.
#[derive(Default)]
pub(super) struct Scratch {
    jacobian: Vec<[f64; 6]>,
    product: Vec<[f64; 6]>,
    condensed: Condensed,
}

fn robot_data<'a>(layout: &'a Layout, recording: &'a Recording, plan: &Plan) -> Vec<RobotData<'a>> {
    let wanted = |robot: usize| {
        plan.unknowns.links(robot).map_or(Vec::new(), |block| match &plan.unknowns.blocks[block].kind {
            UnknownKind::Links { places, .. } => places.clone(),
            _ => Vec::new(),
        })
    };
    let one = |(index, robot): (usize, &'a crate::layout::Robot)| {
        let mut data = RobotData { chain: None, joints: Vec::new(), flange: Vec::new(), wanted: wanted(index) };
        if let Motion::Joints { chain, .. } = &robot.motion {
            data.chain = Some(chain);
        }
        match &recording.motions[index] {
            RobotMotion::Joints(values) => {
                data.joints =
                    plan.configurations.iter().map(|c| values.get(c).map_or(&[][..], Vec::as_slice)).collect();
            }
            RobotMotion::Flange(poses) => {
                data.flange = plan.configurations.iter().map(|c| poses.get(c).copied().unwrap_or_default()).collect();
            }
        }
        data
    };
    layout.robots.iter().enumerate().map(one).collect()
}
