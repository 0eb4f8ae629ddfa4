//! The same fit with a true rotation: nine parameters.

use nalgebra::{SMatrix, SVector, Vector3};

use super::{MOST_STEPS, STEP, Sample, root_mean_square};
use crate::geometry::Pose;
use crate::geometry::rotation::{self, skew};

/// The result with a rotation in place of nine free entries.
#[derive(Clone, Debug, PartialEq)]
pub struct RigidIdentification {
    /// `world_from_base`.
    pub world_from_base: Pose,
    /// The tool point in the flange's frame, m.
    pub tool: Vector3<f64>,
    /// Steps taken.
    pub iterations: usize,
    /// Whether the last step met the stopping rule.
    pub converged: bool,
    /// Root mean square distance between measured and computed points, m.
    pub rms: f64,
}

/// Gauss-Newton on `world_from_base` and the tool point, from the rigid registration of the flange's own path. `None` if the measurements do not determine
/// a rotation (fewer than three, or all on a line).
#[must_use]
pub fn rigid(samples: &[Sample]) -> Option<RigidIdentification> {
    let mut found = RigidIdentification {
        world_from_base: registration(samples)?,
        tool: Vector3::zeros(),
        iterations: 0,
        converged: false,
        rms: f64::INFINITY,
    };
    let residual = |found: &RigidIdentification, s: &Sample| {
        s.world_point - found.world_from_base * (s.base_from_flange * found.tool)
    };
    while found.iterations < MOST_STEPS && !found.converged {
        let (mut hessian, mut gradient) = (SMatrix::<f64, 9, 9>::zeros(), SVector::<f64, 9>::zeros());
        let r = found.world_from_base.rotation_matrix();
        for s in samples {
            let in_base = s.base_from_flange * found.tool;
            let mut row = SMatrix::<f64, 3, 9>::zeros();
            row.fixed_view_mut::<3, 3>(0, 0).copy_from(&r);
            row.fixed_view_mut::<3, 3>(0, 3).copy_from(&(-r * skew(&in_base)));
            row.fixed_view_mut::<3, 3>(0, 6).copy_from(&(r * s.base_from_flange.rotation_matrix()));
            hessian += row.transpose() * row;
            gradient += row.transpose() * residual(&found, s);
        }
        let floor = hessian.diagonal().max() * 1e-12;
        let step = (hessian + SMatrix::identity() * floor).cholesky()?.solve(&gradient);
        found.world_from_base = found.world_from_base.retract(&step.fixed_rows::<6>(0).into_owned());
        found.tool += step.fixed_rows::<3>(6);
        found.iterations += 1;
        found.converged = step.iter().all(|d| d.abs() < STEP);
    }
    found.rms = root_mean_square(samples.iter().map(|s| residual(&found, s)));
    found.rms.is_finite().then_some(found)
}

/// The rigid motion that maps the flange's path onto the measured points best.
fn registration(samples: &[Sample]) -> Option<Pose> {
    if samples.len() < 3 {
        return None;
    }
    let count = samples.len() as f64;
    let from = samples.iter().map(|s| s.base_from_flange.translation).sum::<Vector3<f64>>() / count;
    let to = samples.iter().map(|s| s.world_point).sum::<Vector3<f64>>() / count;
    let cross = samples
        .iter()
        .map(|s| (s.world_point - to) * (s.base_from_flange.translation - from).transpose())
        .sum::<nalgebra::Matrix3<f64>>();
    let turn = rotation::nearest_rotation(&cross)?;
    Some(Pose::new(turn, to - turn * from))
}
