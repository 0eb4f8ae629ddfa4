//! Arithmetic on as many double precision numbers as the machine's registers hold, written as if it were one.
//!
//! A thin dress over [`pulp`]: operators in place of method calls. Sums of products are fused where the machine can, so the last bits depend on
//! the machine, but on nothing else.

use std::ops::{Add, AddAssign, Mul, Neg, Sub};

use pulp::Simd;

/// A register of numbers.
#[derive(Clone, Copy)]
pub(super) struct Lanes<S: Simd> {
    simd: S,
    values: S::f64s,
}

/// Numbers that fill a register each. A value and not a closure: the compiler does not let closures use the registers that they are called with.
#[derive(Clone, Copy)]
pub(super) struct Splat<S: Simd>(pub(super) S);

impl<S: Simd> Splat<S> {
    #[inline(always)]
    pub fn of(self, value: f64) -> Lanes<S> {
        Lanes::splat(self.0, value)
    }
}

/// A register of truths.
#[derive(Clone, Copy)]
pub(super) struct Truths<S: Simd> {
    simd: S,
    mask: S::m64s,
}

impl<S: Simd> Lanes<S> {
    /// How many numbers a register holds.
    pub const COUNT: usize = S::F64_LANES;

    #[inline(always)]
    pub fn splat(simd: S, value: f64) -> Self {
        Self { simd, values: simd.splat_f64s(value) }
    }

    /// Register `index` of a row of registers.
    #[inline(always)]
    pub fn load(simd: S, from: &[f64], index: usize) -> Self {
        let start = index * Self::COUNT;
        Self { simd, values: S::as_simd_f64s(&from[start..start + Self::COUNT]).0[0] }
    }

    #[inline(always)]
    pub fn of(simd: S, values: S::f64s) -> Self {
        Self { simd, values }
    }

    /// The register itself.
    #[inline(always)]
    pub fn values(self) -> S::f64s {
        self.values
    }

    /// The numbers, first to last; `to` must hold at least [`Self::COUNT`].
    #[inline(always)]
    pub fn store(self, to: &mut [f64]) {
        S::as_mut_simd_f64s(&mut to[..Self::COUNT]).0[0] = self.values;
    }

    #[inline(always)]
    fn with(self, values: S::f64s) -> Self {
        Self { simd: self.simd, values }
    }

    /// Adds the numbers to as many as `to` has, all of them at most.
    #[inline(always)]
    pub fn add_to(self, to: &mut [f64]) {
        if to.len() >= Self::COUNT {
            (Self::load(self.simd, to, 0) + self).store(to);
        } else {
            let sum = self.simd.add_f64s(self.simd.partial_load_f64s(to), self.values);
            self.simd.partial_store_f64s(to, sum);
        }
    }

    /// One register of a sum of six rows, which are `stride` numbers apart.
    #[inline(always)]
    pub fn sum_of_six(simd: S, factors: &[f64; 6], rows: &[f64], stride: usize, register: usize) -> Self {
        let mut halves = [Self::splat(simd, 0.0); 2];
        for (half, sum) in halves.iter_mut().enumerate() {
            for k in 3 * half..3 * half + 3 {
                let row = Self::load(simd, &rows[k * stride + register * Self::COUNT..], 0);
                *sum = Self::splat(simd, factors[k]).times_plus(row, *sum);
            }
        }
        halves[0] + halves[1]
    }

    /// `self * other + sum`.
    #[inline(always)]
    pub fn times_plus(self, other: Self, sum: Self) -> Self {
        self.with(self.simd.mul_add_e_f64s(self.values, other.values, sum.values))
    }

    #[inline(always)]
    pub fn over(self, other: Self) -> Self {
        self.with(self.simd.div_f64s(self.values, other.values))
    }

    #[inline(always)]
    pub fn root(self) -> Self {
        self.with(self.simd.sqrt_f64s(self.values))
    }

    #[inline(always)]
    pub fn max(self, other: Self) -> Self {
        self.with(self.simd.max_f64s(self.values, other.values))
    }

    #[inline(always)]
    pub fn less(self, other: Self) -> Truths<S> {
        Truths { simd: self.simd, mask: self.simd.less_than_f64s(self.values, other.values) }
    }

    /// The sum over the register.
    #[inline(always)]
    pub fn sum(self) -> f64 {
        self.simd.reduce_sum_f64s(self.values)
    }

    /// The same number in every place as in the register `like`.
    #[inline(always)]
    pub fn like(self, value: f64) -> Self {
        Self::splat(self.simd, value)
    }

    /// Every number put through a scalar function, for those that have no register form.
    #[inline(always)]
    pub fn each(self, other: Self, function: impl Fn(f64, f64) -> f64) -> Self {
        let (mut a, mut b) = ([0.0; WIDEST_REGISTER], [0.0; WIDEST_REGISTER]);
        self.store(&mut a);
        other.store(&mut b);
        for (a, b) in a.iter_mut().zip(&b).take(Self::COUNT) {
            *a = function(*a, *b);
        }
        Self::load(self.simd, &a, 0)
    }
}

/// More doubles than any register of today holds.
pub(super) const WIDEST_REGISTER: usize = 16;

impl<S: Simd> Truths<S> {
    #[inline(always)]
    pub fn choose(self, yes: Lanes<S>, no: Lanes<S>) -> Lanes<S> {
        yes.with(self.simd.select_f64s(self.mask, yes.values, no.values))
    }
}

impl<S: Simd> Add for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.with(self.simd.add_f64s(self.values, other.values))
    }
}

impl<S: Simd> AddAssign for Lanes<S> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<S: Simd> Sub for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.with(self.simd.sub_f64s(self.values, other.values))
    }
}

impl<S: Simd> Mul for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.with(self.simd.mul_f64s(self.values, other.values))
    }
}

impl<S: Simd> Mul<Lanes<S>> for f64 {
    type Output = Lanes<S>;
    #[inline(always)]
    fn mul(self, other: Lanes<S>) -> Lanes<S> {
        other.like(self) * other
    }
}

impl<S: Simd> Neg for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.with(self.simd.neg_f64s(self.values))
    }
}
