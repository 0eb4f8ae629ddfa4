//! The directions that theory predicts to be open, whatever the numbers are: each is built at the solved state and looked for in the data.
//!
//! | cause | why |
//! |---|---|
//! | base against first joint | what the first joint's parameters do to the flange is the same motion of the base at every configuration |
//! | tool against last joint | what the last joint's parameters do is the same motion in the flange's axes at every configuration |
//! | two parallel axes | two links' lengths do the same at every configuration |
//! | no scale | poses and points all grow together, and nothing that is measured has a known length |
//!
//! (For link parameters see L. Everett, M. Driels, B. Mooring, *Kinematic modelling for robot calibration*, ICRA 1987.) Single axes,
//! constant orientations and flat targets seen face-on are properties of the recording; they are recognised in what is left.

use nalgebra::Matrix6xX;

use super::undetermined::{Evidence, configurations_across};
use crate::frames::{Edge, FrameId, Freedom};
use crate::geometry::Pose;
use crate::geometry::pose::Twist;
use crate::layout::Motion;
use crate::recording::RobotMotion;
use crate::robot::{PARAMETERS_PER_LINK, ParameterKind};
use crate::solve::{GroupKind, UnknownKind};

/// Why a direction is open or weak.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// No measurement mentions it.
    Unseen,
    /// Fewer configurations than the geometry needs.
    TooFewConfigurations,
    /// A robot's flange never turned.
    ConstantOrientation,
    /// A robot turned about one axis only.
    SingleAxis,
    /// Link parameters of two parallel joint axes.
    ParallelAxes,
    /// A tool's pose and the parameters of the last joint.
    ToolAgainstLastJoint,
    /// A base's pose and the parameters of the first joint.
    BaseAgainstFirstJoint,
    /// Nothing of known length is measured.
    NoScale,
    /// A lens and the distance of flat targets that face it.
    FlatFaceOn,
    /// None of these.
    Other,
}

impl Cause {
    /// The word that files carry.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Unseen => "unseen",
            Self::TooFewConfigurations => "too_few_configurations",
            Self::ConstantOrientation => "constant_orientation",
            Self::SingleAxis => "single_axis",
            Self::ParallelAxes => "parallel_axes",
            Self::ToolAgainstLastJoint => "tool_against_last_joint",
            Self::BaseAgainstFirstJoint => "base_against_first_joint",
            Self::NoScale => "no_scale",
            Self::FlatFaceOn => "flat_face_on",
            Self::Other => "other",
        }
    }
}

/// A direction that may be open.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Candidate {
    pub(super) cause: Cause,
    /// Over the shared columns, in units.
    pub(super) direction: Vec<f64>,
    pub(super) why: String,
    pub(super) remedy: String,
}

/// Two motions that differ by less than this share are the same.
const ALIKE: f64 = 1e-3;
/// Configurations that a robot's motions are compared at, spread evenly.
const COMPARED: usize = 60;
/// A view whose points differ by less than this share in their depth is face-on.
const RELIEF: f64 = 0.05;

/// All directions that the cell's structure could leave open.
pub(super) fn candidates(evidence: &Evidence<'_>) -> Vec<Candidate> {
    let mut all: Vec<Candidate> = no_scale(evidence).into_iter().collect();
    for block in &evidence.plan.unknowns.blocks {
        if let UnknownKind::Links { robot, places, .. } = &block.kind {
            all.extend(links(evidence, *robot, places, block.start));
        }
    }
    all
}

/// Everything grows from the world's origin.
fn no_scale(evidence: &Evidence<'_>) -> Option<Candidate> {
    let plan = evidence.plan;
    let mut direction = vec![0.0; plan.unknowns.count];
    for block in &plan.unknowns.blocks {
        if let UnknownKind::Edge(edge) = block.kind {
            let pose = evidence.state.static_poses[edge];
            let grow = pose.rotation.inverse() * pose.translation;
            for i in 0..3 {
                direction[block.start + i] = grow[i] / block.units[i];
            }
        }
    }
    direction.iter().any(|x| *x != 0.0).then(|| Candidate {
        cause: Cause::NoScale,
        direction,
        why: "nothing that is measured has a known length, so the whole cell can grow or shrink".to_owned(),
        remedy: "show a target of known size, give the distance of two things (a pose or a prior with `sigma`), or measure across a \
                 robot that moves"
            .to_owned(),
    })
}

/// What a robot's link parameters do at its configurations.
struct LinkMotion {
    /// `base_from_flange`, and the twist of the flange per unit of each parameter.
    at: Vec<(Pose, Matrix6xX<f64>)>,
}

impl LinkMotion {
    fn new(evidence: &Evidence<'_>, robot: usize, places: &[usize]) -> Option<Self> {
        let Motion::Joints { chain, .. } = &evidence.layout.robots[robot].motion else { return None };
        let RobotMotion::Joints(values) = &evidence.recording.motions[robot] else { return None };
        let used = configurations_across(evidence.plan, robot);
        let corrections = &evidence.state.corrections[robot];
        let stride = used.len().div_ceil(COMPARED).max(1);
        let joints = used.into_iter().step_by(stride).filter_map(|c| values.get(&evidence.plan.configurations[c]));
        let at: Vec<_> =
            joints.map(|q| chain.segment_with_parameters(q, corrections, 0, chain.flange_place(), places)).collect();
        (at.len() > 1).then_some(Self { at })
    }

    /// The twist that `of` makes of each configuration, if it is the same everywhere.
    fn constant(&self, of: impl Fn(&Pose, &Matrix6xX<f64>) -> Twist) -> Option<Twist> {
        let all: Vec<Twist> = self.at.iter().map(|(pose, jacobian)| of(pose, jacobian)).collect();
        let first = *all.first()?;
        let same = |twist: &Twist| (twist - first).norm() <= ALIKE * first.norm();
        (first.norm() > 0.0 && all.iter().all(same)).then_some(first)
    }

    /// How many times parameter `a` moves the flange as `b` does, if it is the same everywhere.
    fn ratio(&self, a: usize, b: usize) -> Option<f64> {
        let sum = |i: usize, j: usize| self.at.iter().map(|(_, m)| m.column(i).dot(&m.column(j))).sum::<f64>();
        let (aa, ab, bb) = (sum(a, a), sum(a, b), sum(b, b));
        if aa <= 0.0 || bb <= 0.0 || aa * bb - ab * ab > ALIKE * ALIKE * aa * bb {
            return None;
        }
        Some(ab / bb)
    }
}

/// `d` and the like in words that a user of robots knows.
fn parameter(place: usize) -> String {
    let word = match ParameterKind::ALL[place % PARAMETERS_PER_LINK] {
        ParameterKind::JointOffset => "offset",
        ParameterKind::LengthD => "length d",
        ParameterKind::LengthA => "length a",
        ParameterKind::TwistAlpha => "twist alpha",
    };
    format!("joint {} {word}", place / PARAMETERS_PER_LINK + 1)
}

/// Link parameters that a pose, or another link, can take the place of.
fn links(evidence: &Evidence<'_>, robot: usize, places: &[usize], start: usize) -> Vec<Candidate> {
    let Some(motion) = LinkMotion::new(evidence, robot, places) else { return Vec::new() };
    let name = &evidence.layout.robots[robot].name;
    let frames = &evidence.tree.robots[robot];
    let (base, flange) = (frames[0], frames[frames.len() - 1]);
    let units = evidence.plan.unknowns.units();
    let empty = || vec![0.0; evidence.plan.unknowns.count];
    let mut all = Vec::new();
    for i in 0..places.len() {
        for j in i + 1..places.len() {
            let Some(ratio) = motion.ratio(i, j) else { continue };
            let mut direction = empty();
            direction[start + i] = 1.0 / units[start + i];
            direction[start + j] = -ratio / units[start + j];
            let axes = [places[i], places[j]].map(|place| place / PARAMETERS_PER_LINK + 1);
            all.push(Candidate {
                cause: Cause::ParallelAxes,
                direction,
                why: format!(
                    "joints {} and {} of `{name}` turn about parallel axes, where {} and {} do the same",
                    axes[0],
                    axes[1],
                    parameter(places[i]),
                    parameter(places[j])
                ),
                remedy: "give the link parameters a `sigma`: no motion and no camera can tell the two apart, and no result depends on it"
                    .to_owned(),
            });
        }
    }
    for (i, &place) in places.iter().enumerate() {
        let column = |direction: &mut Vec<f64>| direction[start + i] = 1.0 / units[start + i];
        if let Some(twist) = motion.constant(|pose, jacobian| pose.adjoint() * jacobian.column(i)) {
            let mut direction = empty();
            column(&mut direction);
            if compensate_base(evidence, base, &twist, &mut direction) {
                all.push(Candidate {
                    cause: Cause::BaseAgainstFirstJoint,
                    direction,
                    why: format!("`{name}.base` moves against {} of `{name}` as one", parameter(place)),
                    remedy: format!(
                        "fix `{name}.base` or give it a prior (`pose` with `sigma`), give the link parameters a `sigma`, or measure its \
                         base by itself (a tracker, or a target mounted on `{name}.base`)"
                    ),
                });
            }
        }
        if let Some(twist) = motion.constant(|_, jacobian| jacobian.column(i).into_owned()) {
            let mut direction = empty();
            column(&mut direction);
            if compensate_below(evidence, flange, &Pose::identity(), &-twist, &mut direction) {
                all.push(Candidate {
                    cause: Cause::ToolAgainstLastJoint,
                    direction,
                    why: format!(
                        "what hangs on `{name}.flange` moves against {} of `{name}` as one",
                        parameter(place)
                    ),
                    remedy: format!(
                        "fix the pose of what hangs on `{name}.flange` or give it a prior (`pose` with `sigma`), or give the link \
                         parameters a `sigma`"
                    ),
                });
            }
        }
    }
    all
}

/// Undoes a `twist` of the flange, seen from the base: by the base's own pose, or where that is given by everything else on the world.
fn compensate_base(evidence: &Evidence<'_>, base: FrameId, twist: &Twist, direction: &mut [f64]) -> bool {
    let Edge::Static(edge) = evidence.tree.frames[base].edge else { return false };
    if let Some(block) = evidence.plan.unknowns.edge(edge) {
        put(evidence, block, &-twist, direction);
        return true;
    }
    let Some(parent) = evidence.tree.frames[base].parent else { return false };
    let base_from_parent = evidence.state.static_poses[edge].inverse();
    let others = children(evidence, parent).filter(|child| *child != base);
    let mut any = false;
    for child in others.collect::<Vec<_>>() {
        any |= compensate(evidence, child, &base_from_parent, twist, direction);
    }
    any
}

/// Moves everything found that hangs on `frame` by `twist`, which is told in the axes that `reference_from_frame` leads to.
fn compensate_below(
    evidence: &Evidence<'_>,
    frame: FrameId,
    reference_from_frame: &Pose,
    twist: &Twist,
    direction: &mut [f64],
) -> bool {
    let mut any = false;
    for child in children(evidence, frame).collect::<Vec<_>>() {
        any |= compensate(evidence, child, reference_from_frame, twist, direction);
    }
    any
}

fn compensate(
    evidence: &Evidence<'_>,
    child: FrameId,
    reference_from_parent: &Pose,
    twist: &Twist,
    direction: &mut [f64],
) -> bool {
    let Edge::Static(edge) = evidence.tree.frames[child].edge else { return false };
    let reference_from_child = *reference_from_parent * evidence.state.static_poses[edge];
    match evidence.plan.unknowns.edge(edge) {
        Some(block) => {
            put(evidence, block, &(reference_from_child.inverse_adjoint() * twist), direction);
            true
        }
        None => compensate_below(evidence, child, &reference_from_child, twist, direction),
    }
}

fn children<'a>(evidence: &Evidence<'a>, frame: FrameId) -> impl Iterator<Item = FrameId> + 'a {
    let frames = &evidence.tree.frames;
    (0..frames.len()).filter(move |child| frames[*child].parent == Some(frame))
}

fn put(evidence: &Evidence<'_>, block: usize, twist: &Twist, direction: &mut [f64]) {
    let block = &evidence.plan.unknowns.blocks[block];
    let UnknownKind::Edge(edge) = block.kind else { return };
    for i in 0..evidence.tree.static_edges[edge].freedom.count().min(Freedom::Pose.count()) {
        direction[block.start + i] = twist[i] / block.units[i];
    }
}

/// Whether a camera has seen nothing but flat views: in the middle one its points hardly differ in depth.
pub(super) fn faces_flat_targets_only(evidence: &Evidence<'_>, wanted: usize) -> bool {
    let mut reliefs = Vec::new();
    for (group, poses) in evidence.plan.groups.iter().zip(evidence.poses) {
        if group.kind != (GroupKind::Corners { camera: wanted }) {
            continue;
        }
        for (block, pose) in group.blocks.iter().zip(poses) {
            let place = |i: usize| nalgebra::Vector3::from(evidence.plan.measurements.place(i));
            let depths = (block.start..block.end).map(|i| (*pose * place(i)).z);
            let (low, high) = depths.fold((f64::MAX, f64::MIN), |(low, high), z| (low.min(z), high.max(z)));
            reliefs.push((high - low) / (0.5 * (high + low)).abs().max(f64::MIN_POSITIVE));
        }
    }
    let middle = reliefs.len() / 2;
    !reliefs.is_empty() && *reliefs.select_nth_unstable_by(middle, f64::total_cmp).1 < RELIEF
}
