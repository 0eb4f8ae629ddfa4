//! Random cells solved without a guess and from the truth: how many end in the same minimum.
//!
//! `cargo run --release --example same_minimum -- [CELLS]` (100 of each kind unless something else is said)

#[path = "../tests/support/minimum.rs"]
mod minimum;
#[path = "../tests/support/random_cells.rs"]
mod random_cells;

use rayon::prelude::*;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let cells: u64 = std::env::args().nth(1).map_or(Ok(100), |text| text.parse())?;
    println!("| cells | same minimum | largest relative difference of the cost | mm | deg |");
    println!("|---|---|---|---|---|");
    for kind in minimum::KINDS {
        let all: Vec<[f64; 3]> = (0..cells).into_par_iter().map(|seed| minimum::apart(kind, seed)).collect();
        let same = all.iter().filter(|[cost, t, r]| *cost < 1e-6 && *t < 1e-6 && *r < 1e-6).count();
        let worst = |i: usize| all.iter().map(|one| one[i]).fold(0.0, f64::max);
        let (cost, t, r) = (worst(0), worst(1) * 1e3, worst(2).to_degrees());
        println!("| {} | {same} of {cells} | {cost:.1e} | {t:.1e} | {r:.1e} |", kind.words());
    }
    Ok(())
}
