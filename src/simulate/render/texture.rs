//! What surfaces look like close up: noise, scratches, holes, joints between tiles, lettering.
//!
//! Textures are looked up once a pixel and fade out where a pixel is wider than their detail; nothing a detector measures is made of them.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::coverage::{Footprint, Grid};

/// The kinds of surfaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Finish {
    /// Smooth paint.
    Plain,
    /// A worn table with a grid of threaded holes.
    Table,
    /// Stone tiles.
    Floor,
    /// A rough wall.
    Wall,
}

/// Texels along one side of the noise; a power of two.
const NOISE: usize = 512;
/// Most texels of the table's wear.
const MOST_TEXELS: f64 = 3.0e6;

/// All textures of a cell.
#[derive(Debug)]
pub struct Textures {
    noise: Vec<f32>,
    wear: Wear,
}

/// Scratches, holes and stains of the table as a picture: 128 leaves the surface as it is, 64 halves its reflectance.
#[derive(Debug)]
struct Wear {
    texel: f64,
    size: [usize; 2],
    texels: Vec<u8>,
}

impl Textures {
    /// Textures for a table of the given half edges (m).
    #[must_use]
    pub fn new(table_half: [f64; 2], seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed ^ 0x7e87_u64);
        Self { noise: noise(&mut random), wear: Wear::new(table_half, &mut random) }
    }

    /// What a surface's reflectance is multiplied with in a pixel.
    #[must_use]
    pub fn sample(&self, finish: Finish, footprint: &Footprint) -> f32 {
        let Footprint { centre: [x, y], right, down } = *footprint;
        let wide = [right[0].abs() + down[0].abs(), right[1].abs() + down[1].abs()];
        let pixel = wide[0].max(wide[1]);
        // Noise whose texels are smaller than the pixel would flicker from pixel to pixel.
        let faded = |texel: f64| (2.0 * texel / (pixel + texel)).min(1.0) as f32;
        match finish {
            Finish::Plain => 1.0,
            Finish::Table => {
                let fine = self.noise(x, y, 0.0016) * faded(0.0016);
                let coarse = self.noise(0.8 * x + 0.6 * y, 0.8 * y - 0.6 * x, 0.009) * faded(0.009);
                (1.0 + 0.22 * fine + 0.3 * coarse) * self.wear.sample(x, y)
            }
            Finish::Floor => {
                let fine = self.noise(x, y, 0.004) * faded(0.004);
                let coarse = self.noise(0.6 * x + 0.8 * y, 0.6 * y - 0.8 * x, 0.02) * faded(0.02);
                let joint = line(x, 0.6, 0.008, wide[0]).max(line(y, 0.6, 0.008, wide[1]));
                (1.0 + 0.25 * fine + 0.35 * coarse) * (1.0 - 0.5 * joint)
            }
            Finish::Wall => {
                let fine = self.noise(x, y, 0.006) * faded(0.006);
                let coarse = self.noise(x, y, 0.027) * faded(0.027);
                1.0 + 0.3 * fine + 0.3 * coarse
            }
        }
    }

    /// Noise of mean zero and about unit range, bilinear, repeating.
    fn noise(&self, x: f64, y: f64, texel: f64) -> f32 {
        let (x, y) = (x / texel, y / texel);
        // Without the processor's rounding instructions `floor` is a call, and this is the innermost loop.
        let below = |v: f64| v as i64 - i64::from(v < (v as i64) as f64);
        let (left, top) = (below(x), below(y));
        let (fx, fy) = ((x - left as f64) as f32, (y - top as f64) as f32);
        let (c, r) = (left as usize % NOISE, top as usize % NOISE);
        let (c1, r1) = ((c + 1) % NOISE, (r + 1) % NOISE);
        let at = |row: usize, column: usize| self.noise[row * NOISE + column];
        let upper = at(r, c) + fx * (at(r, c1) - at(r, c));
        let lower = at(r1, c) + fx * (at(r1, c1) - at(r1, c));
        upper + fy * (lower - upper)
    }
}

/// The part of a pixel of width `wide` covered by lines of width `thick` every `pitch`.
fn line(x: f64, pitch: f64, thick: f64, wide: f64) -> f32 {
    let away = (x - (x / pitch).round() * pitch).abs();
    let wide = wide.max(1e-6);
    let overlap = (0.5 * (thick + wide) - away).clamp(0.0, thick.min(wide));
    (overlap / wide) as f32
}

/// Value noise: octaves of random lattices, smoothly interpolated.
fn noise(random: &mut ChaCha8Rng) -> Vec<f32> {
    let mut sum = vec![0.0f32; NOISE * NOISE];
    for (cell, strength) in [(128, 0.35f32), (32, 0.35), (8, 0.4), (2, 0.5)] {
        let side = NOISE / cell;
        let lattice: Vec<f32> = (0..side * side).map(|_| random.random_range(-1.0..1.0)).collect();
        for (index, value) in sum.iter_mut().enumerate() {
            let (x, y) = (index % NOISE, index / NOISE);
            let ease = |n: usize| {
                let t = (n % cell) as f32 / cell as f32;
                t * t * (3.0 - 2.0 * t)
            };
            let (c, r) = (x / cell, y / cell);
            let at = |r: usize, c: usize| lattice[(r % side) * side + c % side];
            let upper = at(r, c) + ease(x) * (at(r, c + 1) - at(r, c));
            let lower = at(r + 1, c) + ease(x) * (at(r + 1, c + 1) - at(r + 1, c));
            *value += strength * (upper + ease(y) * (lower - upper));
        }
    }
    sum
}

impl Wear {
    fn new(half: [f64; 2], random: &mut ChaCha8Rng) -> Self {
        let texel = (4.0 * half[0] * half[1] / MOST_TEXELS).sqrt().max(0.001);
        let size = half.map(|h| (2.0 * h / texel).ceil() as usize + 2);
        let mut factors = vec![1.0f32; size[0] * size[1]];
        let mut draw = |from: [f64; 2], to: [f64; 2], thick: f64, soft: f64, factor: f32| {
            let place = |p: [f64; 2]| [(p[0] + half[0]) / texel, (p[1] + half[1]) / texel];
            stroke(&mut factors, size, place(from), place(to), [0.5 * thick / texel, (soft / texel).max(0.5)], factor);
        };
        let pitch = 0.1;
        let holes = half.map(|h| (h / pitch - 0.3).max(0.0) as i64);
        for row in -holes[1]..=holes[1] {
            for column in -holes[0]..=holes[0] {
                let at = [column as f64 * pitch, row as f64 * pitch];
                draw(at, at, 0.011, 0.0, 0.22);
            }
        }
        let area = 4.0 * half[0] * half[1];
        for _ in 0..(90.0 * area).min(2000.0) as usize {
            let from = half.map(|h| random.random_range(-h..h));
            let angle = random.random_range(0.0..std::f64::consts::TAU);
            let length = random.random_range(0.03f64..0.22);
            let to = [from[0] + length * angle.cos(), from[1] + length * angle.sin()];
            let factor =
                if random.random_bool(0.6) { random.random_range(1.15..1.5) } else { random.random_range(0.6..0.85) };
            draw(from, to, random.random_range(0.0006..0.0025), 0.0, factor);
        }
        for _ in 0..(10.0 * area).min(200.0) as usize {
            let at = half.map(|h| random.random_range(-h..h));
            draw(at, at, random.random_range(0.02..0.08), 0.02, random.random_range(0.8..0.95));
        }
        Self { texel, size, texels: factors.iter().map(|f| (f * 128.0).round().clamp(0.0, 255.0) as u8).collect() }
    }

    fn sample(&self, x: f64, y: f64) -> f32 {
        let half = |n: usize| 0.5 * (n as f64 - 2.0) * self.texel;
        let (x, y) = ((x + half(self.size[0])) / self.texel, (y + half(self.size[1])) / self.texel);
        let bound = |v: f64, n: usize| v.clamp(0.0, n as f64 - 1.001);
        let (x, y) = (bound(x, self.size[0]), bound(y, self.size[1]));
        let (c, r) = (x as usize, y as usize);
        let (fx, fy) = ((x - c as f64) as f32, (y - r as f64) as f32);
        let at = |i: usize| f32::from(self.texels[i]);
        let i = r * self.size[0] + c;
        let j = i + self.size[0];
        let upper = at(i) + fx * (at(i + 1) - at(i));
        let lower = at(j) + fx * (at(j + 1) - at(j));
        (upper + fy * (lower - upper)) / 128.0
    }
}

/// Multiplies a round-ended stroke into a picture; `widths` are half its width and the softness of its rim, all in texels.
fn stroke(picture: &mut [f32], size: [usize; 2], from: [f64; 2], to: [f64; 2], widths: [f64; 2], factor: f32) {
    let reach = widths[0] + widths[1] + 1.0;
    let range = |axis: usize| {
        let bound = |v: f64| v.clamp(0.0, size[axis] as f64) as usize;
        bound(from[axis].min(to[axis]) - reach)..bound(from[axis].max(to[axis]) + reach + 1.0)
    };
    let along = [to[0] - from[0], to[1] - from[1]];
    let length = (along[0] * along[0] + along[1] * along[1]).max(1e-12);
    for row in range(1) {
        for column in range(0) {
            let p = [column as f64 - from[0], row as f64 - from[1]];
            let s = ((p[0] * along[0] + p[1] * along[1]) / length).clamp(0.0, 1.0);
            let apart = (p[0] - s * along[0]).hypot(p[1] - s * along[1]);
            let inside = ((widths[0] + widths[1] - apart) / (2.0 * widths[1])).clamp(0.0, 1.0);
            // A stroke thinner than a texel is faint, not wide.
            let inside = inside * (2.0 * widths[0]).min(1.0);
            picture[row * size[0] + column] *= 1.0 + inside as f32 * (factor - 1.0);
        }
    }
}

/// Letters of 5 x 7 dots, each row five bits from the left, top row first.
const LETTERS: [[u8; 7]; 12] = [
    [0b01110, 0b10001, 0b10001, 0b11111, 0b10001, 0b10001, 0b10001],
    [0b11110, 0b10001, 0b11110, 0b10001, 0b10001, 0b10001, 0b11110],
    [0b11111, 0b10000, 0b11110, 0b10000, 0b10000, 0b10000, 0b11111],
    [0b10001, 0b10010, 0b10100, 0b11000, 0b10100, 0b10010, 0b10001],
    [0b10001, 0b11001, 0b10101, 0b10011, 0b10001, 0b10001, 0b10001],
    [0b11110, 0b10001, 0b10001, 0b11110, 0b10100, 0b10010, 0b10001],
    [0b11111, 0b00100, 0b00100, 0b00100, 0b00100, 0b00100, 0b00100],
    [0b00100, 0b01100, 0b00100, 0b00100, 0b00100, 0b00100, 0b01110],
    [0b01110, 0b10001, 0b00001, 0b00110, 0b01000, 0b10000, 0b11111],
    [0b00010, 0b00110, 0b01010, 0b10010, 0b11111, 0b00010, 0b00010],
    [0b11111, 0b10000, 0b11110, 0b00001, 0b00001, 0b10001, 0b01110],
    [0b01110, 0b10001, 0b01110, 0b10001, 0b10001, 0b10001, 0b01110],
];

/// A sign with some letters, `half` its half edges (m).
#[must_use]
pub fn lettering(random: &mut ChaCha8Rng, letters: usize, half: [f64; 2], paper: f32, ink: f32) -> Grid {
    let (columns, rows) = (letters * 6 + 3, 11);
    let mut values = vec![paper; columns * rows];
    for letter in 0..letters {
        let shape = LETTERS[random.random_range(0..LETTERS.len())];
        for (row, bits) in shape.iter().enumerate() {
            for column in (0..5).filter(|column| bits >> (4 - column) & 1 == 1) {
                // The grid's rows go up, the letter's down.
                values[(8 - row) * columns + 2 + letter * 6 + column] = ink;
            }
        }
    }
    let lines = |count: usize, half: f64| (0..=count).map(|i| half * (2.0 * i as f64 / count as f64 - 1.0)).collect();
    Grid { xs: lines(columns, half[0]), ys: lines(rows, half[1]), values }
}
