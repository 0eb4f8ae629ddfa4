//! Every dictionary: a tag of each, drawn, rendered, found with its own id and corner order.

use cellmap::detect::Detector;
use cellmap::detect::native::NativeDetector;
use cellmap::geometry::dictionary::Dictionary;
use cellmap::geometry::{Feature, Pattern};
use cellmap::layout::parse_layout;
use cellmap::recording::Recording;
use cellmap::simulate::render::{Exposure, Look, Scene, render};
use cellmap::simulate::{Cell, CornerNoise, corners};

#[test]
fn a_tag_of_every_dictionary_is_found_where_it_is() {
    for dictionary in Dictionary::all() {
        // The last tag of the original family is alike after half a turn and has no first corner.
        let last = dictionary.tag_count() - if dictionary == Dictionary::ArucoOriginal { 2 } else { 1 };
        let ids = [0, dictionary.tag_count() / 2, last];
        let targets: String = ids
            .iter()
            .enumerate()
            .map(|(i, id)| {
                // `size` is the edge that is found; data may lie around it.
                let size = 90.0 * dictionary.edge_cells() as f64 / dictionary.cells_per_side() as f64;
                let x = 170.0 * (i as f64 - 1.0);
                format!(
                    "  t{i}: {{tags: {{dictionary: {dictionary}, size: {size}, ids: [{id}]}}, pose: {{xyz: [{x}, {}, 600], rpy: [{}, 8, {}]}}}}\n",
                    10 * i,
                    180.0 - 20.0 * i as f64,
                    25 * i
                )
            })
            .collect();
        let text = format!(
            "cellmap: 1\nunits: {{length: mm, angle: deg}}\nworld: eye\ncameras:\n  eye:\n    intrinsics: {{model: pinhole, \
             size: [960, 540], focal: [900, 900], centre: [479.5, 269.5]}}\ntargets:\n{targets}"
        );
        let layout = parse_layout("x.yaml".as_ref(), &text, None).unwrap();
        let recording = Recording::default();
        let cell = Cell::new(&layout, &recording);
        let scene = Scene::new(&cell, &Look::plain(1));
        let picture = render(&cell, &scene, 0, 0, 0, &Exposure::default()).unwrap();
        let truth = corners(&cell, &[0], CornerNoise { pixel_sigma: 0.0, seed: 0 });
        assert_eq!(truth.len(), 12);
        let wanted = [Pattern::Tags { dictionary, ids: ids.to_vec() }];
        #[allow(unused_mut)]
        let mut detectors: Vec<Box<dyn Detector>> = vec![Box::new(NativeDetector::new())];
        // OpenCV 4.6 ends at 36h11.
        #[cfg(feature = "opencv")]
        if dictionary <= Dictionary::AprilTag36h11 {
            detectors.push(Box::new(cellmap::detect::opencv::OpenCvDetector::new().unwrap()));
        }
        for (detector, corner) in detectors.iter().flat_map(|detector| {
            let found = detector.detect(&picture, None, &wanted).unwrap();
            assert_eq!(found.len(), 12, "{dictionary} {}", detector.name());
            found.into_iter().map(|corner| (detector.name(), corner))
        }) {
            let feature = Feature::TagCorner(corner.tag.unwrap(), corner.corner as u8);
            let expected = truth.iter().find(|row| row.feature == feature).unwrap().pixel;
            let apart = (corner.pixel[0] - expected[0]).hypot(corner.pixel[1] - expected[1]);
            assert!(apart < 0.1, "{dictionary} {detector} {feature:?}: {apart} px");
        }
    }
}
