//! Undetermined directions in words: what moves against what, why, and what would help.

use nalgebra::{Matrix3, Vector3};
use std::collections::BTreeSet;

use crate::frames::{Edge, FrameTree, Step};
use crate::geometry::{Pose, rotation};
use crate::layout::Layout;
use crate::recording::Recording;
use crate::robot::{PARAMETERS_PER_LINK, ParameterKind};
use crate::solve::{Plan, Unknown, UnknownKind};

use super::covariance::Covariance;

/// Something that the measurements do not determine.
#[derive(Clone, Debug, PartialEq)]
pub struct Undetermined {
    /// The poses, links or lenses in it, strongest first.
    pub blocks: Vec<String>,
    /// The standard deviation along the direction, in mm and mrad mixed; none if nothing at all is known of it.
    pub sigma: Option<f64>,
    /// Why, in one sentence.
    pub reason: String,
    /// What would help.
    pub remedy: String,
}

/// A block that carries less than this share of a direction is not named.
const NAMED: f64 = 0.02;
/// Turns smaller than this (rad, root mean square) are no turns.
const TURN: f64 = 0.02;

/// Puts every open direction and every frame that no measurement mentions into words.
#[must_use]
pub fn explain(
    layout: &Layout,
    tree: &FrameTree,
    recording: &Recording,
    plan: &Plan,
    covariance: &Covariance,
    unseen: &[usize],
) -> Vec<Undetermined> {
    let mut all: Vec<Undetermined> = unseen
        .iter()
        .filter_map(|&frame| {
            let key = match tree.frames[frame].edge {
                Edge::Static(edge) => &tree.static_edges[edge].key,
                Edge::Moving(edge) => &tree.moving_edges[edge].key,
                Edge::Root | Edge::Link { .. } => return None,
            };
            Some(Undetermined {
                blocks: vec![key.clone()],
                sigma: None,
                reason: format!("no measurement sees `{}` or anything mounted on it", tree.frames[frame].name),
                remedy: "show it to a camera, or give its pose".to_owned(),
            })
        })
        .collect();
    for (direction, sigma) in covariance.open.iter().zip(&covariance.open_sigma) {
        let mut shares: Vec<(f64, &Unknown)> = plan
            .unknowns
            .blocks
            .iter()
            .map(|block| (direction[block.start..block.start + block.count()].iter().map(|x| x * x).sum(), block))
            .collect();
        shares.sort_by(|a, b| b.0.total_cmp(&a.0));
        let named: Vec<&Unknown> = shares.iter().filter(|(share, _)| *share > NAMED).map(|(_, block)| *block).collect();
        let parts: Vec<String> = named.iter().map(|block| describe(layout, block, direction)).collect();
        let (why, remedy) = cause(layout, recording, plan, &named);
        all.push(Undetermined {
            blocks: named.iter().map(|block| block.name.clone()).collect(),
            sigma: sigma.is_finite().then_some(*sigma),
            reason: format!("{} can change without any measurement noticing: {why}", parts.join(" against ")),
            remedy,
        });
    }
    all
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
fn cause(layout: &Layout, recording: &Recording, plan: &Plan, named: &[&Unknown]) -> (String, String) {
    if named.iter().any(|block| matches!(block.kind, UnknownKind::Links { .. })) {
        return (
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
        .map(|robot| (layout.robots[robot].name.as_str(), flange_poses(layout, recording, plan, robot)))
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
            return (why, format!("record at least 3, better 15, configurations; {more}"));
        }
        let turns = turns(poses);
        let scatter: Matrix3<f64> = turns.iter().map(|v| v * v.transpose()).sum::<Matrix3<f64>>() / turns.len() as f64;
        let mut spread: Vec<f64> = scatter.symmetric_eigenvalues().iter().map(|x| x.max(0.0).sqrt()).collect();
        spread.sort_by(|a, b| b.total_cmp(a));
        if spread[0] < TURN {
            return (format!("the orientation of `{name}.flange` stays constant"), more);
        }
        if spread[1] < TURN {
            return (format!("all motions of `{name}` turn about one axis"), more);
        }
    }
    (
        "the measurements act on their sum only".to_owned(),
        "add configurations that are more different, another camera or target, or a prior (`sigma`) on one of them"
            .to_owned(),
    )
}

/// `base_from_flange` at every configuration with measurements across the robot.
fn flange_poses(layout: &Layout, recording: &Recording, plan: &Plan, robot: usize) -> Vec<Pose> {
    let groups = plan.groups.iter().filter(|group| group.path.robots().any(|r| r == robot));
    let used: BTreeSet<usize> = groups.flat_map(|group| group.blocks.iter().map(|block| block.configuration)).collect();
    used.into_iter().filter_map(|c| recording.base_from_flange(layout, robot, plan.configurations[c])).collect()
}

/// Rotation vectors against the mean orientation.
fn turns(poses: &[Pose]) -> Vec<Vector3<f64>> {
    let Some(first) = poses.first().map(|pose| pose.rotation) else { return Vec::new() };
    let mean = poses.iter().map(|pose| rotation::log(&(first.inverse() * pose.rotation))).sum::<Vector3<f64>>()
        / poses.len() as f64;
    let middle = first * rotation::exp(&mean);
    poses.iter().map(|pose| rotation::log(&(middle.inverse() * pose.rotation))).collect()
}
