//! What a solve found, in the fixed units of reports: millimetres, degrees, pixels.

use crate::frames::Freedom;
use crate::geometry::rotation;
use crate::layout::Document;
use crate::layout::{Motion, PoseSpec};
use crate::robot::PARAMETERS_PER_LINK;
use crate::solve::UnknownKind;
use crate::trust::Source;
use crate::trust::sandwich::Scatter;
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
        let sigma = |source: Source| match solved.plan.unknowns.edge(index) {
            Some(block) => {
                let block = &solved.plan.unknowns.blocks[block];
                solved.covariance.pose_sigma(&solved.tree, &solved.state, block, source)
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
        let xyz_sigma = |source| Document::known(&[0, 1, 2].map(|i| sigma(source)[i].map(|s| s * 1e3)));
        let turn_sigma = |source| Document::known(&[3, 4, 5].map(|i| sigma(source)[i].map(|s| s / DEGREE)));
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
                ("sigma_xyz_mm", xyz_sigma(Source::Both)),
                ("sigma_rotvec_deg", turn_sigma(Source::Both)),
                ("information_sigma_xyz_mm", xyz_sigma(Source::Information)),
                ("information_sigma_rotvec_deg", turn_sigma(Source::Information)),
                ("clusters_sigma_xyz_mm", xyz_sigma(Source::Clusters)),
                ("clusters_sigma_rotvec_deg", turn_sigma(Source::Clusters)),
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
        let parameter = |i: usize, value: f64, scale: f64| {
            let sigma = |source| {
                let sigma = solved.covariance.column_sigma(block.start + i, source);
                sigma.map_or(Document::Null, |sigma| Document::Number(sigma * scale))
            };
            Document::map([
                ("value", Document::Number(value * scale)),
                ("sigma", sigma(Source::Both)),
                ("information_sigma", sigma(Source::Information)),
                ("clusters_sigma", sigma(Source::Clusters)),
            ])
        };
        let mut entries = Vec::new();
        match &block.kind {
            UnknownKind::Edge(_) => continue,
            UnknownKind::Lens { camera, places } => {
                let Some(intrinsics) = &solved.layout.cameras[*camera].intrinsics else { continue };
                for (i, place) in places.iter().enumerate() {
                    let name = intrinsics.model().parameter_name(*place).to_owned();
                    entries.push((name, parameter(i, solved.state.lenses[*camera][*place], 1.0)));
                }
            }
            UnknownKind::Links { robot, places, .. } => {
                let Motion::Joints { chain, .. } = &solved.layout.robots[*robot].motion else { continue };
                for (i, place) in places.iter().enumerate() {
                    let (link, kind) =
                        (place / PARAMETERS_PER_LINK, crate::robot::ParameterKind::ALL[place % PARAMETERS_PER_LINK]);
                    let angle = kind.is_angle(chain.links[link].joint);
                    let (scale, unit) = if angle { (1.0 / DEGREE, "deg") } else { (1e3, "mm") };
                    let name = format!("joint{}_{}_{unit}", link + 1, kind.name());
                    entries.push((name, parameter(i, solved.state.corrections[*robot][*place], scale)));
                }
            }
        }
        all.push((block.name.clone(), Document::Map(entries)));
    }
    all
}

/// Whether groups of measurements have errors in common: how many groups there are, the variance against that of independent errors, and whether that
/// is more than chance.
fn scatter(scatter: &Scatter) -> Document {
    Document::map([
        ("groups", Document::Whole(scatter.groups as u64)),
        ("variance_ratio", Document::Number(scatter.ratio())),
        ("shown", Document::Flag(scatter.shown())),
    ])
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

/// Factors on distances, of all (`of` is null), a camera's or a target's, and on focal lengths.
#[must_use]
pub fn scales(solved: &Solved) -> Document {
    let one = |scale: &crate::trust::Scale| {
        Document::map([
            (
                "kind",
                Document::text(match scale.kind {
                    crate::trust::scale::ScaleKind::Distances => "distances",
                    crate::trust::scale::ScaleKind::Focal => "focal",
                }),
            ),
            ("of", scale.of.as_ref().map_or(Document::Null, Document::text)),
            ("percent", Document::Number(100.0 * scale.excess)),
            ("sigma_percent", Document::Number(100.0 * scale.sigma)),
        ])
    };
    Document::List(solved.scales.iter().map(one).collect())
}

/// What residuals follow, and factors on distances that matter.
#[must_use]
pub fn remarks(solved: &Solved) -> Document {
    let one = |remark: &crate::trust::Remark| {
        Document::map([
            ("kind", Document::text(remark.factor.name())),
            ("what", Document::text(&remark.what)),
            ("remedy", Document::text(&remark.remedy)),
            ("size", Document::Number(remark.size)),
            ("unit", Document::text(remark.unit)),
            ("interval", remark.interval.map_or(Document::Null, Document::Number)),
        ])
    };
    Document::List(solved.remarks.iter().map(one).collect())
}

/// What is wrong with a recording or its description.
#[must_use]
pub fn faults(faults: &[crate::trust::Fault]) -> Document {
    let one = |fault: &crate::trust::Fault| {
        Document::map([
            ("kind", Document::text(fault.kind.name())),
            ("what", Document::text(&fault.what)),
            ("evidence", Document::text(&fault.evidence)),
            ("remedy", Document::text(&fault.remedy)),
            ("action", Document::text(fault.action.name())),
        ])
    };
    Document::List(faults.iter().map(one).collect())
}

/// How a recording was solved that does not fit into memory, and what is then said of a part of it only.
#[must_use]
pub fn streamed(solved: &Solved) -> Option<Document> {
    let streamed = solved.streamed.as_ref()?;
    let [first, all] = streamed.configurations;
    let costs: Vec<f64> = streamed.report.costs.iter().map(|(cost, _)| *cost).collect();
    Some(Document::map([
        ("memory_bytes", Document::Whole(streamed.memory)),
        ("configurations", Document::Whole(all as u64)),
        ("solved_first", Document::Whole(first as u64)),
        ("one_of", Document::Whole(streamed.stride)),
        ("corners", Document::Whole(streamed.corners as u64)),
        ("pieces", Document::Whole(streamed.chunks as u64)),
        ("costs_of_passes", Document::numbers(&costs)),
        ("step_left_over_sigma", Document::Number(streamed.report.left_over)),
        ("of_a_part", Document::Row(["faults", "remarks", "scales"].into_iter().map(Document::text).collect())),
    ]))
}

/// The quality of the fit.
#[must_use]
pub fn fit(solved: &Solved) -> Vec<(String, Document)> {
    let r = &solved.summary;
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
        (
            "shared_errors".to_owned(),
            Document::map([
                ("by_configuration", scatter(&solved.covariance.clusters.configurations)),
                ("by_corner", scatter(&solved.covariance.clusters.corners)),
            ]),
        ),
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
