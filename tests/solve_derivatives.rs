//! Derivatives of every kind of measurement and belief to every kind of unknown, through every lens and every kind of joint: against numeric ones at random
//! places, at rest (all angles zero) and next to where formulas divide by little; and the condensed equations against sums over single rows.

#[path = "support/explicit.rs"]
mod explicit;

use std::collections::BTreeMap;

use cellmap::frames::{FrameTree, Freedom, Step};
use cellmap::geometry::pose::Twist;
use cellmap::geometry::{Feature, Pose};
use cellmap::layout::{Layout, parse_layout};
use cellmap::recording::{ContactRow, CornerRow, PointRow, PoseRow, Recording, RobotMotion};
use cellmap::solve::{Assembler, Loss, Normal, Plan, Priors, State};
use explicit::Explicit;
use nalgebra::{DMatrix, DVector, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const LENSES: [(&str, &str); 4] = [
    ("pinhole", "focal, centre"),
    ("brown, distortion: [0.1, -0.2, 0.001, -0.002, 0.05]", "focal, centre, distortion"),
    ("rational, distortion: [0.1, 0.02, 0.001, -0.001, 0.01, 0.2, 0.03, 0.001]", "focal, centre, distortion"),
    ("kannala_brandt, distortion: [0.01, -0.01, 0.004, 0.001]", "focal, centre, distortion"),
];

const MODELS: [&str; 3] = ["{mdh: mdh.yaml}", "{dh: dh.yaml}", "{urdf: arm.urdf, base: base, tip: c}"];

const JOINTS: &str = "
  - {alpha: 0.3, a: 0.1, theta: 0.2, d: 0.05, type: prismatic}
  - {alpha: -1.5, a: 0.05, theta: 0.1, d: 0.2}
  - {alpha: 1.2, a: 0.3, theta: -0.4, d: 0.02}
";

const URDF: &str = "<robot name=\"r\"><link name=\"base\"/><link name=\"a\"/><link name=\"b\"/><link name=\"c\"/>
<joint name=\"1\" type=\"prismatic\"><parent link=\"base\"/><child link=\"a\"/><origin xyz=\"0.1 0 0.2\" rpy=\"0.1 0.2 0.3\"/><axis xyz=\"0.6 0 0.8\"/><limit effort=\"1\" velocity=\"1\" lower=\"-1\" upper=\"1\"/></joint>
<joint name=\"2\" type=\"revolute\"><parent link=\"a\"/><child link=\"b\"/><origin xyz=\"0 0.2 0\" rpy=\"-0.3 0 0\"/><axis xyz=\"0 0.6 0.8\"/><limit effort=\"1\" velocity=\"1\" lower=\"-3\" upper=\"3\"/></joint>
<joint name=\"3\" type=\"continuous\"><parent link=\"b\"/><child link=\"c\"/><origin xyz=\"0 0 0.3\" rpy=\"0 0 1\"/><axis xyz=\"1 0 0\"/></joint>
</robot>";

const CONFIGURATIONS: u64 = 3;

/// A cell with every kind of sensor, target and unknown; the camera `eye` looks along z from the origin, the robot stands two metres before it.
fn layout((model, refine): (&str, &str), robot: &str) -> Layout {
    let folder = tempfile::tempdir().unwrap();
    for convention in ["mdh", "dh"] {
        let text =
            format!("cellmap_robot: 1\nunits: {{length: m, angle: rad}}\nconvention: {convention}\njoints:{JOINTS}");
        std::fs::write(folder.path().join(format!("{convention}.yaml")), text).unwrap();
    }
    std::fs::write(folder.path().join("arm.urdf"), URDF).unwrap();
    let lens = format!(
        "intrinsics: {{model: {model}, size: [1280, 960], focal: [900, 905], centre: [640, 479]}}, refine: [{refine}]"
    );
    let text = format!(
        "
cellmap: 1
units: {{length: m, angle: rad}}
world: bench
cameras:
  eye: {{{lens}, pose: {{xyz: [0, 0, 0], rpy: [0, 0, 0], start: true}}}}
  wrist: {{{lens}, mount: arm.flange, pose: {{xyz: [0, 0.05, 0], rpy: [0.1, 0, 0], start: true}}}}
sensors:
  tracker: {{measures: points, pose: {{xyz: [0, 0, 0], rpy: [0, 0, 0], start: true}}}}
robots:
  arm:
    model: {robot}
    joints: joints.csv
    pose: {{xyz: [0, 0, 2], rpy: [0, 0, 0], sigma: {{xyz: 0.5, rotation: 1}}}}
    identify: {{joint_offsets: {{sigma: 1}}, lengths: {{sigma: 1}}, angles: {{sigma: 1}}}}
    repeatability: {{xyz: 0.003, rotation: 0.01}}
targets:
  plate:
    tags: {{dictionary: 6x6_250, grid: {{columns: 2, rows: 2, size: 0.1, gap: 0.02, first_id: 0}}}}
    mount: arm.flange
    pose: {{xyz: [0, 0, 0.1], rpy: [0, 0, 0], start: true}}
  dot: {{tags: {{dictionary: 6x6_250, size: 0.1, ids: [10]}}, pose: {{xyz: [0.05, -0.05, 1.5], rpy: [0, 0, 0], start: true}}}}
  pallet: {{tags: {{dictionary: 6x6_250, size: 0.1, ids: [20, 21]}}, geometry: unknown, pose: {{xyz: [0.1, 0.1, 1.8], rpy: [0, 0, 0], start: true}}}}
  wall: {{tags: {{dictionary: 6x6_250, size: 0.2, ids: [30]}}, pose: {{xyz: [0.2, 0.4, 5], rpy: [0, 0, 0], start: true}}}}
  wand: {{checkerboard: {{corners: [3, 2], square: 0.05}}, moves: true}}
  tool: {{points: {{tip: unknown}}, mount: arm.flange, pose: {{xyz: [0, 0.01, 0.02], rpy: [0, 0, 0], start: true}}}}
  post: {{points: {{top: [0.02, 0.0, 0.3]}}, pose: {{xyz: [0.3, 0.1, 1.5], rpy: [0, 0, 0], sigma: {{xyz: 1, rotation: 1}}}}}}
solve: {{pixel_sigma: 0.3, point_sigma: 0.001, pose_sigma: {{xyz: 0.004, rotation: 0.02}}, contact_sigma: 0.002}}
"
    );
    parse_layout(&folder.path().join("cell.yaml"), &text, None).unwrap_or_else(|e| panic!("{e}"))
}

/// Where the derivatives are looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
enum At {
    Random,
    /// Every angle, joint value and correction zero; a corner on the axis of the lens.
    Rest,
    /// Measured and expected poses nearly half a turn away, points that nearly touch, a corner next to the axis of the lens.
    NearlySingular,
}

/// Any value within reach, or zero.
fn stray(random: &mut ChaCha8Rng, reach: f64) -> f64 {
    if reach > 0.0 { random.random_range(-reach..reach) } else { 0.0 }
}

fn twist(random: &mut ChaCha8Rng, reach: f64) -> Pose {
    Pose::exp(&Twist::from_fn(|_, _| stray(random, reach)))
}

fn state(layout: &Layout, tree: &FrameTree, at: At, random: &mut ChaCha8Rng) -> State {
    let reach: f64 = if at == At::Random { 0.1 } else { 0.0 };
    let tiny: f64 = if at == At::Rest { 0.0 } else { 1e-9 };
    let mut static_poses: Vec<Pose> =
        tree.static_edges.iter().map(|edge| edge.spec.pose().unwrap_or_default()).collect();
    for (pose, edge) in static_poses.iter_mut().zip(&tree.static_edges) {
        *pose = match edge.freedom {
            Freedom::Pose => *pose * twist(random, reach.max(tiny)),
            Freedom::Translation => {
                *pose * Pose::from_translation(stray(random, reach), stray(random, reach), stray(random, reach))
            }
            Freedom::Fixed => *pose,
        };
    }
    let mut draw = |reach: f64| (0..CONFIGURATIONS).map(|_| twist(random, reach)).collect::<Vec<_>>();
    let wand = draw(reach).into_iter().map(|stray| Pose::from_translation(-0.1, 0.05, 1.3) * stray).collect();
    let stops = draw((0.05 * reach).max(tiny));
    State {
        static_poses,
        moving_poses: vec![wand, stops],
        corrections: vec![(0..12).map(|_| stray(random, 0.2 * reach)).collect()],
        lenses: layout.cameras.iter().map(|camera| *camera.intrinsics.as_ref().unwrap().parameters()).collect(),
    }
}

fn joints(at: At, random: &mut ChaCha8Rng) -> Recording {
    let reach = if at == At::Random { 0.4 } else { 0.0 };
    let values = (1..=CONFIGURATIONS).map(|id| (id, (0..3).map(|_| stray(random, reach)).collect()));
    Recording { motions: vec![RobotMotion::Joints(BTreeMap::from_iter(values))], ..Recording::default() }
}

/// `from_from_to` at a state.
fn pose_at(
    layout: &Layout,
    tree: &FrameTree,
    shadow: &Recording,
    state: &State,
    from: usize,
    to: usize,
    id: u64,
) -> Pose {
    tree.path(from, to).steps.iter().fold(Pose::identity(), |pose, step| {
        let (value, inverse) = match *step {
            Step::Static { edge, inverse } => (state.static_poses[edge], inverse),
            Step::Moving { edge, inverse } => (state.moving_poses[edge][id as usize - 1], inverse),
            Step::Robot { robot, from, to, inverse } => {
                (shadow.robot_segment(layout, robot, id, from, to).unwrap(), inverse)
            }
        };
        pose * if inverse { value.inverse() } else { value }
    })
}

/// What was measured: every camera sees every corner of what is before it, tens of pixels from where the state would have it.
fn record(
    layout: &Layout,
    tree: &FrameTree,
    shadow: Recording,
    state: &State,
    at: At,
    random: &mut ChaCha8Rng,
) -> Recording {
    let mut recording = shadow.clone();
    let mut rows = Vec::new();
    let pose = |from, to, id| pose_at(layout, tree, &shadow, state, from, to, id);
    for (configuration, camera) in (1..=CONFIGURATIONS).flat_map(|id| [(id, 0), (id, 1)]) {
        let seen: &[(usize, &[u32])] =
            if camera == 0 { &[(0, &[0, 1, 2, 3]), (1, &[10]), (2, &[20, 21]), (4, &[0])] } else { &[(3, &[30])] };
        for &(target, ids) in seen {
            let features = ids.iter().flat_map(|id| {
                let board = (0..6).map(Feature::BoardCorner).filter(|_| target == 4);
                (0..4).map(|corner| Feature::TagCorner(*id, corner)).filter(|_| target != 4).chain(board)
            });
            for feature in features {
                let (frame, place) = tree.locate(layout, target, &feature).unwrap();
                let point = pose(tree.cameras[camera], frame, configuration) * place;
                let lens = layout.cameras[camera].intrinsics.as_ref().unwrap();
                let pixel = lens.project(&point).unwrap_or_else(|| panic!("camera {camera} cannot see {point:?}"));
                let pixel = [pixel.x + stray(random, 30.0), pixel.y + stray(random, 30.0)];
                // One shot with a covariance of its own and one without, at other pixels: both are of one block.
                for (shot, covariance) in [(0, Some([0.3, 0.1, 0.2])), (1, None)] {
                    let pixel = pixel.map(|x| x + 2.0 * shot as f64);
                    let feature = feature.clone();
                    rows.push(CornerRow { configuration, shot, camera, target, feature, pixel, covariance });
                }
            }
        }
    }
    recording.corners = rows.into();
    for configuration in 1..=CONFIGURATIONS {
        let seen = pose(tree.cameras[0], tree.targets[0], configuration);
        let turn = if at == At::NearlySingular { std::f64::consts::PI - 1e-2 } else { 0.3 };
        let away = Pose::exp(&Twist::new(0.01, -0.004, 0.002, 0.6 * turn, 0.0, 0.8 * turn));
        recording.poses.push(PoseRow { configuration, shot: 0, camera: 0, target: 0, pose: seen * away });
        let (tip, top) = (Feature::Point("tip".into()), Feature::Point("top".into()));
        let (frame, _) = tree.locate(layout, 5, &tip).unwrap();
        let position = pose(tree.sensors[0], frame, configuration).translation + Vector3::new(0.01, -0.02, 0.03);
        let feature = tip.clone();
        recording.points.push(PointRow { configuration, shot: 0, sensor: 0, target: 5, feature, position });
        for distance in [0.0, 0.4] {
            let points = [(5, tip.clone()), (6, top.clone())];
            recording.contacts.push(ContactRow { configuration, points, distance });
        }
    }
    recording
}

/// Puts the post's top a millimetre from the tool's tip (no joint moves), and the post nearly half a turn from where it is expected.
fn nearly_touch(layout: &Layout, tree: &FrameTree, shadow: &Recording, state: &mut State) {
    let (tip, _) = tree.locate(layout, 5, &Feature::Point("tip".into())).unwrap();
    let tip = pose_at(layout, tree, shadow, state, 0, tip, 1).translation;
    let post = tree.static_edges.iter().position(|edge| edge.key == "world_from_post").unwrap();
    let turn = Pose::from_rotation_vector(&(Vector3::new(0.6, 0.0, 0.8) * (std::f64::consts::PI - 1e-2)));
    let top = turn * Vector3::new(0.02, 0.0, 0.3);
    let place = tip + Vector3::new(8e-4, 0.0, 6e-4) - top;
    state.static_poses[post] = Pose::from_translation(place.x, place.y, place.z) * turn;
}

/// A layout, what is measured in it, and where: through every lens and every kind of robot.
fn everywhere(mut look: impl FnMut(&Explicit<'_>, &State, &str)) {
    for (number, lens) in LENSES.into_iter().enumerate() {
        for model in MODELS {
            let layout = layout(lens, model);
            let tree = FrameTree::new(&layout);
            for at in [At::Random, At::Rest, At::NearlySingular] {
                let mut random = ChaCha8Rng::seed_from_u64(number as u64);
                let mut state = state(&layout, &tree, at, &mut random);
                let shadow = joints(at, &mut random);
                if at == At::NearlySingular {
                    nearly_touch(&layout, &tree, &shadow, &mut state);
                }
                let recording = record(&layout, &tree, shadow, &state, at, &mut random);
                let plan = Plan::new(&layout, &tree, &recording).unwrap();
                assert_eq!((plan.moving_edges, plan.stops.len()), (1, 1));
                // Corners of six bodies, poses, points, contacts.
                assert_eq!(plan.groups.len(), 9, "{:?}", plan.groups.iter().map(|g| g.kind).collect::<Vec<_>>());
                let name = format!("{} {model} {at:?}", lens.0);
                let (layout, tree, recording, plan) = (&layout, &tree, &recording, &plan);
                look(&Explicit { layout, tree, recording, plan, priors: true }, &state, &name);
            }
        }
    }
}

/// The five-point rule, whose error is of fourth order.
fn slope(at: impl Fn(f64) -> Vec<f64>, h: f64) -> Vec<f64> {
    let [far_down, down, up, far_up] = [-2.0, -1.0, 1.0, 2.0].map(|steps| at(steps * h));
    let one = |i: usize| (8.0 * (up[i] - down[i]) - (far_up[i] - far_down[i])) / (12.0 * h);
    (0..up.len()).map(one).collect()
}

#[test]
fn every_row_has_its_numeric_derivative() {
    everywhere(|explicit, state, name| {
        let values = |state: &State| -> Vec<f64> {
            explicit.rows(state).iter().flat_map(|rows| rows.rows.iter().map(|row| row.value)).collect()
        };
        let rows = explicit.rows(state);
        let rows: Vec<_> = rows.iter().flat_map(|rows| &rows.rows).collect();
        let units = explicit.units();
        let mut largest = vec![0f64; units.len()];
        for (column, unit) in units.iter().enumerate() {
            let numeric = slope(|by| values(&explicit.moved(state, column, by)), 2e-3 * unit);
            for (row, numeric) in rows.iter().zip(numeric) {
                let analytic = row.slopes[column];
                largest[column] = largest[column].max(analytic.abs());
                // Against the steepest slope of the row, all counted in units; what rounding leaves of a difference of large values.
                let steepest = row.slopes.iter().zip(&units).map(|(s, unit)| (s * unit).abs()).fold(0.0, f64::max);
                let off = (numeric - analytic).abs() * unit;
                let rounding = 1e-12 * (1e3 + row.value.abs());
                assert!(
                    off < 1e-6 * steepest + rounding / 2e-3,
                    "{name} column {column}: {numeric} {analytic} of {steepest}"
                );
            }
        }
        // Every unknown is seen by something, so nothing above was zero against zero only.
        assert!(largest.iter().all(|slope| *slope > 0.0), "{name}: {largest:?}");
    });
}

fn close(found: &DMatrix<f64>, expected: &DMatrix<f64>, sizes: &DVector<f64>, digits: f64, what: &str) {
    assert_eq!(found.shape(), expected.shape());
    for ((i, j), expected) in
        (0..found.nrows()).flat_map(|i| (0..found.ncols()).map(move |j| (i, j))).map(|at| (at, expected[at]))
    {
        let scale = (sizes[i] * if found.ncols() == 1 { 1.0 } else { sizes[j] }).sqrt();
        let found = found[(i, j)];
        assert!((found - expected).abs() <= digits * scale, "{what} at {i}, {j}: {found} {expected} of {scale}");
    }
}

#[test]
fn condensed_equations_are_the_sums_over_single_rows_under_every_loss() {
    everywhere(|explicit, state, name| {
        let plain = explicit.sums(state, Loss::Squared);
        for loss in [Loss::Squared, Loss::Huber(30.0), Loss::Cauchy(50.0), Loss::Tukey(300.0)] {
            let sums = explicit.sums(state, loss);
            let priors = Priors::new(explicit.tree, &explicit.plan.unknowns);
            let mut assembler = Assembler::new(explicit.layout, explicit.recording, explicit.plan, priors);
            assembler.set_loss(loss);
            let mut normal = Normal::default();
            let cost = assembler.linearise(state, &mut normal);
            let n = explicit.plan.unknowns.count;
            // Two metres away, a millimetre between points is known to 1e-12 of itself at best.
            let digits = if name.ends_with("NearlySingular") { 1e-10 } else { 1e-12 };
            let name = format!("{name} {loss:?}");
            assert!((cost - sums.cost).abs() < 1e-12 * cost, "{name}: {cost} {}", sums.cost);
            let again = assembler.cost(state);
            assert!((cost - again).abs() < 1e-12 * cost, "{name}: {cost} {again}");
            let hessian = DMatrix::from_row_slice(n, n, &normal.hessian);
            let expected = sums.hessian.view((0, 0), (n, n)).into_owned();
            // A weight next to zero is known to as many digits as its residual, not as itself: what would be there with weight one is the measure.
            let sizes = plain.hessian.diagonal().rows(0, n).into_owned();
            close(&hessian, &expected, &sizes, digits, &name);
            // Whole residuals cancel in a gradient, so it is measured against their size.
            let gradient = DMatrix::from_column_slice(n, 1, &normal.gradient);
            let expected = sums.gradient.rows(0, n).into_owned();
            close(
                &gradient,
                &DMatrix::from_column_slice(n, 1, expected.as_slice()),
                &(sizes * 2.0 * plain.cost),
                digits,
                &name,
            );
        }
    });
}

#[test]
fn what_is_unknown_at_one_configuration_is_eliminated_exactly() {
    everywhere(|explicit, state, name| {
        let explicit = Explicit { priors: false, ..*explicit };
        let sums = explicit.sums(state, Loss::Squared);
        let mut assembler = Assembler::new(explicit.layout, explicit.recording, explicit.plan, Priors::default());
        assembler.set_loss(Loss::Squared);
        let terms = assembler.terms(state);
        let (n, all) = (explicit.plan.unknowns.count, explicit.columns());
        let local =
            sums.hessian.view((n, n), (all - n, all - n)).into_owned().cholesky().expect("all that moves is seen");
        let across = sums.hessian.view((n, 0), (all - n, n)).into_owned();
        let whole = sums.hessian.view((0, 0), (n, n)).into_owned();
        let expected = &whole - across.transpose() * local.solve(&across);
        let found = DMatrix::from_row_slice(n, n, &terms.information(n));
        close(&found, &expected, &whole.diagonal(), 1e-10, name);
        let expected = sums.gradient.rows(0, n) - across.transpose() * local.solve(&sums.gradient.rows(n, all - n));
        let mut found = DMatrix::zeros(n, 1);
        for term in terms.configurations.iter().chain(&terms.corners) {
            term.columns.iter().zip(term.gradient.iter()).for_each(|(column, g)| found[(*column, 0)] += g);
        }
        let sizes = whole.diagonal() * 2.0 * sums.cost;
        close(&found, &DMatrix::from_column_slice(n, 1, expected.as_slice()), &sizes, 1e-10, name);
    });
}
