//! The covariance of a cell whose shared equations are sparse: never a whole matrix, but what is asked of it.
//!
//! Columns of the inverse come from a sparse factor, six at a time. A first pass over them keeps the entries that the gradients of the cluster-robust covariance
//! need, a second one the blocks of single unknowns of all three matrices.

use faer::Mat;
use nalgebra::DMatrix;
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::sync::Arc;

use super::covariance::UNDETERMINED;
use super::form::{Columns, Vectors};
use super::inverse::Inverse;
use super::sandwich::{Scatter, adjust};
use super::undetermined::WEAK;
use super::weakest::{Direction, weakest};
use crate::solve::terms::{Term, Terms};
use crate::solve::{Normal, Pattern, Plan, Symbolic};

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
    let mut large = Large {
        symbolic: Arc::clone(symbolic),
        inverse: Inverse::new(symbolic, fitted, &open),
        believed,
        kinds: Vec::new(),
        starts: plan.unknowns.blocks.iter().map(|block| block.start).collect(),
        own: Vec::new(),
        weak,
    };
    let pairs = pairs(plan, terms);
    let entries = large.entries(plan, &pairs);
    let entry = |i: usize, j: usize| pairs.place(i, j).map_or(0.0, |place| entries[place]);
    let kinds = [&terms.configurations, &terms.corners].into_iter().zip(measured).map(|(terms, information)| {
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

    /// Does something with the covariance's columns of each block of unknowns, in parallel.
    fn each<R: Send>(&self, plan: &Plan, of: impl Fn(usize, usize, &Mat<f64>) -> R + Sync) -> Vec<R> {
        let n = plan.unknowns.count;
        let widest = plan.unknowns.blocks.iter().map(|block| block.count()).max().unwrap_or(0);
        let room = || {
            let none = || faer::dyn_stack::MemBuffer::new(faer::dyn_stack::StackReq::empty());
            self.inverse.as_ref().map_or_else(none, |inverse| inverse.room(widest))
        };
        let one = |room: &mut faer::dyn_stack::MemBuffer, block: &crate::solve::Unknown| {
            let unit = Mat::from_fn(n, block.count(), |i, j| f64::from(u8::from(i == block.start + j)));
            of(block.start, block.count(), &self.columns(&unit, room))
        };
        plan.unknowns.blocks.par_iter().map_init(room, one).collect()
    }

    /// The covariance's entries at the places of a pattern.
    fn entries(&self, plan: &Plan, pairs: &Pattern) -> Vec<f64> {
        let parts = self.each(plan, |start, count, columns| {
            let of = |j: usize| pairs.range(start + j).map(move |place| columns[(pairs.rows()[place], j)]);
            (0..count).flat_map(of).collect::<Vec<f64>>()
        });
        parts.concat()
    }

    fn blocks(&self, plan: &Plan) -> Vec<[DMatrix<f64>; 3]> {
        self.each(plan, |start, count, columns| {
            let own = DMatrix::from_fn(count, count, |i, j| columns[(start + i, j)]);
            let [clusters, shown] = self.around(columns, &own);
            [own, clusters, shown]
        })
    }

    /// `X^T M X` for the scatter of all clusters, and for that of kinds that show an error in common; `X` are columns of the covariance, `own` the rows of them
    /// that they belong to.
    fn around(&self, columns: &Mat<f64>, own: &DMatrix<f64>) -> [DMatrix<f64>; 2] {
        let rows = Columns::new(columns);
        let pattern = &self.symbolic.pattern;
        let believed = rows.around(pattern, &self.believed);
        let scatters: Vec<DMatrix<f64>> = self.kinds.iter().map(|kind| rows.scatter(&kind.gradients)).collect();
        let clusters = scatters.iter().fold(believed.clone(), |sum, scatter| sum + scatter);
        if !self.kinds.iter().any(|kind| kind.scatter.shown()) {
            // What all are believed to say together is what the covariance is the inverse of.
            return [clusters, own.clone()];
        }
        let shown = self.kinds.iter().zip(scatters).fold(believed, |sum, (kind, scatter)| {
            sum + if kind.scatter.shown() { scatter } else { rows.around(pattern, &kind.information) }
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
        let [clusters, shown] = self.around(&columns, &own);
        [own, clusters, shown]
    }

    /// The part of one of the three matrices (information, clusters, shown) that belongs to neighbouring columns of one block.
    pub(super) fn own(&self, which: usize, start: usize, count: usize) -> DMatrix<f64> {
        let block = self.starts.partition_point(|first| *first <= start) - 1;
        let at = start - self.starts[block];
        self.own[block][which].view((at, at), (count, count)).into_owned()
    }
}
