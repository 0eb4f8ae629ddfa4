//! From condensed blocks to the normal equations of the shared unknowns.
//!
//! The work is cut into *units* by the data alone ([`super::cut`]): a run of blocks of one group, or, where targets move, everything at some
//! configurations. Each unit fills its own compact matrix, in parallel; the sums are folded in the order of units, so the bits do not depend on how many threads
//! there were. After the first linearisation nothing is allocated any more.

use pulp::Arch;

use super::chain::{SegmentValues, pose_along, pose_and_jacobian};
use super::corners::{self, View};
use super::cut::Cut;
use super::expand::Expand;
use super::kernels::{self, Condensed};
use super::local::{Bundle, LocalUnit};
use super::loss::Loss;
pub use super::normal::Normal;
use super::pack::Packed;
use super::plan::{Block, CompiledPath, Group, GroupKind, Plan};
use super::prior::Priors;
use super::robots::{RobotData, Wanted, fill_segments, robot_data};
use super::share::{Rooms, each, find};
use super::state::State;
use super::unknowns::{UnknownKind, Unknowns};
use crate::geometry::{Intrinsics, LensModel, Pose};
use crate::layout::Layout;
use crate::recording::Recording;

/// How the compact columns of a group are laid out.
#[derive(Clone, Debug)]
pub(super) struct Shape {
    /// Columns of its compact matrix: its path's, its lens', the residual.
    pub(super) width: usize,
    /// The shared columns behind them: (compact, shared, count).
    pub(super) shared: Vec<(usize, usize, usize)>,
    /// Where each compact column without the residual is in the shared equations; only for groups without moving edges.
    columns: Vec<usize>,
    /// The unknown lens parameters.
    pub(super) lens: Vec<usize>,
}

/// Buffers for expanding one block.
#[derive(Clone, Debug, Default)]
pub(super) struct Scratch {
    jacobian: Vec<[f64; 6]>,
    room: Vec<f64>,
    condensed: Condensed,
}

/// Linearises and evaluates a plan.
#[derive(Debug)]
pub struct Assembler<'a> {
    pub(super) plan: &'a Plan,
    loss: Loss,
    /// What linearisations weigh by in the place of the loss.
    guide: Option<Loss>,
    curved: bool,
    /// Whether one thread is enough for all of the plan.
    alone: bool,
    pub(super) arch: Arch,
    pub(super) lens_models: Vec<LensModel>,
    pub(super) robots: Vec<RobotData<'a>>,
    pub(super) priors: Priors,
    /// By group.
    pub(super) shapes: Vec<Shape>,
    /// What is linearised: all of the plan, but for a first search of a part.
    pub(super) cut: Cut,
    packed: Packed,
    rooms: Rooms,
    pub(super) segments: Vec<SegmentValues>,
}

impl Scratch {
    /// Room for blocks of any group, so that none is made later.
    fn new(shapes: &[Shape]) -> Self {
        let widest = shapes.iter().map(|shape| shape.width).max().unwrap_or(0);
        let rows = if shapes.iter().all(|shape| shape.lens.is_empty()) { 0 } else { corners::MOST_ROOM };
        Self {
            jacobian: Vec::with_capacity(widest),
            room: Vec::with_capacity(Expand::room(widest)),
            condensed: Condensed { rows: Vec::with_capacity(rows), ..Condensed::default() },
        }
    }
}

impl<'a> Assembler<'a> {
    /// Prepares the loop.
    #[must_use]
    pub fn new(layout: &'a Layout, recording: &'a Recording, plan: &'a Plan, priors: Priors) -> Self {
        let model = |intrinsics: &Option<Intrinsics>| intrinsics.as_ref().map_or(LensModel::Pinhole, Intrinsics::model);
        let shapes: Vec<Shape> = plan.groups.iter().map(|group| shape(&plan.unknowns, group)).collect();
        let cut = Cut::new(plan, &shapes, None);
        Self {
            plan,
            loss: plan.settings.loss.into(),
            guide: None,
            curved: false,
            alone: cut.is_small(),
            arch: Arch::new(),
            lens_models: layout.cameras.iter().map(|camera| model(&camera.intrinsics)).collect(),
            robots: robot_data(layout, recording, plan),
            priors,
            cut,
            shapes,
            packed: Packed::default(),
            rooms: Rooms::default(),
            segments: vec![SegmentValues::default(); plan.segments.len()],
        }
    }

    /// Sets the loss, for a first pass that is more forgiving than the layout asks for.
    pub fn set_loss(&mut self, loss: Loss) {
        self.loss = loss;
    }

    /// The loss in force.
    pub(super) fn loss(&self) -> Loss {
        self.loss
    }

    /// Lets linearisations from now on weigh by another loss than the one whose cost counts; then the cost that they give is that loss' too.
    pub(super) fn set_guide(&mut self, guide: Option<Loss>) {
        self.guide = guide;
    }

    /// Whether linearisations from now on take in the curvature of the loss beside its weights: quicker near a minimum, slower far from it.
    pub(super) fn set_curved(&mut self, curved: bool) {
        self.curved = curved;
    }

    /// The number of scalar measurements that have not been rejected, of all or about so many of a part.
    pub(super) fn scalar_count(&self) -> usize {
        let blocks = self.plan.groups.iter().flat_map(|group| &group.blocks);
        let all: usize = blocks.map(|block| block.end - block.start).sum();
        (self.plan.scalar_count() as f64 * self.cut.measurements as f64 / all.max(1) as f64) as usize
    }

    /// Whether linearisations take in the curvature of the loss, or there is none.
    pub(super) fn is_curved(&self) -> bool {
        self.curved || self.loss == Loss::Squared
    }

    /// Lays out the corners for the loss in force, and makes room for every thread, if that is not done.
    fn prepare(&mut self) {
        let shapes = &self.shapes;
        self.rooms.fit(self.cut.is_small(), || Scratch::new(shapes));
        let folded = self.loss == Loss::Squared;
        if self.packed.folded != Some(folded) {
            // The old layout goes first, so that there is never room for both.
            self.packed = Packed::default();
            self.packed = Packed::new(self.plan, corners::lanes(self.arch), folded, self.alone);
        }
    }

    fn fill_bundles(&self, state: &State, segments: &[SegmentValues], bundles: &mut [Bundle]) {
        each(self.cut.is_small(), bundles, |bundle| {
            let mut scratch = self.rooms.own();
            bundle.fill((self.plan, &self.shapes), state, |group, shape, block, matrix| {
                self.expand(group, shape, block, state, segments, &mut scratch, matrix)
            });
        });
    }

    /// Fills the robots' segments and every local unit, and nothing else.
    pub(super) fn linearise_locally(&mut self, state: &State) {
        self.prepare();
        let segments = self.take_segments(state, true);
        let mut bundles = std::mem::take(&mut self.cut.bundles);
        self.fill_bundles(state, &segments, &mut bundles);
        (self.cut.bundles, self.segments) = (bundles, segments);
    }

    /// Linearises at `state`: fills the normal equations and every local unit. Returns the cost.
    pub fn linearise(&mut self, state: &State, normal: &mut Normal) -> f64 {
        self.prepare();
        let segments = self.take_segments(state, true);
        let (mut units, mut local) = (std::mem::take(&mut self.cut.units), std::mem::take(&mut self.cut.bundles));
        let this: &Self = self;
        each(this.cut.is_small(), &mut units, |unit| {
            let mut scratch = this.rooms.own();
            unit.matrix.fill(0.0);
            unit.cost = 0.0;
            let group = &this.plan.groups[unit.group];
            for &block in &unit.blocks {
                let (shape, block) = (&this.shapes[unit.group], &group.blocks[block as usize]);
                unit.cost += this.expand(group, shape, block, state, &segments, &mut scratch, &mut unit.matrix);
            }
        });
        this.fill_bundles(state, &segments, &mut local);
        normal.reset(this.plan);
        for unit in &units {
            normal.add_upper(&this.shapes[unit.group].columns, &unit.matrix);
            normal.cost += unit.cost;
        }
        for bundle in &local {
            bundle.add_shared(normal);
        }
        normal.mirror();
        this.priors.add(state, normal);
        (self.cut.units, self.cut.bundles, self.segments) = (units, local, segments);
        normal.cost
    }

    /// Everything that moves, one unit a configuration.
    pub(super) fn local_units(&self) -> impl Iterator<Item = &LocalUnit> {
        self.cut.bundles.iter().flat_map(|bundle| &bundle.units)
    }

    /// For each moving edge, the configurations (of the plan) at which something sees it.
    #[must_use]
    pub fn moved(&self) -> Vec<Vec<usize>> {
        // A robot's stop is no place of anything.
        let edges =
            self.local_units().flat_map(|unit| unit.form.edges.iter()).filter(|edge| **edge < self.plan.moving_edges);
        let edges = edges.max().map_or(0, |edge| edge + 1);
        let at = |edge: usize| {
            self.local_units().filter(move |unit| unit.form.edges.contains(&edge)).map(|unit| unit.configuration)
        };
        (0..edges)
            .map(|edge| {
                let mut all: Vec<usize> = at(edge).collect();
                all.sort_unstable();
                all
            })
            .collect()
    }

    /// The robust cost at `state`, and nothing else.
    pub fn cost(&mut self, state: &State) -> f64 {
        self.prepare();
        let segments = self.take_segments(state, false);
        let mut costs = std::mem::take(&mut self.cut.costs);
        let (this, alone): (&Self, bool) = (self, self.cut.is_small());
        let block_cost = |group: &Group, block: &Block| this.block_cost(group, block, state, &segments);
        let (of_units, of_bundles) = costs.split_at_mut(this.cut.units.len());
        find(alone, &this.cut.units, of_units, |unit| {
            let group = &this.plan.groups[unit.group];
            unit.blocks.iter().map(|block| block_cost(group, &group.blocks[*block as usize])).sum()
        });
        find(alone, &this.cut.bundles, of_bundles, |bundle| {
            bundle.units.iter().map(|unit| unit.cost_of(this.plan, state, block_cost)).sum()
        });
        let total = costs.iter().sum::<f64>() + this.priors.cost(state);
        (self.segments, self.cut.costs) = (segments, costs);
        total
    }

    /// The robots' segments at `state`, to be given back.
    pub(super) fn take_segments(&mut self, state: &State, derivatives: bool) -> Vec<SegmentValues> {
        let mut segments = std::mem::take(&mut self.segments);
        let seen = self.cut.configurations.as_deref();
        let what = Wanted { derivatives, seen, alone: self.alone };
        fill_segments(self.plan, &self.robots, state, what, &mut segments);
        segments
    }

    /// Condenses a block and adds its expansion to a compact matrix of its group's shape; returns its cost.
    #[allow(clippy::too_many_arguments, reason = "the inner loop's own, borrowed apart")]
    pub(super) fn expand(
        &self,
        group: &Group,
        shape: &Shape,
        block: &Block,
        state: &State,
        segments: &[SegmentValues],
        scratch: &mut Scratch,
        matrix: &mut [f64],
    ) -> f64 {
        let path: &CompiledPath = &group.compiled;
        scratch.jacobian.resize(path.columns, [0.0; 6]);
        let pose = pose_and_jacobian(path, block.configuration, state, segments, &mut scratch.jacobian);
        self.condense(group, block, &pose, state, !shape.lens.is_empty(), &mut scratch.condensed);
        let Scratch { jacobian, room, condensed } = scratch;
        self.arch.dispatch(Expand { condensed, jacobian, lens: &shape.lens, room, out: matrix });
        scratch.condensed.cost
    }

    fn condense(&self, group: &Group, block: &Block, pose: &Pose, state: &State, free: bool, out: &mut Condensed) {
        let (m, s) = (&self.plan.measurements, &self.plan.settings);
        let range = block.start..block.end;
        let robust = (self.guide.unwrap_or(self.loss), self.curved);
        match group.kind {
            GroupKind::Corners { camera } => {
                let view = View { loss: robust.0, ..self.view(camera, block, pose, state) };
                view.condense(self.arch, free, out);
            }
            GroupKind::Poses => kernels::condense_poses(&m.poses[range], pose, s.pose_sigma, robust, out),
            GroupKind::Points => kernels::condense_points(&m.points[range], pose, s.point_sigma, robust, out),
            GroupKind::Contacts => kernels::condense_contacts(&m.contacts[range], pose, s.contact_sigma, robust, out),
        }
    }

    fn block_cost(&self, group: &Group, block: &Block, state: &State, segments: &[SegmentValues]) -> f64 {
        let pose = pose_along(&group.compiled, block.configuration, state, segments);
        let (m, s) = (&self.plan.measurements, &self.plan.settings);
        let range = block.start..block.end;
        match group.kind {
            GroupKind::Corners { camera } => self.view(camera, block, &pose, state).cost(self.arch),
            GroupKind::Poses => kernels::pose_cost(&m.poses[range], &pose, s.pose_sigma, self.loss),
            GroupKind::Points => kernels::point_cost(&m.points[range], &pose, s.point_sigma, self.loss),
            GroupKind::Contacts => kernels::contact_cost(&m.contacts[range], &pose, s.contact_sigma, self.loss),
        }
    }

    fn view<'b>(&'b self, camera: usize, block: &Block, camera_from_target: &'b Pose, state: &'b State) -> View<'b> {
        View {
            corners: self.packed.block(block),
            camera_from_target,
            model: self.lens_models[camera],
            lens: &state.lenses[camera],
            loss: self.loss,
            curved: self.curved && self.loss != Loss::Squared,
        }
    }

    /// The transform of every block at `state`: `poses[group][block]` is `sensor_from_target`.
    #[must_use]
    pub fn block_poses(&mut self, state: &State) -> Vec<Vec<Pose>> {
        let segments = self.take_segments(state, false);
        let pose = |group: &Group, block: &Block| pose_along(&group.compiled, block.configuration, state, &segments);
        let poses = self.plan.groups.iter().map(|g| g.blocks.iter().map(|b| pose(g, b)).collect()).collect();
        self.segments = segments;
        poses
    }
}

pub(super) fn shape(unknowns: &Unknowns, group: &Group) -> Shape {
    let (mut lens, mut shared) = (Vec::new(), group.compiled.shared.clone());
    if let GroupKind::Corners { camera } = group.kind
        && let Some(block) = unknowns.lens(camera)
        && let UnknownKind::Lens { places, .. } = &unknowns.blocks[block].kind
    {
        lens.clone_from(places);
        shared.push((group.compiled.columns, unknowns.blocks[block].start, places.len()));
    }
    let width = group.compiled.columns + lens.len() + 1;
    let mut columns = vec![0; if group.compiled.moving.is_empty() { width - 1 } else { 0 }];
    if !columns.is_empty() {
        for &(compact, first, count) in &shared {
            (0..count).for_each(|i| columns[compact + i] = first + i);
        }
    }
    Shape { width, shared, columns, lens }
}
