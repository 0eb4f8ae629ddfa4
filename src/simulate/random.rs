//! Random numbers that depend on what they are for, not on when they are drawn.
//!
//! Every picture, every stop and every fault has a stream of its own, keyed by the seed and by what it is for. So the same seed gives the same bits
//! on any number of threads, and one more camera changes nothing about the others.

use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// What a stream is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// Joint values tried for a path.
    Path = 1,
    /// Where a target that moves by itself is.
    Moving,
    /// Where a robot really stops.
    Stop,
    /// Real links and lenses.
    Parts,
    /// Wrong beliefs about poses.
    Prior,
    /// Noise of measurements.
    Measurement,
    /// Outliers.
    Fault,
    /// What is missing.
    Missing,
    /// What a picture looks like.
    Picture,
}

/// The stream of a purpose and of up to three numbers that say which.
#[must_use]
pub fn stream(seed: u64, purpose: Purpose, which: [u64; 3]) -> ChaCha8Rng {
    let mixed = which.into_iter().chain([purpose as u64]).fold(seed, |state, value| mix(state ^ mix(value)));
    ChaCha8Rng::seed_from_u64(mixed)
}

/// SplitMix64's output function: every bit of the input reaches every bit of the output.
fn mix(value: u64) -> u64 {
    let mut z = value.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A draw from the standard normal distribution.
pub fn normal(random: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(random)
}

/// Three of them.
pub fn normal3(random: &mut ChaCha8Rng) -> Vector3<f64> {
    Vector3::from_fn(|_, _| normal(random))
}
