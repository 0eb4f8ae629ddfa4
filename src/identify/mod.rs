//! The published method: base and tool of one robot from measured points, by an iterated Jacobian.
//!
//! D. Huczala et al., *Camera-Based Method for Identification of the Layout of a Robotic Workcell*, Appl. Sci. 10(21):7679, 2020. Fifteen numbers: the
//! upper three rows of `world_from_base` (the 3 x 3 entries free, **not** a rotation) and the tool point in the flange's frame. Because the nine entries are
//! free, they absorb an error of scale in the measurements, and the residual looks better than any real robot could. Beside it therefore stands the same
//! fit with a true rotation ([`rigid`]).

mod free;
mod rigid;

pub use free::{FreeIdentification, free};
pub use rigid::{RigidIdentification, rigid};

use nalgebra::Vector3;

use crate::geometry::Pose;

/// One measurement: where the flange was in the base's frame, and where the tool point was in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// `base_from_flange`.
    pub base_from_flange: Pose,
    /// The tool point in the world, m.
    pub world_point: Vector3<f64>,
}

/// Both searches stop when every component of a step is below this (m, or the dimensionless entries of the matrix): the paper's rule.
pub const STEP: f64 = 1e-6;
/// Steps at most; the published recordings need four or five.
pub const MOST_STEPS: usize = 100;

/// Root mean square distance (m) between measured and computed points.
fn root_mean_square(residuals: impl Iterator<Item = Vector3<f64>>) -> f64 {
    let (sum, count) = residuals.fold((0.0, 0), |(sum, count), r| (sum + r.norm_squared(), count + 1));
    if count == 0 { 0.0 } else { (sum / f64::from(count)).sqrt() }
}
