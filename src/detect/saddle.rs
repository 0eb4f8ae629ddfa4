//! A board's corner: where two straight edges cross and the colours change places.
//!
//! Unlike a tag's corner this one is symmetric, blur leaves it where it is, and looking right at it
//! is sound. The usual way (`cornerSubPix`) solves for the point that all gradients around are
//! perpendicular to; it says nothing about how well it did. Here the picture around the corner is
//! fitted as what it is,
//!
//! ```text
//! value = light * (middle + contrast * E(distance to edge 1 / blur) * E(distance to edge 2 / blur)),   E = 2 Phi - 1
//! ```
//!
//! with the place, the two directions, the blur, middle, contrast and the slope of the light free: least squares on the pixels
//! themselves. The residual then gives an honest covariance, and a place that is no such corner
//! gives a residual that says so.

use nalgebra::{SMatrix, SVector};

use super::edge_fit::normal;
use super::edge_lines::{LARGEST_DEVIATION, Refinement, Weakness};
use super::picture::GreyPicture;

/// Unknowns: x, y, direction 1, direction 2, ln blur, middle, contrast, and the light's relative slopes along x and y.
const UNKNOWNS: usize = 9;
/// Pixels farther from the corner than this, along either axis, are not used.
const FARTHEST: f64 = 9.0;
/// Half the difference of white and black, in grey levels, below which there is no corner.
const MINIMUM_CONTRAST: f64 = 5.0;
/// Error in px that the residual cannot show.
const FLOOR: f64 = 0.003;

/// What is known of a corner before it is measured.
#[derive(Debug, Clone, Copy)]
pub struct RoughCorner {
    /// Where it is to within a few pixels or a third of a square, whichever is less.
    pub pixel: [f64; 2],
    /// One square along the board's columns, and one along its rows, in pixels, at this place.
    pub square: [[f64; 2]; 2],
    /// How far the squares around are plain, as a part of a square: 0.5 on a checkerboard, on a ChArUco
    /// board the white margin around its markers.
    pub margin: f64,
    /// Whether the square ahead (towards both directions of `square`) is black, if that is known; a
    /// corner of the other colours is then refused.
    pub black_ahead: Option<bool>,
}

/// Measures one inner corner of a board; see the module's head. About 0.1 ms.
#[must_use]
pub fn refine_saddle(picture: &GreyPicture, rough: &RoughCorner) -> Refinement {
    match fit(picture, rough) {
        Ok((pixel, covariance)) => Refinement::Refined { pixel, covariance },
        Err(weakness) => Refinement::Weak(weakness),
    }
}

fn fit(picture: &GreyPicture, rough: &RoughCorner) -> Result<([f64; 2], [f64; 3]), Weakness> {
    let [along, across] = rough.square;
    let sine = (along[0] * across[1] - along[1] * across[0]) / (along[0].hypot(along[1]) * across[0].hypot(across[1]));
    // A board seen so flat that its edges nearly coincide has no corners to speak of.
    if sine.is_nan() || sine.abs() <= 0.08 {
        return Err(Weakness::NotAQuadrangle);
    }
    let start = SVector::<f64, UNKNOWNS>::from([
        rough.pixel[0],
        rough.pixel[1],
        along[1].atan2(along[0]),
        across[1].atan2(across[0]),
        0.9_f64.ln(),
        0.0,
        0.0,
        0.0,
        0.0,
    ]);
    let mut samples = window(picture, rough, rough.pixel)?;
    let (mut found, mut information, mut squares) = descend(&samples, start)?;
    if (found[0] - rough.pixel[0]).hypot(found[1] - rough.pixel[1]) > 0.75 {
        // The window sat on the rough place and not on the corner.
        samples = window(picture, rough, [found[0], found[1]])?;
        (found, information, squares) = descend(&samples, found)?;
    }

    let noise = squares / (samples.len() - UNKNOWNS) as f64;
    let contrast = found[6].abs();
    if contrast < MINIMUM_CONTRAST {
        return Err(Weakness::NoContrast);
    }
    // Ahead, the signed distances from the two edges have the sign of the hand, and the other one.
    if rough.black_ahead.is_some_and(|black| black != (found[6] > 0.0)) {
        return Err(Weakness::NotStraight);
    }
    // Residuals a third of the contrast mean that something else is there.
    if noise.sqrt() > 0.3 * contrast {
        return Err(Weakness::NotStraight);
    }
    let reach = 0.35 * along[0].hypot(along[1]).min(across[0].hypot(across[1]));
    if (found[0] - rough.pixel[0]).hypot(found[1] - rough.pixel[1]) > reach {
        return Err(Weakness::MovedTooFar);
    }
    let inverse = information.cholesky().ok_or(Weakness::TooUncertain)?.inverse()
        * (noise.max(1.0 / 12.0) * redundancy(&samples, &found));
    let covariance = [inverse[(0, 0)] + FLOOR.powi(2), inverse[(0, 1)], inverse[(1, 1)] + FLOOR.powi(2)];
    let worst = (covariance[0] + covariance[2]) / 2.0 + ((covariance[0] - covariance[2]) / 2.0).hypot(covariance[1]);
    if worst.is_nan() || worst > LARGEST_DEVIATION.powi(2) {
        return Err(Weakness::TooUncertain);
    }
    Ok(([found[0], found[1]], covariance))
}

/// How many residuals of this picture say what one independent residual would, at least 1.
///
/// On real prints and in JPEG files neighbouring residuals are alike, and counting them as so many separate
/// facts would promise a precision that is not there. If each is `rho` times the one beside it, in both
/// directions, then ((1 + rho) / (1 - rho))^2 of them make one.
fn redundancy(samples: &[[f64; 3]], unknowns: &SVector<f64, UNKNOWNS>) -> f64 {
    let residuals: Vec<f64> = samples.iter().map(|sample| sample[2] - value(unknowns, sample)).collect();
    let (mut squares, mut products, mut pairs) = (0.0, 0.0, 0.0);
    for ((this, next), (a, b)) in
        samples.iter().zip(samples.iter().skip(1)).zip(residuals.iter().zip(residuals.iter().skip(1)))
    {
        // Samples run along rows of the picture: the next one is mostly the pixel beside.
        if this[1] == next[1] && next[0] - this[0] == 1.0 {
            squares += 0.5 * (a * a + b * b);
            products += a * b;
            pairs += 1.0;
        }
    }
    if pairs < 8.0 || squares <= 0.0 {
        return 1.0;
    }
    let rho = (products / squares).clamp(0.0, 0.6);
    ((1.0 + rho) / (1.0 - rho)).powi(2)
}

/// The model's grey value at a sample.
fn value(unknowns: &SVector<f64, UNKNOWNS>, sample: &[f64; 3]) -> f64 {
    let light = 1.0 + unknowns[7] * (sample[0] - unknowns[0]) + unknowns[8] * (sample[1] - unknowns[1]);
    light * (unknowns[5] + unknowns[6] * product(unknowns, sample))
}

/// The pixels around a corner that lie in the four squares that meet there and, on a ChArUco board,
/// not in the markers: (x, y, value).
fn window(picture: &GreyPicture, rough: &RoughCorner, centre: [f64; 2]) -> Result<Vec<[f64; 3]>, Weakness> {
    let [along, across] = rough.square;
    let determinant = along[0] * across[1] - along[1] * across[0];
    // Half a square in px, as far as it reaches along either axis of the picture.
    let half = [0, 1].map(|axis: usize| (0.5 * (along[axis].abs() + across[axis].abs())).min(FARTHEST));
    let span = |axis: usize, extent: usize| {
        let low = (centre[axis] - half[axis]).ceil();
        let high = (centre[axis] + half[axis]).floor();
        (low >= 0.0 && high < extent as f64 && low <= high).then_some(low as usize..high as usize + 1)
    };
    let (Some(columns), Some(rows)) = (span(0, picture.width()), span(1, picture.height())) else {
        return Err(Weakness::TooFewEdges);
    };
    // The next corner's edges and the marker's have faded a pixel and a half before they begin.
    let shortest = along[0].hypot(along[1]).min(across[0].hypot(across[1]));
    let plain = (rough.margin - 1.5 / shortest).max(0.6 * rough.margin);
    let mut samples = Vec::with_capacity(columns.len() * rows.len());
    for row in rows {
        for column in columns.clone() {
            let delta = [column as f64 - centre[0], row as f64 - centre[1]];
            let u = ((delta[0] * across[1] - delta[1] * across[0]) / determinant).abs();
            let v = ((along[0] * delta[1] - along[1] * delta[0]) / determinant).abs();
            if u.max(v) <= 0.5
                && u.min(v) <= plain
                && let Some(value) = picture.pixel(column, row)
            {
                samples.push([column as f64, row as f64, f64::from(value)]);
            }
        }
    }
    if samples.len() < 3 * UNKNOWNS { Err(Weakness::TooFewEdges) } else { Ok(samples) }
}

type Information = SMatrix<f64, UNKNOWNS, UNKNOWNS>;

/// Levenberg-Marquardt. Gives the unknowns, J'J there, and the sum of squared residuals.
fn descend(
    samples: &[[f64; 3]],
    start: SVector<f64, UNKNOWNS>,
) -> Result<(SVector<f64, UNKNOWNS>, Information, f64), Weakness> {
    let mut unknowns = start;
    if start[6] == 0.0 {
        // Middle and contrast are linear: one small regression starts them.
        let (mut e, mut ee, mut v, mut ev) = (0.0, 0.0, 0.0, 0.0);
        for sample in samples {
            let edge = product(&unknowns, sample);
            e += edge;
            ee += edge * edge;
            v += sample[2];
            ev += edge * sample[2];
        }
        let n = samples.len() as f64;
        unknowns[6] = (ev - e * v / n) / (ee - e * e / n).max(1e-9);
        unknowns[5] = (v - unknowns[6] * e) / n;
        if unknowns[6].abs() < 0.5 * MINIMUM_CONTRAST {
            return Err(Weakness::NoContrast);
        }
    }
    let mut damping = 1e-3;
    let (mut information, mut gradient, mut squares) = normal_equations(samples, &unknowns);
    for _ in 0..25 {
        let mut damped = information;
        for diagonal in 0..UNKNOWNS {
            damped[(diagonal, diagonal)] *= 1.0 + damping;
            damped[(diagonal, diagonal)] += 1e-12;
        }
        let step = damped.cholesky().ok_or(Weakness::TooUncertain)?.solve(&gradient);
        let mut trial = unknowns + step;
        // From a third of a pixel (a pixel's own width) to quite out of focus.
        trial[4] = trial[4].clamp(0.3_f64.ln(), 4.0_f64.ln());
        let (trial_information, trial_gradient, trial_squares) = normal_equations(samples, &trial);
        if trial_squares <= squares {
            // A thousandth of a pixel is a tenth of what noise leaves; the next step would be far smaller still.
            let settled = step[0].hypot(step[1]) < 1e-3 && squares - trial_squares <= 1e-3 * squares;
            (unknowns, information, gradient, squares) = (trial, trial_information, trial_gradient, trial_squares);
            damping = (damping * 0.1).max(1e-9);
            if settled {
                break;
            }
        } else {
            damping *= 10.0;
            if damping > 1e6 {
                break;
            }
        }
    }
    Ok((unknowns, information, squares))
}

/// E(edge 1) * E(edge 2) at a sample.
fn product(unknowns: &SVector<f64, UNKNOWNS>, sample: &[f64; 3]) -> f64 {
    let blur = unknowns[4].exp();
    let delta = [sample[0] - unknowns[0], sample[1] - unknowns[1]];
    let edge = |direction: f64| 2.0 * normal((delta[1] * direction.cos() - delta[0] * direction.sin()) / blur).0 - 1.0;
    edge(unknowns[2]) * edge(unknowns[3])
}

fn normal_equations(
    samples: &[[f64; 3]],
    unknowns: &SVector<f64, UNKNOWNS>,
) -> (Information, SVector<f64, UNKNOWNS>, f64) {
    let blur = unknowns[4].exp();
    let (sin1, cos1) = unknowns[2].sin_cos();
    let (sin2, cos2) = unknowns[3].sin_cos();
    let contrast = unknowns[6];
    let mut information = Information::zeros();
    let mut gradient = SVector::<f64, UNKNOWNS>::zeros();
    let mut squares = 0.0;
    for [x, y, value] in samples {
        let delta = [x - unknowns[0], y - unknowns[1]];
        // Distance from an edge, and place along it.
        let (d1, a1) = (delta[1] * cos1 - delta[0] * sin1, delta[0] * cos1 + delta[1] * sin1);
        let (d2, a2) = (delta[1] * cos2 - delta[0] * sin2, delta[0] * cos2 + delta[1] * sin2);
        let (phi1, density1) = normal(d1 / blur);
        let (phi2, density2) = normal(d2 / blur);
        let (e1, e2) = (2.0 * phi1 - 1.0, 2.0 * phi2 - 1.0);
        let board = unknowns[5] + contrast * e1 * e2;
        let light = 1.0 + unknowns[7] * delta[0] + unknowns[8] * delta[1];
        // Derivatives by the two distances.
        let contrast = contrast * light;
        let (g1, g2) = (contrast * 2.0 * density1 / blur * e2, contrast * 2.0 * density2 / blur * e1);
        let row = SVector::<f64, UNKNOWNS>::from([
            g1 * sin1 + g2 * sin2 - unknowns[7] * board,
            -g1 * cos1 - g2 * cos2 - unknowns[8] * board,
            -g1 * a1,
            -g2 * a2,
            -g1 * d1 - g2 * d2,
            light,
            light * e1 * e2,
            delta[0] * board,
            delta[1] * board,
        ]);
        let residual = value - light * board;
        // The lower triangle is all that Cholesky reads.
        for column in 0..UNKNOWNS {
            for line in column..UNKNOWNS {
                information[(line, column)] += row[line] * row[column];
            }
        }
        gradient.axpy(residual, &row, 1.0);
        squares += residual * residual;
    }
    (information, gradient, squares)
}
