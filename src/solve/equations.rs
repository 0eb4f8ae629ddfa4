//! Whether the shared equations are kept and solved as a dense matrix or as a sparse one.
//!
//! The choice is made once, from the pattern alone, by counted work: the multiplications of a dense Cholesky factorisation against those of a sparse one
//! after faer's minimum degree ordering. Cells of one hall whose robots never meet, or many targets that stand still, make a large matrix of which nearly all
//! is zero; few cameras that see the same board make one that is full.

use std::collections::BTreeSet;
use std::sync::Arc;

use super::assemble::Shape;
use super::pattern::Pattern;
use super::plan::Group;
use super::sparse::Symbolic;
use super::unknowns::Unknowns;
use crate::layout::SolverChoice;

/// Unknowns up to which a factorisation takes a fraction of a millisecond either way, so that no pattern is looked for.
const FEW: usize = 200;
/// Sparse factors are reached by way of lists of places: a multiplication costs about this many dense ones.
const PRICE: f64 = 4.0;

/// How the shared equations are solved, and why.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Solver {
    /// Sparse, or else dense.
    pub sparse: bool,
    /// Shared unknowns.
    pub unknowns: usize,
    /// Multiplications of one sparse factorisation, where they have been counted.
    pub sparse_work: Option<f64>,
    /// Whether it was asked for.
    pub asked: bool,
}

impl Solver {
    /// Multiplications of one dense factorisation.
    #[must_use]
    pub fn dense_work(&self) -> f64 {
        (self.unknowns as f64).powi(3) / 6.0
    }

    /// `dense` or `sparse`.
    #[must_use]
    pub fn name(&self) -> &'static str {
        if self.sparse { "sparse" } else { "dense" }
    }

    /// What was chosen and why.
    #[must_use]
    pub fn words(&self) -> String {
        let (name, n) = (self.name(), self.unknowns);
        let millions = |work: f64| format!("{:.3}", work / 1e6);
        match (self.asked, self.sparse_work) {
            (true, _) => format!("{name} equations of {n} shared unknowns, as asked"),
            (false, None) => format!("dense equations: {n} shared unknowns are few"),
            (false, Some(work)) => format!(
                "{name} equations of {n} shared unknowns: {} million multiplications a factorisation if sparse, {} if dense",
                millions(work),
                millions(self.dense_work())
            ),
        }
    }
}

/// The chosen form of the shared equations.
#[derive(Clone, Debug, Default)]
pub(crate) struct Equations {
    pub(crate) solver: Solver,
    /// The pattern and its symbolic factor, if sparse.
    pub(crate) sparse: Option<Arc<Symbolic>>,
}

impl Equations {
    /// Chooses for the groups of a plan; `shapes` tells the columns of each.
    pub(super) fn new(unknowns: &Unknowns, groups: &[Group], shapes: &[Shape], choice: SolverChoice) -> Self {
        let asked = choice != SolverChoice::Auto;
        let mut solver = Solver { sparse: false, unknowns: unknowns.count, sparse_work: None, asked };
        if choice == SolverChoice::Dense || (choice == SolverChoice::Auto && unknowns.count <= FEW) {
            return Self { solver, sparse: None };
        }
        let symbolic = Symbolic::new(pattern(unknowns, groups, shapes));
        let Some(symbolic) = symbolic else { return Self { solver, sparse: None } };
        solver.sparse_work = Some(symbolic.work());
        solver.sparse = choice == SolverChoice::Sparse || PRICE * symbolic.work() < solver.dense_work();
        Self { solver, sparse: solver.sparse.then(|| Arc::new(symbolic)) }
    }
}

/// Which blocks of unknowns meet: those of a path, and those of all paths across something that moves, since it is eliminated from all of them at once.
fn pattern(unknowns: &Unknowns, groups: &[Group], shapes: &[Shape]) -> Pattern {
    let places: Vec<(usize, usize)> = unknowns.blocks.iter().map(|block| (block.start, block.count())).collect();
    let blocks = |shape: &Shape| -> Vec<usize> {
        let of = |start: usize| places.partition_point(|place| place.0 <= start) - 1;
        let mut blocks: Vec<usize> = shape.shared.iter().map(|shared| of(shared.1)).collect();
        blocks.sort_unstable();
        blocks.dedup();
        blocks
    };
    let own: Vec<Vec<usize>> = shapes.iter().map(blocks).collect();
    let count = groups.iter().flat_map(|group| &group.blocks).map(|block| block.configuration + 1).max().unwrap_or(0);
    let mut moving: Vec<Vec<usize>> = vec![Vec::new(); count];
    for (index, group) in groups.iter().enumerate().filter(|(_, group)| !group.compiled.moving.is_empty()) {
        group.blocks.iter().for_each(|block| moving[block.configuration].push(index));
    }
    let meetings: BTreeSet<Vec<usize>> = moving.into_iter().collect();
    let together = |groups: &Vec<usize>| {
        let all: BTreeSet<usize> = groups.iter().flat_map(|group| own[*group].iter().copied()).collect();
        all.into_iter().collect::<Vec<usize>>()
    };
    let together: Vec<Vec<usize>> = meetings.iter().map(together).collect();
    Pattern::new(&places, own.iter().chain(&together).map(Vec::as_slice))
}
