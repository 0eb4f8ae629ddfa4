//! Any bytes as a picture's file. The first byte says whether the camera's size is known.

#![no_main]

use cellmap::detect::GreyPicture;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let Some((first, bytes)) = data.split_first() else { return };
    let expected = (first % 2 == 1).then_some([64, 48]);
    if let Ok(picture) = GreyPicture::decode(bytes, "fuzz".as_ref(), expected) {
        assert_eq!(picture.pixels().len(), picture.width() * picture.height());
        assert!(
            expected
                .is_none_or(|[width, height]| [width as usize, height as usize] == [picture.width(), picture.height()])
        );
    }
});
