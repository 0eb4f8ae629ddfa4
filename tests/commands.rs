//! The commands through the real binary: the demo from end to end, detection that is interrupted or meets bad pictures, comparison.

#[path = "support/program.rs"]
mod program;

use std::path::Path;

use program::{contents, folder, json, run, stderr, stdout};

/// The demo, and then every command on its files.
#[test]
fn the_demo_from_end_to_end() {
    let dir = folder(&[]);
    let output = run(dir.path(), &["demo", "--configurations", "24", "--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let shown = json(&output);
    assert_eq!(shown["pictures"], 24);
    // The paper's method on these pictures, and the joint solve: both far better than on the paper's own pictures.
    let error = |method: &str, what: &str| shown[method][what].as_f64().unwrap();
    assert_eq!((error("paper", "base_mm"), error("paper", "tool_mm")), (2.59, 1.22));
    assert!(error("joint_solve", "base_mm") < 0.3 && error("joint_solve", "tool_mm") < 0.3, "{shown}");
    assert!(error("published_method", "base_mm") < 2.0 && error("published_method", "tool_mm") < 1.0, "{shown}");
    assert!(shown["worst_translation_mm"].as_f64().unwrap() < 0.3, "{shown}");
    assert!(shown["worst_rotation_deg"].as_f64().unwrap() < 0.03, "{shown}");
    assert!(shown["rms_px"].as_f64().unwrap() < 0.05, "{shown}");

    let demo = dir.path().join("cellmap-demo");
    let check = run(&demo, &["check", "layout.yaml"]);
    assert_eq!(check.status.code(), Some(0), "{}", stderr(&check));
    assert!(stdout(&check).contains("└─ tool_board  (unknown)"), "{}", stdout(&check));
    assert!(stdout(&check).lines().all(|line| line.chars().count() <= 80), "{}", stdout(&check));

    // A second detection gives the same bytes, also when pictures are broken on the way.
    let first = std::fs::read(demo.join("detections.csv")).unwrap();
    assert_eq!(run(&demo, &["detect", "layout.yaml", "--threads", "1"]).status.code(), Some(0));
    assert_eq!(std::fs::read(demo.join("detections.csv")).unwrap(), first);
    std::fs::write(demo.join("images/camera/001.png"), "no picture").unwrap();
    std::fs::remove_file(demo.join("images/camera/002.png")).unwrap();
    let whole = std::fs::read(demo.join("images/camera/003.png")).unwrap();
    std::fs::write(demo.join("images/camera/003.png"), &whole[..whole.len() / 2]).unwrap();
    let detected = run(&demo, &["detect", "layout.yaml", "--json"]);
    assert_eq!(detected.status.code(), Some(0));
    let found = json(&detected);
    assert_eq!(found["pictures"], 23);
    let failed: Vec<String> = found["failed"].as_array().unwrap().iter().map(|f| f["picture"].to_string()).collect();
    assert_eq!(failed.len(), 2, "{failed:?}");
    assert!(failed[0].contains("camera/001.png") && failed[1].contains("camera/003.png"), "{failed:?}");

    // Drawings: one a picture that could be read.
    assert_eq!(run(&demo, &["detect", "layout.yaml", "--out", "again.csv", "--draw", "drawn"]).status.code(), Some(0));
    assert_eq!(std::fs::read_dir(demo.join("drawn")).unwrap().count(), 21);

    // Without OpenCV in the build, asking for it is an input error that says what to do.
    if cfg!(not(feature = "opencv")) {
        let refused = run(&demo, &["detect", "layout.yaml", "--detector", "opencv"]);
        assert_eq!(refused.status.code(), Some(2));
        assert!(stderr(&refused).contains("--features opencv"), "{}", stderr(&refused));
    }

    // A dictionary that is not on the targets finds nothing, and says so.
    for name in ["layout.yaml", "gridboard_base.yaml", "gridboard_tool.yaml"] {
        let text = std::fs::read_to_string(demo.join(name)).unwrap();
        let strange = text.replace("6x6_250", "4x4_50").replace("gridboard", "strange_gridboard");
        std::fs::write(demo.join(format!("strange_{name}")), strange).unwrap();
    }
    let nothing = run(&demo, &["detect", "strange_layout.yaml", "--out", "nothing.csv"]);
    assert_eq!(nothing.status.code(), Some(1));
    assert!(stderr(&nothing).contains("nothing was found: check the targets' dictionary"), "{}", stderr(&nothing));

    // The solution is a layout: it can be checked, compared, and started from.
    let solved = json(&run(&demo, &["solve", "layout.yaml", "--json"]));
    for field in [
        "converged",
        "termination",
        "iterations",
        "initial_cost",
        "final_cost",
        "observations",
        "unknowns",
        "rms_px",
        "rejected",
        "undetermined",
        "seconds",
        "poses",
    ] {
        assert!(!solved[field].is_null(), "{field}");
    }
    assert_eq!(run(&demo, &["check", "solution.yaml"]).status.code(), Some(0));
    let same = json(&run(&demo, &["compare", "solution.yaml", "solution.json", "--json"]));
    assert_eq!(same["worst_translation_mm"], 0.0);
    let again =
        json(&run(&demo, &["solve", "layout.yaml", "--start", "solution.yaml", "--json", "--out", "again.yaml"]));
    assert!(
        again["iterations"].as_u64() <= solved["iterations"].as_u64(),
        "{} {}",
        again["iterations"],
        solved["iterations"]
    );
    let compared = json(&run(&demo, &["compare", "again.yaml", "solution.yaml", "--json"]));
    assert!(compared["worst_translation_mm"].as_f64().unwrap() < 1e-6, "{compared}");
    assert!(compared["poses"]["world_from_camera"]["within_sigma"].as_f64().unwrap() < 0.1);
    sparse_equations_give_the_same(&demo, &solved);
}

/// The form of the equations is chosen, told, and overridden.
fn sparse_equations_give_the_same(demo: &Path, solved: &serde_json::Value) {
    assert_eq!(solved["solver"]["form"], "dense");
    assert!(solved["solver"]["why"].as_str().unwrap().ends_with("are few"), "{}", solved["solver"]);
    let sparse = ["solve", "layout.yaml", "--solver", "sparse", "--out", "sparse.yaml"];
    let found = json(&run(demo, &[&sparse[..], &["--json"]].concat()));
    assert_eq!(found["solver"]["form"], "sparse");
    assert!(found["solver"]["sparse_multiplications"].as_f64().unwrap() > 0.0);
    for (key, pose) in solved["poses"].as_object().unwrap() {
        for part in ["xyz_mm", "sigma_xyz_mm"] {
            let other = &found["poses"][key][part];
            assert_eq!(pose[part].is_null(), other.is_null(), "{key} {part}");
            for i in 0..3 {
                let [a, b] = [pose[part][i].as_f64(), other[i].as_f64()];
                assert!((a.unwrap_or(0.0) - b.unwrap_or(0.0)).abs() < 1e-4, "{key} {part}: {a:?} {b:?}");
            }
        }
    }
    let refused = run(demo, &[&sparse[..], &["--covariance", "covariance.json"]].concat());
    assert_eq!(refused.status.code(), Some(2));
    assert!(stderr(&refused).contains("is not kept whole"), "{}", stderr(&refused));
    let between = run(demo, &[&sparse[..], &["--between", "camera", "ur3.base", "--json"]].concat());
    assert!(json(&between)["between"][0]["sigma_xyz_mm"][0].as_f64().unwrap() > 0.0);
}

/// A run that was stopped leaves a journal; the next goes on from there and the result is the same.
#[test]
fn detection_picks_up_where_it_stopped() {
    use cellmap::detect::native::NativeDetector;
    use cellmap::workflow::detect::{Watch, detect};
    use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

    let dir = folder(&[]);
    assert_eq!(run(dir.path(), &["demo", "--configurations", "48", "--json"]).status.code(), Some(0));
    let demo = dir.path().join("cellmap-demo");
    let whole = std::fs::read(demo.join("detections.csv")).unwrap();
    std::fs::remove_file(demo.join("detections.csv")).unwrap();
    let layout = cellmap::layout::read_layout(&demo.join("layout.yaml"), None).unwrap();
    let out = demo.join("detections.csv");
    let stop = AtomicBool::new(false);
    let seen = AtomicUsize::new(0);
    let progress = |done: usize, _: usize| {
        seen.store(done, Ordering::Relaxed);
        if done > 0 {
            stop.store(true, Ordering::Relaxed);
        }
    };
    let detector = NativeDetector::new();
    let first = detect(
        &layout,
        &detector,
        &out,
        &Watch { progress: &progress, stop: &stop, draw: None, predict: None, search_all: false },
    )
    .unwrap();
    assert!(first.interrupted && first.pictures > 0 && first.pictures < 48, "{first:?}");
    assert!(!out.exists(), "nothing half is left");
    let journal = demo.join("detections.csv.unfinished");
    assert!(journal.exists());
    // The last line was cut by the interrupt.
    let text = std::fs::read_to_string(&journal).unwrap();
    std::fs::write(&journal, &text[..text.len() - 40]).unwrap();
    let go = AtomicBool::new(false);
    let second = detect(
        &layout,
        &detector,
        &out,
        &Watch { progress: &|_, _| {}, stop: &go, draw: None, predict: None, search_all: false },
    )
    .unwrap();
    assert_eq!(second.resumed, first.pictures - 1);
    assert_eq!(second.pictures, 48);
    assert_eq!(std::fs::read(&out).unwrap(), whole);
    assert!(!journal.exists());
}

#[test]
fn a_result_that_cannot_be_written_is_an_error_and_leaves_no_trace() {
    let layout = "cellmap: 1\nunits: {length: m, angle: rad}\nworld: base\ncameras: {eye: {}}\n\
        robots: {arm: {flange_poses: f.csv, pose: {xyz: [0, 0, 0], rpy: [0, 0, 0]}}}\n\
        targets: {tag: {mount: arm.flange}}\nobservations: {target_poses: p.csv}\n";
    let row = "x,y,z,qx,qy,qz,qw\n";
    let flange = format!("configuration,robot,{row}1,arm,0,0,0,0,0,0,1\n2,arm,1,0,0,1,0,0,0\n3,arm,0,1,0,0,1,0,0\n");
    let poses = format!(
        "configuration,shot,camera,target,{row}1,0,eye,tag,0,0,1,0,0,0,1\n2,0,eye,tag,1,0,1,1,0,0,0\n3,0,eye,tag,0,1,1,0,1,0,0\n"
    );
    let dir = folder(&[("layout.yaml", layout), ("f.csv", &flange), ("p.csv", &poses), ("taken", "a file")]);
    let before = contents(dir.path());
    let output = run(dir.path(), &["solve", "layout.yaml", "--out", "taken/solution.yaml"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("the file cannot be written"), "{}", stderr(&output));
    assert_eq!(before, contents(dir.path()));
    // And the same cell with a good place to write to.
    let output = run(dir.path(), &["solve", "layout.yaml"]);
    assert!(
        dir.path().join("solution.yaml").exists() && dir.path().join("solution.json").exists(),
        "{}",
        stderr(&output)
    );
}

#[test]
fn comparing_strangers_is_refused() {
    let one = "cellmap: 1\nunits: {length: m, angle: rad}\nworld: w\ncameras: {a: {pose: {xyz: [0, 0, 0], rpy: [0, 0, 0]}}}\n";
    let dir = folder(&[("one.yaml", one), ("two.yaml", &one.replace("{a:", "{b:"))]);
    let output = run(dir.path(), &["compare", "one.yaml", "two.yaml"]);
    assert_eq!(output.status.code(), Some(2));
    assert_eq!(
        stderr(&output),
        "error: it gives no pose that `one.yaml` gives too\n  --> two.yaml\n  help: compare two layouts of one cell: frames are matched by name\n"
    );
}

#[test]
fn comparison_follows_frames_not_mounts() {
    // The same cell described once with the lamp on the table and once on the world.
    let pose = |x: f64| format!("pose: {{xyz: [{x}, 0, 0], rpy: [0, 0, 0]}}");
    let head = "cellmap: 1\nunits: {length: m, angle: rad}\nworld: w\n";
    let one = format!("{head}targets:\n  table: {{{}}}\n  lamp: {{mount: table, {}}}\n", pose(1.0), pose(0.5));
    let two = format!("{head}targets:\n  table: {{{}}}\n  lamp: {{{}}}\n", pose(1.0), pose(1.501));
    let dir = folder(&[("one.yaml", &one), ("two.yaml", &two)]);
    let found = json(&run(dir.path(), &["compare", "one.yaml", "two.yaml", "--json"]));
    let lamp = found["poses"]["table_from_lamp"]["translation_mm"].as_f64().unwrap();
    assert!((lamp - 1.0).abs() < 1e-9, "{found}");
    assert_eq!(found["poses"]["world_from_table"]["rotation_deg"], 0.0);
}

#[test]
fn comparison_covers_the_places_that_were_found_on_a_target() {
    let dir = folder(&[]);
    let layout = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("layouts/laser_tracker.yaml");
    let made = run(dir.path(), &["simulate", layout.to_str().unwrap(), "--out", "cell"]);
    assert_eq!(made.status.code(), Some(0), "{}", stderr(&made));
    let solved = run(dir.path(), &["solve", "cell/layout.yaml"]);
    assert_eq!(solved.status.code(), Some(0), "{}", stderr(&solved));
    let found = json(&run(dir.path(), &["compare", "cell/solution.yaml", "cell/truth.yaml", "--json"]));
    for point in ["a", "b", "c"] {
        let place = &found["poses"][format!("reflectors_from_reflectors.{point}")];
        assert!(place["translation_mm"].as_f64().unwrap() < 1.0, "{found}");
        assert!(place["within_sigma"].as_f64().unwrap() < 5.0, "{found}");
    }
}

#[test]
fn check_warns_of_a_camera_without_pictures() {
    let layout = "cellmap: 1\nunits: {length: m, angle: rad}\nworld: tag\ncameras:\n  eye:\n    images: p/{configuration}.png\n    \
        intrinsics: {model: pinhole, size: [9, 9], focal: [9, 9], centre: [4, 4]}\ntargets:\n  tag: {tags: {dictionary: 4x4_50, size: 1, ids: [1]}}\n";
    let dir = folder(&[("layout.yaml", layout)]);
    let output = run(dir.path(), &["check", "layout.yaml"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(
        stdout(&output).contains("warning: camera `eye` has no pictures: nothing matches `p/{configuration}.png`"),
        "{}",
        stdout(&output)
    );
}

#[test]
fn a_reader_that_goes_away_is_no_panic() {
    use std::process::{Command, Stdio};
    let layout = "cellmap: 1\nunits: {length: m, angle: rad}\nworld: tag\ntargets: {tag: {tags: {dictionary: 4x4_50, size: 1, ids: [1]}}}\n";
    let dir = folder(&[("layout.yaml", layout)]);
    let mut child = Command::new(env!("CARGO_BIN_EXE_cellmap"))
        .current_dir(dir.path())
        .args(["check", "layout.yaml"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert!(!stderr(&output).contains("panicked"), "{}", stderr(&output));
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
}

#[test]
fn help_fits_a_terminal() {
    for arguments in [&["--help"][..], &["solve", "--help"], &["detect", "--help"], &["identify", "--help"]] {
        let output = run(std::path::Path::new("."), arguments);
        assert_eq!(output.status.code(), Some(0));
        assert!(stdout(&output).lines().all(|line| line.chars().count() <= 100), "{}", stdout(&output));
    }
    assert_eq!(run(std::path::Path::new("."), &["slove"]).status.code(), Some(2));
}
