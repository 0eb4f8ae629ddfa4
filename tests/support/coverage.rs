//! How often intervals of 95 % contain the truth, by kind of parameter and by source of the standard deviation.
#![allow(dead_code)]

use std::collections::BTreeMap;

use cellmap::frames::FrameTree;
use cellmap::geometry::rotation;
use cellmap::robot::{PARAMETERS_PER_LINK, ParameterKind};
use cellmap::simulate::Simulated;
use cellmap::solve::UnknownKind;
use cellmap::trust::Source;
use cellmap::workflow::solve::Solved;

pub const SOURCES: [Source; 3] = [Source::Information, Source::Clusters, Source::Both];

/// Half the width of an interval of 95 %, in standard deviations.
const WIDTH: f64 = 1.959964;

/// Hits and tries by kind of parameter, for each source.
pub type Counts = BTreeMap<String, [(u64, u64); 3]>;

/// Every parameter's error in standard deviations of each source, with its kind.
fn errors(simulated: &Simulated, solved: &Solved) -> Vec<(String, [f64; 3])> {
    let truth = FrameTree::new(&simulated.truth);
    let mut all = Vec::new();
    for block in &solved.plan.unknowns.blocks {
        match &block.kind {
            UnknownKind::Edge(edge) => {
                let key = &solved.tree.static_edges[*edge].key;
                // A plate that looks the same upside down, and a tag that has a frame of its own only where its place is unknown.
                if key.contains("gauge") || key.contains("tag61") {
                    continue;
                }
                let Some(known) = truth.static_edges.iter().find(|e| e.key == *key) else { panic!("no {key}") };
                let expected = known.spec.truth().unwrap_or_else(|| panic!("{key} is known"));
                let found = solved.state.static_poses[*edge];
                let shift = found.translation - expected.translation;
                let turn = found.rotation * rotation::log(&(expected.rotation.inverse() * found.rotation));
                let what = if key.ends_with(".base") {
                    "base"
                } else if simulated.truth.cameras.iter().any(|c| key.ends_with(&format!("_from_{}", c.name))) {
                    "camera"
                } else if key.contains(".flange_from_") {
                    "tool"
                } else {
                    "target"
                };
                let sigmas = SOURCES.map(|s| solved.covariance.pose_sigma(&solved.tree, &solved.state, block, s));
                for (i, d) in shift.iter().chain(turn.iter()).enumerate() {
                    let part = if i < 3 { "translation" } else { "rotation" };
                    let ratios = sigmas.map(|sigma| d / sigma[i].unwrap_or(f64::INFINITY));
                    all.push((format!("{what} {part}"), ratios));
                }
            }
            UnknownKind::Lens { camera, places } => {
                let lens = simulated.truth.cameras[*camera].intrinsics.as_ref().unwrap().parameters();
                for (i, place) in places.iter().enumerate() {
                    let d = solved.state.lenses[*camera][*place] - lens[*place];
                    let what =
                        ["focal length", "focal length", "centre", "centre"].get(*place).unwrap_or(&"distortion");
                    all.push(((*what).to_owned(), ratios(solved, block.start + i, d)));
                }
            }
            UnknownKind::Links { robot, places, .. } => {
                for (i, place) in places.iter().enumerate() {
                    let d =
                        solved.state.corrections[*robot][*place] - simulated.truth.robots[*robot].corrections[*place];
                    let what = match ParameterKind::ALL[place % PARAMETERS_PER_LINK] {
                        ParameterKind::JointOffset => "joint offset",
                        ParameterKind::LengthD | ParameterKind::LengthA => "link length",
                        ParameterKind::TwistAlpha => "link twist",
                    };
                    all.push((what.to_owned(), ratios(solved, block.start + i, d)));
                }
            }
        }
    }
    all
}

fn ratios(solved: &Solved, column: usize, d: f64) -> [f64; 3] {
    SOURCES.map(|source| d / solved.covariance.column_sigma(column, source).unwrap_or(f64::INFINITY))
}

/// Adds a solved cell.
pub fn count(counts: &mut Counts, simulated: &Simulated, solved: &Solved) {
    for (what, ratios) in errors(simulated, solved) {
        let entry = counts.entry(what).or_default();
        for (tally, ratio) in entry.iter_mut().zip(ratios) {
            tally.0 += u64::from(ratio.abs() <= WIDTH);
            tally.1 += 1;
        }
    }
}
