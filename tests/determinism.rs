//! The same bits on any number of threads, and with the lines of every file in any order.

#[path = "support/cells.rs"]
mod cells;
#[path = "support/program.rs"]
mod program;

use std::fmt::Write;
use std::path::Path;

use cellmap::recording::{RobotMotion, write_detections};
use program::run;
use rand::SeedableRng;
use rand::seq::SliceRandom;

fn record_to(dir: &Path) {
    let truth = cells::layout(&cells::two_robot_truth());
    let motions = cells::two_robot_motion(25);
    let recording = cells::record(&truth, motions.clone(), 0.1, 21);
    std::fs::write(dir.join("layout.yaml"), cells::hidden(cells::TWO_ROBOTS)).unwrap();
    write_detections(&dir.join("detections.csv"), &truth, &recording.corners).unwrap();
    let mut text = "configuration,robot,q1,q2,q3,q4,q5,q6\n".to_owned();
    for (name, motion) in ["ur10e", "ur5e"].iter().zip(motions) {
        let RobotMotion::Joints(values) = motion else { panic!("joints") };
        for (configuration, q) in values {
            let cells: Vec<String> = q.iter().map(|q| format!("{:.12}", q.to_degrees())).collect();
            writeln!(text, "{configuration},{name},{}", cells.join(",")).unwrap();
        }
    }
    std::fs::write(dir.join("joints.csv"), text).unwrap();
}

fn shuffle(path: &Path, seed: u64) {
    let text = std::fs::read_to_string(path).unwrap();
    let mut lines: Vec<&str> = text.lines().collect();
    lines[1..].shuffle(&mut rand_chacha::ChaCha8Rng::seed_from_u64(seed));
    std::fs::write(path, lines.join("\n") + "\n").unwrap();
}

/// The solution without the hashes of its inputs, which a shuffled file cannot keep.
fn solution(dir: &Path, threads: &str) -> String {
    let output = run(dir, &["solve", "layout.yaml", "--threads", threads]);
    assert_eq!(output.status.code(), Some(0), "{}", program::stderr(&output));
    let text = std::fs::read_to_string(dir.join("solution.yaml")).unwrap();
    text.lines().filter(|line| !line.contains("sha256")).map(|line| format!("{line}\n")).collect()
}

#[test]
fn the_solution_has_the_same_bits_always() {
    let dir = program::folder(&[]);
    record_to(dir.path());
    let one = solution(dir.path(), "1");
    assert!(one.contains("world_from_ur5e.base"));
    assert_eq!(one, solution(dir.path(), "2"), "two threads");
    assert_eq!(one, solution(dir.path(), "5"), "five threads");
    for seed in 0..2 {
        shuffle(&dir.path().join("detections.csv"), seed);
        shuffle(&dir.path().join("joints.csv"), seed + 10);
        assert_eq!(one, solution(dir.path(), "2"), "shuffled");
    }
}
