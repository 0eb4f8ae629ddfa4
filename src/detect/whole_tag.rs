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
//! How cells look when they are blurred is said in [`super::blurred_cells`].

use nalgebra::{SMatrix, SVector};

use super::blurred_cells::{Cells, MOST_CELLS, Meetings};
use super::edge_lines::Weakness;
use super::lens::Bender;
use super::picture::GreyPicture;
use super::projection::Projection;

/// Numbers that are fitted: eight of the map, three of the blur, four of the light, one of the tone.
const UNKNOWNS: usize = 16;
/// Bound of the tone: beyond it grey would not grow with light.
const STEEPEST: f64 = 0.95;
/// Standard deviation of the tone that is expected: an sRGB picture has 0.4 or so.
const USUAL_TONE: f64 = 0.3;
/// Gauss-Newton steps, at most.
const MOST_STEPS: usize = 16;
/// Part of a step of the blur that is taken.
const BLUR_STEP: f64 = 0.7;
/// Corners that move less than this (px) stand still.
const STILL: f64 = 4e-3;
/// Bounds of the blur, px.
const BLUR_BOUNDS: [f64; 2] = [0.3, 6.0];
/// Residuals are believed up to so many standard deviations.
const BELIEVED: f64 = 2.5;
/// Grey levels between black and white below which there is no tag.
const LEAST_CONTRAST: f64 = 8.0;
/// Part of the picture's variance that the fit must explain.
const EXPLAINED: f64 = 0.8;
/// Pixels that are looked at, at most: of a larger tag every second or third row and column.
const MOST_PIXELS: f64 = 2500.0;

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

/// One pixel: its ideal place from the tag's middle, and its value.
#[derive(Clone, Copy)]
struct Sample {
    place: [f64; 2],
    value: f64,
    /// Column and row on the grid of samples.
    grid: [u16; 2],
}

/// The state of the fit.
struct State {
    /// Unit square to ideal pixels from the tag's middle.
    map: Projection,
    /// Covariance `[xx, xy, yy]`, px^2.
    blur: [f64; 3],
    /// Dark, its slopes, contrast.
    light: [f64; 4],
    tone: f64,
}

impl WholeTag<'_> {
    /// Measures the corners, and the blur along its worst direction (px).
    pub fn fit(&self, picture: &GreyPicture, bender: &Bender<'_>) -> Result<([IdealCorner; 4], f64), Weakness> {
        let n = self.cells.per_side;
        if n == 0 || n > MOST_CELLS || self.cells.bright.len() != n * n {
            return Err(Weakness::TooFewEdges);
        }
        let middle = [0, 1].map(|axis: usize| self.ideal.iter().map(|corner| corner[axis]).sum::<f64>() / 4.0);
        let around = |corner: [f64; 2]| [corner[0] - middle[0], corner[1] - middle[1]];
        let map = Projection::from_unit_square(self.ideal.map(around)).ok_or(Weakness::NotAQuadrangle)?;
        let samples = self.samples(picture, bender, &map, middle)?;
        if samples.len() < 4 * UNKNOWNS {
            return Err(Weakness::TooFewEdges);
        }
        let round = self.blur.clamp(BLUR_BOUNDS[0], BLUR_BOUNDS[1]).powi(2);
        let mut state = State { map, blur: [round, 0.0, round], light: [0.0; 4], tone: 0.0 };
        let meetings = self.cells.meetings();
        let mut residuals = vec![0.0; samples.len()];
        // Light alone first: nothing is known of it.
        self.step(&samples, &meetings, &mut state, None, &mut residuals)?;
        let mut scale = spread(&residuals);
        let mut inverse = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::zeros();
        let mut still = false;
        for _ in 0..MOST_STEPS {
            let before = state.map.corners();
            inverse = self.step(&samples, &meetings, &mut state, Some(scale), &mut residuals)?;
            let after = state.map.corners();
            scale = spread(&residuals);
            let moved = (0..4).map(|k| distance(before[k], after[k])).fold(0.0, f64::max);
            if moved < STILL {
                still = true;
                break;
            }
            if (0..4).any(|k| distance(after[k], around(self.ideal[k])) > self.reach()) {
                return Err(Weakness::MovedTooFar);
            }
        }
        if !still {
            return Err(Weakness::NotStraight);
        }
        let (variance, explained) = judged(&samples, &residuals, scale);
        let contrast = if self.bright_inside { -state.light[3] } else { state.light[3] };
        if contrast.is_nan() || contrast < LEAST_CONTRAST {
            return Err(Weakness::NoContrast);
        }
        if explained.is_nan() || explained < EXPLAINED {
            return Err(Weakness::NotStraight);
        }
        let corners = state.map.corners();
        let mut found = [([0.0; 2], [0.0; 3]); 4];
        for (k, unit) in [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].into_iter().enumerate() {
            let [x, y] = map_slopes(&state.map, unit, corners[k]);
            let block = inverse.fixed_view::<8, 8>(0, 0);
            let product = |a: &SVector<f64, 8>, b: &SVector<f64, 8>| variance * a.dot(&(block * b));
            let pixel = [corners[k][0] + middle[0], corners[k][1] + middle[1]];
            found[k] = (pixel, [product(&x, &x), product(&x, &y), product(&y, &y)]);
        }
        let [xx, xy, yy] = state.blur;
        let worst = (xx + yy) / 2.0 + ((xx - yy) / 2.0).hypot(xy);
        Ok((found, worst.sqrt()))
    }

    /// How far a corner may move, px.
    fn reach(&self) -> f64 {
        let shortest = (0..4).map(|k| distance(self.ideal[k], self.ideal[(k + 1) % 4])).fold(f64::MAX, f64::min);
        (0.15 * shortest).max(3.0).min(1.5 * shortest / self.cells.per_side as f64 + 0.5)
    }

    /// The pixels on the tag and on as much of the margin as surely is one.
    fn samples(
        &self,
        picture: &GreyPicture,
        bender: &Bender<'_>,
        map: &Projection,
        middle: [f64; 2],
    ) -> Result<Vec<Sample>, Weakness> {
        let inverse = Inverse::of(map).ok_or(Weakness::NotAQuadrangle)?;
        let cell = 1.0 / self.cells.per_side as f64;
        let (mut low, mut high) = ([f64::MAX; 2], [f64::MIN; 2]);
        for unit in [[-cell, -cell], [1.0 + cell, -cell], [1.0 + cell, 1.0 + cell], [-cell, 1.0 + cell]] {
            let [x, y] = map.map(unit);
            let pixel = bender.distort([x + middle[0], y + middle[1]])?;
            for axis in 0..2 {
                low[axis] = low[axis].min(pixel[axis]);
                high[axis] = high[axis].max(pixel[axis]);
            }
        }
        let extent = [picture.width(), picture.height()];
        // Conversion to integers cuts towards zero and saturates.
        let [columns, rows] = [0, 1]
            .map(|axis: usize| low[axis].max(0.0) as usize..(high[axis] as usize).saturating_add(1).min(extent[axis]));
        let every = (((high[0] - low[0]) * (high[1] - low[1]) / MOST_PIXELS).sqrt().ceil() as usize).max(1);
        let mut samples = Vec::new();
        for (j, row) in rows.step_by(every).enumerate() {
            for (i, column) in columns.clone().step_by(every).enumerate() {
                let [x, y] = bender.undistort([column as f64, row as f64])?;
                let place = [x - middle[0], y - middle[1]];
                let ([u, v], slopes) = inverse.at(place);
                // Beyond the margin, which may be one cell wide only, anything may be; its blur reaches in.
                let within = |at: f64, slope: [f64; 2]| {
                    let blur = self.blur * slope[0].hypot(slope[1]);
                    let margin = (cell - 2.2 * blur).max(-cell);
                    (-margin..1.0 + margin).contains(&at)
                };
                if within(u, slopes[0])
                    && within(v, slopes[1])
                    && let Some(value) = picture.pixel(column, row)
                {
                    samples.push(Sample { place, value: f64::from(value), grid: [i as u16, j as u16] });
                }
            }
        }
        Ok(samples)
    }

    /// One Gauss-Newton step, of the light alone if there is no scale of the residuals yet. Residuals are those before it.
    /// Returns the inverse of the normal matrix.
    fn step(
        &self,
        samples: &[Sample],
        meetings: &Meetings,
        state: &mut State,
        scale: Option<f64>,
        residuals: &mut [f64],
    ) -> Result<SMatrix<f64, UNKNOWNS, UNKNOWNS>, Weakness> {
        let inverse = Inverse::of(&state.map).ok_or(Weakness::NotAQuadrangle)?;
        let size = self.reach().max(1.0) * 4.0;
        let n = self.cells.per_side as f64;
        let [xx, xy, yy] = state.blur;
        let mut normal_matrix = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::zeros();
        let mut gradient = SVector::<f64, UNKNOWNS>::zeros();
        for (sample, residual) in samples.iter().zip(residuals.iter_mut()) {
            let [x, y] = sample.place;
            let ([u, v], slopes) = inverse.at(sample.place);
            // In cells.
            let [du, dv] = slopes.map(|slope| slope.map(|slope| slope * n));
            let product =
                |a: [f64; 2], b: [f64; 2]| a[0] * b[0] * xx + (a[0] * b[1] + a[1] * b[0]) * xy + a[1] * b[1] * yy;
            let look = self.cells.look(meetings, [u * n, v * n], [product(du, du), product(du, dv), product(dv, dv)]);
            let [dark, a, b, contrast] = state.light;
            let between = look.value * (1.0 - look.value);
            let toned = look.value + state.tone * between;
            *residual = sample.value - (dark + a * x / size + b * y / size + contrast * toned);
            let mut row = SVector::<f64, UNKNOWNS>::zeros();
            if scale.is_some() {
                row[15] = contrast * between;
                let contrast = contrast * (1.0 + state.tone * (1.0 - 2.0 * look.value));
                // A place that the map moves by d sees what was d before it.
                let slope = [0, 1].map(|axis: usize| -contrast * (look.slope[0] * du[axis] + look.slope[1] * dv[axis]));
                let [mx, my] = map_slopes(&state.map, [u, v], sample.place);
                row.fixed_rows_mut::<8>(0).copy_from(&(mx * slope[0] + my * slope[1]));
                // The equation of heat: blur changes values by half their curvature.
                let [uu, uv, vv] = look.curvature;
                let curved =
                    |a: usize, b: usize| du[a] * du[b] * uu + (du[a] * dv[b] + du[b] * dv[a]) * uv + dv[a] * dv[b] * vv;
                row[8] = contrast * 0.5 * curved(0, 0);
                row[9] = contrast * curved(0, 1);
                row[10] = contrast * 0.5 * curved(1, 1);
            }
            row[11] = 1.0;
            row[12] = x / size;
            row[13] = y / size;
            row[14] = toned;
            let weight = scale.map_or(1.0, |scale| (BELIEVED * scale / residual.abs().max(1e-9)).min(1.0));
            normal_matrix.ger(weight, &row, &row, 1.0);
            gradient.axpy(weight * *residual, &row, 1.0);
        }
        if let Some(scale) = scale {
            let certainty = (scale / USUAL_TONE).powi(2);
            normal_matrix[(15, 15)] += certainty;
            gradient[15] -= certainty * state.tone;
        }
        // Each unknown in its own unit, and a trace of damping for what the picture does not tell.
        let units = normal_matrix.diagonal().map(|value| if value > 0.0 { 1.0 / value.sqrt() } else { 1.0 });
        let mut scaled = normal_matrix.component_mul(&(units * units.transpose()));
        for k in 0..UNKNOWNS {
            scaled[(k, k)] = if normal_matrix[(k, k)] > 0.0 { 1.0 + 1e-9 } else { 1.0 };
        }
        let factor = scaled.cholesky().ok_or(Weakness::TooUncertain)?;
        let step = factor.solve(&gradient.component_mul(&units)).component_mul(&units);
        if step.iter().any(|step| !step.is_finite()) {
            return Err(Weakness::TooUncertain);
        }
        let covariance = factor.inverse().component_mul(&(units * units.transpose()));
        if scale.is_some() {
            state.map.add([0, 1, 2, 3, 4, 5, 6, 7].map(|k: usize| step[k]));
            // The slopes leave the correlation aside, and with it the whole step would swing to and fro.
            state.tone = (state.tone + step[15]).clamp(-STEEPEST, STEEPEST);
            state.blur = bounded(state.blur, [step[8], step[9], step[10]].map(|step| BLUR_STEP * step));
        }
        for (light, step) in state.light.iter_mut().zip([step[11], step[12], step[13], step[14]]) {
            *light += step;
        }
        Ok(covariance)
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

/// Picture to unit square.
struct Inverse([[f64; 3]; 3]);

impl Inverse {
    fn of(map: &Projection) -> Option<Self> {
        let inverse = map.matrix().try_inverse()?;
        Some(Self([0, 1, 2].map(|row: usize| [0, 1, 2].map(|column: usize| inverse[(row, column)]))))
    }

    /// The place in the unit square, and the slopes of its two coordinates.
    fn at(&self, [x, y]: [f64; 2]) -> ([f64; 2], [[f64; 2]; 2]) {
        let [a, b, c] = self.0.map(|row| row[0] * x + row[1] * y + row[2]);
        let place = [a / c, b / c];
        let slopes =
            [0, 1].map(|k: usize| [0, 1].map(|axis: usize| (self.0[k][axis] - place[k] * self.0[2][axis]) / c));
        (place, slopes)
    }
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// A robust standard deviation; at least half a grey level.
fn spread(residuals: &[f64]) -> f64 {
    let mut sizes: Vec<f64> = residuals.iter().map(|residual| residual.abs()).collect();
    let middle = sizes.len() / 2;
    (1.4826 * *sizes.select_nth_unstable_by(middle, f64::total_cmp).1).max(0.5)
}

/// The variance that the inverse of the normal matrix is to be multiplied by, and the part of the picture that is explained.
///
/// Residuals of neighbours are alike where the model is not quite right, and what is alike is not averaged away: the variance is that of a first-order
/// autoregressive process in both directions.
fn judged(samples: &[Sample], residuals: &[f64], scale: f64) -> (f64, f64) {
    let count = samples.len() as f64;
    let believed = |k: usize| residuals[k].clamp(-BELIEVED * scale, BELIEVED * scale);
    let squares: f64 = (0..samples.len()).map(|k| believed(k).powi(2)).sum();
    let mean = samples.iter().map(|sample| sample.value).sum::<f64>() / count;
    let all: f64 = samples.iter().map(|sample| (sample.value - mean).powi(2)).sum();
    let (mut beside, mut pairs_beside, mut below, mut pairs_below) = (0.0, 0.0, 0.0, 0.0);
    // Samples are sorted by row, then column, so the one below is found by walking along.
    let mut under = 0;
    for (k, sample) in samples.iter().enumerate() {
        let [column, row] = sample.grid;
        if samples.get(k + 1).is_some_and(|next| next.grid == [column + 1, row]) {
            beside += believed(k) * believed(k + 1);
            pairs_beside += 1.0;
        }
        while samples.get(under).is_some_and(|other| (other.grid[1], other.grid[0]) < (row + 1, column)) {
            under += 1;
        }
        if samples.get(under).is_some_and(|other| other.grid == [column, row + 1]) {
            below += believed(k) * believed(under);
            pairs_below += 1.0;
        }
    }
    let variance = squares / (count - UNKNOWNS as f64).max(1.0);
    let alike = |sum: f64, pairs: f64| {
        let correlation = (sum / f64::max(pairs, 1.0) / (squares / count)).clamp(0.0, 0.9);
        (1.0 + correlation) / (1.0 - correlation)
    };
    (variance * alike(beside, pairs_beside) * alike(below, pairs_below), 1.0 - squares / all)
}
