//! Any rough corners in any small picture, as a finder that errs or a prediction that lies might give them.

#![no_main]

use cellmap::detect::edge_lines::{Refinement, RoughTag, refine_tag};
use cellmap::detect::native::NativeDetector;
use cellmap::detect::{Dictionary, ExpectedTag, GreyPicture};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let Some((head, pixels)) = data.split_first_chunk::<36>() else { return };
    if pixels.is_empty() {
        return;
    }
    let (width, height) = (usize::from(head[0] % 96) + 1, usize::from(head[1] % 96) + 1);
    let places: Vec<u8> = (0..width * height).map(|place| pixels[(place / 3) % pixels.len()]).collect();
    let picture = GreyPicture::new(width, height, places).expect("as many pixels as it has places");
    let number = |k: usize| f64::from(f32::from_le_bytes([head[k], head[k + 1], head[k + 2], head[k + 3]]));
    let corners = [0, 1, 2, 3].map(|corner: usize| {
        let pixel = [number(4 + 8 * corner), number(8 + 8 * corner)];
        // Half of the time somewhere near the picture.
        if head[2] % 2 == 0 { pixel } else { pixel.map(|value| value.rem_euclid(110.0) - 5.0) }
    });
    let dictionary =
        Dictionary::all().nth(usize::from(head[3]) % Dictionary::all().count()).expect("there are dictionaries");
    let edge = dictionary.edge_cells();
    let cells: Vec<bool> = (0..edge * edge).map(|k| pixels[k % pixels.len()] > 100).collect();
    let tag = RoughTag {
        corners,
        cells_per_side: edge,
        bright_inside: head[2] % 4 < 2,
        close: head[2] % 8 < 4,
        cells: Some(&cells),
    };
    for corner in refine_tag(&picture, None, &tag) {
        if let Refinement::Refined { pixel, covariance: [uu, uv, vv] } = corner {
            assert!(pixel.iter().all(|value| value.is_finite()) && uu > 0.0 && vv > 0.0 && uu * vv >= uv * uv);
        }
    }
    let _ = NativeDetector::new().verify(&picture, &ExpectedTag { dictionary, id: 0, corners });
});
