//! The full covariance of everything that was found, for programs that go on computing with it.

use crate::layout::Document;
use crate::robot::{PARAMETERS_PER_LINK, ParameterKind};
use crate::solve::{Unknown, UnknownKind};
use crate::workflow::solve::Solved;

/// Both covariance matrices with the names and units of their rows. A pose's rows are its twist on the right, `pose * Exp(d)`: translation (m), then rotation
/// vector (rad), in the child's axes. Lengths and angles of links are in m and rad, lens parameters as the lens has them. Along directions that
/// nothing determines (their section `undetermined`, vectors over the same rows) the matrices are zero.
#[must_use]
pub fn document(solved: &Solved) -> Document {
    let covariance = &solved.covariance;
    let (units, n) = (covariance.units(), solved.plan.unknowns.count);
    let blocks = &solved.plan.unknowns.blocks;
    let names = blocks.iter().flat_map(|block| column_names(solved, block)).map(Document::text);
    let rows = |matrix: &nalgebra::DMatrix<f64>| {
        let row =
            |i: usize| Document::numbers(&(0..n).map(|j| matrix[(i, j)] * units[i] * units[j]).collect::<Vec<f64>>());
        Document::List((0..n).map(row).collect())
    };
    let open = covariance.open.iter().map(|v| {
        let natural: Vec<f64> = v.iter().zip(units).map(|(x, unit)| x * unit).collect();
        Document::numbers(&natural)
    });
    Document::map([
        ("columns", Document::List(names.collect())),
        ("information", rows(&covariance.matrix)),
        ("clusters", rows(&covariance.clusters.matrix)),
        ("undetermined", Document::List(open.collect())),
    ])
}

/// A name for each column of a block: `world_from_left x`, `left lens fx`, `ur5e links joint1 offset`.
#[must_use]
pub fn column_names(solved: &Solved, block: &Unknown) -> Vec<String> {
    let short: Vec<String> = match &block.kind {
        UnknownKind::Edge(_) => ["x", "y", "z", "rx", "ry", "rz"].iter().map(|s| (*s).to_owned()).collect(),
        UnknownKind::Lens { camera, places } => {
            let model = solved.layout.cameras[*camera].intrinsics.as_ref().map(|lens| lens.model());
            let name = |place: &usize| model.map_or(String::new(), |model| model.parameter_name(*place).to_owned());
            places.iter().map(name).collect()
        }
        UnknownKind::Links { places, .. } => {
            let name = |place: &usize| {
                let kind = ParameterKind::ALL[place % PARAMETERS_PER_LINK].name();
                format!("joint{} {kind}", place / PARAMETERS_PER_LINK + 1)
            };
            places.iter().map(name).collect()
        }
    };
    short.into_iter().take(block.count()).map(|part| format!("{} {part}", block.name)).collect()
}
