//! From a layout to poses by way of pictures, through the real binary: the cell with two robots, without a guess.

#[path = "support/program.rs"]
mod program;

use std::collections::{BTreeMap, BTreeSet};

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
    assert_eq!(poses.len(), 15, "{compared}");
    for (key, pose) in poses {
        assert!(pose["translation_mm"].as_f64().unwrap() < 0.5, "{key}: {pose}");
        // Still things are seen with nearly the same error in every picture, and the standard deviations know it.
        assert!(pose["within_sigma"].as_f64().unwrap() < 4.0, "{key}: {pose}");
    }
    // Told where tags must be, the detector finds the same.
    let told = ["detect", "cell/layout.yaml", "--predict", "cell/solution.yaml", "--out", "told.csv", "--json"];
    let told = run(dir.path(), &told);
    assert_eq!(told.status.code(), Some(0), "{}", stderr(&told));
    let read = |name: &str| -> BTreeMap<String, [f64; 2]> {
        let text = std::fs::read_to_string(dir.path().join(name)).unwrap();
        let line = |line: &str| {
            let fields: Vec<&str> = line.split(',').collect();
            (fields[..6].join(","), [fields[6].parse().unwrap(), fields[7].parse().unwrap()])
        };
        text.lines().skip(1).map(line).collect()
    };
    let (with, without) = (read("told.csv"), read("cell/detections.csv"));
    let both: Vec<f64> =
        with.iter().filter_map(|(key, a)| without.get(key).map(|b| (a[0] - b[0]).hypot(a[1] - b[1]))).collect();
    assert!(
        both.len() * 100 >= without.len() * 99 && both.len() * 100 >= with.len() * 99,
        "{} {}",
        both.len(),
        with.len()
    );
    let rms = (both.iter().map(|apart| apart * apart).sum::<f64>() / both.len() as f64).sqrt();
    assert!(rms < 0.02, "{rms} px");
}

/// A tag so slanted, or so near the edge, that it may be seen or not is looked for as if nothing had been told.
#[test]
fn tags_hardly_seen_are_not_lost_by_telling_where_tags_are() {
    let dir = tempfile::tempdir().unwrap();
    let layout = concat!(env!("CARGO_MANIFEST_DIR"), "/layouts/paper_simulation_b.yaml");
    let simulate = ["simulate", layout, "--out", "b", "--pictures", "--configurations", "60"];
    let told = ["detect", "b/layout.yaml", "--predict", "b/truth.yaml", "--out", "told.csv"];
    for arguments in [&simulate[..], &["detect", "b/layout.yaml"], &told] {
        let done = run(dir.path(), arguments);
        assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    }
    let tags = |name: &str| -> BTreeSet<String> {
        let text = std::fs::read_to_string(dir.path().join(name)).unwrap();
        text.lines().skip(1).map(|line| line.split(',').take(5).collect::<Vec<_>>().join(",")).collect()
    };
    let (with, without) = (tags("told.csv"), tags("b/detections.csv"));
    let lost: Vec<&String> = without.difference(&with).collect();
    assert!(without.len() > 400 && lost.is_empty(), "{} of {}: {lost:?}", lost.len(), without.len());
}
