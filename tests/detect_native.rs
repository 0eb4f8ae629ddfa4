//! cellmap's own detector on whole rendered pictures: it finds what is there, nothing else, and measures it well.

#[path = "support/rendering.rs"]
mod rendering;
#[path = "support/scene.rs"]
mod scene;

use cellmap::detect::Lens;
use cellmap::detect::native::NativeDetector;
use cellmap::detect::{Detector, Dictionary, GreyPicture, Pattern};
use cellmap::geometry::{Intrinsics, LensModel};
use scene::{Scene, Tally, USUAL};

fn tally(scene: &Scene, seeds: std::ops::Range<u64>) -> Tally {
    tally_through(None, scene, seeds)
}

fn tally_through(lens: Option<&dyn Lens>, scene: &Scene, seeds: std::ops::Range<u64>) -> Tally {
    let ids = (0..scene.dictionary.tag_count()).collect();
    let wanted = [Pattern::Tags { dictionary: scene.dictionary, ids }];
    let mut tally = Tally::default();
    let detector = if scene.inverted { NativeDetector::with_inverted() } else { NativeDetector::new() };
    for seed in seeds {
        let (picture, truth) = scene.render(seed, lens);
        let found = detector.detect(&picture, lens, &wanted).unwrap();
        let corners: Vec<_> =
            found.iter().map(|c| (c.tag.unwrap(), c.corner as usize, c.pixel, c.covariance.unwrap())).collect();
        tally.add(&truth, &corners);
    }
    tally
}

#[test]
fn tags_are_found_and_measured_in_clutter_and_without() {
    for (clutter, noise, limit) in [(false, 2.0, 0.03), (true, 2.0, 0.03), (true, 4.0, 0.05)] {
        let t = tally(&Scene { clutter, noise, ..USUAL }, 100..110);
        assert!(t.tags == 100.0 && t.found >= 99.0 && t.false_ids == 0.0, "{t:?}");
        assert!(t.rms() <= limit && t.mean_pull().abs() <= 0.005, "{t:?}");
        assert!(t.mean_offset().iter().all(|offset| offset.abs() <= 0.005), "{t:?}");
        assert!((0.7..1.4).contains(&t.mean_normalised()), "{t:?}");
    }
}

#[test]
fn inverted_tags_and_tags_with_data_around_them_are_found() {
    let around = Scene { dictionary: Dictionary::AprilTagStandard41h12, size: [30.0, 50.0], ..USUAL };
    for scene in [Scene { inverted: true, ..USUAL }, around, Scene { inverted: true, ..around }] {
        let t = tally(&scene, 0..3);
        assert!(t.found >= t.tags - 1.0 && t.false_ids == 0.0 && t.rms() < 0.03, "{t:?}");
    }
}

/// Lines along the sides see what shines through a thin border; all cells together do not mind.
#[test]
fn small_slanted_and_blurred_tags_are_measured() {
    let tilted = |degrees: f64| [degrees.to_radians(); 2];
    for (scene, recall, rms) in [
        (Scene { size: [12.0, 12.0], tilt: [0.0, 0.5], ..USUAL }, 0.85, 0.08),
        (Scene { size: [16.0, 16.0], tilt: [0.0, 0.5], ..USUAL }, 0.95, 0.04),
        (Scene { size: [20.0, 20.0], tilt: [0.0, 0.5], inverted: true, ..USUAL }, 0.95, 0.03),
        (Scene { tilt: tilted(75.0), ..USUAL }, 0.95, 0.05),
        (Scene { blur: 2.0, ..USUAL }, 0.95, 0.04),
        (Scene { motion: 6.0, ..USUAL }, 0.95, 0.05),
        (Scene { hidden: 0.2, ..USUAL }, 0.95, 0.03),
        // As sRGB does it; without allowing for it corners are pulled by a third of a pixel.
        (Scene { gamma: 0.45, size: [20.0, 20.0], tilt: [0.0, 0.5], ..USUAL }, 0.95, 0.04),
    ] {
        let t = tally(&scene, 0..3);
        assert!(t.found >= recall * t.tags && t.corners >= 3.9 * recall * t.tags && t.false_ids == 0.0, "{t:?}");
        assert!(t.rms() < rms && t.mean_pull().abs() < 0.4 * rms, "{} {} {t:?}", t.rms(), t.mean_pull());
        assert!((0.4..2.5).contains(&t.mean_normalised()), "{} {t:?}", t.mean_normalised());
    }
}

/// Without allowing for it, tags look larger or smaller by a quarter to half a pixel at each corner.
#[test]
fn gamma_and_saturation_move_no_corner() {
    for (scene, pictures) in [
        (Scene { gamma: 0.45, ..USUAL }, 3),
        (Scene { gamma: 2.2, ..USUAL }, 3),
        (Scene { exposure: 1.4, ..USUAL }, 3),
        // One tag has to tell it alone.
        (Scene { gamma: 0.45, tags: 1, ..USUAL }, 12),
    ] {
        let t = tally(&scene, 0..pictures);
        assert!(t.found >= 0.99 * t.tags && t.rms() < 0.025 && t.mean_pull().abs() < 0.02, "{} {t:?}", t.rms());
        assert!((0.4..2.0).contains(&t.mean_normalised()), "{} {t:?}", t.mean_normalised());
    }
}

#[test]
fn small_tags_are_measured_through_a_lens() {
    let barrel = [-0.28, 0.07, 0.0, 0.0, 0.0];
    let lens = Intrinsics::new(LensModel::Brown, [1280, 720], [700.0, 700.0], [639.5, 359.5], &barrel).unwrap();
    for scene in [Scene { size: [20.0, 20.0], tilt: [0.0, 0.5], ..USUAL }, Scene { blur: 2.0, ..USUAL }] {
        let t = tally_through(Some(&lens), &scene, 0..2);
        assert!(t.found >= 0.95 * t.tags && t.rms() < 0.04, "{} {t:?}", t.rms());
        assert!((0.4..2.5).contains(&t.mean_normalised()), "{} {t:?}", t.mean_normalised());
    }
}

#[test]
fn clutter_is_no_tag() {
    for dictionary in [Dictionary::Aruco4x4_50, Dictionary::AprilTag16h5, Dictionary::Aruco6x6_1000] {
        let t = tally(&Scene { dictionary, tags: 0, clutter: true, ..USUAL }, 0..20);
        assert_eq!(t.false_ids, 0.0, "{dictionary}");
    }
}

/// Dark boxes with a label, as a few tags are, and what has less than a pixel a cell.
#[test]
fn a_box_with_a_label_is_no_tag() {
    for (dictionary, seeds) in [
        (Dictionary::Aruco4x4_50, &[619][..]),
        (Dictionary::ArucoOriginal, &[58, 175, 360, 515, 942]),
        (Dictionary::ArucoMip36h12, &[57]),
    ] {
        for seed in seeds {
            let (picture, _) = Scene { dictionary, tags: 0, clutter: true, ..USUAL }.render(*seed, None);
            let found = NativeDetector::new().find_tags(&picture, &[dictionary]).remove(0);
            assert!(found.is_empty(), "{dictionary}, picture {seed}: {found:?}");
        }
    }
}

#[test]
fn inverted_tags_are_found_only_if_wanted() {
    let (picture, truth) = Scene { inverted: true, ..USUAL }.render(0, None);
    let found = |detector: NativeDetector| detector.find_tags(&picture, &[USUAL.dictionary])[0].len();
    assert_eq!(found(NativeDetector::with_inverted()), truth.len());
    assert_eq!(found(NativeDetector::new()), 0);
}

/// Wherever a tag stands, and whatever stands above it.
#[test]
fn a_tag_is_found_on_every_row() {
    let (width, height, cell) = (160, 130, 6);
    let cells = Dictionary::Aruco6x6_250.cells(7).unwrap();
    for top in 10..70 {
        let mut pixels = vec![215; width * height];
        // A frame of 30 rows, no tag.
        for (row, column) in (5..35).flat_map(|row| (5..35).map(move |column| (row, column))) {
            if !(10..30).contains(&row) || !(10..30).contains(&column) {
                pixels[row * width + column] = 30;
            }
        }
        for (row, column) in (0..8 * cell).flat_map(|row| (0..8 * cell).map(move |column| (row, column))) {
            if !cells[row / cell * 8 + column / cell] {
                pixels[(top + row) * width + 80 + column] = 30;
            }
        }
        let picture = GreyPicture::new(width, height, pixels).unwrap();
        let found = NativeDetector::new().find_tags(&picture, &[Dictionary::Aruco6x6_250]).remove(0);
        assert_eq!(found.iter().map(|tag| tag.id).collect::<Vec<_>>(), [7], "top row {top}");
    }
}

/// The sun beside it is brighter than the paper it is on by as much as the paper is than ink.
#[test]
fn a_tag_in_the_shade_beside_something_in_the_sun_is_found() {
    let (width, height, cell) = (200, 160, 4);
    // Of a dictionary whose tags have few cells a pixel more or less decides whether what is in the shade is believed.
    for (dictionary, least) in
        [(Dictionary::Aruco6x6_250, 8), (Dictionary::AprilTag36h11, 8), (Dictionary::Aruco4x4_50, 5)]
    {
        let (side, cells) = (dictionary.cells_per_side(), dictionary.cells(23).unwrap());
        let found = (0..8).filter(|shift| {
            let mut pixels = vec![250; width * height];
            let edge = (side + 2) * cell;
            for (row, column) in (0..edge).flat_map(|row| (0..edge).map(move |column| (row, column))) {
                let inside = |at: usize| (at / cell).checked_sub(1).filter(|at| *at < side);
                let ink =
                    matches!((inside(row), inside(column)), (Some(row), Some(column)) if !cells[row * side + column]);
                pixels[(50 + shift + row) * width + 60 + 3 * shift + column] = if ink { 20 } else { 125 };
            }
            let picture = GreyPicture::new(width, height, pixels).unwrap();
            let found = NativeDetector::new().find_tags(&picture, &[dictionary]).remove(0);
            assert!(found.iter().all(|tag| tag.id == 23), "{found:?}");
            found.len() == 1
        });
        let found = found.count();
        assert!(found >= least, "{dictionary}: {found} of 8");
    }
}

/// Patterns that are tags by chance if little light is enough.
#[test]
fn clutter_in_the_shade_is_no_tag() {
    for (dictionary, seed) in [(Dictionary::AprilTag36h11, 167), (Dictionary::Aruco4x4_1000, 252)] {
        let (picture, _) = Scene { dictionary, tags: 0, clutter: true, ..USUAL }.render(seed, None);
        let found = NativeDetector::new().find_tags(&picture, &[dictionary]).remove(0);
        assert!(found.is_empty(), "{dictionary}, picture {seed}: {found:?}");
    }
}
