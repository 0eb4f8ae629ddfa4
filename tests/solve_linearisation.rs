//! The gradient against the slope of the cost, under every loss, and the losses themselves.

#[path = "support/cells.rs"]
mod cells;

use cellmap::frames::FrameTree;
use cellmap::geometry::Pose;
use cellmap::geometry::pose::Twist;
use cellmap::layout::Layout;
use cellmap::recording::{ContactRow, PointRow, PoseRow, Recording, RobotMotion};
use cellmap::simulate::Cell;
use cellmap::solve::{Assembler, Loss, Normal, Plan, Priors, State, UnknownKind};
use nalgebra::Vector3;

/// A cell with every kind of measurement and unknown: a refined lens, link parameters, a prior, a point of unknown place.
const CELL: &str = "
cellmap: 1
units: {length: m, angle: rad}
world: bench
cameras:
  eye:
    intrinsics: {model: rational, size: [1280, 960], focal: [900, 905], centre: [640, 479], distortion: [0.1, 0.02, 0.001, -0.001, 0.01, 0.2, 0.03, 0.001]}
    refine: [focal, centre, distortion]
    pose: {xyz: [0.1, -1.6, 1.1], rpy: [-2.1, 0.05, 0.1], start: true}
  wrist:
    intrinsics: {model: kannala_brandt, size: [1280, 960], focal: [500, 500], centre: [640, 480], distortion: [0.01, -0.01, 0.004, 0.001]}
    mount: arm.flange
    pose: {xyz: [0.0, -0.08, 0.03], rpy: [0.2, 0.0, 0.1], start: true}
sensors:
  tracker: {measures: points, pose: {xyz: [2, 1, 0.5], rpy: [0.1, 0.2, 2.0], start: true}}
robots:
  arm:
    model: ur5e
    joints: joints.csv
    pose: {xyz: [0.4, 0.3, 0.05], rpy: [0.02, 0.01, 3.0], sigma: {xyz: 0.01, rotation: 0.02}}
    identify: {joint_offsets: {sigma: 0.01}, lengths: {sigma: 0.002}, angles: {sigma: 0.01}}
targets:
  plate:
    tags: {dictionary: 6x6_250, grid: {columns: 3, rows: 2, size: 0.1, gap: 0.02, first_id: 0}}
    pose: {xyz: [0, 0, 0], rpy: [0, 0, 0.1], start: true}
  tool:
    points: {tip: unknown, ball: [0.01, 0.02, 0.1]}
    mount: arm.flange
    pose: {xyz: [0.0, 0.01, 0.02], rpy: [0.1, 0.0, 0.0], start: true}
  post:
    points: {top: [0.02, 0.0, 0.3]}
    pose: {xyz: [0.3, 0.1, 0.0], rpy: [0, 0, 0.4], start: true}
solve: {pixel_sigma: 0.3, point_sigma: 0.001, pose_sigma: {xyz: 0.004, rotation: 0.02}, contact_sigma: 0.002}
";

fn recording(layout: &Layout) -> Recording {
    let motions = vec![RobotMotion::Joints(cells::wander(&[3.2, -1.6, 1.9, -1.87, -1.57, 0.2], 0.5, 6, 2))];
    let mut recording = cells::record(layout, motions, 0.5, 3);
    let shadow = recording.clone();
    let cell = Cell::new(layout, &shadow);
    for configuration in 1..=6u64 {
        for (shot, point, distance) in [(0, "tip", 0.0), (1, "ball", 0.2)] {
            let feature = cellmap::geometry::Feature::Point(point.into());
            let place = Vector3::new(0.01, 0.02, 0.1) * shot as f64;
            let at = cell.pose(cell.tree.sensors[0], cell.tree.targets[1], configuration).unwrap() * place;
            let position = at + Vector3::new(0.001, -0.002, 0.0015);
            recording.points.push(PointRow {
                configuration,
                shot,
                sensor: 0,
                target: 1,
                feature: feature.clone(),
                position,
            });
            let top = (2, cellmap::geometry::Feature::Point("top".into()));
            recording.contacts.push(ContactRow { configuration, points: [(1, feature), top], distance });
        }
        let seen = cell.pose(cell.tree.cameras[0], cell.tree.targets[0], configuration).unwrap();
        let pose = seen.retract(&Twist::new(0.01, -0.004, 0.002, 0.03, -0.02, 0.01));
        recording.poses.push(PoseRow { configuration, shot: 0, camera: 0, target: 0, pose });
    }
    recording
}

fn start(layout: &Layout, tree: &FrameTree, plan: &Plan) -> State {
    State {
        static_poses: tree.static_edges.iter().map(|edge| edge.spec.pose().unwrap_or_default()).collect(),
        moving_poses: vec![vec![Pose::identity(); plan.configurations.len()]; plan.moving_count()],
        corrections: vec![(0..24).map(|i| 0.001 * f64::from(i).sin()).collect()],
        lenses: layout.cameras.iter().map(|c| *c.intrinsics.as_ref().unwrap().parameters()).collect(),
    }
}

/// The state moved along one shared column.
fn moved(tree: &FrameTree, plan: &Plan, state: &State, column: usize, by: f64) -> State {
    let block = plan.unknowns.block_of(column).unwrap();
    let at = column - block.start;
    let mut next = state.clone();
    match &block.kind {
        UnknownKind::Edge(edge) if tree.static_edges[*edge].freedom.count() == 3 => {
            let mut d = Vector3::zeros();
            d[at] = by;
            next.static_poses[*edge] = next.static_poses[*edge] * Pose::from_translation(d.x, d.y, d.z);
        }
        UnknownKind::Edge(edge) => {
            let mut d = Twist::zeros();
            d[at] = by;
            next.static_poses[*edge] = next.static_poses[*edge].retract(&d);
        }
        UnknownKind::Links { robot, places, .. } => next.corrections[*robot][places[at]] += by,
        UnknownKind::Lens { camera, places } => next.lenses[*camera][places[at]] += by,
    }
    next
}

#[test]
fn the_gradient_is_the_slope_of_the_cost_under_every_loss() {
    let layout = cells::layout(CELL);
    let tree = FrameTree::new(&layout);
    let recording = recording(&layout);
    let plan = Plan::new(&layout, &tree, &recording).unwrap();
    assert!(recording.corners.len() > 100, "{}", recording.corners.len());
    assert!(plan.unknowns.blocks.len() >= 8, "{:?}", plan.unknowns.blocks.iter().map(|b| &b.name).collect::<Vec<_>>());
    let state = start(&layout, &tree, &plan);
    let units = plan.unknowns.units();
    for loss in [Loss::Squared, Loss::Huber(1.0), Loss::Cauchy(2.0), Loss::Tukey(40.0)] {
        let mut assembler = Assembler::new(&layout, &recording, &plan, Priors::new(&tree, &plan.unknowns));
        assembler.set_loss(loss);
        let mut normal = Normal::default();
        let cost = assembler.linearise(&state, &mut normal);
        let plain = assembler.cost(&state);
        // To the last digits: a step may be judged by one against the other.
        assert!((plain - cost).abs() < 1e-14 * cost, "{plain} {cost}");
        for (column, unit) in units.iter().enumerate() {
            let h = 1e-4 * unit;
            let up = assembler.cost(&moved(&tree, &plan, &state, column, h));
            let down = assembler.cost(&moved(&tree, &plan, &state, column, -h));
            let numeric = (up - down) / (2.0 * h) * unit;
            let analytic = normal.gradient[column] * unit;
            assert!(
                (numeric - analytic).abs() < 2e-4 * (1.0 + analytic.abs()) + 1e-9 * cost,
                "{loss:?} {:?} column {column}: {numeric} {analytic}",
                plan.unknowns.block_of(column).unwrap().name
            );
        }
    }
}

#[test]
fn losses_start_square_and_their_weights_are_their_slopes() {
    for loss in [Loss::Squared, Loss::Huber(1.3), Loss::Cauchy(2.0), Loss::Tukey(3.0)] {
        let (rho, weight) = loss.evaluate(1e-12);
        assert!((rho / 1e-12 - 1.0).abs() < 1e-6 && (weight - 1.0).abs() < 1e-6);
        for s in [0.2, 1.0, 2.5, 8.0, 30.0] {
            let h = 1e-6;
            let numeric = (loss.evaluate(s + h).0 - loss.evaluate(s - h).0) / (2.0 * h);
            assert!((numeric - loss.evaluate(s).1).abs() < 1e-7, "{loss:?} at {s}");
        }
    }
}

/// Every robust loss' weight and bend against numeric derivatives of its slope.
#[test]
fn bends_are_the_slopes_of_weights_and_never_make_the_curvature_negative() {
    for loss in [Loss::Squared, Loss::Huber(1.3), Loss::Cauchy(2.0), Loss::Tukey(3.0)] {
        for s in [0.0, 1e-9, 0.2, 1.0, 1.6, 2.5, 3.9, 8.0, 30.0, 1e20] {
            let (weight, bend) = loss.weight_and_bend(s);
            assert_eq!(weight, loss.evaluate(s).1);
            assert!(bend <= 0.0 && weight + bend * s >= -1e-12 * weight, "{loss:?} at {s}");
            let h = 1e-5 * (1.0 + s);
            let numeric =
                2.0 * (loss.evaluate(s + h).1 - loss.evaluate((s - h).max(0.0)).1) / (s + h - (s - h).max(0.0));
            if weight + numeric * s > 1e-6 {
                assert!((numeric - bend).abs() < 1e-4, "{loss:?} at {s}: {numeric} {bend}");
            }
        }
    }
}
