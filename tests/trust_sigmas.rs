//! Standard deviations against what they are of: terms against the whole problem, a robot's stops against the formula, intervals against the truth.

#[path = "support/cells.rs"]
mod cells;
#[path = "support/coverage.rs"]
mod coverage;
#[path = "support/random_cells.rs"]
mod random_cells;

use cellmap::frames::FrameTree;
use cellmap::layout::{Layout, PoseSpec};
use cellmap::recording::Recording;
use cellmap::solve::terms::Terms;
use cellmap::solve::{Assembler, Loss, Normal, Plan, Priors, State};
use cellmap::trust::Source;
use nalgebra::{DMatrix, Matrix6};
use random_cells::{Kind, REPEATABILITY};

/// A state at the poses of a layout.
fn state(layout: &Layout, tree: &FrameTree, plan: &Plan) -> State {
    State {
        static_poses: tree.static_edges.iter().map(|edge| edge.spec.truth().unwrap_or_default()).collect(),
        moving_poses: vec![vec![cellmap::geometry::Pose::identity(); plan.configurations.len()]; plan.moving_count()],
        corrections: layout.robots.iter().map(|robot| robot.corrections.clone()).collect(),
        lenses: layout.cameras.iter().map(|c| *c.intrinsics.as_ref().unwrap().parameters()).collect(),
    }
}

/// The terms and the whole normal equations of a layout at its own poses.
fn apart(layout: &Layout, recording: &Recording) -> (Plan, Terms, Normal) {
    let tree = FrameTree::new(layout);
    let plan = Plan::new(layout, &tree, recording).unwrap();
    let at = state(layout, &tree, &plan);
    let mut assembler = Assembler::new(layout, recording, &plan, Priors::default());
    assembler.set_loss(Loss::Squared);
    let mut normal = Normal::default();
    assembler.linearise(&at, &mut normal);
    let terms = assembler.terms(&at);
    drop(assembler);
    (plan, terms, normal)
}

#[test]
fn the_terms_add_up_to_the_whole_problem() {
    for kind in [Kind::TwoRobots, Kind::Lenses, Kind::Links] {
        let simulated = random_cells::cell(kind, 3, 15);
        let mut layout = simulated.truth.clone();
        // What the solver is told to find, at the true poses.
        for (found, told) in layout.cameras.iter_mut().zip(&simulated.told.cameras) {
            (found.refine, found.pose) = (told.refine.clone(), started(&found.pose, &told.pose));
        }
        for (found, told) in layout.robots.iter_mut().zip(&simulated.told.robots) {
            (found.identify, found.pose) = (told.identify.clone(), started(&found.pose, &told.pose));
        }
        let (plan, terms, normal) = apart(&layout, &simulated.recording);
        let n = plan.unknowns.count;
        assert!(n > 20 && terms.configurations.len() == 15 && terms.corners.len() > 90, "{n} {}", terms.corners.len());
        let information = terms.information(n);
        let mut gradient = vec![0.0; n];
        for term in terms.configurations.iter().chain(&terms.corners) {
            for (column, g) in term.columns.iter().zip(term.gradient.iter()) {
                gradient[*column] += g;
            }
        }
        for i in 0..n {
            let scale = normal.hessian[i * n + i].sqrt();
            assert!((gradient[i] - normal.gradient[i]).abs() < 1e-7 * scale, "{kind:?} gradient {i}");
            for j in 0..n {
                let other = normal.hessian[j * n + j].sqrt();
                let (a, b) = (information[i * n + j], normal.hessian[i * n + j]);
                assert!((a - b).abs() < 1e-9 * scale * other, "{kind:?} {i} {j}: {a} {b}");
            }
        }
    }
}

/// A pose that is to be found, starting from the truth.
fn started(truth: &PoseSpec, told: &PoseSpec) -> PoseSpec {
    match told {
        PoseSpec::Unknown => PoseSpec::Start(truth.truth().unwrap()),
        other => *other,
    }
}

#[test]
fn a_stop_is_marginalised_by_the_formula() {
    let mut simulated = random_cells::cell(Kind::OneRobot, 5, 8);
    // The wrist camera's view of the table says where the robot stopped, too.
    simulated.recording.corners.retain(|row| simulated.truth.cameras[row.camera].name != "wrist");
    let mut layout = simulated.truth.clone();
    let tool = layout.targets.iter().position(|target| target.name == "tool_cube").unwrap();
    let flange_from_tool = layout.targets[tool].pose.truth().unwrap();
    layout.targets[tool].pose = PoseSpec::Start(flange_from_tool);
    let (_, without, _) = apart(&layout, &simulated.recording);
    let sigma = [2e-4, 7e-4];
    layout.robots[0].repeatability = Some(sigma);
    let (_, with, _) = apart(&layout, &simulated.recording);
    // A twist of the flange is Ad(tool^-1) of itself at the tool; only the tool's pose is unknown.
    let adjoint = flange_from_tool.inverse_adjoint();
    let belief = Matrix6::from_diagonal(&nalgebra::Vector6::from_fn(|i, _| sigma[i / 3].powi(-2)));
    assert_eq!(with.configurations.len(), without.configurations.len());
    for (with, without) in with.configurations.iter().zip(&without.configurations) {
        let m: Matrix6<f64> = without.information.fixed_view::<6, 6>(0, 0).into_owned();
        let inner = (adjoint.transpose() * m * adjoint + belief).try_inverse().unwrap();
        let expected = m - m * adjoint * inner * adjoint.transpose() * m;
        let found: Matrix6<f64> = with.information.fixed_view::<6, 6>(0, 0).into_owned();
        assert!((found - expected).norm() < 1e-7 * m.norm(), "{}", (found - expected).norm() / m.norm());
        assert!(found.norm() < 0.9 * m.norm(), "the stops take something away");
    }
}

#[test]
fn a_told_repeatability_makes_the_answer_better_and_its_sigma_true() {
    let (mut told_error, mut untold_error) = (0.0, 0.0);
    for seed in 0..6 {
        let error = |kind| {
            let simulated = random_cells::cell(kind, seed, 25);
            let solved = random_cells::solve(&simulated);
            let truth = cells::true_pose(&simulated.truth, "world_from_ur5e.base");
            let found = solved.pose("world_from_ur5e.base").unwrap();
            (solved, (truth.translation - found.translation).norm_squared())
        };
        let (told, told_square) = error(Kind::StopsTold);
        let (untold, untold_square) = error(Kind::Stops);
        told_error += told_square;
        untold_error += untold_square;
        assert!((told.covariance.noise - 1.0).abs() < 0.06, "{}", told.covariance.noise);
        assert!(!told.covariance.clusters.configurations.shown(), "{:?}", told.covariance.clusters.configurations);
        assert!(untold.covariance.clusters.configurations.shown(), "{:?}", untold.covariance.clusters.configurations);
        assert_eq!(told.layout.robots[0].repeatability, Some(REPEATABILITY));
    }
    assert!(told_error < 0.7 * untold_error, "{told_error} {untold_error}");
}

#[test]
fn errors_in_common_are_shown_where_they_are_and_nowhere_else() {
    for seed in 20..24 {
        let plain = random_cells::solve(&random_cells::cell(Kind::OneRobot, seed, 25)).covariance;
        assert!(
            !plain.clusters.configurations.shown() && !plain.clusters.corners.shown(),
            "{:?}",
            plain.clusters.corners
        );
        // Nothing is shown: the sigma to use is the information's own.
        let apart = (&plain.clusters.shown - &plain.matrix).abs().max();
        assert!(apart < 1e-9 * plain.matrix.diagonal().max(), "{apart}");
        let still = random_cells::solve(&random_cells::cell(Kind::StillCorners, seed, 25)).covariance;
        assert!(still.clusters.corners.shown(), "{:?}", still.clusters.corners);
        assert!(still.clusters.corners.ratio() > 5.0);
    }
}

/// A small study with fixed seeds: intervals of 95 % contain the truth about as often as they say, whatever is unknown. Some hundred tries a row leave a
/// standard deviation of about one percent; the large study is `examples/coverage.rs`.
#[test]
fn intervals_contain_the_truth_as_often_as_they_say() {
    for (kind, source, least) in [
        (Kind::OneRobot, Source::Information, 0.925),
        (Kind::OneRobot, Source::Both, 0.925),
        (Kind::Lenses, Source::Both, 0.925),
        (Kind::Links, Source::Both, 0.925),
        (Kind::Stops, Source::Clusters, 0.91),
        (Kind::StopsTold, Source::Clusters, 0.91),
        (Kind::StillCorners, Source::Both, 0.91),
    ] {
        let mut counts = coverage::Counts::new();
        for seed in 1000..1025 {
            let simulated = random_cells::cell(kind, seed, 25);
            coverage::count(&mut counts, &simulated, &random_cells::solve(&simulated));
        }
        let at = coverage::SOURCES.iter().position(|known| *known == source).unwrap();
        let (hits, tries) = counts.values().fold((0, 0), |sum, row| (sum.0 + row[at].0, sum.1 + row[at].1));
        let share = hits as f64 / tries as f64;
        assert!((least..0.99).contains(&share), "{kind:?} {source:?}: {share} of {tries}");
    }
}

#[test]
fn both_kinds_of_sigma_stand_side_by_side_in_the_solution() {
    let solved = random_cells::solve(&random_cells::cell(Kind::Lenses, 1, 20));
    let json: serde_json::Value = serde_json::from_str(
        &cellmap::export::solution::document(&solved, std::path::Path::new(".")).to_json().unwrap(),
    )
    .unwrap();
    let pose = &json["solution"]["poses"]["world_from_ur5e.base"];
    let of = |key: &str| -> Vec<f64> { pose[key].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect() };
    for part in ["sigma_xyz_mm", "sigma_rotvec_deg"] {
        let (headline, information, clusters) =
            (of(part), of(&format!("information_{part}")), of(&format!("clusters_{part}")));
        for i in 0..3 {
            assert!(headline[i] >= information[i] && information[i] > 0.0 && clusters[i] > 0.0);
            assert!((0.2..8.0).contains(&(clusters[i] / information[i])), "{part}: {clusters:?} {information:?}");
        }
    }
    let focal = &json["solution"]["parameters"]["left lens"]["fx"];
    assert!(focal["information_sigma"].as_f64().unwrap() > 0.0 && focal["clusters_sigma"].as_f64().unwrap() > 0.0);
    let shared = &json["solution"]["fit"]["shared_errors"]["by_configuration"];
    // Configurations at which nothing was seen that a robot moves have nothing to say.
    assert!((5..=20).contains(&shared["groups"].as_u64().unwrap()) && shared["shown"] == false, "{shared}");
    // A column's sigma is the root of the matrix's diagonal.
    let matrix: &DMatrix<f64> = &solved.covariance.matrix;
    let column = solved.plan.unknowns.count - 1;
    let sigma = solved.covariance.column_sigma(column, Source::Information).unwrap();
    assert!((sigma / (matrix[(column, column)].sqrt() * solved.covariance.units()[column]) - 1.0).abs() < 1e-12);
}
