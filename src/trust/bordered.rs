//! Equations of the shared unknowns with some more columns, dense or sparse as the plan's own are.

use faer::Mat;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use std::collections::BTreeSet;
use std::sync::Arc;

use crate::solve::{Factor, Normal, Pattern, Plan, Symbolic};

/// Where each column of a term goes, and the term's information.
pub(super) type Placed<'a> = (Vec<Option<usize>>, &'a DMatrix<f64>);

/// A factor of equations with unit diagonal: the columns carry metres, radians, pixels and factors.
pub(super) struct Solver {
    scale: Vec<f64>,
    form: Form,
}

enum Form {
    Dense(Box<Cholesky<f64, Dyn>>),
    Sparse(Factor),
}

impl Solver {
    /// The sum of `terms` and `weight` times what is believed, over `count` columns of which the
    /// first are the plan's; none if it is not positive definite.
    pub(super) fn new(plan: &Plan, terms: &[Placed<'_>], believed: &Normal, weight: f64, count: usize) -> Option<Self> {
        if believed.symbolic().is_none() {
            return Self::dense(plan, terms, believed, weight, count);
        }
        let mut blocks: Vec<(usize, usize)> = plan.unknowns.blocks.iter().map(|b| (b.start, b.count())).collect();
        blocks.extend((plan.unknowns.count..count).map(|column| (column, 1)));
        let of = |column: &usize| blocks.partition_point(|block| block.0 <= *column) - 1;
        let cliques: BTreeSet<Vec<usize>> = terms
            .iter()
            .map(|(at, _)| at.iter().flatten().map(of).collect::<BTreeSet<usize>>().into_iter().collect())
            .collect();
        let pattern = Pattern::new(&blocks, cliques.iter().map(Vec::as_slice));
        let symbolic = Arc::new(Symbolic::new(pattern)?);
        let pattern = &symbolic.pattern;
        let mut values = vec![0.0; pattern.places()];
        for column in 0..plan.unknowns.count {
            for place in pattern.range(column) {
                let row = pattern.rows()[place];
                if row < plan.unknowns.count {
                    values[place] = weight * believed.entry(row, column);
                }
            }
        }
        for (at, information) in terms {
            for (i, a) in at.iter().enumerate() {
                for (j, b) in at.iter().enumerate() {
                    if let (Some(a), Some(b)) = (a, b)
                        && a >= b
                        && let Some(place) = pattern.place(*a, *b)
                    {
                        values[place] += information[(i, j)];
                    }
                }
            }
        }
        let diagonal = |column: usize| values[pattern.range(column).start].max(f64::MIN_POSITIVE);
        let scale: Vec<f64> = (0..count).map(|column| 1.0 / diagonal(column).sqrt()).collect();
        for column in 0..count {
            for place in pattern.range(column) {
                values[place] *= scale[column] * scale[pattern.rows()[place]];
            }
        }
        let mut factor = Factor::new(&symbolic);
        factor.factorise(&values).then(|| Self { scale, form: Form::Sparse(factor) })
    }

    fn dense(plan: &Plan, terms: &[Placed<'_>], believed: &Normal, weight: f64, count: usize) -> Option<Self> {
        let shared = plan.unknowns.count;
        let mut information = DMatrix::zeros(count, count);
        let prior = DMatrix::from_row_slice(shared, shared, &believed.hessian) * weight;
        information.view_mut((0, 0), (shared, shared)).copy_from(&prior);
        for (at, own) in terms {
            for (i, a) in at.iter().enumerate() {
                let Some(a) = *a else { continue };
                for (j, b) in at.iter().enumerate() {
                    if let Some(b) = *b {
                        information[(a, b)] += own[(i, j)];
                    }
                }
            }
        }
        let scale: Vec<f64> = (0..count).map(|i| 1.0 / information[(i, i)].max(f64::MIN_POSITIVE).sqrt()).collect();
        let scaled = DMatrix::from_fn(count, count, |i, j| information[(i, j)] * scale[i] * scale[j]);
        Some(Self { scale, form: Form::Dense(Box::new(scaled.cholesky()?)) })
    }

    /// Solves for one right-hand side.
    pub(super) fn solve(&self, right: &DVector<f64>) -> DVector<f64> {
        let n = right.len();
        let scaled = DVector::from_fn(n, |i, _| right[i] * self.scale[i]);
        match &self.form {
            Form::Dense(factor) => {
                let solution = factor.solve(&scaled);
                DVector::from_fn(n, |i, _| solution[i] * self.scale[i])
            }
            Form::Sparse(factor) => {
                let mut x = Mat::from_fn(n, 1, |i, _| scaled[i]);
                factor.solve(x.as_mut(), &mut factor.room(1));
                DVector::from_fn(n, |i, _| x[(i, 0)] * self.scale[i])
            }
        }
    }
}
