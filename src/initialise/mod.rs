//! Starting values without a guess from the user.
//!
//! Every picture of a target gives candidate poses ([`pose_from_points`]: both solutions for a flat target, every numbering that a
//! checkerboard's symmetry allows). What is known then grows from the world ([`grow`]): an edge whose path is otherwise known is placed by the
//! candidates' consensus, a robot between two unknown edges by closed-form robot-world/hand-eye calibration ([`hand_eye`]), a tracker by
//! registering points ([`register`]); always the step with the most observations first. Consensus also decides between candidates, so flips
//! and half turns are resolved by the robot's motion and by other pictures, never guessed.

mod consensus;
mod grow;
mod grow_points;
mod hand_eye;
mod moving;
mod observe;
mod planar;
mod pose_from_points;
mod register;
mod robust_pose;

pub use grow::{InitialiseError, Start, initialise};
pub use hand_eye::{HandEye, solve_hand_eye};
pub use pose_from_points::{PoseCandidate, poses_from_points};
