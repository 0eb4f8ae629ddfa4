//! The corners of a tag whose cells are only a few blurs wide, from all of its cells at once.
//!
//! Lines along the four sides ([`super::edge_lines`]) need a border and a margin in which black and white are reached. A tag of a dozen
//! pixels, one that is seen edge on, one out of focus has none: what lies behind the border shines through it. But a tag that has been
//! read is known, every cell of it, and so is how it looks:
//!
//! ```text
//! value(x) = dark + slope . x + contrast * t(T(H^-1 x)),    t(p) = p + tone * p (1 - p)
//! ```
//!
//! with T the cells blurred and H the perspective map that takes cells to pixels. The tone t
//! is what a camera that does not answer to light in proportion makes of it: the grey half-way between black and white is then not where the edge is. All of it, the map, the blur, the light and the tone, is fitted to
//! the pixels by Gauss-Newton with robust weights: some hundred pixels for some sixteen numbers, so that corners of a tag of 12 px are known
//! to a few hundredths of a pixel.
//!
//! How cells look when they are blurred is said in [`super::blurred_cells`], what the pixels make of it summed up in [`super::tag_sums`].

use nalgebra::{Cholesky, Const, SMatrix, SVector};

use super::blurred_cells::{Cells, Marks};
use super::edge_lines::Weakness;
use super::known_tag::Linear;
use super::lens::Bender;
use super::picture::GreyPicture;
use super::projection::Projection;
use super::tag_pixels::{Frame, Pixels};
use super::tag_sums::{Model, Sums, UNKNOWNS};
use super::tag_verdict::{BELIEVED, Judge, spread};
use super::wide::Lanes;

/// Bound of the tone: beyond it grey would not grow with light.
const STEEPEST: f64 = 0.95;
/// Standard deviation of the tone that is expected: an sRGB picture has 0.4 or so.
const USUAL_TONE: f64 = 0.3;
/// Gauss-Newton steps, at most.
const MOST_STEPS: usize = 16;
/// Corners that move less than this (px) stand still.
const STILL: f64 = 4e-3;
/// Bounds of the blur, px.
const BLUR_BOUNDS: [f64; 2] = [0.3, 6.0];
/// What is added to the diagonal of the scaled normal matrix, for what the picture does not tell: single precision's part of it.
const DAMPING: f64 = 1e-6;

/// What is fitted.
pub(super) struct WholeTag<'a> {
    /// Rough corners in ideal pixels, in the order of the cells.
    pub ideal: [[f64; 2]; 4],
    pub cells: Cells<'a>,
    pub bright_inside: bool,
    /// A first idea of the blur, px.
    pub blur: f64,
}

/// A measured corner: ideal pixel and its covariance `[suu, suv, svv]`.
pub(super) type IdealCorner = ([f64; 2], [f64; 3]);

/// The state of the fit.
#[derive(Debug, Clone)]
pub(super) struct State {
    /// Cells, from the middle of the tag, to ideal pixels from `WholeTag`'s.
    pub map: Projection,
    /// Covariance `[xx, xy, yy]`, px^2.
    pub blur: [f64; 3],
    /// Dark, its slopes, contrast.
    pub light: [f64; 4],
    pub tone: f64,
}

/// The scaled normal matrix, factorised, and the units it is scaled by.
struct Normal {
    factor: Cholesky<f64, Const<UNKNOWNS>>,
    units: SVector<f64, UNKNOWNS>,
}

/// A fit that stands still.
pub(super) struct Fitted<'a> {
    tag: &'a WholeTag<'a>,
    marks: Marks,
    middle: [f64; 2],
    pixels: Pixels,
    residuals: Vec<Lanes>,
    state: State,
    normal: Normal,
    scale: f64,
}

impl Fitted<'_> {
    /// The corners, and the blur along its worst direction (px).
    pub fn corners(&self) -> Result<([IdealCorner; 4], f64), Weakness> {
        let judge = Judge { bright_inside: self.tag.bright_inside, scale: self.scale };
        let (values, neighbours) = (self.pixels.values(), self.pixels.neighbours());
        let variance = judge.variance(self.pixels.count, &neighbours, [&values, &self.residuals], &self.state)?;
        let per_side = self.tag.cells.per_side;
        let covariances = covariances(&self.state.map, per_side, &self.normal.inverse());
        let corners = corners(&self.state.map, per_side);
        let found = [0, 1, 2, 3].map(|k: usize| {
            let pixel = [corners[k][0] + self.middle[0], corners[k][1] + self.middle[1]];
            (pixel, covariances[k].map(|number| variance * number))
        });
        let [xx, xy, yy] = self.state.blur;
        let worst = (xx + yy) / 2.0 + ((xx - yy) / 2.0).hypot(xy);
        Ok((found, worst.sqrt()))
    }

    /// The fit, made linear for other pictures.
    pub fn linear(self) -> Result<Linear, Weakness> {
        let Self { tag, marks, middle, pixels, state, normal, scale, .. } = self;
        let model = tag.model(&marks, &state, f64::INFINITY)?;
        let (expected, slopes) = model.linearised(&pixels);
        Ok(Linear {
            per_side: tag.cells.per_side,
            bright_inside: tag.bright_inside,
            middle,
            neighbours: pixels.neighbours(),
            pixels,
            expected,
            slopes,
            inverse: normal.inverse(),
            state,
            scale,
            certainty: certainty(scale),
        })
    }
}

/// How much the tone that is expected counts where the noise has this standard deviation.
fn certainty(scale: f64) -> f64 {
    (scale / USUAL_TONE).powi(2)
}

/// A tag's corners among its cells, from its middle.
fn square(per_side: usize) -> [[f64; 2]; 4] {
    let half = per_side as f64 / 2.0;
    [[-half, -half], [half, -half], [half, half], [-half, half]]
}

/// The corners that a map makes.
pub(super) fn corners(map: &Projection, per_side: usize) -> [[f64; 2]; 4] {
    square(per_side).map(|corner| map.map(corner))
}

/// The corners' covariances `[suu, suv, svv]` for residuals of variance 1.
pub(super) fn covariances(
    map: &Projection,
    per_side: usize,
    inverse: &SMatrix<f64, UNKNOWNS, UNKNOWNS>,
) -> [[f64; 3]; 4] {
    let block = inverse.fixed_view::<8, 8>(0, 0);
    let corners = corners(map, per_side);
    let square = square(per_side);
    [0, 1, 2, 3].map(|k: usize| {
        let [x, y] = map_slopes(map, square[k], corners[k]);
        let (to_x, to_y) = (block * x, block * y);
        [x.dot(&to_x), x.dot(&to_y), y.dot(&to_y)]
    })
}

impl WholeTag<'_> {
    /// The tag anew, if the blur that was found is larger than was thought: then less of the margin was free of what lies beyond it.
    pub fn with_less_margin(&self, corners: &[IdealCorner; 4], seen: f64) -> Option<Self> {
        (seen > 1.15 * self.blur).then(|| Self { ideal: corners.map(|corner| corner.0), blur: seen, ..*self })
    }

    /// The fit, to where it stands still.
    pub fn settle(&self, picture: &GreyPicture, bender: &Bender<'_>) -> Result<Fitted<'_>, Weakness> {
        let marks = self.cells.marks().ok_or(Weakness::TooFewEdges)?;
        let middle = [0, 1].map(|axis: usize| self.ideal.iter().map(|corner| corner[axis]).sum::<f64>() / 4.0);
        let around = |corner: [f64; 2]| [corner[0] - middle[0], corner[1] - middle[1]];
        let unit = Projection::from_unit_square(self.ideal.map(around)).ok_or(Weakness::NotAQuadrangle)?;
        let map = unit.around_origin(self.cells.per_side as f64).ok_or(Weakness::NotAQuadrangle)?;
        let pixels = self.pixels(picture, bender, &map, middle)?;
        if pixels.count < 4 * UNKNOWNS {
            return Err(Weakness::TooFewEdges);
        }
        let round = self.blur.clamp(BLUR_BOUNDS[0], BLUR_BOUNDS[1]).powi(2);
        let mut state = State { map, blur: [round, 0.0, round], light: self.light(&pixels), tone: 0.0 };
        let mut residuals: Vec<Lanes> = Vec::new();
        // Nothing is known of the noise, and every residual is believed.
        let mut scale = f64::INFINITY;
        for _ in 0..MOST_STEPS {
            let before = corners(&state.map, self.cells.per_side);
            let sums = self.model(&marks, &state, scale)?.sums(&pixels, &mut residuals);
            let spread = spread(&residuals, pixels.count);
            let normal = state.step(&sums, spread)?;
            scale = spread;
            let after = corners(&state.map, self.cells.per_side);
            let moved = (0..4).map(|k| distance(before[k], after[k])).fold(0.0, f64::max);
            if moved < STILL {
                return Ok(Fitted { tag: self, marks, middle, pixels, residuals, state, normal, scale });
            }
            if (0..4).any(|k| distance(after[k], around(self.ideal[k])) > self.reach()) {
                return Err(Weakness::MovedTooFar);
            }
        }
        Err(Weakness::NotStraight)
    }

    /// How far a corner may move, px.
    fn reach(&self) -> f64 {
        let shortest = (0..4).map(|k| distance(self.ideal[k], self.ideal[(k + 1) % 4])).fold(f64::MAX, f64::min);
        (0.15 * shortest).max(3.0).min(1.5 * shortest / self.cells.per_side as f64 + 0.5)
    }

    /// The pixels on the tag and on as much of the margin as surely is one.
    fn pixels(
        &self,
        picture: &GreyPicture,
        bender: &Bender<'_>,
        map: &Projection,
        middle: [f64; 2],
    ) -> Result<Pixels, Weakness> {
        let inverse = inverse(map)?;
        let half = self.cells.per_side as f64 / 2.0;
        let (mut low, mut high) = ([f64::MAX; 2], [f64::MIN; 2]);
        for corner in square(self.cells.per_side) {
            let [x, y] = map.map(corner.map(|place| place + place.signum()));
            let pixel = bender.distort([x + middle[0], y + middle[1]])?;
            for axis in 0..2 {
                low[axis] = low[axis].min(pixel[axis]);
                high[axis] = high[axis].max(pixel[axis]);
            }
        }
        Pixels::gather(picture, bender, &Frame { low, high, middle }, |[x, y]| {
            let [u, v, depth] = inverse.map(|row| row[0] * x + row[1] * y + row[2]);
            // Beyond the margin, which may be one cell wide only, anything may be; its blur reaches in.
            let far = 1.0 / depth;
            [u * far, v * far].iter().zip(&inverse).all(|(at, row)| {
                if at.abs() < half - 1.0 {
                    return true;
                }
                let slope = [0, 1].map(|axis: usize| (row[axis] - at * inverse[2][axis]) * far);
                let blur = self.blur * (slope[0] * slope[0] + slope[1] * slope[1]).sqrt();
                at.abs() < half + (1.0 - 2.2 * blur).max(-1.0)
            })
        })
    }

    /// A first idea of the light: black and white are where a tenth of the pixels is darker or brighter.
    fn light(&self, pixels: &Pixels) -> [f64; 4] {
        let mut counts = [0_usize; 256];
        pixels.values().iter().flatten().take(pixels.count).for_each(|value| counts[*value as usize & 255] += 1);
        let percentile = |part: usize| {
            let mut left = pixels.count * part / 10;
            let value = counts.iter().position(|count| {
                let found = left < *count;
                left = left.saturating_sub(*count);
                found
            });
            value.unwrap_or(0) as f64
        };
        let (low, high) = (percentile(1), percentile(9));
        if self.bright_inside { [high, 0.0, 0.0, low - high] } else { [low, 0.0, 0.0, high - low] }
    }

    fn model<'a>(&self, marks: &'a Marks, state: &State, scale: f64) -> Result<Model<'a>, Weakness> {
        Ok(Model {
            marks,
            inverse: inverse(&state.map)?.map(|row| row.map(|number| number as f32)),
            blur: state.blur.map(|number| number as f32),
            light: state.light.map(|number| number as f32),
            tone: state.tone as f32,
            size: self.reach().max(1.0) as f32 * 4.0,
            believed: (BELIEVED * scale) as f32,
        })
    }
}

impl State {
    /// One Gauss-Newton step.
    fn step(&mut self, sums: &Sums, scale: f64) -> Result<Normal, Weakness> {
        let mut matrix = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::from_fn(|i, k| sums[i.min(k)][i.max(k)]);
        let mut gradient = SVector::<f64, UNKNOWNS>::from_fn(|i, _| sums[i][UNKNOWNS]);
        let certainty = certainty(scale);
        matrix[(15, 15)] += certainty;
        gradient[15] -= certainty * self.tone;
        // Each unknown in its own unit, and a trace of damping for what the picture does not tell.
        let units = matrix.diagonal().map(|value| if value > 0.0 { 1.0 / value.sqrt() } else { 1.0 });
        let mut scaled = matrix.component_mul(&(units * units.transpose()));
        for k in 0..UNKNOWNS {
            scaled[(k, k)] = 1.0 + DAMPING;
        }
        let factor = scaled.cholesky().ok_or(Weakness::TooUncertain)?;
        let step = factor.solve(&gradient.component_mul(&units)).component_mul(&units);
        if step.iter().any(|step| !step.is_finite()) {
            return Err(Weakness::TooUncertain);
        }
        self.map.add([0, 1, 2, 3, 4, 5, 6, 7].map(|k: usize| step[k]));
        self.blur = bounded(self.blur, [step[8], step[9], step[10]]);
        for (light, step) in self.light.iter_mut().zip([step[11], step[12], step[13], step[14]]) {
            *light += step;
        }
        self.tone = (self.tone + step[15]).clamp(-STEEPEST, STEEPEST);
        Ok(Normal { factor, units })
    }
}

impl Normal {
    /// The inverse of the normal matrix.
    fn inverse(&self) -> SMatrix<f64, UNKNOWNS, UNKNOWNS> {
        self.factor.inverse().component_mul(&(self.units * self.units.transpose()))
    }
}

/// A blur after a step, which is cut where it would leave the bounds.
fn bounded(blur: [f64; 3], step: [f64; 3]) -> [f64; 3] {
    let [low, high] = BLUR_BOUNDS.map(|bound| bound * bound);
    let mut part = 1.0;
    for _ in 0..6 {
        let [xx, xy, yy] = [0, 1, 2].map(|k: usize| blur[k] + part * step[k]);
        let (middle, apart) = ((xx + yy) / 2.0, ((xx - yy) / 2.0).hypot(xy));
        if middle - apart >= low && middle + apart <= high {
            return [xx, xy, yy];
        }
        part /= 2.0;
    }
    blur
}

/// How a place of the picture moves with the eight numbers of the map.
fn map_slopes(map: &Projection, [u, v]: [f64; 2], [x, y]: [f64; 2]) -> [SVector<f64, 8>; 2] {
    let w = map.depth([u, v]);
    let (u, v, one) = (u / w, v / w, 1.0 / w);
    [
        SVector::from([u, v, one, 0.0, 0.0, 0.0, -x * u, -x * v]),
        SVector::from([0.0, 0.0, 0.0, u, v, one, -y * u, -y * v]),
    ]
}

/// Picture to cells.
fn inverse(map: &Projection) -> Result<[[f64; 3]; 3], Weakness> {
    let inverse = map.matrix().try_inverse().ok_or(Weakness::NotAQuadrangle)?;
    Ok([0, 1, 2].map(|row: usize| [0, 1, 2].map(|column: usize| inverse[(row, column)])))
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}
