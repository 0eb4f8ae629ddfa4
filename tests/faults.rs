//! What goes wrong in real cells is found and named, with numbers, and left out or refused; and is not seen where it is not.

#[path = "support/cells.rs"]
mod cells;
#[path = "support/one_robot.rs"]
mod one_robot;
#[path = "support/program.rs"]
mod program;

use std::collections::{BTreeMap, BTreeSet};

use cellmap::frames::FrameTree;
use cellmap::geometry::{Feature, Pose};
use cellmap::layout::PoseSpec;
use cellmap::recording::{CornerRow, Recording, RobotMotion};
use cellmap::trust::{Action, Fault, FaultKind};
use cellmap::workflow::solve::Solved;
use nalgebra::Vector3;
use one_robot::{told, truth};

const STOPS: u64 = 24;

fn path() -> Vec<RobotMotion> {
    one_robot::path(STOPS)
}

fn clean() -> Recording {
    one_robot::clean(STOPS)
}

/// Solves what was recorded with what was told.
fn solve(told: &str, recording: &Recording) -> Solved {
    let solved = cells::solve(cells::layout(told), recording);
    for fault in &solved.faults {
        println!(
            "{}: {} / {} / {} / {}",
            fault.kind.name(),
            fault.what,
            fault.evidence,
            fault.remedy,
            fault.action.name()
        );
        assert!(!fault.evidence.contains("NaN") && !fault.remedy.is_empty());
    }
    solved
}

/// The one fault of a kind.
fn the(solved: &Solved, kind: FaultKind) -> &Fault {
    let all: Vec<&Fault> = solved.faults.iter().filter(|fault| fault.kind == kind).collect();
    assert_eq!(all.len(), 1, "{kind:?} in {:#?} {:?}", solved.faults, solved.doubts());
    all[0]
}

fn contains(text: &str, parts: &[&str]) {
    for part in parts {
        assert!(text.contains(part), "no {part:?} in {text:?}");
    }
}

/// Every pose is where it is in truth, to this many mm.
fn right(solved: &Solved, mm: f64) {
    let truth = truth();
    for (index, edge) in solved.tree.static_edges.iter().enumerate().filter(|(_, edge)| edge.freedom.count() == 6) {
        let off = (cells::true_pose(&truth, &edge.key).inverse() * solved.state.static_poses[index]).magnitude().0;
        assert!(off * 1e3 < mm, "{} is off by {} mm: {:?}", edge.key, off * 1e3, solved.rejected);
    }
}

fn tag(row: &CornerRow) -> u32 {
    match row.feature {
        Feature::TagCorner(id, _) => id,
        _ => panic!("tags only"),
    }
}

fn things(rows: &mut [CornerRow]) -> Vec<Vec<&mut CornerRow>> {
    let mut all: BTreeMap<(usize, u64, usize, u32), Vec<&mut CornerRow>> = BTreeMap::new();
    for row in rows {
        all.entry((row.camera, row.configuration, row.target, tag(row))).or_default().push(row);
    }
    all.into_values().collect()
}

#[test]
fn a_clean_recording_has_no_faults() {
    let solved = solve(&told(), &clean());
    assert!(solved.trustworthy() && solved.faults.is_empty(), "{:#?}", solved.faults);
    assert!(solved.seconds.diagnose < 0.005, "a sound fit is not looked into");
}

#[test]
fn tags_read_with_a_wrong_id() {
    let mut recording = clean();
    let seen: BTreeSet<(usize, u64, u32)> = recording
        .corners
        .iter()
        .filter(|row| row.target == 1)
        .map(|row| (row.camera, row.configuration, tag(&row)))
        .collect();
    recording.corners.edit(|rows| {
        let cubes = things(rows).into_iter().filter(|thing| thing[0].target == 1);
        for thing in cubes.skip(2).step_by(9) {
            let row = &thing[0];
            // A face of the cube that is not in the picture.
            let hidden = (20..25).find(|id| !seen.contains(&(row.camera, row.configuration, *id))).unwrap();
            for row in thing {
                let Feature::TagCorner(_, corner) = row.feature else { continue };
                row.feature = Feature::TagCorner(hidden, corner);
            }
        }
    });
    let solved = solve(&told(), &recording);
    let fault = the(&solved, FaultKind::WrongId);
    assert_eq!(fault.action, Action::Excluded);
    contains(&fault.what, &["tags were read with a wrong id"]);
    contains(&fault.evidence, &["px from its own place", "what was read as tag"]);
    assert!(solved.trustworthy());
    right(&solved, 1.0);
}

#[test]
fn tags_whose_corners_begin_elsewhere() {
    let mut recording = clean();
    recording.corners.edit(|rows| {
        for thing in things(rows).into_iter().skip(3).step_by(40).filter(|thing| thing.len() == 4) {
            let pixels: Vec<[f64; 2]> = thing.iter().map(|row| row.pixel).collect();
            thing.into_iter().enumerate().for_each(|(i, row)| row.pixel = pixels[(i + 1) % 4]);
        }
    });
    let solved = solve(&told(), &recording);
    let fault = the(&solved, FaultKind::Flipped);
    assert_eq!(fault.action, Action::Excluded);
    contains(&fault.evidence, &["with its corners in another order"]);
    right(&solved, 1.0);
}

#[test]
fn dragged_corners_and_corners_that_are_merely_noisy() {
    let drag = |px: f64| {
        let mut recording = clean();
        recording.corners.edit(|rows| {
            for thing in things(rows).into_iter().step_by(30) {
                thing.into_iter().take(1).for_each(|row| row.pixel[0] += px);
            }
        });
        solve(&told(), &recording)
    };
    let solved = drag(6.0);
    let fault = the(&solved, FaultKind::DraggedCorner);
    contains(&fault.evidence, &["px"]);
    assert_eq!((fault.action, solved.faults.len()), (Action::Excluded, 1));
    right(&solved, 1.0);
    let solved = drag(0.12);
    assert!(solved.faults.is_empty(), "{:#?}", solved.faults);
}

#[test]
fn pictures_of_another_configuration() {
    let mut recording = clean();
    // Two stops at which both cameras on tripods see the cube: else a wrong line of the log would explain as much.
    let sees = |camera: usize, id: u64| {
        recording.corners.iter().any(|row| (row.camera, row.configuration, row.target) == (camera, id, 1))
    };
    let both: Vec<u64> = (1..=STOPS).filter(|id| sees(0, *id) && sees(1, *id)).collect();
    let (a, b) = (both[1], both[both.len() - 2]);
    recording.corners.edit(|rows| {
        for row in rows.iter_mut().filter(|row| row.camera == 0) {
            row.configuration = match row.configuration {
                id if id == a => b,
                id if id == b => a,
                other => other,
            };
        }
    });
    let solved = solve(&told(), &recording);
    let fault = the(&solved, FaultKind::WrongPicture);
    contains(
        &fault.what,
        &["2 pictures of `left`", &format!("that for {a} shows {b}"), &format!("that for {b} shows {a}")],
    );
    contains(&fault.evidence, &["px from where they were there"]);
    right(&solved, 1.0);
}

fn joints(recording: &mut Recording) -> &mut BTreeMap<u64, Vec<f64>> {
    match &mut recording.motions[0] {
        RobotMotion::Joints(values) => values,
        RobotMotion::Flange(_) => panic!("joints"),
    }
}

#[test]
fn two_lines_of_the_log_have_changed_places() {
    let mut recording = clean();
    let values = joints(&mut recording);
    let (a, b) = (values[&6].clone(), values[&11].clone());
    values.insert(6, b);
    values.insert(11, a);
    let solved = solve(&told(), &recording);
    let fault = the(&solved, FaultKind::SwappedLines);
    contains(&fault.what, &["`ur5e`", "at configurations 6 and 11 have changed places"]);
    contains(&fault.evidence, &["mm from its own line", "the other way round"]);
    assert_eq!(fault.action, Action::Excluded);
    right(&solved, 1.0);
}

#[test]
fn joint_values_that_do_not_fit_and_values_that_nearly_do() {
    let bend = |degrees: f64| {
        let mut recording = clean();
        joints(&mut recording).get_mut(&7).unwrap()[1] += degrees.to_radians();
        solve(&told(), &recording)
    };
    let solved = bend(3.0);
    let fault = the(&solved, FaultKind::WrongJointValues);
    contains(&fault.what, &["do not fit at 1 configuration: 7"]);
    contains(&fault.evidence, &["from where its joint values put it"]);
    right(&solved, 1.0);
    let solved = bend(0.002);
    assert!(solved.faults.is_empty(), "{:#?}", solved.faults);
}

/// The log from a configuration on says where the robot stood `lines` configurations earlier (later, if negative).
fn shifted(from: u64, lines: i64) -> Recording {
    let mut recording = clean();
    let right = joints(&mut recording).clone();
    for (id, values) in joints(&mut recording).iter_mut().filter(|(id, _)| **id >= from) {
        let other = (*id as i64 - lines).clamp(1, STOPS as i64) as u64;
        values.clone_from(&right[&other]);
    }
    recording
}

#[test]
fn a_log_that_is_late_from_the_middle_or_from_the_beginning() {
    for (from, lines, words) in [
        (13, 1, "is 1 line late from configuration 1"),
        (7, 1, "is 1 line late from configuration"),
        (1, 1, "is 1 line late from configuration"),
        (9, 2, "is 2 lines late from configuration"),
        (12, -1, "is 1 line early from configuration"),
    ] {
        let solved = solve(&told(), &shifted(from, lines));
        let fault = the(&solved, FaultKind::ShiftedLog);
        contains(&fault.what, &["the log of `ur5e`", words]);
        contains(&fault.evidence, &["the residual falls from", "of the turns"]);
        assert_eq!(fault.action, Action::Refused);
        assert!(!solved.trustworthy());
        let named: u64 = fault.what.split_whitespace().rev().nth(1).unwrap().parse().unwrap();
        assert!(named.abs_diff(from) <= 1, "{from}: {}", fault.what);
    }
}

/// A recording in which the robot stops at some configurations (nearly) where it stopped at `like`.
fn nearly_alike(stops: std::ops::RangeInclusive<u64>, like: u64) -> Recording {
    let mut motions = path();
    let RobotMotion::Joints(values) = &mut motions[0] else { panic!("joints") };
    let there = values[&like].clone();
    for id in stops {
        // Half a thousandth of a degree a stop: less than can be seen.
        let turned = there.iter().map(|q| q + (id as f64 * 0.0005_f64).to_radians() / STOPS as f64).collect();
        values.insert(id, turned);
    }
    cells::record(&truth(), motions, 0.05, 19)
}

#[test]
fn exchanges_of_what_is_alike_are_not_reported() {
    let sound = |recording: Recording| {
        let solved = solve(&told(), &recording);
        assert!(solved.faults.is_empty() && solved.trustworthy(), "{:#?}", solved.faults);
        right(&solved, 1.0);
    };
    // Two lines of the log.
    let mut recording = nearly_alike(11..=11, 6);
    let values = joints(&mut recording);
    let (a, b) = (values[&6].clone(), values[&11].clone());
    values.insert(6, b);
    values.insert(11, a);
    sound(recording);
    // Two pictures.
    let mut recording = nearly_alike(11..=11, 6);
    recording.corners.edit(|rows| {
        for row in rows.iter_mut().filter(|row| row.camera == 0) {
            row.configuration = [(6, 11), (11, 6)]
                .into_iter()
                .find(|(from, _)| *from == row.configuration)
                .map_or(row.configuration, |(_, to)| to);
        }
    });
    sound(recording);
    // A log that is late while the robot hardly moves.
    let mut recording = nearly_alike(18..=STOPS, 17);
    let values = joints(&mut recording);
    let right = values.clone();
    for id in 18..=STOPS {
        values.insert(id, right[&(id - 1)].clone());
    }
    sound(recording);
}

#[test]
fn tags_that_are_merely_noisy_have_neither_a_wrong_id_nor_another_order() {
    let mut recording = clean();
    recording.corners.edit(|rows| {
        for thing in things(rows).into_iter().skip(3).step_by(20) {
            for (i, row) in thing.into_iter().enumerate() {
                // Three standard deviations round the tag, as if it were turned a little.
                let turn = (i as f64 * std::f64::consts::FRAC_PI_2).sin_cos();
                row.pixel = [row.pixel[0] + 0.1 * turn.0, row.pixel[1] + 0.1 * turn.1];
            }
        }
    });
    let solved = solve(&told(), &recording);
    assert!(solved.faults.is_empty() && solved.trustworthy(), "{:#?}", solved.faults);
    right(&solved, 1.0);
}

/// From a configuration on, one thing stands elsewhere.
fn bumped(name: &str, from: u64, by: Pose) -> Recording {
    let mut moved = truth();
    let bump = |spec: &mut PoseSpec| {
        let pose = spec.truth().unwrap();
        *spec = PoseSpec::Fixed(pose * by);
    };
    for camera in moved.cameras.iter_mut().filter(|camera| camera.name == name) {
        bump(&mut camera.pose);
    }
    for target in moved.targets.iter_mut().filter(|target| target.name == name) {
        bump(&mut target.pose);
    }
    for robot in moved.robots.iter_mut().filter(|robot| robot.name == name) {
        bump(&mut robot.pose);
    }
    let mut recording = clean();
    let later = cells::record(&moved, path(), 0.05, 18);
    recording.corners.edit(|rows| {
        rows.retain(|row| row.configuration < from);
        rows.extend(later.corners.iter().filter(|row| row.configuration >= from));
    });
    recording
}

fn by(mm: [f64; 3], degrees: f64) -> Pose {
    let turn = Vector3::new(0.2, -0.5, 0.8).normalize() * degrees.to_radians();
    Pose::from_translation(mm[0] * 1e-3, mm[1] * 1e-3, mm[2] * 1e-3) * Pose::from_rotation_vector(&turn)
}

#[test]
fn things_that_moved_half_way_and_things_that_hardly_did() {
    for (name, frame, from) in [
        ("right", "right", 14),
        ("left", "left", 9),
        ("pallet", "pallet", 12),
        ("tool_cube", "tool_cube", 15),
        ("wrist", "wrist", 12),
    ] {
        let solved = solve(&told(), &bumped(name, from, by([8.0, -9.0, 4.0], 1.5)));
        let fault = the(&solved, FaultKind::Moved);
        let between = format!("between configurations {} and {from}", from - 1);
        contains(&fault.what, &[&format!("`{frame}` moved by "), &between]);
        let mm: f64 = fault.what.split("moved by ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
        assert!((mm - 12.69).abs() < 1.0, "{}", fault.what);
        contains(&fault.evidence, &["the residual falls from", "agrees with itself"]);
        contains(&fault.remedy, &["split the recording"]);
        assert_eq!(fault.action, Action::Refused);
        assert!(!solved.trustworthy());
    }
    let solved = solve(&told(), &bumped("right", 14, by([0.05, -0.05, 0.02], 0.0)));
    assert!(solved.faults.is_empty() && solved.trustworthy(), "{:#?}", solved.faults);
}

#[test]
fn a_robot_that_moved_half_way_never_passes_as_good() {
    let mut named = 0;
    for from in [8, 10, 12, 14, 16] {
        let solved = solve(&told(), &bumped("ur5e", from, by([8.0, -9.0, 4.0], 1.5)));
        assert!(!solved.trustworthy(), "{from}: {:#?}", solved.faults);
        let moved = solved.faults.iter().find(|fault| fault.kind == FaultKind::Moved);
        match moved {
            Some(fault) => {
                contains(
                    &fault.what,
                    &["`ur5e.base` moved by 12.", &format!("configurations {} and {from}", from - 1)],
                );
                named += 1;
            }
            // Where the camera on the wrist was led astray, that is said.
            None => contains(&solved.doubts().join(" "), &["corners that `wrist` saw do not fit the rest"]),
        }
    }
    assert!(named >= 3, "{named}");
}

#[test]
fn targets_of_another_size_and_nearly_of_the_same() {
    let told = told();
    for (from, to, printed, words) in [
        ("size: 120, ids: [40]", "size: 118, ids: [40]", 120.0, ["`pallet`", "1", "the layout says 118.00 mm"]),
        (
            "size: 120, ids: [40]",
            "size: 125, ids: [40]",
            120.0,
            ["`pallet`", " measure 1", "the layout says 125.00 mm"],
        ),
        ("edge: 80, size: 56", "edge: 80, size: 60", 56.0, ["`tool_cube`", " measure 5", "the layout says 60.00 mm"]),
        ("size: 90, gap: 20", "size: 88, gap: 22", 90.0, ["`table_board`", "measure", "the layout says 88.00 mm"]),
    ] {
        assert!(told.contains(from));
        let solved = solve(&told.replace(from, to), &clean());
        let fault = the(&solved, FaultKind::WrongSize);
        contains(&fault.what, &words);
        contains(&fault.evidence, &["%", "the residual falls from"]);
        let mm: f64 = fault.what.split(" mm where").next().unwrap().split(' ').next_back().unwrap().parse().unwrap();
        assert!((mm / printed - 1.0).abs() < 0.003, "{}", fault.what);
        assert_eq!(fault.action, Action::Refused);
        assert!(!solved.trustworthy());
    }
    let solved = solve(&told.replace("edge: 80, size: 56", "edge: 80, size: 56.01"), &clean());
    assert!(solved.faults.is_empty(), "{:#?}", solved.faults);
}

#[test]
fn two_cameras_whose_pictures_have_changed_places() {
    let exchange = |a: usize, b: usize| {
        let mut recording = clean();
        recording.corners.edit(|rows| {
            for row in rows {
                row.camera = if row.camera == a {
                    b
                } else if row.camera == b {
                    a
                } else {
                    row.camera
                };
            }
        });
        recording
    };
    for (a, b, words) in [(0, 1, "of `left` and `right`"), (0, 2, "of `left` and `wrist`")] {
        let solved = solve(&told(), &exchange(a, b));
        let fault = the(&solved, FaultKind::SwappedCameras);
        contains(&fault.what, &[words]);
        contains(&fault.remedy, &["exchange `images`"]);
        assert_eq!(fault.action, Action::Refused);
    }
    // Two cameras of one kind: exchanged, they are each other.
    let alike = told().replace(
        "focal: [1085, 1086], centre: [637.8, 361.5], distortion: [-0.09, 0.06, -0.0004, 0.0002, 0]",
        "focal: [1100, 1100], centre: [640.3, 358.9], distortion: [-0.08, 0.05, 0.0005, -0.0003, 0]",
    );
    let truth = cells::one_robot_truth().replace(
        "focal: [1085, 1086], centre: [637.8, 361.5], distortion: [-0.09, 0.06, -0.0004, 0.0002, 0]",
        "focal: [1100, 1100], centre: [640.3, 358.9], distortion: [-0.08, 0.05, 0.0005, -0.0003, 0]",
    );
    let mut recording = cells::record(&cells::layout(&truth), path(), 0.05, 17);
    recording.corners.edit(|rows| {
        rows.iter_mut().filter(|row| row.camera < 2).for_each(|row| row.camera = 1 - row.camera);
    });
    let solved = solve(&alike, &recording);
    assert!(solved.faults.is_empty() && solved.trustworthy(), "{:#?}", solved.faults);
}

#[test]
fn ids_in_another_order_than_printed() {
    // Turned by a quarter, three of the cube's faces are where they should be; the other two have changed places.
    let told = told().replace("ids: [20, 21, 22, 23, 24]", "ids: [23, 20, 24, 22, 21]");
    let solved = solve(&told, &clean());
    let fault = the(&solved, FaultKind::WrongId);
    contains(&fault.what, &["tags bear another id than the layout says", "always tag 21 of `tool_cube`"]);
    assert_eq!(fault.action, Action::Refused);
    assert!(!solved.trustworthy());
}

#[test]
fn a_target_of_which_nothing_fits() {
    // The pallet is said to hang on the flange.
    let told = told().replace("size: 120, ids: [40]}", "size: 120, ids: [40]}\n    mount: ur5e.flange");
    let solved = solve(&told, &clean());
    let fault = the(&solved, FaultKind::DoesNotFit);
    contains(&fault.what, &["nothing of `pallet` fits"]);
    contains(&fault.remedy, &["what it is mounted on"]);
    assert_eq!(fault.action, Action::Refused);
    assert!(!solved.trustworthy());
}

#[test]
fn measured_poses_that_lean_to_the_wrong_side() {
    let truth = truth();
    let tree = FrameTree::new(&truth);
    assert_eq!(tree.targets.len(), 3);
    let text = "cellmap: 1\nunits: {length: mm, angle: deg}\nworld: board\ncameras: {eye: {pose: {xyz: [0, 0, 800], rpy: [180, 0, 0], unknown: true}}}\n\
        targets: {board: {}, other: {pose: {xyz: [100, 0, 0], rpy: [0, 25, 0], unknown: true}}}\nsimulate: {configurations: 80, outliers: {flipped: 0.1}}\n";
    let made = cellmap::simulate::simulate(&cells::layout(text), Vec::new(), 1, 1.0).unwrap();
    let told = "cellmap: 1\nunits: {length: mm, angle: deg}\nworld: board\ncameras: {eye: {}}\ntargets: {board: {}, other: {}}\n";
    let solved = solve(told, &made.recording.clone());
    let fault = the(&solved, FaultKind::Flipped);
    contains(&fault.what, &["lean to the wrong side"]);
    contains(&fault.evidence, &["deg off as seen by `eye`"]);
}

/// A camera before a board of 5x5 tags, and a second target behind its back; detected with another dictionary in the layout.
fn detected_as(dictionary: &str) -> (Option<i32>, serde_json::Value) {
    let text = "cellmap: 1\nunits: {length: mm, angle: deg}\nworld: eye\ncameras:\n  eye:\n    images: images/{configuration}.png\n    \
                intrinsics: {model: pinhole, size: [640, 480], focal: [700, 700], centre: [319.5, 239.5]}\n\
                targets:\n  board: {tags: {dictionary: 5x5_100, grid: {columns: 3, rows: 2, size: 60, gap: 15}}, moves: true, pose: {xyz: [0, 0, 500], rpy: [180, 10, 0]}}\n  \
                hidden: {tags: {dictionary: 7x7_50, size: 60, ids: [3]}, pose: {xyz: [0, 0, -500], rpy: [0, 0, 0]}}\n\
                simulate: {configurations: 3, picture: {clutter: false}}\n";
    let dir = program::folder(&[("truth.yaml", &text.replace("moves: true, ", ""))]);
    let made = program::run(dir.path(), &["simulate", "truth.yaml", "--out", "cell", "--pictures"]);
    assert!(made.status.success(), "{}", program::stderr(&made));
    let told = std::fs::read_to_string(dir.path().join("cell/layout.yaml")).unwrap();
    assert!(told.contains("5x5_100"), "{told}");
    std::fs::write(dir.path().join("cell/layout.yaml"), told.replace("5x5_100", dictionary)).unwrap();
    let output = program::run(dir.path(), &["detect", "cell/layout.yaml", "--json"]);
    (output.status.code(), program::json(&output))
}

#[test]
fn another_dictionary_than_the_printed_one() {
    let (code, found) = detected_as("6x6_250");
    assert_eq!(code, Some(1), "{found}");
    let fault = &found["faults"][0];
    assert_eq!(fault["kind"], "wrong_dictionary");
    contains(fault["what"].as_str().unwrap(), &["`board`", "the dictionary 5x5_50"]);
    contains(fault["evidence"].as_str().unwrap(), &["in 3 of 3 pictures", "ids 0, 1, 2, 3, 4, 5"]);
    // The hidden target is missing too, but no other dictionary's tags are there in its place.
    let (code, found) = detected_as("5x5_100");
    assert_eq!(code, Some(0), "{found}");
    assert_eq!(found["faults"].as_array().unwrap().len(), 0);
}
