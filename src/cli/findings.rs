//! What speaks against a solution, in words.

use super::output::{say, say_wrapped};
use cellmap::trust::{Action, Fault, Undetermined};
use cellmap::workflow::solve::Solved;

/// How many faults are told one by one.
const NAMED_FAULTS: usize = 8;
/// How many directions of a kind are named one by one.
const NAMED_DIRECTIONS: usize = 6;

/// Says what a reader should know before using the answer: doubts, faults, directions that are open or weak, and what noise does not explain.
pub(super) fn show_findings(solved: &Solved) {
    for doubt in solved.doubts() {
        say_wrapped("warning: ", 9, &doubt);
    }
    show_faults(&solved.faults);
    show_directions("not determined: ", &solved.undetermined);
    show_directions("weak: ", &solved.weak);
    for remark in &solved.remarks {
        say_wrapped("remark: ", 2, &remark.what);
        say_wrapped("  help: ", 8, &remark.remedy);
    }
}

/// Says what is wrong, why, and what helps.
pub(super) fn show_faults(faults: &[Fault]) {
    for fault in faults.iter().take(NAMED_FAULTS) {
        let label = match fault.action {
            Action::Refused => "wrong: ",
            Action::Excluded => "left out: ",
        };
        say_wrapped(label, 2, &fault.what);
        say_wrapped("  because ", 2, &fault.evidence);
        say_wrapped("  help: ", 8, &fault.remedy);
    }
    if faults.len() > NAMED_FAULTS {
        say!("and {} more, all in the solution", faults.len() - NAMED_FAULTS);
    }
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
