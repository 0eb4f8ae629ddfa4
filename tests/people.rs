//! From an empty folder to a robot description, as the README and the book tell it; `new` with its words; help, completions and the manual page.

#[path = "support/program.rs"]
mod program;

use program::{contents, folder, json, run, stderr, stdout};

fn fine(dir: &std::path::Path, arguments: &[&str]) -> std::process::Output {
    let output = run(dir, arguments);
    assert_eq!(output.status.code(), Some(0), "{arguments:?}\n{}\n{}", stdout(&output), stderr(&output));
    output
}

/// The commands of the first block after a heading, a word an element; a line that ends in `\\` goes on in the next.
fn commands(page: &str, heading: &str) -> Vec<Vec<String>> {
    let block = page.split(heading).nth(1).unwrap().split("```sh\n").nth(1).unwrap().split("```").next().unwrap();
    let joined = block.replace("\\\n", " ");
    joined.lines().map(|line| line.split_whitespace().map(str::to_owned).collect()).collect()
}

/// The commands are the README's own, and the book's quick start has the same.
#[test]
fn the_whole_way_from_an_empty_folder() {
    let project = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let [readme, book] =
        ["README.md", "docs/src/quick_start.md"].map(|page| std::fs::read_to_string(project.join(page)).unwrap());
    let all = commands(&readme, "## From an empty folder");
    assert_eq!(all, commands(&book, "# Quick start"));
    let told: Vec<&str> = all.iter().map(|words| words[1].as_str()).collect();
    assert_eq!(told, ["new", "check", "print", "simulate", "detect", "solve", "compare", "export"]);
    let dir = folder(&[]);
    let at = dir.path();
    let mut said = Vec::new();
    for words in &all {
        assert_eq!(words[0], "cellmap");
        let words: Vec<&str> = words[1..].iter().map(String::as_str).collect();
        said.push(stdout(&fine(at, &words)));
        if words[0] == "new" {
            // The one edit by hand: where the pallet stands.
            let text = std::fs::read_to_string(at.join("cell.yaml")).unwrap();
            let edited = text.replace(
                "pose: {xyz: [-330, 60, 40], rpy: [2, 1, 25], unknown: true}",
                "pose: {xyz: [-300, 40, 30], rpy: [0, 0, 10], unknown: true}",
            );
            assert_ne!(text, edited);
            std::fs::write(at.join("cell.yaml"), edited).unwrap();
        }
    }
    // What the book shows of `check` is what it says.
    let shown = book.split("```text\n").nth(1).unwrap().split("```").next().unwrap();
    assert!(said[1].starts_with(shown) && said[1].contains("The layout is fine."), "{}", said[1]);
    assert!(std::fs::read(at.join("targets.pdf")).unwrap().starts_with(b"%PDF-"));
    let compared = json(&fine(at, &["compare", "cell/solution.yaml", "cell/truth.yaml", "--json"]));
    assert!(compared["worst_translation_mm"].as_f64().unwrap() < 1.0, "{compared}");
    let solution = cellmap::layout::read_layout(&at.join("cell/solution.yaml"), None).unwrap();
    let pallet = solution.targets.iter().find(|target| target.name == "pallet").unwrap().pose.pose().unwrap();
    assert!((pallet.translation - nalgebra::Vector3::new(-0.3, 0.04, 0.03)).norm() < 1e-3, "{pallet:?}");
    let urdf = urdf_rs::read_file(at.join("cell.urdf")).unwrap();
    let joint = urdf.joints.iter().find(|joint| joint.child.link == "pallet").unwrap();
    for (found, expected) in joint.origin.xyz.0.iter().zip(pallet.translation.iter()) {
        assert!((found - expected).abs() < 1e-9);
    }
    assert!(urdf.links.iter().any(|link| link.name == "wrist_optical_frame"));
    let html = std::fs::read_to_string(at.join("report.html")).unwrap();
    assert!(html.contains("data:image/jpeg;base64,"), "the worst pictures are shown");
}

#[test]
fn a_new_layout_says_what_it_is_told() {
    let dir = folder(&[]);
    let at = dir.path();
    // Without a terminal nothing is asked: defaults.
    fine(at, &["new", "plain.yaml"]);
    fine(at, &["check", "plain.yaml"]);
    // Every kind of target, on tables and flanges, boards as worlds, several robots: all pass check and can be simulated and solved.
    for (name, words) in [
        ("boards.yaml", ["a=ur5e,b=ur10e", "n,e,s,w,h@b", "table:charuco,ta:cube@a,tb:checkerboard@b,p:aprilgrid"]),
        ("twins.yaml", ["ur3,ur3", "one,two,three", "t:grid,x:charuco@ur3,y:tag@ur3_2"]),
        ("hand.yaml", ["ur3", "c1,c2,c3", "tool:charuco@ur3"]),
    ] {
        fine(at, &["new", name, "--robots", words[0], "--cameras", words[1], "--targets", words[2]]);
        fine(at, &["check", name]);
        fine(at, &["simulate", name, "--out", "made", "--force"]);
        fine(at, &["solve", "made/layout.yaml"]);
    }
    let before = contents(at);
    let again = run(at, &["new", "plain.yaml"]);
    assert_eq!(again.status.code(), Some(2));
    assert!(
        stderr(&again).contains("the file is there already") && stderr(&again).contains("--force"),
        "{}",
        stderr(&again)
    );
    for (words, what) in [
        (["--robots", "ur6"], "there is no built-in robot `ur6`"),
        (["--cameras", "a b"], "the name `a b` has a character that names cannot have"),
        (["--targets", "t:pyramid"], "`pyramid` is no kind of target"),
        (["--targets", "t:tag@nobody"], "`t` is mounted on `nobody`, which is no robot of the cell"),
        (["--cameras", "left,left"], "the name `left` is taken"),
    ] {
        let output = run(at, &["new", "bad.yaml", words[0], words[1]]);
        assert_eq!(output.status.code(), Some(2), "{words:?}");
        assert!(stderr(&output).contains(what), "{}", stderr(&output));
    }
    assert_eq!(before, contents(at), "nothing was written");
    fine(at, &["new", "plain.yaml", "--force", "--robots", "arm=reported"]);
    assert!(std::fs::read_to_string(at.join("plain.yaml")).unwrap().contains("flange_poses: flange_poses.csv"));
}

/// The layouts to copy from are described but not recorded: `check` explains each within 80 columns.
#[test]
fn every_layout_of_the_project_passes_check() {
    let project = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut count = 0;
    for entry in std::fs::read_dir(project.join("layouts")).unwrap().flatten() {
        let text = std::fs::read_to_string(entry.path()).unwrap_or_default();
        if !text.contains("cellmap: 1") {
            continue;
        }
        let said = stdout(&fine(project, &["check", entry.path().to_str().unwrap()]));
        assert!(said.contains("The layout is fine."), "{said}");
        assert!(said.lines().all(|line| line.chars().count() <= 80), "{said}");
        count += 1;
    }
    assert!(count >= 8, "{count}");
}

/// On a terminal `new` asks, and asks again where an answer cannot be. `script` lends the terminal.
#[cfg(target_os = "linux")]
#[test]
fn on_a_terminal_new_asks() {
    use std::io::Write;
    use std::process::{Command, Stdio};
    let dir = folder(&[]);
    let command = format!("{} new cell.yaml", env!("CARGO_BIN_EXE_cellmap"));
    let child = Command::new("script")
        .args(["-qec", &command, "/dev/null"])
        .current_dir(dir.path())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn();
    let Ok(mut child) = child else {
        println!("skipped: no `script`");
        return;
    };
    child.stdin.take().unwrap().write_all(b"ur6\nur10e\n\ntable:charuco tool:cube@ur10e\n").unwrap();
    let output = child.wait_with_output().unwrap();
    let said = stdout(&output);
    assert!(output.status.success(), "{said}");
    assert!(said.contains("there is no built-in robot `ur6`: built in are `ur3`"), "{said}");
    assert_eq!(said.matches("Robots: ").count(), 2, "{said}");
    assert!(said.contains("[table:grid,tool:cube@ur10e]: ") && said.contains("wrote cell.yaml"), "{said}");
    let checked = stdout(&fine(dir.path(), &["check", "cell.yaml"]));
    assert!(checked.contains("target `table`: ChArUco board") && checked.contains("├─ left  (unknown)"), "{checked}");
}

#[test]
fn a_robot_description_becomes_a_layout() {
    let urdf = "<robot name=\"my arm\"><link name=\"world\"/><link name=\"base\"/><link name=\"l1\"/><link name=\"l2\"/><link name=\"tool0\"/><link name=\"lamp\"/>\
        <joint name=\"w\" type=\"fixed\"><parent link=\"world\"/><child link=\"base\"/></joint>\
        <joint name=\"a\" type=\"revolute\"><parent link=\"base\"/><child link=\"l1\"/><axis xyz=\"0 0 1\"/><limit lower=\"-1\" upper=\"1\" effort=\"1\" velocity=\"1\"/></joint>\
        <joint name=\"b\" type=\"continuous\"><parent link=\"l1\"/><child link=\"l2\"/><axis xyz=\"0 1 0\"/></joint>\
        <joint name=\"c\" type=\"fixed\"><parent link=\"l2\"/><child link=\"tool0\"/></joint>\
        <joint name=\"d\" type=\"fixed\"><parent link=\"l2\"/><child link=\"lamp\"/></joint></robot>";
    let dir = folder(&[("robots/arm.urdf", urdf)]);
    fine(dir.path(), &["new", "cell.yaml", "--from-urdf", "robots/arm.urdf"]);
    let text = std::fs::read_to_string(dir.path().join("cell.yaml")).unwrap();
    assert!(text.contains("my_arm:\n    model: {urdf: robots/arm.urdf, base: base, tip: tool0}"), "{text}");
    let checked = stdout(&fine(dir.path(), &["check", "cell.yaml"]));
    assert!(checked.contains("robot `my_arm`: 2 joints, nothing recorded yet"), "{checked}");
    let output = run(dir.path(), &["new", "other.yaml", "--from-urdf", "cell.yaml"]);
    assert_eq!(output.status.code(), Some(2));
}

#[test]
fn every_help_fits_a_screen_and_shows_an_example() {
    let at = std::path::Path::new(".");
    let all = stdout(&fine(at, &["--help"]));
    let names: Vec<&str> = all
        .lines()
        .skip_while(|line| *line != "Commands:")
        .skip(1)
        .take_while(|line| !line.is_empty())
        .filter_map(|line| line.split_whitespace().next())
        .collect();
    assert!(names.len() >= 14 && names.contains(&"new") && names.contains(&"export"), "{names:?}");
    for name in names.iter().filter(|name| **name != "help") {
        let help = stdout(&fine(at, &[name, "--help"]));
        assert!(help.lines().count() <= 30, "{name}: {} lines", help.lines().count());
        assert!(help.lines().all(|line| line.chars().count() <= 80), "{name}");
        assert!(help.contains("Example"), "{name}");
        // The example is of this command, and its flags are flags of the command.
        let example = help.split("Example").nth(1).unwrap();
        let line = example.lines().find(|line| line.trim_start().starts_with(&format!("cellmap {name}")));
        let line = line.unwrap_or_else(|| panic!("{name}: {example}"));
        for flag in line.split_whitespace().filter(|word| word.starts_with("--")) {
            assert!(help.contains(&format!("  {flag} ")), "{name}: {flag}");
        }
    }
    assert!(all.lines().all(|line| line.chars().count() <= 80));
    assert!(all.lines().count() <= 24 && all.contains("Example"), "{all}");
}

#[test]
fn shells_and_manuals_know_the_commands() {
    let at = std::path::Path::new(".");
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let text = stdout(&fine(at, &["completions", shell]));
        assert!(text.contains("cellmap") && text.contains("simulate"), "{shell}");
    }
    let page = stdout(&fine(at, &["man"]));
    assert!(page.contains(".TH cellmap") && page.contains("export"), "{page}");
    assert!(stdout(&fine(at, &["man", "solve"])).contains("\\-\\-report"));
    assert_eq!(run(at, &["man", "slove"]).status.code(), Some(2));
}
