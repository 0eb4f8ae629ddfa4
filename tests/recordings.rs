//! Real recordings that others made, through the real binary: the published tables, and cells solved without a guess.

#[path = "support/program.rs"]
mod program;

use std::path::Path;

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use program::{json, recordings, run};
use serde_json::Value;

/// Solves a layout of a recording; results go to a folder of their own. Returns (exit code, what `--json` says).
fn solve(data: &Path, layout: &str, detections: Option<&Path>) -> (Option<i32>, Value) {
    let dir = tempfile::tempdir().unwrap();
    let layout = data.join(layout);
    let mut arguments = vec!["solve", layout.to_str().unwrap(), "--json", "--out", "solution.yaml"];
    if let Some(path) = detections {
        arguments.extend(["--detections", path.to_str().unwrap()]);
    }
    let output = run(dir.path(), &arguments);
    (output.status.code(), json(&output))
}

/// Detects, then solves with what was found.
fn detect_and_solve(data: &Path, layout: &str) -> (Value, Value) {
    let dir = tempfile::tempdir().unwrap();
    let path = data.join(layout);
    let output = run(dir.path(), &["detect", path.to_str().unwrap(), "--json", "--out", "corners.csv"]);
    assert_eq!(output.status.code(), Some(0), "{}", program::stderr(&output));
    let (code, solved) = solve(data, layout, Some(&dir.path().join("corners.csv")));
    assert!(code == Some(0), "{solved}");
    (json(&output), solved)
}

fn number(value: &Value, key: &str) -> f64 {
    value[key].as_f64().unwrap_or_else(|| panic!("no number {key} in {value}"))
}

/// (metres, rotation) of a pose in `--json`.
fn pose(solved: &Value, key: &str) -> (Vector3<f64>, UnitQuaternion<f64>) {
    let list = |name: &str| {
        let items = solved["poses"][key][name].as_array().unwrap_or_else(|| panic!("no {key}"));
        Vector3::from_iterator(items.iter().map(|x| x.as_f64().unwrap()))
    };
    (list("xyz_mm") * 1e-3, UnitQuaternion::new(list("rotvec_deg").map(f64::to_radians)))
}

/// The published tables: within one unit of the last printed digit. The paper's Table 1 prints 83.35 mm for link 5; only 85.35, which
/// the recordings' model has, gives these numbers.
#[test]
fn the_papers_tables() {
    let Some(data) = recordings() else { return };
    let names = [
        "x0_mm", "y0_mm", "z0_mm", "r11", "r21", "r31", "r12", "r22", "r32", "r13", "r23", "r33", "xe_mm", "ye_mm",
        "ze_mm",
    ];
    #[rustfmt::skip]
    let tables: [(&str, Option<&str>, usize, [f64; 15]); 6] = [
        ("sim_b", None, 251, [433.59, 556.01, -458.41, 1.006, -0.006, 0.001, 0.003, 1.004, -0.0, -0.006, -0.001, 1.0, 0.14, 0.23, 64.78]),
        ("exp_a", Some("cam1"), 2500, [432.53, 551.15, -451.33, 1.006, -0.018, -0.004, 0.02, 1.008, 0.0, 0.01, 0.012, 0.99, 0.18, 0.52, 64.09]),
        ("exp_a", Some("cam2"), 2500, [430.81, 561.06, -449.27, 1.024, -0.039, -0.013, 0.014, 1.019, -0.009, 0.01, -0.009, 0.969, 0.49, 0.73, 61.0]),
        ("exp_a", Some("cam3"), 2500, [426.91, 555.45, -456.496, 1.013, -0.015, 0.008, 0.007, 1.004, 0.01, 0.001, -0.006, 1.011, 0.05, 0.68, 66.03]),
        ("exp_a", None, 7500, [430.05, 555.96, -452.39, 1.014, -0.024, -0.003, 0.013, 1.011, 0.0, 0.007, -0.001, 0.991, 0.24, 0.65, 63.73]),
        ("exp_b", None, 1250, [613.88, 30.94, -25.12, 0.506, -0.873, 0.012, 0.872, 0.515, 0.02, -0.016, -0.013, 1.043, -0.05, 0.69, 67.59]),
    ];
    let rms = [0.6391, 2.6406, 4.0935, 3.6738, 9.3730, 4.5040];
    for ((set, sensor, measurements, published), rms) in tables.into_iter().zip(rms) {
        let layout = data.join("vsb").join(set).join("layout_points.yaml");
        let mut arguments = vec!["identify", layout.to_str().unwrap(), "--json"];
        arguments.extend(sensor.iter().flat_map(|name| ["--sensor", name]));
        let output = run(Path::new("."), &arguments);
        let found = json(&output);
        assert_eq!(found["measurements"], measurements);
        assert_eq!(found["converged"], true);
        for (name, expected) in names.iter().zip(published) {
            // Millimetres are printed with two decimals, one of them with three; matrix entries with three.
            let unit = if name.ends_with("mm") && expected != -456.496 { 0.01 } else { 0.001 };
            let value = number(&found["parameters"], name);
            assert!((value - expected).abs() <= unit + 1e-9, "{set} {sensor:?} {name}: {value}, published {expected}");
        }
        assert!((number(&found, "rms_mm") - rms).abs() < 1e-3, "{set} {sensor:?}");
    }
}

#[test]
fn the_same_with_a_true_rotation() {
    let Some(data) = recordings() else { return };
    let layout = data.join("vsb/exp_b/layout_points.yaml");
    let found = json(&run(Path::new("."), &["identify", layout.to_str().unwrap(), "--json"]));
    let rigid = &found["rigid"];
    for (name, expected) in [("x0_mm", 615.859), ("y0_mm", 23.012), ("z0_mm", -8.219), ("ze_mm", 72.516)] {
        assert!((number(&rigid["parameters"], name) - expected).abs() < 0.002, "{name}: {rigid}");
    }
    assert!((number(rigid, "rms_mm") - 4.896).abs() < 0.001);
}

/// Three cameras, 7500 pictures, everything unknown but the base board.
#[test]
fn the_papers_whole_cell() {
    let Some(data) = recordings() else { return };
    let (code, solved) = solve(&data, "vsb/exp_a/layout_poses.yaml", None);
    assert_eq!(code, Some(0), "{solved}");
    let (base, _) = pose(&solved, "world_from_ur3.base");
    // The reference took every fifth configuration and another loss.
    assert!((base * 1e3 - Vector3::new(435.41, 551.96, -463.28)).norm() < 0.5, "{base}");
    let (tool, _) = pose(&solved, "ur3.flange_from_tool_board");
    assert!((tool * 1e3 - Vector3::new(-2.44, 1.32, 69.43)).norm() < 0.6, "{tool}");
    for (camera, expected) in [
        ("cam1", [747.175, 301.944, 1003.26]),
        ("cam2", [106.83, 1275.33, 744.215]),
        ("cam3", [-376.771, -325.341, 893.114]),
    ] {
        let (at, _) = pose(&solved, &format!("world_from_{camera}"));
        assert!((at * 1e3 - Vector3::from(expected)).norm() < 1.0, "{camera} {at}");
    }
}

#[test]
fn four_cameras_around_a_panda_from_their_pictures() {
    let Some(data) = recordings() else { return };
    let (detected, solved) = detect_and_solve(&data, "metric/layout.yaml");
    assert_eq!(detected["pictures"], 240);
    assert!(number(&detected, "pictures_with_detections") >= 105.0, "{detected}");
    assert!(number(&solved, "rms_px") < 0.05, "{}", solved["rms_px"]);
    #[rustfmt::skip]
    let truth = [
        ("world_from_camera1", [-0.7068252, -0.33913997, 0.62079161, -1.1876168, -0.70738828, 0.33886996, -0.62029743, 1.897282, 0.0, -0.87758255, -0.47942552, 1.151495]),
        ("world_from_camera2", [-0.59847212, 0.31198001, -0.73790216, 1.7660546, 0.80114365, 0.2330561, -0.55122936, 2.0611763, 0.0, -0.92106104, -0.38941833, 1.1553298]),
        ("world_from_camera3", [0.70795101, 0.27503127, -0.65051007, 1.8986243, 0.70626163, -0.27568907, 0.65206599, -1.9082119, 0.0, -0.92106104, -0.38941836, 1.1553298]),
        ("world_from_camera4", [0.75128049, -0.31641278, 0.57918966, -1.0450802, -0.65998316, -0.36018303, 0.65931064, -2.0309489, 0.0, -0.87758261, -0.47942555, 1.151495]),
    ];
    for (key, m) in truth {
        let rotation = Matrix3::new(m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]);
        let expected = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
        let (at, turn) = pose(&solved, key);
        let (mm, deg) = ((at - Vector3::new(m[3], m[7], m[11])).norm() * 1e3, turn.angle_to(&expected).to_degrees());
        println!("{key}: {mm:.3} mm, {deg:.4} deg");
        assert!(mm < 1.2 && deg < 0.08, "{key}: {mm} mm, {deg} deg");
    }
}

#[test]
fn one_tag_on_a_ur5e() {
    let Some(data) = recordings() else { return };
    for (layout, limit) in [("layout_detections", 0.4421), ("layout_flange_detections", 0.5153)] {
        let (code, solved) = solve(&data, &format!("ur5_nirshal/{layout}.yaml"), None);
        assert_eq!(code, Some(0));
        assert!(number(&solved, "rms_px") <= limit, "{layout}: {}", solved["rms_px"]);
        assert_eq!(solved["rejected"], 0);
    }
    // From the pictures: better corners than the published ones.
    for (layout, limit) in [("layout", 0.442), ("layout_flange", 0.515)] {
        let (detected, solved) = detect_and_solve(&data, &format!("ur5_nirshal/{layout}.yaml"));
        assert_eq!(detected["corners"], 80);
        assert!(number(&solved, "rms_px") <= limit, "{layout}: {}", solved["rms_px"]);
    }
}

#[test]
fn a_charuco_board_on_an_abb() {
    let Some(data) = recordings() else { return };
    for (layout, limit) in [("layout", 1.88), ("layout_refine", 0.7805)] {
        let (code, solved) = solve(&data, &format!("charuco_abb/{layout}.yaml"), None);
        assert_eq!(code, Some(0));
        assert!(number(&solved, "rms_px") <= limit, "{layout}: {}", solved["rms_px"]);
    }
    let (detected, solved) = detect_and_solve(&data, "charuco_abb/layout_detect.yaml");
    assert!(number(&detected, "corners") >= 294.0);
    assert!(number(&solved, "rms_px") <= 1.88, "{}", solved["rms_px"]);
}

#[test]
fn a_camera_on_a_kukas_wrist() {
    let Some(data) = recordings() else { return };
    let (code, solved) = solve(&data, "kuka_2/layout.yaml", None);
    assert_eq!(code, Some(0));
    assert!(number(&solved, "rms_px") <= 0.795, "{}", solved["rms_px"]);
    let (at, _) = pose(&solved, "kuka.flange_from_wrist");
    assert!((at - Vector3::new(0.01416464, -0.108055, -0.08236905)).norm() < 2e-4, "{at}");
    let (detected, solved) = detect_and_solve(&data, "kuka_2/layout_detect.yaml");
    assert_eq!(detected["corners"], 11424);
    assert!(number(&solved, "rms_px") <= 0.795, "{}", solved["rms_px"]);
}

#[test]
fn fifty_pose_pairs() {
    let Some(data) = recordings() else { return };
    let (code, solved) = solve(&data, "moveit/layout.yaml", None);
    assert_eq!(code, Some(0));
    assert!(number(&solved, "rms_pose_mm") <= 4.565 && number(&solved, "rms_pose_deg") <= 0.105, "{solved}");
    let (at, _) = pose(&solved, "world_from_camera");
    for (found, published) in at.iter().zip([0.659, -0.249, 0.830]) {
        assert!((found - published).abs() < 0.01 * f64::abs(published), "{at}");
    }
}

/// A laser tracker, a robot, link parameters, and a degenerate set.
#[test]
fn points_by_trackers() {
    let Some(data) = recordings() else { return };
    let (_, solved) = solve(&data, "abb_irb120/layout.yaml", None);
    assert!((number(&solved, "rms_point_mm") - 5.330).abs() < 0.002);
    let (code, solved) = solve(&data, "abb_irb120/layout_links.yaml", None);
    assert!(number(&solved, "rms_point_mm") < 0.3, "{solved}");
    assert_eq!(code, Some(0));
    let offset = number(&solved["parameters"]["irb120 links"]["joint2_offset_deg"], "value");
    assert!((offset + 1.36).abs() < 0.1, "{offset}");
    let (_, solved) = solve(&data, "motoman/leica/layout.yaml", None);
    assert!((number(&solved, "rms_point_mm") - 0.724).abs() < 0.002);
    let (code, solved) = solve(&data, "motoman/leica_left_6x6x6/layout.yaml", None);
    assert_eq!(code, Some(1));
    assert_eq!(solved["undetermined"].as_array().unwrap().len(), 3);
    for open in solved["undetermined"].as_array().unwrap() {
        assert_eq!(open["kind"], "constant_orientation");
    }
    let reason = solved["undetermined"][0]["reason"].as_str().unwrap();
    assert!(reason.contains("the orientation of `left.flange` stays constant"), "{reason}");
    assert!((number(&solved, "rms_point_mm") - 0.233).abs() < 0.002);
}

#[test]
fn two_arms_and_two_cameras() {
    let Some(data) = recordings() else { return };
    let (_, solved) = solve(&data, "motoman/markers/layout.yaml", None);
    assert_eq!(solved["converged"], true);
    assert!(number(&solved, "rms_px") < 13.7, "{}", solved["rms_px"]);
    let (eye, _) = pose(&solved, "torso.flange_from_right_eye");
    assert!((eye - Vector3::new(-0.28662439, -0.189315264, 2.52354987)).norm() < 0.03, "{eye}");
}

#[test]
fn every_layout_of_the_recordings_is_understood() {
    let Some(data) = recordings() else { return };
    let mut count = 0;
    let mut queue = vec![data];
    while let Some(folder) = queue.pop() {
        for entry in std::fs::read_dir(folder).unwrap().flatten() {
            let path = entry.path();
            if path.is_dir() {
                queue.push(path);
            } else if path.file_name().unwrap().to_str().unwrap().starts_with("layout") {
                let output = run(Path::new("."), &["check", path.to_str().unwrap()]);
                assert_eq!(output.status.code(), Some(0), "{}: {}", path.display(), program::stderr(&output));
                count += 1;
            }
        }
    }
    assert!(count >= 20, "{count}");
}
