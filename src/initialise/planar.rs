//! The two poses of a flat target: infinitesimal plane-based pose estimation.
//!
//! T. Collins and A. Bartoli, *Infinitesimal Plane-Based Pose Estimation*, IJCV 109(3), 2014: the homography from the plane to the normalised
//! image, and its first derivative at the plane's centre, leave exactly two rotations.

use nalgebra::{DMatrix, Matrix2, Matrix3, SMatrix, SVector, Vector2, Vector3};

/// The homography `H` with `image ~ H plane`, scaled to `h33 = 1`, by the direct linear transform; `None` for fewer than four points or a
/// degenerate arrangement.
pub(super) fn homography(plane: &[Vector2<f64>], image: &[Vector2<f64>]) -> Option<Matrix3<f64>> {
    if plane.len() < 4 {
        return None;
    }
    let (plane_norm, a) = normalise(plane)?;
    let (image_norm, b) = normalise(image)?;
    let mut gram = SMatrix::<f64, 9, 9>::zeros();
    for (p, q) in a.iter().zip(&b) {
        let rows = [
            [p.x, p.y, 1.0, 0.0, 0.0, 0.0, -q.x * p.x, -q.x * p.y, -q.x],
            [0.0, 0.0, 0.0, p.x, p.y, 1.0, -q.y * p.x, -q.y * p.y, -q.y],
        ];
        for row in rows {
            let row = SVector::<f64, 9>::from(row);
            gram += row * row.transpose();
        }
    }
    let eigen = DMatrix::from_column_slice(9, 9, gram.as_slice()).symmetric_eigen();
    let mut order: Vec<usize> = (0..9).collect();
    order.sort_by(|i, j| eigen.eigenvalues[*i].total_cmp(&eigen.eigenvalues[*j]));
    // Two vanishing eigenvalues: the points lie on a line.
    if eigen.eigenvalues[order[1]] < 1e-12 * eigen.eigenvalues[order[8]] {
        return None;
    }
    let h = eigen.eigenvectors.column(order[0]);
    let h = Matrix3::new(h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], h[8]);
    let h = image_norm.try_inverse()? * h * plane_norm;
    (h[(2, 2)].abs() > 1e-12).then(|| h / h[(2, 2)])
}

/// Points shifted to their centroid and scaled to a mean distance of sqrt 2, with the matrix that does it.
fn normalise(points: &[Vector2<f64>]) -> Option<(Matrix3<f64>, Vec<Vector2<f64>>)> {
    let count = points.len() as f64;
    let centre = points.iter().sum::<Vector2<f64>>() / count;
    let spread = points.iter().map(|p| (p - centre).norm()).sum::<f64>() / count;
    if !(spread.is_finite() && spread > 1e-12) {
        return None;
    }
    let s = std::f64::consts::SQRT_2 / spread;
    let matrix = Matrix3::new(s, 0.0, -s * centre.x, 0.0, s, -s * centre.y, 0.0, 0.0, 1.0);
    Some((matrix, points.iter().map(|p| (p - centre) * s).collect()))
}

/// The two rotations `camera_from_plane` that fit a homography at the plane's origin.
pub(super) fn plane_rotations(h: &Matrix3<f64>) -> Option<[Matrix3<f64>; 2]> {
    let (p, q) = (h[(0, 2)], h[(1, 2)]);
    let slope = Matrix2::new(
        h[(0, 0)] - h[(2, 0)] * p,
        h[(0, 1)] - h[(2, 1)] * p,
        h[(1, 0)] - h[(2, 0)] * q,
        h[(1, 1)] - h[(2, 1)] * q,
    );
    // The rotation that turns the optical axis to the ray of the plane's origin.
    let t2 = p * p + q * q;
    let turn = if t2 < 1e-20 {
        Matrix3::identity()
    } else {
        let (s, t) = ((t2 + 1.0).sqrt(), t2.sqrt());
        let k = Matrix3::new(0.0, 0.0, p, 0.0, 0.0, q, -p, -q, 0.0) / t;
        Matrix3::identity() + k * (t / s) + k * k * (1.0 - 1.0 / s)
    };
    let b = Matrix2::new(
        turn[(0, 0)] - p * turn[(2, 0)],
        turn[(0, 1)] - p * turn[(2, 1)],
        turn[(1, 0)] - q * turn[(2, 0)],
        turn[(1, 1)] - q * turn[(2, 1)],
    );
    let a = b.try_inverse()? * slope;
    let gamma = a.singular_values().max();
    if !(gamma.is_finite() && gamma > 1e-12) {
        return None;
    }
    let r = a / gamma;
    let first = (1.0 - r[(0, 0)].powi(2) - r[(1, 0)].powi(2)).max(0.0).sqrt();
    let mut second = (1.0 - r[(0, 1)].powi(2) - r[(1, 1)].powi(2)).max(0.0).sqrt();
    if -r[(0, 0)] * r[(0, 1)] - r[(1, 0)] * r[(1, 1)] < 0.0 {
        second = -second;
    }
    let build = |sign: f64| {
        let x = Vector3::new(r[(0, 0)], r[(1, 0)], sign * first);
        let y = Vector3::new(r[(0, 1)], r[(1, 1)], sign * second);
        turn * Matrix3::from_columns(&[x, y, x.cross(&y)])
    };
    Some([build(1.0), build(-1.0)])
}
