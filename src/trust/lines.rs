//! Lines of a joint log that do not fit the pictures, and whose lines they really are.

use std::collections::{BTreeMap, BTreeSet};

use super::fault::{Action, Fault, FaultKind};
use super::sightings::{Sighting, distance, implied, robot_segment};
use super::undetermined::Evidence;
use crate::frames::Step;
use crate::geometry::Pose;
use crate::solve::GroupKind;

/// A configuration whose measurements have been set aside to this share is wrong as a whole.
const MOSTLY: f64 = 0.6;

/// How a robot's logged place compares with what the pictures say at one configuration.
struct Line {
    configuration: usize,
    /// Where the pictures have the end of the segment, and the segment.
    seen: Pose,
    segment: (usize, usize),
    /// How far that is from the log's line (m).
    own: f64,
    bad: bool,
}

/// Configurations whose joint values do not fit, and where what was seen fits to another line of the log.
pub(super) fn wrong_lines(evidence: &Evidence<'_>, sightings: &[Vec<Sighting>]) -> (Vec<Fault>, BTreeSet<usize>) {
    let (mut faults, mut found) = (Vec::new(), BTreeSet::new());
    for (robot, described) in evidence.layout.robots.iter().enumerate() {
        let lines = compared(evidence, sightings, robot);
        let mut usual: Vec<f64> = lines.values().filter(|line| !line.bad).map(|line| line.own).collect();
        if usual.len() < 3 {
            continue;
        }
        usual.sort_by(f64::total_cmp);
        let tolerance = 0.003 + 4.0 * usual[usual.len() / 2];
        let fits = |line: &Line, id: u64| {
            robot_segment(evidence, robot, line.segment.0, line.segment.1, id)
                .map_or(f64::INFINITY, |pose| distance(&line.seen, &pose))
        };
        let ids = evidence.recording.motions[robot].configurations();
        let mut told: BTreeSet<u64> = BTreeSet::new();
        let mut unexplained = Vec::new();
        for line in lines.values().filter(|line| line.bad && line.own > 3.0 * tolerance) {
            let id = evidence.plan.configurations[line.configuration];
            found.insert(line.configuration);
            if told.contains(&id) {
                continue;
            }
            let best = ids.iter().filter(|other| **other != id).map(|other| (*other, fits(line, *other)));
            let best = best.min_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, far)| *far < tolerance);
            let Some((other, far)) = best else {
                unexplained.push((id, line.own));
                continue;
            };
            let back = evidence.plan.configurations.binary_search(&other).ok().and_then(|c| lines.get(&c));
            let both = back.is_some_and(|back| back.bad && fits(back, id) < tolerance);
            let evidence_words = format!(
                "at configuration {id} the pictures have the robot {:.1} mm from its own line and {:.1} mm from line {other}{}",
                line.own * 1e3,
                far * 1e3,
                if both { ", and the other way round" } else { "" }
            );
            told.insert(id);
            if both {
                told.insert(other);
            }
            let name = &described.name;
            faults.push(Fault {
                kind: if both { FaultKind::SwappedLines } else { FaultKind::WrongJointValues },
                what: if both {
                    format!("the joint values of `{name}` at configurations {id} and {other} have changed places")
                } else {
                    format!("the joint values of `{name}` at configuration {id} are those of configuration {other}")
                },
                evidence: evidence_words,
                remedy: "mend the lines in the file of joint values, or leave them out".to_owned(),
                action: Action::Excluded,
            });
        }
        if let Some((worst, far)) = unexplained.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1)) {
            let names: Vec<String> = unexplained.iter().take(8).map(|(id, _)| id.to_string()).collect();
            let more = if unexplained.len() > names.len() { " and more" } else { "" };
            faults.push(Fault {
                kind: FaultKind::WrongJointValues,
                what: format!(
                    "the joint values of `{}` do not fit at {} configuration{}: {}{more}",
                    described.name,
                    unexplained.len(),
                    if unexplained.len() == 1 { "" } else { "s" },
                    names.join(", ")
                ),
                evidence: format!(
                    "at configuration {worst} the pictures have the robot {:.1} mm from where its joint values put it, against {:.1} mm \
                     usually",
                    far * 1e3,
                    usual[usual.len() / 2] * 1e3
                ),
                remedy: "check that the robot stood still while pictures were taken and joint values were read".to_owned(),
                action: Action::Excluded,
            });
        }
    }
    (faults, found)
}

/// For each configuration, what the pictures say of a robot.
fn compared(evidence: &Evidence<'_>, sightings: &[Vec<Sighting>], robot: usize) -> BTreeMap<usize, Line> {
    let mut lines: BTreeMap<usize, Line> = BTreeMap::new();
    for (group, sightings) in evidence.plan.groups.iter().zip(sightings) {
        let mut robots = group.path.steps.iter().enumerate().filter_map(|(at, step)| match *step {
            Step::Robot { robot, from, to, .. } => Some((at, robot, from, to)),
            _ => None,
        });
        let (Some((at, walked, from, to)), None) = (robots.next(), robots.next()) else { continue };
        if walked != robot || group.path.steps.iter().any(|step| matches!(step, Step::Moving { .. })) {
            continue;
        }
        for sighting in sightings {
            let c = sighting.configuration;
            let Some(seen) = implied(evidence, &group.path, at, sighting) else { continue };
            let id = evidence.plan.configurations[c];
            let Some(logged) = robot_segment(evidence, robot, from, to, id) else { continue };
            let own = distance(&seen, &logged);
            let line = Line { configuration: c, seen, segment: (from, to), own, bad: false };
            // Of several views the one that agrees best with the log speaks: a bad one must not accuse the line.
            if lines.get(&c).is_none_or(|known| own < known.own) {
                lines.insert(c, line);
            }
        }
    }
    for line in lines.values_mut() {
        line.bad = mostly_aside(evidence, robot, line.configuration);
    }
    lines
}

/// Whether most of what was measured across a robot at a configuration has been set aside.
fn mostly_aside(evidence: &Evidence<'_>, robot: usize, configuration: usize) -> bool {
    let m = &evidence.plan.measurements;
    let (mut aside, mut all) = (0, 0);
    for group in evidence.plan.groups.iter().filter(|group| group.path.robots().any(|r| r == robot)) {
        for block in group.blocks.iter().filter(|block| block.configuration == configuration) {
            all += block.end - block.start;
            let range = block.start..block.end;
            aside += match group.kind {
                GroupKind::Corners { .. } => range.filter(|i| !m.is_kept(*i)).count(),
                GroupKind::Poses => m.poses[range].iter().filter(|pose| pose.is_none()).count(),
                GroupKind::Points => m.points[range].iter().filter(|point| point.is_none()).count(),
                GroupKind::Contacts => m.contacts[range].iter().filter(|contact| contact.is_none()).count(),
            };
        }
    }
    all > 0 && aside as f64 >= MOSTLY * all as f64
}
