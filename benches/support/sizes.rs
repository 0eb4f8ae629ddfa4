//! Cells of several sizes for benches: arms that hold a board over cameras that look up, as in [`cellmap::simulate::paper_size`], in any number.
#![allow(dead_code)]

use std::collections::BTreeMap;
use std::path::Path;

use cellmap::frames::{FrameTree, Freedom};
use cellmap::geometry::pose::Twist;
use cellmap::geometry::{Pose, rotation};
use cellmap::layout::{Layout, Motion, parse_layout};
use cellmap::recording::{Recording, RobotMotion};
use cellmap::simulate::Disturbances;
use cellmap::simulate::{Cell, CornerNoise, corners, paper_size};
use cellmap::solve::{Plan, State};
use nalgebra::Vector3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// What a bench solves.
pub struct Problem {
    /// What the solver is told, as a layout file says it: the truth's poses as mere starts.
    pub text: String,
    pub layout: Layout,
    pub recording: Recording,
    /// The poses of what moves, by moving edge and configuration.
    pub moving: BTreeMap<(usize, u64), Pose>,
}

/// How large.
#[derive(Clone, Copy, Debug)]
pub struct Size {
    /// Places where robots share a board's space; the first robot of each is known.
    pub spaces: usize,
    /// Robots around each; with none, a board is moved by hand.
    pub robots: usize,
    /// Cameras below each.
    pub cameras: usize,
    /// Configurations in each.
    pub stops: u64,
    pub shots: u64,
    pub board: Board,
    /// Small checkerboards that stand still in each.
    pub plates: usize,
}

/// What robots and hands hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Board {
    /// 40 corners, partly out of sight in many pictures.
    Small,
    /// 64 corners, always in full view of every camera.
    Large,
}

impl Board {
    fn text(self) -> &'static str {
        match self {
            Self::Small => "charuco: {squares: [9, 6], square: 14, marker: 10, dictionary: 6x6_250}",
            Self::Large => "charuco: {squares: [9, 9], square: 11, marker: 8, dictionary: 6x6_250}",
        }
    }
}

/// The sizes by name, with their pictures and corners: `small` 250 and 10 000; `paper`, ten shots a stop, and `single`, one, 7500 and 480 000; `cell` 12 000 and
/// 305 000; `moving`, with 5000 unknown board poses, 20 000 and 610 000; `hall`, 20 robots and 40 cameras, 100 000 and 2 760 000; `floor`, 50 robots,
/// 100 cameras and 2000 plates that stand still, 4000.
pub fn size(name: &str) -> Option<Size> {
    use Board::{Large, Small};
    let of =
        |spaces, robots, cameras, stops, shots, board| Size { spaces, robots, cameras, stops, shots, board, plates: 0 };
    Some(match name {
        "small" => of(1, 1, 1, 25, 10, Small),
        "paper" => of(1, 1, 3, 250, 10, Large),
        "single" => of(1, 1, 3, 2500, 1, Large),
        "cell" => of(1, 3, 6, 2000, 1, Small),
        "moving" => of(1, 0, 4, 5000, 1, Small),
        "hall" => of(10, 2, 4, 2500, 1, Small),
        "floor" => Size { plates: 40, ..of(50, 1, 2, 40, 1, Small) },
        _ => return None,
    })
}

const MIDDLE: [f64; 6] = [0.3, -1.6, 1.7, -1.7, -1.57, 0.2];
/// Plates hang side by side, so many in a row.
const PLATE_COLUMNS: usize = 7;
/// How far the spaces are apart, m.
const APART: f64 = 5.0;

fn pose_text(pose: &Pose) -> String {
    let t = pose.translation * 1e3;
    let r = rotation::log(&pose.rotation) * 180.0 / std::f64::consts::PI;
    format!("xyz: [{:?}, {:?}, {:?}], rotvec: [{:?}, {:?}, {:?}]", t.x, t.y, t.z, r.x, r.y, r.z)
}

/// A problem of a size, with or without free lenses.
pub fn problem(size: Size, refine: bool) -> Problem {
    let (text, layout, board) = cell(size, refine);
    let (recording, moving) = record(&layout, size, &board);
    Problem { text, layout, recording, moving }
}

/// The layout, as text and read, and where the first board is in the middle of its space.
fn cell(size: Size, refine: bool) -> (String, Layout, Pose) {
    let paper = parse_layout(Path::new("paper.yaml"), &paper_size::truth(), None).expect("the layout is fine");
    let tree = FrameTree::new(&paper);
    let pose_of = |name: &str| {
        let ending = format!("_from_{name}");
        let edge = tree.static_edges.iter().find(|edge| edge.key.ends_with(&ending)).expect("the layout has it");
        edge.spec.pose().expect("the layout says where")
    };
    let Motion::Joints { chain, .. } = &paper.robots[0].motion else { panic!("the paper's robot has joints") };
    let flange = chain.base_from_flange(&MIDDLE);
    let board = flange * pose_of("board");
    let centre = Vector3::new(board.translation.x, board.translation.y, 0.0);
    // A turn about the vertical through the middle of the board's space.
    let about = |angle: f64| {
        let turn = Pose::from_rotation_vector(&Vector3::new(0.0, 0.0, angle));
        Pose::from_translation(centre.x, centre.y, 0.0) * turn * Pose::from_translation(-centre.x, -centre.y, 0.0)
    };
    let mut text = String::from("cellmap: 1\nunits: {length: mm, angle: deg}\nworld: hall\ncameras:\n");
    let lens = "{model: brown, size: [1280, 720], focal: [920, 919], centre: [640.2, 359.7], distortion: [0.05, -0.1, 0.0005, -0.0003, 0.01]}";
    let refine = if refine { "refine: [focal, centre, distortion], " } else { "" };
    let space_at = |space: usize| Pose::from_translation(APART * space as f64, 0.0, 0.0);
    for space in 0..size.spaces {
        for camera in 0..size.cameras {
            let own = pose_of(["cam1", "cam2", "cam3"][camera % 3]);
            let pose = space_at(space) * about((camera / 3) as f64 * 1.1) * own;
            // A board that is moved by hand shows only how cameras stand to each other: one of them is known.
            let known = if size.robots == 0 && camera == 0 { "" } else { ", start: true" };
            text += &format!(
                "  eye{space}_{camera}: {{intrinsics: {lens}, {refine}pose: {{{}{known}}}}}\n",
                pose_text(&pose)
            );
        }
    }
    let mut robots = Vec::new();
    for space in 0..size.spaces {
        for robot in 0..size.robots {
            robots.push(space);
            if robot == 0 && space == 0 {
                text += "robots:\n";
            }
            let pose = space_at(space) * about(robot as f64 * 2.1);
            let known = if robot == 0 { "" } else { ", start: true" };
            text += &format!(
                "  arm{space}_{robot}: {{model: ur3, joints: joints.csv, pose: {{{}{known}}}}}\n",
                pose_text(&pose)
            );
        }
    }
    text += "targets:\n";
    if size.robots == 0 {
        text += &format!("  board: {{{}, moves: true}}\n", size.board.text());
    }
    for (index, space) in robots.iter().enumerate() {
        let robot = index - space * size.robots;
        text += &format!(
            "  board{space}_{robot}: {{{}, mount: arm{space}_{robot}.flange, pose: {{{}, start: true}}}}\n",
            size.board.text(),
            pose_text(&pose_of("board"))
        );
    }
    for space in 0..size.spaces {
        for plate in 0..size.plates {
            let (column, row) = (plate % PLATE_COLUMNS, plate / PLATE_COLUMNS);
            let aside = Pose::from_translation(-0.06 + 0.034 * column as f64, -0.06 + 0.034 * row as f64, 0.01);
            let pose = space_at(space) * board * aside;
            text += &format!(
                "  plate{space}_{plate}: {{checkerboard: {{corners: [4, 3], square: 6}}, pose: {{{}, start: true}}}}\n",
                pose_text(&pose)
            );
        }
    }
    text += "solve: {loss: squared, pixel_sigma: 0.1}\n";
    let layout = parse_layout(Path::new("layout.yaml"), &text, None).unwrap_or_else(|e| panic!("{e}\n{text}"));
    (text, layout, board)
}

/// Spaces are alike and see nothing of each other, so each is recorded as if it were alone.
fn record(layout: &Layout, size: Size, board: &Pose) -> (Recording, BTreeMap<(usize, u64), Pose>) {
    let mut random = ChaCha8Rng::seed_from_u64(7500);
    let mut joints: Vec<BTreeMap<u64, Vec<f64>>> = vec![BTreeMap::new(); size.spaces * size.robots];
    let mut moving = BTreeMap::new();
    let (_, alone, _) = cell(Size { spaces: 1, ..size }, false);
    let mut rows = Vec::new();
    for space in 0..size.spaces {
        let ids: Vec<u64> = (1..=size.stops).map(|stop| space as u64 * size.stops + stop).collect();
        let mut own: Vec<BTreeMap<u64, Vec<f64>>> = vec![BTreeMap::new(); size.robots];
        for (stop, &id) in ids.iter().enumerate() {
            let mut stray = |reach: f64| random.random_range(-reach..reach);
            if size.robots == 0 {
                let d: [f64; 6] = std::array::from_fn(|i| stray(if i < 3 { 0.1 } else { 0.4 }));
                moving.insert((0, id), *board * Pose::exp(&Twist::from(d)));
            } else {
                // They take turns.
                let robot = stop % size.robots;
                let reach = if size.board == Board::Large { 0.45 } else { 0.35 };
                let mut draw = || MIDDLE.iter().map(|q| q + stray(reach)).collect::<Vec<f64>>();
                let mut place = draw();
                while size.board == Board::Large && !in_full_view(&alone, robot, &place) {
                    place = draw();
                }
                own[robot].insert(id, place);
            }
        }
        let there =
            Recording { motions: own.iter().cloned().map(RobotMotion::Joints).collect(), ..Recording::default() };
        let mut one = Cell::new(&alone, &there);
        one.disturbances = Disturbances { moving: moving.clone(), ..Disturbances::default() };
        for shot in 0..size.shots {
            let found = corners(&one, &ids, CornerNoise { pixel_sigma: 0.1, seed: 1 + shot });
            rows.extend(found.into_iter().map(|mut row| {
                row.shot = shot;
                row.camera += space * size.cameras;
                row.target = match row.target.checked_sub(size.robots).filter(|_| size.robots > 0) {
                    Some(plate) => size.spaces * size.robots + space * size.plates + plate,
                    None => space * size.robots + row.target,
                };
                row
            }));
        }
        for (robot, own) in own.into_iter().enumerate() {
            joints[space * size.robots + robot] = own;
        }
    }
    assert_eq!(joints.len(), layout.robots.len());
    let motions = joints.into_iter().map(RobotMotion::Joints).collect();
    (Recording { motions, corners: rows.into(), ..Recording::default() }, moving)
}

/// Whether every camera sees every corner of what the only robot holds.
fn in_full_view(layout: &Layout, robot: usize, joints: &[f64]) -> bool {
    assert_eq!(layout.robots.len(), 1, "a full view is asked for where there is one robot");
    let mut motions = vec![RobotMotion::Joints(BTreeMap::new()); layout.robots.len()];
    motions[robot] = RobotMotion::Joints(BTreeMap::from([(1, joints.to_vec())]));
    let recording = Recording { motions, ..Recording::default() };
    let seen = corners(&Cell::new(layout, &recording), &[1], CornerNoise { pixel_sigma: 0.0, seed: 0 });
    seen.len() == 64 * layout.cameras.len()
}

/// A direction that depends on a number.
fn direction(number: f64) -> Vector3<f64> {
    Vector3::new(number.sin(), (1.7 * number).cos(), (2.3 * number).sin()).normalize()
}

fn displaced(pose: &Pose, number: f64) -> Pose {
    let (t, r) = (0.05 * direction(number + 0.3), 3f64.to_radians() * direction(number + 1.1));
    *pose * Pose::exp(&Twist::new(t.x, t.y, t.z, r.x, r.y, r.z))
}

/// Every unknown pose 50 mm and 3 degrees from the truth.
pub fn wrong_start(problem: &Problem, tree: &FrameTree, plan: &Plan) -> State {
    let layout = &problem.layout;
    let pose = |(i, edge): (usize, &cellmap::frames::StaticEdge)| {
        let truth = edge.spec.pose().unwrap_or_default();
        if edge.freedom == Freedom::Pose { displaced(&truth, i as f64) } else { truth }
    };
    let moving = |edge: usize| {
        let one = |(i, id): (usize, &u64)| {
            problem.moving.get(&(edge, *id)).map_or(Pose::identity(), |truth| displaced(truth, i as f64))
        };
        plan.configurations.iter().enumerate().map(one).collect()
    };
    State {
        static_poses: tree.static_edges.iter().enumerate().map(pose).collect(),
        moving_poses: (0..plan.moving_count()).map(moving).collect(),
        corrections: layout.robots.iter().map(|_| Vec::new()).collect(),
        lenses: layout
            .cameras
            .iter()
            .map(|c| c.intrinsics.as_ref().map_or([0.0; 12], |lens| *lens.parameters()))
            .collect(),
    }
}
