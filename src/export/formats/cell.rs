//! The cell as a tree of joints, the form that all formats start from.

use nalgebra::Vector3;

use crate::frames::{Edge, FrameId, FrameTree, Step};
use crate::geometry::Pose;
use crate::layout::{Layout, Motion};
use crate::robot::{Chain, JointKind, LinkShape};

/// How a joint moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum JointMotion {
    /// Not at all.
    Fixed,
    /// It turns about an axis of the child.
    Revolute(Vector3<f64>),
    /// It slides along an axis of the child.
    Prismatic(Vector3<f64>),
    /// Freely: a flange known only by reported poses, a target that somebody waves.
    Floating,
}

/// A child on its parent.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// The parent's name.
    pub parent: String,
    /// The child's name.
    pub child: String,
    /// `parent_from_child` at joint value zero, metres.
    pub pose: Pose,
    /// How it moves.
    pub motion: JointMotion,
}

/// A layout whose poses are known, as joints.
#[derive(Debug)]
pub struct Cell<'a> {
    /// The layout.
    pub layout: &'a Layout,
    /// Its frames.
    pub tree: FrameTree,
    /// The name of each frame in other programs: without dots, no two alike; a camera's is its optical frame's.
    pub names: Vec<String>,
    /// Which frames hang on the world by known poses.
    placed: Vec<bool>,
}

/// From a camera's body as ROS has it (x forward, y left, z up; REP 103) to its optical frame (x right, y down, z forward).
pub(super) fn body_from_optical() -> Pose {
    let half = std::f64::consts::FRAC_PI_2;
    Pose { rotation: crate::geometry::rotation::from_rpy([-half, 0.0, -half]), ..Pose::identity() }
}

impl<'a> Cell<'a> {
    /// The cell of a layout; frames without a known pose are left out with all that hangs on them.
    #[must_use]
    pub fn new(layout: &'a Layout) -> Self {
        let tree = FrameTree::new(layout);
        let mut names: Vec<String> = Vec::new();
        let mut placed: Vec<bool> = Vec::new();
        for (frame, known) in tree.frames.iter().enumerate() {
            let suffix = if tree.cameras.contains(&frame) { "_optical_frame" } else { "" };
            let mut name = format!("{}{suffix}", known.name.replace('.', "_"));
            while names.contains(&name) {
                name.push('_');
            }
            names.push(name);
            let own = match known.edge {
                Edge::Static(edge) => tree.static_edges[edge].spec.pose().is_some(),
                Edge::Root | Edge::Moving(_) | Edge::Link { .. } => true,
            };
            placed.push(own && known.parent.is_none_or(|parent| placed[parent]));
        }
        Self { layout, tree, names, placed }
    }

    /// Sentences about the frames that have no pose.
    pub(super) fn left_out(&self) -> Vec<String> {
        let missing = (0..self.tree.frames.len()).filter(|frame| {
            let parent = self.tree.frames[*frame].parent.unwrap_or(0);
            !self.placed[*frame] && self.placed[parent]
        });
        missing
            .map(|frame| {
                format!("`{}` is left out with all that hangs on it: its pose is unknown", self.tree.frames[frame].name)
            })
            .collect()
    }

    /// Whether a frame has a pose.
    #[must_use]
    pub fn has(&self, frame: FrameId) -> bool {
        self.placed[frame]
    }

    /// The name of a camera's body, which ROS wants beside its optical frame.
    #[must_use]
    pub fn camera_body(&self, camera: usize) -> String {
        format!("{}_link", self.layout.cameras[camera].name)
    }

    /// `from_from_to` where everything between is known and stands still.
    #[must_use]
    pub fn between(&self, from: FrameId, to: FrameId) -> Option<Pose> {
        self.tree.path(from, to).steps.iter().try_fold(Pose::identity(), |pose, step| match *step {
            Step::Static { edge, inverse } => {
                let value = self.tree.static_edges[edge].spec.pose()?;
                Some(pose * if inverse { value.inverse() } else { value })
            }
            _ => None,
        })
    }

    /// Every frame on its parent, parents first; cameras have their optical frame on a body of their own.
    #[must_use]
    pub fn joints(&self) -> Vec<Joint> {
        let mut all = Vec::new();
        for (frame, known) in self.tree.frames.iter().enumerate() {
            let Some(parent) = known.parent.filter(|_| self.placed[frame]) else { continue };
            let (above, own) = (self.names[parent].clone(), self.names[frame].clone());
            match known.edge {
                Edge::Root => {}
                Edge::Moving(_) => {
                    let motion = JointMotion::Floating;
                    all.push(Joint { parent: above, child: own, pose: Pose::identity(), motion });
                }
                Edge::Static(edge) => {
                    let Some(pose) = self.tree.static_edges[edge].spec.pose() else { continue };
                    let motion = JointMotion::Fixed;
                    if let Some(camera) = self.tree.cameras.iter().position(|camera| *camera == frame) {
                        let body = self.camera_body(camera);
                        let turned = body_from_optical();
                        let parent_from_body = pose * turned.inverse();
                        all.push(Joint { parent: above, child: body.clone(), pose: parent_from_body, motion });
                        all.push(Joint { parent: body, child: own, pose: turned, motion });
                    } else {
                        all.push(Joint { parent: above, child: own, pose, motion });
                    }
                }
                Edge::Link { robot, place } => match &self.layout.robots[robot].motion {
                    Motion::Joints { chain, .. } => {
                        all.extend(link_joints(chain, &self.layout.robots[robot].corrections, place, above, own));
                    }
                    Motion::FlangePoses { .. } => {
                        let motion = JointMotion::Floating;
                        all.push(Joint { parent: above, child: own, pose: Pose::identity(), motion });
                    }
                },
            }
        }
        all
    }
}

/// The joint between two places of a chain, with the corrections built in. A classic DH link turns before its fixed part, so it needs a link between.
fn link_joints(chain: &Chain, corrections: &[f64], place: usize, parent: String, child: String) -> Vec<Joint> {
    let zeros = vec![0.0; chain.joint_count()];
    let whole = chain.segment(&zeros, corrections, place, place + 1);
    let Some(link) = chain.links.get(place) else {
        return vec![Joint { parent, child, pose: whole, motion: JointMotion::Fixed }];
    };
    let axis = match link.shape {
        LinkShape::Urdf { axis, .. } => axis,
        LinkShape::Mdh(_) | LinkShape::Dh(_) => Vector3::z(),
    };
    let motion = match link.joint {
        JointKind::Revolute => JointMotion::Revolute(axis),
        JointKind::Prismatic => JointMotion::Prismatic(axis),
    };
    if !matches!(link.shape, LinkShape::Dh(_)) {
        return vec![Joint { parent, child, pose: whole, motion }];
    }
    let before = if place == 0 { chain.base_from_first } else { Pose::identity() };
    let between = format!("{child}_axis");
    let after = before.inverse() * whole;
    vec![
        Joint { parent, child: between.clone(), pose: before, motion },
        Joint { parent: between, child, pose: after, motion: JointMotion::Fixed },
    ]
}
