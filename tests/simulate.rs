//! The simulator through the library: exact truth, honest statistics, faults that are where they should be, the same bits for the same seed.

#[path = "support/cells.rs"]
mod cells;

use std::collections::BTreeSet;
use std::path::Path;

use cellmap::geometry::{Feature, TargetGeometry};
use cellmap::identify::{Sample, free};
use cellmap::layout::write::sections;
use cellmap::layout::{Document, Layout, Paths, PoseSpec, parse_layout, read_layout};
use cellmap::recording::{Recording, RobotMotion};
use cellmap::simulate::bodies::robot_capsules;
use cellmap::simulate::{Simulated, faults, knowledge, paths, simulate};
use cellmap::workflow::solve::Solved;
use nalgebra::{Matrix6, Vector3, Vector6};

fn layouts() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("layouts")
}

fn named(name: &str) -> Layout {
    read_layout(&layouts().join(name), None).unwrap_or_else(|e| panic!("{e}"))
}

fn run(cell: &Layout, stops: u64, seed: u64, noise: f64) -> Simulated {
    let motions = paths::generate(cell, stops, seed).unwrap_or_else(|e| panic!("{e}"));
    simulate(cell, motions, seed, noise).unwrap_or_else(|e| panic!("{e}"))
}

fn solve(made: &Simulated) -> Solved {
    let recording = Recording { motions: made.logged.clone(), ..made.recording.clone() };
    cells::solve(made.told.clone(), &recording)
}

fn with(name: &str, section: &str) -> Layout {
    let text = std::fs::read_to_string(layouts().join(name)).unwrap();
    let text = &text[..text.find("\nsimulate:").unwrap() + 1];
    parse_layout(&layouts().join(name), &format!("{text}simulate: {section}\n"), None).unwrap_or_else(|e| panic!("{e}"))
}

/// Standard deviations of a pose by the information matrix.
fn sigma_of(solved: &Solved, key: &str) -> [Option<f64>; 6] {
    let edge = solved.tree.static_edges.iter().position(|edge| edge.key == key).unwrap();
    let block = &solved.plan.unknowns.blocks[solved.plan.unknowns.edge(edge).unwrap()];
    solved.covariance.pose_sigma(&solved.tree, &solved.state, block, cellmap::trust::Source::Both)
}

/// The paper's simulation A: without noise both methods find base and tool to a millionth of a micrometre (1e-9 mm).
#[test]
fn simulation_a_is_exact_without_noise() {
    let cell = named("paper_simulation_a.yaml");
    for seed in [1, 2, 3] {
        let made = run(&cell, 250, seed, 0.0);
        let samples: Vec<Sample> = made
            .recording
            .points
            .iter()
            .map(|row| Sample {
                base_from_flange: made.recording.base_from_flange(&made.truth, 0, row.configuration).unwrap(),
                world_point: row.position,
            })
            .collect();
        let published = free(&samples).unwrap();
        let (base, tool) = (Vector3::new(0.431, 0.555, -0.460), Vector3::new(0.0, 0.0, 0.066));
        assert!((published.origin - base).abs().max() < 1e-12 && (published.tool - tool).abs().max() < 1e-12);
        let solved = solve(&made);
        let found = solved.world_from("ur3.base").unwrap();
        let point = solved.world_from("tool.tool_tip");
        assert!((found.translation - base).abs().max() < 1e-12, "{:e}", (found.translation - base).abs().max());
        // The point's own frame hangs on the flange, which stands elsewhere at every configuration: its edge is compared.
        assert!(point.is_none());
        let tip = solved.tree.static_edges.iter().position(|edge| edge.key.ends_with("tool_tip")).unwrap();
        assert!((solved.state.static_poses[tip].translation - tool).abs().max() < 1e-12);
    }
}

/// Over 200 seeds, base and tool scatter about the truth as the covariance says: the mean of nine squared normalised errors is one.
#[test]
fn simulation_a_scatters_as_its_covariance_says() {
    let cell = named("paper_simulation_a.yaml");
    // One path for all, so that the covariance is the same for all.
    let motions = paths::generate(&cell, 250, 5).unwrap();
    let truth = knowledge::truth(&cell, 5);
    let mut sum = 0.0;
    let mut scatter = Matrix6::zeros();
    let mut sigma = Vector6::zeros();
    for seed in 0..200 {
        let solved = solve(&simulate(&cell, motions.clone(), seed, 1.0).unwrap());
        let base = solved.world_from("ur3.base").unwrap();
        let true_base = truth.robots[0].pose.pose().unwrap();
        let error = (true_base.inverse() * base).log();
        scatter += error * error.transpose() / 200.0;
        let found = sigma_of(&solved, "world_from_ur3.base");
        sigma = Vector6::from_iterator(found.into_iter().map(Option::unwrap));
        let translation = base.translation - true_base.translation;
        sum += (0..3).map(|i| (translation[i] / sigma[i]).powi(2)).sum::<f64>() / 3.0;
    }
    // The mean of 200 chi-square values of three correlated degrees of freedom, over three: one, within four of its own standard deviations (0.1 at most).
    let mean = sum / 200.0;
    assert!((0.6..1.4).contains(&mean), "{mean}");
    for i in 3..6 {
        let ratio = scatter[(i, i)].sqrt() / sigma[i];
        assert!((0.8..1.2).contains(&ratio), "rotation {i}: {ratio}");
    }
}

#[test]
fn the_same_seed_gives_the_same_bits_on_any_number_of_threads() {
    let cell = with(
        "workcell.yaml",
        "{configurations: 4, missing: 0.2, outliers: {wrong_id: 0.1, dragged: 0.1}, repeatability: {xyz: 0.1, rotation: 0.01}}",
    );
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| run(&cell, 4, 9, 1.0))
    };
    let (one, three) = (on(1), on(3));
    assert_eq!(one.recording, three.recording);
    assert_eq!(one.logged, three.logged);
    assert!(!one.recording.corners.is_empty());
    assert_ne!(one.recording.corners, run(&cell, 4, 10, 1.0).recording.corners);
}

/// A camera more changes nothing about what the others measured.
#[test]
fn instruments_are_independent() {
    let text = std::fs::read_to_string(layouts().join("two_robots.yaml")).unwrap();
    let fewer = text.replace(&text[text.find("  west:").unwrap()..text.find("  wrist:").unwrap()], "");
    assert_ne!(text, fewer);
    let (all, some) = (cells::layout(&text), cells::layout(&fewer));
    let motions = paths::generate(&some, 3, 1).unwrap();
    let all = simulate(&all, motions.clone(), 1, 1.0).unwrap();
    let some = simulate(&some, motions, 1, 1.0).unwrap();
    let of = |made: &Simulated, camera: usize| {
        made.recording.corners.iter().filter(|row| row.camera == camera).map(|row| row.pixel).collect::<Vec<_>>()
    };
    assert_eq!(of(&all, 1), of(&some, 1));
    assert!(!of(&all, 1).is_empty());
}

/// At every generated stop some camera sees the tool, no body dips below its base, and the stops are farther apart than random ones.
#[test]
fn generated_paths_show_the_tools_keep_off_the_floor_and_vary() {
    let cell = named("workcell.yaml");
    let made = run(&cell, 30, 3, 0.0);
    let tools: Vec<usize> =
        cell.targets.iter().enumerate().filter(|(_, t)| t.name.ends_with("_tool")).map(|(i, _)| i).collect();
    for stop in 1..=30 {
        for tool in &tools {
            let seen = made.recording.corners.iter().any(|row| row.configuration == stop && row.target == *tool);
            assert!(seen, "{} at {stop}", cell.targets[*tool].name);
        }
    }
    let asked = made.cell();
    for robot in 0..2 {
        let base = asked.tree.robots[robot][0];
        for capsule in robot_capsules(&cell, &asked.tree, robot).iter().filter(|capsule| capsule.link > 1) {
            for stop in 1..=30 {
                let placed = capsule.place(|frame| asked.pose(base, frame, stop)).unwrap();
                assert!(placed.clearance_above(&Vector3::zeros(), &Vector3::z()) >= 0.0);
            }
        }
        let RobotMotion::Joints(values) = &made.logged[robot] else { panic!("joints") };
        let nearest = |points: &[Vec<f64>]| {
            let apart = |a: &Vec<f64>, b: &Vec<f64>| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
            let one = |i: usize| {
                (0..points.len()).filter(|j| *j != i).map(|j| apart(&points[i], &points[j])).fold(f64::MAX, f64::min)
            };
            (0..points.len()).map(one).fold(f64::MAX, f64::min)
        };
        let chosen: Vec<Vec<f64>> = values.values().cloned().collect();
        let RobotMotion::Joints(other) = &run(&cell, 30, 4, 0.0).logged[robot] else { panic!("joints") };
        // Two unrelated paths mixed are about what chance gives: the same number of stops, every second from each.
        let mixed: Vec<Vec<f64>> = chosen.iter().step_by(2).chain(other.values().skip(1).step_by(2)).cloned().collect();
        assert!(nearest(&chosen) > 0.8 * nearest(&mixed), "{} {}", nearest(&chosen), nearest(&mixed));
        assert!(nearest(&chosen) > 0.3, "{}", nearest(&chosen));
    }
}

/// What a solver is told: hidden things not at all, fixed ones exactly, priors off by a draw.
#[test]
fn a_solver_is_told_what_the_layout_marks() {
    let text = "cellmap: 1\nunits: {length: mm, angle: deg}\nworld: w\nsensors: {w: {measures: points}}\nrobots:\n  a: {model: ur5e, joints: joints.csv, \
        pose: {xyz: [1, 2, 3], rpy: [0, 0, 0], unknown: true}}\ntargets:\n  t: {points: {p: [1, 2, 3], q: {xyz: [4, 5, 6], unknown: true}}, mount: a.flange, \
        pose: {xyz: [0, 0, 50], rpy: [0, 0, 0], sigma: {xyz: 2, rotation: 1}}}\n  f: {points: {g: [0, 0, 0]}, pose: {xyz: [7, 7, 7], rpy: [0, 0, 0]}}\n  \
        s: {points: {h: [0, 0, 0]}, pose: {xyz: [8, 8, 8], rpy: [0, 0, 0], start: true}}\n";
    let cell = cells::layout(text);
    let told = knowledge::told(&cell, 1);
    assert_eq!(told.robots[0].pose, PoseSpec::Unknown);
    let PoseSpec::Prior(pose, _) = told.targets[0].pose else { panic!("a prior") };
    let off = (pose.translation - Vector3::new(0.0, 0.0, 0.05)).norm();
    assert!(off > 1e-5 && off < 0.02, "{off}");
    assert_eq!(told.targets[1].pose, cell.targets[1].pose);
    assert_eq!(told.targets[2].pose, cell.targets[2].pose);
    let TargetGeometry::Points(points) = &told.targets[0].geometry else { panic!("points") };
    assert_eq!(points[1].1, None);
    let truth = knowledge::truth(&cell, 1);
    assert_eq!(truth.targets[0].pose.pose().unwrap().translation, Vector3::new(0.0, 0.0, 0.05));
    let TargetGeometry::Points(points) = &truth.targets[0].geometry else { panic!("points") };
    assert_eq!(points[1].1, Some(Vector3::new(0.004, 0.005, 0.006)));

    // A plain description marks nothing: everything but the world is hidden.
    let plain = cells::layout(
        &text
            .replace(", unknown: true}", "}")
            .replace("q: {xyz: [4, 5, 6]}", "q: [4, 5, 6]")
            .replace(", sigma: {xyz: 2, rotation: 1}", "")
            .replace(", start: true", ""),
    );
    assert!(!knowledge::is_marked(&plain));
    assert!(knowledge::told(&plain, 1).targets.iter().all(|target| target.pose == PoseSpec::Unknown));
}

/// A layout that is written and read again says the same, for every layout of the project and both sides of its simulation.
#[test]
fn layouts_are_written_as_they_are_read() {
    for entry in std::fs::read_dir(layouts()).unwrap().flatten() {
        let path = entry.path();
        let is_cell = path.is_file() && std::fs::read_to_string(&path).unwrap().contains("\ncellmap: 1\n");
        if !is_cell {
            continue;
        }
        let cell = read_layout(&path, None).unwrap_or_else(|e| panic!("{e}"));
        for layout in [cell.clone(), knowledge::truth(&cell, 3), knowledge::told(&cell, 3)] {
            let text = Document::Map(sections(&layout, &Paths::new(&layout, &layouts()))).to_yaml().unwrap();
            let again = parse_layout(&path, &text, None).unwrap_or_else(|e| panic!("{e}\n{text}"));
            let same = |a: &PoseSpec, b: &PoseSpec| match (a, b) {
                (PoseSpec::Unknown, PoseSpec::Unknown) => true,
                (PoseSpec::Fixed(a), PoseSpec::Fixed(b))
                | (PoseSpec::Hidden(a), PoseSpec::Hidden(b))
                | (PoseSpec::Start(a), PoseSpec::Start(b))
                | (PoseSpec::Prior(a, _), PoseSpec::Prior(b, _)) => (a.inverse() * *b).log().norm() < 1e-14,
                _ => false,
            };
            for (a, b) in layout.cameras.iter().zip(&again.cameras).filter(|(a, _)| a.name != layout.world) {
                assert!(same(&a.pose, &b.pose), "{path:?} {}", a.name);
                assert_eq!((&a.intrinsics, &a.refine, &a.images), (&b.intrinsics, &b.refine, &b.images));
            }
            for (a, b) in layout.robots.iter().zip(&again.robots) {
                assert!(format!("{}.base", a.name) == layout.world || same(&a.pose, &b.pose), "{path:?} {}", a.name);
                assert_eq!(a.identify, b.identify);
                let apart = a.corrections.iter().zip(&b.corrections).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                assert!(apart < 1e-15 && a.corrections.len() == b.corrections.len());
            }
            for (a, b) in layout.targets.iter().zip(&again.targets).filter(|(a, _)| a.name != layout.world) {
                assert!(same(&a.pose, &b.pose), "{path:?} {}", a.name);
                assert_eq!(a.pattern, b.pattern);
            }
            assert_eq!(layout.solve.loss, again.solve.loss);
        }
    }
}

#[test]
fn outliers_are_as_many_as_asked_and_where_they_should_be() {
    let clean = run(&named("workcell.yaml"), 20, 1, 0.0);
    let spoilt = |section: &str| {
        let cell = with("workcell.yaml", &format!("{{configurations: 20, outliers: {section}}}"));
        simulate(&cell, clean.recording.motions.clone(), 1, 0.0).unwrap()
    };
    let pixel = |made: &Simulated| made.recording.corners.iter().map(|row| row.pixel).collect::<Vec<_>>();

    // A tenth of about 880 things in pictures: within five standard deviations.
    let dragged = spoilt("{dragged: 0.1}");
    let (before, after) = (pixel(&clean), pixel(&dragged));
    let off: Vec<f64> =
        before.iter().zip(&after).map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1])).filter(|d| *d > 0.0).collect();
    let things: BTreeSet<_> = clean
        .recording
        .corners
        .iter()
        .map(|row| {
            (
                row.camera,
                row.configuration,
                row.target,
                matches!(row.feature, Feature::TagCorner(..)).then(|| row.feature.clone()).map(|f| match f {
                    Feature::TagCorner(id, _) => id,
                    _ => 0,
                }),
            )
        })
        .collect();
    let expected = 0.1 * things.len() as f64;
    assert!((off.len() as f64 - expected).abs() < 5.0 * expected.sqrt(), "{} of {}", off.len(), things.len());
    assert!(off.iter().all(|d| (2.0..=12.0).contains(d)));
    assert!(dragged.spoilt[0].ends_with("corners dragged away"), "{:?}", dragged.spoilt);

    // A tag with another's id keeps its pixels; no corner is twice in a picture.
    let wrong = spoilt("{wrong_id: 0.1}");
    let sorted = |mut pixels: Vec<[f64; 2]>| {
        pixels.sort_by(|a, b| a.partial_cmp(b).unwrap());
        pixels
    };
    assert_eq!(sorted(pixel(&wrong)), sorted(pixel(&clean)));
    let keys: BTreeSet<_> = wrong
        .recording
        .corners
        .iter()
        .map(|row| (row.camera, row.configuration, row.shot, row.target, row.feature.clone()))
        .collect();
    assert_eq!(keys.len(), wrong.recording.corners.len());
    let clean_keys: BTreeSet<_> = clean
        .recording
        .corners
        .iter()
        .map(|row| (row.camera, row.configuration, row.shot, row.target, row.feature.clone()))
        .collect();
    assert!(keys.difference(&clean_keys).count() > 40, "{}", keys.difference(&clean_keys).count());

    // A flipped tag has the same four corners in another order.
    let flipped = spoilt("{flipped: 0.1}");
    assert_eq!(sorted(pixel(&flipped)), sorted(pixel(&clean)));
    assert_ne!(pixel(&flipped), pixel(&clean));

    // A shifted log: the measurements are the true ones, the log is late from the middle on.
    let shifted = spoilt("{shifted_log: ur5e}");
    assert_eq!(pixel(&shifted), pixel(&clean));
    let (RobotMotion::Joints(log), RobotMotion::Joints(real)) = (&shifted.logged[1], &shifted.recording.motions[1])
    else {
        panic!("joints")
    };
    for stop in 1..=20 {
        assert_eq!(log[&stop], real[&(if stop < 11 { stop } else { stop - 1 })], "{stop}");
    }
    assert_eq!(shifted.logged[0], clean.logged[0]);

    // A bumped target: seen elsewhere from the middle on, nothing else changes.
    let moved = spoilt("{moved: {frame: pallet, xyz: 5, rotation: 1}}");
    let pallet = moved.truth.targets.iter().position(|t| t.name == "pallet").unwrap();
    let differs = |stop: u64, target: usize| {
        let of = |made: &Simulated| {
            made.recording
                .corners
                .iter()
                .filter(|r| r.configuration == stop && r.target == target)
                .map(|r| r.pixel)
                .collect::<Vec<_>>()
        };
        of(&moved) != of(&clean)
    };
    assert!((1..11).all(|stop| !differs(stop, pallet)) && differs(12, pallet));
    assert!((1..=20).all(|stop| (0..moved.truth.targets.len()).all(|t| t == pallet || !differs(stop, t))));
}

#[test]
fn whole_poses_can_be_mirrored_and_pictures_missing() {
    let text = "cellmap: 1\nunits: {length: mm, angle: deg}\nworld: board\ncameras: {eye: {pose: {xyz: [300, 200, 1000], rpy: [170, 5, 0], unknown: true}}}\n\
        targets: {board: {}, other: {pose: {xyz: [100, 0, 0], rpy: [0, 10, 0], unknown: true}}}\nsimulate: {configurations: 200, shots: 2, missing: 0.25, outliers: {flipped: 0.2}}\n";
    let made = simulate(&cells::layout(text), Vec::new(), 1, 0.0).unwrap();
    let lost = made.missing.len() as f64;
    assert!((lost - 100.0).abs() < 45.0, "{lost}");
    assert_eq!(made.recording.poses.len(), 2 * (400 - made.missing.len()));
    let truth = cells::true_pose(&made.truth, "world_from_eye").inverse();
    let of_board = made.recording.poses.iter().filter(|row| row.target == 0);
    let flipped: Vec<_> = of_board.filter(|row| (truth.inverse() * row.pose).log().norm() > 1e-9).collect();
    assert!((flipped.len() as f64 - 60.0).abs() < 40.0, "{}", flipped.len());
    for row in flipped {
        // The same place, leaning as far to the other side of the line of sight.
        assert!((row.pose.translation - truth.translation).norm() < 1e-12);
        let lean = |pose: &cellmap::geometry::Pose| (pose.rotation * Vector3::z()).dot(&truth.translation.normalize());
        assert!((lean(&row.pose) - lean(&truth)).abs() < 1e-12);
    }
}

#[test]
fn a_shifted_log_repeats_the_stop_before() {
    let mut motion = RobotMotion::Joints((1..=5).map(|stop| (stop * 10, vec![stop as f64])).collect());
    faults::shift_log(&mut motion, 30);
    let RobotMotion::Joints(values) = motion else { panic!("joints") };
    assert_eq!(values.into_values().map(|v| v[0]).collect::<Vec<_>>(), [1.0, 2.0, 2.0, 3.0, 4.0]);
}

/// Links and lenses that differ from the description are found when asked for, and the recording repeats them exactly.
#[test]
fn errors_of_links_and_lenses_are_in_the_truth() {
    let cell = with(
        "one_robot.yaml",
        "{configurations: 30, link_errors: {joint_offsets: 0.1, lengths: 0.2}, lens_errors: {focal: 3, centre: 2, distortion: 0.01}}",
    );
    let made = run(&cell, 30, 2, 0.0);
    assert!(made.truth.robots[0].corrections.iter().any(|c| *c != 0.0));
    assert_ne!(made.truth.cameras[0].intrinsics, cell.cameras[0].intrinsics);
    assert_eq!(made.told.cameras[0].intrinsics, cell.cameras[0].intrinsics);
    assert!(made.told.robots[0].corrections.iter().all(|c| *c == 0.0));
    // From the truth's own links and lenses the exact corners are explained exactly.
    let mut told = made.told.clone();
    told.robots[0].corrections.clone_from(&made.truth.robots[0].corrections);
    told.cameras.iter_mut().zip(&made.truth.cameras).for_each(|(a, b)| a.intrinsics.clone_from(&b.intrinsics));
    let solved = cells::solve(told, &made.recording);
    assert!(solved.summary.rms_px().unwrap() < 1e-9);
    assert!(solve(&made).summary.rms_px().unwrap() > 0.1);
}

/// A board that is waved before the cameras, and one of the arms on a rail.
#[test]
fn waved_targets_and_rails_are_simulated() {
    let text = "cellmap: 1\nunits: {length: mm, angle: deg}\nworld: left\ncameras:\n  left: {intrinsics: {model: pinhole, size: [1280, 720], focal: [900, 900], \
        centre: [639.5, 359.5]}}\n  right: {intrinsics: {model: pinhole, size: [1280, 720], focal: [900, 900], centre: [639.5, 359.5]}, pose: {xyz: [300, 0, 0], \
        rpy: [0, -15, 0], unknown: true}}\ntargets:\n  wand: {checkerboard: {corners: [7, 4], square: 30}, moves: true}\nsimulate: {configurations: 30}\n";
    let made = simulate(&cells::layout(text), Vec::new(), 1, 1.0).unwrap();
    let both = (1..=30)
        .filter(|stop| {
            [0, 1].iter().all(|c| made.recording.corners.iter().any(|r| r.configuration == *stop && r.camera == *c))
        })
        .count();
    assert!(both > 5, "{both}");
    let solved = solve(&made);
    let off = (solved.world_from("right").unwrap().translation - Vector3::new(0.3, 0.0, 0.0)).norm();
    assert!(off < 2e-3, "{off}");
}
