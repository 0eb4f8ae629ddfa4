//! Condensing corners, a register of points at a time.
//!
//! With `J` (2 x unknowns) the derivative of a point's pixel, `A = sum w W^T W` and `g = sum w W^T W d` over its observations (whitener `W`,
//! difference `d` from the measured pixel, robust weight `w`; under a robust loss `A` has the loss' own curvature too, see
//! [`super::loss::Loss::weight_and_bend`]), the point adds `J^T A J` and `J^T g` to the block's matrix. `A` and `g` cost little
//! for each picture; `J` and the products are formed once a point.

use std::marker::PhantomData;

use pulp::{Arch, Simd, WithSimd};

use super::chunk::{PIXEL, PackedBlock, WEIGHT};
use super::kernels::{Condensed, WIDEST};
use super::lanes::{Lanes, Splat, Truths};
use super::lens_lanes::{Differentiated, LensLanes, Projected};
use super::lines::{align_frame, in_lines, room_in_lines};
use super::loss::Loss;
use super::robust_lanes::Robust;
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
                const TILED: usize = (7 + PARAMETERS).div_ceil(WIDE) * WIDE;
                arch.dispatch(CondenseFree::<L, { 7 + PARAMETERS }, TILED, { 4 * TILED + 1 }> { view: self, out, lens: PhantomData });
            } else {
                arch.dispatch(Condense::<L> { view: self, out, lens: PhantomData });
            }
        });
    }

    /// The cost alone.
    pub(super) fn cost(self, arch: Arch) -> f64 {
        with_lens!(self.model, L => arch.dispatch(Cost::<L> { view: self, lens: PhantomData }))
    }
}

/// The task of condensing over the twist alone: the sums are as few as the processor has registers.
struct Condense<'a, 'b, L> {
    view: View<'a>,
    out: &'b mut Condensed,
    lens: PhantomData<L>,
}

impl<L: LensLanes> WithSimd for Condense<'_, '_, L> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        align_frame();
        let (view, corners) = (&self.view, &self.view.corners);
        let zero = Lanes::splat(simd, 0.0);
        let rigid = Rigid::new(simd, view.camera_from_target);
        let mut robust = Robust::new(simd, view.loss);
        let mut sums = [[zero; 7]; 6];
        let mut first = 0;
        for (register, &end) in corners.ends.iter().enumerate() {
            let point = place(simd, corners, register);
            let at: Differentiated<S> = L::differentiate_lanes(simd, view.lens, rigid.apply(&point));
            let total = view.total(simd, &mut robust, register, first..end as usize, at.seen, &at.pixel);
            first = end as usize;
            let u = rigid.row(&point, &at.by_point[0]);
            let v = rigid.row(&point, &at.by_point[1]);
            let [uu, uv, vv] = total.weight;
            for i in 0..6 {
                let au = uu.times_plus(u[i], uv * v[i]);
                let av = uv.times_plus(u[i], vv * v[i]);
                for j in 0..i + 1 {
                    sums[j][i] = u[j].times_plus(au, v[j].times_plus(av, sums[j][i]));
                }
                sums[i][6] = u[i].times_plus(total.slope[0], v[i].times_plus(total.slope[1], sums[i][6]));
            }
        }
        let m = &mut self.out.matrix;
        for i in 0..6 {
            for j in i..7 {
                m[i][j] = sums[i][j].sum();
            }
        }
        self.out.size = 7;
        self.out.cost = corners.constant + robust.finish();
    }
}

/// The task of condensing over the twist and the lens: `W` is 7 plus the lens' parameters, `P` that in whole tiles. The sums are too many for the
/// processor's registers, so rows are set aside and multiplied tile by tile.
struct CondenseFree<'a, 'b, L, const W: usize, const P: usize, const R: usize> {
    view: View<'a>,
    out: &'b mut Condensed,
    lens: PhantomData<L>,
}

/// Rows of sums in a tile, and columns.
const TALL: usize = 2;
const WIDE: usize = 4;
/// Points whose rows are set aside at most: they stay near the processor.
const ASIDE: usize = 32;
/// Numbers of the rows set aside at most: of the largest lens.
pub(super) const MOST_ROOM: usize = room_in_lines(ASIDE * (4 * WIDEST.div_ceil(WIDE) * WIDE + 1));

impl<L: LensLanes, const W: usize, const P: usize, const R: usize> WithSimd for CondenseFree<'_, '_, L, W, P, R> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        align_frame();
        let (view, corners) = (&self.view, &self.view.corners);
        let rigid = Rigid::new(simd, view.camera_from_target);
        let mut robust = Robust::new(simd, view.loss);
        let Condensed { matrix, rows, size, cost } = self.out;
        let rows = in_lines(rows, ASIDE * R);
        // For each register of points: the rows of `J`, and those of `[A J, g]`. What stands past `W` is never looked at.
        let (aside, _) = S::as_mut_simd_f64s(rows).0.as_chunks_mut::<R>();
        for row in &mut matrix[..W - 1] {
            row[..W].fill(0.0);
        }
        let (mut register, mut first) = (0, 0);
        for ends in corners.ends.chunks(aside.len()) {
            for (rows, &end) in aside.iter_mut().zip(ends) {
                let ([us, vs, aus, avs], _) = rows.as_chunks_mut::<P>() else { return };
                let point = place(simd, corners, register);
                let at: Differentiated<S> = L::differentiate_lanes(simd, view.lens, rigid.apply(&point));
                let total = view.total(simd, &mut robust, register, first..end as usize, at.seen, &at.pixel);
                (register, first) = (register + 1, end as usize);
                let twist = [rigid.row(&point, &at.by_point[0]), rigid.row(&point, &at.by_point[1])];
                let [uu, uv, vv] = total.weight;
                for i in 0..W - 1 {
                    let (u, v) = if i < 6 {
                        (twist[0][i], twist[1][i])
                    } else {
                        (at.by_parameter[0][i - 6], at.by_parameter[1][i - 6])
                    };
                    (us[i], vs[i]) = (u.values(), v.values());
                    aus[i] = uu.times_plus(u, uv * v).values();
                    avs[i] = uv.times_plus(u, vv * v).values();
                }
                (aus[W - 1], avs[W - 1]) = (total.slope[0].values(), total.slope[1].values());
            }
            multiply::<S, W, P, R>(simd, &aside[..ends.len()], matrix);
        }
        *size = W;
        *cost = corners.constant + robust.finish();
    }
}

/// Adds `J^T [A J, g]` of the rows set aside to a matrix, tile by tile.
#[inline(always)]
fn multiply<S: Simd, const W: usize, const P: usize, const R: usize>(
    simd: S,
    aside: &[[S::f64s; R]],
    matrix: &mut [[f64; WIDEST]; WIDEST],
) {
    for i in (0..W - 1).step_by(TALL) {
        for j in (i / WIDE * WIDE..W).step_by(WIDE) {
            let mut tile = [[Lanes::splat(simd, 0.0); WIDE]; TALL];
            for rows in aside {
                let ([us, vs, aus, avs], _) = rows.as_chunks::<P>() else { return };
                for a in 0..TALL {
                    let (u, v) = (Lanes::of(simd, us[i + a]), Lanes::of(simd, vs[i + a]));
                    for b in 0..WIDE {
                        let (au, av) = (Lanes::of(simd, aus[j + b]), Lanes::of(simd, avs[j + b]));
                        tile[a][b] = u.times_plus(au, v.times_plus(av, tile[a][b]));
                    }
                }
            }
            for a in 0..TALL {
                for b in 0..WIDE.min(W - j) {
                    matrix[i + a][j + b] += tile[a][b].sum();
                }
            }
        }
    }
}

/// The task of evaluating the cost.
struct Cost<'a, L> {
    view: View<'a>,
    lens: PhantomData<L>,
}

impl<L: LensLanes> WithSimd for Cost<'_, L> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        align_frame();
        let (view, corners) = (&self.view, &self.view.corners);
        let rigid = Rigid::new(simd, view.camera_from_target);
        let mut robust = Robust::new(simd, view.loss);
        let mut first = 0;
        for (register, &end) in corners.ends.iter().enumerate() {
            let point = place(simd, corners, register);
            let at: Projected<S> = L::project_lanes(simd, view.lens, rigid.apply(&point));
            for observation in first..end as usize {
                robust.add(Seen::new(simd, corners, observation, &at.pixel, at.seen).squared);
            }
            robust.hide(at.seen, Lanes::load(simd, corners.counts, register));
            first = end as usize;
        }
        corners.constant + robust.finish()
    }
}

/// A register of points.
#[inline(always)]
fn place<S: Simd>(simd: S, corners: &PackedBlock<'_>, register: usize) -> [Lanes<S>; 3] {
    let first = 3 * register;
    [
        Lanes::load(simd, corners.points, first),
        Lanes::load(simd, corners.points, first + 1),
        Lanes::load(simd, corners.points, first + 2),
    ]
}

/// A register of points as one observation shows them.
struct Seen<S: Simd> {
    /// `W^T W`: uu, uv, vv.
    weight: [Lanes<S>; 3],
    /// `W^T W d`.
    slope: [Lanes<S>; 2],
    /// `|W d|^2`, zero for a point that the camera cannot see.
    squared: Lanes<S>,
}

impl<S: Simd> Seen<S> {
    #[inline(always)]
    fn new(simd: S, corners: &PackedBlock<'_>, observation: usize, pixel: &[Lanes<S>; 2], seen: Truths<S>) -> Self {
        let du = pixel[0] - Lanes::load(simd, corners.pixels, PIXEL * observation);
        let dv = pixel[1] - Lanes::load(simd, corners.pixels, PIXEL * observation + 1);
        let uu = Lanes::load(simd, corners.weights, WEIGHT * observation);
        let uv = Lanes::load(simd, corners.weights, WEIGHT * observation + 1);
        let vv = Lanes::load(simd, corners.weights, WEIGHT * observation + 2);
        let slope = [uu.times_plus(du, uv * dv), uv.times_plus(du, vv * dv)];
        let squared = seen.choose(slope[0].times_plus(du, slope[1] * dv), Lanes::splat(simd, 0.0));
        Self { weight: [uu, uv, vv], slope, squared }
    }
}

/// A transform whose numbers fill registers.
struct Rigid<S: Simd> {
    r: [[Lanes<S>; 3]; 3],
    t: [Lanes<S>; 3],
}

impl<S: Simd> Rigid<S> {
    #[inline(always)]
    fn new(simd: S, pose: &Pose) -> Self {
        let (m, t, n) = (pose.rotation_matrix(), &pose.translation, Splat(simd));
        let mut r = [[n.of(0.0); 3]; 3];
        for i in 0..3 {
            for j in 0..3 {
                r[i][j] = n.of(m[(i, j)]);
            }
        }
        Self { r, t: [n.of(t.x), n.of(t.y), n.of(t.z)] }
    }

    #[inline(always)]
    fn apply(&self, p: &[Lanes<S>; 3]) -> [Lanes<S>; 3] {
        let mut moved = self.t;
        for (sum, [x, y, z]) in moved.iter_mut().zip(self.r) {
            *sum = x.times_plus(p[0], y.times_plus(p[1], z.times_plus(p[2], *sum)));
        }
        moved
    }

    /// The derivative of a coordinate to the twist on the right: `R^T g`, and the cross product of the point with it.
    #[inline(always)]
    fn row(&self, p: &[Lanes<S>; 3], g: &[Lanes<S>; 3]) -> [Lanes<S>; 6] {
        let mut along = *g;
        for (i, sum) in along.iter_mut().enumerate() {
            *sum = self.r[0][i].times_plus(g[0], self.r[1][i].times_plus(g[1], self.r[2][i] * g[2]));
        }
        let [x, y, z] = along;
        let about = [p[1].times_plus(z, -(p[2] * y)), p[2].times_plus(x, -(p[0] * z)), p[0].times_plus(y, -(p[1] * x))];
        [x, y, z, about[0], about[1], about[2]]
    }
}

/// The sums over a point's observations.
struct Total<S: Simd> {
    /// `A`: uu, uv, vv.
    weight: [Lanes<S>; 3],
    /// `g`.
    slope: [Lanes<S>; 2],
}

impl View<'_> {
    /// Sums over the observations of a register of points.
    #[inline(always)]
    fn total<S: Simd>(
        &self,
        simd: S,
        robust: &mut Robust<S>,
        register: usize,
        observations: std::ops::Range<usize>,
        seen: Truths<S>,
        pixel: &[Lanes<S>; 2],
    ) -> Total<S> {
        let zero = Lanes::splat(simd, 0.0);
        let (mut weight, mut slope) = ([zero; 3], [zero; 2]);
        for observation in observations {
            let one = Seen::new(simd, &self.corners, observation, pixel, seen);
            let (w, bend) = robust.add(one.squared);
            let w = seen.choose(w, zero);
            for (sum, value) in weight.iter_mut().zip(one.weight) {
                *sum = w.times_plus(value, *sum);
            }
            for (sum, value) in slope.iter_mut().zip(one.slope) {
                *sum = w.times_plus(value, *sum);
            }
            if self.curved {
                // The loss' own curvature along the residual.
                let [gu, gv] = one.slope;
                let bend = seen.choose(bend, zero);
                let (bu, bv) = (bend * gu, bend * gv);
                weight[0] = bu.times_plus(gu, weight[0]);
                weight[1] = bu.times_plus(gv, weight[1]);
                weight[2] = bv.times_plus(gv, weight[2]);
            }
        }
        robust.hide(seen, Lanes::load(simd, self.corners.counts, register));
        Total { weight, slope }
    }
}
