//! Which frames hang together through measurements, and which float.

use petgraph::unionfind::UnionFind;
use std::collections::{BTreeMap, BTreeSet};

use super::path::{Path, Step};
use super::tree::{FrameId, FrameTree};
use crate::layout::PoseSpec;

/// What measurements tie together.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Pieces {
    /// Groups of frames that are tied to each other but not to the body they are mounted on; each group in order, with that body's frame.
    pub floating: Vec<(FrameId, Vec<FrameId>)>,
    /// Frames with something to find that no measurement mentions.
    pub unseen: Vec<FrameId>,
}

/// Splits the cell into pieces: within each rigid body, frames are tied by known poses, by priors, and by every measured path that runs
/// through them without a joint in between. Two paths that end at one moving target at one configuration are tied to each other, but not to what the
/// target moves against. A frame that is measured but not tied to its body's own frame floats.
///
/// `measured` gives each path with the configurations (any numbering) at which it was measured.
#[must_use]
pub fn pieces<'a>(tree: &FrameTree, measured: impl IntoIterator<Item = (&'a Path, Vec<usize>)>) -> Pieces {
    let measured: Vec<(&Path, Vec<usize>)> = measured.into_iter().collect();
    let configurations = measured.iter().flat_map(|(_, at)| at.iter().map(|c| c + 1)).max().unwrap_or(0);
    // After the frames, a node for each moving edge at each configuration.
    let moving_node = |edge: usize, configuration: usize| tree.frames.len() + edge * configurations + configuration;
    let mut ties = UnionFind::<usize>::new(tree.frames.len() + tree.moving_edges.len() * configurations);
    for edge in &tree.static_edges {
        if !matches!(edge.spec, PoseSpec::Unknown | PoseSpec::Hidden(_) | PoseSpec::Start(_))
            && let Some(parent) = tree.frames[edge.frame].parent
        {
            ties.union(edge.frame, parent);
        }
    }
    let mut touched: BTreeSet<FrameId> = BTreeSet::new();
    for (path, at) in &measured {
        // A run of static steps from a frame `a` to a frame `b` fixes a_from_b, but not where the frames between stand.
        let mut run_start = path.stops[0];
        for (i, step) in path.steps.iter().enumerate() {
            let (stop, next) = (path.stops[i + 1], path.steps.get(i + 1));
            match step {
                Step::Static { edge, .. } => {
                    touched.insert(tree.static_edges[*edge].frame);
                    match next {
                        Some(Step::Static { .. } | Step::Moving { inverse: false, .. }) => {}
                        _ => {
                            ties.union(run_start, stop);
                        }
                    }
                }
                // Downwards, the run ends at the target's place of the moment; upwards, one begins there.
                Step::Moving { edge, inverse } => {
                    touched.insert(tree.moving_edges[*edge].frame);
                    let free_end = if *inverse { path.stops[end_of_run(path, i + 1)] } else { run_start };
                    for configuration in at {
                        ties.union(free_end, moving_node(*edge, *configuration));
                    }
                    run_start = if *inverse { free_end } else { stop };
                }
                Step::Robot { .. } => run_start = stop,
            }
        }
    }
    let mut groups: BTreeMap<(FrameId, usize), Vec<FrameId>> = BTreeMap::new();
    let mut result = Pieces::default();
    result.unseen.extend(tree.moving_edges.iter().map(|edge| edge.frame).filter(|frame| !touched.contains(frame)));
    for edge in tree.static_edges.iter().filter(|edge| edge.freedom.count() > 0) {
        let body = tree.body(edge.frame);
        if !touched.contains(&edge.frame) && !matches!(edge.spec, PoseSpec::Prior(..)) {
            result.unseen.push(edge.frame);
        } else if !ties.equiv(edge.frame, body) {
            groups.entry((body, ties.find(edge.frame))).or_default().push(edge.frame);
        }
    }
    result.floating = groups.into_iter().map(|((body, _), frames)| (body, frames)).collect();
    result
}

/// The stop at which the run of static steps that starts at stop `start` ends.
fn end_of_run(path: &Path, start: usize) -> usize {
    let steps = path.steps[start..].iter().take_while(|step| matches!(step, Step::Static { .. })).count();
    start + steps
}
