//! The explanations that are tried for a fit that does not hold.

use std::collections::{BTreeMap, BTreeSet};

use super::diagnose::{Case, Explained, TRIED_ON, Tried, VERY_NOISY, aside, attempt, noise};
use super::repair::{self, Sizes};
use super::solve::Solved;
use crate::frames::Step;
use crate::geometry::{Pose, TargetGeometry};
use crate::trust::changes::{Change, changes, middle, scatter, values};
use crate::trust::shifts::shifts;
use crate::trust::sightings::{ARM, Sighting, distance};
use crate::trust::{Action, Evidence, Fault, FaultKind};

/// An explanation must bring the misfit down to this share of what it was.
const CONVINCING: f64 = 0.4;
/// The same for one that fits no number and leaves nothing out: chance hardly helps it.
const CONVINCING_AS_IT_IS: f64 = 0.7;
/// Poses that are suspected of having moved, at most.
const SUSPECTS: usize = 8;
/// A step must be this many times as large as the middles of its sides are uncertain.
const SURE: f64 = 6.0;
/// Targets whose size is doubted, and pairs of cameras that are exchanged, at most.
const DOUBTED: usize = 4;
const PAIRS: usize = 10;
/// A target is doubted whose share of corners set aside, or residual, is so many times the usual; all are if the fit is very noisy.
const STANDS_OUT: f64 = 1.3;
/// Steps of the search for a size, as a share of it; where it must have brought the misfit down to a share of what it was to go on.
const FIRST_STEP: f64 = 0.1;
const PROMISING_STEP: f64 = 0.02;
const PROMISING: f64 = 0.9;
const LAST_STEP: f64 = 5e-4;
/// Sizes that are tried where hardly anything fits.
const FAR_SIZES: [f64; 4] = [0.8, 1.25, 0.5, 2.0];

/// How much better it is, in words.
fn improvement(before: &Tried, after: &Tried) -> String {
    let one = |s: &Solved| match (s.summary.rms_px(), s.summary.rms_poses()) {
        (Some(px), _) => format!("{px:.2} px and {:.1} % set aside", 100.0 * aside(s)),
        (None, Some([t, _])) => format!("{:.2} mm and {:.1} % set aside", t * 1e3, 100.0 * aside(s)),
        _ => format!("{:.2} standard deviations and {:.1} % set aside", noise(s), 100.0 * aside(s)),
    };
    format!("the residual falls from {} to {}", one(&before.solved), one(&after.solved))
}

pub(super) fn shifted_logs(case: &Case<'_>, evidence: &Evidence<'_>, seen: &[Vec<Sighting>]) -> Vec<Explained> {
    let solved = case.solved;
    let mut all = Vec::new();
    for shift in shifts(evidence, seen) {
        let mended =
            repair::shift_back(&solved.layout, &solved.tree, case.recording, shift.robot, shift.from, shift.lines);
        let mended = repair::thin(&mended, TRIED_ON);
        let Some(after) = case.convinces(&solved.layout, &mended, CONVINCING_AS_IT_IS) else { continue };
        let name = &solved.layout.robots[shift.robot].name;
        let late = if shift.lines > 0 { "late" } else { "early" };
        let count = shift.lines.unsigned_abs();
        let plural = if count == 1 { "" } else { "s" };
        let other = if shift.lines > 0 { "after" } else { "before" };
        all.push(Explained {
            fault: Fault {
                kind: FaultKind::ShiftedLog,
                what: format!("the log of `{name}` is {count} line{plural} {late} from configuration {} on", shift.from),
                evidence: format!(
                    "with the values that stand {count} line{plural} {other} each configuration, {}; of the turns between configurations \
                     {:.0} % agree then, {:.0} % as it stands",
                    improvement(&case.before, &after),
                    100.0 * shift.agreement[0],
                    100.0 * shift.agreement[1]
                ),
                remedy: format!(
                    "from configuration {} on give each configuration the values that stand {count} line{plural} {other} it, or leave those \
                     configurations out",
                    shift.from
                ),
                action: Action::Refused,
            },
            tried: after,
            recording: mended,
        });
    }
    all
}

pub(super) fn swapped_cameras(case: &Case<'_>) -> Vec<Explained> {
    let (solved, thin) = (case.solved, &case.thin);
    let cameras: BTreeSet<usize> = thin
        .corners
        .appearances()
        .iter()
        .map(|one| one.camera)
        .chain(thin.poses.iter().map(|row| row.camera))
        .collect();
    let cameras: Vec<usize> = cameras.into_iter().collect();
    let pairs = cameras.iter().enumerate().flat_map(|(i, a)| cameras[i + 1..].iter().map(move |b| (*a, *b)));
    let mut all = Vec::new();
    for (a, b) in pairs.take(PAIRS) {
        let mended = repair::exchange_cameras(thin, a, b);
        let Some(after) = case.convinces(&solved.layout, &mended, CONVINCING_AS_IT_IS) else { continue };
        let [a, b] = [a, b].map(|i| solved.layout.cameras[i].name.as_str());
        all.push(Explained {
            fault: Fault {
                kind: FaultKind::SwappedCameras,
                what: format!("the pictures of `{a}` and `{b}` have changed places"),
                evidence: format!("exchanged, {}", improvement(&case.before, &after)),
                remedy: format!(
                    "exchange `images` of `{a}` and `{b}` in the layout, or their folders, and detect again"
                ),
                action: Action::Refused,
            },
            tried: after,
            recording: mended,
        });
    }
    all
}

pub(super) fn wrong_sizes(case: &Case<'_>) -> Vec<Explained> {
    let (solved, before) = (case.solved, &case.before.solved);
    let mut share: BTreeMap<&str, (usize, usize, f64)> = BTreeMap::new();
    for tally in &before.tallies {
        let sum = share.entry(&tally.target).or_default();
        let rms = tally.rms_px.unwrap_or(0.0);
        *sum = (sum.0 + tally.accepted, sum.1 + tally.rejected, sum.2.max(rms));
    }
    let badness = |target: &str| {
        share.get(target).map_or(0.0, |(ok, bad, rms)| rms * (1.0 + 25.0 * *bad as f64 / (*ok + *bad).max(1) as f64))
    };
    let mut doubted: Vec<usize> = (0..solved.layout.targets.len())
        .filter(|&t| {
            matches!(solved.layout.targets[t].geometry, TargetGeometry::Tags(_) | TargetGeometry::Board { .. })
        })
        .filter(|&t| share.contains_key(solved.layout.targets[t].name.as_str()))
        .collect();
    // What is spread evenly over all targets is no target's size.
    let (ok, bad, rms) = share.values().fold((0, 0, 0.0_f64), |sum, one| (sum.0 + one.0, sum.1 + one.1, sum.2 + one.2));
    let (usual, rms) = (bad as f64 / (ok + bad).max(1) as f64, rms / share.len().max(1) as f64);
    let stands_out = |target: usize| {
        share.get(solved.layout.targets[target].name.as_str()).is_some_and(|(ok, bad, own)| {
            *bad as f64 > STANDS_OUT * usual * (*ok + *bad) as f64 || *own > STANDS_OUT * rms
        })
    };
    if share.len() > 1 && noise(before) < VERY_NOISY {
        doubted.retain(|target| stands_out(*target));
    }
    doubted
        .sort_by(|a, b| badness(&solved.layout.targets[*b].name).total_cmp(&badness(&solved.layout.targets[*a].name)));
    let mut best: Option<Explained> = None;
    for &target in doubted.iter().take(DOUBTED) {
        let hopeless = share
            .get(solved.layout.targets[target].name.as_str())
            .is_some_and(|(accepted, rejected, _)| rejected > accepted);
        for sizes in [Sizes::Tags, Sizes::Whole] {
            let Some((factor, after)) = search_size(case, target, sizes, hopeless) else { continue };
            let found = after.misfit;
            if found >= CONVINCING * case.before.misfit || best.as_ref().is_some_and(|best| best.tried.misfit <= found)
            {
                continue;
            }
            let name = &solved.layout.targets[target].name;
            let mm = repair::size_of(&solved.layout.targets[target].geometry, 1e3);
            let what = match sizes {
                Sizes::Tags => "tags",
                Sizes::Whole => "whole pattern",
            };
            best = Some(Explained {
                fault: Fault {
                    kind: FaultKind::WrongSize,
                    what: format!(
                        "the {what} of `{name}` measure{} {:.2} mm where the layout says {mm:.2} mm",
                        if sizes == Sizes::Tags { "" } else { "s" },
                        mm * factor
                    ),
                    evidence: format!("{:+.2} %: then {}", 100.0 * (factor - 1.0), improvement(&case.before, &after)),
                    remedy: format!(
                        "measure `{name}` (the outer edge of a tag's black border, or a square of a board) and correct its size in the layout"
                    ),
                    action: Action::Refused,
                },
                tried: after,
                recording: case.thin.clone(),
            });
        }
    }
    best.into_iter().collect()
}

/// The factor on a target's size that fits best, by pattern search (Hooke and Jeeves, *Direct search*, J. ACM 8, 1961) on its logarithm; none where
/// no factor helps. `hopeless`: so little fits that sizes far away are tried, too.
fn search_size(case: &Case<'_>, target: usize, sizes: Sizes, hopeless: bool) -> Option<(f64, Tried)> {
    let at = |factor: f64| {
        let layout = repair::resized(&case.solved.layout, target, factor, sizes)?;
        let after = attempt(&layout, &case.thin, case.start)?;
        Some((factor, after))
    };
    let mut best: Option<(f64, Tried)> = None;
    let unchanged = case.before.misfit;
    let found = |best: &Option<(f64, Tried)>| best.as_ref().map_or((unchanged, 1.0), |best| (best.1.misfit, best.0));
    for factor in FAR_SIZES.iter().filter(|_| hopeless) {
        if let Some(tried) = at(*factor).filter(|tried| tried.1.misfit < found(&best).0) {
            best = Some(tried);
        }
    }
    let mut step = FIRST_STEP;
    while step > LAST_STEP {
        let (known, here) = found(&best);
        let tried = [-step, step].into_iter().filter_map(|d| at(here * d.exp())).find(|tried| tried.1.misfit < known);
        match tried {
            Some(tried) => best = Some(tried),
            // A size that is wrong enough to matter shows by now.
            None if step < PROMISING_STEP && known > PROMISING * unchanged => return None,
            None => step /= 3.0,
        }
    }
    best
}

/// Something moved: without what was measured of it on the shorter side of the change, the rest agrees, and what was left out agrees with itself.
pub(super) fn moved(case: &Case<'_>, evidence: &Evidence<'_>, seen: &[Vec<Sighting>]) -> Vec<Explained> {
    let solved = case.solved;
    let mut all: Vec<(f64, Explained)> = Vec::new();
    let suspects: Vec<Change> = changes(evidence, seen).into_iter().filter(|change| change.explained > 0.2).collect();
    for change in suspects.iter().take(SUSPECTS) {
        let configurations = &evidence.plan.configurations;
        let crosses = |from, to| {
            let steps = solved.tree.path(from, to).steps;
            steps.iter().any(|step| matches!(step, Step::Static { edge, .. } if *edge == change.edge))
        };
        let first = configurations[change.from];
        let early = 2 * change.from < configurations.len();
        let mended = repair::without(&solved.layout, &solved.tree, case.recording, crosses, |id| (id < first) == early);
        let mended = repair::thin(&mended, TRIED_ON);
        let Some(after) = case.convinces(&solved.layout, &mended, CONVINCING) else { continue };
        // The same pictures, with everything else as it is without the suspect.
        let there = Evidence { state: &after.solved.state, ..*evidence };
        let values = values(&there, seen, change.edge);
        let Some((from, sides)) = divide(&values, change.from) else { continue };
        let [ours, theirs] = &sides;
        let (scatter_here, scatter_there) = (scatter(ours), scatter(theirs));
        let (kept, left) = if early { (scatter_there, scatter_here) } else { (scatter_here, scatter_there) };
        if left > 4.0 * kept + 0.001 {
            continue;
        }
        let step = middle(ours).inverse() * middle(theirs);
        let (apart, angle) = step.magnitude();
        // The middles are known better than single pictures.
        let fewest = ours.len().min(theirs.len()).max(1) as f64;
        if apart + ARM * angle < SURE * left / fewest.sqrt() {
            continue;
        }
        let name = &solved.tree.frames[change.frame].name;
        let (last, next) = (configurations[from - 1], configurations[from]);
        let edge = &solved.tree.static_edges[change.edge].key;
        all.push((
            left,
            Explained {
                fault: Fault {
                    kind: FaultKind::Moved,
                    what: format!(
                        "`{name}` moved by {:.1} mm and {:.2} deg between configurations {last} and {next}",
                        apart * 1e3,
                        angle.to_degrees()
                    ),
                    evidence: format!(
                        "without what was measured across `{edge}` {} that, {}; what was left out agrees with itself to {:.1} mm",
                        if early { "before" } else { "after" },
                        improvement(&case.before, &after),
                        left * 1e3
                    ),
                    remedy: format!(
                        "split the recording between configurations {last} and {next} and solve each part, or fasten `{name}` and record again"
                    ),
                    action: Action::Refused,
                },
                tried: after,
                recording: mended,
            },
        ));
    }
    // Poses on one path change together; the one that moved is the one whose other side agrees with itself best.
    all.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, explained)| explained).into_iter().collect()
}

/// Divides what pictures say of a pose where most of it falls on the right side, near a first guess: the first configuration of the later side, both
/// sides.
fn divide(values: &[(usize, Pose)], guess: usize) -> Option<(usize, [Vec<Pose>; 2])> {
    let part = |from: usize| -> [Vec<Pose>; 2] {
        let (early, late): (Vec<_>, Vec<_>) = values.iter().partition(|(c, _)| *c < from);
        [early, late].map(|side: Vec<&(usize, Pose)>| side.into_iter().map(|(_, pose)| *pose).collect())
    };
    let [early, late] = part(guess);
    if early.is_empty() || late.is_empty() {
        return None;
    }
    let (first, second) = (middle(&early), middle(&late));
    let far = |pose: &Pose, centre: &Pose| distance(pose, centre);
    let wrong =
        |from: usize| values.iter().filter(|(c, pose)| (far(pose, &first) < far(pose, &second)) != (*c < from)).count();
    let places: BTreeSet<usize> = values.iter().map(|(c, _)| *c).skip_while(|c| *c == values[0].0).collect();
    let from = places.into_iter().min_by_key(|from| (wrong(*from), from.abs_diff(guess)))?;
    Some((from, part(from)))
}
