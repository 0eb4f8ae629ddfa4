//! Pictures as the bytes of a file.

use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use std::io;

use crate::detect::GreyPicture;

/// The kind of file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PictureFormat {
    /// Lossless, packed quickly.
    Png,
    /// With losses; quality 1 to 100.
    Jpeg(u8),
    /// Lossless and not packed.
    Pgm,
}

impl PictureFormat {
    /// The kind of file that a name's ending stands for; JPEG with quality 92.
    #[must_use]
    pub fn of_name(name: &str) -> Option<Self> {
        match name.rsplit_once('.')?.1.to_ascii_lowercase().as_str() {
            "png" => Some(Self::Png),
            "jpg" | "jpeg" => Some(Self::Jpeg(92)),
            "pgm" => Some(Self::Pgm),
            _ => None,
        }
    }
}

/// A picture as a file's bytes.
///
/// # Errors
/// The encoder's own.
pub fn encode(picture: &GreyPicture, format: PictureFormat) -> io::Result<Vec<u8>> {
    let (width, height) = (picture.width() as u32, picture.height() as u32);
    let mut bytes = Vec::new();
    let written =
        match format {
            PictureFormat::Png => PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Up)
                .write_image(picture.pixels(), width, height, ExtendedColorType::L8),
            PictureFormat::Jpeg(quality) => JpegEncoder::new_with_quality(&mut bytes, quality.clamp(1, 100))
                .write_image(picture.pixels(), width, height, ExtendedColorType::L8),
            PictureFormat::Pgm => {
                bytes.extend_from_slice(format!("P5\n{width} {height}\n255\n").as_bytes());
                bytes.extend_from_slice(picture.pixels());
                return Ok(bytes);
            }
        };
    written.map_err(io::Error::other)?;
    Ok(bytes)
}
