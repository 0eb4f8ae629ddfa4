//! What was found, drawn into the picture, so that a person can check it.
//!
//! Outlines of tags (the first side thicker), their ids, and a small cross at every corner; boards are a polyline through their corners in
//! order. No font is needed for ten digits.

use std::path::Path;

use image::{Rgb, RgbImage};

use super::picture::GreyPicture;
use super::{Corner, PictureError};

const OUTLINE: Rgb<u8> = Rgb([40, 220, 60]);
const FIRST_SIDE: Rgb<u8> = Rgb([255, 170, 0]);
const CROSS: Rgb<u8> = Rgb([255, 40, 40]);
const NUMBER: Rgb<u8> = Rgb([60, 160, 255]);

/// Digits of 3 x 5 cells, a row in three bits.
const DIGITS: [[u8; 5]; 10] = [
    [7, 5, 5, 5, 7],
    [2, 6, 2, 2, 7],
    [7, 1, 7, 4, 7],
    [7, 1, 7, 1, 7],
    [5, 5, 7, 1, 1],
    [7, 4, 7, 1, 7],
    [7, 4, 7, 5, 7],
    [7, 1, 1, 1, 1],
    [7, 5, 7, 5, 7],
    [7, 5, 7, 1, 7],
];

/// The picture with what was found in it; `corners` as a detector returns them, sorted by pattern, tag and corner.
#[must_use]
pub fn draw(picture: &GreyPicture, corners: &[Corner]) -> RgbImage {
    let width = picture.width();
    let mut canvas = RgbImage::from_fn(width as u32, picture.height() as u32, |x, y| {
        let value = picture.pixel(x as usize, y as usize).unwrap_or(0);
        Rgb([value; 3])
    });
    for one in corners.chunk_by(|a, b| (a.pattern, a.tag) == (b.pattern, b.tag)) {
        match one[0].tag {
            Some(id) => {
                for (place, corner) in one.iter().enumerate() {
                    let next = &one[(place + 1) % one.len()];
                    if next.corner == (corner.corner + 1) % 4 {
                        let colour = if corner.corner == 0 { FIRST_SIDE } else { OUTLINE };
                        line(&mut canvas, corner.pixel, next.pixel, colour);
                    }
                }
                let n = one.len() as f64;
                let middle = [0, 1].map(|axis: usize| one.iter().map(|corner| corner.pixel[axis]).sum::<f64>() / n);
                number(&mut canvas, middle, id);
            }
            None => one.windows(2).for_each(|two| line(&mut canvas, two[0].pixel, two[1].pixel, OUTLINE)),
        }
        for corner in one {
            let [x, y] = corner.pixel;
            line(&mut canvas, [x - 3.0, y], [x + 3.0, y], CROSS);
            line(&mut canvas, [x, y - 3.0], [x, y + 3.0], CROSS);
        }
    }
    canvas
}

/// Draws into a PNG file, making its folder.
///
/// # Errors
/// [`PictureError::Unwritable`].
pub fn draw_to(path: &Path, picture: &GreyPicture, corners: &[Corner]) -> Result<(), PictureError> {
    let unwritable = |words: String| PictureError::Unwritable { path: path.to_owned(), words };
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(|error| unwritable(error.to_string()))?;
    }
    draw(picture, corners)
        .save_with_format(path, image::ImageFormat::Png)
        .map_err(|error| unwritable(error.to_string()))
}

fn dot(canvas: &mut RgbImage, x: f64, y: f64, colour: Rgb<u8>) {
    let (x, y) = (x.round(), y.round());
    if x >= 0.0
        && y >= 0.0
        && let Some(pixel) = canvas.get_pixel_mut_checked(x as u32, y as u32)
    {
        *pixel = colour;
    }
}

fn line(canvas: &mut RgbImage, from: [f64; 2], to: [f64; 2], colour: Rgb<u8>) {
    let delta = [to[0] - from[0], to[1] - from[1]];
    // A lens may throw a corner anywhere; no line is longer than a picture is wide.
    let steps = delta[0].abs().max(delta[1].abs()).ceil().clamp(1.0, 65_536.0) as usize;
    for step in 0..=steps {
        let t = step as f64 / steps as f64;
        dot(canvas, from[0] + t * delta[0], from[1] + t * delta[1], colour);
    }
}

fn number(canvas: &mut RgbImage, middle: [f64; 2], number: u32) {
    const SCALE: usize = 2;
    let text = number.to_string();
    let left = middle[0] - (text.len() * 4 * SCALE) as f64 / 2.0;
    for (place, digit) in text.bytes().enumerate() {
        let Some(rows) = DIGITS.get(usize::from(digit - b'0')) else { continue };
        for (y, row) in rows.iter().enumerate() {
            for x in (0..3).filter(|x| row & (4 >> x) != 0) {
                for k in 0..SCALE * SCALE {
                    let (dx, dy) = ((place * 4 + x) * SCALE + k % SCALE, y * SCALE + k / SCALE);
                    dot(canvas, left + dx as f64, middle[1] - 5.0 + dy as f64, NUMBER);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tag_is_outlined_and_nothing_outside_the_picture_matters() {
        let picture = GreyPicture::new(40, 30, vec![100; 1200]).unwrap();
        let corner =
            |corner: u32, pixel: [f64; 2]| Corner { pattern: 0, tag: Some(42), corner, pixel, covariance: None };
        let corners = [
            corner(0, [5.0, 5.0]),
            corner(1, [30.0, 5.0]),
            corner(2, [30.0, 25.0]),
            corner(3, [5.0, 25.0]),
            Corner { tag: None, ..corner(0, [-1e9, f64::NAN]) },
        ];
        let drawn = draw(&picture, &corners);
        assert_eq!(*drawn.get_pixel(15, 5), FIRST_SIDE);
        assert_eq!(*drawn.get_pixel(15, 25), OUTLINE);
        assert_eq!(*drawn.get_pixel(5, 5), CROSS);
        assert!(drawn.pixels().any(|pixel| *pixel == NUMBER));
        assert_eq!(*drawn.get_pixel(38, 28), Rgb([100; 3]));
    }
}
