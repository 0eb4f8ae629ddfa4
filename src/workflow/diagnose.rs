//! What is wrong with a recording that does not fit: explanations are tried, and the one that makes the rest agree is told.
//!
//! Nothing is done for a fit that is sound. Where more is set aside, or more is left over, than noise explains, each explanation is a small change of the
//! recording or its description (a log by a line, a target by its size, two cameras exchanged, a thing that moved taken out from there on), solved
//! again on a part of the configurations. What makes the misfit fall far enough is believed. Then what has been set aside is explained case by case
//! ([`crate::trust::culprits`]).

use nalgebra::{Vector2, Vector3};
use std::collections::BTreeMap;
use std::time::Instant;

use super::explanations::{moved, shifted_logs, swapped_cameras, wrong_sizes};
use super::repair;
use super::solve::{Solved, solve_plain};
use crate::geometry::Pose;
use crate::layout::Layout;
use crate::recording::Recording;
use crate::solve::{Assembler, GroupKind, Priors};
use crate::trust::culprits::culprits;
use crate::trust::sightings::sightings;
use crate::trust::{Action, Evidence, Fault, FaultKind};

/// A share of the measurements set aside above this is looked into.
const ASIDE: f64 = 0.003;
/// A share above which explanations of the whole are tried.
const MUCH_ASIDE: f64 = 0.01;
/// Fitted noise, in the layout's standard deviations, above which a fit is looked into; above which sizes are doubted, too.
const NOISY: f64 = 1.5;
pub(super) const VERY_NOISY: f64 = 3.0;
/// What is farther off than this (standard deviations) counts as if it were so far.
const FARTHEST: f64 = 40.0;
/// Configurations on which explanations are tried.
pub(super) const TRIED_ON: usize = 50;
/// Of a target that does not fit at all, so many corners have been set aside.
const NOTHING_FITS: f64 = 0.8;

/// An explanation that convinces.
pub(super) struct Explained {
    pub(super) fault: Fault,
    /// The cell as it would be.
    pub(super) tried: Tried,
    pub(super) recording: Recording,
}

/// Share of the measurements that were set aside.
pub(super) fn aside(solved: &Solved) -> f64 {
    let m = &solved.plan.measurements;
    let all = m.corner_count() + m.poses.len() + m.points.len() + m.contacts.len();
    let aside = solved.rejected.total() - solved.rejected.unplaced;
    aside as f64 / all.max(1) as f64
}

/// Root mean square residual in the layout's standard deviations.
pub(super) fn noise(solved: &Solved) -> f64 {
    (solved.residuals.weighted_sum / solved.plan.scalar_count().max(1) as f64).sqrt()
}

/// Root mean square of all residuals, those set aside included, in the layout's standard deviations and at most [`FARTHEST`] each.
fn misfit(solved: &Solved, recording: &Recording) -> f64 {
    let (m, s) = (&solved.plan.measurements, &solved.plan.settings);
    let most = FARTHEST * FARTHEST;
    let mut sum = solved.residuals.weighted_sum;
    for (group, poses) in solved.plan.groups.iter().zip(block_poses(solved, recording)) {
        let GroupKind::Corners { camera } = group.kind else { continue };
        let Some(lens) = &solved.layout.cameras[camera].intrinsics else { continue };
        let lens = lens.with_parameters(solved.state.lenses[camera]);
        for (block, pose) in group.blocks.iter().zip(&poses) {
            for i in (block.start..block.end).filter(|i| !m.is_kept(*i)) {
                let at = lens.project(&(*pose * Vector3::from(m.place(i))));
                let off = at.map_or(most, |at| (at - Vector2::from(m.pixel(i))).norm_squared() / s.pixel_sigma.powi(2));
                sum += off.min(most);
            }
        }
    }
    let j = &solved.rejected;
    sum += most * (j.poses + j.points + j.contacts) as f64;
    let aside = 2 * j.corners + 6 * j.poses + 3 * j.points + j.contacts;
    (sum / (solved.plan.scalar_count() + aside).max(1) as f64).sqrt()
}

/// A cell solved to see whether it fits better.
pub(super) struct Tried {
    pub(super) solved: Solved,
    pub(super) misfit: f64,
}

/// A fit to explain.
pub(super) struct Case<'a> {
    pub(super) solved: &'a Solved,
    pub(super) recording: &'a Recording,
    /// The starting poses that were given.
    pub(super) start: &'a [(String, Pose)],
    /// A part of the recording, and how it solves as it stands.
    pub(super) thin: Recording,
    pub(super) before: Tried,
}

impl<'a> Case<'a> {
    fn new(solved: &'a Solved, recording: &'a Recording, start: &'a [(String, Pose)]) -> Option<Self> {
        let thin = repair::thin(recording, TRIED_ON);
        let before = solve_plain(solved.layout.clone(), &thin, start, Vec::new(), Instant::now(), false).ok()?;
        let before = Tried { misfit: misfit(&before, &thin), solved: before };
        Some(Self { solved, recording, start, thin, before })
    }

    /// How a changed cell solves, if that brings the misfit down to a share of what it was.
    pub(super) fn convinces(&self, layout: &Layout, recording: &Recording, share: f64) -> Option<Tried> {
        attempt(layout, recording, self.start).filter(|after| after.misfit < share * self.before.misfit)
    }
}

pub(super) fn attempt(layout: &Layout, recording: &Recording, start: &[(String, Pose)]) -> Option<Tried> {
    let solved = solve_plain(layout.clone(), recording, start, Vec::new(), Instant::now(), false).ok()?;
    solved.report.termination.converged().then(|| Tried { misfit: misfit(&solved, recording), solved })
}

/// `sensor_from_target` of every block of a solution.
pub(super) fn block_poses(solved: &Solved, recording: &Recording) -> Vec<Vec<Pose>> {
    Assembler::new(&solved.layout, recording, &solved.plan, Priors::default()).block_poses(&solved.state)
}

/// Finds what is wrong, if the fit gives reason to look.
#[must_use]
pub fn diagnose(solved: &Solved, recording: &Recording, start: &[(String, Pose)]) -> Vec<Fault> {
    let (share, noise) = (aside(solved), noise(solved));
    if share <= ASIDE && noise <= NOISY {
        return Vec::new();
    }
    let much = share > MUCH_ASIDE || noise > NOISY;
    let case = much.then(|| Case::new(solved, recording, start)).flatten();
    if let Some(explained) = case.and_then(|case| explain(&case)) {
        let mut faults = vec![explained.fault];
        faults.extend(cases(&explained.tried.solved, &explained.recording));
        return faults;
    }
    cases(solved, recording)
}

/// What was set aside, case by case.
fn cases(solved: &Solved, recording: &Recording) -> Vec<Fault> {
    let poses = block_poses(solved, recording);
    let evidence = evidence(solved, recording, &poses);
    let seen = sightings(&evidence);
    let mut faults = culprits(&evidence, &seen, solved.summary.rms_px());
    let mut whole: BTreeMap<&str, (usize, usize)> = BTreeMap::new();
    for tally in &solved.tallies {
        let sum = whole.entry(&tally.target).or_default();
        *sum = (sum.0 + tally.accepted, sum.1 + tally.rejected);
    }
    for (target, (accepted, rejected)) in whole {
        if rejected >= 8 && rejected as f64 > NOTHING_FITS * (accepted + rejected) as f64 {
            faults.push(Fault {
                kind: FaultKind::DoesNotFit,
                what: format!("nothing of `{target}` fits the rest of the cell"),
                evidence: format!("{rejected} of its {} corners were set aside", accepted + rejected),
                remedy: format!(
                    "check the dictionary, the ids and the geometry of `{target}`, what it is mounted on, and that it stands still there"
                ),
                action: Action::Refused,
            });
        }
    }
    faults
}

pub(super) fn evidence<'a>(solved: &'a Solved, recording: &'a Recording, poses: &'a [Vec<Pose>]) -> Evidence<'a> {
    Evidence { layout: &solved.layout, tree: &solved.tree, recording, plan: &solved.plan, state: &solved.state, poses }
}

/// The explanation that convinces most; one that leaves measurements out only if no other does as well.
fn explain(case: &Case<'_>) -> Option<Explained> {
    let poses = block_poses(case.solved, case.recording);
    let evidence = evidence(case.solved, case.recording, &poses);
    let seen = sightings(&evidence);
    let mut all: Vec<Explained> = Vec::new();
    all.extend(shifted_logs(case, &evidence, &seen));
    all.extend(swapped_cameras(case));
    if aside(&case.before.solved) > MUCH_ASIDE || noise(&case.before.solved) > VERY_NOISY {
        all.extend(wrong_sizes(case));
    }
    if all.is_empty() {
        all.extend(moved(case, &evidence, &seen));
    }
    all.into_iter().min_by(|a, b| a.tried.misfit.total_cmp(&b.tried.misfit))
}
