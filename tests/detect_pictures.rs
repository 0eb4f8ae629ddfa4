//! Reading pictures: what is refused, and that grey is the grey that other tools see.

use std::fs;
use std::path::PathBuf;

use cellmap::detect::{GreyPicture, PictureError};
use image::{ImageBuffer, Luma, Rgb, Rgba};

fn place(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("cellmap-pictures-{}", std::process::id()));
    fs::create_dir_all(&folder).unwrap();
    folder.join(name)
}

#[test]
fn a_missing_picture_is_missing() {
    assert!(matches!(GreyPicture::read(&place("nowhere.png"), None), Err(PictureError::Missing { .. })));
}

#[test]
fn what_is_no_picture_is_unreadable() {
    let path = place("words.png");
    fs::write(&path, "not a picture").unwrap();
    assert!(matches!(GreyPicture::read(&path, None), Err(PictureError::Unreadable { .. })));
    fs::write(&path, "").unwrap();
    assert!(matches!(GreyPicture::read(&path, None), Err(PictureError::Unreadable { .. })));
    // A folder can be opened, but not read.
    assert!(matches!(GreyPicture::read(&std::env::temp_dir(), None), Err(PictureError::Unreadable { .. })));
}

#[test]
fn a_truncated_picture_is_unreadable() {
    for name in ["cut.png", "cut.jpg"] {
        let path = place(name);
        let mut value = 1u32;
        let noise = ImageBuffer::<Luma<u8>, _>::from_fn(64, 64, |_, _| {
            value = value.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            Luma([(value >> 24) as u8])
        });
        noise.save(&path).unwrap();
        let bytes = fs::read(&path).unwrap();
        for length in [10, 40, bytes.len() / 3] {
            fs::write(&path, &bytes[..length]).unwrap();
            let outcome = GreyPicture::read(&path, None);
            assert!(matches!(outcome, Err(PictureError::Unreadable { .. })), "{name} {length}");
        }
        if name == "cut.jpg" {
            fs::write(&path, &bytes[..bytes.len() - 2]).unwrap();
            let words = GreyPicture::read(&path, None).unwrap_err().to_string();
            let expected = "not readable as a picture: the file is cut off: the mark of its end is missing";
            assert!(words.ends_with(expected), "{words}");
            // Cameras pad what they send, or append notes of their own.
            for after in [vec![0; 100], vec![0xff, 0xda, 0, 1]] {
                fs::write(&path, [bytes.clone(), after].concat()).unwrap();
                assert!(GreyPicture::read(&path, None).is_ok());
            }
        }
    }
}

#[test]
fn a_jpeg_of_more_pixels_than_its_bits_is_unreadable() {
    let path = place("many.jpg");
    ImageBuffer::from_pixel(64, 64, Luma([7u8])).save(&path).unwrap();
    let mut bytes = fs::read(&path).unwrap();
    let frame = bytes.windows(2).position(|mark| mark == [0xff, 0xc0]).unwrap();
    bytes[frame + 5..frame + 9].copy_from_slice(&[0x40, 0x00, 0x40, 0x00]);
    fs::write(&path, &bytes).unwrap();
    let words = GreyPicture::read(&path, None).unwrap_err().to_string();
    let expected = format!("{} bytes cannot hold the 16384x16384 pixels of its header", bytes.len());
    assert!(words.ends_with(&expected), "{words}");
}

#[test]
fn a_jpeg_of_more_scans_than_its_bits_is_unreadable() {
    // Progressive, one component, 2000 x 2000; then nothing but heads of scans: 5600 bytes would keep a decoder busy for seconds.
    let frame = [0xff, 0xd8, 0xff, 0xc2, 0, 11, 8, 0x07, 0xd0, 0x07, 0xd0, 1, 1, 0x11, 0];
    let scan = [0xff, 0xda, 0, 8, 1, 1, 0, 1, 63, 0];
    let bytes = [&frame[..], &scan.repeat(560), &[0xff, 0xd9]].concat();
    let path = place("scans.jpg");
    fs::write(&path, &bytes).unwrap();
    let words = GreyPicture::read(&path, None).unwrap_err().to_string();
    assert!(words.ends_with("5617 bytes cannot hold 560 scans of 2000x2000 pixels"), "{words}");
}

#[test]
fn a_wrong_size_names_both_sizes() {
    let path = place("size.png");
    ImageBuffer::from_pixel(40, 30, Luma([7u8])).save(&path).unwrap();
    let error = GreyPicture::read(&path, Some([30, 40])).unwrap_err();
    assert!(matches!(error, PictureError::WrongSize { found: [40, 30], expected: [30, 40], .. }));
    let words = error.to_string();
    assert!(words.contains("40x30") && words.contains("30x40"), "{words}");
    assert!(GreyPicture::read(&path, Some([40, 30])).is_ok());
}

#[test]
fn a_boastful_header_is_refused_before_anything_is_allocated() {
    // A PNG of 100000 x 100000 with a correct header checksum and no pixels.
    let mut header = b"IHDR".to_vec();
    header.extend(100_000u32.to_be_bytes());
    header.extend(100_000u32.to_be_bytes());
    header.extend([8, 0, 0, 0, 0]);
    let checksum = !header.iter().fold(!0u32, |sum, byte| {
        (0..8).fold(sum ^ u32::from(*byte), |sum, _| if sum & 1 == 1 { (sum >> 1) ^ 0xedb8_8320 } else { sum >> 1 })
    });
    let mut bytes = b"\x89PNG\r\n\x1a\n\0\0\0\x0d".to_vec();
    bytes.extend(&header);
    bytes.extend(checksum.to_be_bytes());
    bytes.extend(b"\0\0\0\0IDAT\x35\xaf\x06\x1e\0\0\0\0IEND\xae\x42\x60\x82");
    let path = place("boastful.png");
    fs::write(&path, bytes).unwrap();
    let outcome = GreyPicture::read(&path, None);
    assert!(matches!(outcome, Err(PictureError::TooLarge { size: [100_000, 100_000], .. })), "{outcome:?}");
}

#[test]
fn every_kind_of_pixel_becomes_the_right_grey() {
    let read = |name: &str| GreyPicture::read(&place(name), None).unwrap().pixel(1, 1).unwrap();
    ImageBuffer::from_pixel(3, 2, Luma([200u8])).save(place("grey.bmp")).unwrap();
    ImageBuffer::from_pixel(3, 2, Luma([200u16 * 257])).save(place("grey16.png")).unwrap();
    ImageBuffer::from_pixel(3, 2, Rgb([255u8, 0, 0])).save(place("red.png")).unwrap();
    ImageBuffer::from_pixel(3, 2, Rgba([0u8, 255, 0, 3])).save(place("green.tiff")).unwrap();
    ImageBuffer::from_pixel(3, 2, Rgb([0u8, 0, 255])).save(place("blue.ppm")).unwrap();
    // OpenCV's COLOR_RGB2GRAY of the pure colours: 76, 150, 29.
    let found = ["grey.bmp", "grey16.png", "red.png", "green.tiff", "blue.ppm"].map(read);
    assert_eq!(found, [200, 200, 76, 150, 29]);
    ImageBuffer::from_pixel(16, 16, Luma([90u8])).save(place("grey.jpg")).unwrap();
    assert_eq!(read("grey.jpg"), 90);
    // A colour JPEG stores luma; its own rounding may be one off.
    for (name, colour, luma) in [("red.jpg", [255u8, 0, 0], 76), ("green.jpg", [0, 255, 0], 150)] {
        ImageBuffer::from_pixel(16, 16, Rgb(colour)).save(place(name)).unwrap();
        assert!(read(name).abs_diff(luma) <= 1, "{name}");
    }
}

#[test]
fn sampling_is_exact_on_pixels_and_linear_between() {
    let picture = GreyPicture::new(3, 2, vec![0, 10, 20, 100, 110, 120]).unwrap();
    assert_eq!(picture.sample(1.0, 1.0), Some(110.0));
    assert_eq!(picture.sample(2.0, 1.0), Some(120.0));
    assert_eq!(picture.sample(0.5, 0.25), Some(30.0));
    for outside in [[-0.01, 0.0], [2.01, 0.0], [0.0, 1.01], [f64::NAN, 0.0], [0.0, f64::INFINITY]] {
        assert_eq!(picture.sample(outside[0], outside[1]), None);
    }
    assert_eq!(GreyPicture::new(3, 2, vec![0; 5]), None);
    assert_eq!(GreyPicture::new(0, 2, vec![]), None);
    assert_eq!(picture.pixel(3, 0), None);
}
