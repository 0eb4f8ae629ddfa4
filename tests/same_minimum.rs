//! Without a guess and from the truth, the search ends in the same minimum. `examples/same_minimum.rs` tries a hundred cells of each kind.

#[path = "support/minimum.rs"]
mod minimum;
#[path = "support/random_cells.rs"]
mod random_cells;

use rayon::prelude::*;

#[test]
fn the_closed_form_start_ends_in_the_minimum_of_the_truth() {
    for kind in minimum::KINDS {
        let all: Vec<[f64; 3]> = (0..20u64).into_par_iter().map(|seed| minimum::apart(kind, 7000 + seed)).collect();
        for (seed, [cost, t, r]) in all.into_iter().enumerate() {
            assert!(cost < 1e-6 && t < 1e-6 && r < 1e-6, "{kind:?} {seed}: cost {cost}, {t} m, {r} rad");
        }
    }
}
