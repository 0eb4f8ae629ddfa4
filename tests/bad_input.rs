//! Bad input: exit code 2, nothing written, and exactly these words.

#[path = "support/program.rs"]
mod program;

use program::{contents, folder, run, stderr};

const JOINTS: &str = "configuration,robot,q1,q2,q3,q4,q5,q6\n1,arm,0,0,0,0,0,0\n2,arm,0.1,0.2,0.3,0.4,0.5,0.6\n";
const CORNERS: &str = "configuration,shot,camera,target,tag,corner,u,v\n\
    1,0,eye,tag,7,0,100,100\n1,0,eye,tag,7,1,200,100\n1,0,eye,tag,7,2,200,200\n1,0,eye,tag,7,3,100,200\n";
const GOOD: &str = "cellmap: 1
units: {length: mm, angle: deg}
world: arm.base
cameras:
  eye:
    images: images/{configuration:04}.png
    intrinsics: {model: pinhole, size: [640, 480], focal: [600, 600], centre: [319.5, 239.5]}
robots:
  arm: {model: ur5e, joints: joints.csv}
targets:
  tag: {tags: {dictionary: 6x6_250, size: 50, ids: [7]}, mount: arm.flange}
observations: {detections: corners.csv}
";

/// Runs a command on a layout with the good recording's files, some of them replaced, and returns what it says.
fn refused(command: &str, layout: &str, files: &[(&str, &str)]) -> String {
    let mut all = vec![("joints.csv", JOINTS), ("corners.csv", CORNERS), ("layout.yaml", layout)];
    all.extend_from_slice(files);
    let dir = folder(&all);
    check(dir.path(), command)
}

fn check(dir: &std::path::Path, command: &str) -> String {
    let before = contents(dir);
    let output = run(dir, &[command, "layout.yaml"]);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{said}");
    let files = |list: Vec<(String, Vec<u8>)>| {
        list.into_iter().filter(|(n, _)| !n.ends_with(".unfinished")).collect::<Vec<_>>()
    };
    assert_eq!(files(before), files(contents(dir)), "something was written");
    assert!(!said.contains("panicked"), "{said}");
    said
}

fn edited(from: &str, to: &str) -> String {
    assert!(GOOD.contains(from), "{from}");
    GOOD.replace(from, to)
}

#[track_caller]
fn pinned(said: &str, expected: &str) {
    assert_eq!(said.trim_end(), expected.trim());
}

#[test]
fn the_good_input_is_good() {
    let dir = folder(&[("joints.csv", JOINTS), ("corners.csv", CORNERS), ("layout.yaml", GOOD)]);
    let output = run(dir.path(), &["check", "layout.yaml"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
}

#[test]
fn unknown_key() {
    let said = refused("solve", &edited("mount: arm.flange", "mout: arm.flange"), &[]);
    pinned(
        &said,
        "error: unknown key `mout` in target `tag`
  --> layout.yaml:11
   11 |   tag: {tags: {dictionary: 6x6_250, size: 50, ids: [7]}, mout: arm.flange}
  help: did you mean `mount`?",
    );
}

#[test]
fn missing_files() {
    let said = refused("solve", &edited("joints: joints.csv", "joints: joint.csv"), &[]);
    pinned(
        &said,
        "error: the file cannot be read: it does not exist
  --> joint.csv
  help: paths are relative to the recording's folder, by default the layout's own",
    );
    let said = refused("solve", &edited("model: ur5e", "model: {mdh: my_arm.yaml}"), &[]);
    pinned(
        &said,
        "error: the file `./my_arm.yaml` cannot be read: it does not exist
  --> layout.yaml:9
    9 |   arm: {model: {mdh: my_arm.yaml}, joints: joints.csv}
  help: paths are relative to the recording's folder, by default the layout's own",
    );
    let dir = folder(&[]);
    pinned(
        &check(dir.path(), "solve"),
        "error: the layout cannot be read: it does not exist
  --> layout.yaml
  help: give the path of a layout; examples are in `layouts/`",
    );
}

#[test]
fn a_board_that_nobody_prints() {
    let board = "tag: {checkerboard: {corners: [9000, 5000], square: 50}";
    let said = refused("solve", &edited("tag: {tags: {dictionary: 6x6_250, size: 50, ids: [7]}", board), &[]);
    pinned(
        &said,
        "error: the board `tag` has 9000 x 5000 inner corners
  --> layout.yaml:11
   11 |   tag: {checkerboard: {corners: [9000, 5000], square: 50}, mount: arm.flange}
  help: no board has more than 1000000: check the counts",
    );
}

#[test]
fn unit_missing() {
    let said = refused("solve", &edited("units: {length: mm, angle: deg}", "units: {length: mm}"), &[]);
    pinned(
        &said,
        "error: `units` does not say the unit of angle
  --> layout.yaml:2
    2 | units: {length: mm}
  help: add `angle`: one of `rad` or `deg`",
    );
    let said = refused("solve", &edited("units: {length: mm, angle: deg}\n", ""), &[]);
    pinned(
        &said,
        "error: the layout has no `units`
  --> layout.yaml:1
    1 | cellmap: 1
  help: add for example `units: {length: mm, angle: deg}`",
    );
}

#[test]
fn zero_or_negative_size() {
    for size in ["0", "-50"] {
        let said = refused("solve", &edited("size: 50", &format!("size: {size}")), &[]);
        pinned(
            &said,
            &format!(
                "error: `size` of `tags` of target `tag` is {size}
  --> layout.yaml:11
   11 |   tag: {{tags: {{dictionary: 6x6_250, size: {size}, ids: [7]}}, mount: arm.flange}}
  help: it must be greater than zero"
            ),
        );
    }
}

#[test]
fn a_tag_on_two_targets() {
    let two = edited("observations", "  other: {tags: {dictionary: 6x6_50, size: 30, ids: [3, 7]}}\nobservations");
    pinned(
        &refused("solve", &two, &[]),
        "error: tag 7 of `6x6_50` is on target `tag` and on target `other`
  --> layout.yaml:12
   12 |   other: {tags: {dictionary: 6x6_50, size: 30, ids: [3, 7]}}
  help: print one of the two with another id",
    );
}

#[test]
fn a_matrix_that_is_no_rotation() {
    let pose = "pose: {xyz: [0, 0, 0], matrix: [1, 0, 0, 0, 1.1, 0, 0, 0, 1]}";
    let said = refused("solve", &edited("mount: arm.flange", &format!("mount: arm.flange, {pose}")), &[]);
    assert!(
        said.starts_with(
            "error: the rotation matrix of the pose of target `tag` is not orthonormal\n  --> layout.yaml:11\n"
        ),
        "{said}"
    );
    assert!(
        said.ends_with(
            "help: its columns miss length 1 or right angles by 0.210: check for scale, units or a typing error\n"
        ),
        "{said}"
    );
}

#[test]
fn two_rotations() {
    let pose = "pose: {xyz: [0, 0, 0], rpy: [0, 0, 0], rotvec: [0, 0, 0]}";
    let said = refused("solve", &edited("mount: arm.flange", &format!("mount: arm.flange, {pose}")), &[]);
    assert!(
        said.starts_with(
            "error: the pose of target `tag` has two rotations, `rpy` and `rotvec`\n  --> layout.yaml:11\n"
        ),
        "{said}"
    );
    assert!(said.ends_with("help: keep exactly one of them\n"), "{said}");
}

#[test]
fn nan_in_a_csv() {
    let said = refused("solve", GOOD, &[("joints.csv", &JOINTS.replace("0.3", "NaN"))]);
    pinned(
        &said,
        "error: `q3` is NaN
  --> joints.csv:3
    3 | 2,arm,0.1,0.2,NaN,0.4,0.5,0.6
  help: every number must be finite: leave the line out if the value is not known",
    );
    let said = refused("solve", GOOD, &[("corners.csv", &CORNERS.replace("200,200", "inf,200"))]);
    pinned(
        &said,
        "error: `u` is inf
  --> corners.csv:4
    4 | 1,0,eye,tag,7,2,inf,200
  help: every number must be finite: leave the line out if the value is not known",
    );
}

#[test]
fn wrong_joint_count() {
    let said = refused("solve", GOOD, &[("joints.csv", "configuration,robot,q1,q2,q3,q4,q5,q6\n1,arm,0,0,0,0,0,\n")]);
    pinned(
        &said,
        "error: robot `arm` has 6 joints but 5 values stand here
  --> joints.csv:2
    2 | 1,arm,0,0,0,0,0,
  help: give one value for each joint and leave the other cells empty",
    );
}

#[test]
fn pictures_or_corners_without_joints() {
    let said = refused("detect", GOOD, &[("images/0009.png", "not looked at")]);
    pinned(
        &said,
        "error: configuration 9 has the picture `./images/0009.png` but no joint values
  --> joints.csv
  help: add the line, or remove the picture",
    );
    let said = refused("solve", GOOD, &[("corners.csv", &CORNERS.replace("1,0,eye", "9,0,eye"))]);
    pinned(
        &said,
        "error: configuration 9 has a measurement by `eye` but robot `arm` has no joint values there
  --> joints.csv
  help: add the line, or remove the measurements of that configuration",
    );
}

fn grey_png(width: u32, height: u32) -> Vec<u8> {
    let picture =
        cellmap::detect::GreyPicture::new(width as usize, height as usize, vec![99; (width * height) as usize]);
    cellmap::simulate::render::encode(&picture.unwrap(), cellmap::simulate::render::PictureFormat::Png).unwrap()
}

#[test]
fn pictures_of_another_size_and_impossible_pictures() {
    let dir = folder(&[("joints.csv", JOINTS), ("layout.yaml", GOOD)]);
    std::fs::create_dir(dir.path().join("images")).unwrap();
    std::fs::write(dir.path().join("images/0001.png"), grey_png(64, 48)).unwrap();
    pinned(&check(dir.path(), "detect"), "error: none of the 1 pictures could be used; the first: ./images/0001.png: the picture is 64x48, the camera's intrinsics are for 640x480
  --> images/0001.png
  help: check the pictures against `images` and the `size` of the intrinsics");
    // The header alone, claiming ten thousand million pixels.
    let mut bomb = grey_png(64, 48);
    bomb[16..20].copy_from_slice(&100_000u32.to_be_bytes());
    bomb[20..24].copy_from_slice(&100_000u32.to_be_bytes());
    let mut crc = !0u32;
    for byte in &bomb[12..29] {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = if crc & 1 == 1 { (crc >> 1) ^ 0xedb8_8320 } else { crc >> 1 };
        }
    }
    bomb[29..33].copy_from_slice(&(!crc).to_be_bytes());
    std::fs::write(dir.path().join("images/0001.png"), bomb).unwrap();
    pinned(&check(dir.path(), "detect"), "error: none of the 1 pictures could be used; the first: ./images/0001.png: the header claims 100000x100000 pixels, more than 256 megapixels
  --> images/0001.png
  help: check the pictures against `images` and the `size` of the intrinsics");
}

#[test]
fn mounts_in_a_circle() {
    let circle = "cellmap: 1
units: {length: mm, angle: deg}
world: table
targets:
  a: {mount: b}
  b: {mount: a}
";
    pinned(
        &refused("solve", circle, &[]),
        "error: the mounts go round in a circle: a on b on a
  --> layout.yaml:5
    5 |   a: {mount: b}
  help: something in the circle must hang on `world`",
    );
}

#[test]
fn no_world() {
    pinned(
        &refused("solve", &edited("world: arm.base\n", ""), &[]),
        "error: the layout does not define the world
  --> layout.yaml:1
    1 | cellmap: 1
  help: add `world: NAME`: the frame whose pose is the identity, for example a board on the table or `ur3.base`",
    );
}

#[test]
fn a_cell_in_two_pieces() {
    let said = refused("solve", &edited("world: arm.base", "world: bench"), &[]);
    pinned(
        &said,
        "error: the cell is in two pieces: `eye`, `arm.base` are not tied to `bench`
  --> layout.yaml
  help: let `eye` see something that is tied to `bench`, or give `eye` a pose",
    );
}

#[test]
fn an_empty_recording() {
    let header = CORNERS.lines().next().unwrap();
    pinned(
        &refused("solve", GOOD, &[("corners.csv", header)]),
        "error: the recording is empty: its files hold no measurement
  --> corners.csv
  help: check that the detector found something and that the files are the right ones",
    );
    let said = refused("solve", &edited("observations: {detections: corners.csv}\n", ""), &[]);
    pinned(
        &said,
        "error: there is nothing to solve from: the layout has no `observations` and the recording no `detections.csv`
  --> layout.yaml
  help: run `cellmap detect` on the layout first",
    );
    let said = refused("detect", GOOD, &[]);
    pinned(
        &said,
        "error: no picture was found; camera `eye` looks for `images/{configuration:04}.png` in `.`
  --> layout.yaml:6
    6 |     images: images/{configuration:04}.png
  help: check the pattern, or say where the recording is with `--recording DIR`",
    );
}

#[test]
fn an_alias_bomb() {
    let mut bomb = "a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n".to_owned();
    for i in 1..10 {
        let alias = format!("*a{}", i - 1);
        bomb.push_str(&format!("a{i}: &a{i} [{}]\n", vec![alias; 10].join(", ")));
    }
    let said = refused("solve", &bomb, &[]);
    assert!(
        said.starts_with("error: aliases here unfold to more than 1000000 values\n  --> layout.yaml:5\n"),
        "{said}"
    );
    assert!(said.ends_with("help: write the values out; no cell needs that many\n"), "{said}");
}

#[test]
fn every_fault_is_named_at_once() {
    let layout = edited("size: 50", "size: -1").replace("model: ur5e", "model: ur55e").replace("world:", "wrld:");
    let said = refused("solve", &layout, &[]);
    let first_lines: Vec<&str> = said.lines().filter(|line| line.starts_with("error:")).collect();
    assert_eq!(
        first_lines,
        [
            "error: the layout does not define the world",
            "error: robot `arm` has the unknown model `ur55e`",
            "error: `size` of `tags` of target `tag` is -1",
            "error: unknown key `wrld` in the layout",
        ]
    );
    assert!(said.contains("did you mean `ur5e`?") && said.contains("did you mean `world`?"), "{said}");
}

#[test]
fn names_that_the_layout_does_not_have() {
    let said = refused("solve", GOOD, &[("corners.csv", &CORNERS.replace("eye,tag,7,3", "eye,tga,7,3"))]);
    pinned(
        &said,
        "error: the layout has no target `tga`
  --> corners.csv:5
    5 | 1,0,eye,tga,7,3,100,200
  help: did you mean `tag`?",
    );
    let said = refused("solve", GOOD, &[("corners.csv", &CORNERS.replace("7,3,", "7,0,"))]);
    pinned(
        &said,
        "error: this corner is given twice, first on line 2
  --> corners.csv:5
    5 | 1,0,eye,tag,7,0,100,200
  help: keep one of the lines",
    );
}

#[test]
fn json_carries_the_errors_too() {
    let dir = folder(&[("layout.yaml", "cellmap: 2\n")]);
    let output = run(dir.path(), &["check", "layout.yaml", "--json"]);
    assert_eq!(output.status.code(), Some(2));
    let errors = program::json(&output);
    assert_eq!(errors["errors"][0]["line"], 1);
    assert!(errors["errors"][0]["what"].as_str().unwrap().contains("`cellmap`"), "{errors}");
}

const SIMULATED: &str = "cellmap: 1
units: {length: mm, angle: deg}
world: table
cameras:
  eye:
    images: images/{configuration:04}.png
    intrinsics: {model: pinhole, size: [640, 480], focal: [500, 500], centre: [319.5, 239.5]}
    pose: {xyz: [0, 0, 1500], rpy: [180, 0, 0], unknown: true}
robots:
  arm: {model: ur5e, joints: joints.csv, pose: {xyz: [0, 500, 0], rpy: [0, 0, 0], unknown: true}}
targets:
  table: {tags: {dictionary: 6x6_250, size: 100, ids: [1]}}
  tool: {tags: {dictionary: 6x6_250, size: 100, ids: [2]}, mount: arm.flange, pose: {xyz: [0, 0, 50], rpy: [0, 0, 0], unknown: true}}
";

/// Runs `simulate` with more arguments on a changed layout; nothing is written.
fn not_simulated(from: &str, to: &str, more: &[&str]) -> String {
    assert!(SIMULATED.contains(from), "{from}");
    let dir = folder(&[("layout.yaml", &SIMULATED.replace(from, to))]);
    let before = contents(dir.path());
    let mut arguments = vec!["simulate", "layout.yaml", "--out", "out", "--configurations", "3"];
    arguments.extend_from_slice(more);
    let output = run(dir.path(), &arguments);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert_eq!(before, contents(dir.path()), "something was written");
    assert!(!dir.path().join("out").exists());
    said
}

#[test]
fn a_simulation_of_unknown_poses() {
    let said = not_simulated("    pose: {xyz: [0, 0, 1500], rpy: [180, 0, 0], unknown: true}\n", "", &[]);
    pinned(
        &said,
        "error: the pose of camera `eye` is not known\n  --> layout.yaml:6\n    6 |     images: images/{configuration:04}.png\n  help: a simulation needs every pose: \
         give it, with `unknown: true` in it if the solver is to find it",
    );
    let said = not_simulated("size: 100, ids: [2]", "size: 100, ids: [2, 3]", &[]);
    assert!(
        said.starts_with("error: the place of tag 3 on target `tool` is not known\n  --> layout.yaml:13"),
        "{said}"
    );
    let said = not_simulated("{xyz: [0, 500, 0], rpy: [0, 0, 0], unknown: true}", "unknown", &[]);
    assert!(said.starts_with("error: the pose of robot `arm` is not known\n  --> layout.yaml:10"), "{said}");
    let said = not_simulated("unknown: true}}\ntargets", "unknown: true, start: true}}\ntargets", &[]);
    assert!(said.contains("the pose of robot `arm` has both `start` and `unknown`"), "{said}");
}

#[test]
fn a_simulation_of_a_path_that_cannot_be() {
    // The camera looks at the ceiling.
    let said = not_simulated("rpy: [180, 0, 0]", "rpy: [0, 0, 0]", &[]);
    let words = "error: no joint values were found for robot `arm` at configuration 1: of 9600 tried";
    assert!(said.starts_with(words) && said.contains("nothing is seen of what it carries"), "{said}");
    assert!(said.contains("help: give ranges in which it works: `simulate: {joints:"), "{said}");
    let ranges = |text: &str| format!("simulate: {{joints: {{{text}}}}}\ncellmap: 1\n");
    let said = not_simulated("cellmap: 1\n", &ranges("arn: [[0, 1]]"), &[]);
    pinned(
        &said,
        "error: `simulate` gives joint ranges of `arn`, which is no robot\n  --> layout.yaml:1\n    1 | simulate: {joints: {arn: [[0, 1]]}}\n  help: did you mean `arm`?",
    );
    let said = not_simulated("cellmap: 1\n", &ranges("arm: [[0, 1]]"), &[]);
    assert!(said.starts_with("error: robot `arm` has 6 joints but 1 ranges stand here"), "{said}");
    let said = not_simulated("cellmap: 1\n", &ranges("arm: [[1, 0], [0, 1], [0, 1], [0, 1], [0, 1], [0, 1]]"), &[]);
    assert!(said.starts_with("error: a joint range of `arm` ends before it begins"), "{said}");
    // A recorded path that leaves the ranges.
    let joints = "configuration,robot,q1,q2,q3,q4,q5,q6\n1,arm,0,-90,90,-90,-90,0\n2,arm,200,-90,90,-90,-90,0\n";
    let text =
        format!("simulate: {{path: recorded, joints: {{arm: [{}]}}}}\n{SIMULATED}", ["[-100, 100]"; 6].join(", "));
    let dir = folder(&[("layout.yaml", &text), ("joints.csv", joints)]);
    let output = run(dir.path(), &["simulate", "layout.yaml", "--out", "out"]);
    assert_eq!(output.status.code(), Some(2));
    let words = "error: configuration 2 cannot be reached: joint 1 of robot `arm` is outside its range";
    assert!(stderr(&output).starts_with(words), "{}", stderr(&output));
    assert!(!dir.path().join("out").exists());
}

#[test]
fn a_simulation_with_nowhere_to_go() {
    let said = not_simulated("04}.png", "04}_{shot}.png", &["--pictures", "--shots", "1000000"]);
    assert!(said.starts_with("error: the recording needs about ") && said.contains(" but the disk has "), "{said}");
    let said = not_simulated("04}.png", "04}.tga", &["--pictures"]);
    assert!(said.contains("pictures of camera `eye` would be of kind `tga`"), "{said}");
    let said = not_simulated("cellmap", "cellmap", &["--pictures", "--shots", "2"]);
    assert!(said.contains("camera `eye` takes 2 shots but its `images` have no `{shot}`"), "{said}");

    // A folder in use is refused without `--force`, whatever is in it; with it the simulation is replaced and strangers stay.
    let dir = folder(&[("layout.yaml", SIMULATED), ("out/mine.txt", "precious")]);
    let before = contents(dir.path());
    let arguments = ["simulate", "layout.yaml", "--out", "out", "--configurations", "3"];
    let output = run(dir.path(), &arguments);
    assert_eq!(output.status.code(), Some(2));
    pinned(
        &stderr(&output),
        "error: the folder exists and is not empty\n  --> out\n  help: give another with `--out DIR`, or replace the simulation in it with `--force`",
    );
    assert_eq!(before, contents(dir.path()));
    let forced: Vec<&str> = arguments.iter().copied().chain(["--force"]).collect();
    assert_eq!(run(dir.path(), &forced).status.code(), Some(0));
    assert_eq!(std::fs::read_to_string(dir.path().join("out/mine.txt")).unwrap(), "precious");
    let first = contents(dir.path());
    assert_eq!(run(dir.path(), &arguments).status.code(), Some(2));
    assert_eq!(run(dir.path(), &forced).status.code(), Some(0));
    assert_eq!(first, contents(dir.path()), "the same seed gives the same files");
    let file = run(dir.path(), &["simulate", "layout.yaml", "--out", "layout.yaml"]);
    assert_eq!(file.status.code(), Some(2), "{}", stderr(&file));
}

#[test]
fn a_simulated_camera_that_never_sees_anything() {
    let blind = "cameras:\n  blind: {intrinsics: {model: pinhole, size: [640, 480], focal: [500, 500], centre: [319.5, 239.5]}, \
                 pose: {xyz: [0, 0, 1500], rpy: [0, 0, 0], unknown: true}}\n";
    let dir = folder(&[("layout.yaml", &SIMULATED.replace("cameras:\n", blind))]);
    let output = run(dir.path(), &["simulate", "layout.yaml", "--out", "out", "--configurations", "3"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    pinned(
        &stderr(&output),
        "warning: camera `blind` never sees anything: check its pose (x right, y down, z forward)",
    );
}
