//! Cells of known truth, solved without a guess.

#[path = "support/cells.rs"]
mod cells;

use cellmap::geometry::Pose;
use cellmap::recording::{PointRow, PoseRow, Recording, RobotMotion};
use cellmap::simulate::Cell;
use cellmap::trust::{Action, FaultKind};
use cells::{hidden, layout, record, solve, true_pose, two_robot_motion, two_robot_truth};

/// Every pose that was found against the truth: (key, metres, radians).
fn errors(solved: &cellmap::workflow::solve::Solved, truth: &cellmap::layout::Layout) -> Vec<(String, f64, f64)> {
    let found = solved.tree.static_edges.iter().enumerate().filter(|(_, edge)| edge.freedom.count() == 6);
    found
        .map(|(index, edge)| {
            // A tag of unknown place has a frame of its own, which the truth's layout has not.
            let expected = match edge.key.as_str() {
                "bin_from_bin.tag61" => match &truth.targets.iter().find(|t| t.name == "bin").unwrap().geometry {
                    cellmap::geometry::TargetGeometry::Tags(faces) => faces[1].target_from_tag.unwrap(),
                    _ => panic!("the bin carries tags"),
                },
                key => true_pose(truth, key),
            };
            let (t, r) = (expected.inverse() * solved.state.static_poses[index]).magnitude();
            (edge.key.clone(), t, r)
        })
        .collect()
}

#[test]
fn two_robots_five_cameras_and_six_targets_are_recovered_exactly_without_noise() {
    let truth = layout(&two_robot_truth());
    let recording = record(&truth, two_robot_motion(30), 0.0, 1);
    let solved = solve(layout(&hidden(cells::TWO_ROBOTS)), &recording);
    assert!(solved.trustworthy(), "{:?} {:?}", solved.report.termination, solved.undetermined);
    let errors = errors(&solved, &truth);
    assert_eq!(errors.len(), 5 + 2 + 5 + 2 + 1, "cameras, robots, targets, tools, the bin's second tag");
    for (key, t, r) in errors {
        // The gauge plate's numbering has two equal ends: its pose may be the truth turned by half a turn in its plane.
        if key == "world_from_gauge_plate" && r > 1.0 {
            let turned = true_pose(&truth, &key)
                * Pose::from_translation(0.2, 0.12, 0.0)
                * Pose::from_rotation_vector(&nalgebra::Vector3::new(0.0, 0.0, std::f64::consts::PI));
            let (t, r) = (turned.inverse() * solved.pose(&key).unwrap()).magnitude();
            assert!(t < 1e-9 && r < 1e-9, "{key}: {t} m, {r} rad");
            continue;
        }
        assert!(t < 1e-9 && r < 1e-9, "{key}: {t} m, {r} rad");
    }
}

#[test]
fn with_noise_every_component_lies_within_four_sigma() {
    let truth = layout(&two_robot_truth());
    for seed in 0..3 {
        let recording = record(&truth, two_robot_motion(30), 0.1, 100 + seed);
        let solved = solve(layout(&hidden(cells::TWO_ROBOTS)), &recording);
        assert!(solved.trustworthy());
        assert!((solved.covariance.noise - 1.0).abs() < 0.05, "fitted noise {}", solved.covariance.noise);
        for (index, edge) in solved.tree.static_edges.iter().enumerate() {
            let (Some(block), false) =
                (solved.plan.unknowns.edge(index), edge.key.contains("gauge") || edge.key.contains("tag61"))
            else {
                continue;
            };
            let sigma = solved.covariance.pose_sigma(
                &solved.tree,
                &solved.state,
                &solved.plan.unknowns.blocks[block],
                cellmap::trust::Source::Both,
            );
            let (expected, found) = (true_pose(&truth, &edge.key), solved.state.static_poses[index]);
            let shift = found.translation - expected.translation;
            let turn =
                found.rotation * cellmap::geometry::rotation::log(&(expected.rotation.inverse() * found.rotation));
            for (d, s) in shift.iter().chain(turn.iter()).zip(sigma) {
                let s = s.unwrap();
                assert!(d.abs() < 4.0 * s, "{}: {d} against sigma {s}", edge.key);
                assert!(s < 5e-3, "{}: sigma {s}", edge.key);
            }
        }
    }
}

#[test]
fn outliers_are_set_aside_and_do_no_harm() {
    let truth = layout(&two_robot_truth());
    let mut recording = record(&truth, two_robot_motion(30), 0.1, 5);
    let mut spoilt = 0;
    recording.corners.edit(|rows| {
        for row in rows.iter_mut().step_by(53) {
            row.pixel[0] += 25.0;
            spoilt += 1;
        }
    });
    for loss in ["{huber: 1.5}", "{cauchy: 2}", "{tukey: 6}"] {
        let text = hidden(cells::TWO_ROBOTS).replace("{huber: 1.5}", loss);
        let solved = solve(layout(&text), &recording);
        assert!(solved.report.termination.converged(), "{loss}");
        let rejected = solved.rejected.corners;
        assert!(rejected >= spoilt && rejected < spoilt + spoilt / 5 + 5, "{loss}: {rejected} of {spoilt}");
        for (key, t, _) in errors(&solved, &truth).iter().filter(|(key, ..)| !key.contains("gauge")) {
            assert!(*t < 2e-3, "{loss}: {key} off by {t} m");
        }
    }
}

const WAND: &str = "
cellmap: 1
units: {length: m, angle: rad}
world: a
cameras:
  a:
    intrinsics: {model: pinhole, size: [1280, 960], focal: [900, 900], centre: [639.5, 479.5]}
  b:
    intrinsics: {model: pinhole, size: [1280, 960], focal: [900, 900], centre: [639.5, 479.5]}
  c:
    intrinsics: {model: pinhole, size: [1280, 960], focal: [900, 900], centre: [639.5, 479.5]}
targets:
  wand: {checkerboard: {corners: [4, 3], square: 0.05}, moves: true}
solve: {pixel_sigma: 0.1}
";

/// Corners of a board waved in front of three cameras.
fn waved(noise: f64) -> (Vec<Pose>, Recording) {
    use nalgebra::Vector3;
    use rand::{Rng, SeedableRng};
    let layout = layout(WAND);
    let place = |x: f64, z: f64, turn: f64| {
        Pose::from_translation(x, 0.0, z) * Pose::from_rotation_vector(&Vector3::new(0.0, turn, 0.0))
    };
    let world_from_camera = vec![Pose::identity(), place(0.8, 0.2, -0.6), place(-0.7, 0.1, 0.5)];
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(3);
    let mut rows = Vec::new();
    for configuration in 0..25u64 {
        let mut draw = |scale: f64| random.random_range(-scale..scale);
        let wand = Pose::from_translation(draw(0.2), draw(0.15), 1.2 + draw(0.2))
            * Pose::from_rotation_vector(&Vector3::new(draw(0.5), draw(0.5), draw(0.8)));
        for (camera, pose) in world_from_camera.iter().enumerate() {
            for i in 0..12u32 {
                let feature = cellmap::geometry::Feature::BoardCorner(i);
                let point = pose.inverse() * (wand * layout.targets[0].geometry.place(&feature).unwrap());
                let pixel = layout.cameras[camera].intrinsics.as_ref().unwrap().project(&point).unwrap();
                let pixel = [pixel.x + noise * draw(1.0), pixel.y + noise * draw(1.0)];
                rows.push(cellmap::recording::CornerRow {
                    configuration,
                    shot: 0,
                    camera,
                    target: 0,
                    feature,
                    pixel,
                    covariance: None,
                });
            }
        }
    }
    (world_from_camera, Recording { corners: rows.into(), ..Recording::default() })
}

#[test]
fn cameras_are_tied_by_a_board_that_moves() {
    let (truth, recording) = waved(0.0);
    let solved = solve(layout(WAND), &recording);
    assert!(solved.trustworthy(), "{:?}", solved.undetermined);
    assert_eq!(solved.unknowns, 2 * 6 + 25 * 6);
    for (camera, expected) in ["a", "b", "c"].iter().zip(&truth) {
        let (t, r) = (expected.inverse() * solved.world_from(camera).unwrap()).magnitude();
        assert!(t < 1e-9 && r < 1e-9, "{camera}: {t} {r}");
    }
    assert_eq!(solved.moved, vec![(0..25).collect::<Vec<_>>()]);
    let (_, noisy) = waved(0.2);
    let solved = solve(layout(WAND), &noisy);
    let (t, _) = (truth[1].inverse() * solved.world_from("b").unwrap()).magnitude();
    assert!(t < 2e-3, "{t}");
}

#[test]
fn whole_poses_and_points_are_enough_too() {
    let text = "
cellmap: 1
units: {length: m, angle: rad}
world: tracker
cameras:
  eye:
    pose: {xyz: [1.5, -0.4, 1.0], rpy: [-2.0, 0.1, 0.7]}
sensors:
  tracker: {measures: points}
robots:
  arm:
    model: ur5e
    joints: joints.csv
    pose: {xyz: [0.3, 0.2, -0.1], rpy: [0.02, -0.01, 0.8]}
targets:
  reflector:
    points: {ball: [0.03, -0.02, 0.12]}
    mount: arm.flange
    pose: {xyz: [0, 0, 0], rpy: [0, 0, 0]}
  flag:
    mount: arm.flange
    pose: {xyz: [0.05, 0.0, 0.1], rpy: [0.3, -0.2, 1.0]}
";
    let truth = layout(text);
    let motions = vec![RobotMotion::Joints(cells::wander(&[0.3, -1.6, 1.9, -1.8, -1.5, 0.2], 0.7, 20, 4))];
    let mut recording = Recording { motions, ..Recording::default() };
    let shadow = recording.clone();
    let cell = Cell::new(&truth, &shadow);
    for configuration in 1..=20 {
        let flag = cell.pose(cell.tree.cameras[0], cell.tree.targets[1], configuration).unwrap();
        recording.poses.push(PoseRow { configuration, shot: 0, camera: 0, target: 1, pose: flag });
        let ball =
            cell.pose(0, cell.tree.targets[0], configuration).unwrap() * nalgebra::Vector3::new(0.03, -0.02, 0.12);
        let feature = cellmap::geometry::Feature::Point("ball".into());
        recording.points.push(PointRow { configuration, shot: 0, sensor: 0, target: 0, feature, position: ball });
    }
    let unknown = hidden(text).replace("ball: [0.03, -0.02, 0.12]", "ball: unknown").replace(
        "    mount: arm.flange\n  flag",
        "    mount: arm.flange\n    pose : {xyz: [0, 0, 0], rpy: [0, 0, 0]}\n  flag",
    );
    let solved = solve(layout(&unknown), &recording);
    assert!(solved.trustworthy(), "{:?}", solved.undetermined);
    for key in ["world_from_eye", "world_from_arm.base", "arm.flange_from_flag"] {
        let (t, r) = (true_pose(&truth, key).inverse() * solved.pose(key).unwrap()).magnitude();
        assert!(t < 1e-9 && r < 1e-9, "{key}: {t} {r}");
    }
    let ball = solved.pose("reflector_from_reflector.ball").unwrap().translation;
    assert!((ball - nalgebra::Vector3::new(0.03, -0.02, 0.12)).norm() < 1e-9);
}

#[test]
fn a_prior_holds_what_nothing_measures_and_yields_to_what_is_measured() {
    let truth = layout(&two_robot_truth());
    let recording = record(&truth, two_robot_motion(20), 0.0, 1);
    let wrong = hidden(cells::TWO_ROBOTS).replace(
        "    mount: ur5e.flange\n",
        "    mount: ur5e.flange\n    pose : {xyz: [10, 10, 100], rpy: [0, 0, -50], sigma: {xyz: 20, rotation: 10}}\n",
    );
    let solved = solve(layout(&wrong), &recording);
    let key = "ur5e.flange_from_ur5e_tool";
    let (t, _) = (true_pose(&truth, key).inverse() * solved.pose(key).unwrap()).magnitude();
    assert!(t < 1e-4, "the pixels outweigh a 20 mm prior: {t}");
}

#[test]
fn the_cost_never_rises() {
    let truth = layout(&two_robot_truth());
    let recording = record(&truth, two_robot_motion(20), 0.1, 9);
    let solved = solve(layout(&hidden(cells::TWO_ROBOTS)), &recording);
    assert!(solved.report.costs.windows(2).all(|pair| pair[1] <= pair[0]), "{:?}", solved.report.costs);
    assert!(solved.report.final_cost <= solved.report.initial_cost);
}

/// A board with an even and an even corner count looks the same upside down: whoever detects it numbers it either way, picture by picture.
#[test]
fn half_turned_boards_are_put_right_by_the_robots_motion() {
    let tools = "    checkerboard: {corners: [6, 4], square: 30}\n";
    let tool = |text: &str| {
        let from = text.find("  tool_cube:").unwrap();
        let to = text[from..].find("    mount: ur5e.flange").unwrap() + from;
        format!("{}  tool_cube:\n{tools}{}", &text[..from], &text[to..])
    };
    let text = tool(&cells::one_robot_truth())
        .replace("xyz: [2, 3, 110], rpy: [1, -0.5, 44]", "xyz: [-75, -45, 60], rpy: [178, 1, 3]");
    // The board faces down from the flange; the cameras look up at it from below the table's edge.
    let text = text
        .replace("xyz: [-900, -700, 1000], rpy: [-132, 0, -45]", "xyz: [-500, -400, -500], rpy: [-55, 0, -45]")
        .replace("xyz: [1000, -800, 1050], rpy: [-133, 0, 46]", "xyz: [600, -500, -550], rpy: [-50, 0, 46]");
    let truth = layout(&text);
    let stops = cells::wander(&[-1.9, -1.75, 1.9, -1.7, -1.55, 0.4], 0.35, 25, 6);
    let mut recording = record(&truth, vec![RobotMotion::Joints(stops)], 0.05, 8);
    let board = truth.targets.iter().position(|target| target.name == "tool_cube").unwrap();
    let mut turned = 0;
    recording.corners.edit(|rows| {
        for row in rows.iter_mut().filter(|row| row.target == board) {
            if let cellmap::geometry::Feature::BoardCorner(i) = &mut row.feature
                && (row.configuration * 7 + row.camera as u64).is_multiple_of(3)
            {
                *i = 23 - *i;
                turned += 1;
            }
        }
    });
    let cameras: std::collections::BTreeSet<usize> =
        recording.corners.iter().filter(|row| row.target == board).map(|row| row.camera).collect();
    assert!(turned > 100 && cameras.len() >= 2, "{turned} corners turned, seen by {cameras:?}");
    // Tie the cameras to the world by their truth: only the robot and its board are to be found.
    let lines: Vec<String> = text
        .lines()
        .scan(String::new(), |section, line| {
            if line.starts_with("  ") && !line.starts_with("   ") || !line.starts_with(' ') {
                *section = line.trim().to_owned();
            }
            let hide =
                line.trim_start().starts_with("pose:") && !section.starts_with("left") && !section.starts_with("right");
            Some(if hide { String::new() } else { line.to_owned() })
        })
        .collect();
    let solved = solve(layout(&lines.join("\n")), &recording);
    // The wrist camera and the pallet are out of everybody's sight here.
    assert!(solved.report.termination.converged());
    assert!(
        solved.undetermined.iter().all(|u| u.reason.starts_with("no measurement sees")),
        "{:?}",
        solved.undetermined
    );
    assert!(solved.summary.rms_px().unwrap() < 0.055, "{:?}", solved.summary.rms_px());
    assert_eq!(solved.rejected.total(), 0);
    let (t, _) = (true_pose(&truth, "world_from_ur5e.base").inverse() * solved.pose("world_from_ur5e.base").unwrap())
        .magnitude();
    assert!(t < 1e-3, "{t}");
}

#[test]
fn a_moving_target_that_is_hardly_seen_is_left_out_where_it_is() {
    let (truth, mut recording) = waved(0.0);
    // At two configurations only three corners are left: no pose.
    recording.corners.edit(|rows| {
        rows.retain(|row| {
            ![3, 7].contains(&row.configuration)
                || matches!(row.feature, cellmap::geometry::Feature::BoardCorner(i) if i < 3)
        });
    });
    let solved = solve(layout(WAND), &recording);
    assert!(solved.trustworthy(), "{:?} {:?}", solved.report.termination, solved.undetermined);
    assert_eq!(solved.rejected.unplaced, 2 * 3 * 3);
    let (t, _) = (truth[1].inverse() * solved.world_from("b").unwrap()).magnitude();
    assert!(t < 1e-9, "{t}");
}

#[test]
fn a_prior_is_not_weighed_by_the_noise_of_the_measurements() {
    // Nothing but its prior speaks of the probe.
    let truth = layout(&two_robot_truth());
    let recording = record(&truth, two_robot_motion(20), 0.02, 1);
    let probe = "  unseen_probe:\n    mount: ur5e.flange\n    pose : {xyz: [0, 0, 50], rpy: [0, 0, 0], sigma: {xyz: 2, rotation: 1}}\nsolve:";
    let text = hidden(cells::TWO_ROBOTS).replace("solve:", probe);
    let solved = solve(layout(&text), &recording);
    assert!(solved.covariance.noise < 0.3, "{}", solved.covariance.noise);
    let (_, probe) =
        cellmap::export::findings::poses(&solved).into_iter().find(|(key, _)| key.ends_with("unseen_probe")).unwrap();
    let cellmap::export::Document::Map(entries) = probe else { panic!("a pose is a map") };
    let sigma = &entries.iter().find(|(key, _)| key == "sigma_xyz_mm").unwrap().1;
    assert_eq!(*sigma, cellmap::export::Document::numbers(&[2.0, 2.0, 2.0]));
    // A measured pose with a weak prior: its sigma is the measurements'.
    let weak = hidden(cells::TWO_ROBOTS).replace(
        "    mount: ur5e.flange\n",
        "    mount: ur5e.flange\n    pose : {xyz: [-4, 2, 118], rpy: [-0.7, 1.1, -58], sigma: {xyz: 20, rotation: 10}}\n",
    );
    let (with, without) = (solve(layout(&weak), &recording), solve(layout(&hidden(cells::TWO_ROBOTS)), &recording));
    let sigma = |solved: &cellmap::workflow::solve::Solved| {
        let index = solved.tree.static_edges.iter().position(|edge| edge.key == "ur5e.flange_from_ur5e_tool").unwrap();
        let block = &solved.plan.unknowns.blocks[solved.plan.unknowns.edge(index).unwrap()];
        solved.covariance.pose_sigma(&solved.tree, &solved.state, block, cellmap::trust::Source::Both)[0].unwrap()
    };
    assert!((sigma(&with) / sigma(&without) - 1.0).abs() < 0.02);
}

#[test]
fn a_corner_that_cannot_be_where_it_was_read_is_set_aside() {
    let truth = layout(&two_robot_truth());
    let mut recording = record(&truth, two_robot_motion(20), 0.05, 1);
    // The wrist camera claims to see the tag on its own tool, which is behind its lens plane.
    let mut false_read = recording.corners.iter().find(|row| row.camera == 4).unwrap();
    false_read.target = truth.targets.iter().position(|target| target.name == "ur10e_tool").unwrap();
    recording.corners.edit(|rows| {
        for corner in 0..4u8 {
            false_read.feature = cellmap::geometry::Feature::TagCorner(72, corner);
            false_read.pixel = [600.0 + 40.0 * f64::from(corner % 2), 500.0 + 40.0 * f64::from(corner / 2)];
            rows.push(false_read.clone());
        }
    });
    let solved = solve(layout(&hidden(cells::TWO_ROBOTS)), &recording);
    assert!(solved.rejected.corners >= 4, "{:?}", solved.rejected);
    assert!(solved.summary.rms_px().unwrap() < 0.06, "{:?}", solved.summary.rms_px());
    assert!(solved.report.final_cost < 1e6, "no corner costs more than it can be wrong");
}

#[test]
fn cameras_that_share_only_a_waved_board_with_a_world_that_nobody_sees_are_in_pieces() {
    let (_, recording) = waved(0.0);
    let text = WAND.replace("world: a", "world: bench");
    let error = cellmap::workflow::solve::solve_recording(
        layout(&text),
        &recording,
        &[],
        Vec::new(),
        std::time::Instant::now(),
    )
    .unwrap_err()
    .to_string();
    assert!(error.contains("the cell is in two pieces: `a`, `b`, `c` are not tied to `bench`"), "{error}");
}

#[test]
fn link_corrections_survive_a_second_solve_and_a_rail_keeps_its_metres() {
    use cellmap::export::solution;
    let text = "
cellmap: 1
units: {length: mm, angle: deg}
world: tracker
sensors:
  tracker: {measures: points}
robots:
  arm:
    model: {mdh: rail.yaml}
    joints: joints.csv
    pose: {xyz: [100, 50, 0], rpy: [0, 0, 30]}
    corrections: [[5, 0, 0, 0], [0.5, 0, 1, 0.2], [-0.4, 0, 0, 0]]
targets:
  ball: {points: {b: [10, 20, 80]}, mount: arm.flange, pose: {xyz: [0, 0, 0], rpy: [0, 0, 0]}}
";
    let rail = "cellmap_robot: 1\nunits: {length: mm, angle: deg}\nconvention: mdh\njoints:\n  - {alpha: 0, a: 0, theta: 0, d: 0, type: prismatic}\n  - {alpha: -90, a: 0, theta: 0, d: 0}\n  - {alpha: 90, a: 400, theta: 0, d: 0}\n";
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("rail.yaml"), rail).unwrap();
    let parse = |text: &str| cellmap::layout::parse_layout(&dir.path().join("cell.yaml"), text, None).unwrap();
    let truth = parse(text);
    assert_eq!(truth.robots[0].corrections[0], 0.005, "a rail's offset is a length");
    let joints = cells::wander(&[0.3, 0.2, -0.3], 0.9, 40, 3);
    let mut recording = Recording { motions: vec![RobotMotion::Joints(joints)], ..Recording::default() };
    let shadow = recording.clone();
    let cell = Cell::new(&truth, &shadow);
    for configuration in 1..=40 {
        let position =
            cell.pose(0, cell.tree.targets[0], configuration).unwrap() * nalgebra::Vector3::new(0.01, 0.02, 0.08);
        let feature = cellmap::geometry::Feature::Point("b".into());
        recording.points.push(PointRow { configuration, shot: 0, sensor: 0, target: 0, feature, position });
    }
    // The base is known; the links are to be found.
    let lines: Vec<&str> = text.lines().filter(|line| !line.contains("corrections")).collect();
    let unknown = lines
        .join("\n")
        .replace("joints: joints.csv", "joints: joints.csv\n    identify: {joint_offsets: {sigma: 20}}");
    let layout = parse(&unknown);
    let solved = solve(layout, &recording);
    let offset = solved.state.corrections[0][0];
    assert!((offset - 0.005).abs() < 2e-3, "{offset}");
    let again = parse(&solution::document(&solved, dir.path()).to_yaml().unwrap());
    let kept = &again.robots[0].corrections;
    assert!(kept.iter().zip(&solved.state.corrections[0]).all(|(a, b)| (a - b).abs() < 1e-12), "{kept:?}");
    // Solving the solution keeps what it found of the links.
    let second = solve(again, &recording);
    assert_eq!(second.state.corrections[0], solution_corrections(&second));
    assert!((second.summary.rms_points().unwrap() - solved.summary.rms_points().unwrap()).abs() < 1e-9);
}

fn solution_corrections(solved: &cellmap::workflow::solve::Solved) -> Vec<f64> {
    solved.layout.robots[0].corrections.clone()
}

#[test]
fn a_wrong_tag_size_is_not_called_a_good_answer() {
    let truth = layout(&two_robot_truth());
    let recording = record(&truth, two_robot_motion(20), 0.1, 3);
    let right = solve(layout(&hidden(cells::TWO_ROBOTS)), &recording);
    assert!(right.doubts().is_empty() && right.trustworthy(), "{:?}", right.doubts());
    let wrong = hidden(cells::TWO_ROBOTS).replace("size: 90, gap: 20", "size: 80, gap: 20");
    let solved = solve(layout(&wrong), &recording);
    assert!(!solved.trustworthy());
    // It is not merely doubted but named: the pattern is a tenth larger than it was said to be.
    let size = solved.faults.iter().find(|fault| fault.kind == FaultKind::WrongSize);
    let size = size.unwrap_or_else(|| panic!("{:?}", solved.faults));
    assert_eq!(size.action, Action::Refused);
    assert!(size.what.contains("`table_board` measures 88."), "{}", size.what);
    assert!(size.remedy.contains("correct its size in the layout"), "{}", size.remedy);
    let counted: usize = solved.tallies.iter().map(|t| t.accepted + t.rejected).sum();
    assert_eq!(counted, recording.corners.len());
}
