//! Solving a recording that does not fit into the given memory.
//!
//! The corners of one configuration in so many are solved as any recording is: start, robust search, faults, rejection. Its answer lies within a few of its own
//! standard deviations, so that two or three passes over all corners, chunk by chunk, lead from there to the answer of all ([`crate::solve::passes`]). What is set aside is
//! judged by the scale that the first solve has found. Nothing of a chunk is kept but sums: the equations, what the covariance needs, counts. So the
//! memory does not grow with the corners; a count and the robots' values stay of every configuration.

use std::ops::RangeInclusive;
use std::time::Instant;

use super::memory::{Shares, shares};
use super::refusals::no_motion;
use super::solve::{SolveRequest, Solved, hashes, solve_recording, start_poses};
use crate::complaint::{Complaint, InputError};
use crate::frames::{FrameId, FrameTree};
use crate::geometry::{Feature, Pose};
use crate::initialise::initialise;
use crate::layout::{Layout, LossSetting, SolverChoice};
use crate::recording::{Appearance, CornerIndex, Recording, RobotMotion, Wanted};
use crate::solve::passes::{PassReport, Passed, minimise_in_passes};
use crate::solve::{Assembler, Loss, Normal, Plan, Priors, State};
use crate::trust::outliers::{Gates, Rejected, Tally, reject_unseen, tally};
use crate::trust::pieces::{Gathering, from_sums};
use crate::trust::residuals::Summary;
use crate::trust::{Covariance, Evidence, explain, residuals};

/// How a recording was solved that is not in memory as a whole.
#[derive(Debug)]
pub struct Streamed {
    /// The memory that was given, bytes.
    pub memory: u64,
    /// One of so many configurations was solved first.
    pub stride: u64,
    /// How many were, and how many there are.
    pub configurations: [usize; 2],
    /// All corners, and all measurements.
    pub corners: usize,
    /// All measurements, those set aside among them.
    pub measurements: usize,
    /// Parts that each pass went over.
    pub chunks: usize,
    /// The recording of the configurations that were solved first.
    pub recording: Recording,
    /// How the passes went.
    pub report: PassReport,
    /// Seconds that looking through the files took, the solve of the part, and each pass.
    pub seconds: (f64, f64, Vec<f64>),
}

/// What a pass adds up.
#[derive(Default)]
struct Sums {
    summary: Summary,
    tallies: Vec<Tally>,
    rejected: Rejected,
    scalars: usize,
    /// Poses of what moves by itself.
    moved: usize,
    /// The squared residuals in the layout's standard deviations, stops included.
    squares: f64,
    /// What the cost counts for measurements that are set aside.
    price: f64,
    /// `J^T W J` of the measurements.
    information: Vec<f64>,
    /// None in a first pass, before which nothing is known of the covariance.
    gathering: Option<Gathering>,
}

/// As [`super::solve::solve`], in so much memory; none if everything fits into it as it is.
///
/// # Errors
/// As there; what cannot be solved in pieces; a file that changes meanwhile.
pub(super) fn solve_streamed(
    layout: &Layout,
    request: &SolveRequest,
    memory: u64,
    began: Instant,
) -> Result<Option<Solved>, InputError> {
    let mut layout = layout.clone();
    layout.solve.solver = SolverChoice::Dense;
    let tree = FrameTree::new(&layout);
    let start = request.start.as_ref().map_or(Ok(Vec::new()), |file| start_poses(file, &layout.world))?;
    let mut whole = Recording::read_motion(&layout)?;
    let files = Recording::corner_files(&layout, request.detections.as_deref())?;
    let mut index = CornerIndex::read(&files, &layout, &|one, feature| pair(&layout, &tree, one, feature))?;
    whole.files.extend(files);
    whole.digests.clone_from(&index.digests);
    whole.read_others(&layout)?;
    note_others(&layout, &tree, &whole, &mut index);
    let others = whole.poses.len() + whole.points.len() + whole.contacts.len();
    let inputs = hashes(&layout, &whole, request.start.as_ref())?;
    let shares = shares(memory, &layout, &tree, &index, others);
    if !matches!(shares, Ok(None)) {
        refuse(&layout, request, memory)?;
    }
    let Some(Shares { stride, first, chunk }) = shares? else { return Ok(None) };
    let chunks = index.chunks(chunk);
    let wanted = |configuration: u64| first.binary_search(&configuration).is_ok();
    let mut part = others_of(&whole, &wanted);
    part.motions = std::mem::take(&mut whole.motions);
    part.corners = index.read_some(&layout, &chunks, &first)?;
    let read = began.elapsed().as_secs_f64();
    let solved = solve_recording(layout, &part, &start, inputs, Instant::now())?;
    let measurements = index.corners() + others;
    let configurations = [first.len(), index.configurations.len()];
    let mut streamed = Streamed {
        memory,
        stride,
        configurations,
        corners: index.corners(),
        measurements,
        chunks: chunks.len(),
        recording: part,
        report: PassReport { termination: solved.report.termination, costs: Vec::new(), left_over: 0.0 },
        seconds: (read, solved.seconds.total, Vec::new()),
    };
    let mut solved = refine(solved, &mut streamed, &whole, &index, &chunks)?;
    solved.seconds.read += read;
    solved.seconds.total = began.elapsed().as_secs_f64();
    solved.streamed = Some(Box::new(streamed));
    Ok(Some(solved))
}

/// What cannot be solved in pieces.
fn refuse(layout: &Layout, request: &SolveRequest, memory: u64) -> Result<(), InputError> {
    let given = super::memory::words(memory);
    if request.solver == SolverChoice::Sparse {
        let what = format!("the corners do not fit into {given}, and equations that are summed over pieces are dense");
        return Err(Complaint::of(&layout.file, what, "give more `--memory`, or leave `--solver` out").into());
    }
    Ok(())
}

fn frame(layout: &Layout, tree: &FrameTree, target: usize, feature: &Feature) -> FrameId {
    tree.locate(layout, target, feature).map_or(tree.targets[target], |(frame, _)| frame)
}

/// The ends of a corner's path.
fn pair(layout: &Layout, tree: &FrameTree, one: &Appearance, feature: &Feature) -> (FrameId, FrameId) {
    (tree.cameras[one.camera], frame(layout, tree, one.target, feature))
}

/// The same of all that is no corner.
fn note_others(layout: &Layout, tree: &FrameTree, whole: &Recording, index: &mut CornerIndex) {
    for row in &whole.poses {
        index.note((tree.cameras[row.camera], tree.targets[row.target]), row.configuration);
    }
    for row in &whole.points {
        index.note((tree.sensors[row.sensor], frame(layout, tree, row.target, &row.feature)), row.configuration);
    }
    for row in &whole.contacts {
        let [a, b] = [0, 1].map(|end| frame(layout, tree, row.points[end].0, &row.points[end].1));
        index.note((a, b), row.configuration);
    }
}

/// What is no corner, at some configurations; no motion.
fn others_of(whole: &Recording, wanted: &dyn Fn(u64) -> bool) -> Recording {
    Recording {
        poses: whole.poses.iter().filter(|row| wanted(row.configuration)).cloned().collect(),
        points: whole.points.iter().filter(|row| wanted(row.configuration)).cloned().collect(),
        contacts: whole.contacts.iter().filter(|row| wanted(row.configuration)).cloned().collect(),
        files: whole.files.clone(),
        ..Recording::default()
    }
}

/// All that a pass needs.
struct Over<'a> {
    layout: &'a Layout,
    tree: &'a FrameTree,
    /// Of the part that was solved first.
    plan: &'a Plan,
    gates: Gates,
    motions: &'a [RobotMotion],
    others: &'a Recording,
    index: &'a CornerIndex,
    chunks: &'a [RangeInclusive<u64>],
}

impl Over<'_> {
    /// Goes over everything once.
    fn pass(&self, shared: &State, passed: &mut Passed, against: Option<Covariance>) -> Result<Sums, InputError> {
        let mut sums = Sums { gathering: against.map(Gathering::new), ..Sums::default() };
        passed.normal.clear(self.plan);
        let mut normal = Normal::default();
        for range in self.chunks {
            self.add(range, shared, &mut normal, &mut sums)?;
            passed.normal.include(&normal);
        }
        sums.information.clone_from(&passed.normal.hessian);
        passed.normal.cost += sums.price;
        passed.variance = sums.squares / sums.scalars.max(1) as f64;
        Ok(sums)
    }

    /// Where the unknowns of each configuration alone begin, and how many measurements show too little of them; numbers boards that look the same
    /// turned round.
    fn begin(&self, recording: &Recording, plan: &mut Plan, shared: &State) -> Result<(State, usize), InputError> {
        let mut state = shared.clone();
        let symmetric = self.layout.targets.iter().any(|target| target.geometry.symmetries().len() > 1);
        if self.tree.moving_edges.is_empty() && !symmetric {
            state.begin(plan);
            return Ok((state, 0));
        }
        let poses = self.tree.static_edges.iter().zip(&shared.static_poses);
        let poses: Vec<(String, Pose)> = poses.map(|(edge, pose)| (edge.key.clone(), *pose)).collect();
        let start = initialise(self.layout, self.tree, recording, plan, &poses)
            .map_err(|error| Complaint::of(&self.layout.file, error.to_string(), "give more `--memory`"))?;
        state.moving_poses = start.state.moving_poses;
        Ok((state, start.dropped))
    }

    /// Adds one chunk to the sums, and leaves its equations.
    fn add(
        &self,
        range: &RangeInclusive<u64>,
        shared: &State,
        normal: &mut Normal,
        sums: &mut Sums,
    ) -> Result<(), InputError> {
        let mut recording = others_of(self.others, &|configuration| range.contains(&configuration));
        recording.corners = self.index.read_corners(self.layout, range, Wanted::All)?;
        recording.motions = self.motions.iter().map(|motion| motion.during(range)).collect();
        let mut plan =
            self.plan.part(self.layout, self.tree, &recording).map_err(|error| no_motion(self.layout, &error))?;
        let (mut state, unplaced) = self.begin(&recording, &mut plan, shared)?;
        sums.rejected.unplaced += unplaced;
        // Outliers are in it still, so what is unknown at each configuration alone is found robustly first.
        let mut assembler = Assembler::new(self.layout, &recording, &plan, Priors::default());
        assembler.settle(&mut state);
        let poses = assembler.block_poses(&state);
        drop(assembler);
        let rest = residuals(self.layout, &plan, &state, &poses, Loss::Squared);
        sums.rejected.add(reject_unseen(&mut plan, &rest));
        sums.price += self.gates.price(&plan, &rest);
        sums.rejected.add(self.gates.set_aside(&mut plan, &rest));
        let mut assembler = Assembler::new(self.layout, &recording, &plan, Priors::default());
        assembler.set_loss(Loss::Squared);
        assembler.settle(&mut state);
        assembler.reduced(&state, normal);
        let poses = assembler.block_poses(&state);
        sums.moved += assembler.moved().iter().map(Vec::len).sum::<usize>();
        if let Some(gathering) = &mut sums.gathering {
            gathering.add(&mut assembler, &state);
        }
        drop(assembler);
        let rest = residuals(self.layout, &plan, &state, &poses, Loss::Squared);
        sums.summary.add(&rest.summary());
        Tally::add_all(&mut sums.tallies, tally(self.layout, &plan, &rest), self.layout);
        sums.scalars += plan.scalar_count();
        // The cost is half the squares of the residuals and of the stops.
        sums.squares += 2.0 * normal.cost;
        Ok(())
    }
}

/// Leads the answer of a part to that of all.
fn refine(
    mut solved: Solved,
    streamed: &mut Streamed,
    others: &Recording,
    index: &CornerIndex,
    chunks: &[RangeInclusive<u64>],
) -> Result<Solved, InputError> {
    let robust = solved.layout.solve.loss != LossSetting::Squared;
    let over = Over {
        layout: &solved.layout,
        tree: &solved.tree,
        plan: &solved.plan,
        gates: if robust { Gates::of(&solved.plan, &solved.residuals) } else { Gates::open() },
        motions: &streamed.recording.motions,
        others,
        index,
        chunks,
    };
    let priors = Priors::new(&solved.tree, &solved.plan.unknowns);
    let noise = |sums: &Sums| {
        let unknowns = solved.plan.unknowns.count + 6 * sums.moved;
        let found = unknowns.saturating_sub(priors.scalar_count());
        let freedom = sums.scalars.saturating_sub(found);
        if freedom == 0 { 1.0 } else { (sums.squares / freedom as f64).sqrt() }
    };
    let mut state = solved.state.clone();
    let mut before: Option<Covariance> = None;
    let mut seconds = Vec::new();
    let mut pass = |state: &State, passed: &mut Passed| {
        let clock = Instant::now();
        let sums = over.pass(state, passed, before.take())?;
        let believed = priors.equations(&solved.plan, state);
        before = Some(from_sums(&solved.plan, &sums.information, &believed, noise(&sums)));
        seconds.push(clock.elapsed().as_secs_f64());
        Ok::<Sums, InputError>(sums)
    };
    let (mut sums, report) = minimise_in_passes(&solved.plan, &solved.tree, &priors, &mut state, &mut pass)?;
    if sums.gathering.is_none() {
        sums = pass(&state, &mut Passed::default())?;
    }
    let believed = priors.equations(&solved.plan, &state);
    let level = noise(&sums);
    let Some(gathering) = sums.gathering.take() else { return Ok(solved) };
    let covariance = gathering.finish(&solved.plan, &sums.information, &believed, level);
    let mut assembler = Assembler::new(&solved.layout, &streamed.recording, &solved.plan, priors.clone());
    assembler.set_loss(Loss::Squared);
    assembler.settle(&mut state);
    let poses = assembler.block_poses(&state);
    drop(assembler);
    solved.residuals = residuals(&solved.layout, &solved.plan, &state, &poses, Loss::Squared);
    solved.state = state;
    let (undetermined, weak) = {
        let Solved { layout, tree, plan, state, .. } = &solved;
        let evidence = Evidence { layout, tree, recording: &streamed.recording, plan, state, poses: &poses };
        explain(&evidence, &covariance, &solved.unseen)
    };
    (solved.undetermined, solved.weak, solved.covariance) = (undetermined, weak, covariance);
    (solved.summary, solved.tallies, solved.rejected) = (sums.summary, sums.tallies, sums.rejected);
    solved.observations = sums.scalars + priors.scalar_count();
    solved.unknowns = solved.plan.unknowns.count + 6 * sums.moved;
    let costs = report.costs.iter().filter(|(_, kept)| *kept).map(|(cost, _)| cost - sums.price);
    let costs: Vec<f64> = costs.collect();
    solved.report.initial_cost = costs.first().copied().unwrap_or(f64::NAN);
    solved.report.final_cost = costs.last().copied().unwrap_or(f64::NAN);
    solved.report.iterations += seconds.len();
    solved.report.costs = costs;
    if solved.report.termination.converged() {
        solved.report.termination = report.termination;
    }
    (streamed.report, streamed.seconds.2) = (report, seconds);
    Ok(solved)
}
