//! The covariance of measurements whose terms are never in memory at once: what a pass over them gathers, and what comes of it.
//!
//! How a group's gradient is corrected for its own leverage depends on the covariance of all. That of the pass before will do: the states of
//! two passes differ by less than a standard deviation by then, and the last two by next to nothing.

use std::collections::BTreeMap;

use super::covariance::{Covariance, covariance, from_information};
use super::sandwich::{Kind, around};
use crate::solve::terms::{StillCorner, Term};
use crate::solve::{Assembler, Normal, Plan, State};

/// Bytes of the terms that are held at once.
const HELD: usize = 8 << 20;
/// Terms held at once all the same.
const FEWEST: usize = 4;

/// Bytes of terms that are kept rather than formed twice.
const KEPT: usize = 64 << 20;

/// The covariance at a state, as [`covariance()`] has it, from an assembler without beliefs; `noise` tells the noise from the sum of the squared whitened twists of
/// robots that stop inexactly. Terms that would take much memory are formed twice: each group's gradient needs the covariance of all.
#[must_use]
pub fn covariance_at(
    plan: &Plan,
    measuring: &mut Assembler<'_>,
    state: &State,
    believed: &Normal,
    noise: impl Fn(f64) -> f64,
) -> Covariance {
    if plan.solver().sparse || measuring.term_bytes() <= KEPT {
        let terms = measuring.terms(state);
        return covariance(plan, &terms, believed, noise(terms.stops));
    }
    let mut normal = Normal::default();
    measuring.reduced(state, &mut normal);
    let noise = noise(measuring.stops(state));
    let mut gathering = Gathering::new(from_sums(plan, &normal.hessian, believed, noise));
    gathering.add(measuring, state);
    gathering.finish(plan, &normal.hessian, believed, noise)
}

/// What one pass gathers, part by part.
#[derive(Clone, Debug)]
pub struct Gathering {
    against: Covariance,
    configurations: Kind,
    corners: BTreeMap<StillCorner, Term>,
}

/// The covariance from the information matrix alone (row-major, natural units); the rest as in [`super::covariance()`].
#[must_use]
pub fn from_sums(plan: &Plan, information: &[f64], believed: &Normal, noise: f64) -> Covariance {
    from_information(plan, information, &believed.hessian, noise)
}

impl Gathering {
    /// Begins, against the covariance of the pass before.
    #[must_use]
    pub fn new(against: Covariance) -> Self {
        let configurations = Kind::new(against.matrix.ncols());
        Self { against, configurations, corners: BTreeMap::new() }
    }

    /// Adds the measurements of an assembler without beliefs; all that is measured at a configuration in one go.
    pub fn add(&mut self, assembler: &mut Assembler<'_>, state: &State) {
        let n = self.against.matrix.ncols().max(1);
        let most = (HELD / (8 * n * n)).max(FEWEST);
        let (kind, against) = (&mut self.configurations, &self.against);
        let rest = assembler.terms_in_batches(state, most, |terms| kind.add(against, &terms));
        for term in rest.corners {
            let Some(corner) = term.corner else { continue };
            match self.corners.get_mut(&corner) {
                Some(known) => known.include(&term),
                None => drop(self.corners.insert(corner, term)),
            }
        }
    }

    /// The covariance of all that was added, of which `information` is the sum (row-major, natural units); the rest as in [`super::covariance()`].
    #[must_use]
    pub fn finish(self, plan: &Plan, information: &[f64], believed: &Normal, noise: f64) -> Covariance {
        let mut covariance = from_sums(plan, information, believed, noise);
        // Where nothing at all is known the gradients may not even be numbers.
        if covariance.open.len() < plan.unknowns.count {
            let corners: Vec<Term> = self.corners.into_values().collect();
            let mut kind = Kind::new(plan.unknowns.count);
            kind.add(&covariance, &corners);
            covariance.clusters = around(&covariance, &believed.hessian, [self.configurations, kind]);
        }
        covariance
    }
}
