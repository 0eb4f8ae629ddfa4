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
/// through them without a joint in between. A frame that is measured but not tied to its body's own frame floats.
#[must_use]
pub fn pieces<'a>(tree: &FrameTree, measured: impl IntoIterator<Item = &'a Path>) -> Pieces {
    let mut ties = UnionFind::<usize>::new(tree.frames.len());
    for edge in &tree.static_edges {
        if !matches!(edge.spec, PoseSpec::Unknown | PoseSpec::Start(_))
            && let Some(parent) = tree.frames[edge.frame].parent
        {
            ties.union(edge.frame, parent);
        }
    }
    let mut touched: BTreeSet<FrameId> = BTreeSet::new();
    for path in measured {
        // A run of static steps from a frame `a` to a frame `b` fixes a_from_b, but not where the frames between stand.
        let mut run_start = path.stops[0];
        for (i, step) in path.steps.iter().enumerate() {
            let stop = path.stops[i + 1];
            let Step::Static { edge, .. } = step else {
                run_start = stop;
                continue;
            };
            touched.insert(tree.static_edges[*edge].frame);
            if !matches!(path.steps.get(i + 1), Some(Step::Static { .. })) {
                ties.union(run_start, stop);
            }
        }
    }
    let mut groups: BTreeMap<(FrameId, usize), Vec<FrameId>> = BTreeMap::new();
    let mut result = Pieces::default();
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
