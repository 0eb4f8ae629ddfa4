//! Logs that are late or early by some lines, seen without any solution.
//!
//! Between two configurations a target on a robot turns by some angle as its camera sees it, and the robot's flange by the same angle, wherever
//! camera, base and target are (screw congruence; Chen, *A screw motion approach to uniqueness analysis of head-eye geometry*, CVPR 1991). So a
//! log can be held against the pictures line by line before anything is known.

use super::sightings::{Sighting, distance, robot_segment};
use super::undetermined::Evidence;
use crate::frames::Step;
use crate::geometry::Pose;

/// A log that may be shifted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shift {
    /// The robot's place in the layout.
    pub robot: usize,
    /// How many lines later the line stands that belongs to a configuration; negative: earlier.
    pub lines: isize,
    /// The first configuration (as recorded) from which that is so.
    pub from: u64,
    /// The share of pairs of configurations that agree from there on, with the shift and without.
    pub agreement: [f64; 2],
}

/// Lines that a log is shifted by at most.
const FARTHEST: isize = 3;
/// Angles (rad) that differ by less agree.
const AGREE: f64 = 0.02;
/// Each configuration is held against so many that follow.
const AHEAD: usize = 4;
/// Lines of a log that are no further apart (m) are the same.
const SAME: f64 = 1e-6;
/// Pairs that a verdict needs.
const PAIRS: usize = 6;

/// The most likely shift of each robot's log, if any explains the pictures better than none.
#[must_use]
pub fn shifts(evidence: &Evidence<'_>, sightings: &[Vec<Sighting>]) -> Vec<Shift> {
    (0..evidence.layout.robots.len()).filter_map(|robot| shift(evidence, sightings, robot)).collect()
}

/// Two configurations' lines and the angle between them as pictures have it (either of two candidates).
struct Pair {
    lines: [usize; 2],
    angles: Vec<f64>,
}

fn shift(evidence: &Evidence<'_>, sightings: &[Vec<Sighting>], robot: usize) -> Option<Shift> {
    let ids = evidence.recording.motions[robot].configurations();
    let (mut pairs, mut segment): (Vec<Pair>, Option<(usize, usize)>) = (Vec::new(), None);
    for (group, sightings) in evidence.plan.groups.iter().zip(sightings) {
        let mut robots = group.path.steps.iter().filter_map(|step| match *step {
            Step::Robot { robot, from, to, .. } => Some((robot, (from, to))),
            _ => None,
        });
        let (Some((walked, part)), None) = (robots.next(), robots.next()) else { continue };
        let moving = group.path.steps.iter().any(|step| matches!(step, Step::Moving { .. }));
        if walked != robot || moving || segment.is_some_and(|known| known != part) {
            continue;
        }
        segment = Some(part);
        for (i, first) in sightings.iter().enumerate() {
            for second in sightings.iter().skip(i + 1).take(AHEAD) {
                let line = |s: &Sighting| ids.binary_search(&evidence.plan.configurations[s.configuration]).ok();
                let (Some(a), Some(b)) = (line(first), line(second)) else { continue };
                let angles = first
                    .candidates
                    .iter()
                    .flat_map(|x| second.candidates.iter().map(move |y| x.rotation.angle_to(&y.rotation)));
                pairs.push(Pair { lines: [a, b], angles: angles.collect() });
            }
        }
    }
    let (from, to) = segment?;
    let poses: Vec<Pose> = ids.iter().map(|id| robot_segment(evidence, robot, from, to, *id)).collect::<Option<_>>()?;
    let agrees = |pair: &Pair, lines: isize| {
        let at = |line: usize| line.checked_add_signed(lines).and_then(|line| poses.get(line));
        let (Some(a), Some(b)) = (at(pair.lines[0]), at(pair.lines[1])) else { return false };
        let turn = a.rotation.angle_to(&b.rotation);
        pair.angles.iter().any(|angle| (angle - turn).abs() < AGREE)
    };
    let plain: Vec<bool> = pairs.iter().map(|pair| agrees(pair, 0)).collect();
    let mut best: Option<(i64, Shift)> = None;
    for lines in (-FARTHEST..=FARTHEST).filter(|lines| *lines != 0) {
        let moved: Vec<bool> = pairs.iter().map(|pair| agrees(pair, lines)).collect();
        for (first, id) in ids.iter().enumerate() {
            // Before the break the log is right, after it shifted; a pair across it says nothing.
            let (mut gain, mut after, mut with, mut without) = (0i64, 0usize, 0usize, 0usize);
            let later = |pair: &Pair| pair.lines[0].min(pair.lines[1]) >= first;
            for (i, _) in pairs.iter().enumerate().filter(|(_, pair)| later(pair)) {
                gain += i64::from(moved[i]) - i64::from(plain[i]);
                after += 1;
                with += usize::from(moved[i]);
                without += usize::from(plain[i]);
            }
            if after < PAIRS || best.as_ref().is_some_and(|(known, _)| gain <= *known) {
                continue;
            }
            let share = |count: usize| count as f64 / after as f64;
            let agreement = [share(with), share(without)];
            best = Some((gain, Shift { robot, lines, from: *id, agreement }));
        }
    }
    let mut shift =
        best.map(|(_, shift)| shift).filter(|shift| shift.agreement[0] > 0.6 && shift.agreement[1] < 0.5)?;
    // Where the log begins to lag, a line stands twice: what is the same either way is right.
    while let Some(at) = ids.iter().position(|id| *id == shift.from)
        && at + 1 < ids.len()
        && let Some(other) = at.checked_add_signed(shift.lines).and_then(|other| poses.get(other))
        && distance(other, &poses[at]) < SAME
    {
        shift.from = ids[at + 1];
    }
    Some(shift)
}
