//! A board of which nothing is known but the tags' size: every tag but the first is a pose of its own.

#[path = "support/cells.rs"]
mod cells;

use cellmap::geometry::TargetGeometry;

const TRUTH: &str = "
cellmap: 1
units: {length: mm, angle: deg}
world: arm.base
cameras:
  near: {intrinsics: {model: pinhole, size: [1280, 960], focal: [900, 900], centre: [640, 480]}, mount: arm.flange, pose: {xyz: [60, 0, 30], rpy: [0, 0, 90]}}
  far: {intrinsics: {model: pinhole, size: [1280, 960], focal: [900, 900], centre: [640, 480]}, pose: {xyz: [450, 150, 900], rpy: [180, 10, 40]}}
robots:
  arm: {model: ur5e, joints: joints.csv}
targets:
  board:
    tags: {dictionary: 6x6_250, grid: {columns: 6, rows: 6, size: 40, gap: 12, first_id: 0}}
    pose: {xyz: [400, 50, 0], rpy: [2, -3, 20]}
solve: {loss: squared, pixel_sigma: 0.1}
";

#[test]
fn every_tag_of_an_unknown_board_is_found() {
    let truth = cells::layout(TRUTH);
    let ids: Vec<String> = (0..36).map(|id| id.to_string()).collect();
    let told = cells::hidden(TRUTH)
        .replace(
            "grid: {columns: 6, rows: 6, size: 40, gap: 12, first_id: 0}}",
            &format!("size: 40, ids: [{}]}}\n    geometry: unknown", ids.join(", ")),
        )
        .replace(", pose: {xyz: [60, 0, 30], rpy: [0, 0, 90]}", "")
        .replace(", pose: {xyz: [450, 150, 900], rpy: [180, 10, 40]}", "");
    let layout = cells::layout(&told);
    let motions = cellmap::simulate::paths::generate(&truth, 30, 1).unwrap();
    let recording = cells::record(&truth, motions, 0.0, 3);
    let solved = cells::solve(layout, &recording);
    assert!(solved.trustworthy(), "{:?} {:?}", solved.undetermined, solved.doubts());
    // Tags meet cameras and robots, never each other.
    let solver = solved.plan.solver();
    assert!(solver.sparse && solver.unknowns == 35 * 6 + 3 * 6, "{}", solver.words());
    let TargetGeometry::Tags(faces) = &truth.targets[0].geometry else { panic!("the board carries tags") };
    let place = |id: usize| faces[id].target_from_tag.unwrap();
    for id in 1..36 {
        let found = solved.pose(&format!("board_from_board.tag{id}")).unwrap();
        let (t, r) = ((place(0).inverse() * place(id)).inverse() * found).magnitude();
        assert!(t < 1e-9 && r < 1e-8, "tag {id}: {t} m, {r} rad");
    }
}
