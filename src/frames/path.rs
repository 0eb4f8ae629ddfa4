//! Paths between two frames, as a product of transforms.

use super::tree::{Edge, FrameId, FrameTree};

/// One factor of a path's transform.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Step {
    /// A static edge, walked down (`parent_from_child`) or up (its inverse).
    Static {
        /// Index into [`FrameTree::static_edges`].
        edge: usize,
        /// Walked upwards.
        inverse: bool,
    },
    /// A moving edge.
    Moving {
        /// Index into [`FrameTree::moving_edges`].
        edge: usize,
        /// Walked upwards.
        inverse: bool,
    },
    /// A robot between two places of its chain, `from < to`.
    Robot {
        /// The robot's place in the layout.
        robot: usize,
        /// Nearer the base.
        from: usize,
        /// Nearer the flange.
        to: usize,
        /// Walked towards the base.
        inverse: bool,
    },
}

/// The way from one frame to another: `from_from_to` is the product of the steps in order.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Path {
    /// The frame in which the result is expressed.
    pub from: FrameId,
    /// The frame whose pose it is.
    pub to: FrameId,
    /// The factors.
    pub steps: Vec<Step>,
    /// The frames between which the steps lead, one more than steps.
    pub stops: Vec<FrameId>,
}

impl FrameTree {
    /// The path between two frames: up to their nearest common ancestor, then down. O(depth).
    #[must_use]
    pub fn path(&self, from: FrameId, to: FrameId) -> Path {
        let (mut up, mut down) = (vec![from], vec![to]);
        let (mut a, mut b) = (from, to);
        while a != b {
            if self.frames[a].depth >= self.frames[b].depth {
                a = self.frames[a].parent.unwrap_or(0);
                up.push(a);
            } else {
                b = self.frames[b].parent.unwrap_or(0);
                down.push(b);
            }
        }
        down.pop();
        let summit = up.len() - 1;
        let frames: Vec<FrameId> = up.into_iter().chain(down.into_iter().rev()).collect();
        let mut path = Path { from, to, steps: Vec::new(), stops: vec![from] };
        for (i, pair) in frames.windows(2).enumerate() {
            let inverse = i < summit;
            let child = if inverse { pair[0] } else { pair[1] };
            let step = match self.frames[child].edge {
                Edge::Static(edge) => Step::Static { edge, inverse },
                Edge::Moving(edge) => Step::Moving { edge, inverse },
                Edge::Link { robot, place } => Step::Robot { robot, from: place, to: place + 1, inverse },
                Edge::Root => continue,
            };
            path.push(step, pair[1]);
        }
        path
    }
}

impl Path {
    /// Appends a step, merging neighbouring links of one robot walked in one direction.
    fn push(&mut self, step: Step, stop: FrameId) {
        if let (Step::Robot { robot, from, to, inverse }, Some(Step::Robot { robot: r, from: f, to: t, inverse: i })) =
            (step, self.steps.last_mut())
            && *r == robot
            && *i == inverse
        {
            (*f, *t) = ((*f).min(from), (*t).max(to));
            if let Some(last) = self.stops.last_mut() {
                *last = stop;
            }
            return;
        }
        self.steps.push(step);
        self.stops.push(stop);
    }

    /// The robots on the way.
    pub fn robots(&self) -> impl Iterator<Item = usize> + '_ {
        self.steps.iter().filter_map(|step| match step {
            Step::Robot { robot, .. } => Some(*robot),
            _ => None,
        })
    }

    /// Whether the transform is the same at every configuration.
    #[must_use]
    pub fn is_static(&self) -> bool {
        self.steps.iter().all(|step| matches!(step, Step::Static { .. }))
    }
}
