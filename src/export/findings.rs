//! What a solve found, in the fixed units of reports: millimetres, degrees, pixels.

use crate::frames::Freedom;
use crate::geometry::rotation;
use crate::layout::Document;
use crate::layout::{Motion, PoseSpec};
use crate::robot::PARAMETERS_PER_LINK;
use crate::solve::UnknownKind;
use crate::workflow::solve::Solved;

/// Radians in degrees.
const DEGREE: f64 = std::f64::consts::PI / 180.0;

/// Every static pose with its standard deviations, keyed `parent_from_child`, in the fixed units of reports.
#[must_use]
pub fn poses(solved: &Solved) -> Vec<(String, Document)> {
    let mut all = Vec::new();
    for (index, edge) in solved.tree.static_edges.iter().enumerate() {
        let name = &solved.tree.frames[edge.frame].name;
        if *name == solved.layout.world || solved.unseen.contains(&edge.frame) {
            continue;
        }
        let pose = &solved.state.static_poses[index];
        let sigma = match solved.plan.unknowns.edge(index) {
            Some(block) => {
                solved.covariance.pose_sigma(&solved.tree, &solved.state, &solved.plan.unknowns.blocks[block])
            }
            // Fixed, or known by nothing but its prior.
            None => match &edge.spec {
                PoseSpec::Prior(_, sigma) => {
                    let (t, r) = (sigma.translation, sigma.rotation);
                    [t[0], t[1], t[2], r[0], r[1], r[2]].map(Some)
                }
                _ => [Some(0.0); 6],
            },
        };
        let xyz: [f64; 3] = (pose.translation * 1e3).into();
        let turn: [f64; 3] = (rotation::log(&pose.rotation) / DEGREE).into();
        let scaled = |i: usize, scale: f64| sigma[i].map(|s| s * scale);
        let kind = match (edge.freedom, &edge.spec) {
            (Freedom::Fixed, _) => "fixed",
            (_, PoseSpec::Prior(..)) => "found with a prior",
            _ => "found",
        };
        all.push((
            edge.key.clone(),
            Document::map([
                ("xyz_mm", Document::numbers(&xyz)),
                ("rotvec_deg", Document::numbers(&turn)),
                ("sigma_xyz_mm", Document::known(&[0, 1, 2].map(|i| scaled(i, 1e3)))),
                ("sigma_rotvec_deg", Document::known(&[3, 4, 5].map(|i| scaled(i, 1.0 / DEGREE)))),
                ("kind", Document::text(kind)),
            ]),
        ));
    }
    all
}

/// Lenses and links that were found, with standard deviations.
#[must_use]
pub fn parameters(solved: &Solved) -> Vec<(String, Document)> {
    let mut all = Vec::new();
    for block in &solved.plan.unknowns.blocks {
        let sigma = |i: usize| solved.covariance.column_sigma(block.start + i).map_or(Document::Null, Document::Number);
        let mut entries = Vec::new();
        match &block.kind {
            UnknownKind::Edge(_) => continue,
            UnknownKind::Lens { camera, places } => {
                let Some(intrinsics) = &solved.layout.cameras[*camera].intrinsics else { continue };
                for (i, place) in places.iter().enumerate() {
                    let value = Document::Number(solved.state.lenses[*camera][*place]);
                    let name = intrinsics.model().parameter_name(*place).to_owned();
                    entries.push((name, Document::map([("value", value), ("sigma", sigma(i))])));
                }
            }
            UnknownKind::Links { robot, places, .. } => {
                let Motion::Joints { chain, .. } = &solved.layout.robots[*robot].motion else { continue };
                for (i, place) in places.iter().enumerate() {
                    let (link, kind) =
                        (place / PARAMETERS_PER_LINK, crate::robot::ParameterKind::ALL[place % PARAMETERS_PER_LINK]);
                    let angle = kind.is_angle(chain.links[link].joint);
                    let (scale, unit) = if angle { (1.0 / DEGREE, "deg") } else { (1e3, "mm") };
                    let value = Document::Number(solved.state.corrections[*robot][*place] * scale);
                    let sigma = solved
                        .covariance
                        .column_sigma(block.start + i)
                        .map_or(Document::Null, |s| Document::Number(s * scale));
                    let name = format!("joint{}_{}_{unit}", link + 1, kind.name());
                    entries.push((name, Document::map([("value", value), ("sigma", sigma)])));
                }
            }
        }
        all.push((block.name.clone(), Document::Map(entries)));
    }
    all
}

/// What could not be determined.
#[must_use]
pub fn undetermined(solved: &Solved) -> Document {
    directions(&solved.undetermined)
}

/// What was determined, but weakly.
#[must_use]
pub fn weak(solved: &Solved) -> Document {
    directions(&solved.weak)
}

fn directions(all: &[crate::trust::Undetermined]) -> Document {
    let one = |u: &crate::trust::Undetermined| {
        Document::map([
            ("kind", Document::text(u.cause.name())),
            ("blocks", Document::Row(u.blocks.iter().map(Document::text).collect())),
            ("sigma_mm_mrad", u.sigma.map_or(Document::Null, Document::Number)),
            ("reason", Document::text(&u.reason)),
            ("remedy", Document::text(&u.remedy)),
        ])
    };
    Document::List(all.iter().map(one).collect())
}

/// The quality of the fit.
#[must_use]
pub fn fit(solved: &Solved) -> Vec<(String, Document)> {
    let r = &solved.residuals;
    let optional = |value: Option<f64>| value.map_or(Document::Null, Document::Number);
    let poses = r.rms_poses();
    vec![
        ("converged".to_owned(), Document::Flag(solved.report.termination.converged())),
        ("termination".to_owned(), Document::text(solved.report.termination.words())),
        ("initial_cost".to_owned(), Document::Number(solved.report.initial_cost)),
        ("final_cost".to_owned(), Document::Number(solved.report.final_cost)),
        ("observations".to_owned(), Document::Whole(solved.observations as u64)),
        ("unknowns".to_owned(), Document::Whole(solved.unknowns as u64)),
        ("rms_px".to_owned(), optional(r.rms_px())),
        ("rms_pose_mm".to_owned(), optional(poses.map(|p| p[0] * 1e3))),
        ("rms_pose_deg".to_owned(), optional(poses.map(|p| p[1] / DEGREE))),
        ("rms_point_mm".to_owned(), optional(r.rms_points().map(|e| e * 1e3))),
        ("rms_contact_mm".to_owned(), optional(r.rms_contacts().map(|e| e * 1e3))),
        ("noise".to_owned(), Document::Number(solved.covariance.noise)),
        ("doubts".to_owned(), Document::List(solved.doubts().into_iter().map(Document::Text).collect())),
        (
            "corners".to_owned(),
            Document::List(
                solved
                    .tallies
                    .iter()
                    .map(|t| {
                        Document::map([
                            ("camera", Document::text(&t.camera)),
                            ("target", Document::text(&t.target)),
                            ("accepted", Document::Whole(t.accepted as u64)),
                            ("rejected", Document::Whole(t.rejected as u64)),
                            ("rms_px", t.rms_px.map_or(Document::Null, Document::Number)),
                        ])
                    })
                    .collect(),
            ),
        ),
        ("rejected".to_owned(), Document::Whole(solved.rejected.total() as u64)),
    ]
}
