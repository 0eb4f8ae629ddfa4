//! Motions that do not determine everything: solved as far as they go, named, exit code 1, never a NaN.

#[path = "support/cells.rs"]
mod cells;
#[path = "support/program.rs"]
mod program;

use std::collections::BTreeMap;
use std::io::Write;

use cellmap::layout::Layout;
use cellmap::recording::{RobotMotion, write_detections};
use program::{folder, json, run};

/// The cell with one robot without its wrist camera and pallet: one robot, two cameras, a tool of unknown pose.
fn truth_text() -> String {
    let text = cells::one_robot_truth();
    let wrist = &text[text.find("  wrist:").unwrap()..text.find("robots:").unwrap()];
    let pallet = &text[text.find("  pallet:").unwrap()..text.find("solve:").unwrap()];
    text.replace(wrist, "").replace(pallet, "")
}

/// Writes a recording of the given stops and solves it with the binary.
fn solve(stops: Vec<Vec<f64>>) -> (Option<i32>, serde_json::Value) {
    let truth: Layout = cells::layout(&truth_text());
    let joints: BTreeMap<u64, Vec<f64>> = stops.into_iter().zip(1u64..).map(|(q, i)| (i, q)).collect();
    let recording = cells::record(&truth, vec![RobotMotion::Joints(joints.clone())], 0.05, 11);
    let dir = folder(&[("layout.yaml", &cells::hidden(&truth_text()))]);
    write_detections(&dir.path().join("detections.csv"), &truth, &recording.corners).unwrap();
    let mut file = std::fs::File::create(dir.path().join("joints.csv")).unwrap();
    writeln!(file, "configuration,robot,q1,q2,q3,q4,q5,q6").unwrap();
    for (configuration, q) in &joints {
        let cells: Vec<String> = q.iter().map(|q| format!("{:.12}", q.to_degrees())).collect();
        writeln!(file, "{configuration},ur5e,{}", cells.join(",")).unwrap();
    }
    let output = run(dir.path(), &["solve", "layout.yaml", "--json"]);
    let text = program::stdout(&output);
    assert!(!text.to_lowercase().contains("nan"), "{text}");
    let written = std::fs::read_to_string(dir.path().join("solution.yaml")).unwrap_or_default();
    assert!(!written.to_lowercase().contains(".nan"), "{written}");
    assert!(output.status.code() != Some(0) || !written.is_empty());
    (output.status.code(), json(&output))
}

fn reasons(found: &serde_json::Value) -> String {
    let all = found["undetermined"].as_array().unwrap_or_else(|| panic!("{found}"));
    all.iter().map(|u| format!("{} / {}\n", u["reason"].as_str().unwrap(), u["remedy"].as_str().unwrap())).collect()
}

const MIDDLE: [f64; 6] = [-1.9, -1.75, 1.9, -1.7, -1.55, 0.4];

#[test]
fn all_turns_about_one_axis() {
    // Only the first joint moves: everything turns about the base's z.
    let stops = (0..10).map(|i| {
        let mut q = MIDDLE.to_vec();
        q[0] += 0.08 * f64::from(i) - 0.4;
        q
    });
    let (code, found) = solve(stops.collect());
    assert_eq!(code, Some(1), "{found}");
    let reasons = reasons(&found);
    assert!(reasons.contains("all motions of `ur5e` turn about one axis"), "{reasons}");
    assert!(reasons.contains("turn `ur5e` about at least two different axes"), "{reasons}");
    assert!(
        found["poses"]["world_from_left"]["sigma_xyz_mm"][0].as_f64().unwrap() < 1.0,
        "the cameras are still found"
    );
    let sigma = &found["poses"]["ur5e.flange_from_tool_cube"]["sigma_xyz_mm"];
    assert!(sigma.as_array().unwrap().iter().any(serde_json::Value::is_null), "{sigma}");
}

#[test]
fn orientation_constant() {
    // Shoulder and elbow move, the wrist undoes their turn.
    let stops = (0..10).map(|i| {
        let mut q = MIDDLE.to_vec();
        let (a, b) = (0.25 * f64::from(i).sin(), 0.2 * (2.0 * f64::from(i)).cos());
        q[1] += a;
        q[2] += b;
        q[3] -= a + b;
        q
    });
    let (code, found) = solve(stops.collect());
    assert_eq!(code, Some(1), "{found}");
    let reasons = reasons(&found);
    assert!(reasons.contains("the orientation of `ur5e.flange` stays constant"), "{reasons}");
}

#[test]
fn too_few_configurations() {
    for count in [1, 2] {
        // Stops at which the tool is seen.
        let RobotMotion::Joints(seen) = cells::one_robot_path(2).remove(0) else { panic!("a path of joints") };
        let (code, found) = solve(seen.into_values().take(count).collect());
        assert_eq!(code, Some(1), "{found}");
        let words = if count == 1 { "in only 1 configuration" } else { "in only 2 configurations" };
        assert!(reasons(&found).contains(words), "{}", reasons(&found));
    }
}

#[test]
fn enough_motion_is_not_complained_about() {
    let stops = cells::wander(&MIDDLE, 0.4, 12, 5).into_values().collect();
    let (code, found) = solve(stops);
    assert_eq!(code, Some(0), "{found}");
    assert!(found["undetermined"].as_array().unwrap().is_empty());
}
