//! Condensation: all residuals of a block become one small symmetric matrix over (twist, lens, residual).
//!
//! Corners have kernels of their own ([`super::corners`]); here are the other kinds. With `r` the whitened residuals of a block, `J` their derivative to the twist of the block's transform on the right and to the lens, and `W` the
//! robust weights, a kernel forms `M = [J r]^T W [J r]`. Its layout is: 3 translations, 3 rotations, the lens parameters, and last the
//! residual, so that `M`'s last column is the gradient. Only the upper triangle is filled; corners leave out the residual's own square, which nobody asks for.

use nalgebra::{Matrix3, Vector3};

use super::loss::Loss;
use super::measurements::Contact;
use crate::geometry::lens::MAX_PARAMETERS;
use crate::geometry::{Pose, rotation};

/// The widest matrix: a twist, the largest lens, the residual.
pub const WIDEST: usize = 7 + MAX_PARAMETERS;

/// Squared whitened residual of a corner that the camera cannot see at the current state: large enough that seeing it is always better,
/// finite so that costs stay comparable.
pub(super) const UNSEEN: f64 = 1e8;

/// A condensed block. `size` counts the rows in use: 7, or 7 plus the lens parameters.
#[derive(Clone, Debug)]
pub struct Condensed {
    /// Row-major with stride [`WIDEST`]; upper triangle.
    pub matrix: [[f64; WIDEST]; WIDEST],
    /// Rows in use.
    pub size: usize,
    /// Sum of the losses, `rho / 2`.
    pub cost: f64,
    /// Room for the rows of corners.
    pub(super) rows: Vec<f64>,
}

impl Default for Condensed {
    fn default() -> Self {
        Self { matrix: [[0.0; WIDEST]; WIDEST], size: 7, cost: 0.0, rows: Vec::new() }
    }
}

/// A loss, and whether its own curvature counts beside its weights.
pub type Robust = (Loss, bool);

/// Adds one group of rows `r = [J | residual]` under a common robust loss; see [`Loss::weight_and_bend`].
fn add_rows<const N: usize>(rows: &[[f64; 7]; N], (loss, curved): Robust, out: &mut Condensed) {
    let squared: f64 = rows.iter().map(|row| row[6] * row[6]).sum();
    let (weight, bend) = loss.weight_and_bend(squared);
    out.cost += 0.5 * loss.evaluate(squared).0;
    if curved && bend != 0.0 {
        let along: [f64; 6] = std::array::from_fn(|i| rows.iter().map(|row| row[i] * row[6]).sum());
        for i in 0..6 {
            for j in i..6 {
                out.matrix[i][j] += bend * along[i] * along[j];
            }
        }
    }
    for row in rows {
        for i in 0..7 {
            for j in i..7 {
                out.matrix[i][j] += weight * row[i] * row[j];
            }
        }
    }
}

/// The two whitened residual vectors of a measured pose: translation in the sensor's axes, then the rotation vector of the difference.
#[must_use]
pub fn pose_residuals(measured: &Pose, pose: &Pose, sigma: [f64; 2]) -> (Vector3<f64>, Vector3<f64>) {
    let turn = rotation::log(&(measured.rotation.inverse() * pose.rotation));
    ((pose.translation - measured.translation) / sigma[0], turn / sigma[1])
}

/// Adds measured poses. The translation and the rotation are robust apart from each other: a flipped tag is right about where it is.
pub fn condense_poses(measured: &[Option<Pose>], pose: &Pose, sigma: [f64; 2], robust: Robust, out: &mut Condensed) {
    reset(out);
    let r = pose.rotation_matrix();
    for measured in measured.iter().flatten() {
        let (translation, turn) = pose_residuals(measured, pose, sigma);
        let slope = rotation::right_jacobian_inverse(&(turn * sigma[1]));
        let first: [[f64; 7]; 3] = std::array::from_fn(|i| {
            let row = r.row(i) / sigma[0];
            [row[0], row[1], row[2], 0.0, 0.0, 0.0, translation[i]]
        });
        let second: [[f64; 7]; 3] = std::array::from_fn(|i| {
            let row = slope.row(i) / sigma[1];
            [0.0, 0.0, 0.0, row[0], row[1], row[2], turn[i]]
        });
        add_rows(&first, robust, out);
        add_rows(&second, robust, out);
    }
}

/// The cost of measured poses alone.
#[must_use]
pub fn pose_cost(measured: &[Option<Pose>], pose: &Pose, sigma: [f64; 2], loss: Loss) -> f64 {
    let one = |measured: &Pose| {
        let (translation, turn) = pose_residuals(measured, pose, sigma);
        0.5 * loss.evaluate(translation.norm_squared()).0 + 0.5 * loss.evaluate(turn.norm_squared()).0
    };
    measured.iter().flatten().map(one).sum()
}

/// Rows of the derivative of `pose * point` to the twist of `pose`, divided by `sigma`.
fn point_rows(r: &Matrix3<f64>, point: &Vector3<f64>, sigma: f64) -> [[f64; 6]; 3] {
    std::array::from_fn(|i| {
        let row = Vector3::new(r[(i, 0)], r[(i, 1)], r[(i, 2)]) / sigma;
        let turn = point.cross(&row);
        [row.x, row.y, row.z, turn.x, turn.y, turn.z]
    })
}

fn with_residual(row: [f64; 6], residual: f64) -> [f64; 7] {
    [row[0], row[1], row[2], row[3], row[4], row[5], residual]
}

/// Adds measured points.
pub fn condense_points(
    points: &[Option<(Vector3<f64>, Vector3<f64>)>],
    pose: &Pose,
    sigma: f64,
    robust: Robust,
    out: &mut Condensed,
) {
    reset(out);
    let r = pose.rotation_matrix();
    for (place, measured) in points.iter().flatten() {
        let residual = (*pose * *place - measured) / sigma;
        let rows = point_rows(&r, place, sigma);
        add_rows(&std::array::from_fn::<_, 3, _>(|i| with_residual(rows[i], residual[i])), robust, out);
    }
}

/// The cost of measured points alone.
#[must_use]
pub fn point_cost(points: &[Option<(Vector3<f64>, Vector3<f64>)>], pose: &Pose, sigma: f64, loss: Loss) -> f64 {
    let one = |(place, measured): &(Vector3<f64>, Vector3<f64>)| {
        0.5 * loss.evaluate(((*pose * *place - measured) / sigma).norm_squared()).0
    };
    points.iter().flatten().map(one).sum()
}

/// Adds contacts: two points at a distance. At distance zero all three coordinates agree; else only the length is known.
pub fn condense_contacts(
    contacts: &[Option<Contact>],
    a_from_b: &Pose,
    sigma: f64,
    robust: Robust,
    out: &mut Condensed,
) {
    reset(out);
    let r = a_from_b.rotation_matrix();
    for Contact { a: point_a, b: point_b, distance } in contacts.iter().flatten() {
        let apart = *a_from_b * *point_b - point_a;
        let rows = point_rows(&r, point_b, sigma);
        if *distance == 0.0 {
            add_rows(&std::array::from_fn::<_, 3, _>(|i| with_residual(rows[i], apart[i] / sigma)), robust, out);
            continue;
        }
        let length = apart.norm();
        // Two points on top of each other have no direction apart; any will do for one step.
        let direction = if length > 1e-12 { apart / length } else { Vector3::z() };
        let row: [f64; 6] = std::array::from_fn(|c| (0..3).map(|i| direction[i] * rows[i][c]).sum());
        add_rows(&[with_residual(row, (length - distance) / sigma)], robust, out);
    }
}

/// The cost of contacts alone.
#[must_use]
pub fn contact_cost(contacts: &[Option<Contact>], a_from_b: &Pose, sigma: f64, loss: Loss) -> f64 {
    let one = |Contact { a: point_a, b: point_b, distance }: &Contact| {
        let apart = (*a_from_b * *point_b - point_a).norm();
        0.5 * loss.evaluate(((apart - distance) / sigma).powi(2)).0
    };
    contacts.iter().flatten().map(one).sum()
}

fn reset(out: &mut Condensed) {
    for row in &mut out.matrix[..7] {
        row[..7].fill(0.0);
    }
    out.size = 7;
    out.cost = 0.0;
}
