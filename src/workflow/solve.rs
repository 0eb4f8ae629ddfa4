//! `solve`: from a layout and its recording to a solved cell.

use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};
use std::time::Instant;

use super::diagnose::diagnose;
use super::follow::{follow_scale, follow_up};
use super::memory::is_plenty;
use super::refusals::{in_pieces, no_motion};
use super::robust::robust_search;
use super::streamed::{Streamed, solve_streamed};
use crate::complaint::{Complaint, InputError};
use crate::frames::{FrameId, FrameTree, Pieces, pieces};
use crate::geometry::Pose;
use crate::initialise::{Start, initialise};
use crate::layout::{Layout, LossSetting, SolverChoice, read_layout};
use crate::recording::Recording;
use crate::solve::{Assembler, Loss, Options, Plan, Priors, Report, State, minimise};
use crate::trust::outliers::{Rejected, Tally, reject_unseen, tally};
use crate::trust::pieces::covariance_at;
use crate::trust::residuals::Summary;
use crate::trust::{Action, Covariance, Evidence, Fault, Remark, Residuals, Scale, Undetermined, explain, residuals};

/// More than this share of measurements set aside means that the description is wrong, not the measurements.
const MOST_ASIDE: f64 = 0.1;
/// Of a camera or a target, more than this share means that its own pose is wrong, where it is this many corners at least.
const MOST_OF_ONE: f64 = 0.5;
const SOME_CORNERS: usize = 24;

/// What to solve from, besides the layout.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SolveRequest {
    /// Corners that take the place of the layout's own.
    pub detections: Option<PathBuf>,
    /// A layout or solution whose poses are the start.
    pub start: Option<PathBuf>,
    /// Whether the equations are dense or sparse.
    pub solver: SolverChoice,
    /// Bytes that the solve may take; corners that do not fit into them are gone over in pieces. None for as many as it likes.
    pub memory: Option<u64>,
}

/// Wall time of the stages, seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StageSeconds {
    /// Reading and compiling files.
    pub read: f64,
    /// Finding a start.
    pub initialise: f64,
    /// Linearising.
    pub linearise: f64,
    /// Factorising.
    pub factorise: f64,
    /// Trial costs.
    pub evaluate: f64,
    /// Covariance and observability.
    pub covariance: f64,
    /// Finding what is wrong; nothing if the fit is sound.
    pub diagnose: f64,
    /// Everything.
    pub total: f64,
}

/// A solved cell.
#[derive(Debug)]
pub struct Solved {
    /// The layout it came from.
    pub layout: Layout,
    /// Its frames.
    pub tree: FrameTree,
    /// The compiled measurements, rejected ones marked.
    pub plan: Plan,
    /// The values found.
    pub state: State,
    /// How the search went; costs of its last pass, linearisations of all.
    pub report: Report,
    /// What is left of the measurements.
    pub residuals: Residuals,
    /// The same, all of a kind together.
    pub summary: Summary,
    /// How certain the unknowns are.
    pub covariance: Covariance,
    /// What could not be determined.
    pub undetermined: Vec<Undetermined>,
    /// What was determined, but weakly.
    pub weak: Vec<Undetermined>,
    /// Factors on distances, as the residuals have them.
    pub scales: Vec<Scale>,
    /// What residuals follow, and factors on distances that matter.
    pub remarks: Vec<Remark>,
    /// What is wrong with the recording or its description.
    pub faults: Vec<Fault>,
    /// What was set aside.
    pub rejected: Rejected,
    /// How the corners fared, by camera and target.
    pub tallies: Vec<Tally>,
    /// Frames with something to find that no measurement mentions.
    pub unseen: Vec<FrameId>,
    /// For each moving edge, the configurations at which it was found.
    pub moved: Vec<Vec<usize>>,
    /// Scalar measurements and priors used.
    pub observations: usize,
    /// Scalar unknowns, moving targets included.
    pub unknowns: usize,
    /// Input files and their SHA-256.
    pub inputs: Vec<(String, String)>,
    /// Where the time went.
    pub seconds: StageSeconds,
    /// How it was solved in little memory. Then plan, residuals, scales, remarks and faults are those of a part of the configurations, and everything else
    /// is that of all.
    pub streamed: Option<Box<Streamed>>,
}

impl Solved {
    /// Whether the answer can be used without a second look: converged, every direction determined, nearly all measurements in agreement, and
    /// nothing found that leaving measurements out would not mend.
    #[must_use]
    pub fn trustworthy(&self) -> bool {
        let refused = self.faults.iter().any(|fault| fault.action == Action::Refused);
        self.report.termination.converged() && self.undetermined.is_empty() && self.doubts().is_empty() && !refused
    }

    /// What speaks against the answer although it converged: too many measurements that do not fit it, of all or of one camera or target.
    #[must_use]
    pub fn doubts(&self) -> Vec<String> {
        let m = &self.plan.measurements;
        let all = m.corner_count() + m.poses.len() + m.points.len() + m.contacts.len();
        let all = self.streamed.as_ref().map_or(all, |streamed| streamed.measurements);
        let aside = self.rejected.total() - self.rejected.unplaced;
        let strangers = self.strangers();
        if aside as f64 <= MOST_ASIDE * all as f64 {
            return strangers;
        }
        let share = |t: &Tally| t.rejected as f64 / (t.accepted + t.rejected) as f64;
        let worst = self.tallies.iter().max_by(|a, b| share(a).total_cmp(&share(b)));
        let whose = worst.map_or(String::new(), |t| {
            let of = t.accepted + t.rejected;
            format!(", most of all those of `{}` by `{}` ({} of {of})", t.target, t.camera, t.rejected)
        });
        let whole = format!(
            "{aside} of {all} measurements do not fit the rest{whose}: check sizes and geometry of the targets, the robot's model, \
             the units of its joints, lenses and mounts"
        );
        std::iter::once(whole).chain(strangers).collect()
    }

    /// Cameras and targets most of whose corners do not fit the rest: a small share of all, and yet nothing can be said of where they are.
    fn strangers(&self) -> Vec<String> {
        let mostly = |of: &dyn Fn(&Tally) -> bool| -> Option<(usize, usize)> {
            let counts = self.tallies.iter().filter(|t| of(t)).map(|t| (t.rejected, t.accepted + t.rejected));
            let (rejected, all) = counts.fold((0, 0), |sum, t| (sum.0 + t.0, sum.1 + t.1));
            (rejected >= SOME_CORNERS && rejected as f64 > MOST_OF_ONE * all as f64).then_some((rejected, all))
        };
        let cameras = self.layout.cameras.iter().filter_map(|camera| {
            let (rejected, all) = mostly(&|tally| tally.camera == camera.name)?;
            Some(format!(
                "{rejected} of the {all} corners that `{}` saw do not fit the rest, so that its pose means nothing: check its lens and mount, \
                 and whether it, its robot or what it looks at has moved",
                camera.name
            ))
        });
        let targets = self.layout.targets.iter().filter_map(|target| {
            let (rejected, all) = mostly(&|tally| tally.target == target.name)?;
            Some(format!(
                "{rejected} of the {all} corners seen of `{}` do not fit the rest, so that its pose means nothing: check its size, geometry and \
                 mount, and whether it has moved",
                target.name
            ))
        });
        cameras.chain(targets).collect()
    }

    /// `world_from_frame` for a frame that stands still.
    #[must_use]
    pub fn world_from(&self, frame: &str) -> Option<Pose> {
        let id = self.tree.frames.iter().position(|known| known.name == frame)?;
        let path = self.tree.path(0, id);
        path.steps.iter().try_fold(Pose::identity(), |pose, step| match *step {
            crate::frames::Step::Static { edge, inverse } => {
                let value = self.state.static_poses[edge];
                Some(pose * if inverse { value.inverse() } else { value })
            }
            _ => None,
        })
    }

    /// `parent_from_child` by its key.
    #[must_use]
    pub fn pose(&self, key: &str) -> Option<Pose> {
        let edge = self.tree.static_edges.iter().position(|edge| edge.key == key)?;
        Some(self.state.static_poses[edge])
    }
}

/// Solves the cell of a layout.
///
/// # Errors
/// Input that cannot be used: faults of the recording, a cell in pieces, nothing to start from.
pub fn solve(mut layout: Layout, request: &SolveRequest) -> Result<Solved, InputError> {
    let began = Instant::now();
    if let Some(memory) = request.memory
        && !is_plenty(memory, &Recording::corner_files(&layout, request.detections.as_deref())?)?
        && let Some(solved) = solve_streamed(&layout, request, memory, began)?
    {
        return Ok(solved);
    }
    layout.solve.solver = request.solver;
    let recording = Recording::read(&layout, request.detections.as_deref())?;
    let start = match &request.start {
        Some(file) => start_poses(file, &layout.world)?,
        None => Vec::new(),
    };
    let inputs = hashes(&layout, &recording, request.start.as_ref())?;
    solve_recording(layout, &recording, &start, inputs, began)
}

/// As [`solve`], from a recording that is in memory already.
///
/// # Errors
/// As [`solve`].
pub fn solve_recording(
    layout: Layout,
    recording: &Recording,
    start: &[(String, Pose)],
    inputs: Vec<(String, String)>,
    began: Instant,
) -> Result<Solved, InputError> {
    let mut solved = solve_plain(layout, recording, start, inputs, began, true)?;
    let clock = Instant::now();
    solved.faults = diagnose(&solved, recording, start);
    follow_scale(&mut solved, recording, start);
    solved.seconds.diagnose = clock.elapsed().as_secs_f64();
    solved.seconds.total = began.elapsed().as_secs_f64();
    Ok(solved)
}

/// The solve without a look at what may be wrong; with a `look` at what the residuals still tell.
pub(super) fn solve_plain(
    layout: Layout,
    recording: &Recording,
    start: &[(String, Pose)],
    inputs: Vec<(String, String)>,
    began: Instant,
    look: bool,
) -> Result<Solved, InputError> {
    let tree = FrameTree::new(&layout);
    let mut plan = Plan::new(&layout, &tree, recording).map_err(|error| no_motion(&layout, &error))?;
    let Pieces { floating, unseen } = pieces(
        &tree,
        plan.groups.iter().map(|group| (&group.path, group.blocks.iter().map(|block| block.configuration).collect())),
    );
    if !floating.is_empty() {
        return Err(in_pieces(&layout, &tree, &floating).into());
    }
    let mut seconds = StageSeconds { read: began.elapsed().as_secs_f64(), ..StageSeconds::default() };
    let clock = Instant::now();
    let start = initialise(&layout, &tree, recording, &mut plan, start).map_err(|error| {
        Complaint::of(
            &layout.file,
            error.to_string(),
            "no picture shows enough of it, or too many unknown poses meet in one loop: give it `pose: {..., start: true}`",
        )
    })?;
    seconds.initialise = clock.elapsed().as_secs_f64();
    let priors = Priors::new(&tree, &plan.unknowns);
    let prior_count = priors.scalar_count();
    let Start { mut state, dropped } = start;
    let beginning = state.clone();
    let mut rejected = Rejected { unplaced: dropped, ..Rejected::default() };
    let (mut iterations, mut thinned) = (0, 0);
    let mut run = |assembler: &mut Assembler<'_>, state: &mut State, options: &Options| {
        let report = minimise(assembler, &tree, state, options);
        seconds.linearise += report.seconds.linearise;
        seconds.factorise += report.seconds.factorise;
        seconds.evaluate += report.seconds.evaluate;
        iterations += report.iterations;
        thinned += report.thinned;
        report
    };
    if layout.solve.loss != LossSetting::Squared {
        robust_search(&layout, recording, &mut plan, &priors, &mut state, &mut rejected, &mut run);
    }
    let (mut report, residuals, poses) = loop {
        let mut assembler = Assembler::new(&layout, recording, &plan, priors.clone());
        assembler.set_loss(Loss::Squared);
        let mut report = run(&mut assembler, &mut state, &Options::default());
        report.initial_cost = assembler.cost(&beginning);
        let poses = assembler.block_poses(&state);
        drop(assembler);
        let rest = residuals(&layout, &plan, &state, &poses, Loss::Squared);
        let unseen = reject_unseen(&mut plan, &rest);
        if unseen.total() == 0 {
            break (report, rest, poses);
        }
        rejected.add(unseen);
    };
    (report.iterations, report.thinned) = (iterations, thinned);
    let clock = Instant::now();
    // Linearised without the priors, whose weight is no matter of how noisy the measurements are.
    let mut measuring = Assembler::new(&layout, recording, &plan, Priors::default());
    measuring.set_loss(Loss::Squared);
    let moved = measuring.moved();
    let unknowns = plan.unknowns.count + 6 * moved.iter().map(Vec::len).sum::<usize>();
    let scalars = plan.scalar_count();
    let observations = scalars + prior_count;
    let freedom = scalars.saturating_sub(unknowns.saturating_sub(prior_count));
    let noise = |stops: f64| {
        if freedom == 0 { 1.0 } else { ((residuals.weighted_sum + stops) / freedom as f64).sqrt() }
    };
    let believed = priors.equations(&plan, &state);
    let covariance = covariance_at(&plan, &mut measuring, &state, &believed, noise);
    drop(measuring);
    let evidence = Evidence { layout: &layout, tree: &tree, recording, plan: &plan, state: &state, poses: &poses };
    let (undetermined, weak) = explain(&evidence, &covariance, &unseen);
    let (scales, remarks) =
        if look { follow_up(&evidence, &residuals, &covariance, &believed) } else { Default::default() };
    let tallies = tally(&layout, &plan, &residuals);
    seconds.covariance = clock.elapsed().as_secs_f64();
    seconds.total = began.elapsed().as_secs_f64();
    Ok(Solved {
        layout,
        tree,
        plan,
        state,
        report,
        summary: residuals.summary(),
        residuals,
        covariance,
        undetermined,
        weak,
        scales,
        remarks,
        faults: Vec::new(),
        rejected,
        tallies,
        unseen,
        moved,
        observations,
        unknowns,
        inputs,
        seconds,
        streamed: None,
    })
}

/// The poses of another layout, by key.
///
/// # Errors
/// Faults of the file; a layout with another world, whose poses would mean something else.
pub(super) fn start_poses(file: &Path, world: &str) -> Result<Vec<(String, Pose)>, InputError> {
    let layout = read_layout(file, None)?;
    if layout.world != world {
        let what = format!("its world is `{}`, but that of the layout to solve is `{world}`", layout.world);
        return Err(Complaint::of(file, what, "start from a solution with the same world").into());
    }
    let tree = FrameTree::new(&layout);
    Ok(tree.static_edges.iter().filter_map(|edge| Some((edge.key.clone(), edge.spec.pose()?))).collect())
}

/// SHA-256 of the layout, of every file that it names and was read, and of the start.
pub(super) fn hashes(
    layout: &Layout,
    recording: &Recording,
    start: Option<&PathBuf>,
) -> Result<Vec<(String, String)>, InputError> {
    let mut all = Vec::new();
    for path in std::iter::once(&layout.file).chain(&layout.files).chain(&recording.files).chain(start) {
        let digest = match recording.digests.get(path) {
            Some(digest) => *digest,
            None => Sha256::digest(std::fs::read(path).map_err(|e| {
                Complaint::of(path, format!("the file cannot be read: {}", crate::layout::plain(&e)), "check the path")
            })?)
            .into(),
        };
        let hex: String = digest.iter().map(|byte| format!("{byte:02x}")).collect();
        let name = path.strip_prefix(&layout.recording).unwrap_or(path);
        all.push((name.display().to_string(), hex));
    }
    Ok(all)
}
