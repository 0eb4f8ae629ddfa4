//! Measured poses that are the second solution of a flat target.

use nalgebra::Vector3;
use std::collections::BTreeSet;

use super::culprits::TOLD;
use super::fault::{Action, Fault, FaultKind};
use super::sightings::Sighting;
use super::undetermined::Evidence;
use crate::complaint::list;
use crate::geometry::Pose;
use crate::solve::GroupKind;

/// Measured poses that lean to the other side of the line of sight.
pub(super) fn flipped_poses(evidence: &Evidence<'_>, sightings: &[Vec<Sighting>]) -> Option<Fault> {
    let (mut count, mut told, mut names) = (0, Vec::new(), BTreeSet::new());
    let groups = evidence.plan.groups.iter().zip(evidence.poses).zip(sightings);
    for ((group, poses), sightings) in groups.filter(|((group, _), _)| group.kind == GroupKind::Poses) {
        for sighting in sightings {
            let c = sighting.configuration;
            let Some(place) = group.blocks.iter().position(|block| block.configuration == c) else { continue };
            let (block, pose) = (&group.blocks[place], &poses[place]);
            let m = &evidence.plan.measurements;
            let measured = sighting.nearest(pose);
            if m.poses[block.start].is_some() {
                continue;
            }
            let (own, mirrored) = (measured.rotation.angle_to(&pose.rotation), mirrored(&measured));
            let other = mirrored.map_or(own, |mirrored| mirrored.rotation.angle_to(&pose.rotation));
            if own > 0.1 && other < 0.25 * own {
                count += 1;
                let frames = &evidence.tree.frames;
                names.insert(frames[group.path.to].name.as_str());
                if told.len() < TOLD {
                    told.push(format!(
                        "at configuration {} `{}` is {:.1} deg off as seen by `{}`, and {:.1} deg if it leans to the other side",
                        evidence.plan.configurations[c],
                        frames[group.path.to].name,
                        own.to_degrees(),
                        frames[group.path.from].name,
                        other.to_degrees()
                    ));
                }
            }
        }
    }
    (count > 0).then(|| Fault {
        kind: FaultKind::Flipped,
        what: format!("{count} measured poses of {} lean to the wrong side", list(names)),
        evidence: told.join("; "),
        remedy: "a flat target seen from afar has two solutions: let the detector give corners in place of poses, or use a target with depth"
            .to_owned(),
        action: Action::Excluded,
    })
}

/// The second solution of a flat target seen from afar: its face leans to the other side of the line of sight.
fn mirrored(pose: &Pose) -> Option<Pose> {
    let sight = pose.translation.try_normalize(1e-9)?;
    let normal = pose.rotation * Vector3::z();
    let leaning = sight * (2.0 * normal.dot(&sight)) - normal;
    let turn = nalgebra::UnitQuaternion::rotation_between(&normal, &leaning)?;
    Some(Pose::new(turn * pose.rotation, pose.translation))
}
