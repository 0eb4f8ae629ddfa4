//! The book and the README: every link leads somewhere, every layout passes `check`, every command and flag exists, every error is listed.

#[path = "support/error_page.rs"]
mod error_page;
#[path = "support/program.rs"]
mod program;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use program::{folder, run, stderr, stdout};

fn project() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Every page with its text: the book's, the README, the changelog.
fn pages() -> Vec<(PathBuf, String)> {
    let mut paths: Vec<PathBuf> =
        std::fs::read_dir(project().join("docs/src")).unwrap().flatten().map(|entry| entry.path()).collect();
    paths.retain(|path| path.extension().is_some_and(|kind| kind == "md"));
    paths.sort();
    paths.extend(["README.md", "CHANGELOG.md"].map(|name| project().join(name)));
    let read = |path: PathBuf| (path.clone(), std::fs::read_to_string(&path).unwrap());
    paths.into_iter().map(read).collect()
}

/// Fenced blocks of a page: what stands behind the fence, and the text.
fn blocks(text: &str) -> Vec<(String, String)> {
    let mut all = Vec::new();
    let mut open: Option<(String, String)> = None;
    for line in text.lines() {
        match (line.strip_prefix("```"), &mut open) {
            (Some(kind), None) => open = Some((kind.to_owned(), String::new())),
            (Some(_), Some(_)) => all.extend(open.take()),
            (None, Some((_, inside))) => inside.push_str(&format!("{line}\n")),
            (None, None) => {}
        }
    }
    assert!(open.is_none(), "a block does not end");
    all
}

/// A page without its fenced blocks.
fn prose(text: &str) -> String {
    text.split("```").step_by(2).collect()
}

/// A heading as an address.
fn slug(heading: &str) -> String {
    let words = heading.trim_start_matches('#').trim().to_lowercase();
    words.chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c)).collect::<String>().replace(' ', "-")
}

#[test]
fn every_link_leads_somewhere() {
    let all = pages();
    let headings: BTreeMap<PathBuf, BTreeSet<String>> = all
        .iter()
        .map(|(path, text)| {
            let lines = prose(text);
            (path.clone(), lines.lines().filter(|line| line.starts_with('#')).map(slug).collect())
        })
        .collect();
    let mut linked = BTreeSet::new();
    for (path, text) in &all {
        let text = prose(text);
        for part in text.split("](").skip(1) {
            let target = part.split(')').next().unwrap();
            if target.starts_with("http") {
                assert!(target.starts_with("https://"), "{}: {target}", path.display());
                continue;
            }
            let (file, anchor) = target.split_once('#').map_or((target, None), |(file, anchor)| (file, Some(anchor)));
            let there = if file.is_empty() { path.clone() } else { path.parent().unwrap().join(file) };
            assert!(there.exists(), "{}: {target}", path.display());
            if let Some(anchor) = anchor {
                let there = headings.iter().find(|(known, _)| known.canonicalize().ok() == there.canonicalize().ok());
                assert!(there.is_some_and(|(_, known)| known.contains(anchor)), "{}: {target}", path.display());
            }
            if path.ends_with("SUMMARY.md") {
                linked.insert(target.to_owned());
            }
        }
    }
    let book = all.iter().filter(|(path, _)| path.parent().unwrap().ends_with("src"));
    let names = book.map(|(path, _)| path.file_name().unwrap().to_str().unwrap().to_owned());
    let names: BTreeSet<String> = names.filter(|name| name != "SUMMARY.md").collect();
    assert_eq!(names, linked, "the summary lists the pages");
}

#[test]
fn the_pictures_are_small_and_used() {
    let mut bytes = 0;
    let text: String = pages().into_iter().map(|(_, text)| text).collect();
    for entry in std::fs::read_dir(project().join("docs/src/pictures")).unwrap().flatten() {
        bytes += entry.metadata().unwrap().len();
        let name = entry.file_name().into_string().unwrap();
        assert!(text.contains(&format!("pictures/{name}")), "{name} is shown nowhere");
    }
    assert!(bytes < 2 << 20, "{bytes}");
}

#[test]
fn every_layout_passes_check() {
    let mut layouts = 0;
    for (path, text) in pages() {
        for (kind, inside) in blocks(&text) {
            match kind.as_str() {
                "yaml" => {
                    let dir = folder(&[("layout.yaml", &inside)]);
                    let output = run(dir.path(), &["check", "layout.yaml"]);
                    let said = format!("{}\n{}\n{}", path.display(), stdout(&output), stderr(&output));
                    assert_eq!(output.status.code(), Some(0), "{said}");
                    layouts += 1;
                }
                "yaml,robot" => {
                    let layout = "cellmap: 1\nunits: {length: m, angle: rad}\nworld: r.base\nrobots: {r: {model: {mdh: r.yaml}, joints: j.csv}}\n\
                        targets: {t: {mount: r.flange}}\n";
                    let dir = folder(&[("r.yaml", &inside), ("layout.yaml", layout)]);
                    let output = run(dir.path(), &["check", "layout.yaml"]);
                    assert!(stdout(&output).contains("robot `r`: 6 joints"), "{}", stderr(&output));
                    layouts += 1;
                }
                "" | "sh" | "text" | "csv" => {}
                other => panic!("{}: what is a block of `{other}`?", path.display()),
            }
        }
    }
    assert!(layouts >= 3, "{layouts}");
}

#[test]
fn every_command_and_flag_exists() {
    let help = |words: &[&str]| stdout(&run(project(), &[words, &["--help"]].concat()));
    let commands = help(&[]);
    let commands: BTreeSet<&str> = commands
        .lines()
        .skip_while(|line| *line != "Commands:")
        .skip(1)
        .take_while(|line| !line.is_empty())
        .filter_map(|line| line.split_whitespace().next())
        .collect();
    let mut helps: BTreeMap<String, String> = BTreeMap::new();
    let mut lines = Vec::new();
    for (path, text) in pages() {
        for (kind, inside) in blocks(&text) {
            if kind == "sh" {
                let joined = inside.replace("\\\n", " ");
                lines.extend(joined.lines().map(|line| (path.clone(), line.to_owned())));
            }
        }
        // Between grave accents, on one line or two.
        let spans = prose(&text).replace('\n', " ");
        lines.extend(spans.split('`').skip(1).step_by(2).map(|span| (path.clone(), span.to_owned())));
    }
    let mut count = 0;
    for (path, line) in lines {
        for line in line.split("&&").filter_map(|line| line.trim().strip_prefix("cellmap ")) {
            let words: Vec<&str> = line.split(" #").next().unwrap().split_whitespace().collect();
            if words[0].starts_with('-') || words[0] == "COMMAND" || words[0].chars().any(|c| !c.is_ascii_lowercase()) {
                continue;
            }
            assert!(commands.contains(words[0]), "{}: `{line}`", path.display());
            let own = helps.entry(words[0].to_owned()).or_insert_with(|| help(&[words[0]]));
            for flag in words.iter().filter(|word| word.starts_with("--") && word.len() > 2) {
                assert!(own.contains(&format!("{flag} ")) || *flag == "--help", "{}: `{line}`: {flag}", path.display());
            }
            count += 1;
        }
    }
    assert!(count > 30, "{count}");
}

#[test]
fn the_error_page_is_the_source() {
    let page = std::fs::read_to_string(project().join("docs/src/errors.md")).unwrap();
    let found = error_page::page();
    assert!(
        page.trim_end() == found.trim_end(),
        "run `cargo run --release --example error_page > docs/src/errors.md`; the first line that differs: {:?}",
        found.lines().zip(page.lines()).find(|(a, b)| a != b)
    );
    for known in
        ["| it must be greater than zero |", "| run `cellmap detect` on the layout first |", "`--paper \u{2026}`"]
    {
        assert!(page.contains(known), "{known}");
    }
}
