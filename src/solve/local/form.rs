//! What units that see something move along the same paths have in common: where the columns of their blocks go.

use super::super::assemble::Shape;
use super::super::lanes::WIDEST_REGISTER;
use super::super::plan::Plan;

/// A stretch of compact columns that stays together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Span {
    /// Its first compact column.
    pub(super) compact: usize,
    /// Where that goes in (local, shared, residual).
    pub(super) to: usize,
    pub(super) count: usize,
}

/// The columns of the units whose blocks belong to the same groups.
#[derive(Clone, Debug)]
pub(in super::super) struct Form {
    /// The groups of its blocks, one a block.
    pub(super) groups: Vec<usize>,
    /// Moving edges; edge `i` owns local columns `6 i .. 6 i + 6`.
    pub(in super::super) edges: Vec<usize>,
    /// Shared columns that its measurements touch, ascending.
    pub(in super::super) shared: Vec<usize>,
    /// For each block the stretches of its compact columns, the residual last.
    pub(super) spans: Vec<Vec<Span>>,
}

impl Form {
    /// Finds where everything goes.
    pub(super) fn new(groups: Vec<usize>, plan: &Plan, shapes: &[Shape]) -> Self {
        let (mut edges, mut shared) = (Vec::new(), Vec::new());
        for &group in &groups {
            for &(_, edge) in &plan.groups[group].compiled.moving {
                if !edges.contains(&edge) {
                    edges.push(edge);
                }
            }
            for &(_, first, count) in &shapes[group].shared {
                shared.extend(first..first + count);
            }
        }
        shared.sort_unstable();
        shared.dedup();
        let local = 6 * edges.len();
        let spans = groups.iter().map(|&group| {
            let shape = &shapes[group];
            let moving = plan.groups[group].compiled.moving.iter().map(|&(compact, edge)| {
                let slot = edges.iter().position(|known| *known == edge).unwrap_or(0);
                Span { compact, to: 6 * slot, count: 6 }
            });
            // The columns of one unknown are next to each other in any ascending list that has them.
            let still = shape.shared.iter().map(|&(compact, first, count)| Span {
                compact,
                to: local + shared.binary_search(&first).unwrap_or(0),
                count,
            });
            let residual = Span { compact: shape.width - 1, to: local + shared.len(), count: 1 };
            moving.chain(still).chain([residual]).filter(|span| span.count > 0).collect()
        });
        let spans = spans.collect();
        Self { groups, edges, shared, spans }
    }

    /// The number of local columns.
    pub(in super::super) fn local(&self) -> usize {
        6 * self.edges.len()
    }

    /// Numbers that eliminating a unit needs: its rows of (shared, residual) and one more, in whole registers.
    pub(super) fn room(&self) -> usize {
        let whole = (self.size() - self.local()).next_multiple_of(WIDEST_REGISTER);
        (self.local() + 1) * whole + WIDEST_REGISTER
    }

    /// Columns of the local rows: local, shared, residual.
    pub(in super::super) fn size(&self) -> usize {
        self.local() + self.shared.len() + 1
    }
}

/// A form's shared columns in a bundle's.
#[derive(Clone, Debug)]
pub(super) struct Place {
    /// For each of the form's shared columns and the residual its place among the bundle's.
    pub(super) of: Vec<usize>,
    /// The same as stretches: (first of the form's, first of the bundle's, count).
    pub(super) runs: Vec<(usize, usize, usize)>,
}

impl Place {
    pub(super) fn new(form: &Form, bundle: &[usize]) -> Self {
        let of = form.shared.iter().map(|column| bundle.binary_search(column).unwrap_or(0));
        let of: Vec<usize> = of.chain([bundle.len()]).collect();
        let mut runs: Vec<(usize, usize, usize)> = Vec::new();
        for (own, &place) in of.iter().enumerate() {
            match runs.last_mut() {
                Some((_, first, count)) if *first + *count == place => *count += 1,
                _ => runs.push((own, place, 1)),
            }
        }
        Self { of, runs }
    }
}
