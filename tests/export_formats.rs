//! Exported cells, read back by others: URDF by `k`, tables by `csv` and `serde_json`, controllers' values by the formulas that are published for them.

#[path = "support/program.rs"]
mod program;

use nalgebra::{Isometry3, Matrix3, Quaternion, Rotation3, Translation3, UnitQuaternion, Vector3};
use std::path::Path;

use cellmap::export::formats::{Format, abb_orientation, export, fanuc_pose, kuka_frame, ur_pose};
use cellmap::geometry::{Pose, rotation};
use cellmap::layout::yaml::{Node, Value, parse};
use cellmap::layout::{Layout, Motion, parse_layout, read_layout};

/// Two robots of different descriptions, one on the other's flange, cameras of every lens, things that hang on things.
const CELL: &str = "cellmap: 1
units: {length: mm, angle: deg}
world: table
cameras:
  left:
    intrinsics: {model: brown, size: [1280, 720], focal: [920.1, 919.8], centre: [640.2, 359.7], distortion: [0.1, -0.2, 0.001, 0.002, 0]}
    pose: {xyz: [-900, -700, 1000], rpy: [-132, 3, -45]}
  steep:
    intrinsics: {model: kannala_brandt, size: [800, 600], focal: [400, 401], centre: [399.5, 299.5], distortion: [0.01, 0.002, 0.0003, 0.0001]}
    pose: {xyz: [10, 20, 900], rpy: [180, 90, 20]}
  hand:
    intrinsics: {model: pinhole, size: [640, 480], focal: [600, 600], centre: [319.5, 239.5]}
    mount: arm.flange
    pose: {xyz: [0, -75, 20], rpy: [12, 0, 0]}
robots:
  arm: {model: ur5e, joints: joints.csv, pose: {xyz: [120, 420, -35], rpy: [0.4, -0.3, 31]}, corrections: [[0.5, 1, -2, 0.1], [-0.3, 0, 1, 0], [0, 0, 0, 0], [0.1, 0.2, 0.3, 0.4], [0, 0, 0, 0], [0, 0, 0, 0.2]]}
  classic: {model: {dh: dh.yaml}, joints: joints.csv, pose: {xyz: [900, 0, 0], rpy: [0, 0, 170]}}
targets:
  table: {tags: {dictionary: 6x6_250, size: 50, ids: [1]}}
  tool: {tags: {dictionary: 6x6_250, size: 50, ids: [2]}, mount: arm.flange, pose: {xyz: [2, 3, 110], rpy: [1, -90, 44]}}
  part: {tags: {dictionary: 6x6_250, size: 50, ids: [3]}, mount: tool, pose: {xyz: [5, 0, 9], rotvec: [0, 180, 0]}}
  lost: {tags: {dictionary: 6x6_250, size: 50, ids: [4]}}
";
const DH: &str = "cellmap_robot: 1
units: {length: mm, angle: deg}
convention: dh
base: {xyz: [0, 0, 10], rpy: [0, 0, 5]}
flange: {xyz: [0, 5, 20], rpy: [10, 0, 0]}
joints:
  - {alpha: 90, a: 20, theta: 10, d: 300}
  - {alpha: 0, a: 400, theta: 0, d: 0}
  - {alpha: -90, a: 30, theta: -20, d: 15, type: prismatic}
";

fn cell() -> (tempfile::TempDir, Layout) {
    let dir = program::folder(&[("cell.yaml", CELL), ("dh.yaml", DH)]);
    let layout = read_layout(&dir.path().join("cell.yaml"), None).unwrap();
    (dir, layout)
}

fn text_of(layout: &Layout, format: Format) -> String {
    export(layout, format).unwrap().files[0].text.clone()
}

fn isometry(pose: &Pose) -> Isometry3<f64> {
    Isometry3::from_parts(Translation3::from(pose.translation), pose.rotation)
}

fn assert_near(found: &Isometry3<f64>, expected: &Isometry3<f64>, what: &str) {
    let apart = (found.translation.vector - expected.translation.vector).norm();
    let turned =
        (found.rotation.to_rotation_matrix().matrix() - expected.rotation.to_rotation_matrix().matrix()).norm();
    assert!(apart < 1e-9 && turned < 1e-9, "{what}: {apart} m, {turned}");
}

/// `world_from_frame` of a frame that hangs on the world or on robot `arm`, by cellmap's own kinematics.
fn expected(layout: &Layout, name: &str, joints: [&[f64]; 2]) -> Pose {
    let find = |name: &str| {
        let camera = layout.cameras.iter().find(|c| c.name == name).map(|c| (c.mount.parent.clone(), c.pose.pose()));
        let target = layout.targets.iter().find(|t| t.name == name).map(|t| (t.mount.parent.clone(), t.pose.pose()));
        let robot = layout.robots.iter().find(|r| format!("{}.base", r.name) == name);
        camera.or(target).or(robot.map(|r| (r.mount.parent.clone(), r.pose.pose()))).unwrap()
    };
    if name == "world" || name == "table" {
        return Pose::identity();
    }
    for (index, robot) in layout.robots.iter().enumerate() {
        if name == format!("{}.flange", robot.name) {
            let Motion::Joints { chain, .. } = &robot.motion else { panic!() };
            let base = expected(layout, &format!("{}.base", robot.name), joints);
            return base * chain.segment(joints[index], &robot.corrections, 0, chain.flange_place());
        }
    }
    let (parent, pose) = find(name);
    expected(layout, &parent, joints) * pose.unwrap()
}

#[test]
fn the_urdf_has_the_same_poses_in_an_independent_reader() {
    let (dir, layout) = cell();
    let exported = export(&layout, Format::Urdf).unwrap();
    assert_eq!(exported.notes, ["`lost` is left out with all that hangs on it: its pose is unknown"]);
    let path = dir.path().join("cell.urdf");
    std::fs::write(&path, &exported.files[0].text).unwrap();
    let chain = k::Chain::<f64>::from_urdf_file(&path).unwrap();
    // `k` has a nalgebra of its own.
    let world_from = |link: &str| -> Isometry3<f64> {
        let pose = chain.find_link(link).unwrap_or_else(|| panic!("{link}")).world_transform().unwrap();
        let (t, q) = (pose.translation.vector, pose.rotation.quaternion().coords);
        let q = UnitQuaternion::from_quaternion(Quaternion::new(q[3], q[0], q[1], q[2]));
        Isometry3::from_parts(Translation3::new(t[0], t[1], t[2]), q)
    };
    for seed in 0..5 {
        let q = |i: usize| f64::sin(1.7 * (seed * 9 + i) as f64) * 2.0;
        let (arm, classic): (Vec<f64>, Vec<f64>) = ((0..6).map(q).collect(), (6..9).map(|i| q(i) * 0.4).collect());
        for (i, value) in arm.iter().enumerate() {
            chain.find(&format!("arm_link{}_joint", i + 1)).unwrap().set_joint_position(*value).unwrap();
        }
        for (i, value) in classic.iter().enumerate() {
            chain.find(&format!("classic_link{}_axis_joint", i + 1)).unwrap().set_joint_position(*value).unwrap();
        }
        chain.update_transforms();
        for (link, frame) in [
            ("arm_base", "arm.base"),
            ("arm_flange", "arm.flange"),
            ("classic_flange", "classic.flange"),
            ("left_optical_frame", "left"),
            ("steep_optical_frame", "steep"),
            ("hand_optical_frame", "hand"),
            ("tool", "tool"),
            ("part", "part"),
        ] {
            assert_near(&world_from(link), &isometry(&expected(&layout, frame, [&arm, &classic])), link);
        }
        // A camera's body looks along its x where the optical frame looks along z.
        let (body, optical) = (world_from("left_link"), world_from("left_optical_frame"));
        assert!((body.rotation * Vector3::x() - optical.rotation * Vector3::z()).norm() < 1e-12);
        assert!((body.rotation * Vector3::z() + optical.rotation * Vector3::y()).norm() < 1e-12);
    }
}

/// The same in another language's reader, where it is installed.
#[test]
fn the_urdf_has_the_same_poses_in_a_python_reader() {
    const SCRIPT: &str = "
import json, sys, yourdfpy
cell = yourdfpy.URDF.load(sys.argv[1], load_meshes=False)
cell.update_cfg(json.loads(sys.argv[2]))
print(json.dumps({link: cell.get_transform(link, 'world').flatten().tolist() for link in cell.link_map}))
";
    let (dir, layout) = cell();
    let path = dir.path().join("cell.urdf");
    std::fs::write(&path, text_of(&layout, Format::Urdf)).unwrap();
    let arm = [0.3, -1.2, 1.9, -0.4, 2.2, -2.9];
    let classic = [0.7, -0.5, 0.15];
    let names =
        (1..=6).map(|i| format!("arm_link{i}_joint")).chain((1..=3).map(|i| format!("classic_link{i}_axis_joint")));
    let values = arm.iter().chain(&classic);
    let joints: serde_json::Map<_, _> = names.zip(values).map(|(name, v)| (name, serde_json::json!(v))).collect();
    let output = std::process::Command::new("python3")
        .args(["-c", SCRIPT, path.to_str().unwrap(), &serde_json::Value::from(joints).to_string()])
        .output();
    let output = match output {
        Ok(output) if !program::stderr(&output).contains("No module named") => output,
        _ => {
            println!("skipped: no yourdfpy");
            return;
        }
    };
    let found = program::json(&output);
    for (link, frame) in [
        ("arm_flange", "arm.flange"),
        ("classic_flange", "classic.flange"),
        ("left_optical_frame", "left"),
        ("steep_optical_frame", "steep"),
        ("hand_optical_frame", "hand"),
        ("tool", "tool"),
        ("part", "part"),
    ] {
        let matrix = isometry(&expected(&layout, frame, [&arm, &classic])).to_homogeneous();
        for (i, value) in found[link].as_array().unwrap().iter().enumerate() {
            assert!((value.as_f64().unwrap() - matrix[(i / 4, i % 4)]).abs() < 1e-9, "{link} {i}");
        }
    }
}

#[test]
fn the_macro_is_the_same_cell_with_a_prefix() {
    let (_dir, layout) = cell();
    let text = text_of(&layout, Format::Xacro);
    let inside = text.split("params=\"prefix:='' parent\">").nth(1).unwrap().split("</xacro:macro>").next().unwrap();
    let plain = inside.replace("${prefix}", "a_").replace("${parent}", "room");
    let urdf = format!("<robot name=\"r\"><link name=\"room\"/>{plain}</robot>");
    let (one, two) = (
        urdf_rs::read_from_string(&urdf).unwrap(),
        urdf_rs::read_from_string(&text_of(&layout, Format::Urdf)).unwrap(),
    );
    assert_eq!(one.joints.len(), two.joints.len() + 1);
    for (a, b) in one.joints.iter().skip(1).zip(&two.joints) {
        assert_eq!(a.name, format!("a_{}", b.name));
        assert_eq!((a.origin.xyz.0, a.origin.rpy.0), (b.origin.xyz.0, b.origin.rpy.0));
    }
}

/// A key's value in a tree.
fn get<'a>(node: &'a Node, key: &str) -> &'a Node {
    let Value::Mapping(entries) = &node.value else { panic!("{key}") };
    &entries.iter().find(|(k, _, _)| k == key).unwrap_or_else(|| panic!("{key}")).2
}

fn list(node: &Node) -> Vec<f64> {
    let Value::Sequence(items) = &node.value else { panic!() };
    items.iter().map(|item| item.text().unwrap().parse().unwrap()).collect()
}

fn number(node: &Node) -> f64 {
    node.text().unwrap().parse().unwrap()
}

#[test]
fn static_transforms_leave_the_robots_joints_to_their_drivers() {
    let (_dir, layout) = cell();
    let files = export(&layout, Format::Ros2).unwrap().files;
    let tree = parse(&files[1].text).unwrap();
    let Value::Sequence(all) = &get(&tree, "static_transforms").value else { panic!() };
    let mut children = Vec::new();
    for one in all {
        let (t, q) = (get(one, "translation"), get(one, "rotation"));
        let n = |node: &Node, key: &str| number(get(node, key));
        let found = Isometry3::from_parts(
            Translation3::new(n(t, "x"), n(t, "y"), n(t, "z")),
            UnitQuaternion::from_quaternion(Quaternion::new(n(q, "w"), n(q, "x"), n(q, "y"), n(q, "z"))),
        );
        let child = get(one, "child_frame_id").text().unwrap();
        children.push(child.to_owned());
        if child == "tool" {
            assert_eq!(get(one, "frame_id").text(), Some("arm_flange"));
            assert_near(&found, &isometry(&layout.targets[1].pose.pose().unwrap()), child);
        }
        // The same numbers stand in the launch file.
        assert!(files[0].text.contains(&format!("'{}'", n(t, "x"))) || n(t, "x") == 0.0, "{child}");
    }
    assert!(children.iter().any(|c| c == "steep_optical_frame") && children.iter().any(|c| c == "steep_link"));
    assert!(!children.iter().any(|c| c.contains("link1") || c == "arm_flange" || c == "lost"), "{children:?}");
}

#[test]
fn lenses_are_told_in_the_words_of_ros_opencv_and_kalibr() {
    let (_dir, layout) = cell();
    let files = export(&layout, Format::CameraInfo).unwrap().files;
    assert_eq!(files.len(), 3);
    let left = parse(&files[0].text).unwrap();
    assert_eq!(list(get(get(&left, "camera_matrix"), "data")), [920.1, 0.0, 640.2, 0.0, 919.8, 359.7, 0.0, 0.0, 1.0]);
    assert_eq!(get(&left, "distortion_model").text(), Some("plumb_bob"));
    assert_eq!(list(get(get(&left, "distortion_coefficients"), "data")), [0.1, -0.2, 0.001, 0.002, 0.0]);
    assert_eq!(get(&parse(&files[1].text).unwrap(), "distortion_model").text(), Some("equidistant"));

    let text = text_of(&layout, Format::OpenCv);
    let body = text.strip_prefix("%YAML:1.0\n---\n").unwrap();
    let tree = parse(body).unwrap();
    let matrix = list(get(get(get(&tree, "left"), "world_from_camera"), "data"));
    let pose = isometry(&layout.cameras[0].pose.pose().unwrap()).to_homogeneous();
    for (i, value) in matrix.iter().enumerate() {
        assert!((value - pose[(i / 4, i % 4)]).abs() < 1e-12, "{i}");
    }
    assert_eq!(get(get(&tree, "steep"), "fisheye").text(), Some("1"));

    let exported = export(&layout, Format::Kalibr).unwrap();
    assert!(
        exported.notes.iter().any(|note| note.contains("camera `hand` is left out: it moves")),
        "{:?}",
        exported.notes
    );
    let tree = parse(&exported.files[0].text).unwrap();
    let Value::Sequence(rows) = &get(get(&tree, "cam1"), "T_cn_cnm1").value else { panic!() };
    let rows: Vec<Vec<f64>> = rows.iter().map(|row| list(row)).collect();
    // Kalibr's T_cn_cnm1 takes points of the camera before into this camera.
    let [before, own] = [0, 1].map(|i| isometry(&layout.cameras[i].pose.pose().unwrap()));
    let expected = (own.inverse() * before).to_homogeneous();
    for (i, row) in rows.iter().enumerate() {
        for (j, value) in row.iter().enumerate() {
            assert!((value - expected[(i, j)]).abs() < 1e-12, "{i} {j}");
        }
    }
    let refused = CELL.replace("0.002, 0]", "0.002, 0.3]");
    let dir = program::folder(&[("cell.yaml", &refused), ("dh.yaml", DH)]);
    let error = export(&read_layout(&dir.path().join("cell.yaml"), None).unwrap(), Format::Kalibr).unwrap_err();
    assert!(error.0[0].what.contains("has no k3"), "{error}");
}

#[test]
fn tables_are_read_back() {
    let (_dir, layout) = cell();
    let json: serde_json::Value = serde_json::from_str(&text_of(&layout, Format::Json)).unwrap();
    let tool = &json["poses"]["arm.flange_from_tool"];
    let q: Vec<f64> = tool["quat_xyzw"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    let t: Vec<f64> = tool["xyz_m"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    let found = Isometry3::from_parts(
        Translation3::new(t[0], t[1], t[2]),
        UnitQuaternion::from_quaternion(Quaternion::new(q[3], q[0], q[1], q[2])),
    );
    assert_near(&found, &isometry(&layout.targets[1].pose.pose().unwrap()), "tool");
    let text = text_of(&layout, Format::Csv);
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let rows: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
    assert_eq!(rows.len(), json["poses"].as_object().unwrap().len());
    let row = rows.iter().find(|row| &row[1] == "tool").unwrap();
    assert_eq!((&row[0], row[2].parse::<f64>().unwrap(), &row[9]), ("arm.flange", t[0], ""));
}

fn turned(matrix: Matrix3<f64>) -> Pose {
    Pose { rotation: rotation::from_matrix(&matrix), ..Pose::identity() }
}

/// ABB, *Technical reference manual RAPID*, data type `orient`: a tool whose z' points along x and whose y' along y has [0.707, 0, 0.707, 0]; one
/// that is turned by 30 degrees about y has [0.965926, 0, 0.258819, 0].
#[test]
fn abb_quaternions_are_those_of_the_manual() {
    let ahead = turned(Matrix3::new(0.0, 0.0, 1.0, 0.0, 1.0, 0.0, -1.0, 0.0, 0.0));
    for (found, expected) in abb_orientation(&ahead).iter().zip([0.5f64.sqrt(), 0.0, 0.5f64.sqrt(), 0.0]) {
        assert!((found - expected).abs() < 1e-12);
    }
    let (s, c) = 30f64.to_radians().sin_cos();
    let tilted = turned(Matrix3::new(c, 0.0, s, 0.0, 1.0, 0.0, -s, 0.0, c));
    for (found, expected) in abb_orientation(&tilted).iter().zip([0.965_926, 0.0, 0.258_819, 0.0]) {
        assert!((found - expected).abs() < 1e-6);
    }
}

/// The angles that each test of a controller's convention runs through, the singular ones included.
fn angles() -> Vec<[f64; 3]> {
    vec![
        [10.0, 20.0, 30.0],
        [-170.0, 45.0, 5.0],
        [0.0, 89.999, 0.0],
        [33.0, 90.0, 0.0],
        [120.0, -90.0, 0.0],
        [-60.0, -30.0, 179.0],
    ]
}

/// Roboception, *rc_visard manual*, appendix "KUKA XYZ-ABC format": the quaternion of A, B, C.
#[test]
fn kuka_angles_are_those_that_are_published() {
    for [a, b, c] in angles() {
        let ([sa, ca], [sb, cb], [sc, cc]) = (half(a), half(b), half(c));
        let q = Quaternion::new(
            ca * cb * cc + sa * sb * sc,
            ca * cb * sc - sa * sb * cc,
            ca * sb * cc + sa * cb * sc,
            sa * cb * cc - ca * sb * sc,
        );
        let pose = Pose::new(UnitQuaternion::from_quaternion(q), Vector3::new(0.1, 0.2, -0.3));
        let [x, y, z, fa, fb, fc] = kuka_frame(&pose);
        assert!((Vector3::new(x, y, z) - Vector3::new(100.0, 200.0, -300.0)).norm() < 1e-9);
        let again = Rotation3::from_euler_angles(fc.to_radians(), fb.to_radians(), fa.to_radians());
        assert!((again.matrix() - pose.rotation_matrix()).norm() < 1e-12, "{a} {b} {c}");
        if b.abs() < 89.0 {
            assert!((fa - a).abs() < 1e-9 && (fb - b).abs() < 1e-9 && (fc - c).abs() < 1e-9, "{fa} {fb} {fc}");
        }
    }
}

/// The same manual, appendix "FANUC XYZ-WPR format".
#[test]
fn fanuc_angles_are_those_that_are_published() {
    for [r, p, w] in angles() {
        let ([sr, cr], [sp, cp], [sw, cw]) = (half(r), half(p), half(w));
        let q = Quaternion::new(
            cr * cp * cw + sr * sp * sw,
            cr * cp * sw - sr * sp * cw,
            cr * sp * cw + sr * cp * sw,
            sr * cp * cw - cr * sp * sw,
        );
        let pose = Pose::new(UnitQuaternion::from_quaternion(q), Vector3::zeros());
        let [.., fw, fp, fr] = fanuc_pose(&pose);
        let again = Rotation3::from_euler_angles(fw.to_radians(), fp.to_radians(), fr.to_radians());
        assert!((again.matrix() - pose.rotation_matrix()).norm() < 1e-12);
        if p.abs() < 89.0 {
            assert!((fw - w).abs() < 1e-9 && (fp - p).abs() < 1e-9 && (fr - r).abs() < 1e-9);
        }
    }
}

fn half(degrees: f64) -> [f64; 2] {
    let (sin, cos) = (0.5 * degrees.to_radians()).sin_cos();
    [sin, cos]
}

/// Universal Robots' forum, "Pose rotation order": the conversion from roll, pitch and yaw to the rotation vector that their script language uses.
#[test]
fn ur_rotation_vectors_are_those_that_are_published() {
    for [yaw, pitch, roll] in
        [[10.0, 20.0, 30.0], [-100.0, 45.0, 5.0], [-60.0, -30.0, 120.0]].map(|a: [f64; 3]| a.map(f64::to_radians))
    {
        let ((sa, ca), (sb, cb), (sg, cg)) = (yaw.sin_cos(), pitch.sin_cos(), roll.sin_cos());
        let (r11, r21, r31) = (ca * cb, sa * cb, -sb);
        let (r12, r22, r32) = (ca * sb * sg - sa * cg, sa * sb * sg + ca * cg, cb * sg);
        let (r13, r23, r33) = (ca * sb * cg + sa * sg, sa * sb * cg - ca * sg, cb * cg);
        let theta = ((r11 + r22 + r33 - 1.0) / 2.0).acos();
        let scale = theta / (2.0 * theta.sin());
        let published = [(r32 - r23) * scale, (r13 - r31) * scale, (r21 - r12) * scale];
        let found = ur_pose(&Pose { rotation: rotation::from_rpy([roll, pitch, yaw]), ..Pose::identity() });
        for (a, b) in found[3..].iter().zip(published) {
            assert!((a - b).abs() < 1e-12);
        }
    }
}

/// Universal Robots, *The URScript Programming Language*, `rpy2rotvec` and `rotvec2rpy`: the manual's own examples, to its own digits.
#[allow(clippy::approx_constant, reason = "the manual's numbers")]
#[test]
fn ur_rotation_vectors_are_those_of_the_manual() {
    let found = ur_pose(&Pose { rotation: rotation::from_rpy([3.14, 1.57, 0.0]), ..Pose::identity() });
    for (a, b) in found[3..].iter().zip([2.22153, 0.00177, -2.21976]) {
        assert!((a - b).abs() < 5.1e-6, "{found:?}");
    }
    let back = ur_pose(&Pose { rotation: rotation::from_rpy([-2.80856, -0.16202, 0.9]), ..Pose::identity() });
    // The manual's angles have five digits; its rotation vector is longer than half a turn, and the shorter one is the same turn.
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(3.14, 1.57, 0.0));
    assert!(
        UnitQuaternion::from_scaled_axis(Vector3::new(back[3], back[4], back[5])).angle_to(&turn) < 1e-5,
        "{back:?}"
    );
}

#[test]
fn controllers_files_hold_bases_and_tools() {
    let (_dir, layout) = cell();
    let tool = layout.targets[1].pose.pose().unwrap();
    let ur = text_of(&layout, Format::Ur);
    let line = ur.lines().find(|line| line.starts_with("global tcp_arm_tool = p[")).unwrap();
    let values: Vec<f64> = line.split(['[', ']']).nth(1).unwrap().split(", ").map(|v| v.parse().unwrap()).collect();
    for (a, b) in values.iter().zip(ur_pose(&tool)) {
        assert!((a - b).abs() < 1e-12);
    }
    assert!(ur.contains("global base_arm_classic_base = p["), "{ur}");
    let kuka = text_of(&layout, Format::Kuka);
    assert!(
        kuka.lines().any(|line| line.starts_with("DECL GLOBAL FRAME T_arm_tool={X 2,Y 3,Z 110")
            || line.contains("T_arm_tool={X 2.0")),
        "{kuka}"
    );
    assert!(
        kuka.lines()
            .filter(|line| line.starts_with("DECL"))
            .all(|line| line.split([' ', '=']).nth(3).unwrap().len() <= 24)
    );
    let abb = text_of(&layout, Format::Abb);
    assert!(abb.contains("PERS tooldata t_arm_tool := [TRUE,[[") && abb.trim_end().ends_with("ENDMODULE"));
    let fanuc = text_of(&layout, Format::Fanuc);
    assert!(fanuc.contains("[UTOOL arm]") && fanuc.contains("[UFRAME classic]"));
    let no_robot = parse_layout(
        Path::new("x.yaml"),
        "cellmap: 1\nunits: {length: m, angle: rad}\nworld: a\ntargets: {a: {}}\n",
        None,
    )
    .unwrap();
    assert!(export(&no_robot, Format::Ur).is_err() && export(&no_robot, Format::OpenCv).is_err());
}

#[test]
fn the_command_writes_files_and_folders() {
    let dir = program::folder(&[("cell.yaml", CELL), ("dh.yaml", DH)]);
    for format in Format::ALL {
        let output = program::run(
            dir.path(),
            &["export", "cell.yaml", "--to", format.name(), "--out", &format!("{}/", format.name()), "--json"],
        );
        assert_eq!(output.status.code(), Some(0), "{}", program::stderr(&output));
        for file in program::json(&output)["files"].as_array().unwrap() {
            assert!(dir.path().join(file.as_str().unwrap()).is_file(), "{file}");
        }
    }
    let output = program::run(dir.path(), &["export", "cell.yaml", "--to", "urdf", "--out", "here.urdf"]);
    assert_eq!(
        program::stdout(&output),
        "wrote here.urdf\nnote: `lost` is left out with all that hangs on it: its pose is unknown\n"
    );
    assert_eq!(program::run(dir.path(), &["export", "cell.yaml", "--to", "blender"]).status.code(), Some(2));
}
