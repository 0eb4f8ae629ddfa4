//! The detector and the decoder on anything at all: no panic, and nothing found in noise.

use cellmap::detect::native::NativeDetector;
use cellmap::detect::{Detector, Dictionary, GreyPicture, Pattern};
use proptest::prelude::*;

fn all_patterns() -> Vec<Pattern> {
    let mut wanted: Vec<Pattern> = Dictionary::all()
        .map(|dictionary| Pattern::Tags { dictionary, ids: (0..dictionary.tag_count()).collect() })
        .collect();
    wanted.push(Pattern::Checkerboard { columns: 3, rows: 4 });
    wanted.push(Pattern::Charuco {
        squares: [5, 7],
        square: 2.0,
        marker: 1.0,
        dictionary: Dictionary::Aruco4x4_50,
        first_id: 0,
    });
    wanted
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn pictures_of_any_size_and_content(width in 1usize..90, height in 1usize..90, kind in 0u8..4, seed in any::<u64>()) {
        let mut state = seed | 1;
        let mut next = || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            state
        };
        let block = 1 + (next() % 9) as usize;
        let salt = next();
        let pixels = (0..width * height).map(|k| match kind {
            0 => (next() >> 32) as u8,
            1 => if (k % width / block + k / width / block).is_multiple_of(2) { 20 } else { 230 },
            2 => if (((k % width / block) as u64 * 31 + (k / width / block) as u64 * 17) ^ salt).count_ones().is_multiple_of(2) { 0 } else { 255 },
            _ => (k * 255 / (width * height)) as u8,
        }).collect();
        let picture = GreyPicture::new(width, height, pixels).unwrap();
        let found = NativeDetector::with_inverted().detect(&picture, None, &all_patterns()).unwrap();
        prop_assert!(found.iter().all(|corner| corner.pixel.iter().all(|value| value.is_finite())));
    }

    #[test]
    fn files_of_any_content(head in 0usize..6, bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
        let heads: [&[u8]; 6] = [b"", b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff\xe0", b"P5\n7 7\n255\n", b"II*\0", b"BM"];
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), [heads[head], &bytes].concat()).unwrap();
        // Either is fine; a panic is not.
        let _ = GreyPicture::read(file.path(), None);
    }
}
