//! The stations of a side as one picture has them, to be measured in others that show the same.
//!
//! From one picture to the next a side moves by hundredths of a pixel. Which pixels belong to which station, and what a blurred step and its slope are at
//! each of them, is then as good as the same, and all that is left of the fit of [`super::edge_stations`] is its last Gauss-Newton step, from where the edges
//! were: four sums a station over its grey values. Each picture's edges are its own: what noise did to those of the first is made good by that step.

use pulp::{Simd, WithSimd};

use super::edge_stations::{Group, Line, MIDDLE, Profile, Stations, Step, steps};
use super::edge_step::{Found, ModelSums, Seen, Shape, ValueSums};
use super::picture::GreyPicture;
use super::wide::{LANES, Lanes, Wide, dispatch, lanes, store};

/// Eight stations.
#[derive(Debug, Clone)]
struct KeptGroup {
    /// Where its samples begin.
    first: usize,
    u: Lanes,
    edge: Lanes,
    /// Sums as in [`ModelSums`], in its order.
    sums: [Lanes; 6],
}

/// The stations of one side.
#[derive(Debug, Clone)]
pub(super) struct KeptStations {
    /// The pixels that are used.
    lines: Vec<Line>,
    groups: Vec<KeptGroup>,
    /// The step and its slope at each; 0 where a station has fewer than its neighbours.
    model: Vec<[Lanes; 2]>,
    /// How many stations there were.
    pub count: usize,
    /// The side's blur, px.
    pub blur: f64,
    widest: f32,
    bright_inside: bool,
    size: [usize; 2],
}

impl Stations {
    /// What was fitted with a profile in a picture.
    pub fn keep(&self, profile: Profile, widest: f64, bright_inside: bool, picture: &GreyPicture) -> KeptStations {
        let [blur, tone] = [profile.blur as f32, profile.tone as f32];
        let mut model = vec![[[0.0; LANES]; 3]; self.distances.len()];
        let ends = self.groups.iter().skip(1).map(|group| group.first).chain([self.distances.len()]);
        for (group, end) in self.groups.iter().zip(ends) {
            let (distances, model) = (&self.distances[group.first..end], &mut model[group.first..end]);
            dispatch(Look { group, distances, model, profile: [blur, tone], widest: widest as f32 });
        }
        let mut kept = KeptStations {
            lines: Vec::with_capacity(self.lines.len()),
            groups: Vec::with_capacity(self.groups.len()),
            model: Vec::new(),
            count: self.len(),
            blur: profile.blur,
            widest: widest as f32,
            bright_inside,
            size: [picture.width(), picture.height()],
        };
        let mut lines = self.lines.as_slice();
        for (k, group) in self.groups.iter().enumerate() {
            let end = self.groups.get(k + 1).map_or(usize::MAX, |next| next.first);
            let (own, rest) = lines.split_at(lines.iter().take_while(|line| line.at < end).count());
            lines = rest;
            kept.push(group, own, &model);
        }
        kept
    }
}

impl KeptStations {
    /// Adds eight stations without the pixels that are not used.
    fn push(&mut self, group: &Group, lines: &[Line], model: &[[Lanes; 3]]) {
        let first = self.model.len();
        let mut filled = [0; LANES];
        let mut sums = [[0.0; LANES]; 6];
        for line in lines {
            let used = |k: usize| model[line.at + k][0][line.lane] > 0.0;
            // Those that are used lie beside each other.
            let Some(begin) = (0..line.count).find(|k| used(*k)) else { continue };
            let count = (begin..line.count).take_while(|k| used(*k)).count();
            let at = first + filled[line.lane];
            filled[line.lane] += count;
            self.lines.push(Line { first: line.first + begin * line.stride, count, at, ..*line });
            if self.model.len() < at + count {
                self.model.resize(at + count, [[0.0; LANES]; 2]);
            }
            for (k, kept) in self.model[at..at + count].iter_mut().enumerate() {
                let [_, p, g] = model[line.at + begin + k].map(|lanes| lanes[line.lane]);
                (kept[0][line.lane], kept[1][line.lane]) = (p, g);
                for (sum, part) in sums.iter_mut().zip([1.0, p, p * p, g, g * p, g * g]) {
                    sum[line.lane] += part;
                }
            }
        }
        self.groups.push(KeptGroup { first, u: group.u, edge: group.edge, sums });
    }

    /// What stations find in another picture; `None` if it has not the size of the first.
    pub fn steps(&self, picture: &GreyPicture, values: &mut Vec<Lanes>) -> Option<Vec<Step>> {
        if self.size != [picture.width(), picture.height()] {
            return None;
        }
        values.clear();
        values.resize(self.model.len(), [0.0; LANES]);
        for line in &self.lines {
            let pixels = picture.pixels().get(line.first..)?.iter().step_by(line.stride);
            for (value, pixel) in values.get_mut(line.at..line.at + line.count)?.iter_mut().zip(pixels) {
                let shade = if self.bright_inside { u8::MAX - pixel } else { *pixel };
                value[line.lane] = f32::from(shade) - MIDDLE;
            }
        }
        Some(dispatch(Measure { kept: self, values }))
    }
}

/// Whether each sample is used, and the step and its slope there.
struct Look<'a> {
    group: &'a Group,
    distances: &'a [Lanes],
    model: &'a mut [[Lanes; 3]],
    profile: [f32; 2],
    widest: f32,
}

impl WithSimd for Look<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for part in 0..LANES / S::F32_LANES {
            let shape = Shape::of(simd, self.group, part, self.profile, self.widest);
            for (d, model) in self.distances.iter().zip(self.model.iter_mut()) {
                let Seen { w, phi, slope, .. } = shape.at(simd, lanes(simd, d, part));
                store(&mut model[0], part, w);
                store(&mut model[1], part, phi);
                store(&mut model[2], part, slope * shape.sharpness);
            }
        }
    }
}

struct Measure<'a> {
    kept: &'a KeptStations,
    values: &'a [Lanes],
}

impl WithSimd for Measure<'_> {
    type Output = Vec<Step>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<Step> {
        let Self { kept, values } = self;
        let mut found = Vec::with_capacity(kept.count);
        let ends = kept.groups.iter().skip(1).map(|group| group.first).chain([values.len()]);
        for (group, end) in kept.groups.iter().zip(ends) {
            let (values, model) = (&values[group.first..end], &kept.model[group.first..end]);
            let (mut edges, mut rest) = (group.edge, [[0.0; LANES]; 3]);
            for part in 0..LANES / S::F32_LANES {
                let zero = Wide::splat(simd, 0.0);
                let (mut v, mut pv, mut vv, mut gv) = (zero, zero, zero, zero);
                for (value, [p, g]) in values.iter().zip(model) {
                    let x = lanes(simd, value, part);
                    v = v + x;
                    pv = pv + lanes(simd, p, part) * x;
                    vv = vv + x * x;
                    gv = gv + lanes(simd, g, part) * x;
                }
                let [n, p, pp, g, gp, gg] = [
                    lanes(simd, &group.sums[0], part),
                    lanes(simd, &group.sums[1], part),
                    lanes(simd, &group.sums[2], part),
                    lanes(simd, &group.sums[3], part),
                    lanes(simd, &group.sums[4], part),
                    lanes(simd, &group.sums[5], part),
                ];
                let edge = lanes(simd, &group.edge, part);
                let Found { contrast, step, information, noise, .. } =
                    ModelSums { n, p, pp, g, gp, gg }.solve(simd, ValueSums { v, pv, vv, gv }, edge, kept.widest);
                store(&mut edges, part, edge + step);
                store(&mut rest[0], part, contrast);
                store(&mut rest[1], part, information);
                store(&mut rest[2], part, noise);
            }
            found.extend(steps(group.u, edges, rest));
        }
        found
    }
}
