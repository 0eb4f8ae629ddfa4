//! How often intervals of 95 % contain the truth, over many simulated cells of each kind; prints a table as Markdown.
//!
//! `cargo run --release --example coverage -- [CELLS] [STOPS]` (1000 cells of 25 stops unless something else is said)

#[path = "../tests/support/coverage.rs"]
mod coverage;
#[path = "../tests/support/random_cells.rs"]
mod random_cells;

use coverage::Counts;
use random_cells::Kind;
use rayon::prelude::*;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut numbers = std::env::args().skip(1).map(|text| text.parse::<usize>());
    let (cells, stops) = (numbers.next().transpose()?.unwrap_or(1000), numbers.next().transpose()?.unwrap_or(25));
    println!("| cells | parameter | information | clusters | headline | intervals |");
    println!("|---|---|---|---|---|---|");
    for kind in Kind::ALL {
        let began = std::time::Instant::now();
        let one = |seed: usize| {
            let simulated = random_cells::cell(kind, seed as u64, stops);
            let solved = random_cells::solve(&simulated);
            let mut counts = Counts::new();
            coverage::count(&mut counts, &simulated, &solved);
            (counts, solved.covariance.clusters.configurations.shown(), solved.covariance.clusters.corners.shown())
        };
        let all: Vec<(Counts, bool, bool)> = (0..cells).into_par_iter().map(one).collect();
        let mut sum = Counts::new();
        for (counts, ..) in &all {
            for (what, tallies) in counts {
                for (total, tally) in sum.entry(what.clone()).or_default().iter_mut().zip(tallies) {
                    *total = (total.0 + tally.0, total.1 + tally.1);
                }
            }
        }
        for (what, tallies) in &sum {
            let shares = tallies.map(|(hits, tries)| format!("{:.1}", 100.0 * hits as f64 / tries as f64));
            println!("| {} | {what} | {} | {} |", kind.words(), shares.join(" | "), tallies[0].1);
        }
        let shown = |pick: fn(&(Counts, bool, bool)) -> bool| all.iter().filter(|one| pick(one)).count();
        eprintln!(
            "{}: common errors shown by configuration in {} and by corner in {} of {cells}; {:.0} s",
            kind.words(),
            shown(|one| one.1),
            shown(|one| one.2),
            began.elapsed().as_secs_f64()
        );
    }
    Ok(())
}
