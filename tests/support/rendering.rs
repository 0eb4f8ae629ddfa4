//! A small renderer with known truth: a plane pattern seen in perspective, each pixel the mean of 8 x 8
//! places, blurred, with noise, rounded to whole grey levels.
#![allow(dead_code)]

use std::f64::consts::TAU;

use cellmap::detect::GreyPicture;

/// SplitMix64: small, and the same on every machine.
pub struct Random(pub u64);

impl Random {
    pub fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }
    pub fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.unit()).ln()).sqrt() * (TAU * self.unit()).cos()
    }
}

/// A plane seen by a pinhole camera: plane (x, y) in units of its pattern -> pixel.
pub struct View {
    pub rotation: [[f64; 3]; 3],
    pub translation: [f64; 3],
    pub focal: f64,
    pub centre: [f64; 2],
}

impl View {
    /// A plane whose origin is at `place`, `pixels_per_unit` large, turned in the picture and tilted by up to `tilt` radians.
    pub fn random(random: &mut Random, place: [f64; 2], pixels_per_unit: f64, tilt: f64) -> Self {
        let tilt = random.between(0.0, tilt);
        Self::tilted(random, place, pixels_per_unit, tilt)
    }
    /// The same, tilted by so much in a random direction.
    pub fn tilted(random: &mut Random, place: [f64; 2], pixels_per_unit: f64, tilt: f64) -> Self {
        let (spin, direction) = (random.between(0.0, TAU), random.between(0.0, TAU));
        let axis = [direction.cos(), direction.sin(), 0.0];
        let tilted = rotation(axis, tilt);
        let spun = rotation([0.0, 0.0, 1.0], spin);
        let focal = 1000.0;
        Self {
            rotation: multiply(tilted, spun),
            translation: [0.0, 0.0, focal / pixels_per_unit],
            focal,
            centre: place,
        }
    }
    pub fn ideal(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let p = [0, 1, 2].map(|k: usize| self.rotation[k][0] * x + self.rotation[k][1] * y + self.translation[k]);
        [self.centre[0] + self.focal * p[0] / p[2], self.centre[1] + self.focal * p[1] / p[2]]
    }
    /// Pixel -> place on the plane.
    pub fn plane(&self, pixel: [f64; 2]) -> [f64; 2] {
        // In the camera the ray is (u, v, 1); on the plane's frame it starts at -R't.
        let ray = [(pixel[0] - self.centre[0]) / self.focal, (pixel[1] - self.centre[1]) / self.focal, 1.0];
        let turned = |v: [f64; 3], k: usize| {
            self.rotation[0][k] * v[0] + self.rotation[1][k] * v[1] + self.rotation[2][k] * v[2]
        };
        let t = self.translation;
        let depth = turned(t, 2) / turned(ray, 2);
        [depth * turned(ray, 0) - turned(t, 0), depth * turned(ray, 1) - turned(t, 1)]
    }
}

fn rotation(a: [f64; 3], angle: f64) -> [[f64; 3]; 3] {
    let (s, c) = angle.sin_cos();
    let t = 1.0 - c;
    [
        [t * a[0] * a[0] + c, t * a[0] * a[1] - s * a[2], t * a[0] * a[2] + s * a[1]],
        [t * a[0] * a[1] + s * a[2], t * a[1] * a[1] + c, t * a[1] * a[2] - s * a[0]],
        [t * a[0] * a[2] - s * a[1], t * a[1] * a[2] + s * a[0], t * a[2] * a[2] + c],
    ]
}

fn multiply(a: [[f64; 3]; 3], b: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    [0, 1, 2].map(|i: usize| [0, 1, 2].map(|j: usize| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}

/// Renders `value(pixel)` (a grey level at a real place in the picture).
pub fn render(
    random: &mut Random,
    width: usize,
    height: usize,
    blur: f64,
    noise: f64,
    value: impl Fn([f64; 2]) -> f64,
) -> GreyPicture {
    const OVER: usize = 8;
    let mut sharp = vec![0.0; width * height];
    for row in 0..height {
        for column in 0..width {
            // Most pixels are of one colour; a straight edge cannot pass through one without parting its corners.
            let rim = [-0.5, 0.0, 0.5].map(|x| [-0.5, 0.0, 0.5].map(|y| value([column as f64 + x, row as f64 + y])));
            if rim.iter().flatten().all(|here| *here == rim[0][0]) {
                sharp[row * width + column] = rim[0][0];
                continue;
            }
            let mut sum = 0.0;
            for sub in 0..OVER * OVER {
                let x = column as f64 + ((sub % OVER) as f64 + 0.5) / OVER as f64 - 0.5;
                let y = row as f64 + ((sub / OVER) as f64 + 0.5) / OVER as f64 - 0.5;
                sum += value([x, y]);
            }
            sharp[row * width + column] = sum / (OVER * OVER) as f64;
        }
    }
    let reach = (5.0 * blur).ceil() as isize;
    let kernel: Vec<f64> =
        (-reach..=reach).map(|k| if blur > 0.0 { (-0.5 * (k as f64 / blur).powi(2)).exp() } else { 1.0 }).collect();
    let total: f64 = kernel.iter().sum();
    let smooth = |from: &[f64], stride: usize, extent: usize, place: usize| {
        let at = (place / stride % extent) as isize;
        kernel
            .iter()
            .enumerate()
            .map(|(k, weight)| {
                let moved = (at + k as isize - reach).clamp(0, extent as isize - 1);
                weight * from[(place as isize + (moved - at) * stride as isize) as usize]
            })
            .sum::<f64>()
            / total
    };
    let across: Vec<f64> = (0..sharp.len()).map(|place| smooth(&sharp, 1, width, place)).collect();
    let both: Vec<f64> = (0..sharp.len()).map(|place| smooth(&across, width, height, place)).collect();
    let pixels = both.iter().map(|value| (value + noise * random.normal()).round().clamp(0.0, 255.0) as u8).collect();
    GreyPicture::new(width, height, pixels).unwrap()
}

/// A random tag of `bits` data cells in the square [-1/2, 1/2], with a white margin one cell wide, on `background`.
pub struct Tag {
    pub bits: usize,
    pub data: Vec<bool>,
    pub background: f64,
}

impl Tag {
    pub fn random(random: &mut Random, bits: usize) -> Self {
        Self {
            bits,
            data: (0..bits * bits).map(|_| random.unit() < 0.5).collect(),
            background: random.between(10.0, 200.0),
        }
    }
    pub fn value(&self, [x, y]: [f64; 2]) -> f64 {
        let (black, white) = (30.0, 215.0);
        let cells = (self.bits + 2) as f64;
        let (column, row) = (((x + 0.5) * cells).floor() as isize, ((y + 0.5) * cells).floor() as isize);
        let last = self.bits as isize + 1;
        if column < -1 || row < -1 || column > last + 1 || row > last + 1 {
            self.background
        } else if column < 0 || row < 0 || column > last || row > last {
            white
        } else if column == 0
            || row == 0
            || column == last
            || row == last
            || !self.data[(row as usize - 1) * self.bits + column as usize - 1]
        {
            black
        } else {
            white
        }
    }
}

/// Corners of the square [-1/2, 1/2]: top-left, then clockwise as seen.
pub const SQUARE: [[f64; 2]; 4] = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]];
