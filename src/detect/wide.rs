//! Arithmetic on as many single precision numbers as the machine's registers hold, written as if it were one.
//!
//! A thin dress over [`pulp`]: operators in place of method calls. Products are never fused with sums, so that
//! the results are the same bits on every machine.

use std::ops::{Add, Mul, Neg, Sub};

use pulp::{Simd, WithSimd};

/// Numbers worked on together, whatever the machine's registers hold.
pub(super) const LANES: usize = 8;
/// They, one a lane.
pub(super) type Lanes = [f32; LANES];

/// Runs a task in the widest registers that hold no more than [`LANES`] numbers. Where there are registers of sixteen they would be half
/// empty: a small tag's side has ten stations, and places that see the same cells are eight at most.
pub(super) fn dispatch<T: WithSimd>(task: T) -> T::Output {
    #[cfg(target_arch = "x86_64")]
    return match pulp::x86::V3::try_new() {
        Some(simd) => Simd::vectorize(simd, task),
        None => task.with_simd(pulp::Scalar),
    };
    #[cfg(not(target_arch = "x86_64"))]
    return pulp::Arch::new().dispatch(task);
}

/// A register of numbers.
#[derive(Clone, Copy)]
pub(super) struct Wide<S: Simd> {
    simd: S,
    pub values: S::f32s,
}

/// A register of truths.
#[derive(Clone, Copy)]
pub(super) struct Truths<S: Simd> {
    simd: S,
    mask: S::m32s,
}

impl<S: Simd> Wide<S> {
    #[inline(always)]
    pub fn new(simd: S, values: S::f32s) -> Self {
        Self { simd, values }
    }

    #[inline(always)]
    pub fn splat(simd: S, value: f32) -> Self {
        Self { simd, values: simd.splat_f32s(value) }
    }

    #[inline(always)]
    fn with(self, values: S::f32s) -> Self {
        Self { simd: self.simd, values }
    }

    #[inline(always)]
    pub fn min(self, other: Self) -> Self {
        self.with(self.simd.min_f32s(self.values, other.values))
    }

    #[inline(always)]
    pub fn max(self, other: Self) -> Self {
        self.with(self.simd.max_f32s(self.values, other.values))
    }

    #[inline(always)]
    pub fn abs(self) -> Self {
        self.with(self.simd.abs_f32s(self.values))
    }

    /// One over it.
    #[inline(always)]
    pub fn inverse(self) -> Self {
        self.with(self.simd.div_f32s(self.simd.splat_f32s(1.0), self.values))
    }

    #[inline(always)]
    pub fn sqrt(self) -> Self {
        self.with(self.simd.sqrt_f32s(self.values))
    }

    #[inline(always)]
    pub fn less(self, other: Self) -> Truths<S> {
        Truths { simd: self.simd, mask: self.simd.less_than_f32s(self.values, other.values) }
    }

    #[inline(always)]
    pub fn sum(self) -> f32 {
        self.simd.reduce_sum_f32s(self.values)
    }
}

impl<S: Simd> Truths<S> {
    #[inline(always)]
    pub fn and(self, other: Self) -> Self {
        Self { mask: self.simd.and_m32s(self.mask, other.mask), ..self }
    }

    #[inline(always)]
    pub fn choose(self, yes: Wide<S>, no: Wide<S>) -> Wide<S> {
        yes.with(self.simd.select_f32s(self.mask, yes.values, no.values))
    }
}

impl<S: Simd> Add for Wide<S> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.with(self.simd.add_f32s(self.values, other.values))
    }
}

impl<S: Simd> Sub for Wide<S> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.with(self.simd.sub_f32s(self.values, other.values))
    }
}

impl<S: Simd> Mul for Wide<S> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.with(self.simd.mul_f32s(self.values, other.values))
    }
}

impl<S: Simd> Neg for Wide<S> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.with(self.simd.neg_f32s(self.values))
    }
}

/// The normal distribution's integral and density, good to 1e-5: the exponential as a 64th power, the integral by
/// Abramowitz and Stegun 7.1.26.
#[inline(always)]
pub(super) fn normal<S: Simd>(simd: S, z: Wide<S>) -> (Wide<S>, Wide<S>) {
    let number = |value: f32| Wide::splat(simd, value);
    let one = number(1.0);
    let z = z.max(number(-5.0)).min(number(5.0));
    let t = number(-0.5 / 64.0) * z * z;
    let mut power = one + t * (one + t * (number(0.5) + t * number(1.0 / 6.0)));
    for _ in 0..6 {
        power = power * power;
    }
    let t = (one + number(0.327_591_1 * std::f32::consts::FRAC_1_SQRT_2) * z.abs()).inverse();
    let series = t * (number(-1.453_152) + t * number(1.061_405_4));
    let series = t * (number(0.254_829_6) + t * (number(-0.284_496_74) + t * (number(1.421_413_7) + series)));
    let half = number(0.5) * series * power;
    (z.less(number(0.0)).choose(half, one - half), number(0.398_942_3) * power)
}

/// As many lanes as a register holds: the `part`th such.
#[inline(always)]
pub(super) fn lanes<S: Simd>(simd: S, lanes: &Lanes, part: usize) -> Wide<S> {
    const { assert!(S::F32_LANES <= LANES, "a register is wider than a group") };
    let (whole, _) = S::as_simd_f32s(lanes);
    Wide::new(simd, whole.get(part).copied().unwrap_or(simd.splat_f32s(0.0)))
}

/// Puts them back.
#[inline(always)]
pub(super) fn store<S: Simd>(lanes: &mut Lanes, part: usize, value: Wide<S>) {
    let (whole, _) = S::as_mut_simd_f32s(lanes);
    if let Some(lane) = whole.get_mut(part) {
        *lane = value.values;
    }
}

#[cfg(test)]
mod tests {
    use super::{LANES, Lanes, Wide, dispatch, lanes, normal, store};
    use pulp::{Scalar, Simd, WithSimd};

    /// The integral and the density at many places.
    struct Many<'a>(&'a mut [Lanes; 2]);

    impl WithSimd for Many<'_> {
        type Output = ();

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) {
            let places: Lanes = [-6.0, -2.5, -0.7, 0.0, 0.1, 1.3, 3.9, 8.0];
            for part in 0..LANES / S::F32_LANES {
                let (integral, density) = normal(simd, lanes(simd, &places, part));
                store(&mut self.0[0], part, integral);
                store(&mut self.0[1], part, density);
            }
        }
    }

    #[test]
    fn wide_registers_and_single_numbers_give_the_same_bits() {
        let (mut wide, mut single) = ([[0.0; LANES]; 2], [[1.0; LANES]; 2]);
        dispatch(Many(&mut wide));
        Many(&mut single).with_simd(Scalar);
        assert_eq!(wide, single);
    }

    #[test]
    fn the_normal_distribution() {
        // Values of scipy.stats.norm.
        for (z, integral, density) in [
            (0.0, 0.5, 0.398_942_3),
            (1.0, 0.841_344_7, 0.241_970_7),
            (-1.5, 0.066_807_2, 0.129_517_6),
            (3.0, 0.998_650_1, 0.004_431_8),
            (-4.0, 0.000_031_7, 0.000_133_8),
        ] {
            let found = normal(Scalar, Wide::splat(Scalar, z));
            let found = (Scalar.reduce_sum_f32s(found.0.values), Scalar.reduce_sum_f32s(found.1.values));
            assert!((found.0 - integral).abs() < 1e-5_f32 && (found.1 - density).abs() < 1e-5_f32, "{z}: {found:?}");
        }
    }
}
