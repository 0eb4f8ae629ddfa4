//! Rigid transforms, lenses and the shapes of targets, each with its derivatives.
//!
//! This folder knows nothing of robots, files or solvers. Two choices made here run through the whole
//! crate: transforms are perturbed **on the right**, `a_from_b * Exp(d)` with `d = (translation, rotation)`,
//! so a perturbation always speaks in the child's own axes; and pixels have their origin at the **centre** of
//! the top-left pixel, as in OpenCV.

pub mod dictionary;
pub mod intrinsics;
pub mod lens;
pub mod pattern;
pub mod pose;
pub mod rotation;
pub mod target;

pub use intrinsics::{Intrinsics, IntrinsicsError, UndistortError};
pub use lens::LensModel;
pub use pattern::Pattern;
pub use pose::{Pose, Twist};
pub use target::{Feature, TagFace, TargetGeometry};
