//! Robots as kinematic chains: forward kinematics, link parameters and their Jacobians.
//!
//! Three descriptions come in (modified DH after Craig, classic DH, URDF) and one goes out: a [`Chain`] of links, each
//! with a nominal transform, a joint and four small corrections that can be identified. This folder knows nothing of files that
//! list joint values; it knows the file that describes a robot only through `layout`.

pub mod chain;
pub mod urdf;

pub use chain::{Chain, JointKind, Link, LinkShape, PARAMETERS_PER_LINK, ParameterKind};
