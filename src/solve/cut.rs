//! The work of a linearisation, cut into pieces that threads share.

use super::assemble::Shape;
use super::local::{Bundle, bundles};
use super::plan::{Group, Plan};

/// Measurements a unit holds at most, in whole blocks: enough to hide the cost of a task, few enough to share out evenly.
const UNIT_MEASUREMENTS: usize = 4096;
/// Of less work there are this many units, so that it too can be shared out evenly.
const UNITS: usize = 32;

/// Measurements up to which one thread does everything: waking another one takes as long as to linearise some thousand corners, and a search wakes it a
/// dozen times.
const ALONE: usize = 16_384;

/// A run of blocks of one group with a compact matrix of its own.
#[derive(Clone, Debug)]
pub(super) struct Unit {
    pub(super) group: usize,
    /// Places among the group's blocks.
    pub(super) blocks: Vec<u32>,
    /// Row-major over (path columns, active lens columns, residual).
    pub(super) matrix: Vec<f64>,
    pub(super) cost: f64,
}

/// All blocks of a plan or some of them, in units and bundles.
#[derive(Debug, Default)]
pub(super) struct Cut {
    pub(super) units: Vec<Unit>,
    pub(super) bundles: Vec<Bundle>,
    /// Costs of units, then of bundles, at a trial.
    pub(super) costs: Vec<f64>,
    /// The configurations that are looked at; none if all are.
    pub(super) configurations: Option<Vec<bool>>,
    /// Measurements, rejected ones among them.
    pub(super) measurements: usize,
}

impl Cut {
    /// Cuts a plan, or of a plan the blocks that are chosen by their place.
    pub(super) fn new(plan: &Plan, shapes: &[Shape], chosen: Option<&[bool]>) -> Self {
        let wanted = |place: usize| chosen.is_none_or(|chosen| chosen[place]);
        let measurements = |group: &Group| -> usize {
            group.blocks.iter().filter(|block| wanted(block.place)).map(|block| block.end - block.start).sum()
        };
        let all = plan.groups.iter().map(measurements).sum();
        let most = UNIT_MEASUREMENTS.min(all / UNITS + 1);
        let mut units: Vec<Unit> = Vec::new();
        for (index, group) in plan.groups.iter().enumerate().filter(|(_, group)| group.compiled.moving.is_empty()) {
            let width = shapes[index].width;
            let mut room = 0;
            for (place, block) in group.blocks.iter().enumerate().filter(|(_, block)| wanted(block.place)) {
                if room == 0 {
                    let matrix = vec![0.0; width * width];
                    units.push(Unit { group: index, blocks: Vec::new(), matrix, cost: 0.0 });
                    room = most;
                }
                if let Some(unit) = units.last_mut() {
                    unit.blocks.push(place as u32);
                }
                room = room.saturating_sub(block.end - block.start);
            }
        }
        let bundles = bundles(plan, shapes, chosen);
        let costs = vec![0.0; units.len() + bundles.len()];
        let configurations = chosen.map(|chosen| {
            let mut seen = vec![false; plan.configurations.len()];
            let blocks = plan.groups.iter().flat_map(|group| &group.blocks);
            blocks.filter(|block| chosen[block.place]).for_each(|block| seen[block.configuration] = true);
            seen
        });
        Self { units, bundles, costs, configurations, measurements: all }
    }

    /// Whether one thread is enough: no other is woken, or even started.
    pub(super) fn is_small(&self) -> bool {
        self.measurements <= ALONE
    }
}
