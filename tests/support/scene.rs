//! Whole pictures with known truth, fast enough for thousands: tags over plain or cluttered ground, then what a camera does to them.
#![allow(dead_code)]

use cellmap::detect::edge_lines::Lens;
use cellmap::detect::{Dictionary, GreyPicture};

use super::rendering::{Random, SQUARE, View};

/// What to render.
#[derive(Clone, Copy)]
pub struct Scene {
    pub dictionary: Dictionary,
    /// Tags in the picture, at most 12.
    pub tags: usize,
    /// Edge of the untilted tag, px.
    pub size: [f64; 2],
    /// Radians: smallest and largest.
    pub tilt: [f64; 2],
    pub blur: f64,
    /// Length of a smear in a random direction, px.
    pub motion: f64,
    pub noise: f64,
    pub gamma: f64,
    /// Multiplies all light.
    pub exposure: f64,
    pub jpeg: Option<u8>,
    pub clutter: bool,
    pub inverted: bool,
    /// Part of one side of each tag that something bright hides.
    pub hidden: f64,
    pub extent: [usize; 2],
}

pub const USUAL: Scene = Scene {
    dictionary: Dictionary::Aruco6x6_250,
    tags: 10,
    size: [44.0, 93.0],
    tilt: [0.0, 1.047],
    blur: 0.7,
    motion: 0.0,
    noise: 2.0,
    gamma: 1.0,
    exposure: 1.0,
    jpeg: None,
    clutter: false,
    inverted: false,
    hidden: 0.0,
    extent: [1280, 720],
};

/// A tag in a picture.
#[derive(Clone, Copy, Debug)]
pub struct Truth {
    pub id: u32,
    pub corners: [[f64; 2]; 4],
}

impl Scene {
    /// The picture and the tags in it. The same seed gives the same picture.
    pub fn render(&self, seed: u64, lens: Option<&dyn Lens>) -> (GreyPicture, Vec<Truth>) {
        let mut random = Random(seed.wrapping_mul(0x9e37_79b9).wrapping_add(17));
        let [width, height] = self.extent;
        let mut canvas = Canvas { width, height, light: vec![0.0; width * height] };
        canvas.ground(&mut random);
        if self.clutter {
            canvas.clutter(&mut random);
        }
        let mut truth = Vec::new();
        let (columns, rows) = (4, 3);
        let mut used = Vec::new();
        for k in 0..self.tags.min(columns * rows) {
            let cell = [width as f64 / columns as f64, height as f64 / rows as f64];
            let id = loop {
                let id = (random.unit() * f64::from(self.dictionary.tag_count())) as u32;
                if !used.contains(&id) {
                    break id;
                }
            };
            used.push(id);
            let place = [0, 1].map(|axis: usize| {
                let at = [k % columns, k / columns][axis] as f64 + 0.5;
                at * cell[axis] + random.between(-0.15, 0.15) * cell[axis]
            });
            let size = random.between(self.size[0], self.size[1]);
            // A lens moves the place too; views are built where the tag lies without it.
            let ideal = lens.map_or(Some(place), |lens| lens.undistort(place));
            let Some(ideal) = ideal else { continue };
            let tilt = random.between(self.tilt[0], self.tilt[1]);
            let view = View::tilted(&mut random, ideal, size, tilt);
            let hidden = (self.hidden > 0.0).then(|| (random.unit() * 4.0) as usize);
            if let Some(corners) = canvas.tag(&view, lens, self, id, hidden) {
                truth.push(Truth { id, corners });
            }
        }
        canvas.finish(self, &mut random, truth)
    }
}

struct Canvas {
    width: usize,
    height: usize,
    light: Vec<f32>,
}

impl Canvas {
    fn ground(&mut self, random: &mut Random) {
        let (a, b, level) = (random.between(90.0, 250.0), random.between(90.0, 250.0), random.between(70.0, 150.0));
        let across: Vec<f32> = (0..self.width).map(|x| (25.0 * (x as f64 / a).sin()) as f32).collect();
        for (y, row) in self.light.chunks_exact_mut(self.width).enumerate() {
            let down = (y as f64 / b).cos() as f32;
            for (value, across) in row.iter_mut().zip(&across) {
                *value = level as f32 + across * down;
            }
        }
    }

    fn fill(&mut self, x0: f64, y0: f64, x1: f64, y1: f64, mut value: impl FnMut(usize, usize) -> f64) {
        let clamp = |value: f64, most: usize| value.clamp(0.0, most as f64) as usize;
        for y in clamp(y0, self.height)..clamp(y1, self.height) {
            for x in clamp(x0, self.width)..clamp(x1, self.width) {
                self.light[y * self.width + x] = value(x, y) as f32;
            }
        }
    }

    fn clutter(&mut self, random: &mut Random) {
        let extent = [self.width as f64, self.height as f64];
        let place = |random: &mut Random| [random.unit() * extent[0], random.unit() * extent[1]];
        // Boxes of one colour, some with a darker rim: window frames, labels, tag-like squares.
        for _ in 0..60 {
            let [x, y] = place(random);
            let (w, h) = (random.between(10.0, 160.0), random.between(10.0, 120.0));
            let h = if random.unit() < 0.3 { w } else { h };
            let (rim, inner, t) = (random.between(5.0, 120.0), random.between(60.0, 250.0), random.between(1.0, 12.0));
            let outer = random.between(60.0, 250.0);
            self.fill(x - t, y - t, x + w + t, y + h + t, |_, _| outer);
            self.fill(x, y, x + w, y + h, |_, _| rim);
            let texture = random.unit() < 0.3;
            let cell = (w / 8.0).max(1.0);
            let salt = random.0;
            self.fill(x + t, y + t, x + w - t, y + h - t, |px, py| {
                if texture {
                    let key = ((px as f64 - x) / cell) as u64 * 31 + ((py as f64 - y) / cell) as u64 * 1013;
                    random_of(key ^ salt) * 240.0 + 10.0
                } else {
                    inner
                }
            });
        }
        // Texture.
        for _ in 0..10 {
            let [x, y] = place(random);
            let (w, h, level, depth) = (
                random.between(60.0, 260.0),
                random.between(60.0, 200.0),
                random.between(60.0, 180.0),
                random.between(20.0, 90.0),
            );
            let salt = random.0;
            let grain = random.between(1.0, 6.0);
            self.fill(x, y, x + w, y + h, |px, py| {
                let key = (px as f64 / grain) as u64 * 7919 + (py as f64 / grain) as u64 * 104_729;
                level + depth * (random_of(key ^ salt) - 0.5) * 2.0
            });
        }
        // Checkers.
        for _ in 0..4 {
            let [x, y] = place(random);
            let (square, n) = (random.between(5.0, 24.0), (random.unit() * 6.0) as i64 + 3);
            let edge = square * n as f64;
            self.fill(x, y, x + edge, y + edge, |px, py| {
                let parity = ((px as f64 - x) / square) as i64 + ((py as f64 - y) / square) as i64;
                if parity % 2 == 0 { 35.0 } else { 215.0 }
            });
        }
        // Writing: lines of small dark strokes on paper.
        for _ in 0..14 {
            let [x, y] = place(random);
            let (w, lines, glyph) =
                (random.between(80.0, 300.0), (random.unit() * 8.0) as usize + 2, random.between(4.0, 16.0));
            self.fill(x, y, x + w, y + 1.6 * glyph * (lines as f64 + 1.0), |_, _| 225.0);
            for line in 0..lines {
                let mut at = x + glyph;
                while at < x + w - glyph {
                    let (top, wide) = (y + glyph * (1.0 + 1.6 * line as f64), glyph * random.between(0.3, 0.8));
                    for _ in 0..3 {
                        let (sx, sy) = (at + random.unit() * wide * 0.7, top + random.unit() * glyph * 0.7);
                        let upright = random.unit() < 0.5;
                        let (dx, dy) = if upright { (glyph * 0.15, glyph * 0.6) } else { (glyph * 0.5, glyph * 0.15) };
                        self.fill(sx, sy, sx + dx.max(1.0), sy + dy.max(1.0), |_, _| 40.0);
                    }
                    at += wide + glyph * 0.3;
                }
            }
        }
        // Scratches and cables.
        for _ in 0..40 {
            let [x, y] = place(random);
            let (angle, length, level) =
                (random.between(0.0, std::f64::consts::TAU), random.between(40.0, 500.0), random.between(10.0, 240.0));
            let (thick, bend) = (random.between(0.5, 4.0), random.between(-0.01, 0.01));
            let mut at = [x, y];
            for step in 0..length as usize {
                let heading = angle + bend * step as f64;
                at = [at[0] + heading.cos(), at[1] + heading.sin()];
                self.fill(
                    at[0] - thick / 2.0,
                    at[1] - thick / 2.0,
                    at[0] + thick / 2.0 + 0.5,
                    at[1] + thick / 2.0 + 0.5,
                    |_, _| level,
                );
            }
        }
    }

    /// Draws a tag's plate; `None` if it is not wholly in the picture.
    fn tag(
        &mut self,
        view: &View,
        lens: Option<&dyn Lens>,
        scene: &Scene,
        id: u32,
        hidden: Option<usize>,
    ) -> Option<[[f64; 2]; 4]> {
        const OVER: usize = 8;
        let dictionary = scene.dictionary;
        let cells = dictionary.cells(id)?;
        let (side, edge) = (dictionary.cells_per_side() as f64, dictionary.edge_cells() as f64);
        let bend = |ideal: [f64; 2]| lens.map_or(Some(ideal), |lens| lens.distort(ideal));
        // The found edge is the unit square.
        let half = 0.5 * (side + 2.0) / edge;
        let (mut low, mut high) = ([f64::MAX; 2], [f64::MIN; 2]);
        for k in 0..64 {
            let (a, b) = (SQUARE[k / 16], SQUARE[(k / 16 + 1) % 4]);
            let t = (k % 16) as f64 / 16.0;
            let at = bend(view.ideal([0, 1].map(|axis: usize| 2.0 * half * (a[axis] + t * (b[axis] - a[axis])))))?;
            for axis in 0..2 {
                low[axis] = low[axis].min(at[axis]);
                high[axis] = high[axis].max(at[axis]);
            }
        }
        if low[0] < 2.0 || low[1] < 2.0 || high[0] > self.width as f64 - 3.0 || high[1] > self.height as f64 - 3.0 {
            return None;
        }
        let (black, white) = if scene.inverted { (215.0, 30.0) } else { (30.0, 215.0) };
        let value = |[x, y]: [f64; 2]| -> Option<f64> {
            if x.abs() > half || y.abs() > half {
                return None;
            }
            if let Some(hidden) = hidden {
                // A bright strip across the middle of one side.
                let (across, depth) = [(x, y), (y, -x), (-x, -y), (-y, x)][hidden];
                if across.abs() < scene.hidden / 2.0 && depth < -0.3 {
                    return Some(200.0);
                }
            }
            let cell = |v: f64| ((v * edge + side / 2.0).floor()) as i64;
            let (column, row) = (cell(x), cell(y));
            let last = side as i64;
            let inside = column >= 0 && row >= 0 && column < last && row < last;
            Some(if !inside || cells[(row * last + column) as usize] { white } else { black })
        };
        for row in low[1] as usize - 1..=high[1] as usize + 1 {
            for column in low[0] as usize - 1..=high[0] as usize + 1 {
                let (mut sum, mut count) = (0.0, 0);
                for sub in 0..OVER * OVER {
                    let x = column as f64 + ((sub % OVER) as f64 + 0.5) / OVER as f64 - 0.5;
                    let y = row as f64 + ((sub / OVER) as f64 + 0.5) / OVER as f64 - 0.5;
                    let ideal = lens.map_or(Some([x, y]), |lens| lens.undistort([x, y]));
                    if let Some(value) = ideal.and_then(|ideal| value(view.plane(ideal))) {
                        sum += value;
                        count += 1;
                    }
                }
                let here = &mut self.light[row * self.width + column];
                *here = ((sum + f64::from(*here) * (OVER * OVER - count) as f64) / (OVER * OVER) as f64) as f32;
            }
        }
        let corners = SQUARE.map(|corner| bend(view.ideal(corner)));
        Some([corners[0]?, corners[1]?, corners[2]?, corners[3]?])
    }

    fn finish(mut self, scene: &Scene, random: &mut Random, truth: Vec<Truth>) -> (GreyPicture, Vec<Truth>) {
        if scene.motion > 0.0 {
            let angle = random.between(0.0, std::f64::consts::TAU);
            let steps = (4.0 * scene.motion).ceil() as usize;
            let old = std::mem::take(&mut self.light);
            self.light = vec![0.0; old.len()];
            for step in 0..steps {
                let d = ((step as f64 + 0.5) / steps as f64 - 0.5) * scene.motion;
                self.add_shifted(&old, [d * angle.cos(), d * angle.sin()], 1.0 / steps as f32);
            }
        }
        self.blur(scene.blur);
        let normals: Vec<f32> = (0..4096).map(|_| random.normal() as f32).collect();
        let mut state = random.0 | 1;
        let (white, noise) = (215.0_f32, scene.noise as f32);
        let pixels: Vec<u8> = self
            .light
            .iter()
            .map(|value| {
                state ^= state << 13;
                state ^= state >> 7;
                state ^= state << 17;
                let mut value = *value * scene.exposure as f32;
                if scene.gamma != 1.0 {
                    value = white * (value.max(0.0) / white).powf(scene.gamma as f32);
                }
                (value + noise * normals[(state >> 20) as usize % normals.len()]).round().clamp(0.0, 255.0) as u8
            })
            .collect();
        let pixels = match scene.jpeg {
            None => pixels,
            Some(quality) => {
                let mut bytes = Vec::new();
                image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, quality)
                    .encode(&pixels, self.width as u32, self.height as u32, image::ExtendedColorType::L8)
                    .unwrap();
                image::load_from_memory(&bytes).unwrap().into_luma8().into_raw()
            }
        };
        (GreyPicture::new(self.width, self.height, pixels).unwrap(), truth)
    }

    fn add_shifted(&mut self, old: &[f32], [dx, dy]: [f64; 2], weight: f32) {
        let (ix, iy) = (dx.floor(), dy.floor());
        let (fx, fy) = ((dx - ix) as f32, (dy - iy) as f32);
        let (ix, iy) = (ix as isize, iy as isize);
        let (w, h) = (self.width as isize, self.height as isize);
        for y in 0..h {
            for x in 0..w {
                let at = |x: isize, y: isize| old[(y.clamp(0, h - 1) * w + x.clamp(0, w - 1)) as usize];
                let (x0, y0) = (x + ix, y + iy);
                let value = (at(x0, y0) * (1.0 - fx) + at(x0 + 1, y0) * fx) * (1.0 - fy)
                    + (at(x0, y0 + 1) * (1.0 - fx) + at(x0 + 1, y0 + 1) * fx) * fy;
                self.light[(y * w + x) as usize] += weight * value;
            }
        }
    }

    fn blur(&mut self, sigma: f64) {
        if sigma <= 0.0 {
            return;
        }
        let reach = (4.0 * sigma).ceil() as isize;
        let kernel: Vec<f32> = (-reach..=reach).map(|k| (-0.5 * (k as f64 / sigma).powi(2)).exp() as f32).collect();
        let total: f32 = kernel.iter().sum();
        let (w, h) = (self.width, self.height);
        let mut across = vec![0.0f32; w * h];
        for (to, from) in across.chunks_exact_mut(w).zip(self.light.chunks_exact(w)) {
            for (k, weight) in kernel.iter().enumerate() {
                let shift = k as isize - reach;
                for (x, to) in to.iter_mut().enumerate() {
                    let at = (x as isize + shift).clamp(0, w as isize - 1) as usize;
                    *to += weight / total * from[at];
                }
            }
        }
        self.light.fill(0.0);
        for (y, to) in self.light.chunks_exact_mut(w).enumerate() {
            for (k, weight) in kernel.iter().enumerate() {
                let at = (y as isize + k as isize - reach).clamp(0, h as isize - 1) as usize;
                for (to, from) in to.iter_mut().zip(&across[at * w..(at + 1) * w]) {
                    *to += weight / total * from;
                }
            }
        }
    }
}

/// A number in 0..1 that depends on `key` only.
fn random_of(key: u64) -> f64 {
    Random(key).unit()
}

/// Errors of corners against truth.
#[derive(Default, Debug, Clone, Copy)]
pub struct Tally {
    pub tags: f64,
    pub found: f64,
    pub false_ids: f64,
    pub corners: f64,
    pub squares: f64,
    pub offset: [f64; 2],
    pub pull: f64,
    pub normalised: f64,
    pub worst: f64,
}

impl Tally {
    /// Counts one picture's tags; `found` is (id, corner, pixel, covariance).
    pub fn add(&mut self, truth: &[Truth], found: &[(u32, usize, [f64; 2], [f64; 3])]) {
        self.tags += truth.len() as f64;
        let mut ids: Vec<u32> = found.iter().map(|corner| corner.0).collect();
        ids.dedup();
        for id in ids {
            let tag = truth.iter().find(|tag| tag.id == id);
            let near = tag.is_some_and(|tag| {
                found
                    .iter()
                    .filter(|corner| corner.0 == id)
                    .all(|(_, k, pixel, _)| (pixel[0] - tag.corners[*k][0]).hypot(pixel[1] - tag.corners[*k][1]) < 5.0)
            });
            if near {
                self.found += 1.0;
            } else {
                self.false_ids += 1.0;
            }
        }
        for (id, k, pixel, [suu, suv, svv]) in found {
            let Some(tag) = truth.iter().find(|tag| tag.id == *id) else { continue };
            let at = tag.corners[*k];
            let centre = [0, 1].map(|axis: usize| tag.corners.iter().map(|corner| corner[axis]).sum::<f64>() / 4.0);
            let e = [pixel[0] - at[0], pixel[1] - at[1]];
            if e[0].hypot(e[1]) > 5.0 {
                continue;
            }
            let out = [at[0] - centre[0], at[1] - centre[1]];
            self.corners += 1.0;
            self.squares += e[0] * e[0] + e[1] * e[1];
            self.offset = [self.offset[0] + e[0], self.offset[1] + e[1]];
            self.pull += (e[0] * out[0] + e[1] * out[1]) / out[0].hypot(out[1]);
            self.normalised +=
                (e[0] * e[0] * svv - 2.0 * e[0] * e[1] * suv + e[1] * e[1] * suu) / (suu * svv - suv * suv) / 2.0;
            self.worst = self.worst.max(e[0].hypot(e[1]));
        }
    }
    pub fn recall(&self) -> f64 {
        self.found / self.tags.max(1.0)
    }
    pub fn rms(&self) -> f64 {
        (self.squares / self.corners.max(1.0) / 2.0).sqrt()
    }
    pub fn mean_offset(&self) -> [f64; 2] {
        self.offset.map(|sum| sum / self.corners.max(1.0))
    }
    pub fn mean_pull(&self) -> f64 {
        self.pull / self.corners.max(1.0)
    }
    pub fn mean_normalised(&self) -> f64 {
        self.normalised / self.corners.max(1.0)
    }
}
