//! The covariance of a cell whose shared equations are sparse: never a whole matrix, but what is asked of it.
//!
//! Columns of the inverse come from a sparse factor, six at a time, and those of parts that share nothing together. A first pass over them keeps the entries that the gradients of the cluster-robust covariance
//! need, a second one the blocks of single unknowns of all three matrices.

use faer::Mat;
use nalgebra::DMatrix;
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::sync::Arc;

use super::covariance::UNDETERMINED;
use super::form::{Columns, Vectors};
use super::inverse::Inverse;
use super::parts::{Part, parts};
use super::sandwich::{Scatter, adjust};
use super::undetermined::WEAK;
use super::weakest::{Direction, weakest};
use crate::solve::terms::{Term, Terms};
use crate::solve::{Normal, Pattern, Plan, Symbolic, Unknown};

/// Gradients of one kind of cluster, or its information where they show nothing in common.
struct Kind {
    gradients: Vectors,
    /// On the pattern, in units.
    information: Vec<f64>,
    scatter: Scatter,
}

/// What a large problem keeps.
pub(super) struct Large {
    symbolic: Arc<Symbolic>,
    inverse: Option<Inverse>,
    believed: Vec<f64>,
    kinds: Vec<Kind>,
    parts: Vec<Part>,
    /// First columns of the blocks of unknowns, and for each its own part of the three matrices.
    starts: Vec<usize>,
    own: Vec<[DMatrix<f64>; 3]>,
    /// Determined, but weakly: directions and their standard deviations.
    pub(super) weak: Vec<(Vec<f64>, f64)>,
}

/// Open directions and what the rest is known to.
pub(super) struct Judged {
    pub(super) large: Large,
    pub(super) open: Vec<Vec<f64>>,
    pub(super) open_sigma: Vec<f64>,
    /// How the gradients of configurations and of corners scatter.
    pub(super) scatter: [Scatter; 2],
}

impl std::fmt::Debug for Large {
    fn fmt(&self, to: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(to, "Large({} blocks)", self.starts.len())
    }
}

impl PartialEq for Large {
    fn eq(&self, other: &Self) -> bool {
        self.starts == other.starts && self.own == other.own && self.weak == other.weak
    }
}

/// Judges a problem with sparse equations; `noise` as in [`super::covariance::covariance`].
pub(super) fn judge(plan: &Plan, symbolic: &Arc<Symbolic>, terms: &Terms, believed: &Normal, noise: f64) -> Judged {
    let units = plan.unknowns.units();
    let pattern = &symbolic.pattern;
    let in_units = |values: &[f64], factor: f64| -> Vec<f64> {
        let mut out = values.to_vec();
        for column in 0..pattern.columns() {
            for place in pattern.range(column) {
                out[place] *= units[column] * units[pattern.rows()[place]] * factor;
            }
        }
        out
    };
    let measured = [&terms.configurations, &terms.corners].map(|terms| in_units(&values(pattern, terms), 1.0));
    let believed = in_units(&believed.hessian, 1.0);
    let sum = |noise: f64| -> Vec<f64> {
        let weight = 1.0 / (noise * noise);
        let [a, b] = &measured;
        a.iter().zip(b).zip(&believed).map(|((a, b), own)| (a + b) * weight + own).collect()
    };
    let (judged, fitted) = (sum(noise.max(1.0)), sum(noise.max(1e-9)));
    let (mut open, mut open_sigma) = (Vec::new(), Vec::new());
    let largest = largest(pattern, &judged);
    let (bound, limit) = (1.0 / (UNDETERMINED * UNDETERMINED), 1.0 / (WEAK * WEAK));
    let candidates = if judged.iter().all(|x| x.is_finite()) { weakest(symbolic, &judged, limit) } else { Vec::new() };
    let mut weak: Vec<Direction> = Vec::new();
    for (direction, value) in candidates {
        if value >= bound {
            weak.push((direction, value));
            continue;
        }
        // Below this, rounding alone could have made the eigenvalue.
        open_sigma.push(if value <= 1e-14 * largest { f64::INFINITY } else { 1.0 / value.sqrt() });
        open.push(direction);
    }
    if noise < 1.0 && !weak.is_empty() {
        // What is weak is judged by the fitted noise.
        weak = weakest(symbolic, &fitted, limit);
        weak.retain(|(direction, value)| *value >= bound && alone(direction, &open));
    }
    let weak = weak.into_iter().map(|(direction, value)| (direction, 1.0 / value.sqrt())).collect();
    let weight = 1.0 / noise.max(1e-9).powi(2);
    let pairs = pairs(plan, terms);
    let kinds_of_terms = [&terms.configurations[..], &terms.corners];
    // Open directions may reach from one part into another.
    let parts = parts([pattern, &pairs], &plan.unknowns.blocks, kinds_of_terms, open.is_empty());
    let mut large = Large {
        symbolic: Arc::clone(symbolic),
        inverse: Inverse::new(symbolic, fitted, &open),
        believed,
        kinds: Vec::new(),
        parts,
        starts: plan.unknowns.blocks.iter().map(|block| block.start).collect(),
        own: Vec::new(),
        weak,
    };
    let entries = large.entries(plan, &pairs);
    let entry = |i: usize, j: usize| pairs.place(i, j).map_or(0.0, |place| entries[place]);
    let kinds = kinds_of_terms.into_iter().zip(measured).map(|(terms, information)| {
        let (scatter, gradients) = adjust(terms, &units, noise, &entry);
        let mut vectors = Vectors::default();
        terms.iter().zip(&gradients).for_each(|(term, gradient)| vectors.push(&term.columns, gradient.iter()));
        Kind { gradients: vectors, information: information.iter().map(|x| x * weight).collect(), scatter }
    });
    large.kinds = kinds.collect();
    let scatter = [large.kinds[0].scatter, large.kinds[1].scatter];
    large.own = large.blocks(plan);
    Judged { large, open, open_sigma, scatter }
}

/// Whether a direction has little in common with others.
fn alone(direction: &[f64], others: &[Vec<f64>]) -> bool {
    let dot = |other: &Vec<f64>| other.iter().zip(direction).map(|(a, b)| a * b).sum::<f64>();
    others.iter().map(|other| dot(other).powi(2)).sum::<f64>() < 0.5
}

/// The largest eigenvalue, to some percent, by the power method.
fn largest(pattern: &Pattern, values: &[f64]) -> f64 {
    let n = pattern.columns();
    let mut vector: Vec<f64> = (0..n).map(|i| 1.0 + 0.1 * (i as f64).sin()).collect();
    let mut length = 0.0;
    for _ in 0..30 {
        let mut next = vec![0.0; n];
        pattern.multiply(values, 1.0, &vector, &mut next);
        length = next.iter().map(|x| x * x).sum::<f64>().sqrt();
        if !(length > 0.0 && length.is_finite()) {
            return f64::MIN_POSITIVE;
        }
        vector = next.iter().map(|x| x / length).collect();
    }
    length
}

/// The information of some terms on a pattern.
fn values(pattern: &Pattern, terms: &[Term]) -> Vec<f64> {
    let mut values = vec![0.0; pattern.places()];
    for term in terms {
        for (i, &a) in term.columns.iter().enumerate() {
            for (j, &b) in term.columns[..=i].iter().enumerate() {
                // What never meets on a path has no place, and is zero.
                if let Some(place) = pattern.place(a, b) {
                    values[place] += term.information[(i, j)];
                }
            }
        }
    }
    values
}

/// All pairs of unknowns that some term holds together.
fn pairs(plan: &Plan, terms: &Terms) -> Pattern {
    let blocks: Vec<(usize, usize)> = plan.unknowns.blocks.iter().map(|block| (block.start, block.count())).collect();
    let of = |column: &usize| blocks.partition_point(|block| block.0 <= *column) - 1;
    let cliques: BTreeSet<Vec<usize>> = terms
        .configurations
        .iter()
        .chain(&terms.corners)
        .map(|term| term.columns.iter().map(of).collect::<BTreeSet<usize>>().into_iter().collect())
        .collect();
    Pattern::new(&blocks, cliques.iter().map(Vec::as_slice))
}

impl Large {
    /// The covariance times a matrix; nothing where nothing is known.
    fn columns(&self, right: &Mat<f64>, room: &mut faer::dyn_stack::MemBuffer) -> Mat<f64> {
        let nothing = || Mat::zeros(right.nrows(), right.ncols());
        self.inverse.as_ref().map_or_else(nothing, |inverse| inverse.apply(right, room))
    }

    /// Does something with the covariance's columns of each block of unknowns, in parallel. One solve serves a block of every part: what it finds is zero in all
    /// parts but the block's own. `prepare` is given what a solve found, `of` that and what came of it for each of its blocks.
    fn each<P, R: Send>(
        &self,
        plan: &Plan,
        prepare: impl Fn(&Mat<f64>) -> P + Sync,
        of: impl Fn(&Part, &Unknown, &Mat<f64>, &P) -> R + Sync,
    ) -> Vec<R> {
        let (n, blocks) = (plan.unknowns.count, &plan.unknowns.blocks);
        let widest = blocks.iter().map(Unknown::count).max().unwrap_or(0);
        let room = || {
            let none = || faer::dyn_stack::MemBuffer::new(faer::dyn_stack::StackReq::empty());
            self.inverse.as_ref().map_or_else(none, |inverse| inverse.room(widest))
        };
        let turn = |room: &mut faer::dyn_stack::MemBuffer, turn: usize| -> Vec<(usize, R)> {
            let its: Vec<(&Part, usize)> =
                self.parts.iter().filter_map(|part| Some((part, *part.blocks.get(turn)?))).collect();
            let wide = its.iter().map(|(_, block)| blocks[*block].count()).max().unwrap_or(0);
            let mut unit = Mat::zeros(n, wide);
            for block in its.iter().map(|(_, block)| &blocks[*block]) {
                (0..block.count()).for_each(|j| unit[(block.start + j, j)] = 1.0);
            }
            let columns = self.columns(&unit, room);
            let prepared = prepare(&columns);
            its.into_iter().map(|(part, block)| (block, of(part, &blocks[block], &columns, &prepared))).collect()
        };
        let turns = self.parts.iter().map(|part| part.blocks.len()).max().unwrap_or(0);
        let found: Vec<Vec<(usize, R)>> = (0..turns).into_par_iter().map_init(room, turn).collect();
        let mut found: Vec<(usize, R)> = found.into_iter().flatten().collect();
        found.sort_by_key(|(block, _)| *block);
        found.into_iter().map(|(_, one)| one).collect()
    }

    /// The covariance's entries at the places of a pattern.
    fn entries(&self, plan: &Plan, pairs: &Pattern) -> Vec<f64> {
        let parts = self.each(
            plan,
            |_| (),
            |_, block, columns, ()| {
                let of = |j: usize| pairs.range(block.start + j).map(move |place| columns[(pairs.rows()[place], j)]);
                (0..block.count()).flat_map(of).collect::<Vec<f64>>()
            },
        );
        parts.concat()
    }

    fn blocks(&self, plan: &Plan) -> Vec<[DMatrix<f64>; 3]> {
        self.each(plan, Columns::new, |part, block, columns, rows| {
            let count = block.count();
            let own = DMatrix::from_fn(count, count, |i, j| columns[(block.start + i, j)]);
            let [clusters, shown] = self.around(rows, &own, std::slice::from_ref(part));
            [own, clusters, shown]
        })
    }

    /// `X^T M X` for the scatter of all clusters, and for that of kinds that show an error in common, in some parts; `X` are columns of the covariance, `own` the
    /// rows of them that they belong to: as many as the first columns that are asked for.
    fn around(&self, columns: &Columns, own: &DMatrix<f64>, parts: &[Part]) -> [DMatrix<f64>; 2] {
        let (pattern, count) = (&self.symbolic.pattern, own.nrows());
        let sum = |of: &dyn Fn(&Part) -> DMatrix<f64>| {
            let nothing = DMatrix::zeros(count, count);
            parts.iter().fold(nothing, |sum, part| sum + of(part).view((0, 0), (count, count)))
        };
        let believed = sum(&|part| columns.around(pattern, &self.believed, &part.columns));
        let scatter =
            |(place, kind): (usize, &Kind)| sum(&|part| columns.scatter(&kind.gradients, &part.clusters[place]));
        let scatters: Vec<DMatrix<f64>> = self.kinds.iter().enumerate().map(scatter).collect();
        let clusters = scatters.iter().fold(believed.clone(), |sum, scatter| sum + scatter);
        if !self.kinds.iter().any(|kind| kind.scatter.shown()) {
            // What all are believed to say together is what the covariance is the inverse of.
            return [clusters, own.clone()];
        }
        let shown = self.kinds.iter().zip(scatters).fold(believed, |all, (kind, scatter)| {
            let information = || sum(&|part| columns.around(pattern, &kind.information, &part.columns));
            all + if kind.scatter.shown() { scatter } else { information() }
        });
        [clusters, shown]
    }

    /// The three matrices of a linear function of the unknowns, `jacobian` in units.
    pub(super) fn of(&self, jacobian: &DMatrix<f64>) -> [DMatrix<f64>; 3] {
        let (rows, n) = jacobian.shape();
        let right = Mat::from_fn(n, rows, |i, j| jacobian[(j, i)]);
        let Some(inverse) = &self.inverse else { return std::array::from_fn(|_| DMatrix::zeros(rows, rows)) };
        let columns = inverse.apply(&right, &mut inverse.room(rows));
        let own = DMatrix::from_fn(rows, rows, |i, j| (0..n).map(|k| jacobian[(i, k)] * columns[(k, j)]).sum());
        let [clusters, shown] = self.around(&Columns::new(&columns), &own, &self.parts);
        [own, clusters, shown]
    }

    /// The part of one of the three matrices (information, clusters, shown) that belongs to neighbouring columns of one block.
    pub(super) fn own(&self, which: usize, start: usize, count: usize) -> DMatrix<f64> {
        let block = self.starts.partition_point(|first| *first <= start) - 1;
        let at = start - self.starts[block];
        self.own[block][which].view((at, at), (count, count)).into_owned()
    }
}
