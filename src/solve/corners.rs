//! Condensing corners, a register of points at a time.
//!
//! With `J` (2 x unknowns) the derivative of a point's pixel, `A = sum w W^T W` and `g = sum w W^T W d` over its observations (whitener `W`,
//! difference `d` from the measured pixel, robust weight `w`; under a robust loss `A` has the loss' own curvature too, see
//! [`super::loss::Loss::weight_and_bend`]), the point adds `J^T A J` and `J^T g` to the block's matrix. `A` and `g` cost little
//! for each picture; `J` and the products are formed once a point.

use pulp::{Arch, Simd, WithSimd};

use super::kernels::{Condensed, UNSEEN};
use super::lanes::{Lanes, WIDEST_REGISTER};
use super::lens_lanes::{Differentiated, LensLanes, Projected};
use super::loss::Loss;
use super::pack::{OBSERVATION, PackedBlock};
use crate::geometry::Pose;
use crate::geometry::lens::{MAX_PARAMETERS, with_lens};

/// How many numbers a register of this machine holds.
pub(super) fn lanes(arch: Arch) -> usize {
    struct Count;
    impl WithSimd for Count {
        type Output = usize;
        #[inline(always)]
        fn with_simd<S: Simd>(self, _: S) -> usize {
            Lanes::<S>::COUNT
        }
    }
    arch.dispatch(Count)
}

/// The corners of a block seen from a place through a lens.
#[derive(Clone, Copy)]
pub(super) struct View<'a> {
    pub(super) corners: PackedBlock<'a>,
    pub(super) camera_from_target: &'a Pose,
    pub(super) model: crate::geometry::LensModel,
    pub(super) lens: &'a [f64; MAX_PARAMETERS],
    pub(super) loss: Loss,
    /// Whether the loss' own curvature counts, see [`Loss::weight_and_bend`].
    pub(super) curved: bool,
}

impl View<'_> {
    /// Condenses the block; with `free`, over the lens' parameters too.
    pub(super) fn condense(self, arch: Arch, free: bool, out: &mut Condensed) {
        with_lens!(self.model, L => {
            if free {
                const PARAMETERS: usize = <L as crate::geometry::lens::Lens>::COUNT;
                arch.dispatch(Condense::<L, { 7 + PARAMETERS }> { view: self, out, lens: std::marker::PhantomData });
            } else {
                arch.dispatch(Condense::<L, 7> { view: self, out, lens: std::marker::PhantomData });
            }
        });
    }

    /// The cost alone.
    pub(super) fn cost(self, arch: Arch) -> f64 {
        with_lens!(self.model, L => arch.dispatch(Cost::<L> { view: self, lens: std::marker::PhantomData }))
    }
}

/// The task of condensing; `W` is 7, or 7 plus the lens' parameters.
struct Condense<'a, 'b, L, const W: usize> {
    view: View<'a>,
    out: &'b mut Condensed,
    lens: std::marker::PhantomData<L>,
}

impl<L: LensLanes, const W: usize> WithSimd for Condense<'_, '_, L, W> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let view = &self.view;
        let zero = Lanes::splat(simd, 0.0);
        let rigid = Rigid::new(simd, view.camera_from_target);
        let mut robust = Robust::new(simd, view.loss);
        let mut sums = [[zero; W]; W];
        let mut first = view.corners.first;
        for (register, &end) in view.corners.ends.iter().enumerate() {
            let point: [Lanes<S>; 3] =
                std::array::from_fn(|axis| Lanes::load(simd, view.corners.points, 3 * register + axis));
            let at: Differentiated<S> = L::differentiate_lanes(simd, view.lens, rigid.apply(&point));
            let mut total = Total::new(zero);
            for observation in first..end as usize {
                let (d, [a, b, c]) = difference(simd, &view.corners, observation, &at.pixel);
                let (ru, rv) = (a * d[0], b.times_plus(d[0], c * d[1]));
                let counts = view.count(simd, register, a);
                let squared = at.seen.choose(ru.times_plus(ru, rv * rv), zero);
                let (weight, bend) = robust.add(squared);
                let (weight, bend) = (at.seen.choose(weight, zero), at.seen.choose(bend, zero));
                robust.hide(at.seen.choose(zero, counts));
                total.add(weight, [a, b, c], [ru, rv], squared);
                if view.curved {
                    total.bend(bend, [a.times_plus(ru, b * rv), c * rv]);
                }
            }
            first = end as usize;
            let (mut u, mut v) = ([zero; W], [zero; W]);
            for i in 0..3 {
                u[i] = rigid.turn(&at.by_point[0], i);
                v[i] = rigid.turn(&at.by_point[1], i);
            }
            for row in [&mut u, &mut v] {
                let h = [row[0], row[1], row[2]];
                let turned = cross(&point, &h);
                row[3..6].copy_from_slice(&turned);
            }
            u[6..W - 1].copy_from_slice(&at.by_parameter[0][..W - 7]);
            v[6..W - 1].copy_from_slice(&at.by_parameter[1][..W - 7]);
            total.spread(&u, &v, &mut sums);
        }
        let m = &mut self.out.matrix;
        for i in 0..W {
            for j in i..W {
                m[i][j] = sums[i][j].sum();
            }
        }
        self.out.size = W;
        self.out.cost = view.corners.constant + robust.finish();
    }
}

/// The task of evaluating the cost.
struct Cost<'a, L> {
    view: View<'a>,
    lens: std::marker::PhantomData<L>,
}

impl<L: LensLanes> WithSimd for Cost<'_, L> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let view = &self.view;
        let zero = Lanes::splat(simd, 0.0);
        let rigid = Rigid::new(simd, view.camera_from_target);
        let mut robust = Robust::new(simd, view.loss);
        let mut first = view.corners.first;
        for (register, &end) in view.corners.ends.iter().enumerate() {
            let point: [Lanes<S>; 3] =
                std::array::from_fn(|axis| Lanes::load(simd, view.corners.points, 3 * register + axis));
            let Projected { seen, pixel } = L::project_lanes(simd, view.lens, rigid.apply(&point));
            for observation in first..end as usize {
                let (d, [a, b, c]) = difference(simd, &view.corners, observation, &pixel);
                let (ru, rv) = (a * d[0], b.times_plus(d[0], c * d[1]));
                let counts = view.count(simd, register, a);
                robust.add(seen.choose(ru.times_plus(ru, rv * rv), zero));
                robust.hide(seen.choose(zero, counts));
            }
            first = end as usize;
        }
        view.corners.constant + robust.finish()
    }
}

impl View<'_> {
    /// How many corners an observation stands for: zero in a spare lane.
    #[inline(always)]
    fn count<S: Simd>(&self, simd: S, register: usize, a: Lanes<S>) -> Lanes<S> {
        if self.corners.counts.is_empty() {
            let zero = Lanes::splat(simd, 0.0);
            zero.less(a).choose(Lanes::splat(simd, 1.0), zero)
        } else {
            Lanes::load(simd, self.corners.counts, register)
        }
    }
}

/// How far a pixel is from an observed one, and the observation's whitener.
#[inline(always)]
fn difference<S: Simd>(
    simd: S,
    corners: &PackedBlock<'_>,
    observation: usize,
    pixel: &[Lanes<S>; 2],
) -> ([Lanes<S>; 2], [Lanes<S>; 3]) {
    let row = &corners.observations[observation * OBSERVATION * Lanes::<S>::COUNT..];
    let [u, v, a, b, c] = std::array::from_fn(|i| Lanes::load(simd, row, i));
    ([pixel[0] - u, pixel[1] - v], [a, b, c])
}

#[inline(always)]
fn cross<S: Simd>(a: &[Lanes<S>; 3], b: &[Lanes<S>; 3]) -> [Lanes<S>; 3] {
    let part = |i: usize, j: usize| a[i].times_plus(b[j], -(a[j] * b[i]));
    [part(1, 2), part(2, 0), part(0, 1)]
}

/// A transform whose numbers fill registers.
struct Rigid<S: Simd> {
    r: [[Lanes<S>; 3]; 3],
    t: [Lanes<S>; 3],
}

impl<S: Simd> Rigid<S> {
    #[inline(always)]
    fn new(simd: S, pose: &Pose) -> Self {
        let m = pose.rotation_matrix();
        let r = std::array::from_fn(|i| std::array::from_fn(|j| Lanes::splat(simd, m[(i, j)])));
        Self { r, t: std::array::from_fn(|i| Lanes::splat(simd, pose.translation[i])) }
    }

    #[inline(always)]
    fn apply(&self, p: &[Lanes<S>; 3]) -> [Lanes<S>; 3] {
        std::array::from_fn(|i| {
            let [x, y, z] = self.r[i];
            x.times_plus(p[0], y.times_plus(p[1], z.times_plus(p[2], self.t[i])))
        })
    }

    /// Component `i` of `R^T g`.
    #[inline(always)]
    fn turn(&self, g: &[Lanes<S>; 3], i: usize) -> Lanes<S> {
        self.r[0][i].times_plus(g[0], self.r[1][i].times_plus(g[1], self.r[2][i] * g[2]))
    }
}

/// The sums over a point's observations.
struct Total<S: Simd> {
    /// `A`: uu, uv, vv.
    weight: [Lanes<S>; 3],
    /// `g`.
    gradient: [Lanes<S>; 2],
    /// `sum w |W d|^2`.
    squared: Lanes<S>,
}

impl<S: Simd> Total<S> {
    #[inline(always)]
    fn new(zero: Lanes<S>) -> Self {
        Self { weight: [zero; 3], gradient: [zero; 2], squared: zero }
    }

    #[inline(always)]
    fn add(&mut self, weight: Lanes<S>, [a, b, c]: [Lanes<S>; 3], [ru, rv]: [Lanes<S>; 2], squared: Lanes<S>) {
        let (wa, wb, wc) = (weight * a, weight * b, weight * c);
        self.weight[0] = wa.times_plus(a, wb.times_plus(b, self.weight[0]));
        self.weight[1] = wb.times_plus(c, self.weight[1]);
        self.weight[2] = wc.times_plus(c, self.weight[2]);
        self.gradient[0] = wa.times_plus(ru, wb.times_plus(rv, self.gradient[0]));
        self.gradient[1] = wc.times_plus(rv, self.gradient[1]);
        self.squared = weight.times_plus(squared, self.squared);
    }

    /// Adds the loss' own curvature along the residual.
    #[inline(always)]
    fn bend(&mut self, bend: Lanes<S>, [gu, gv]: [Lanes<S>; 2]) {
        let (bu, bv) = (bend * gu, bend * gv);
        self.weight[0] = bu.times_plus(gu, self.weight[0]);
        self.weight[1] = bu.times_plus(gv, self.weight[1]);
        self.weight[2] = bv.times_plus(gv, self.weight[2]);
    }

    /// Adds `[J g]`'s products to the block's sums; `u` and `v` are the rows of `J`, their last place is spare.
    #[inline(always)]
    fn spread<const W: usize>(&self, u: &[Lanes<S>; W], v: &[Lanes<S>; W], sums: &mut [[Lanes<S>; W]; W]) {
        let [uu, uv, vv] = self.weight;
        let [gu, gv] = self.gradient;
        let (mut au, mut av) = (*u, *v);
        for i in 0..W - 1 {
            au[i] = uu.times_plus(u[i], uv * v[i]);
            av[i] = uv.times_plus(u[i], vv * v[i]);
        }
        (au[W - 1], av[W - 1]) = (gu, gv);
        for i in 0..W - 1 {
            for j in i..W {
                sums[i][j] = u[i].times_plus(au[j], v[i].times_plus(av[j], sums[i][j]));
            }
        }
        sums[W - 1][W - 1] += self.squared;
    }
}

/// The cost under a loss, summed register by register.
struct Robust<S: Simd> {
    loss: Loss,
    simd: S,
    /// `sum rho`, without what is still in `product`.
    sum: Lanes<S>,
    /// Corners that cannot be seen.
    hidden: Lanes<S>,
    /// For Cauchy's loss: `prod (1 + t) - 1`, so that several logarithms become one.
    product: Lanes<S>,
    factors: u32,
}

/// Factors that cannot overflow together: each is at most about 1e30.
const FACTORS: u32 = 8;

impl<S: Simd> Robust<S> {
    #[inline(always)]
    fn new(simd: S, loss: Loss) -> Self {
        let zero = Lanes::splat(simd, 0.0);
        Self { loss, simd, sum: zero, hidden: zero, product: zero, factors: 0 }
    }

    /// Adds a register of squared residuals; returns [`Loss::weight_and_bend`] of each.
    #[inline(always)]
    fn add(&mut self, s: Lanes<S>) -> (Lanes<S>, Lanes<S>) {
        let simd = self.simd;
        let n = |value: f64| Lanes::splat(simd, value);
        match self.loss {
            Loss::Squared => {
                self.sum += s;
                (n(1.0), n(0.0))
            }
            Loss::Huber(k) => {
                let far = n(k * k).less(s);
                let r = s.root();
                // Away from zero, where the division is not used.
                let reach = r.max(n(k));
                let weight = n(k).over(reach);
                self.sum += far.choose(r.times_plus(n(2.0 * k), n(-k * k)), s);
                (far.choose(weight, n(1.0)), far.choose(-weight.over(reach * reach), n(0.0)))
            }
            Loss::Cauchy(k) => {
                let t = s * n(1.0 / (k * k));
                self.product = self.product + t + self.product * t;
                self.factors += 1;
                if self.factors == FACTORS {
                    self.flush(k);
                }
                let weight = n(1.0).over(t + n(1.0));
                let full = n(-2.0 / (k * k)) * weight * weight;
                (weight, full.max(-weight.over(s.max(n(f64::MIN_POSITIVE)))))
            }
            Loss::Tukey(k) => {
                let u = s * n(1.0 / (k * k));
                let near = u.less(n(1.0));
                let rest = n(1.0) - u;
                let inside = s * u.times_plus(u.times_plus(n(1.0 / 3.0), n(-1.0)), n(1.0));
                // A residual that is no number stays one: it is on neither side of the limit.
                let beyond = n(1.0).less(u).choose(n(k * k / 3.0), inside);
                self.sum += near.choose(inside, beyond);
                let weight = near.choose(rest * rest, n(0.0));
                let full = near.choose(n(-4.0 / (k * k)) * rest, n(0.0));
                (weight, full.max(-weight.over(s.max(n(f64::MIN_POSITIVE)))))
            }
        }
    }

    /// Counts corners that cannot be seen.
    #[inline(always)]
    fn hide(&mut self, count: Lanes<S>) {
        self.hidden += count;
    }

    #[inline(always)]
    fn flush(&mut self, k: f64) {
        let mut values = [0.0; WIDEST_REGISTER];
        self.product.store(&mut values);
        values.iter_mut().take(Lanes::<S>::COUNT).for_each(|value| *value = value.ln_1p() * k * k);
        self.sum += Lanes::load(self.simd, &values, 0);
        self.product = Lanes::splat(self.simd, 0.0);
        self.factors = 0;
    }

    /// Half the sum of losses.
    #[inline(always)]
    fn finish(mut self) -> f64 {
        if let Loss::Cauchy(k) = self.loss {
            self.flush(k);
        }
        0.5 * (self.sum.sum() + self.hidden.sum() * self.loss.evaluate(UNSEEN).0)
    }
}
