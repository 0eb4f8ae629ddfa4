//! From light before the lens to grey values: vignetting, defocus, motion, exposure, noise.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::detect::GreyPicture;

/// How a picture is taken. The default is a decent industrial camera: slightly soft, about two grey values of noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure {
    /// Grey value of white paper in full light, as a part of 255, before vignetting.
    pub gain: f64,
    /// Exponent of the response: grey = 255 (light)^(1 / gamma). Industrial cameras answer linearly: 1.
    pub gamma: f64,
    /// Standard deviation of the blur by lens and focus, px; 0 for none.
    pub defocus: f64,
    /// Movement of the picture during the exposure, px to the right and down.
    pub motion: [f64; 2],
    /// Standard deviation of the noise that is there in the dark, grey values.
    pub read_noise: f64,
    /// Standard deviation of the noise of the light itself at grey value 255; it grows with the root of the light.
    pub shot_noise: f64,
    /// How much darker the corners of the picture are than its middle: 0 to 1.
    pub vignetting: f64,
}

impl Default for Exposure {
    fn default() -> Self {
        Self {
            gain: 1.0,
            gamma: 1.0,
            defocus: 0.7,
            motion: [0.0; 2],
            read_noise: 1.6,
            shot_noise: 1.7,
            vignetting: 0.12,
        }
    }
}

impl Exposure {
    /// No blur, no noise, no vignetting: each grey value is the rounded mean of the light on its pixel.
    #[must_use]
    pub fn perfect() -> Self {
        Self { defocus: 0.0, read_noise: 0.0, shot_noise: 0.0, vignetting: 0.0, ..Self::default() }
    }

    /// The picture that this light makes, light row by row. `seed` decides the noise.
    #[must_use]
    pub fn take(&self, size: [usize; 2], light: Vec<f32>, seed: u64) -> Option<GreyPicture> {
        let grey = self.develop(size, light);
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let (read, shot) =
            ((self.read_noise * self.read_noise) as f32, (self.shot_noise * self.shot_noise / 255.0) as f32);
        let noisy = read > 0.0 || shot > 0.0;
        let level = |value: f32| {
            let value = if noisy {
                let draw: f32 = StandardNormal.sample(&mut random);
                value + draw * (read + shot * value.clamp(0.0, 255.0)).sqrt()
            } else {
                value
            };
            (value + 0.5).clamp(0.0, 255.0) as u8
        };
        GreyPicture::new(size[0], size[1], grey.into_iter().map(level).collect())
    }

    /// Grey values before noise and rounding, row by row.
    #[must_use]
    pub fn develop(&self, size: [usize; 2], mut light: Vec<f32>) -> Vec<f32> {
        self.darken_corners(size, &mut light);
        let mut light = gaussian(light, size, self.defocus);
        if self.motion != [0.0; 2] {
            light = streak(&light, size, self.motion);
        }
        let gain = 255.0 * self.gain as f32;
        if self.gamma == 1.0 {
            light.iter_mut().for_each(|value| *value *= gain);
        } else {
            let exponent = (1.0 / self.gamma) as f32;
            light.iter_mut().for_each(|value| *value = 255.0 * (value.max(0.0) * gain / 255.0).powf(exponent));
        }
        light
    }

    fn darken_corners(&self, [width, height]: [usize; 2], light: &mut [f32]) {
        if self.vignetting == 0.0 {
            return;
        }
        let middle = [0.5 * (width as f32 - 1.0), 0.5 * (height as f32 - 1.0)];
        let scale = self.vignetting as f32 / (middle[0] * middle[0] + middle[1] * middle[1]).max(1.0);
        for (row, line) in light.chunks_exact_mut(width).enumerate() {
            let y = row as f32 - middle[1];
            for (column, value) in line.iter_mut().enumerate() {
                let x = column as f32 - middle[0];
                *value *= 1.0 - scale * (x * x + y * y);
            }
        }
    }
}

/// A separable Gaussian; what lies outside the picture is like its rim.
fn gaussian(mut picture: Vec<f32>, [width, height]: [usize; 2], sigma: f64) -> Vec<f32> {
    if sigma <= 0.0 {
        return picture;
    }
    let reach = (3.5 * sigma).ceil() as usize;
    let weights: Vec<f64> = (0..=reach).map(|i| (-0.5 * (i as f64 / sigma).powi(2)).exp()).collect();
    let total = weights[0] + 2.0 * weights[1..].iter().sum::<f64>();
    let weights: Vec<f32> = weights.iter().map(|w| (w / total) as f32).collect();
    let mut padded = vec![0.0f32; width + 2 * reach];
    for line in picture.chunks_exact_mut(width) {
        padded[..reach].fill(line[0]);
        padded[reach..reach + width].copy_from_slice(line);
        padded[reach + width..].fill(line[width - 1]);
        for (value, centre) in line.iter_mut().zip(&padded[reach..]) {
            *value = weights[0] * centre;
        }
        for (i, weight) in weights.iter().enumerate().skip(1) {
            let sides = padded[reach - i..].iter().zip(&padded[reach + i..]);
            for (value, (before, after)) in line.iter_mut().zip(sides) {
                *value += weight * (before + after);
            }
        }
    }
    let mut out = vec![0.0f32; width * height];
    let line = |row: usize| &picture[row * width..(row + 1) * width];
    for (row, target) in out.chunks_exact_mut(width).enumerate() {
        for (value, centre) in target.iter_mut().zip(line(row)) {
            *value = weights[0] * centre;
        }
        for (i, weight) in weights.iter().enumerate().skip(1) {
            let sides = line(row.saturating_sub(i)).iter().zip(line((row + i).min(height - 1)));
            for (value, (before, after)) in target.iter_mut().zip(sides) {
                *value += weight * (before + after);
            }
        }
    }
    out
}

/// The mean along a movement, centred on where the picture stands without it.
fn streak(picture: &[f32], [width, height]: [usize; 2], motion: [f64; 2]) -> Vec<f32> {
    let steps = (4.0 * motion[0].hypot(motion[1])).ceil().max(1.0) as usize;
    let mut kernel: std::collections::BTreeMap<(i64, i64), f64> = std::collections::BTreeMap::new();
    for step in 0..steps {
        let s = (step as f64 + 0.5) / steps as f64 - 0.5;
        let (x, y) = (s * motion[0], s * motion[1]);
        let (fx, fy) = (x - x.floor(), y - y.floor());
        for (dx, dy, weight) in
            [(0, 0, (1.0 - fx) * (1.0 - fy)), (1, 0, fx * (1.0 - fy)), (0, 1, (1.0 - fx) * fy), (1, 1, fx * fy)]
        {
            *kernel.entry((x.floor() as i64 + dx, y.floor() as i64 + dy)).or_default() += weight / steps as f64;
        }
    }
    let mut out = vec![0.0f32; picture.len()];
    for ((dx, dy), weight) in kernel {
        for row in 0..height {
            let from = (row as i64 + dy).clamp(0, height as i64 - 1) as usize * width;
            for column in 0..width {
                let c = (column as i64 + dx).clamp(0, width as i64 - 1) as usize;
                out[row * width + column] += weight as f32 * picture[from + c];
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blur_and_motion_keep_the_light_and_its_middle() {
        let size = [41, 31];
        let mut light = vec![0.0f32; 41 * 31];
        light[15 * 41 + 20] = 1.0;
        let exposure = Exposure { gain: 1.0 / 255.0, defocus: 1.1, motion: [5.3, -2.7], ..Exposure::perfect() };
        let grey = exposure.develop(size, light);
        let moment = |f: &dyn Fn(f64, f64) -> f64| {
            grey.iter()
                .enumerate()
                .map(|(i, v)| f64::from(*v) * f((i % 41) as f64 - 20.0, (i / 41) as f64 - 15.0))
                .sum::<f64>()
        };
        assert!((moment(&|_, _| 1.0) - 1.0).abs() < 1e-5);
        assert!(moment(&|x, _| x).abs() < 1e-4 && moment(&|_, y| y).abs() < 1e-4);
        // A Gaussian's variance and a streak's: length squared over 12, and what interpolation between pixels adds.
        assert!((moment(&|x, _| x * x) - (1.21 + 5.3f64.powi(2) / 12.0)).abs() < 0.25);
        assert!(moment(&|x, y| x * y) < -0.8, "along the movement");
    }

    #[test]
    fn noise_has_the_size_it_claims() {
        let exposure = Exposure { read_noise: 2.0, shot_noise: 3.0, ..Exposure::perfect() };
        for level in [0.2f32, 0.7] {
            let picture = exposure.take([300, 200], vec![level; 60_000], 5).unwrap();
            let mean = picture.pixels().iter().map(|v| f64::from(*v)).sum::<f64>() / 6e4;
            let variance = picture.pixels().iter().map(|v| (f64::from(*v) - mean).powi(2)).sum::<f64>() / 6e4;
            // Rounding adds a twelfth.
            let expected = 4.0 + 9.0 * f64::from(level) + 1.0 / 12.0;
            assert!((mean - 255.0 * f64::from(level)).abs() < 0.06, "{mean}");
            assert!((variance / expected - 1.0).abs() < 0.03, "{variance} {expected}");
        }
    }
}
