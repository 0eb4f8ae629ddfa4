//! The table of keys against the parser: neither may know a key that the other does not, and what the schema flags `check` flags too.

use cellmap::layout::yaml::{Node, Value, parse};
use cellmap::layout::{parse_intrinsics, parse_layout, parse_model, parse_target};
use cellmap::schema::{File, SECTIONS, json_schema, markdown};
use serde_json::{Value as Json, json};
use std::collections::BTreeSet;
use std::path::Path;

const HEAD: &str = "cellmap: 1\nunits: {length: m, angle: rad}\nworld: w\n";
const POSE: &str = "xyz: [0, 0, 0], rpy: [0, 0, 0]";

/// A file in which `HERE` stands inside the section's mapping, and what reads it.
fn place(section: &str) -> (File, String) {
    let layout = |text: String| (File::Layout, format!("{HEAD}{text}\n"));
    let target = |inside: &str| layout(format!("targets: {{t: {{{inside}}}}}"));
    let simulate = |inside: &str| layout(format!("targets: {{t: {{}}}}\nsimulate: {{{inside}}}"));
    let robot_file = |units: &str, more: &str, joint: &str| {
        (
            File::Robot,
            format!(
                "cellmap_robot: 1\nunits: {{length: m, angle: rad}}{units}\nconvention: mdh\n{more}joints: [{{alpha: 0, a: 0, theta: 0, d: 0{joint}}}]\n"
            ),
        )
    };
    match section {
        "layout" => layout("targets: {t: {}}\nHERE".to_owned()),
        "units" => {
            (File::Layout, "cellmap: 1\nunits: {length: m, angle: rad, HERE}\nworld: w\ntargets: {t: {}}\n".to_owned())
        }
        "camera" => layout("cameras: {c: {HERE}}".to_owned()),
        "intrinsics" => {
            (File::Intrinsics, "model: pinhole\nsize: [9, 9]\nfocal: [9, 9]\ncentre: [4, 4]\nHERE\n".to_owned())
        }
        "robot" => layout("robots: {r: {flange_poses: f.csv, HERE}}".to_owned()),
        "model" => layout("robots: {r: {joints: j.csv, model: {mdh: ur.yaml, HERE}}}".to_owned()),
        "identify" => layout("robots: {r: {joints: j.csv, model: ur5e, identify: {HERE}}}".to_owned()),
        "repeatability" => {
            layout("robots: {r: {flange_poses: f.csv, repeatability: {xyz: 1, rotation: 1, HERE}}}".to_owned())
        }
        "belief" => layout("robots: {r: {joints: j.csv, model: ur5e, identify: {lengths: {HERE}}}}".to_owned()),
        "sensor" => layout("sensors: {s: {measures: points, HERE}}".to_owned()),
        "target" => target("HERE"),
        "tags" => target("tags: {dictionary: 4x4_50, size: 1, ids: [1], HERE}"),
        "grid" => target("tags: {dictionary: 4x4_50, grid: {columns: 2, rows: 2, size: 1, gap: 1, HERE}}"),
        "cube" => target("tags: {dictionary: 4x4_50, cube: {edge: 2, size: 1, ids: [1], HERE}}"),
        "place" => {
            target(&format!("tags: {{dictionary: 4x4_50, places: [{{id: 1, size: 1, pose: {{{POSE}}}, HERE}}]}}"))
        }
        "checkerboard" => target("checkerboard: {corners: [5, 4], square: 1, HERE}"),
        "charuco" => target("charuco: {squares: [5, 4], square: 2, marker: 1, dictionary: 4x4_50, HERE}"),
        "april_grid" => target("april_grid: {columns: 2, rows: 2, size: 1, spacing: 0.3, HERE}"),
        "point" => target("points: {p: {xyz: [0, 0, 0], HERE}}"),
        "pose" => target(&format!("pose: {{{POSE}, HERE}}")),
        "plain_pose" => robot_file("", &format!("flange: {{{POSE}, HERE}}\n"), ""),
        "sigma" => target(&format!("pose: {{{POSE}, sigma: {{xyz: 1, rotation: 1, HERE}}}}")),
        "observations" => layout("targets: {t: {}}\nobservations: {HERE}".to_owned()),
        "solve" => layout("targets: {t: {}}\nsolve: {HERE}".to_owned()),
        "loss" => layout("targets: {t: {}}\nsolve: {loss: {huber: 1, HERE}}".to_owned()),
        "pose_sigma" => layout("targets: {t: {}}\nsolve: {pose_sigma: {xyz: 1, rotation: 1, HERE}}".to_owned()),
        "simulate" => simulate("HERE"),
        "scatter" => simulate("repeatability: {HERE}"),
        "outliers" => simulate("outliers: {HERE}"),
        "moved" => simulate("outliers: {moved: {frame: t, HERE}}"),
        "link_errors" => simulate("link_errors: {HERE}"),
        "lens_errors" => simulate("lens_errors: {HERE}"),
        "picture" => simulate("picture: {HERE}"),
        "robot_file" => robot_file("", "HERE\n", ""),
        "joint" => robot_file("", "", ", HERE"),
        "target_file" => (
            File::Target,
            format!(
                "cellmap_target: 1\nunits: {{length: m, angle: rad}}\ndictionary: 4x4_50\ntags: [{{id: 1, size: 1, pose: {{{POSE}}}}}]\nHERE\n"
            ),
        ),
        other => panic!("no place for section `{other}`"),
    }
}

/// What is wrong with a file, as (what, remedy).
fn complaints(file: File, text: &str) -> Vec<(String, String)> {
    let path = Path::new("file.yaml");
    let all = match file {
        File::Layout => parse_layout(path, text, None).err().map_or_else(Vec::new, |error| error.0),
        File::Robot => parse_model(path, text, None).err().unwrap_or_default(),
        File::Target => parse_target(path, text, None).err().unwrap_or_default(),
        File::Intrinsics => parse_intrinsics(path, text).err().unwrap_or_default(),
    };
    all.into_iter().map(|c| (c.what, c.remedy)).collect()
}

#[test]
fn the_table_has_exactly_the_keys_that_the_parser_reads() {
    for section in SECTIONS {
        let (file, text) = place(section.name);
        let found = complaints(file, &text.replace("HERE", "qqqqqqqqqqqqqqqq: 1"));
        let known = found.iter().find(|(what, _)| what.contains("unknown key `qqqqqqqqqqqqqqqq`"));
        let (_, remedy) = known.unwrap_or_else(|| panic!("{}: {found:?}", section.name));
        let parsed: BTreeSet<&str> = remedy.split('`').skip(1).step_by(2).collect();
        let table: BTreeSet<&str> = section.keys.iter().map(|key| key.name).collect();
        assert_eq!(parsed, table, "section `{}`", section.name);
    }
}

fn as_json(node: &Node) -> Json {
    match &node.value {
        Value::Scalar { text, quoted: true } => json!(text),
        Value::Scalar { text, .. } => match text.as_str() {
            "" | "~" | "null" => Json::Null,
            "true" => json!(true),
            "false" => json!(false),
            _ => text
                .parse::<i64>()
                .map(Json::from)
                .or_else(|_| text.parse::<f64>().map(Json::from))
                .unwrap_or_else(|_| json!(text)),
        },
        Value::Sequence(items) => Json::Array(items.iter().map(|item| as_json(item)).collect()),
        Value::Mapping(entries) => {
            Json::Object(entries.iter().map(|(key, _, node)| (key.clone(), as_json(node))).collect())
        }
    }
}

fn errors(file: File, text: &str) -> Vec<String> {
    let validator = jsonschema::validator_for(&json_schema(file)).unwrap();
    let value = as_json(&parse(text).unwrap());
    validator.iter_errors(&value).map(|error| format!("{}: {error}", error.instance_path())).collect()
}

#[test]
fn every_layout_and_robot_of_the_project_is_valid() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("layouts");
    let mut count = 0;
    for (folder, robots) in [(folder.clone(), false), (folder.join("robots"), true)] {
        for entry in
            std::fs::read_dir(folder).unwrap().flatten().filter(|e| e.path().extension().is_some_and(|x| x == "yaml"))
        {
            let text = std::fs::read_to_string(entry.path()).unwrap();
            let file = match (robots, text.contains("cellmap_target:")) {
                (true, _) => File::Robot,
                (_, true) => File::Target,
                _ => File::Layout,
            };
            let found = errors(file, &text);
            assert!(found.is_empty(), "{}: {found:#?}", entry.path().display());
            count += 1;
        }
    }
    assert!(count > 12, "{count}");
    for section in SECTIONS {
        let (file, text) = place(section.name);
        let text = text.replace(", HERE", "").replace("HERE", "");
        assert!(errors(file, &text).is_empty(), "{}: {:?}", section.name, errors(file, &text));
    }
}

/// Mistakes that people make: both must see each of them.
#[test]
fn the_schema_flags_the_common_mistakes_that_check_flags() {
    let good = "cellmap: 1\nunits: {length: mm, angle: deg}\nworld: table\n\
        cameras:\n  left:\n    images: a/{configuration}.png\n    intrinsics: {model: brown, size: [1280, 720], focal: [920, 920], centre: [640, 360]}\n    refine: [focal]\n\
        robots:\n  arm: {model: ur5e, joints: joints.csv, identify: {lengths: {sigma: 1}}}\n\
        targets:\n  table: {tags: {dictionary: 6x6_250, size: 50, ids: [1]}}\n  tool: {checkerboard: {corners: [5, 4], square: 20}, mount: arm.flange, pose: {xyz: [0, 0, 1], rpy: [0, 0, 0], sigma: {xyz: 2, rotation: 1}}}\n\
        solve: {loss: {huber: 1.5}, pixel_sigma: 0.1}\n";
    assert_eq!((complaints(File::Layout, good), errors(File::Layout, good)), (vec![], vec![]));
    for (from, to) in [
        ("cellmap: 1", "cellmap: 2"),
        ("cellmap: 1\n", ""),
        ("length: mm", "length: furlong"),
        ("{length: mm, angle: deg}", "{length: mm}"),
        ("world: table\n", ""),
        ("cameras:", "camera:"),
        ("images:", "image:"),
        ("model: brown", "model: browne"),
        ("size: [1280, 720]", "size: [1280]"),
        ("size: [1280, 720]", "size: [1280, 0]"),
        ("focal: [920, 920]", "focal: 920"),
        ("centre: [640, 360]", "center: [640, 360]"),
        ("refine: [focal]", "refine: [focus]"),
        ("refine: [focal]", "refine: focal"),
        ("model: ur5e", "model: ur6e"),
        ("joints: joints.csv", "joint: joints.csv"),
        (", joints: joints.csv", ""),
        ("lengths: {sigma: 1}", "lengths: {sigma: -1}"),
        ("lengths: {sigma: 1}", "length: {sigma: 1}"),
        ("6x6_250", "6x6_251"),
        ("size: 50", "size: -50"),
        ("size: 50, ", ""),
        ("ids: [1]", "ids: 1"),
        ("ids: [1]", "ids: []"),
        ("ids: [1]", "grid: {columns: 2, rows: 2, size: 5, gap: 1}, cube: {edge: 5, size: 3, ids: [3]}"),
        ("corners: [5, 4]", "corners: [5.5, 4]"),
        ("square: 20", "square: twenty"),
        ("checkerboard: {", "points: {a: [0, 0, 0]}, checkerboard: {"),
        ("rpy: [0, 0, 0], ", ""),
        ("rpy: [0, 0, 0]", "rpy: [0, 0, 0], rotvec: [0, 0, 0]"),
        ("xyz: [0, 0, 1]", "xyz: [0, 0]"),
        ("sigma: {xyz: 2, rotation: 1}", "sigma: {xyz: 2}"),
        ("sigma: {xyz: 2, rotation: 1}", "sigma: {xyz: 2, rotation: 1}, start: true"),
        ("loss: {huber: 1.5}", "loss: {huber: 1.5, tukey: 3}"),
        ("loss: {huber: 1.5}", "loss: square"),
        ("pixel_sigma: 0.1", "pixel_sigma: 0"),
        ("  tool:", "  world:"),
    ] {
        assert!(good.contains(from), "{from}");
        let bad = good.replacen(from, to, 1);
        assert!(!complaints(File::Layout, &bad).is_empty(), "check does not flag `{to}` for `{from}`");
        assert!(!errors(File::Layout, &bad).is_empty(), "the schema does not flag `{to}` for `{from}`");
    }
}

#[test]
fn every_spelling_of_a_dictionary_is_valid() {
    for name in [
        "6x6_250",
        "DICT_6X6_250",
        "aruco_original",
        "original",
        "36h11",
        "APRILTAG_36H11",
        "standard41h12",
        "mip_36h12",
    ] {
        let text = format!("{HEAD}targets: {{t: {{tags: {{dictionary: {name}, size: 1, ids: [1]}}}}}}\n");
        assert_eq!((complaints(File::Layout, &text), errors(File::Layout, &text)), (vec![], vec![]), "{name}");
    }
}

#[test]
fn the_books_key_page_is_the_table() {
    let page = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/src/keys.md")).unwrap();
    assert_eq!(page.trim_end(), markdown().trim_end(), "run `cellmap schema --page > docs/src/keys.md`");
}
