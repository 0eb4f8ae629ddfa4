//! What speaks against a solution, in words.

use super::output::{say, say_wrapped};
use cellmap::trust::Undetermined;
use cellmap::workflow::solve::Solved;

/// How many directions of a kind are named one by one.
const NAMED_DIRECTIONS: usize = 6;

/// Says what a reader should know before using the answer: doubts, and directions that are open or weak.
pub(super) fn show_findings(solved: &Solved) {
    for doubt in solved.doubts() {
        say_wrapped("warning: ", 9, &doubt);
    }
    show_directions("not determined: ", &solved.undetermined);
    show_directions("weak: ", &solved.weak);
}

fn show_directions(label: &str, all: &[Undetermined]) {
    let mut said = "";
    for u in all.iter().take(NAMED_DIRECTIONS) {
        say_wrapped(label, 2, &u.reason);
        if u.remedy != said {
            say_wrapped("  help: ", 8, &u.remedy);
            said = &u.remedy;
        }
    }
    if all.len() > NAMED_DIRECTIONS {
        say!("and {} more directions, all in the solution", all.len() - NAMED_DIRECTIONS);
    }
}
