//! From a layout to poses by way of pictures, through the real binary: the cell with two robots, without a guess.

#[path = "support/program.rs"]
mod program;

use program::{folder, json, run, stderr};

#[test]
fn two_robots_through_pictures() {
    let layout = concat!(env!("CARGO_MANIFEST_DIR"), "/layouts/workcell.yaml");
    let dir = folder(&[]);
    let simulate = ["simulate", layout, "--out", "cell", "--pictures", "--configurations", "15", "--json"];
    let made = run(dir.path(), &simulate);
    assert_eq!(made.status.code(), Some(0), "{}", stderr(&made));
    assert_eq!(json(&made)["pictures"], 60);
    let detected = run(dir.path(), &["detect", "cell/layout.yaml", "--json"]);
    assert_eq!(detected.status.code(), Some(0), "{}", stderr(&detected));
    assert_eq!(json(&detected)["failed"].as_array().map(Vec::len), Some(0));
    let solved = json(&run(dir.path(), &["solve", "cell/layout.yaml", "--json"]));
    assert_eq!(solved["converged"], true, "{solved}");
    assert_eq!(solved["undetermined"].as_array().map(Vec::len), Some(0), "{solved}");
    let compared = json(&run(dir.path(), &["compare", "cell/solution.yaml", "cell/truth.yaml", "--json"]));
    let poses = compared["poses"].as_object().unwrap();
    assert_eq!(poses.len(), 14, "{compared}");
    for (key, pose) in poses {
        assert!(pose["translation_mm"].as_f64().unwrap() < 0.5, "{key}: {pose}");
        assert!(pose["within_sigma"].as_f64().unwrap() < 4.0, "{key}: {pose}");
    }
}
