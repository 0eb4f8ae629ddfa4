//! Several pictures of a robot that stands still: what the first two show is expected in the others, and the result is the same.

#[path = "support/program.rs"]
mod program;
#[path = "support/rendering.rs"]
mod rendering;
#[path = "support/scene.rs"]
mod scene;

use std::collections::BTreeMap;
use std::path::Path;

use cellmap::detect::GreyPicture;
use cellmap::detect::native::Sight;
use program::{folder, json, run, stderr};
use rendering::Random;
use scene::{Scene, USUAL};

/// The picture with other noise on top, and light patches, `[column, row, edge, grey levels]`.
fn again(picture: &GreyPicture, seed: u64, patches: &[[usize; 4]]) -> GreyPicture {
    let mut random = Random(seed);
    let width = picture.width();
    let pixels = picture.pixels().iter().enumerate().map(|(k, value)| {
        let (column, row) = (k % width, k / width);
        let inside = |[x, y, edge, _]: &[usize; 4]| (*x..x + edge).contains(&column) && (*y..y + edge).contains(&row);
        let added: usize = patches.iter().filter(|patch| inside(patch)).map(|patch| patch[3]).sum();
        (f64::from(*value) + added as f64 + random.between(-3.0, 3.0)).round().clamp(0.0, 255.0) as u8
    });
    GreyPicture::new(width, picture.height(), pixels.collect()).unwrap()
}

#[test]
fn only_noise_shows_the_same() {
    for clutter in [false, true] {
        let (picture, _) = Scene { clutter, ..USUAL }.render(5, None);
        let sight = Sight::of(&picture);
        assert!(sight.is_of(&picture));
        for seed in 0..5 {
            assert!(sight.is_of(&again(&picture, seed, &[])));
            // Something that a tag's border could be a part of: few pixels, little contrast.
            let place = [100 + 137 * seed as usize, 50 + 91 * seed as usize];
            assert!(!sight.is_of(&again(&picture, seed, &[[place[0], place[1], 8, 25]])), "{clutter} {place:?}");
        }
        let (other, _) = Scene { clutter, ..USUAL }.render(6, None);
        assert!(!sight.is_of(&other));
    }
    let [wide, high] = [[64, 32], [32, 64]].map(|[width, height]| GreyPicture::new(width, height, vec![9; 2048]));
    assert!(!Sight::of(&wide.unwrap()).is_of(&high.unwrap()));
}

/// Pixel and variances of each corner.
fn read(path: &Path) -> BTreeMap<String, [f64; 4]> {
    let text = std::fs::read_to_string(path).unwrap();
    let line = |line: &str| {
        let fields: Vec<&str> = line.split(',').collect();
        let number = |k: usize| fields[k].parse().unwrap();
        (fields[..6].join(","), [number(6), number(7), number(8), number(10)])
    };
    text.lines().skip(1).map(line).collect()
}

#[test]
fn what_the_first_two_pictures_show_is_found_in_the_others_as_without_them() {
    let original =
        std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/layouts/paper_experiment_a.yaml")).unwrap();
    let layout = original.replace("configurations: 250", "configurations: 2").replace("shots: 10", "shots: 5");
    let dir = folder(&[("a.yaml", &layout)]);
    for file in ["gridboard_base.yaml", "gridboard_tool.yaml"] {
        std::fs::copy(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/layouts")).join(file), dir.path().join(file))
            .unwrap();
    }
    let made = run(dir.path(), &["simulate", "a.yaml", "--out", "a", "--pictures", "--json"]);
    assert_eq!(made.status.code(), Some(0), "{}", stderr(&made));
    assert_eq!(json(&made)["pictures"], 30);
    // The robot moves too early: this picture is another configuration's. And one cannot be read.
    let pictures = dir.path().join("a/images");
    let kind = if pictures.join("cam1/001_00.png").exists() { "png" } else { "jpg" };
    let at = |name: &str| pictures.join(format!("{name}.{kind}"));
    std::fs::copy(at("cam2/002_01"), at("cam2/001_02")).unwrap();
    std::fs::write(at("cam3/001_00"), "no picture").unwrap();
    let detect = |out: &str, more: &[&str]| {
        let done = run(dir.path(), &[&["detect", "a/layout.yaml", "--out", out, "--json"], more].concat());
        assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
        assert_eq!(json(&done)["failed"].as_array().map(Vec::len), Some(1));
        std::fs::read(dir.path().join(out)).unwrap()
    };
    let with = detect("with.csv", &["--threads", "2"]);
    assert_eq!(with, detect("alone.csv", &["--threads", "1"]));
    let without = detect("without.csv", &["--search-all"]);
    assert_ne!(with, without, "nothing was expected from the first pictures");
    let (with, without) = (read(&dir.path().join("with.csv")), read(&dir.path().join("without.csv")));
    // A tag at the limit of what can be read may be read in one of the two and in the other not.
    let both = with.keys().filter(|key| without.contains_key(*key)).count();
    assert!(
        both * 100 >= with.len() * 97 && both * 100 >= without.len() * 97,
        "{both} {} {}",
        with.len(),
        without.len()
    );
    let (mut squares, mut count) = (0.0, 0.0);
    for (key, a) in &with {
        let Some(b) = without.get(key) else { continue };
        // First pictures, the one that shows something else, and those whose first picture cannot be read are searched.
        if key.starts_with("1,0,")
            || key.starts_with("2,1,")
            || key.starts_with("1,2,cam2")
            || (key.starts_with("1,") && key.contains("cam3"))
        {
            assert_eq!(a, b, "{key}");
        }
        squares += (a[0] - b[0]).powi(2) / b[2] + (a[1] - b[1]).powi(2) / b[3];
        count += 2.0;
    }
    assert!(count > 500.0, "{count}");
    // In standard deviations of what noise does to a corner.
    let apart = f64::sqrt(squares / count);
    assert!(apart < 0.5, "{apart}");
}
