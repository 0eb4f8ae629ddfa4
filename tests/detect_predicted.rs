//! A detector that is told where tags are finds what it finds without, and does not believe everything it is told.

#[path = "support/rendering.rs"]
mod rendering;
#[path = "support/scene.rs"]
mod scene;

use cellmap::detect::native::NativeDetector;
use cellmap::detect::{Corner, Detector, Expected, ExpectedTag, GreyPicture, Pattern};
use rendering::Random;
use scene::{Scene, Truth, USUAL};

/// What would be predicted from places that are `error` px off.
fn told(truth: &[Truth], error: f64) -> Vec<ExpectedTag> {
    let mut random = Random(3);
    let off = |corner: [f64; 2], random: &mut Random| corner.map(|value| value + random.between(-error, error));
    truth
        .iter()
        .map(|tag| ExpectedTag {
            dictionary: USUAL.dictionary,
            id: tag.id,
            corners: tag.corners.map(|corner| off(corner, &mut random)),
        })
        .collect()
}

fn look(picture: &GreyPicture, expected: &Expected) -> Vec<Corner> {
    let wanted = [Pattern::Tags { dictionary: USUAL.dictionary, ids: (0..250).collect() }];
    NativeDetector::new().detect_expected(picture, None, &wanted, expected).unwrap()
}

#[test]
fn what_is_expected_is_found_as_without() {
    let (mut squares, mut count) = (0.0, 0.0);
    for seed in 0..6 {
        let (picture, truth) = Scene { clutter: seed % 2 == 1, ..USUAL }.render(seed, None);
        let without = look(&picture, &Expected::default());
        let with = look(&picture, &Expected { tags: told(&truth, 1.5), all: true, ..Expected::default() });
        let names = |corners: &[Corner]| corners.iter().map(|c| (c.tag, c.corner)).collect::<Vec<_>>();
        assert_eq!(names(&with), names(&without), "seed {seed}");
        for (a, b) in with.iter().zip(&without) {
            let [uu, _, vv] = a.covariance.unwrap();
            squares += (a.pixel[0] - b.pixel[0]).powi(2) / uu + (a.pixel[1] - b.pixel[1]).powi(2) / vv;
            count += 2.0;
        }
    }
    // In standard deviations of what noise does to a corner.
    let apart = f64::sqrt(squares / count);
    assert!(apart < 0.5, "{apart}");
}

#[test]
fn what_is_not_there_is_searched_for() {
    let (picture, truth) = Scene { clutter: true, ..USUAL }.render(1, None);
    let without = look(&picture, &Expected::default());
    let right = told(&truth, 0.0);
    let moved =
        |by: f64| right.iter().map(move |tag| ExpectedTag { corners: tag.corners.map(|c| [c[0] + by, c[1]]), ..*tag });
    let renamed = || right.iter().map(|tag| ExpectedTag { id: (tag.id + 1) % 250, ..*tag });
    let turned =
        || right.iter().map(|tag| ExpectedTag { corners: [1, 2, 3, 0].map(|k: usize| tag.corners[k]), ..*tag });
    let nowhere = || right.iter().map(|tag| ExpectedTag { corners: [[f64::NAN, 1e300]; 4], ..*tag });
    for tags in [moved(25.0).collect(), renamed().collect(), turned().collect(), nowhere().collect::<Vec<_>>()] {
        assert_eq!(look(&picture, &Expected { tags, all: true, ..Expected::default() }), without);
    }
    for corners in [[[1.4e14, 5.0]; 4], [[f64::INFINITY, -1e19]; 4]] {
        assert_eq!(NativeDetector::new().verify(&picture, &ExpectedTag { corners, ..right[0] }), None);
    }
    // One that nobody expects is found if there may be more.
    let tags = right[1..].to_vec();
    assert_eq!(look(&picture, &Expected { tags, all: false, ..Expected::default() }), without);
}
