//! A chain out of a URDF file: the path from one link to another, read by `urdf-rs`.

use nalgebra::Vector3;
use std::path::Path;
use thiserror::Error;

use super::chain::{Chain, JointKind, Link, LinkShape};
use crate::geometry::pose::Pose;
use crate::geometry::rotation;

/// Why a URDF does not give a chain.
#[derive(Debug, Error)]
pub enum UrdfError {
    /// The file cannot be read or is no URDF.
    #[error("the URDF cannot be read: {0}")]
    Unreadable(String),
    /// A link name that the file does not have.
    #[error("the URDF has no link `{name}`")]
    NoSuchLink {
        /// The name asked for.
        name: String,
        /// The links there are.
        links: Vec<String>,
    },
    /// The two links are not one above the other.
    #[error("`{tip}` does not hang below `{base}` in the URDF")]
    NotAChain {
        /// The upper link.
        base: String,
        /// The lower link.
        tip: String,
    },
    /// A joint that is no single axis.
    #[error("joint `{0}` is of a kind that has no single joint value")]
    UnsupportedJoint(String),
}

/// The chain from link `base` to link `tip` of the URDF at `path`. Fixed joints are merged into their neighbours.
///
/// # Errors
/// When the file is not a URDF, a link is missing, the links are not on one branch or a joint is neither fixed, revolute, continuous nor prismatic.
pub fn read_chain(path: &Path, base: &str, tip: &str) -> Result<Chain, UrdfError> {
    let text = std::fs::read_to_string(path).map_err(|e| UrdfError::Unreadable(e.to_string()))?;
    let robot = urdf_rs::read_from_string(&text).map_err(|e| UrdfError::Unreadable(e.to_string()))?;
    for name in [base, tip] {
        if !robot.links.iter().any(|link| link.name == name) {
            let links = robot.links.iter().map(|link| link.name.clone()).collect();
            return Err(UrdfError::NoSuchLink { name: name.to_owned(), links });
        }
    }
    let mut upwards = Vec::new();
    let mut at = tip.to_owned();
    while at != base {
        // A broken file could loop; no honest chain is longer than the number of joints.
        let joint = robot.joints.iter().find(|joint| joint.child.link == at);
        match joint {
            Some(joint) if upwards.len() < robot.joints.len() => {
                upwards.push(joint);
                at.clone_from(&joint.parent.link);
            }
            _ => return Err(UrdfError::NotAChain { base: base.to_owned(), tip: tip.to_owned() }),
        }
    }
    let mut links: Vec<Link> = Vec::new();
    let mut pending = Pose::identity();
    for joint in upwards.into_iter().rev() {
        let xyz = Vector3::from_column_slice(&joint.origin.xyz.0);
        let origin = Pose::new(rotation::from_rpy(joint.origin.rpy.0), xyz);
        let kind = match joint.joint_type {
            urdf_rs::JointType::Fixed => {
                pending = pending * origin;
                continue;
            }
            urdf_rs::JointType::Revolute | urdf_rs::JointType::Continuous => JointKind::Revolute,
            urdf_rs::JointType::Prismatic => JointKind::Prismatic,
            _ => return Err(UrdfError::UnsupportedJoint(joint.name.clone())),
        };
        let axis = Vector3::from_column_slice(&joint.axis.xyz.0);
        let Some(axis) = axis.try_normalize(1e-9) else {
            return Err(UrdfError::UnsupportedJoint(joint.name.clone()));
        };
        links.push(Link { shape: LinkShape::Urdf { origin: pending * origin, axis }, joint: kind });
        pending = Pose::identity();
    }
    Ok(Chain { base_from_first: Pose::identity(), links, last_from_flange: pending })
}

/// The robot's name, and the links between which most joints lie: where a robot description that nobody has explained most likely begins and
/// ends. Of equal branches the one that ends in `tool0`, `flange` or the like is taken.
///
/// # Errors
/// When the file is not a URDF or has no joint that moves.
pub fn longest_chain(path: &Path) -> Result<(String, String, String), UrdfError> {
    let text = std::fs::read_to_string(path).map_err(|e| UrdfError::Unreadable(e.to_string()))?;
    let robot = urdf_rs::read_from_string(&text).map_err(|e| UrdfError::Unreadable(e.to_string()))?;
    let mut best: Option<((usize, bool, usize), String, String)> = None;
    for link in &robot.links {
        let (mut moving, mut steps, mut base) = (0, 0, link.name.as_str());
        // From the first moving joint down, the chain's base is the link that this joint hangs on, or what is rigid with it above.
        while let Some(joint) = robot.joints.iter().find(|joint| joint.child.link == base) {
            if steps > robot.joints.len() {
                break;
            }
            moving += usize::from(joint.joint_type != urdf_rs::JointType::Fixed);
            steps += 1;
            base = &joint.parent.link;
        }
        let known = ["tool0", "flange", "ee_link", "tcp"].iter().any(|name| link.name.ends_with(name));
        let rank = (moving, known, usize::MAX - steps);
        if moving > 0 && best.as_ref().is_none_or(|(other, ..)| rank > *other) {
            best = Some((rank, base.to_owned(), link.name.clone()));
        }
    }
    match best {
        // A root called `world` is no part of the robot.
        Some((_, base, tip)) => {
            let below =
                robot.joints.iter().find(|j| j.parent.link == base && base == "world").map(|j| j.child.link.clone());
            Ok((robot.name.clone(), below.unwrap_or(base), tip))
        }
        None => Err(UrdfError::Unreadable("it has no joint that moves".to_owned())),
    }
}
