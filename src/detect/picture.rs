//! A grey picture, and how it is read from a file.
//!
//! Decoding is half of the work of detection, and a file is the least trustworthy thing the program
//! meets: a truncated download, a thumbnail with the right name, a PNG whose header claims ten
//! thousand million pixels. So the header is read first and judged before any pixel is allocated:
//! first the absolute limit, then the size that the camera's intrinsics were measured at.
//!
//! Colour becomes grey by BT.601 luma, with the rounding OpenCV uses, so that corners agree with
//! those other tools find. A JPEG file stores that luma, which is taken as it is. Alpha is ignored, and so is an EXIF orientation: intrinsics belong to the
//! sensor's own rows and columns.

use std::io::{self, Cursor};
use std::path::{Path, PathBuf};

use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};
use thiserror::Error;
use zune_core::bytestream::ZCursor;
use zune_core::colorspace::ColorSpace;
use zune_core::options::DecoderOptions;
use zune_jpeg::JpegDecoder;

/// No picture above this many pixels is decoded (256 megapixels: 16384 x 16384).
pub const MAXIMUM_PIXELS: u64 = 256 * 1024 * 1024;

/// Why a picture could not be read.
#[derive(Debug, Error)]
pub enum PictureError {
    /// There is no such file.
    #[error("{}: there is no such picture", path.display())]
    Missing {
        /// The file.
        path: PathBuf,
    },
    /// The file is there, but cannot be opened or is no picture; the decoder's own words follow.
    #[error("{}: not readable as a picture: {words}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// The decoder's own words.
        words: String,
    },
    /// The picture's size is not the one its camera's intrinsics belong to (width, height in pixels).
    #[error("{}: the picture is {}x{}, the camera's intrinsics are for {}x{}", path.display(), found[0], found[1], expected[0], expected[1])]
    WrongSize {
        /// The file.
        path: PathBuf,
        /// The picture's width and height.
        found: [u32; 2],
        /// The intrinsics' width and height.
        expected: [u32; 2],
    },
    /// A drawing could not be written.
    #[error("{}: the drawing cannot be written: {words}", path.display())]
    Unwritable {
        /// The file.
        path: PathBuf,
        /// The encoder's own words.
        words: String,
    },
    /// The header claims more than [`MAXIMUM_PIXELS`].
    #[error("{}: the header claims {}x{} pixels, more than 256 megapixels", path.display(), size[0], size[1])]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// The width and height it claims.
        size: [u32; 2],
    },
}

/// A picture of 8-bit grey values in rows; the centre of the top-left pixel is (0, 0).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GreyPicture {
    width: usize,
    height: usize,
    pixels: Vec<u8>,
}

impl GreyPicture {
    /// Takes `width * height` grey values, row by row from the top. `None` if their number is another
    /// or a side is zero.
    #[must_use]
    pub fn new(width: usize, height: usize, pixels: Vec<u8>) -> Option<Self> {
        (width > 0 && height > 0 && width.checked_mul(height)? == pixels.len()).then_some(Self {
            width,
            height,
            pixels,
        })
    }

    /// Reads a PNG, JPEG, PNM, TIFF or BMP file, known by its contents and not by its name.
    ///
    /// # Arguments
    /// * `expected_size` - width and height in pixels that the camera's intrinsics are for.
    ///
    /// # Errors
    /// See [`PictureError`]. Size errors are found from the header, before anything is allocated.
    pub fn read(path: &Path, expected_size: Option<[u32; 2]>) -> Result<Self, PictureError> {
        let bytes = std::fs::read(path).map_err(|error| match error.kind() {
            io::ErrorKind::NotFound => PictureError::Missing { path: path.to_owned() },
            _ => PictureError::Unreadable { path: path.to_owned(), words: error.to_string() },
        })?;
        Self::decode(&bytes, path, expected_size)
    }

    /// Decodes a file's contents; `path` is for the complaints.
    ///
    /// # Errors
    /// See [`PictureError`]. Size errors are found from the header, before anything is allocated.
    pub fn decode(bytes: &[u8], path: &Path, expected_size: Option<[u32; 2]>) -> Result<Self, PictureError> {
        let unreadable = |words: String| PictureError::Unreadable { path: path.to_owned(), words };
        let judged = |width: u32, height: u32| {
            if u64::from(width) * u64::from(height) > MAXIMUM_PIXELS {
                return Err(PictureError::TooLarge { path: path.to_owned(), size: [width, height] });
            }
            match expected_size {
                Some(expected) if expected != [width, height] => {
                    Err(PictureError::WrongSize { path: path.to_owned(), found: [width, height], expected })
                }
                _ => Ok(()),
            }
        };
        let empty = || unreadable("it has no pixels".to_owned());
        let mut reader = ImageReader::new(Cursor::new(bytes))
            .with_guessed_format()
            .map_err(|error| unreadable(error.to_string()))?;
        if reader.format() == Some(ImageFormat::Jpeg) {
            return match jpeg_luma(bytes, judged) {
                Ok((width, height, pixels)) => Self::new(width, height, pixels).ok_or_else(empty),
                Err(JpegFailure::Refused(error)) => Err(error),
                Err(JpegFailure::Unreadable(words)) => Err(unreadable(words)),
            };
        }
        // `image` would already refuse at its own default; ours is the same for every format.
        reader.limits(Limits::no_limits());
        let mut decoder = reader.into_decoder().map_err(|error| unreadable(error.to_string()))?;
        let (width, height) = decoder.dimensions();
        judged(width, height)?;
        // A decoder may need scratch memory of its own; bound that too, by what 16-bit RGBA needs.
        let mut limits = Limits::no_limits();
        limits.max_alloc = Some(2 * 8 * MAXIMUM_PIXELS);
        decoder.set_limits(limits).map_err(|error| unreadable(error.to_string()))?;
        let decoded = DynamicImage::from_decoder(decoder).map_err(|error| unreadable(error.to_string()))?;
        Self::new(width as usize, height as usize, grey(decoded)).ok_or_else(empty)
    }

    /// Width in pixels, at least 1.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels, at least 1.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// The grey values, row by row from the top.
    #[must_use]
    pub fn pixels(&self) -> &[u8] {
        &self.pixels
    }

    /// One grey value, `None` outside the picture.
    #[must_use]
    #[inline]
    pub fn pixel(&self, column: usize, row: usize) -> Option<u8> {
        if column < self.width {
            self.pixels.get(row.checked_mul(self.width)?.checked_add(column)?).copied()
        } else {
            None
        }
    }

    /// The grey value between pixels by bilinear interpolation; `None` outside the centres of the
    /// outermost pixels or if a coordinate is not a number.
    #[must_use]
    #[inline]
    pub fn sample(&self, x: f64, y: f64) -> Option<f64> {
        let (last_x, last_y) = ((self.width - 1) as f64, (self.height - 1) as f64);
        if !(x >= 0.0 && y >= 0.0 && x <= last_x && y <= last_y) {
            return None;
        }
        let (left, top) = (x as usize, y as usize);
        let (right, bottom) = ((left + 1).min(self.width - 1), (top + 1).min(self.height - 1));
        let (fx, fy) = (x - left as f64, y - top as f64);
        let at = |column: usize, row: usize| self.pixels.get(row * self.width + column).map(|value| f64::from(*value));
        let upper = at(left, top)? * (1.0 - fx) + at(right, top)? * fx;
        let lower = at(left, bottom)? * (1.0 - fx) + at(right, bottom)? * fx;
        Some(upper * (1.0 - fy) + lower * fy)
    }
}

impl GreyPicture {
    /// As [`GreyPicture::sample`], for those who sample thousands of places: coordinates in 1/65536 px, the grey value in 1/65536.
    #[must_use]
    #[inline]
    pub(super) fn sample_fixed(&self, x: i64, y: i64) -> Option<i32> {
        let (left, top) = (x >> 16, y >> 16);
        if left < 0 || top < 0 || left + 1 >= self.width as i64 || top + 1 >= self.height as i64 {
            return None;
        }
        let at = top as usize * self.width + left as usize;
        let (upper, lower) = (self.pixels.get(at..at + 2)?, self.pixels.get(at + self.width..at + self.width + 2)?);
        let (fx, fy) = (((x >> 8) & 255) as i32, ((y >> 8) & 255) as i32);
        let across = |pair: &[u8]| i32::from(pair[0]) * (256 - fx) + i32::from(pair[1]) * fx;
        Some(across(upper) * (256 - fy) + across(lower) * fy)
    }
}

/// Why a JPEG file gave no pixels.
enum JpegFailure {
    Refused(PictureError),
    Unreadable(String),
}

/// A JPEG file's luma, which is stored as such: colour is neither decoded nor turned back into grey.
fn jpeg_luma(
    bytes: &[u8],
    judged: impl Fn(u32, u32) -> Result<(), PictureError>,
) -> Result<(usize, usize, Vec<u8>), JpegFailure> {
    let words = |error: zune_jpeg::errors::DecodeErrors| JpegFailure::Unreadable(error.to_string());
    // A JPEG file's sides have 16 bits; ours is the limit of their product.
    let options = DecoderOptions::default()
        .jpeg_set_out_colorspace(ColorSpace::Luma)
        .set_max_width(usize::from(u16::MAX))
        .set_max_height(usize::from(u16::MAX))
        .set_strict_mode(true);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers().map_err(words)?;
    let (width, height) =
        decoder.dimensions().ok_or_else(|| JpegFailure::Unreadable("the header names no size".to_owned()))?;
    judged(width as u32, height as u32).map_err(JpegFailure::Refused)?;
    whole(bytes, width, height).map_err(JpegFailure::Unreadable)?;
    // Files that do not store luma as such: red, green and blue, or inks.
    if !matches!(decoder.input_colorspace(), Some(ColorSpace::Luma | ColorSpace::YCbCr)) {
        let decoded = image::load_from_memory_with_format(bytes, ImageFormat::Jpeg)
            .map_err(|error| JpegFailure::Unreadable(error.to_string()))?;
        return Ok((width, height, grey(decoded)));
    }
    Ok((width, height, decoder.decode().map_err(words)?))
}

/// Times that a JPEG decoder goes over a block at most, for each bit that the file has: one that codes every block in a bit may do so in ten scans.
const MOST_VISITS: usize = 16;

/// Whether a JPEG file has its end, and as many bits as its header promises blocks of 8 x 8 pixels, and scans over them. What a file lacks its decoder would fill
/// with grey without a word, and look for it in every scan.
fn whole(bytes: &[u8], width: usize, height: usize) -> Result<(), String> {
    let (begin, progressive) = first_scan(bytes).unwrap_or((0, true));
    // Within coded pixels the mark cannot occur (ITU-T T.81, B.1.1.5); before them a small picture's may, after them anything. Looked for from behind: there it mostly is.
    let coded = &bytes[begin..];
    if !coded.windows(2).rev().any(|two| *two == [0xff, 0xd9]) {
        return Err("the file is cut off: the mark of its end is missing".to_owned());
    }
    // The first coefficient of a block takes a bit at least. Components may be sampled more coarsely, though not all of them: a quarter of the blocks are there.
    let (bits, blocks) = (8 * bytes.len(), width.div_ceil(8) * height.div_ceil(8));
    if bits < blocks / 4 {
        return Err(format!("{} bytes cannot hold the {width}x{height} pixels of its header", bytes.len()));
    }
    let scans = if progressive { coded.windows(2).filter(|two| **two == [0xff, 0xda]).count() } else { 1 };
    if bits * MOST_VISITS < scans * blocks {
        return Err(format!("{} bytes cannot hold {scans} scans of {width}x{height} pixels", bytes.len()));
    }
    Ok(())
}

/// Where a JPEG file's coded pixels begin, by its segments (ITU-T T.81, B.1.1.4), and whether they are refined from scan to scan.
fn first_scan(bytes: &[u8]) -> Option<(usize, bool)> {
    let (mut at, mut progressive) = (2, false);
    loop {
        match *bytes.get(at..)? {
            [0xff, 0xff, ..] => at += 1,
            [0xff, 0xda, ..] => return Some((at, progressive)),
            [0xff, mark, high, low, ..] => {
                progressive |= mark == 0xc2;
                at += 2 + usize::from(u16::from_be_bytes([high, low]));
            }
            _ => return None,
        }
    }
}

/// BT.601 luma of 8-bit colour in 14-bit fixed point, rounded: OpenCV's formula to the bit.
fn luma(red: u8, green: u8, blue: u8) -> u8 {
    ((u32::from(red) * 4899 + u32::from(green) * 9617 + u32::from(blue) * 1868 + 8192) >> 14) as u8
}

/// 0..=65535 to 0..=255, rounded.
fn narrow(value: u16) -> u8 {
    ((u32::from(value) + 128) / 257) as u8
}

/// Turns whatever the decoder gave into grey. (`image`'s own `into_luma8` weighs by BT.709.)
fn grey(decoded: DynamicImage) -> Vec<u8> {
    match decoded {
        DynamicImage::ImageLuma8(buffer) => buffer.into_raw(),
        DynamicImage::ImageLumaA8(buffer) => buffer.as_raw().chunks_exact(2).map(|pixel| pixel[0]).collect(),
        DynamicImage::ImageRgb8(buffer) => {
            buffer.as_raw().chunks_exact(3).map(|pixel| luma(pixel[0], pixel[1], pixel[2])).collect()
        }
        DynamicImage::ImageRgba8(buffer) => {
            buffer.as_raw().chunks_exact(4).map(|pixel| luma(pixel[0], pixel[1], pixel[2])).collect()
        }
        DynamicImage::ImageLuma16(buffer) => buffer.as_raw().iter().map(|value| narrow(*value)).collect(),
        DynamicImage::ImageLumaA16(buffer) => buffer.as_raw().chunks_exact(2).map(|pixel| narrow(pixel[0])).collect(),
        // 16-bit colour, floats and whatever a later version adds: by way of 8-bit colour.
        other => other.into_rgb8().as_raw().chunks_exact(3).map(|pixel| luma(pixel[0], pixel[1], pixel[2])).collect(),
    }
}
