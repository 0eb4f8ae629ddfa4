//! Parsers meet anything: they answer or complain, and never panic.

use cellmap::layout::images::ImagePattern;
use cellmap::layout::{parse_layout, parse_model, parse_target, yaml};
use cellmap::recording::{read_detections, read_joints};
use proptest::prelude::*;
use std::path::Path;

const LAYOUT: &str = include_str!("../layouts/two_robots.yaml");

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    #[test]
    fn any_text_is_yaml_or_is_refused(text in "\\PC{0,200}") {
        let _ = yaml::parse(&text);
        let _ = parse_layout(Path::new("x.yaml"), &text, None);
    }

    #[test]
    fn yaml_punctuation_never_panics(text in "[\\[\\]{}:,&*a-c \\n'\"|>#!%@-]{0,120}") {
        let _ = yaml::parse(&text);
    }

    #[test]
    fn a_layout_with_a_piece_missing_or_changed_is_read_or_refused(start in 0usize..3000, length in 0usize..60, put in "[ -~]{0,12}") {
        let start = LAYOUT.char_indices().map(|(i, _)| i).nth(start.min(LAYOUT.chars().count() - 1)).unwrap();
        let end = LAYOUT[start..].char_indices().map(|(i, _)| i + start).nth(length).unwrap_or(LAYOUT.len());
        let text = format!("{}{put}{}", &LAYOUT[..start], &LAYOUT[end..]);
        if let Err(error) = parse_layout(Path::new("x.yaml"), &text, None) {
            prop_assert!(!error.0.is_empty());
            for complaint in error.0 {
                prop_assert!(!complaint.what.is_empty() && !complaint.remedy.is_empty());
            }
        }
    }

    #[test]
    fn models_and_targets_never_panic(text in "(cellmap_robot|cellmap_target|units|joints|tags|convention|dictionary|[:\\[\\]{}, \\n0-9a-z.-]){0,80}") {
        let _ = parse_model(Path::new("x.yaml"), &text, None);
        let _ = parse_target(Path::new("x.yaml"), &text, None);
    }

    #[test]
    fn tables_never_panic(body in "[0-9a-z,.\\n\"-]{0,200}") {
        let layout = parse_layout(Path::new("x.yaml"), LAYOUT, None).unwrap();
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("t.csv");
        std::fs::write(&path, format!("configuration,shot,camera,target,tag,corner,u,v\n{body}")).unwrap();
        let _ = read_detections(&path, &layout);
        std::fs::write(&path, format!("configuration,robot,q1,q2,q3,q4,q5,q6\n{body}")).unwrap();
        let _ = read_joints(&path, &layout, 0);
    }

    #[test]
    fn picture_names_are_found_again(configuration in 0u64..1_000_000, shot in 0u64..100, wide in 0usize..8) {
        let dir = tempfile::tempdir().unwrap();
        let pattern = ImagePattern::parse(&format!("in/{{configuration:0{wide}}}/p_{{shot:02}}.png")).unwrap();
        let path = pattern.path(dir.path(), configuration, shot);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, "").unwrap();
        std::fs::write(path.with_file_name("p_x.png"), "").unwrap();
        let found = pattern.find(dir.path());
        prop_assert_eq!(found.len(), 1);
        prop_assert_eq!((found[0].configuration, found[0].shot), (configuration, shot));
    }
}

#[test]
fn picture_patterns_say_what_is_wrong() {
    assert_eq!(ImagePattern::parse("a/b.png").unwrap_err(), "has no `{configuration}`");
    assert_eq!(ImagePattern::parse("a/{configuration").unwrap_err(), "has an unbalanced brace");
    assert_eq!(ImagePattern::parse("{configration}.png").unwrap_err(), "has the unknown placeholder `{configration}`");
}

#[test]
fn deep_nesting_is_refused() {
    assert_eq!(yaml::parse(&"[".repeat(100)).unwrap_err().what, "the nesting is too deep");
    assert!(yaml::parse(&"[".repeat(100_000)).is_err());
    assert!(yaml::parse(&"{a: ".repeat(100_000)).is_err());
}
