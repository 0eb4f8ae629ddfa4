//! Base and tool values as robot controllers want them.
//!
//! | maker | position | orientation |
//! |---|---|---|
//! | Universal Robots | m | rotation vector, rad |
//! | KUKA | mm | A, B, C in degrees: `Rz(A) Ry(B) Rx(C)` (turns about z, then the new y, then the newest x) |
//! | ABB | mm | unit quaternion, w first |
//! | FANUC | mm | W, P, R in degrees about the fixed x, y, z: `Rz(R) Ry(P) Rx(W)` |
//!
//! A *tool* is the pose of something in the flange, a *base* that of something in the robot's base. Flange and base are those of the robot model: a
//! model whose last frame is not the controller's flange gives tools that differ by what lies between.

use super::Format;
use super::camera_info::FilesAndNotes;
use super::cell::Cell;
use super::text::{number, numbers};
use crate::complaint::{Complaint, InputError};
use crate::geometry::{Pose, rotation};

/// Universal Robots' pose: x, y, z (m), rotation vector (rad).
#[must_use]
pub fn ur_pose(pose: &Pose) -> [f64; 6] {
    let (t, r) = (pose.translation, rotation::log(&pose.rotation));
    [t.x, t.y, t.z, r.x, r.y, r.z]
}

/// KUKA's frame: X, Y, Z (mm), A, B, C (deg).
#[must_use]
pub fn kuka_frame(pose: &Pose) -> [f64; 6] {
    let (t, [roll, pitch, yaw]) = (pose.translation * 1e3, rotation::to_rpy(&pose.rotation).map(f64::to_degrees));
    [t.x, t.y, t.z, yaw, pitch, roll]
}

/// ABB's orientation: q1 to q4, w first, w not negative.
#[must_use]
pub fn abb_orientation(pose: &Pose) -> [f64; 4] {
    let q = pose.rotation.quaternion();
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    [q.w, q.i, q.j, q.k].map(|value| sign * value)
}

/// FANUC's position: X, Y, Z (mm), W, P, R (deg).
#[must_use]
pub fn fanuc_pose(pose: &Pose) -> [f64; 6] {
    let (t, [roll, pitch, yaw]) = (pose.translation * 1e3, rotation::to_rpy(&pose.rotation).map(f64::to_degrees));
    [t.x, t.y, t.z, roll, pitch, yaw]
}

/// What one robot's controller is told.
struct RobotValues {
    robot: String,
    tools: Vec<(String, Pose)>,
    bases: Vec<(String, Pose)>,
}

fn values(cell: &Cell<'_>) -> Vec<RobotValues> {
    let things: Vec<usize> =
        cell.tree.cameras.iter().chain(&cell.tree.sensors).chain(&cell.tree.targets).copied().collect();
    let mut all = Vec::new();
    for (robot, frames) in cell.layout.robots.iter().zip(&cell.tree.robots) {
        let (Some(&base), Some(&flange)) = (frames.first(), frames.last()) else { continue };
        let seen_from = |from: usize, others: &[usize]| -> Vec<(String, Pose)> {
            let frames = things.iter().chain(others).filter(|frame| **frame != from && cell.has(**frame));
            frames
                .filter_map(|frame| Some((cell.tree.frames[*frame].name.clone(), cell.between(from, *frame)?)))
                .collect()
        };
        let other_bases: Vec<usize> = cell
            .tree
            .robots
            .iter()
            .filter_map(|frames| frames.first().copied())
            .filter(|frame| *frame != base)
            .collect();
        let mut bases = seen_from(base, &other_bases);
        if let (Some(pose), false) = (cell.between(base, 0), bases.iter().any(|(name, _)| *name == cell.layout.world)) {
            bases.insert(0, ("world".to_owned(), pose));
        }
        all.push(RobotValues { robot: robot.name.clone(), tools: seen_from(flange, &[]), bases });
    }
    all
}

pub(super) fn file(cell: &Cell<'_>, format: Format) -> Result<FilesAndNotes, InputError> {
    let all = values(cell);
    if all.is_empty() {
        let what = "the cell has no robot whose controller could be told anything";
        return Err(Complaint::of(&cell.layout.file, what, "add the robot to `robots`").into());
    }
    let (name, text) = match format {
        Format::Ur => ("cell.script", ur(&all)),
        Format::Kuka => ("cell.dat", kuka(&all)),
        Format::Abb => ("cellmap.mod", abb(&all)),
        _ => ("cell_fanuc.txt", fanuc(&all)),
    };
    Ok((vec![(name.to_owned(), text)], Vec::new()))
}

/// A name that a controller's language takes: letters, digits and `_`, no longer than `most`.
fn identifier(robot: &str, thing: &str, most: usize) -> String {
    let plain =
        |text: &str| -> String { text.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect() };
    let mut name = format!("{}_{}", plain(robot), plain(thing));
    if name.starts_with(|c: char| c.is_ascii_digit()) {
        name.insert(0, 'c');
    }
    name.truncate(most);
    name.trim_end_matches('_').to_owned()
}

/// Names that no two things share, cut to the language's length.
fn named<'a>(
    robot: &str,
    entries: &'a [(String, Pose)],
    prefix: &str,
    most: usize,
) -> Vec<(String, &'a str, &'a Pose)> {
    let mut taken: Vec<String> = Vec::new();
    let mut all = Vec::new();
    for (thing, pose) in entries {
        let mut name = identifier(&format!("{prefix}{robot}"), thing, most);
        let mut count = 2;
        while taken.contains(&name) {
            name = format!("{}{count}", identifier(&format!("{prefix}{robot}"), thing, most - 2));
            count += 1;
        }
        taken.push(name.clone());
        all.push((name, thing.as_str(), pose));
    }
    all
}

fn ur(all: &[RobotValues]) -> String {
    let mut text = format!(
        "# Written by cellmap {}. p[x, y, z, rx, ry, rz]: metres, rotation vector in radians.\n",
        crate::VERSION
    );
    for one in all {
        text.push_str(&format!("# {}: tools in the flange, for set_tcp()\n", one.robot));
        for (name, _, pose) in named(&one.robot, &one.tools, "tcp_", 60) {
            text.push_str(&format!("global {name} = p[{}]\n", numbers(&ur_pose(pose), ", ")));
        }
        text.push_str(&format!("# {}: features in the robot's base\n", one.robot));
        for (name, _, pose) in named(&one.robot, &one.bases, "base_", 60) {
            text.push_str(&format!("global {name} = p[{}]\n", numbers(&ur_pose(pose), ", ")));
        }
    }
    text
}

fn kuka(all: &[RobotValues]) -> String {
    let mut text = format!(
        "; Written by cellmap {}. X Y Z in mm; A B C in degrees about z, y', x''.\n; Copy a tool into TOOL_DATA[n] and a base into BASE_DATA[n]. Bases are in $ROBROOT.\n",
        crate::VERSION
    );
    let frame = |pose: &Pose| {
        let values = kuka_frame(pose).map(number);
        let keys = ["X", "Y", "Z", "A", "B", "C"];
        keys.iter().zip(values).map(|(key, value)| format!("{key} {value}")).collect::<Vec<_>>().join(",")
    };
    for one in all {
        text.push_str(&format!("; {}: tools in the flange\n", one.robot));
        for (name, thing, pose) in named(&one.robot, &one.tools, "T_", 24) {
            text.push_str(&format!("DECL GLOBAL FRAME {name}={{{}}} ; {thing}\n", frame(pose)));
        }
        text.push_str(&format!("; {}: bases\n", one.robot));
        for (name, thing, pose) in named(&one.robot, &one.bases, "B_", 24) {
            text.push_str(&format!("DECL GLOBAL FRAME {name}={{{}}} ; {thing}\n", frame(pose)));
        }
    }
    text
}

fn abb(all: &[RobotValues]) -> String {
    let mut text = format!(
        "MODULE cellmap\n  ! Written by cellmap {}. Millimetres, unit quaternions with w first.\n  ! The loads are place holders: set mass and centre of gravity.\n",
        crate::VERSION
    );
    let pose_text = |pose: &Pose| {
        let t = (pose.translation * 1e3).map(|value| value);
        format!("[[{}],[{}]]", numbers(t.as_slice(), ","), numbers(&abb_orientation(pose), ","))
    };
    for one in all {
        text.push_str(&format!("  ! {}: tools in the flange\n", one.robot));
        for (name, _, pose) in named(&one.robot, &one.tools, "t_", 32) {
            let frame = pose_text(pose);
            text.push_str(&format!("  PERS tooldata {name} := [TRUE,{frame},[1,[0,0,1],[1,0,0,0],0,0,0]];\n"));
        }
        text.push_str(&format!("  ! {}: work objects in the robot's base\n", one.robot));
        for (name, _, pose) in named(&one.robot, &one.bases, "w_", 32) {
            let frame = pose_text(pose);
            text.push_str(&format!("  PERS wobjdata {name} := [FALSE,TRUE,\"\",{frame},[[0,0,0],[1,0,0,0]]];\n"));
        }
    }
    text.push_str("ENDMODULE\n");
    text
}

fn fanuc(all: &[RobotValues]) -> String {
    let mut text = format!(
        "# Written by cellmap {}. X Y Z in mm; W P R in degrees about the fixed x, y, z axes.\n",
        crate::VERSION
    );
    let mut table = |title: String, entries: &[(String, Pose)]| {
        text.push_str(&title);
        for (thing, pose) in entries {
            let values = fanuc_pose(pose).map(number);
            let keys = ["X", "Y", "Z", "W", "P", "R"];
            let cells: Vec<String> = keys.iter().zip(values).map(|(key, value)| format!("{key}={value}")).collect();
            text.push_str(&format!("{thing}: {}\n", cells.join(" ")));
        }
    };
    for one in all {
        table(format!("[UTOOL {}]\n", one.robot), &one.tools);
        table(format!("[UFRAME {}]\n", one.robot), &one.bases);
    }
    text
}
