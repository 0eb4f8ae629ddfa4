//! A serial chain of links and its derivatives.
//!
//! | convention | `parent_from_child` |
//! |---|---|
//! | modified DH (Craig; eq. 3 of the paper) | `Rx(alpha) Tx(a) Rz(theta + q) Tz(d)` |
//! | classic DH | `Rz(theta + q) Tz(d) Tx(a) Rx(alpha)` |
//! | URDF | `origin * Exp(axis q)` |
//!
//! A prismatic joint adds `q` to `d` instead of `theta` (URDF: along the axis).

use nalgebra::{Matrix6xX, Vector3};

use crate::geometry::pose::{Pose, Twist, join};

/// Corrections per link, in this order: joint offset (rad or m), then the three of [`ParameterKind`] lengths and twist.
pub const PARAMETERS_PER_LINK: usize = 4;

/// How a joint moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointKind {
    /// Turns; joint values in radians.
    Revolute,
    /// Slides; joint values in metres.
    Prismatic,
}

/// What one of a link's corrections changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum ParameterKind {
    /// Added to the joint value.
    JointOffset,
    /// Added to `d` (URDF: the origin's z).
    LengthD,
    /// Added to `a` (URDF: the origin's x).
    LengthA,
    /// Added to `alpha` (URDF: a turn about the origin's x).
    TwistAlpha,
}

impl ParameterKind {
    /// The four kinds in the order in which a link stores them.
    pub const ALL: [Self; PARAMETERS_PER_LINK] = [Self::JointOffset, Self::LengthD, Self::LengthA, Self::TwistAlpha];

    /// A short name for reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::JointOffset => "offset",
            Self::LengthD => "d",
            Self::LengthA => "a",
            Self::TwistAlpha => "alpha",
        }
    }

    /// Whether the correction is an angle (rad) rather than a length (m), for a joint of the given kind.
    #[must_use]
    pub fn is_angle(self, joint: JointKind) -> bool {
        match self {
            Self::JointOffset => joint == JointKind::Revolute,
            Self::TwistAlpha => true,
            Self::LengthD | Self::LengthA => false,
        }
    }
}

/// The nominal transform of a link.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LinkShape {
    /// Modified Denavit-Hartenberg after Craig: alpha, a, theta, d (rad, m).
    Mdh([f64; 4]),
    /// Classic Denavit-Hartenberg: alpha, a, theta, d (rad, m).
    Dh([f64; 4]),
    /// URDF: the joint's origin and its axis (unit vector in the child's frame).
    Urdf {
        /// `parent_from_child` at joint value zero.
        origin: Pose,
        /// The joint's axis.
        axis: Vector3<f64>,
    },
}

/// One link: its shape and the joint that moves it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Link {
    /// The nominal transform.
    pub shape: LinkShape,
    /// Revolute or prismatic.
    pub joint: JointKind,
}

/// A link's transform with the places where its corrections act.
struct Split {
    /// `parent_from_spot` for each of [`ParameterKind::ALL`]: the frame in which that correction is a constant twist.
    spots: [Pose; PARAMETERS_PER_LINK],
    /// `parent_from_child`.
    whole: Pose,
}

fn rot_x(angle: f64) -> Pose {
    Pose::from_rotation_vector(&Vector3::new(angle, 0.0, 0.0))
}

fn rot_z(angle: f64) -> Pose {
    Pose::from_rotation_vector(&Vector3::new(0.0, 0.0, angle))
}

impl Link {
    fn split(&self, joint_value: f64, correction: &[f64]) -> Split {
        let c = |kind: usize| correction.get(kind).copied().unwrap_or(0.0);
        let q = joint_value + c(0);
        let (turn, slide) = match self.joint {
            JointKind::Revolute => (q, 0.0),
            JointKind::Prismatic => (0.0, q),
        };
        match self.shape {
            LinkShape::Mdh([alpha, a, theta, d]) => {
                let at_twist = rot_x(alpha + c(3)) * Pose::from_translation(a + c(2), 0.0, 0.0);
                let whole = at_twist * rot_z(theta + turn) * Pose::from_translation(0.0, 0.0, d + c(1) + slide);
                Split { spots: [whole, whole, at_twist, at_twist], whole }
            }
            LinkShape::Dh([alpha, a, theta, d]) => {
                let at_joint = rot_z(theta + turn) * Pose::from_translation(0.0, 0.0, d + c(1) + slide);
                let whole = at_joint * Pose::from_translation(a + c(2), 0.0, 0.0) * rot_x(alpha + c(3));
                Split { spots: [at_joint, at_joint, whole, whole], whole }
            }
            LinkShape::Urdf { origin, axis } => {
                let at_length = origin * Pose::from_translation(0.0, 0.0, c(1));
                let at_twist = at_length * rot_x(c(3)) * Pose::from_translation(c(2), 0.0, 0.0);
                let moved = Pose::from_rotation_vector(&(axis * turn)) * Pose::new(Default::default(), axis * slide);
                let whole = at_twist * moved;
                Split { spots: [whole, at_length, at_twist, at_twist], whole }
            }
        }
    }

    /// The twist, in the frame of its spot, that a unit of correction `kind` causes.
    fn generator(&self, kind: usize) -> Twist {
        let zero = Vector3::zeros();
        let axis = match self.shape {
            LinkShape::Urdf { axis, .. } => axis,
            LinkShape::Mdh(_) | LinkShape::Dh(_) => Vector3::z(),
        };
        match (kind, self.joint) {
            (0, JointKind::Revolute) => join(&zero, &axis),
            (0, JointKind::Prismatic) => join(&axis, &zero),
            (1, _) => join(&Vector3::z(), &zero),
            (2, _) => join(&Vector3::x(), &zero),
            _ => join(&zero, &Vector3::x()),
        }
    }
}

/// A robot's kinematics: base to flange through its links.
#[derive(Clone, Debug, PartialEq)]
pub struct Chain {
    /// The robot's base from the frame in which the first link starts.
    pub base_from_first: Pose,
    /// The links in order.
    pub links: Vec<Link>,
    /// The flange in the last link's frame.
    pub last_from_flange: Pose,
}

impl Chain {
    /// The number of joints.
    #[must_use]
    pub fn joint_count(&self) -> usize {
        self.links.len()
    }

    /// The frames a chain names, counted along it: place 0 is the base, place `i` is after link `i`, place `n + 1` is the flange.
    #[must_use]
    pub fn flange_place(&self) -> usize {
        self.links.len() + 1
    }

    /// `from_from_to` between two places of the chain (`from <= to`; see [`Chain::flange_place`]).
    ///
    /// `joints` are the joint values (rad, m), `corrections` the link parameters ([`PARAMETERS_PER_LINK`] a link, or empty for nominal).
    #[must_use]
    pub fn segment(&self, joints: &[f64], corrections: &[f64], from: usize, to: usize) -> Pose {
        let mut pose = Pose::identity();
        for place in from..to {
            pose = pose * self.step(joints, corrections, place).whole;
        }
        pose
    }

    /// `base_from_flange` at the given joint values with nominal links.
    #[must_use]
    pub fn base_from_flange(&self, joints: &[f64]) -> Pose {
        self.segment(joints, &[], 0, self.flange_place())
    }

    /// The part of the chain between `place` and `place + 1`.
    fn step(&self, joints: &[f64], corrections: &[f64], place: usize) -> Split {
        if place >= self.links.len() {
            return Split { spots: [self.last_from_flange; PARAMETERS_PER_LINK], whole: self.last_from_flange };
        }
        let own = corrections.get(place * PARAMETERS_PER_LINK..(place + 1) * PARAMETERS_PER_LINK).unwrap_or(&[]);
        let mut split = self.links[place].split(joints[place], own);
        if place == 0 {
            split.spots = split.spots.map(|spot| self.base_from_first * spot);
            split.whole = self.base_from_first * split.whole;
        }
        split
    }

    /// The segment and how each link parameter moves it: column `k` is the twist of `from_from_to`, perturbed on the right, per unit of
    /// parameter `wanted[k]` (numbered `link * PARAMETERS_PER_LINK + kind`). Parameters of links outside the segment have zero columns.
    #[must_use]
    pub fn segment_with_parameters(
        &self,
        joints: &[f64],
        corrections: &[f64],
        from: usize,
        to: usize,
        wanted: &[usize],
    ) -> (Pose, Matrix6xX<f64>) {
        let mut jacobian = Matrix6xX::zeros(wanted.len());
        let mut columns = vec![[0.0; 6]; wanted.len()];
        let whole = self.differentiate_segment(joints, corrections, from, to, wanted, &mut columns);
        for (mut column, values) in jacobian.column_iter_mut().zip(&columns) {
            column.copy_from_slice(values);
        }
        (whole, jacobian)
    }

    /// As [`Chain::segment_with_parameters`], into columns that are there already: `columns[k]` belongs to `wanted[k]`.
    pub fn differentiate_segment(
        &self,
        joints: &[f64],
        corrections: &[f64],
        from: usize,
        to: usize,
        wanted: &[usize],
        columns: &mut [[f64; 6]],
    ) -> Pose {
        let whole = self.segment(joints, corrections, from, to);
        columns.fill([0.0; 6]);
        let mut before = whole.inverse();
        for place in from..to {
            let step = self.step(joints, corrections, place);
            for (column, &parameter) in columns.iter_mut().zip(wanted) {
                if parameter / PARAMETERS_PER_LINK != place || place >= self.links.len() {
                    continue;
                }
                let kind = parameter % PARAMETERS_PER_LINK;
                let twist = self.links[place].generator(kind);
                *column = ((before * step.spots[kind]).adjoint() * twist).into();
            }
            before = before * step.whole;
        }
        whole
    }

    /// The joint Jacobian of `base_from_flange`, a twist in the flange's frame per unit of each joint value: 6 x joints.
    #[must_use]
    pub fn joint_jacobian(&self, joints: &[f64]) -> Matrix6xX<f64> {
        let wanted: Vec<usize> = (0..self.links.len()).map(|link| link * PARAMETERS_PER_LINK).collect();
        self.segment_with_parameters(joints, &[], 0, self.flange_place(), &wanted).1
    }

    /// The longest distance (m) that the chain can bridge if fully stretched: a bound for plausibility checks.
    #[must_use]
    pub fn reach(&self) -> f64 {
        let links = self.links.iter().map(|link| match link.shape {
            LinkShape::Mdh([_, a, _, d]) | LinkShape::Dh([_, a, _, d]) => a.hypot(d),
            LinkShape::Urdf { origin, .. } => origin.translation.norm(),
        });
        links.sum::<f64>() + self.base_from_first.translation.norm() + self.last_from_flange.translation.norm()
    }
}
