//! Undetermined directions in words: what moves against what, why, and what would help.

use crate::frames::{Edge, FrameTree, Freedom, Step};
use crate::geometry::rotation;
use crate::layout::{Layout, Motion};
use crate::recording::{Recording, RobotMotion};
use crate::robot::{PARAMETERS_PER_LINK, ParameterKind};
use crate::solve::{Plan, Unknown, UnknownKind};
use nalgebra::{Matrix3, Vector3};

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
        .filter_map(|&frame| match tree.frames[frame].edge {
            Edge::Static(edge) => Some(Undetermined {
                blocks: vec![tree.static_edges[edge].key.clone()],
                sigma: None,
                reason: format!("no measurement sees `{}` or anything mounted on it", tree.frames[frame].name),
                remedy: "show it to a camera, or give its pose".to_owned(),
            }),
            _ => None,
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
        let parts: Vec<String> = named.iter().map(|block| describe(layout, tree, block, direction)).collect();
        let (why, remedy) = cause(layout, tree, recording, plan, &named);
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
fn describe(layout: &Layout, tree: &FrameTree, block: &Unknown, direction: &[f64]) -> String {
    let part = &direction[block.start..block.start + block.count()];
    let largest = part.iter().map(|x| x.abs()).fold(0.0, f64::max);
    let strong: Vec<usize> = (0..part.len()).filter(|i| part[*i].abs() > 0.3 * largest).collect();
    let names: Vec<String> = match &block.kind {
        UnknownKind::Edge(edge) => {
            let axes = ["x", "y", "z", "turn about x", "turn about y", "turn about z"];
            let _ = tree.static_edges[*edge].freedom == Freedom::Translation;
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
fn cause(layout: &Layout, tree: &FrameTree, recording: &Recording, plan: &Plan, named: &[&Unknown]) -> (String, String) {
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
    for robot in (0..layout.robots.len()).filter(|&robot| involved(robot)) {
        let name = &layout.robots[robot].name;
        let turns = flange_turns(layout, recording, plan, robot);
        let more = format!("turn `{name}` about at least two different axes by 30 degrees or more between configurations");
        if turns.len() < 3 {
            let why = format!("`{name}` stood in only {} configuration{}", turns.len(), if turns.len() == 1 { "" } else { "s" });
            return (why, format!("record at least 3, better 15, configurations; {more}"));
        }
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
    let _ = tree;
    (
        "the measurements act on their sum only".to_owned(),
        "add configurations that are more different, another camera or target, or a prior (`sigma`) on one of them".to_owned(),
    )
}

/// Rotation vectors of a robot's flange against its mean orientation, over the configurations with measurements across it.
fn flange_turns(layout: &Layout, recording: &Recording, plan: &Plan, robot: usize) -> Vec<Vector3<f64>> {
    let mut used: Vec<u64> = plan
        .groups
        .iter()
        .filter(|group| group.path.robots().any(|r| r == robot))
        .flat_map(|group| group.blocks.iter().map(|block| plan.configurations[block.configuration]))
        .collect();
    used.sort_unstable();
    used.dedup();
    let flange = |configuration: &u64| match (&recording.motions[robot], &layout.robots[robot].motion) {
        (RobotMotion::Joints(values), Motion::Joints { chain, .. }) => {
            values.get(configuration).map(|joints| chain.base_from_flange(joints).rotation)
        }
        (RobotMotion::Flange(poses), _) => poses.get(configuration).map(|pose| pose.rotation),
        _ => None,
    };
    let rotations: Vec<_> = used.iter().filter_map(flange).collect();
    let Some(first) = rotations.first() else { return Vec::new() };
    let mean = rotations.iter().map(|r| rotation::log(&(first.inverse() * r))).sum::<Vector3<f64>>() / rotations.len() as f64;
    let middle = first * rotation::exp(&mean);
    rotations.iter().map(|r| rotation::log(&(middle.inverse() * r))).collect()
}
