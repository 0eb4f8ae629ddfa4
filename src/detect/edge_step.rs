//! A blurred step at some stations at once: what it says of their pixels, and one Gauss-Newton step of its fit to them.
//!
//! The formula stands in [`super::edge_stations`].

use pulp::Simd;

use super::edge_stations::Group;
use super::wide::{Truths, Wide, lanes, normal};

/// What some stations say of a pixel by its distance.
pub(super) struct Shape<S: Simd> {
    edge: Wide<S>,
    inner: Wide<S>,
    shine: Wide<S>,
    shines: bool,
    tone: f32,
    /// Pixels farther in and out are not used.
    low: Wide<S>,
    high: Wide<S>,
    pub sharpness: Wide<S>,
}

/// Whether a pixel is used (1 or 0), and where it is the step there, its slope by the distance in blurs, its slope by the blur.
pub(super) struct Seen<S: Simd> {
    pub w: Wide<S>,
    pub phi: Wide<S>,
    pub slope: Wide<S>,
    pub dh: Wide<S>,
}

// Functions and no closures: only so does all of it get the wide instructions.
impl<S: Simd> Shape<S> {
    #[inline(always)]
    pub fn of(simd: S, group: &Group, part: usize, [blur, tone]: [f32; 2], widest: f32) -> Self {
        let inner = lanes(simd, &group.inner, part);
        Self {
            edge: lanes(simd, &group.edge, part),
            inner,
            shine: lanes(simd, &group.shine, part),
            shines: group.shine.iter().any(|shine| *shine > 0.0),
            tone,
            low: -gate(simd, inner, [blur, tone], widest),
            high: gate(simd, lanes(simd, &group.outer, part), [blur, -tone], widest),
            sharpness: Wide::splat(simd, 1.0 / blur),
        }
    }

    #[inline(always)]
    pub fn at(&self, simd: S, d: Wide<S>) -> Seen<S> {
        let number = |value: f32| Wide::splat(simd, value);
        let (zero, one) = (number(0.0), number(1.0));
        let w = self.low.less(d).and(d.less(self.high)).choose(one, zero);
        let z = (d - self.edge) * self.sharpness;
        let (mut phi, mut density) = normal(simd, z);
        let mut dh = density * z;
        if self.shines {
            let z = -(d + self.inner) * self.sharpness;
            let (behind, density) = normal(simd, z);
            phi = phi + self.shine * behind;
            dh = dh + self.shine * density * z;
        }
        if self.tone != 0.0 {
            let steeper = one + number(self.tone) * (one - phi - phi);
            phi = phi + number(self.tone) * phi * (one - phi);
            density = density * steeper;
            dh = dh * steeper;
        }
        Seen { w, phi: w * phi, slope: w * density, dh: w * dh }
    }
}

/// How far from an edge pixels may be used: to where the next edge, one cell away, has faded. The tone makes more of it on the one side than on the other.
#[inline(always)]
fn gate<S: Simd>(simd: S, cell: Wide<S>, [blur, more]: [f32; 2], widest: f32) -> Wide<S> {
    let number = |value: f32| Wide::splat(simd, value);
    let more = more.max(0.0);
    (cell - number((2.0 + more) * blur)).max(number(0.55 - 0.1 * more) * cell).min(number(widest.min(4.5 * blur)))
}

/// Sums over the pixels of some stations: how many, the step p, its slope g by the edge, and their products.
#[derive(Clone, Copy)]
pub(super) struct ModelSums<S: Simd> {
    pub n: Wide<S>,
    pub p: Wide<S>,
    pub pp: Wide<S>,
    pub g: Wide<S>,
    pub gp: Wide<S>,
    pub gg: Wide<S>,
}

/// Sums of the values v, and of their products with the same.
pub(super) struct ValueSums<S: Simd> {
    pub v: Wide<S>,
    pub pv: Wide<S>,
    pub vv: Wide<S>,
    pub gv: Wide<S>,
}

/// One Gauss-Newton step at some stations; none, and no information, where they are not sound.
pub(super) struct Found<S: Simd> {
    pub sound: Truths<S>,
    pub dark: Wide<S>,
    pub contrast: Wide<S>,
    pub step: Wide<S>,
    pub information: Wide<S>,
    pub noise: Wide<S>,
}

impl<S: Simd> ModelSums<S> {
    #[inline(always)]
    fn inverse(&self, simd: S) -> (Truths<S>, Wide<S>) {
        let number = |value: f32| Wide::splat(simd, value);
        let determinant = self.n * self.pp - self.p * self.p;
        let enough = number(4.5).less(self.n).and((number(1e-3) * self.n).less(determinant));
        (enough, enough.choose(determinant, number(1.0)).inverse())
    }

    /// The sum of squares of a slope, by its sum, its products with the step and its squares, without what dark and contrast explain.
    #[inline(always)]
    pub fn project(&self, simd: S, [a, ap, aa]: [Wide<S>; 3]) -> Wide<S> {
        let two = Wide::splat(simd, 2.0);
        aa - (self.pp * a * a - two * self.p * a * ap + self.n * ap * ap) * self.inverse(simd).1
    }

    #[inline(always)]
    pub fn solve(&self, simd: S, values: ValueSums<S>, edge: Wide<S>, widest: f32) -> Found<S> {
        let number = |value: f32| Wide::splat(simd, value);
        let (zero, one) = (number(0.0), number(1.0));
        let Self { n, p, g, gp, gg, .. } = *self;
        let ValueSums { v, pv, vv, gv } = values;
        let (enough, inverse) = self.inverse(simd);
        let contrast = (n * pv - p * v) * inverse;
        let dark = (v - contrast * p) * n.max(one).inverse();
        let square = contrast * contrast;
        let information = square * self.project(simd, [g, gp, gg]);
        // Enough samples, a step among them, a rise outwards, and an edge within reach.
        let sound = enough
            .and(number(4.0).less(contrast))
            .and((number(1e-6) * square * gg).less(information))
            .and(edge.abs().less(number(widest)));
        let gradient = -contrast * (gv - dark * g - contrast * gp);
        let step = sound.choose(gradient * sound.choose(information, one).inverse(), zero);
        let squares = vv - dark * v - contrast * pv - step * step * information;
        let noise = squares.max(zero) * (n - number(3.0)).max(one).inverse();
        let step = step.max(number(-1.0)).min(one);
        Found { sound, dark, contrast, step, information: sound.choose(information, zero), noise }
    }
}
