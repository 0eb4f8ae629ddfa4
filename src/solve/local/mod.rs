//! Unknowns that live at one configuration only: the poses of targets that move and the twists of robots that stop inexactly, eliminated before the
//! shared equations are solved. A robot's twist has its repeatability R as a prior, so eliminating it leaves `M - M (M + R^-1)^-1 M` of what
//! its measurements say.
//!
//! Measurements never reach across configurations, so the local unknowns of one configuration meet only shared ones. Each configuration
//! is a unit that keeps its local rows `[H_ll, H_ls, g_l]`; what is shared alone goes straight into the sums of a *bundle* of units. The
//! Schur complement `S = H_ss - H_sl (H_ll + lambda D)^-1 H_ls` is formed in the same sums, and the local step follows from the shared one.
//! Where the columns of a unit's blocks go is the same for all units that see along the same paths: their *form*.

mod bundle;
mod form;
mod terms;
mod unit;

use std::collections::{BTreeSet, HashMap};
use std::sync::Arc;

use super::assemble::Shape;
use super::plan::{Block, Plan};
pub(super) use bundle::Bundle;
use form::Form;
pub use unit::LocalUnit;

/// Units in a bundle: enough to make the sums worth folding, few enough to share out evenly.
const BUNDLE: usize = 64;
/// Shared columns of a bundle, unless one configuration alone touches more.
const WIDEST: usize = 256;

/// One unit for each configuration at which something moves, in bundles; of the chosen blocks only, if any are chosen.
pub(super) fn bundles(plan: &Plan, shapes: &[Shape], chosen: Option<&[bool]>) -> Vec<Bundle> {
    // For each configuration its blocks: (group, block within the group).
    let mut members: Vec<(Vec<usize>, Vec<u32>)> = vec![Default::default(); plan.configurations.len()];
    for (index, group) in plan.groups.iter().enumerate().filter(|(_, group)| !group.compiled.moving.is_empty()) {
        let wanted = |block: &Block| chosen.is_none_or(|chosen| chosen[block.place]);
        for (place, block) in group.blocks.iter().enumerate().filter(|(_, block)| wanted(block)) {
            let (groups, blocks) = &mut members[block.configuration];
            groups.push(index);
            blocks.push(place as u32);
        }
    }
    let mut forms: HashMap<Vec<usize>, Arc<Form>> = HashMap::new();
    let mut units = Vec::new();
    for (configuration, (groups, blocks)) in members.into_iter().enumerate().filter(|(_, one)| !one.0.is_empty()) {
        let form = match forms.get(&groups) {
            Some(form) => Arc::clone(form),
            None => {
                let form = Arc::new(Form::new(groups.clone(), plan, shapes));
                forms.insert(groups, Arc::clone(&form));
                form
            }
        };
        units.push(LocalUnit::new(configuration, form, blocks));
    }
    if plan.unknowns.count > WIDEST {
        // Like to like, so that a bundle's sums, which are dense, hold what its units touch and little else.
        units.sort_by(|a, b| a.form.shared.cmp(&b.form.shared));
    }
    let mut bundles = Vec::new();
    let mut rest = units.into_iter().peekable();
    while let Some(first) = rest.next() {
        let mut touched: BTreeSet<usize> = first.form.shared.iter().copied().collect();
        let mut units = vec![first];
        while units.len() < BUNDLE
            && let Some(next) = rest.next_if(|next| {
                let more = next.form.shared.iter().filter(|column| !touched.contains(column)).count();
                more == 0 || touched.len() + more <= WIDEST
            })
        {
            touched.extend(&next.form.shared);
            units.push(next);
        }
        bundles.push(Bundle::new(units, shapes));
    }
    bundles
}
