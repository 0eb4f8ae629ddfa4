//! The pixels along a side of a tag, in stations, and a blurred step fitted at each of them.
//!
//! A station is a few columns (or rows) of pixels across the side, each pixel with its distance from the side and its value. At each station
//!
//! ```text
//! value(d) = dark + contrast * (Phi((d - edge) / blur) + shine * Phi(-(d + cell) / blur))
//! ```
//!
//! is fitted by Gauss-Newton on the edge, with dark and contrast, which are linear, solved for outright (variable
//! projection: it converges from a pixel away). `blur` is common to the side. `shine` is how much of the next cell inwards
//! is bright at that place; it is known once the tag has been read, and it matters where cells are only a few blurs wide.
//!
//! Where the camera does not answer to light in proportion, the bracket is `p + tone * p (1 - p)` in place of p; see [`super::edge_tone`].
//!
//! Eight stations are worked on at once, each in its own lane of a wide register: that is what makes the measuring of a tag
//! cost some forty microseconds. All numbers are single precision; rounding is a thousandth of what noise leaves.

use pulp::{Simd, WithSimd};

use super::edge_step::{Found, ModelSums, Seen, Shape, ValueSums};
use super::wide::{LANES, Lanes, Wide, dispatch, lanes, store};

/// A distance that no gate lets in.
const FAR: f32 = 1e3;
/// Values are counted from the middle of the range, which keeps sums of squares small.
pub(super) const MIDDLE: f32 = 128.0;

/// A blurred step at one station.
#[derive(Debug, Clone, Copy)]
pub(super) struct Step {
    /// Mean place along the side, px.
    pub u: f64,
    pub edge: f64,
    pub contrast: f64,
    /// Variance of `edge` in px^2 for pixel noise of variance 1.
    pub information_inverse: f64,
    /// Variance of a grey value about the step.
    pub noise: f64,
}

/// What edges look like.
#[derive(Debug, Clone, Copy)]
pub(super) struct Profile {
    /// Standard deviation, px.
    pub blur: f64,
    pub tone: f64,
}

/// Eight stations.
#[derive(Debug, Clone, Copy)]
pub(super) struct Group {
    /// Where its samples begin.
    pub first: usize,
    /// Sum of places along the side, then their mean.
    pub u: Lanes,
    count: Lanes,
    /// Widths of the cells inside and outside, px.
    pub inner: Lanes,
    pub outer: Lanes,
    pub shine: Lanes,
    pub edge: Lanes,
    contrast: Lanes,
    projected: Lanes,
    noise: Lanes,
}

const EMPTY: Group = Group {
    first: 0,
    u: [0.0; LANES],
    count: [0.0; LANES],
    inner: [1.0; LANES],
    outer: [1.0; LANES],
    shine: [0.0; LANES],
    edge: [0.0; LANES],
    contrast: [0.0; LANES],
    projected: [0.0; LANES],
    noise: [0.0; LANES],
};

/// A row or a column of pixels, or a part of one.
#[derive(Debug, Clone, Copy)]
pub(super) struct Line {
    /// Place of the first one in the picture, how far it is from one to the next there, how many.
    pub first: usize,
    pub stride: usize,
    pub count: usize,
    /// Where they stand among the samples, and their station's lane.
    pub at: usize,
    pub lane: usize,
}

/// The stations of one side.
#[derive(Debug, Default)]
pub(super) struct Stations {
    pub groups: Vec<Group>,
    pub distances: Vec<Lanes>,
    values: Vec<Lanes>,
    /// Where the samples are from; those from `whole` on are of the station that is filling.
    pub lines: Vec<Line>,
    whole: usize,
    /// Stations so far; the last may still be filling.
    stations: usize,
    /// Samples in the station that is filling.
    filling: usize,
}

impl Stations {
    /// Forgets everything but its memory.
    pub fn clear(&mut self) {
        self.groups.clear();
        self.distances.clear();
        self.values.clear();
        self.lines.clear();
        (self.whole, self.stations) = (0, 0);
        self.filling = 0;
    }

    /// Stations that are complete.
    pub fn len(&self) -> usize {
        self.stations
    }

    /// Adds samples to the station that is filling: place along the side and distance outside it of the first one, what both grow by from
    /// one to the next, where they are from, and their grey values.
    #[inline]
    pub fn push(
        &mut self,
        first: [f32; 2],
        growth: [f32; 2],
        [pixel, stride]: [usize; 2],
        values: impl ExactSizeIterator<Item = f32>,
    ) {
        let lane = self.stations % LANES;
        if self.filling == 0 && lane == 0 {
            self.groups.push(Group { first: self.distances.len(), ..EMPTY });
        }
        let Some(group) = self.groups.last_mut() else { return };
        let count = values.len();
        let at = group.first + self.filling;
        self.lines.push(Line { first: pixel, stride, count, at, lane });
        if self.distances.len() < at + count {
            self.distances.resize(at + count, [FAR; LANES]);
            self.values.resize(at + count, [0.0; LANES]);
        }
        let mut d = first[1];
        for ((distance, kept), value) in self.distances[at..].iter_mut().zip(&mut self.values[at..]).zip(values) {
            distance[lane] = d;
            kept[lane] = value - MIDDLE;
            d += growth[1];
        }
        let n = count as f32;
        group.u[lane] += n * first[0] + growth[0] * 0.5 * n * (n - 1.0);
        group.count[lane] += n;
        self.filling += count;
    }

    /// Samples in the station that is filling.
    pub fn filling(&self) -> usize {
        self.filling
    }

    /// Mean place of the station that is filling.
    pub fn place(&self) -> f32 {
        let lane = self.stations % LANES;
        self.groups.last().map_or(0.0, |group| group.u[lane] / group.count[lane].max(1.0))
    }

    /// Completes the station that is filling: widths of the cells inside and outside, px, and the part of the next cell that is bright.
    pub fn complete(&mut self, inner: f32, outer: f32, shine: f32) {
        let lane = self.stations % LANES;
        if let Some(group) = self.groups.last_mut() {
            group.u[lane] /= group.count[lane].max(1.0);
            (group.inner[lane], group.outer[lane]) = (inner, outer);
            group.shine[lane] = shine;
        }
        self.stations += 1;
        self.filling = 0;
        self.whole = self.lines.len();
    }

    /// Drops the station that is filling.
    pub fn abandon(&mut self) {
        let lane = self.stations % LANES;
        if let Some(group) = self.groups.last_mut()
            && self.filling > 0
        {
            for lanes in self.distances.iter_mut().skip(group.first) {
                lanes[lane] = FAR;
            }
            (group.u[lane], group.count[lane]) = (0.0, 0.0);
            if lane == 0 {
                self.distances.truncate(group.first);
                self.values.truncate(group.first);
                self.groups.pop();
            }
        }
        self.lines.truncate(self.whole);
        self.filling = 0;
    }

    /// Fits all stations from edges at 0 and the expectation's blur; returns the side's blur (px). `sweeps` is the number of passes over the samples.
    pub fn fit(&mut self, expected: Profile, bounds: [f64; 2], widest: f64, sweeps: usize) -> f64 {
        let bounds = bounds.map(|bound| bound as f32);
        let Profile { blur, tone } = expected;
        let fit = Fit { stations: self, blur: blur as f32, tone: tone as f32, bounds, widest: widest as f32, sweeps };
        f64::from(dispatch(fit))
    }

    /// What was found, a step a station; stations without a rise outwards are left out.
    pub fn steps(&self) -> Vec<Step> {
        self.groups
            .iter()
            .flat_map(|group| steps(group.u, group.edge, [group.contrast, group.projected, group.noise]))
            .collect()
    }
}

/// The steps of eight stations, from where they are, their edges, contrasts, what is known of the edges, and noise.
pub(super) fn steps(u: Lanes, edge: Lanes, [contrast, information, noise]: [Lanes; 3]) -> impl Iterator<Item = Step> {
    (0..LANES).filter(move |lane| information[*lane] > 0.0).map(move |lane| Step {
        u: f64::from(u[lane]),
        edge: f64::from(edge[lane]),
        contrast: f64::from(contrast[lane]),
        information_inverse: 1.0 / f64::from(information[lane]),
        noise: f64::from(noise[lane]),
    })
}

/// All stations of a side, fitted.
struct Fit<'a> {
    stations: &'a mut Stations,
    blur: f32,
    tone: f32,
    bounds: [f32; 2],
    widest: f32,
    sweeps: usize,
}

impl WithSimd for Fit<'_> {
    type Output = f32;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f32 {
        let Self { stations, mut blur, tone, bounds, widest, sweeps } = self;
        for sweep in 0..sweeps {
            let (mut gradient, mut curvature) = (0.0, 0.0);
            let mut end = stations.distances.len();
            for group in stations.groups.iter_mut().rev() {
                let (d, v) = (&stations.distances[group.first..end], &stations.values[group.first..end]);
                end = group.first;
                for part in 0..LANES / S::F32_LANES {
                    let [g, c] = sweep_part(simd, group, part, [d, v], [blur, tone], widest);
                    gradient += g;
                    curvature += c;
                }
            }
            if curvature > 0.0 && sweep + 1 < sweeps {
                blur = (blur + (gradient / curvature).clamp(-0.5 * blur, blur)).clamp(bounds[0], bounds[1]);
            }
        }
        blur
    }
}

/// One Gauss-Newton step at some stations. Returns gradient and curvature for the side's blur.
#[inline(always)]
fn sweep_part<S: Simd>(
    simd: S,
    group: &mut Group,
    part: usize,
    [distances, values]: [&[Lanes]; 2],
    [blur, tone]: [f32; 2],
    widest: f32,
) -> [f32; 2] {
    let zero = Wide::splat(simd, 0.0);
    let edge = lanes(simd, &group.edge, part);
    let shape = Shape::of(simd, group, part, [blur, tone], widest);
    // p: Phi, v: the value, g: the slope of Phi, h: its slope by the blur.
    let (mut n, mut p, mut pp, mut v, mut pv, mut vv) = (zero, zero, zero, zero, zero, zero);
    let (mut g, mut gp, mut gg, mut gv) = (zero, zero, zero, zero);
    let (mut h, mut hp, mut hh, mut hv) = (zero, zero, zero, zero);
    for (d, value) in distances.iter().zip(values) {
        let Seen { w, phi, slope, dh } = shape.at(simd, lanes(simd, d, part));
        let x = w * lanes(simd, value, part);
        n = n + w;
        p = p + phi;
        pp = pp + phi * phi;
        v = v + x;
        pv = pv + phi * x;
        vv = vv + x * x;
        g = g + slope;
        gp = gp + slope * phi;
        gg = gg + slope * slope;
        gv = gv + slope * x;
        h = h + dh;
        hp = hp + dh * phi;
        hh = hh + dh * dh;
        hv = hv + dh * x;
    }
    let sharpness = shape.sharpness;
    // The density is the slope of Phi in blurs.
    (g, gp, gg, gv) = (g * sharpness, gp * sharpness, gg * sharpness * sharpness, gv * sharpness);
    let model = ModelSums { n, p, pp, g, gp, gg };
    let Found { sound, dark, contrast, step, information, noise } =
        model.solve(simd, ValueSums { v, pv, vv, gv }, edge, widest);
    store(&mut group.edge, part, edge + step);
    store(&mut group.contrast, part, contrast);
    store(&mut group.projected, part, information);
    store(&mut group.noise, part, noise);
    let scale = contrast * sharpness;
    let gradient = -scale * (hv - dark * h - contrast * hp);
    let curvature = contrast * contrast * sharpness * sharpness * model.project(simd, [h, hp, hh]).max(zero);
    [sound.choose(gradient, zero).sum(), sound.choose(curvature, zero).sum()]
}
