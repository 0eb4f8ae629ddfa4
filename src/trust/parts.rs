//! Parts of a large problem that have no unknown in common, such as cells of a hall that see nothing of each other: what is asked of one is told by it alone, and
//! columns of the covariance that belong to different parts are found by one solve.

use crate::solve::terms::Term;
use crate::solve::{Pattern, Unknown};

/// Unknowns that hang together.
#[derive(Debug, Default)]
pub(super) struct Part {
    /// Their columns, ascending.
    pub(super) columns: Vec<usize>,
    /// Their blocks' numbers, ascending.
    pub(super) blocks: Vec<usize>,
    /// Of each kind of cluster the numbers of those that speak of them, ascending.
    pub(super) clusters: [Vec<usize>; 2],
}

/// The parts of a problem whose unknowns are linked by some patterns, those of the terms among them; one part if they are not to be told apart.
pub(super) fn parts(patterns: [&Pattern; 2], blocks: &[Unknown], terms: [&[Term]; 2], apart: bool) -> Vec<Part> {
    let of = links(patterns, apart);
    let mut numbers = vec![None; of.len()];
    let mut parts: Vec<Part> = Vec::new();
    for (column, &first) in of.iter().enumerate() {
        let number = *numbers[first].get_or_insert_with(|| {
            parts.push(Part::default());
            parts.len() - 1
        });
        parts[number].columns.push(column);
    }
    let part_of = |column: usize| numbers[of[column]].unwrap_or(0);
    for (number, block) in blocks.iter().enumerate() {
        parts[part_of(block.start)].blocks.push(number);
    }
    for (kind, terms) in terms.into_iter().enumerate() {
        for (number, term) in terms.iter().enumerate() {
            if let Some(column) = term.columns.first() {
                parts[part_of(*column)].clusters[kind].push(number);
            }
        }
    }
    parts
}

/// For each column the first one that it hangs together with.
fn links(patterns: [&Pattern; 2], apart: bool) -> Vec<usize> {
    let count = patterns[0].columns();
    if !apart {
        return vec![0; count];
    }
    let mut link: Vec<usize> = (0..count).collect();
    let root = |link: &mut [usize], mut column: usize| {
        while link[column] != column {
            link[column] = link[link[column]];
            column = link[column];
        }
        column
    };
    for pattern in patterns {
        for column in 0..count {
            for &row in &pattern.rows()[pattern.range(column)] {
                let (a, b) = (root(&mut link, column), root(&mut link, row));
                link[a.max(b)] = a.min(b);
            }
        }
    }
    (0..count).map(|column| root(&mut link, column)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_some_pattern_links_hangs_together() {
        let blocks = [(0, 2), (2, 1), (3, 2), (5, 1), (6, 3)];
        let pattern = |cliques: &[&[usize]]| Pattern::new(&blocks, cliques.iter().copied());
        let (a, b) = (pattern(&[&[0, 4], &[1]]), pattern(&[&[2, 3], &[1, 4]]));
        assert_eq!(links([&a, &b], true), [0, 0, 0, 3, 3, 3, 0, 0, 0]);
        assert_eq!(links([&a, &a], true), [0, 0, 2, 3, 3, 5, 0, 0, 0]);
        assert_eq!(links([&a, &b], false), [0; 9]);
    }
}
