//! Undetermined and weak directions in words: what moves against what, why, and what would help.
//!
//! The open directions of a solve are a space, and any basis of it is as true as another. So that each sentence names one cause, the directions
//! that theory predicts ([`super::structure`]) are taken out of that space first, and what is left is put into the basis with the fewest
//! entries.

use nalgebra::{Matrix3, Vector3};
use std::collections::BTreeSet;

use crate::frames::{Edge, FrameTree, Step};
use crate::geometry::{Pose, rotation};
use crate::layout::Layout;
use crate::recording::Recording;
use crate::robot::{PARAMETERS_PER_LINK, ParameterKind};
use crate::solve::{Plan, State, Unknown, UnknownKind};

use super::covariance::Covariance;
use super::span::{Span, sparse_basis};
use super::structure::{Cause, candidates, faces_flat_targets_only};

/// What a solve hands over to be judged.
#[derive(Clone, Copy, Debug)]
pub struct Evidence<'a> {
    /// The layout.
    pub layout: &'a Layout,
    /// Its frames.
    pub tree: &'a FrameTree,
    /// What was recorded.
    pub recording: &'a Recording,
    /// The compiled measurements.
    pub plan: &'a Plan,
    /// The values found.
    pub state: &'a State,
    /// `sensor_from_target` of every block at `state`, by group.
    pub poses: &'a [Vec<Pose>],
}

/// Something that the measurements do not determine, or only weakly.
#[derive(Clone, Debug, PartialEq)]
pub struct Undetermined {
    /// What kind of case it is.
    pub cause: Cause,
    /// The poses, links or lenses in it, strongest first.
    pub blocks: Vec<String>,
    /// The standard deviation along the direction, in mm and mrad mixed; none if nothing at all is known of it.
    pub sigma: Option<f64>,
    /// Why, in one sentence.
    pub reason: String,
    /// What would help.
    pub remedy: String,
}

/// A direction whose standard deviation exceeds this many units (5 mm, 5 mrad, 5 px) is determined, but weakly.
pub const WEAK: f64 = 5.0;
/// A block that carries less than this share of a direction is not named.
const NAMED: f64 = 0.02;
/// Turns smaller than this (rad, root mean square) are no turns.
const TURN: f64 = 0.02;

/// Puts every open direction and every frame that no measurement mentions into words, and after them the weak ones.
#[must_use]
pub fn explain(
    evidence: &Evidence<'_>,
    covariance: &Covariance,
    unseen: &[usize],
) -> (Vec<Undetermined>, Vec<Undetermined>) {
    let tree = evidence.tree;
    let mut open: Vec<Undetermined> = unseen
        .iter()
        .filter_map(|&frame| {
            let key = match tree.frames[frame].edge {
                Edge::Static(edge) => &tree.static_edges[edge].key,
                Edge::Moving(edge) => &tree.moving_edges[edge].key,
                Edge::Root | Edge::Link { .. } => return None,
            };
            Some(Undetermined {
                cause: Cause::Unseen,
                blocks: vec![key.clone()],
                sigma: None,
                reason: format!("no measurement sees `{}` or anything mounted on it", tree.frames[frame].name),
                remedy: "show it to a camera, or give its pose".to_owned(),
            })
        })
        .collect();
    open.extend(words(evidence, Span::new(&covariance.open, &covariance.open_sigma), false));
    let (vectors, sigmas) = covariance.weak();
    (open, words(evidence, Span::new(&vectors, &sigmas), true))
}

/// The directions of a space in words: first those that theory predicts, then the rest.
fn words(evidence: &Evidence<'_>, mut span: Span, weak: bool) -> Vec<Undetermined> {
    if span.is_empty() {
        return Vec::new();
    }
    let mut all = Vec::new();
    let mut tell = |direction: &[f64], sigma: f64, known: Option<(Cause, String, String)>| {
        let named = named_blocks(evidence.plan, direction);
        let parts: Vec<String> = named.iter().map(|block| describe(evidence.layout, block, direction)).collect();
        let (cause, why, remedy) = known.unwrap_or_else(|| cause(evidence, &named));
        let parts = parts.join(" against ");
        let reason = if weak {
            format!("{parts} is known to {sigma:.1} mm, mrad or px only: {why}")
        } else {
            format!("{parts} can change without any measurement noticing: {why}")
        };
        let blocks = named.iter().map(|block| block.name.clone()).collect();
        all.push(Undetermined { cause, blocks, sigma: sigma.is_finite().then_some(sigma), reason, remedy });
    };
    for candidate in candidates(evidence) {
        if let Some((direction, sigma)) = span.take(&candidate.direction) {
            tell(&direction, sigma, Some((candidate.cause, candidate.why, candidate.remedy)));
        }
    }
    // Weak directions differ in how weak they are, which singles their basis out already.
    let rest = if weak { span.vectors().to_vec() } else { sparse_basis(span.vectors()) };
    for direction in rest {
        tell(&direction, span.sigma(&direction), None);
    }
    all
}

/// The blocks that a direction moves, strongest first.
fn named_blocks<'a>(plan: &'a Plan, direction: &[f64]) -> Vec<&'a Unknown> {
    let share = |block: &Unknown| direction[block.start..block.start + block.count()].iter().map(|x| x * x).sum();
    let mut shares: Vec<(f64, &Unknown)> = plan.unknowns.blocks.iter().map(|block| (share(block), block)).collect();
    shares.sort_by(|a, b| b.0.total_cmp(&a.0));
    shares.into_iter().filter(|(share, _)| *share > NAMED).map(|(_, block)| block).collect()
}

/// `world_from_cam (x, turn about z)`: the components of a block that a direction moves.
fn describe(layout: &Layout, block: &Unknown, direction: &[f64]) -> String {
    let part = &direction[block.start..block.start + block.count()];
    let largest = part.iter().map(|x| x.abs()).fold(0.0, f64::max);
    let strong: Vec<usize> = (0..part.len()).filter(|i| part[*i].abs() > 0.3 * largest).collect();
    let names: Vec<String> = match &block.kind {
        UnknownKind::Edge(_) => {
            let axes = ["x", "y", "z", "turn about x", "turn about y", "turn about z"];
            strong.iter().map(|i| axes[*i].to_owned()).collect()
        }
        UnknownKind::Links { places, .. } => strong
            .iter()
            .map(|i| {
                let (link, kind) = (places[*i] / PARAMETERS_PER_LINK, places[*i] % PARAMETERS_PER_LINK);
                format!("joint {} {}", link + 1, ParameterKind::ALL[kind].name())
            })
            .collect(),
        UnknownKind::Lens { camera, places } => {
            let model = layout.cameras[*camera].intrinsics.as_ref().map(|intrinsics| intrinsics.model());
            let name = |place: usize| model.map_or("?", |model| model.parameter_name(place)).to_owned();
            strong.iter().map(|i| name(places[*i])).collect()
        }
    };
    format!("`{}` ({})", block.name, names.join(", "))
}

/// Why the named blocks cannot be told apart: what the robots between them did.
fn cause(evidence: &Evidence<'_>, named: &[&Unknown]) -> (Cause, String, String) {
    let (layout, plan) = (evidence.layout, evidence.plan);
    for block in named {
        if let UnknownKind::Lens { camera, .. } = block.kind
            && faces_flat_targets_only(evidence, camera)
        {
            return (
                Cause::FlatFaceOn,
                format!(
                    "`{}` sees flat targets face-on only, where a longer lens looks like a nearer target",
                    layout.cameras[camera].name
                ),
                "tilt the target or the camera by 20 to 45 degrees in several pictures, show a target with depth, or leave the lens \
                 out of `refine`"
                    .to_owned(),
            );
        }
    }
    if named.iter().any(|block| matches!(block.kind, UnknownKind::Links { .. })) {
        return (
            Cause::Other,
            "link parameters act like each other or like the poses beside them".to_owned(),
            "give the link parameters a `sigma`, fix one of the poses, or measure more varied joint values".to_owned(),
        );
    }
    let involved = |robot: usize| {
        plan.groups.iter().any(|group| {
            let walks = group.path.robots().any(|r| r == robot);
            let touches = group.path.steps.iter().any(|step| match step {
                Step::Static { edge, .. } => named.iter().any(|block| block.kind == UnknownKind::Edge(*edge)),
                _ => false,
            });
            walks && touches
        })
    };
    let motions: Vec<(&str, Vec<Pose>)> = (0..layout.robots.len())
        .filter(|&robot| involved(robot))
        .map(|robot| (layout.robots[robot].name.as_str(), flange_poses(evidence, robot)))
        .collect();
    // A robot that stands still (a torso that is parked) explains nothing while another moves.
    let moves = |poses: &[Pose]| poses.iter().any(|pose| (poses[0].inverse() * *pose).magnitude() > (1e-3, TURN));
    let any_moves = motions.iter().any(|(_, poses)| moves(poses));
    for (name, poses) in motions.iter().filter(|(_, poses)| !any_moves || moves(poses)) {
        let more =
            format!("turn `{name}` about at least two different axes by 30 degrees or more between configurations");
        if poses.len() < 3 {
            let plural = if poses.len() == 1 { "" } else { "s" };
            let why = format!("`{name}` was measured in only {} configuration{plural}", poses.len());
            return (Cause::TooFewConfigurations, why, format!("record at least 3, better 15, configurations; {more}"));
        }
        let turns = turns(poses);
        let scatter: Matrix3<f64> = turns.iter().map(|v| v * v.transpose()).sum::<Matrix3<f64>>() / turns.len() as f64;
        let mut spread: Vec<f64> = scatter.symmetric_eigenvalues().iter().map(|x| x.max(0.0).sqrt()).collect();
        spread.sort_by(|a, b| b.total_cmp(a));
        if spread[0] < TURN {
            return (
                Cause::ConstantOrientation,
                format!("the orientation of `{name}.flange` stays constant"),
                format!("{more}, or give what hangs on its flange a pose or a prior"),
            );
        }
        if spread[1] < TURN {
            return (
                Cause::SingleAxis,
                format!("all motions of `{name}` turn about one axis"),
                format!("{more}, or give what hangs on its flange a prior along that axis"),
            );
        }
    }
    (
        Cause::Other,
        "the measurements act on their sum only".to_owned(),
        "add configurations that are more different, another camera or target, or a prior (`sigma`) on one of them"
            .to_owned(),
    )
}

/// `base_from_flange` at every configuration with measurements across the robot.
fn flange_poses(evidence: &Evidence<'_>, robot: usize) -> Vec<Pose> {
    let (layout, recording, plan) = (evidence.layout, evidence.recording, evidence.plan);
    let used = configurations_across(plan, robot);
    used.into_iter().filter_map(|c| recording.base_from_flange(layout, robot, plan.configurations[c])).collect()
}

/// The configurations (of the plan) with measurements across a robot.
pub(super) fn configurations_across(plan: &Plan, robot: usize) -> BTreeSet<usize> {
    let groups = plan.groups.iter().filter(|group| group.path.robots().any(|r| r == robot));
    groups.flat_map(|group| group.blocks.iter().map(|block| block.configuration)).collect()
}

/// Rotation vectors against the mean orientation.
fn turns(poses: &[Pose]) -> Vec<Vector3<f64>> {
    let Some(first) = poses.first().map(|pose| pose.rotation) else { return Vec::new() };
    let mean = poses.iter().map(|pose| rotation::log(&(first.inverse() * pose.rotation))).sum::<Vector3<f64>>()
        / poses.len() as f64;
    let middle = first * rotation::exp(&mean);
    poses.iter().map(|pose| rotation::log(&(middle.inverse() * pose.rotation))).collect()
}
