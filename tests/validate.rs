//! Validation: what was left out judges, and an answer that fits its own measurements too well is told apart.

#[path = "support/cells.rs"]
mod cells;
#[path = "support/program.rs"]
mod program;

use std::fmt::Write;
use std::path::Path;

use cellmap::recording::{RobotMotion, write_detections};
use program::{folder, json, run, stderr, stdout};

/// Writes a recording of the cell with one robot; `spoil` is what the solver's layout says otherwise.
fn record(dir: &Path, truth: &str, told: &str, stops: u64) {
    let layout = cells::layout(truth);
    let motions = cells::one_robot_path(stops);
    let mut recording = cells::record(&layout, motions.clone(), 0.05, 3);
    // Something to set aside; the last row among it.
    recording.corners.edit(|rows| rows.iter_mut().rev().step_by(301).for_each(|row| row.pixel[0] += 15.0));
    std::fs::write(dir.join("layout.yaml"), told).unwrap();
    write_detections(&dir.join("detections.csv"), &layout, &recording.corners).unwrap();
    let mut text = "configuration,robot,q1,q2,q3,q4,q5,q6\n".to_owned();
    let RobotMotion::Joints(values) = &motions[0] else { panic!("joints") };
    for (configuration, q) in values {
        let cells: Vec<String> = q.iter().map(|q| format!("{:.12}", q.to_degrees())).collect();
        writeln!(text, "{configuration},ur5e,{}", cells.join(",")).unwrap();
    }
    std::fs::write(dir.join("joints.csv"), text).unwrap();
}

#[test]
fn a_good_cell_is_predicted_as_well_as_it_is_fitted() {
    let dir = folder(&[]);
    record(dir.path(), &cells::one_robot_truth(), &cells::hidden(include_str!("../layouts/one_robot.yaml")), 24);
    let output = run(dir.path(), &["validate", "layout.yaml", "--folds", "4", "--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let found = json(&output);
    let (fitted, held) = (found["fitted"]["rms_px"].as_f64().unwrap(), found["held_out"]["rms_px"].as_f64().unwrap());
    assert!((0.045..0.055).contains(&fitted) && held > fitted * 0.97 && held < fitted * 1.15, "{fitted} {held}");
    assert!(found["rejected"].as_u64().unwrap() >= 3);
    assert_eq!(found["held_out"]["folds"].as_array().unwrap().len(), 4);
    assert!(found["held_out_nominal_links"].is_null());
    for camera in ["left", "right", "wrist"] {
        let camera = &found["without_camera"][camera];
        let (rms, with) = (camera["rms_mm"].as_f64().unwrap(), camera["fitted_rms_mm"].as_f64().unwrap());
        assert!(camera["positions"].as_u64().unwrap() > 8, "{camera}");
        assert!(rms >= 0.9 * with && rms < 1.5 * with, "{camera}");
        assert!(camera["largest_mm"].as_f64().unwrap() >= rms);
    }
    let base = &found["halves"]["world_from_ur5e.base"];
    assert!(base["translation_mm"].as_f64().unwrap() < 1.0 && base["within_sigma"].as_f64().unwrap() < 5.0, "{base}");
    // The published method takes the tool's place from single pictures.
    let published = &found["published"];
    let (theirs, ours) = (published["published_rms_mm"].as_f64().unwrap(), published["joint_rms_mm"].as_f64().unwrap());
    assert!(published["robot"] == "ur5e" && ours < 1.05 * theirs, "{published}");
    let shown = stdout(&run(dir.path(), &["validate", "layout.yaml", "--folds", "4"]));
    assert!(shown.contains("held out") && shown.contains("camera left out"), "{shown}");
    assert!(shown.lines().all(|line| line.chars().count() <= 80), "{shown}");
}

#[test]
fn links_that_differ_from_the_model_show_in_what_was_held_out() {
    let truth = cells::one_robot_truth().replace(
        "    joints: joints.csv\n",
        "    joints: joints.csv\n    corrections: [[0.2, 0, 0, 0], [-0.3, 0, 1, 0], [0.2, 0, -1, 0], [0.1, 0.5, 0, 0], [-0.2, 0, 0, 0], [0, 0, 0, 0]]\n",
    );
    let told = cells::hidden(include_str!("../layouts/one_robot.yaml")).replace(
        "    joints: joints.csv\n",
        "    joints: joints.csv\n    identify: {joint_offsets: {sigma: 0.3}, lengths: {sigma: 1}}\n",
    );
    let dir = folder(&[]);
    record(dir.path(), &truth, &told, 24);
    let output = run(dir.path(), &["validate", "layout.yaml", "--folds", "3", "--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let found = json(&output);
    let mm = |key: &str| found[key]["rms_mm"].as_f64().unwrap();
    // A single picture of a small tag is off by more than a millimetre whatever the links are.
    assert!(mm("held_out_nominal_links") > 1.3 * mm("held_out"), "{} {}", mm("held_out_nominal_links"), mm("held_out"));
}

#[test]
fn too_many_folds_are_refused_in_words() {
    let dir = folder(&[]);
    record(dir.path(), &cells::one_robot_truth(), &cells::hidden(include_str!("../layouts/one_robot.yaml")), 8);
    let output = run(dir.path(), &["validate", "layout.yaml"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("8 configurations cannot be split into 10 folds"), "{}", stderr(&output));
}

#[test]
fn the_pose_between_any_two_frames_comes_with_its_uncertainty() {
    let dir = folder(&[]);
    record(dir.path(), &cells::one_robot_truth(), &cells::hidden(include_str!("../layouts/one_robot.yaml")), 15);
    let arguments = [
        "solve",
        "layout.yaml",
        "--json",
        "--between",
        "left",
        "right",
        "--between",
        "ur5e.base",
        "wrist",
        "--at",
        "3",
    ];
    let output = run(dir.path(), &arguments);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let found = json(&output);
    let between = found["between"].as_array().unwrap();
    assert_eq!(between.len(), 2);
    let list = |value: &serde_json::Value| -> Vec<f64> {
        value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
    };
    // A pose that is an unknown itself: the same sigma by either way.
    let output = run(
        dir.path(),
        &["solve", "layout.yaml", "--json", "--between", "table_board", "left", "--covariance", "all.json"],
    );
    let own = json(&output);
    let (direct, along) = (&own["poses"]["world_from_left"], &own["between"][0]);
    for key in ["xyz_mm", "rotvec_deg", "sigma_xyz_mm", "sigma_rotvec_deg", "clusters_sigma_xyz_mm"] {
        for (a, b) in list(&direct[key]).iter().zip(list(&along[key])) {
            assert!((a - b).abs() < 1e-9 * (1.0 + a.abs()), "{key}: {a} {b}");
        }
    }
    assert!(along["configuration"].is_null() && between[1]["configuration"] == 3);
    let truth = cells::layout(&cells::one_robot_truth());
    let [left, right] = ["world_from_left", "world_from_right"].map(|key| cells::true_pose(&truth, key));
    let expected = (left.inverse() * right).translation * 1e3;
    let sigma = list(&between[0]["sigma_xyz_mm"]);
    for (i, value) in list(&between[0]["xyz_mm"]).iter().enumerate() {
        assert!(
            (value - expected[i]).abs() < 4.0 * sigma[i] && sigma[i] > 0.0,
            "{value} {} +- {}",
            expected[i],
            sigma[i]
        );
    }
    // The whole covariance has a name for each row, and its diagonal is the sigmas' square.
    let all: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(dir.path().join("all.json")).unwrap()).unwrap();
    let names: Vec<&str> = all["columns"].as_array().unwrap().iter().map(|name| name.as_str().unwrap()).collect();
    let rows = all["information"].as_array().unwrap();
    assert_eq!((names.len(), names[0], names[3]), (rows.len(), "world_from_left x", "world_from_left rx"));
    let trace: f64 = (0..3).map(|i| rows[i][i].as_f64().unwrap() * 1e6).sum();
    let sum: f64 = list(&direct["information_sigma_xyz_mm"]).iter().map(|s| s * s).sum();
    assert!((trace / sum - 1.0).abs() < 1e-9, "{trace} {sum}");
    let output = run(dir.path(), &["solve", "layout.yaml", "--between", "left", "ur5e.bass"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("did you mean `ur5e.base`?"), "{}", stderr(&output));
}
