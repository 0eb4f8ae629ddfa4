//! Any picture from 1 x 1 on, any pattern; then another picture that shows nearly the same, by what is known from the first. Pixels are magnified, so that a
//! few bytes make shapes; half of the pictures have a part in the shade.

#![no_main]

use cellmap::detect::native::NativeDetector;
use cellmap::detect::{Corner, Detector, Dictionary, Expected, GreyPicture, Pattern};
use libfuzzer_sys::fuzz_target;

fn check(corners: Vec<Corner>) {
    for corner in corners {
        assert!(corner.pixel.iter().all(|value| value.is_finite()));
        let [uu, uv, vv] = corner.covariance.expect("it is measured");
        assert!(uu > 0.0 && vv > 0.0 && uu * vv >= uv * uv, "{corner:?}");
    }
}

fuzz_target!(|data: &[u8]| {
    let [width, height, zoom, kind, seed, cells @ ..] = data else { return };
    if cells.is_empty() {
        return;
    }
    let (zoom, width, height) = (usize::from(*zoom % 9) + 1, usize::from(*width) + 1, usize::from(*height) + 1);
    let dictionary =
        Dictionary::all().nth(usize::from(*kind) % Dictionary::all().count()).expect("there are dictionaries");
    // A real tag among the shapes, so that the later stages see something.
    let tag = dictionary.cells(u32::from(*seed) % dictionary.tag_count()).expect("it has this tag");
    let side = dictionary.cells_per_side();
    let columns = width.div_ceil(zoom);
    let pixels: Vec<u8> =
        (0..width * height)
            .map(|place| {
                let (column, row) = (place % width / zoom, place / width / zoom);
                let in_shade = *kind >= 128 && (place % width + place / width) * 4 < usize::from(*seed) * 8;
                let light = |value: u8| if in_shade { value / 2 } else { value.saturating_add(value / 6) };
                let spoilt = cells[(row * columns + column) % cells.len()];
                light(match (row.checked_sub(2), column.checked_sub(2)) {
                    (Some(row), Some(column)) if row < side && column < side && spoilt > 8 => {
                        if tag[row * side + column] { 215 } else { 30 }
                    }
                    (None, _) | (_, None) if spoilt > 8 => 215,
                    _ => spoilt,
                })
            })
            .collect();
    let changed = |(place, value): (usize, &u8)| value.wrapping_add(cells[place % cells.len()] % 4);
    let other = pixels.iter().enumerate().map(changed).collect();
    let picture = GreyPicture::new(width, height, pixels).expect("as many pixels as it has places");
    let other = GreyPicture::new(width, height, other).expect("as many pixels as it has places");
    let wanted = [
        Pattern::Tags { dictionary, ids: (0..dictionary.tag_count()).collect() },
        Pattern::Checkerboard { columns: 3 + usize::from(seed % 4), rows: 4 },
        Pattern::Charuco {
            squares: [4, 3],
            square: 0.04,
            marker: 0.03,
            dictionary: Dictionary::Aruco4x4_50,
            first_id: 0,
        },
    ];
    let detector = if kind % 2 == 0 { NativeDetector::new() } else { NativeDetector::with_inverted() };
    let first = detector.detect_known(&picture, None, &wanted, &Expected::default());
    let (corners, known) = first.expect("these patterns make sense");
    check(corners);
    let tags = known.iter().map(|known| *known.tag()).collect();
    let expected = Expected { tags, known, all: seed % 2 == 0 };
    check(detector.detect_expected(&other, None, &wanted, &expected).expect("these patterns make sense"));
});
