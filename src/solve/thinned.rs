//! A first search on a part of the measurements.
//!
//! Far from the minimum it is geometry, not noise, that decides where to go, and some ten thousand corners tell it as well as all of them. So the
//! first steps look at a few blocks of every group, spread over all of its configurations; where they end, the rest of the way is
//! short against the curvature of the problem, and two linearisations of all measurements remain in the place of five or six. How near the end is to the minimum
//! of all depends on how many corners the part has, not on how many there are: half a thousandth of a degree and ten micrometres in a usual cell.
//!
//! Where targets move there is no such search: poses that the part does not see would stay as wrong as they are, and to bring them along takes as many
//! linearisations of all as are saved. Robots that stop inexactly are no hindrance, because their twists are small. Nor is there one under a
//! loss that forgets what is far away, which has many minima, of which the start chooses one.
//!
//! What comes of it is only a start: if its cost, over all measurements, is not lower than that of the given one, the search begins at the given one.

use std::time::Instant;

use super::cut::Cut;
use super::loss::Loss;
use super::minimise::Search;
use super::plan::{Group, Plan};
use super::report::{Options, Report};
use super::state::State;
use super::step::frozen_scaling;

/// A part is worth its search if there are this many times as many measurements.
const WORTH: usize = 4;
/// Blocks of each group at least, or all: every shared unknown is on some group's path, and this many views hold any of them. Tens of views are what
/// hand-eye calibrations are content with.
const LEAST_BLOCKS: usize = 24;
/// Measurements of each group at least, or all, for groups whose blocks show little.
const LEAST_MEASUREMENTS: usize = 1000;
/// If a linearisation promises to take less than this share of the cost away, residuals are hardly larger than at the minimum, and the start is as good as what
/// would be found.
const FAR: f64 = 0.3;
/// A decrease below this share of the cost is less than what the part's noise makes of it.
const DECREASE: f64 = 1e-4;
/// Linearisations at most; more mean that the part is no help.
const ITERATIONS: usize = 30;

impl Search<'_, '_> {
    /// Searches on a part if that is worth it. True if `state` is now a better start, at which the equations are formed and the report has begun; if not, it is as
    /// it was.
    pub(super) fn begin_thinned(&mut self, state: &mut State) -> bool {
        let robust = matches!(self.assembler.loss(), Loss::Huber(_));
        if !robust && self.assembler.loss() != Loss::Squared {
            return false;
        }
        let clock = Instant::now();
        let Some(chosen) = self.options.thinned.and_then(|about| choose(self.assembler.plan, about)) else {
            return false;
        };
        let mut other = Cut::new(self.assembler.plan, &self.assembler.shapes, Some(&chosen));
        self.report.seconds.linearise += clock.elapsed().as_secs_f64();
        let options = self.options;
        self.options = Options {
            iterations: ITERATIONS.min(options.iterations),
            decrease: DECREASE.max(options.decrease),
            ..options
        };
        let report = std::mem::take(&mut self.report);
        std::mem::swap(&mut self.assembler.cut, &mut other);
        let mut found = state.clone();
        let moved = self.search_part(&mut found, robust);
        std::mem::swap(&mut self.assembler.cut, &mut other);
        let part = std::mem::replace(&mut self.report, report);
        self.report.begun_by(&part);
        self.options = options;
        self.assembler.set_curved(false);
        if !moved || !found.is_finite() {
            self.damping = options.damping;
            return false;
        }
        let before = self.evaluate(state);
        // Near the minimum, so that the loss' curvature counts.
        self.assembler.set_curved(robust);
        self.cost = self.linearise(&found);
        if !before.is_finite() || self.cost.is_nan() || self.cost >= before {
            self.assembler.set_curved(false);
            self.damping = options.damping;
            return false;
        }
        *state = found;
        self.report.initial_cost = before;
        self.report.costs = vec![before, self.cost];
        true
    }

    /// Searches on the part that the assembler looks at; false if the start is near already or no number.
    fn search_part(&mut self, state: &mut State, robust: bool) -> bool {
        self.cost = if robust { self.evaluate(state) } else { self.linearise(state) };
        let start = self.cost;
        if !start.is_finite() {
            return false;
        }
        if robust {
            self.approach(state);
            self.linearise(state);
        }
        let scaling = frozen_scaling(&self.normal);
        let near = self.solve(&scaling, self.damping) && self.step.predicted < FAR * start;
        if near && self.cost == start {
            return false;
        }
        self.descend(state);
        true
    }
}

/// The blocks to look at, by their place, about so many corners in all; none if that would not be worth it.
fn choose(plan: &Plan, about: usize) -> Option<Vec<bool>> {
    let size = |group: &Group| group.blocks.iter().map(|block| block.end - block.start).sum::<usize>();
    let all: usize = plan.groups.iter().map(size).sum();
    let moves = |group: &Group| group.compiled.moving.iter().any(|(_, edge)| *edge < plan.moving_edges);
    if all < WORTH * about || plan.groups.iter().any(moves) {
        return None;
    }
    let mut chosen = vec![false; plan.block_count()];
    // What is measured along a path with an inexact stop is taken configuration by configuration.
    let mut together = vec![false; plan.configurations.len()];
    for group in &plan.groups {
        let (blocks, stops) = (&group.blocks, !group.compiled.moving.is_empty());
        let share = about as f64 / all as f64;
        let least = LEAST_MEASUREMENTS as f64 / size(group).max(1) as f64;
        let wanted = LEAST_BLOCKS.max((share.max(least) * blocks.len() as f64).ceil() as usize);
        let had = if stops { blocks.iter().filter(|block| together[block.configuration]).count() } else { 0 };
        for place in spread(blocks.len(), wanted.saturating_sub(had)) {
            let block = &blocks[place];
            if stops {
                together[block.configuration] = true;
            } else {
                chosen[block.place] = true;
            }
        }
    }
    let mut count = 0;
    for group in &plan.groups {
        let stops = !group.compiled.moving.is_empty();
        for block in &group.blocks {
            chosen[block.place] |= stops && together[block.configuration];
            count += if chosen[block.place] { block.end - block.start } else { 0 };
        }
    }
    (WORTH * count <= all).then_some(chosen)
}

/// So many of `count` places, one of each of equal stretches, or all. Within its stretch a place is drawn by the golden ratio's multiples, which are
/// spread evenly but keep no step with anything that robots repeat: taking turns, or the rows of a grid.
fn spread(count: usize, wanted: usize) -> impl Iterator<Item = usize> {
    const GOLDEN: f64 = 0.618_033_988_749_894_8;
    let wanted = wanted.min(count);
    (0..wanted).map(move |i| {
        let (start, end) = (i * count / wanted, (i + 1) * count / wanted);
        start + ((i as f64 * GOLDEN).fract() * (end - start) as f64) as usize
    })
}

impl Report {
    /// Adds the work of a search on a part, but not how it went.
    fn begun_by(&mut self, part: &Self) {
        self.thinned += part.iterations;
        self.seconds.linearise += part.seconds.linearise;
        self.seconds.factorise += part.seconds.factorise;
        self.seconds.evaluate += part.seconds.evaluate;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::FrameTree;
    use crate::layout::parse_layout;
    use crate::simulate::paper_size;
    use crate::solve::{Assembler, Priors, minimise};
    use std::path::Path;

    #[test]
    fn places_are_spread_and_keep_no_step() {
        assert_eq!(spread(5, 9).collect::<Vec<_>>(), [0, 1, 2, 3, 4]);
        assert_eq!(spread(0, 3).count(), 0);
        for (count, wanted, period) in [(1000, 100, 10), (999, 37, 27), (25, 24, 2), (7500, 300, 25)] {
            let places: Vec<usize> = spread(count, wanted).collect();
            assert_eq!(places.len(), wanted);
            assert!(places.windows(2).all(|pair| pair[0] < pair[1]) && places[wanted - 1] < count);
            assert!(places.windows(2).all(|pair| pair[1] - pair[0] <= 2 * count.div_ceil(wanted)));
            // No place within a period is left out by more than a few of those that it could have had.
            let mut seen = vec![0; period];
            places.iter().for_each(|place| seen[place % period] += 1);
            let fair = wanted as f64 / period as f64;
            assert!(
                seen.iter().all(|n| (f64::from(*n) - fair).abs() <= 2.0 + 0.5 * fair),
                "{count} {wanted}: {seen:?}"
            );
        }
    }

    #[test]
    fn a_part_that_misleads_is_not_followed() {
        let parse = |text: &str| parse_layout(Path::new("layout.yaml"), text, None).unwrap();
        let (truth, layout) = (parse(&paper_size::truth()), parse(&paper_size::hidden(false)));
        let mut recording = paper_size::record(&truth, 150, 1, 40, 0.1);
        let tree = FrameTree::new(&layout);
        let plan = Plan::new(&layout, &tree, &recording).unwrap();
        let true_tree = FrameTree::new(&truth);
        let start = State {
            static_poses: true_tree.static_edges.iter().map(|edge| edge.spec.truth().unwrap_or_default()).collect(),
            corrections: vec![Vec::new()],
            lenses: layout.cameras.iter().map(|c| *c.intrinsics.as_ref().unwrap().parameters()).collect(),
            ..State::default()
        };
        let about = 2000;
        let chosen = choose(&plan, about).unwrap();
        let blocks = plan.groups.iter().flat_map(|group| &group.blocks).filter(|block| chosen[block.place]);
        let shown: Vec<usize> =
            blocks.flat_map(|block| block.start..block.end).map(|i| plan.measurements.row(i)).collect();
        recording.corners.edit(|rows| shown.iter().for_each(|row| rows[*row].pixel[0] += 100.0));
        let plan = Plan::new(&layout, &tree, &recording).unwrap();
        let search = |thinned: Option<usize>| {
            let mut assembler = Assembler::new(&layout, &recording, &plan, Priors::default());
            assembler.set_loss(Loss::Squared);
            let mut state = start.clone();
            let report = minimise(&mut assembler, &tree, &mut state, &Options { thinned, ..Options::default() });
            (state, report)
        };
        let ((plain, all), (state, report)) = (search(None), search(Some(about)));
        assert!(report.thinned > 1, "{report:?}");
        assert_eq!((state, report.costs, report.iterations), (plain, all.costs, all.iterations + 1));
    }
}
