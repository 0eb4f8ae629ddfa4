//! Arithmetic on as many single precision numbers as the machine's registers hold, written as if it were one.
//!
//! A thin dress over [`pulp`]: operators in place of method calls. Products are never fused with sums, so that
//! the results are the same bits on every machine.

use std::ops::{Add, Mul, Neg, Sub};

use pulp::Simd;

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
