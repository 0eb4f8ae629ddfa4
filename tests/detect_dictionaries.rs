//! Every dictionary: a tag of each, drawn, rendered, found with its own id and corner order.
#![cfg(feature = "opencv")]

use cellmap::detect::Detector;
use cellmap::detect::opencv::OpenCvDetector;
use cellmap::geometry::dictionary::Dictionary;
use cellmap::geometry::{Feature, Pattern};
use cellmap::layout::parse_layout;
use cellmap::recording::Recording;
use cellmap::simulate::{Cell, CornerNoise, PictureNoise, corners, plates, render};

#[test]
fn a_tag_of_every_dictionary_is_found_where_it_is() {
    for dictionary in Dictionary::all().filter(|d| d.opencv_number().is_some_and(|n| n < 21)) {
        let ids = [0, dictionary.tag_count() / 2, dictionary.tag_count() - 1];
        let targets: String = ids
            .iter()
            .enumerate()
            .map(|(i, id)| {
                let x = 130.0 * (i as f64 - 1.0);
                format!(
                    "  t{i}: {{tags: {{dictionary: {dictionary}, size: 90, ids: [{id}]}}, pose: {{xyz: [{x}, {}, 600], rpy: [{}, 8, {}]}}}}\n",
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
        let plates = plates(&cell);
        let picture = render(&cell, &plates, 0, 0, PictureNoise { blur: 0.7, grey: 2.0, seed: 1 }).unwrap();
        let truth = corners(&cell, &[0], CornerNoise { pixel_sigma: 0.0, seed: 0 });
        assert_eq!(truth.len(), 12);
        let wanted = [Pattern::Tags { dictionary, ids: ids.to_vec() }];
        let found = OpenCvDetector::new().unwrap().detect(&picture, None, &wanted).unwrap();
        assert_eq!(found.len(), 12, "{dictionary}");
        for corner in found {
            let feature = Feature::TagCorner(corner.tag.unwrap(), corner.corner as u8);
            let expected = truth.iter().find(|row| row.feature == feature).unwrap().pixel;
            let apart = (corner.pixel[0] - expected[0]).hypot(corner.pixel[1] - expected[1]);
            assert!(apart < 0.1, "{dictionary} {feature:?}: {apart} px");
        }
    }
}
