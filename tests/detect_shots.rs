//! Several pictures of a robot that stands still: what the first shows is expected in the others, and the result is the same.

#[path = "support/program.rs"]
mod program;
#[path = "support/rendering.rs"]
mod rendering;
#[path = "support/scene.rs"]
mod scene;

use std::collections::BTreeMap;
use std::path::Path;

use cellmap::detect::native::{NativeDetector, Sight};
use cellmap::detect::{Corner, Detector, Expected, ExpectedTag, GreyPicture, Pattern};
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

/// The picture in more or less light, with noise of two grey levels.
fn shot(picture: &GreyPicture, seed: u64, light: f64) -> GreyPicture {
    let mut random = Random(seed);
    let pixels = picture.pixels().iter().map(|value| f64::from(*value) + light + 2.0 * random.normal());
    let pixels = pixels.map(|value| value.round().clamp(0.0, 255.0) as u8);
    GreyPicture::new(picture.width(), picture.height(), pixels.collect()).unwrap()
}

fn look(picture: &GreyPicture, expected: &Expected) -> Vec<Corner> {
    let wanted = [Pattern::Tags { dictionary: USUAL.dictionary, ids: (0..250).collect() }];
    NativeDetector::new().detect_expected(picture, None, &wanted, expected).unwrap()
}

/// What a picture says of others that show the same.
fn known(picture: &GreyPicture) -> Expected {
    let wanted = [Pattern::Tags { dictionary: USUAL.dictionary, ids: (0..250).collect() }];
    let detector = NativeDetector::new();
    let (found, known) = detector.detect_known(picture, None, &wanted, &Expected::default()).unwrap();
    assert_eq!(found, detector.detect(picture, None, &wanted).unwrap());
    let whole = found.chunk_by(|a, b| a.tag == b.tag).filter(|four| four.len() == 4);
    let tags: Vec<ExpectedTag> = whole
        .map(|four| ExpectedTag {
            dictionary: USUAL.dictionary,
            id: four[0].tag.unwrap(),
            corners: [0, 1, 2, 3].map(|k: usize| four[k].pixel),
        })
        .collect();
    Expected { tags, known, all: true }
}

/// Small tags are measured by all of their cells, large ones by lines, with a camera that answers to light in proportion or does not.
#[test]
fn a_known_tag_is_measured_by_each_picture_alone() {
    let large = Scene { noise: 0.0, ..USUAL };
    for scene in [Scene { size: [18.0, 26.0], ..large }, large, Scene { gamma: 2.2, tilt: [0.0, 0.8], ..large }] {
        measured_by_each_picture_alone(&scene);
    }
}

fn measured_by_each_picture_alone(scene: &Scene) {
    // Of each way to measure: squared errors, the same in standard deviations, products with the first picture's errors, how many.
    let mut sums = [[0.0; 4]; 2];
    for seed in 0..6 {
        let (clean, truth) = scene.render(seed, None);
        let first = shot(&clean, 2 * seed, 0.0);
        let expected = known(&first);
        assert!(expected.known.len() > truth.len() / 2, "{} of {}", expected.known.len(), truth.len());
        let second = shot(&clean, 2 * seed + 1, 3.0);
        let before = look(&first, &Expected::default());
        let (with, without) = (look(&second, &expected), look(&second, &Expected::default()));
        for (found, sums) in [with, without].iter().zip(&mut sums) {
            for corner in found {
                let same = |other: &&Corner| (other.tag, other.corner) == (corner.tag, corner.corner);
                let Some(before) = before.iter().find(same) else { continue };
                let truth =
                    truth.iter().find(|tag| Some(tag.id) == corner.tag).unwrap().corners[corner.corner as usize];
                let ([x, y], [uu, uv, vv]) =
                    ([0, 1].map(|axis: usize| corner.pixel[axis] - truth[axis]), corner.covariance.unwrap());
                let determinant = uu * vv - uv * uv;
                sums[0] += x * x + y * y;
                sums[1] += (x * x * vv - 2.0 * x * y * uv + y * y * uu) / determinant;
                sums[2] += x * (before.pixel[0] - truth[0]) + y * (before.pixel[1] - truth[1]);
                sums[3] += 2.0;
            }
        }
    }
    let [with, without] = sums.map(|[squares, normalised, products, count]| {
        (f64::sqrt(squares / count), normalised / count, products / squares, count)
    });
    assert!(with.3 > 200.0 && (with.3 - without.3).abs() < 0.03 * with.3, "{with:?} {without:?}");
    assert!(with.0 < 1.05 * without.0, "{with:?} {without:?}");
    assert!((0.85..1.15).contains(&(with.1 / without.1)), "{with:?} {without:?}");
    // What is wrong in the first picture is not wrong in the second for it.
    assert!(with.2 < without.2 + 0.1, "{with:?} {without:?}");
}

#[test]
fn a_known_tag_in_another_picture_is_not_believed() {
    for scene in [Scene { size: [18.0, 26.0], ..USUAL }, USUAL] {
        let (first, other) = (scene.render(1, None).0, scene.render(2, None).0);
        assert_eq!(look(&other, &known(&first)), look(&other, &Expected::default()));
        // Nor in one of another size, whatever it shows.
        let [width, height] = [first.width() - 8, first.height()];
        let rows = first.pixels().chunks_exact(first.width()).flat_map(|row| &row[..width]).copied();
        let narrow = GreyPicture::new(width, height, rows.collect()).unwrap();
        let (with, without) = (look(&narrow, &known(&first)), look(&narrow, &Expected::default()));
        assert_eq!(with.len(), without.len());
    }
}

/// The middle of a known tag is hidden: it is read anew, and is what it is without the first picture.
#[test]
fn a_known_tag_that_looks_otherwise_is_read_again() {
    let (first, truth) = USUAL.render(3, None);
    let expected = known(&first);
    assert!(expected.tags.len() > 5);
    for tag in &expected.tags {
        let [a, b, c, d] = truth.iter().find(|truth| truth.id == tag.id).unwrap().corners;
        let at = |u: f64, v: f64, axis: usize| {
            (1.0 - u) * (1.0 - v) * a[axis] + u * (1.0 - v) * b[axis] + u * v * c[axis] + (1.0 - u) * v * d[axis]
        };
        // The whole of the cells in the middle becomes grey.
        let middle = [at(0.5, 0.5, 0), at(0.5, 0.5, 1)].map(|place| place.round() as usize);
        let reach = ((b[0] - a[0]).hypot(b[1] - a[1]) / 4.0).ceil() as usize;
        let mut pixels = first.pixels().to_vec();
        for row in middle[1].saturating_sub(reach)..(middle[1] + reach).min(first.height()) {
            for column in middle[0].saturating_sub(reach)..(middle[0] + reach).min(first.width()) {
                pixels[row * first.width() + column] = 128;
            }
        }
        let covered = GreyPicture::new(first.width(), first.height(), pixels).unwrap();
        let ids = |corners: Vec<Corner>| corners.iter().map(|corner| corner.tag).collect::<Vec<_>>();
        let with = ids(look(&covered, &expected));
        assert!(!with.contains(&Some(tag.id)), "{}", tag.id);
        assert_eq!(with, ids(look(&covered, &Expected::default())));
    }
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
fn what_the_first_picture_shows_is_found_in_the_others_as_without_them() {
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
    // A tag at the limit of what can be read may be read in one picture and in the other not.
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
        // First pictures, the one that shows something else, and the second where the first cannot be read are searched.
        if ["1,0,", "2,0,", "1,2,cam2", "1,1,cam3"].iter().any(|searched| key.starts_with(searched)) {
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
