//! Directions that theory predicts to be open are recognised by name, and not named where they are not open.

#[path = "support/cells.rs"]
mod cells;

use cellmap::geometry::{Feature, Pose};
use cellmap::layout::Layout;
use cellmap::recording::{CornerRow, Recording, RobotMotion};
use cellmap::trust::{Cause, Undetermined};
use cellmap::workflow::solve::Solved;
use nalgebra::Vector3;

const MIDDLE: [f64; 6] = [-1.9, -1.75, 1.9, -1.7, -1.55, 0.4];

/// The cell with one robot, without the camera on its wrist, which a robot that hardly moves does not turn to anything.
fn truth_text() -> String {
    let text = cells::one_robot_truth();
    let wrist = &text[text.find("  wrist:").unwrap()..text.find("robots:").unwrap()];
    text.replace(wrist, "")
}

/// The cell with one robot, told what `edits` say, solved at the given stops.
fn solve_at(stops: Vec<Vec<f64>>, edits: &[(&str, &str)]) -> Solved {
    let truth = cells::layout(&truth_text());
    let joints = stops.into_iter().zip(1u64..).map(|(q, i)| (i, q)).collect();
    let recording = cells::record(&truth, vec![RobotMotion::Joints(joints)], 0.05, 3);
    let told = edits.iter().fold(cells::hidden(&truth_text()), |text, (from, to)| {
        assert!(text.contains(from), "no {from:?} in {text}");
        text.replace(from, to)
    });
    cells::solve(cells::layout(&told), &recording)
}

fn wander(stray: f64, stops: u64) -> Vec<Vec<f64>> {
    cells::wander(&MIDDLE, stray, stops, 5).into_values().collect()
}

fn causes(all: &[Undetermined]) -> Vec<Cause> {
    all.iter().map(|u| u.cause).collect()
}

/// Every number of a solution that is not open is finite, and no sentence holds a NaN.
fn sane(solved: &Solved) {
    assert!(solved.state.is_finite());
    assert!(solved.covariance.matrix.iter().all(|x| x.is_finite()));
    for u in solved.undetermined.iter().chain(&solved.weak) {
        assert!(!u.reason.contains("NaN") && !u.remedy.is_empty() && u.sigma.is_none_or(f64::is_finite), "{u:?}");
    }
}

#[test]
fn turns_about_one_axis_and_a_little_about_another() {
    let turning = |second: f64| {
        let stop = |i: u32| {
            let mut q = MIDDLE.to_vec();
            q[0] += 0.08 * f64::from(i) - 0.4;
            q[4] += second * f64::from(i % 3);
            q
        };
        solve_at((0..10).map(stop).collect(), &[])
    };
    let solved = turning(0.0);
    sane(&solved);
    assert!(!solved.trustworthy());
    assert!(causes(&solved.undetermined).contains(&Cause::SingleAxis), "{:#?}", solved.undetermined);
    let solved = turning(0.15);
    assert!(solved.undetermined.is_empty(), "{:#?}", solved.undetermined);
}

#[test]
fn an_orientation_that_stays_and_one_that_sways() {
    let swaying = |sway: f64| {
        let stop = |i: u32| {
            let mut q = MIDDLE.to_vec();
            let (a, b) = (0.25 * f64::from(i).sin(), 0.2 * (2.0 * f64::from(i)).cos());
            q[1] += a;
            q[2] += b;
            q[3] -= a + b;
            q[4] += sway * f64::from(i % 3);
            q[5] += sway * f64::from(i % 4);
            q
        };
        solve_at((0..10).map(stop).collect(), &[])
    };
    let solved = swaying(0.0);
    sane(&solved);
    assert!(causes(&solved.undetermined).contains(&Cause::ConstantOrientation), "{:#?}", solved.undetermined);
    let solved = swaying(0.15);
    assert!(solved.undetermined.is_empty(), "{:#?}", solved.undetermined);
}

#[test]
fn links_against_base_tool_and_each_other() {
    let free = ("joints: joints.csv", "joints: joints.csv\n    identify: {joint_offsets: {}, lengths: {}}");
    let solved = solve_at(wander(0.5, 25), &[free]);
    sane(&solved);
    let found = causes(&solved.undetermined);
    let of = |cause: Cause| found.iter().filter(|known| **known == cause).count();
    // Offset, d and a of the first joint; offset and d of the last, of which `d` has been told already or the other way round; joints 2, 3, 4.
    assert_eq!(of(Cause::BaseAgainstFirstJoint), 3, "{:#?}", solved.undetermined);
    assert_eq!(of(Cause::ToolAgainstLastJoint), 2, "{:#?}", solved.undetermined);
    assert_eq!(of(Cause::ParallelAxes), 2, "{:#?}", solved.undetermined);
    assert_eq!(of(Cause::Other), 0, "{:#?}", solved.undetermined);
    let base = solved.undetermined.iter().find(|u| u.reason.contains("joint 1 length d")).unwrap();
    assert!(base.reason.contains("`world_from_ur5e.base` (z)"), "{}", base.reason);
    assert!(base.remedy.contains("tracker") && base.remedy.contains("prior"), "{}", base.remedy);
    let parallel = solved.undetermined.iter().find(|u| u.cause == Cause::ParallelAxes).unwrap();
    assert!(parallel.reason.contains("turn about parallel axes"), "{}", parallel.reason);
    // With beliefs about the links, nothing is open.
    let believed = (
        "joints: joints.csv",
        "joints: joints.csv\n    identify: {joint_offsets: {sigma: 0.05}, lengths: {sigma: 0.2}}",
    );
    let solved = solve_at(wander(0.5, 25), &[believed]);
    assert!(solved.undetermined.is_empty() && solved.weak.is_empty(), "{:#?} {:#?}", solved.undetermined, solved.weak);
    // With wide beliefs it is known as well as believed: weak, and named the same.
    let wide = (
        "joints: joints.csv",
        "joints: joints.csv\n    identify: {joint_offsets: {sigma: 0.05}, lengths: {sigma: 20}}",
    );
    let solved = solve_at(wander(0.5, 25), &[wide]);
    sane(&solved);
    assert!(solved.undetermined.is_empty() && solved.trustworthy(), "{:#?}", solved.undetermined);
    let weak = causes(&solved.weak);
    assert!(weak.contains(&Cause::BaseAgainstFirstJoint) || weak.contains(&Cause::ParallelAxes), "{:#?}", solved.weak);
}

/// Two cameras and points of unknown places: the second camera's pose is only a start, or given.
fn points_seen_by_two(second: &str) -> Solved {
    let text = format!(
        "cellmap: 1\nunits: {{length: m, angle: rad}}\nworld: a\ncameras:\n  a:\n    intrinsics: {{model: pinhole, size: [1280, 720], focal: [1000, 1000], centre: [640, 360]}}\n  \
         b:\n    intrinsics: {{model: pinhole, size: [1280, 720], focal: [1000, 1000], centre: [640, 360]}}\n    pose: {{xyz: [0.5, 0, 0], rpy: [0, -0.3, 0]{second}}}\n\
         targets:\n  cloud: {{points: {{{}}}, pose: {{xyz: [0, 0, 0], rpy: [0, 0, 0]}}}}\n",
        (0..12).map(|i| format!("p{i}: unknown")).collect::<Vec<_>>().join(", ")
    );
    let layout: Layout = cells::layout(&text);
    let b = Pose::from_translation(0.5, 0.0, 0.0) * Pose::from_rotation_vector(&Vector3::new(0.0, -0.3, 0.0));
    let mut rows = Vec::new();
    for i in 0..12u32 {
        let t = f64::from(i);
        let place = Vector3::new(0.4 * (1.7 * t).sin(), 0.3 * (2.3 * t).cos(), 1.5 + 0.3 * (0.9 * t).sin());
        for (camera, pose) in [(0, Pose::identity()), (1, b)] {
            let pixel = layout.cameras[camera].intrinsics.as_ref().unwrap().project(&(pose.inverse() * place)).unwrap();
            let feature = Feature::Point(format!("p{i}"));
            let (u, v) = (pixel.x + 0.05 * (5.1 * t).sin(), pixel.y + 0.05 * (7.3 * t).cos());
            rows.push(CornerRow {
                configuration: 1,
                shot: 0,
                camera,
                target: 0,
                feature,
                pixel: [u, v],
                covariance: None,
            });
        }
    }
    cells::solve(layout, &Recording { corners: rows.into(), ..Recording::default() })
}

#[test]
fn nothing_of_known_length_and_one_distance_known() {
    let solved = points_seen_by_two(", start: true");
    sane(&solved);
    assert_eq!(causes(&solved.undetermined), [Cause::NoScale], "{:#?}", solved.undetermined);
    assert!(solved.undetermined[0].remedy.contains("known size"));
    let solved = points_seen_by_two("");
    assert!(solved.undetermined.is_empty(), "{:#?}", solved.undetermined);
}

/// A flat board held by hand before a camera whose focal length is sought.
fn board_before_a_camera(tilt: f64) -> Solved {
    let text = "cellmap: 1\nunits: {length: mm, angle: deg}\nworld: cam\ncameras:\n  cam:\n    \
                intrinsics: {model: pinhole, size: [1280, 720], focal: [1000, 1000], centre: [640, 360]}\n    refine: [focal]\n\
                targets:\n  board: {checkerboard: {corners: [7, 4], square: 30}, moves: true}\n";
    let layout: Layout = cells::layout(text);
    let intrinsics = layout.cameras[0].intrinsics.as_ref().unwrap();
    let mut rows = Vec::new();
    for i in 0..15u64 {
        let t = i as f64;
        let turn = Vector3::new(tilt * (1.3 * t).sin(), tilt * (2.1 * t).cos(), 0.1 * t.sin());
        let pose = Pose::from_translation(-0.09 + 0.05 * t.sin(), -0.05 + 0.04 * (0.7 * t).cos(), 0.6 + 0.01 * t)
            * Pose::from_rotation_vector(&turn);
        for corner in 0..28u32 {
            let place = Vector3::new(0.03 * f64::from(corner % 7), 0.03 * f64::from(corner / 7), 0.0);
            let pixel = intrinsics.project(&(pose * place)).unwrap();
            let wobble = f64::from(corner) * 3.7 + t * 1.9;
            rows.push(CornerRow {
                configuration: i,
                shot: 0,
                camera: 0,
                target: 0,
                feature: Feature::BoardCorner(corner),
                pixel: [pixel.x + 0.05 * wobble.sin(), pixel.y + 0.05 * (1.7 * wobble).cos()],
                covariance: None,
            });
        }
    }
    cells::solve(layout, &Recording { corners: rows.into(), ..Recording::default() })
}

#[test]
fn a_lens_from_flat_boards_face_on_and_tilted() {
    let solved = board_before_a_camera(0.0);
    sane(&solved);
    let all: Vec<Cause> = causes(&solved.undetermined).into_iter().chain(causes(&solved.weak)).collect();
    assert!(all.contains(&Cause::FlatFaceOn), "{:#?} {:#?}", solved.undetermined, solved.weak);
    let solved = board_before_a_camera(0.5);
    assert!(solved.undetermined.is_empty() && solved.weak.is_empty(), "{:#?} {:#?}", solved.undetermined, solved.weak);
}
