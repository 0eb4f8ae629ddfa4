//! Fifteen parameters, as published.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

use super::{MOST_STEPS, STEP, Sample, root_mean_square};

/// The result of the published method.
#[derive(Clone, Debug, PartialEq)]
pub struct FreeIdentification {
    /// The base's origin in the world, m: the paper's x0, y0, z0.
    pub origin: Vector3<f64>,
    /// The 3 x 3 entries of `world_from_base`: the paper's r11..r33. Not a rotation.
    pub matrix: Matrix3<f64>,
    /// The tool point in the flange's frame, m: the paper's xe, ye, ze.
    pub tool: Vector3<f64>,
    /// Steps taken.
    pub iterations: usize,
    /// Whether the last step met the stopping rule.
    pub converged: bool,
    /// Root mean square distance between measured and computed points, m.
    pub rms: f64,
    /// The condition number of the last Jacobian; infinite if the parameters are not determined.
    pub condition: f64,
}

/// The published method: Gauss-Newton with the Jacobian of `p = R (R_i e + t_i) + x0` to `x0`, the nine entries of `R`, and `e`, from the identity.
/// `None` for fewer than five measurements (fifteen equations).
///
/// Each step is the least-squares solution by singular values, so that undetermined parameters do not run away.
#[must_use]
pub fn free(samples: &[Sample]) -> Option<FreeIdentification> {
    if samples.len() < 5 {
        return None;
    }
    let mut found = FreeIdentification {
        origin: Vector3::zeros(),
        matrix: Matrix3::identity(),
        tool: Vector3::zeros(),
        iterations: 0,
        converged: false,
        rms: f64::INFINITY,
        condition: f64::INFINITY,
    };
    let residual = |found: &FreeIdentification, s: &Sample| {
        s.world_point - (found.matrix * (s.base_from_flange * found.tool) + found.origin)
    };
    while found.iterations < MOST_STEPS && !found.converged {
        let mut jacobian = DMatrix::zeros(3 * samples.len(), 15);
        let mut right = DVector::zeros(3 * samples.len());
        for (i, s) in samples.iter().enumerate() {
            let in_base = s.base_from_flange * found.tool;
            let by_tool = found.matrix * s.base_from_flange.rotation_matrix();
            let r = residual(&found, s);
            for axis in 0..3 {
                let row = 3 * i + axis;
                right[row] = r[axis];
                jacobian[(row, axis)] = 1.0;
                for column in 0..3 {
                    // Entry r(axis, column) multiplies coordinate `column` of the point in the base's frame.
                    jacobian[(row, 3 + 3 * axis + column)] = in_base[column];
                    jacobian[(row, 12 + column)] = by_tool[(axis, column)];
                }
            }
        }
        // The triangular factor has the Jacobian's singular values at a fraction of the cost.
        let qr = jacobian.qr();
        qr.q_tr_mul(&mut right);
        let svd = qr.r().svd(true, true);
        let (largest, smallest) = (svd.singular_values.max(), svd.singular_values.min());
        found.condition = if smallest > 0.0 { largest / smallest } else { f64::INFINITY };
        let step = svd.solve(&right.rows(0, 15).into_owned(), 1e-12 * largest).ok()?;
        if step.iter().any(|x| !x.is_finite()) {
            return None;
        }
        for axis in 0..3 {
            found.origin[axis] += step[axis];
            found.tool[axis] += step[12 + axis];
            for column in 0..3 {
                found.matrix[(axis, column)] += step[3 + 3 * axis + column];
            }
        }
        found.iterations += 1;
        found.converged = step.iter().all(|d| d.abs() < STEP);
    }
    found.rms = root_mean_square(samples.iter().map(|s| residual(&found, s)));
    Some(found)
}
