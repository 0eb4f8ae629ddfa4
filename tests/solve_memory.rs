//! Recordings that do not fit into the given memory: the answer of all corners, gone over in pieces.

#[path = "../benches/support/sizes.rs"]
mod sizes;
mod support {
    pub mod program;
}

use std::path::Path;

use cellmap::layout::{Layout, LossSetting};
use cellmap::recording::write::write_motions;
use cellmap::recording::{Recording, write_detections};
use cellmap::solve::{Assembler, Loss, Priors};
use cellmap::trust::pieces::{Gathering, from_sums};
use cellmap::trust::{Source, covariance};
use cellmap::workflow::solve::{SolveRequest, Solved, solve};
use nalgebra::DMatrix;
use sizes::{Board, Size, problem};
use support::program::{folder, run, stderr, stdout};

/// Two robots that share three cameras, or a board moved by hand before four; with corners that are dragged away.
fn recorded(folder: &Path, robots: usize, stops: u64) -> (Layout, Recording) {
    let (cameras, plates) = if robots == 0 { (4, 0) } else { (3, 2) };
    let size = Size { spaces: 1, robots, cameras, stops, shots: 1, board: Board::Small, plates };
    let mut made = problem(size, robots > 0);
    made.layout.solve.loss = LossSetting::Huber(1.0);
    made.layout.recording = folder.to_owned();
    made.layout.file = folder.join("layout.yaml");
    std::fs::write(&made.layout.file, "cellmap: 1\n").unwrap();
    made.recording.corners.edit(|rows| {
        for (place, row) in rows.iter_mut().enumerate().filter(|(place, _)| place % 61 == 7) {
            row.pixel[0] += 3.0 + (place % 17) as f64;
            row.pixel[1] -= 2.0 + (place % 5) as f64;
        }
    });
    write_motions(folder, &made.layout, &made.recording.motions).unwrap();
    write_detections(&folder.join("detections.csv"), &made.layout, &made.recording.corners).unwrap();
    (made.layout, made.recording)
}

fn solved(layout: &Layout, memory: Option<u64>) -> Solved {
    solve(layout.clone(), &SolveRequest { memory, ..SolveRequest::default() }).unwrap_or_else(|e| panic!("{e}"))
}

/// The largest difference of two answers in standard deviations, and the ratio of their standard deviations that is farthest from one.
fn apart(a: &Solved, b: &Solved) -> (f64, f64) {
    let (mut most, mut ratio) = (0.0_f64, 1.0_f64);
    let mut see = |difference: f64, [one, other]: [Option<f64>; 2]| {
        let (one, other) = (one.unwrap(), other.unwrap());
        most = most.max(difference.abs() / one);
        let between = other / one;
        ratio = if between.ln().abs() > ratio.ln().abs() { between } else { ratio };
    };
    for block in &a.plan.unknowns.blocks {
        match &block.kind {
            cellmap::solve::UnknownKind::Edge(edge) => {
                let poses = [a, b].map(|s| s.state.static_poses[*edge]);
                let shift = poses[1].translation - poses[0].translation;
                let turn = poses[0].rotation.angle_to(&poses[1].rotation);
                let sigmas = [a, b].map(|s| s.covariance.pose_sigma(&s.tree, &s.state, block, Source::Both));
                for i in 0..3 {
                    see(shift[i], [sigmas[0][i], sigmas[1][i]]);
                    see(turn, [sigmas[0][3 + i], sigmas[1][3 + i]]);
                }
            }
            cellmap::solve::UnknownKind::Lens { camera, places } => {
                for (i, place) in places.iter().enumerate() {
                    let values = [a, b].map(|s| s.state.lenses[*camera][*place]);
                    let sigmas = [a, b].map(|s| s.covariance.column_sigma(block.start + i, Source::Both));
                    see(values[1] - values[0], sigmas);
                }
            }
            cellmap::solve::UnknownKind::Links { .. } => panic!("no links are asked for"),
        }
    }
    (most, ratio)
}

/// A recording solved as a whole and in little memory, which must give the same.
fn whole_and_in_pieces(layout: &Layout) -> (Solved, Solved) {
    let whole = solved(layout, None);
    let streamed = solved(layout, Some(50_000_000));
    assert!(streamed.streamed.is_some());
    let (most, ratio) = apart(&whole, &streamed);
    println!("{most:.4} sigma apart, sigmas by {ratio:.4}; {:?}", streamed.streamed.as_ref().unwrap().report);
    assert!(most < 0.03 && (ratio - 1.0).abs() < 0.01, "{most} {ratio}");
    (whole, streamed)
}

#[test]
fn pieces_give_the_answer_of_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    let (layout, recording) = recorded(folder.path(), 2, 1500);
    let whole = solved(&layout, None);
    let streamed = solved(&layout, Some(50_000_000));
    let told = streamed.streamed.as_ref().unwrap();
    assert!(told.stride >= 2 && told.chunks >= 2, "{} {}", told.stride, told.chunks);
    assert_eq!(told.corners, recording.corners.len());
    assert!(2 * told.recording.corners.len() < told.corners);
    let (most, ratio) = apart(&whole, &streamed);
    println!(
        "{} corners, 1 of {}, {} pieces, passes {:?}, left over {:.1e}; {most:.4} sigma apart, sigmas by {ratio:.4}; set aside {} and {}",
        told.corners,
        told.stride,
        told.chunks,
        told.report.costs,
        told.report.left_over,
        whole.rejected.corners,
        streamed.rejected.corners
    );
    assert!(most < 0.02 && (ratio - 1.0).abs() < 0.01, "{most} {ratio}");
    assert!(streamed.trustworthy() && whole.trustworthy());
    assert!(whole.rejected.corners.abs_diff(streamed.rejected.corners) <= 2 + whole.rejected.corners / 500);
    assert!((whole.summary.rms_px().unwrap() / streamed.summary.rms_px().unwrap() - 1.0).abs() < 1e-3);
    assert!((whole.report.final_cost / streamed.report.final_cost - 1.0).abs() < 1e-2);
    let counted = |s: &Solved| s.tallies.iter().map(|t| t.accepted + t.rejected).collect::<Vec<_>>();
    assert_eq!(counted(&whole), counted(&streamed));
    assert_eq!(whole.unknowns, streamed.unknowns);
    assert_eq!(whole.inputs, streamed.inputs);
    let clusters = |s: &Solved| (s.covariance.clusters.configurations.groups, s.covariance.clusters.corners.groups);
    assert_eq!(clusters(&whole), clusters(&streamed));

    // Enough memory is the same as no limit, to the last bit.
    let enough = solved(&layout, Some(4_000_000_000));
    assert!(enough.streamed.is_none());
    assert_eq!(enough.state, whole.state);

    // As everywhere: the number of threads changes nothing.
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let again = alone.install(|| solved(&layout, Some(50_000_000)));
    assert_eq!(again.state, streamed.state);
    assert_eq!(again.covariance, streamed.covariance);
}

#[test]
fn robots_that_stop_inexactly_are_solved_in_pieces_too() {
    let folder = tempfile::tempdir().unwrap();
    let (mut layout, _) = recorded(folder.path(), 2, 1000);
    for robot in &mut layout.robots {
        robot.repeatability = Some([5e-5, 1e-4]);
    }
    whole_and_in_pieces(&layout);
}

#[test]
fn a_board_that_moves_by_hand_is_solved_in_pieces_too() {
    let folder = tempfile::tempdir().unwrap();
    let (layout, _) = recorded(folder.path(), 0, 1500);
    let (whole, streamed) = whole_and_in_pieces(&layout);
    assert_eq!(whole.unknowns, streamed.unknowns);
    assert!(whole.observations.abs_diff(streamed.observations) <= 10);
}

#[test]
fn terms_formed_twice_give_the_covariance_of_terms_that_are_kept() {
    let folder = tempfile::tempdir().unwrap();
    let (layout, recording) = recorded(folder.path(), 2, 60);
    let solved = solved(&layout, None);
    let priors = Priors::new(&solved.tree, &solved.plan.unknowns);
    let believed = priors.equations(&solved.plan, &solved.state);
    let mut measuring = Assembler::new(&layout, &recording, &solved.plan, Priors::default());
    measuring.set_loss(Loss::Squared);
    let terms = measuring.terms(&solved.state);
    let kept = covariance(&solved.plan, &terms, &believed, 1.1);
    let information = terms.information(solved.plan.unknowns.count);
    let mut gathering = Gathering::new(from_sums(&solved.plan, &information, &believed, 1.1));
    gathering.add(&mut measuring, &solved.state);
    let twice = gathering.finish(&solved.plan, &information, &believed, 1.1);
    assert_eq!(kept.matrix, twice.matrix);
    let near = |a: &DMatrix<f64>, b: &DMatrix<f64>| (a - b).norm() < 1e-12 * a.norm();
    assert!(near(&kept.clusters.matrix, &twice.clusters.matrix) && near(&kept.clusters.shown, &twice.clusters.shown));
    for (one, other) in
        [(kept.clusters.corners, twice.clusters.corners), (kept.clusters.configurations, twice.clusters.configurations)]
    {
        assert_eq!(one.groups, other.groups);
        assert!((one.found / other.found - 1.0).abs() < 1e-12 && (one.spread / other.spread - 1.0).abs() < 1e-12);
    }
    assert!(measuring.term_bytes() >= terms.configurations.iter().map(|term| 8 * term.columns.len().pow(2)).sum());
}

const LAYOUT: &str = "
cellmap: 1
units: {length: m, angle: deg}
world: board
cameras:
  left: {intrinsics: {model: pinhole, size: [640, 480], focal: [500, 500], centre: [320, 240]}}
targets:
  board: {checkerboard: {corners: [4, 3], square: 0.02}}
";
const HEADER: &str = "configuration,shot,camera,target,tag,corner,u,v\n";

/// What the program says of a recording of these lines in too little memory.
fn refused(lines: &str, arguments: &[&str]) -> String {
    let dir = folder(&[("layout.yaml", LAYOUT), ("detections.csv", &format!("{HEADER}{lines}"))]);
    let output = run(dir.path(), &[&["solve", "layout.yaml"], arguments].concat());
    assert_eq!(output.status.code(), Some(2), "{}", stdout(&output));
    stderr(&output)
}

#[test]
fn what_cannot_be_solved_in_pieces_is_refused_in_words() {
    let line = "1,0,left,board,,1,100,100\n";
    let told = refused(line, &["--memory", "500"]);
    assert!(told.contains("invalid value '500' for '--memory <SIZE>': say of what, such as `500M` or `2G`"), "{told}");
    let told = refused(line, &["--memory", "1M"]);
    assert!(told.contains("the recording cannot be solved in 1M of memory"), "{told}");
    assert!(told.contains("give at least `--memory 47M`"), "{told}");
    let told = refused(line, &["--memory", "1M", "--solver", "sparse"]);
    assert!(
        told.contains("the corners do not fit into 1M, and equations that are summed over pieces are dense"),
        "{told}"
    );
}

#[test]
fn bad_lines_are_told_as_in_a_whole_reading() {
    for bad in [
        "1,0,left,plate,,1,1,2",
        "1,0,left,board,,12,1,2",
        "1,0,left,board,,1,one,2",
        "1,0,left,board,,1,1",
        "x,0,left,board,,1,1,2",
    ] {
        let lines = format!("2,0,left,board,,1,100,100\n\n3,0,left,board,,1,100,100\n{bad}\n4,0,left,board,,2,1,1\n");
        let (whole, pieces) = (refused(&lines, &[]), refused(&lines, &["--memory", "1M"]));
        assert!(whole.contains("detections.csv:5\n"), "{whole}");
        assert_eq!(whole, pieces);
    }
    let down: String = (0..1200).rev().map(|c| format!("{c},0,left,board,,1,100,100\n")).collect();
    let told = refused(&down, &["--memory", "1M"]);
    assert!(told.contains("detections.csv:1026\n"), "{told}");
    assert!(told.contains("configuration 175 stands after 176"), "{told}");
}
