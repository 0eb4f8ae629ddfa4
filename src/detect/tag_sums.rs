//! One pass over a tag's pixels: what the model says of each, what is left, and the sums of products that a Gauss-Newton step needs.
//!
//! Single precision throughout; sums are kept lane by lane, so that they are the same bits on every machine.

use pulp::{Simd, WithSimd};

use super::blurred_cells::{Edges, Marks, Places};
use super::tag_pixels::{Group, Pixels};
use super::wide::{LANES, Lanes, Wide, dispatch, lanes, store};

/// Numbers that are fitted: eight of the map, three of the blur, four of the light, one of the tone.
pub(super) const UNKNOWNS: usize = 16;
/// Slopes by the unknowns, and the residual.
const COLUMNS: usize = UNKNOWNS + 1;
/// Groups of pixels whose slopes are kept before their products are summed.
const TOGETHER: usize = 32;

/// What the pixels are compared with.
#[derive(Debug, Clone, Copy)]
pub(super) struct Model<'a> {
    pub marks: &'a Marks,
    /// Picture, from the tag's middle, to cells, from theirs.
    pub inverse: [[f32; 3]; 3],
    /// Covariance `[xx, xy, yy]`, px^2.
    pub blur: [f32; 3],
    /// Dark, its slopes (by places over `size`), contrast.
    pub light: [f32; 4],
    pub tone: f32,
    pub size: f32,
    /// Residuals beyond this weigh less.
    pub believed: f32,
}

/// Slopes of eight pixels by the unknowns.
pub(super) type Slopes = [Lanes; UNKNOWNS];

/// Products of slopes, `[i][k]` for `k >= i`; the last column is the residual's.
pub(super) type Sums = [[f64; COLUMNS]; COLUMNS];

impl Model<'_> {
    /// Sums over all pixels. The residuals, pixel less model, are put one group after the other.
    pub fn sums(&self, pixels: &Pixels, residuals: &mut Vec<Lanes>) -> Sums {
        residuals.clear();
        residuals.resize(pixels.groups.len(), [0.0; LANES]);
        dispatch(Pass { model: self, groups: &pixels.groups, residuals })
    }

    /// What the model says of each pixel, and its slopes. Where there is no pixel they are 0.
    pub fn linearised(&self, pixels: &Pixels) -> (Vec<Lanes>, Vec<Slopes>) {
        let count = pixels.groups.len();
        let (mut expected, mut slopes) = (vec![[0.0; LANES]; count], vec![[[0.0; LANES]; UNKNOWNS]; count]);
        dispatch(Linearise { model: self, groups: &pixels.groups, expected: &mut expected, slopes: &mut slopes });
        (expected, slopes)
    }
}

type Rows = [[Lanes; COLUMNS]; TOGETHER];

struct Pass<'a> {
    model: &'a Model<'a>,
    groups: &'a [Group],
    residuals: &'a mut [Lanes],
}

impl WithSimd for Pass<'_> {
    type Output = Sums;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Sums {
        let mut rows: Rows = [[[0.0; LANES]; COLUMNS]; TOGETHER];
        let mut sums = [[[0.0; LANES]; COLUMNS]; COLUMNS];
        let mut edges = Edges::new(simd);
        for (groups, residuals) in self.groups.chunks(TOGETHER).zip(self.residuals.chunks_mut(TOGETHER)) {
            for ((group, residual), row) in groups.iter().zip(residuals).zip(&mut rows) {
                self.model.slopes(simd, group, residual, row, &mut edges);
            }
            let rows = &rows[..groups.len()];
            for part in 0..LANES / S::F32_LANES {
                products(simd, rows, part, &mut sums);
            }
        }
        sums.map(|line| line.map(|lanes| lanes.iter().map(|value| f64::from(*value)).sum()))
    }
}

struct Linearise<'a> {
    model: &'a Model<'a>,
    groups: &'a [Group],
    expected: &'a mut [Lanes],
    slopes: &'a mut [Slopes],
}

impl WithSimd for Linearise<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let mut edges = Edges::new(simd);
        let mut row = [[0.0; LANES]; COLUMNS];
        for ((group, expected), slopes) in self.groups.iter().zip(self.expected).zip(self.slopes) {
            let mut residual = [0.0; LANES];
            self.model.slopes(simd, group, &mut residual, &mut row, &mut edges);
            *expected = std::array::from_fn(|lane| group.value[lane] - residual[lane]);
            slopes.copy_from_slice(&row[..UNKNOWNS]);
        }
    }
}

/// One step with slopes that are kept: takes from the residuals what an earlier step explains, and sums up slopes times residuals for the next.
/// Residuals beyond `believed` count as if they were there.
pub(super) fn gradient(
    slopes: &[Slopes],
    step: [f32; UNKNOWNS],
    believed: f32,
    residuals: &mut [Lanes],
) -> [f64; UNKNOWNS] {
    dispatch(Gradient { slopes, step, believed, residuals })
}

struct Gradient<'a> {
    slopes: &'a [Slopes],
    step: [f32; UNKNOWNS],
    believed: f32,
    residuals: &'a mut [Lanes],
}

impl WithSimd for Gradient<'_> {
    type Output = [f64; UNKNOWNS];

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> [f64; UNKNOWNS] {
        let mut sums = [[0.0; LANES]; UNKNOWNS];
        let (low, high) = (Wide::splat(simd, -self.believed), Wide::splat(simd, self.believed));
        for part in 0..LANES / S::F32_LANES {
            let mut kept = [Wide::splat(simd, 0.0); UNKNOWNS];
            for (slopes, residual) in self.slopes.iter().zip(self.residuals.iter_mut()) {
                let mut left = lanes(simd, residual, part);
                for (slope, step) in slopes.iter().zip(self.step) {
                    left = left - lanes(simd, slope, part) * Wide::splat(simd, step);
                }
                store(residual, part, left);
                let believed = left.max(low).min(high);
                for (kept, slope) in kept.iter_mut().zip(slopes) {
                    *kept = *kept + lanes(simd, slope, part) * believed;
                }
            }
            for (sum, kept) in sums.iter_mut().zip(kept) {
                store(sum, part, kept);
            }
        }
        sums.map(|lanes| lanes.iter().map(|value| f64::from(*value)).sum())
    }
}

impl Model<'_> {
    /// Residuals and slopes of one group, times the root of their weights.
    #[inline(always)]
    fn slopes<S: Simd>(
        &self,
        simd: S,
        group: &Group,
        residuals: &mut Lanes,
        rows: &mut [Lanes; COLUMNS],
        edges: &mut Edges<S>,
    ) {
        let inverse = Inverse {
            u: three(simd, self.inverse[0]),
            v: three(simd, self.inverse[1]),
            depth: three(simd, self.inverse[2]),
        };
        let number = |value: f32| Wide::splat(simd, value);
        let half = number(0.5 * self.marks.per_side as f32);
        let blur = three(simd, self.blur);
        let parts = LANES / S::F32_LANES;
        let mut places = Places { at: [[0.0; LANES]; 2], blur: [[0.0; LANES]; 3] };
        // The cells that any of the eight sees are looked at from all of them, so all places come first.
        for part in 0..parts {
            let (x, y) = (lanes(simd, &group.x, part), lanes(simd, &group.y, part));
            let Seen { u, v, du, dv, .. } = inverse.see(x, y);
            store(&mut places.at[0], part, u + half);
            store(&mut places.at[1], part, v + half);
            store(&mut places.blur[0], part, twice(blur, du, du));
            store(&mut places.blur[1], part, twice(blur, du, dv));
            store(&mut places.blur[2], part, twice(blur, dv, dv));
        }
        for part in 0..parts {
            let (x, y) = (lanes(simd, &group.x, part), lanes(simd, &group.y, part));
            let Seen { u, v, du, dv, depth } = inverse.see(x, y);
            let look = self.marks.look(simd, &places, part, edges);
            let ([dark, a, b], contrast) =
                (three(simd, [self.light[0], self.light[1], self.light[2]]), number(self.light[3]));
            let (one, smaller) = (number(1.0), number(1.0 / self.size));
            let between = look.value * (one - look.value);
            let toned = look.value + number(self.tone) * between;
            let (across, down) = (x * smaller, y * smaller);
            let residual = lanes(simd, &group.value, part) - (dark + a * across + b * down + contrast * toned);
            store(residuals, part, residual);
            let weight = (number(self.believed) * residual.abs().max(number(1e-6)).inverse()).min(one);
            let root = weight.sqrt() * lanes(simd, &group.filled, part);
            let steep = root * contrast * (one + number(self.tone) * (one - number(2.0) * look.value));
            // A place that the map moves by d sees what was d before it.
            let [by_u, by_v] = look.slope;
            let slope = [-steep * (by_u * du[0] + by_v * dv[0]), -steep * (by_u * du[1] + by_v * dv[1])];
            let (here, u, v) = (depth, u * depth, v * depth);
            let ahead = -(x * slope[0] + y * slope[1]);
            // The equation of heat: blur changes values by half their curvature.
            let curved = look.curvature;
            let (by_x, by_y) = ([du[0], dv[0]], [du[1], dv[1]]);
            let half = number(0.5) * steep;
            let row = [
                slope[0] * u,
                slope[0] * v,
                slope[0] * here,
                slope[1] * u,
                slope[1] * v,
                slope[1] * here,
                ahead * u,
                ahead * v,
                half * twice(curved, by_x, by_x),
                steep * twice(curved, by_x, by_y),
                half * twice(curved, by_y, by_y),
                root,
                root * across,
                root * down,
                root * toned,
                root * contrast * between,
                root * residual,
            ];
            for (lanes, value) in rows.iter_mut().zip(&row) {
                store(lanes, part, *value);
            }
        }
    }
}

/// Where a pixel is among the cells, counted from their middle.
struct Seen<S: Simd> {
    u: Wide<S>,
    v: Wide<S>,
    /// Slopes of u and v by x and y.
    du: [Wide<S>; 2],
    dv: [Wide<S>; 2],
    /// One over the depth of the map from cells to pixels.
    depth: Wide<S>,
}

/// Picture to cells.
struct Inverse<S: Simd> {
    u: [Wide<S>; 3],
    v: [Wide<S>; 3],
    depth: [Wide<S>; 3],
}

// Functions and no closures: only so does all of it get the wide instructions.
impl<S: Simd> Inverse<S> {
    #[inline(always)]
    fn see(&self, x: Wide<S>, y: Wide<S>) -> Seen<S> {
        let depth = along(self.depth, x, y);
        let far = depth.inverse();
        let (u, v) = (along(self.u, x, y) * far, along(self.v, x, y) * far);
        let du = [(self.u[0] - u * self.depth[0]) * far, (self.u[1] - u * self.depth[1]) * far];
        let dv = [(self.v[0] - v * self.depth[0]) * far, (self.v[1] - v * self.depth[1]) * far];
        Seen { u, v, du, dv, depth }
    }
}

#[inline(always)]
fn along<S: Simd>(row: [Wide<S>; 3], x: Wide<S>, y: Wide<S>) -> Wide<S> {
    row[0] * x + row[1] * y + row[2]
}

#[inline(always)]
fn three<S: Simd>(simd: S, [a, b, c]: [f32; 3]) -> [Wide<S>; 3] {
    [Wide::splat(simd, a), Wide::splat(simd, b), Wide::splat(simd, c)]
}

/// A symmetric form `[xx, xy, yy]` of two vectors.
#[inline(always)]
fn twice<S: Simd>(form: [Wide<S>; 3], a: [Wide<S>; 2], b: [Wide<S>; 2]) -> Wide<S> {
    a[0] * b[0] * form[0] + (a[0] * b[1] + a[1] * b[0]) * form[1] + a[1] * b[1] * form[2]
}

/// Adds the products of the columns `FROM..TO` with column `I`.
#[inline(always)]
fn product<S: Simd, const I: usize, const FROM: usize, const TO: usize>(
    simd: S,
    rows: &[[Lanes; COLUMNS]],
    part: usize,
    sums: &mut [[Lanes; COLUMNS]; COLUMNS],
) {
    let mut kept = [Wide::splat(simd, 0.0); COLUMNS];
    for k in FROM..TO {
        kept[k] = lanes(simd, &sums[I][k], part);
    }
    for row in rows {
        let first = lanes(simd, &row[I], part);
        for k in FROM..TO {
            kept[k] = kept[k] + first * lanes(simd, &row[k], part);
        }
    }
    for k in FROM..TO {
        store(&mut sums[I][k], part, kept[k]);
    }
}

/// Adds all products. (Spelt out, so that sums stay in registers.)
#[inline(always)]
fn products<S: Simd>(simd: S, rows: &[[Lanes; COLUMNS]], part: usize, sums: &mut [[Lanes; COLUMNS]; COLUMNS]) {
    product::<S, 0, 0, 9>(simd, rows, part, sums);
    product::<S, 0, 9, 17>(simd, rows, part, sums);
    product::<S, 1, 1, 9>(simd, rows, part, sums);
    product::<S, 1, 9, 17>(simd, rows, part, sums);
    product::<S, 2, 2, 9>(simd, rows, part, sums);
    product::<S, 2, 9, 17>(simd, rows, part, sums);
    product::<S, 3, 3, 17>(simd, rows, part, sums);
    product::<S, 4, 4, 17>(simd, rows, part, sums);
    product::<S, 5, 5, 17>(simd, rows, part, sums);
    product::<S, 6, 6, 17>(simd, rows, part, sums);
    product::<S, 7, 7, 17>(simd, rows, part, sums);
    product::<S, 8, 8, 17>(simd, rows, part, sums);
    product::<S, 9, 9, 17>(simd, rows, part, sums);
    product::<S, 10, 10, 17>(simd, rows, part, sums);
    product::<S, 11, 11, 17>(simd, rows, part, sums);
    product::<S, 12, 12, 17>(simd, rows, part, sums);
    product::<S, 13, 13, 17>(simd, rows, part, sums);
    product::<S, 14, 14, 17>(simd, rows, part, sums);
    product::<S, 15, 15, 17>(simd, rows, part, sums);
    product::<S, 16, 16, 17>(simd, rows, part, sums);
}
