//! ChArUco boards that OpenCV 4.6 itself draws: with an odd number of rows as every version does, with an even one "legacy".
#![cfg(feature = "opencv")]

use ::opencv::core::{Mat, Size};
use ::opencv::{aruco, prelude::*};
use cellmap::detect::opencv::OpenCvDetector;
use cellmap::detect::{Detector, Dictionary, GreyPicture, Pattern};

#[test]
fn both_ways_of_printing_get_the_same_numbers() {
    for rows in [7usize, 6] {
        let (columns, square, margin) = (5usize, 60usize, 40usize);
        let family = aruco::get_predefined_dictionary_i32(Dictionary::Aruco6x6_250 as i32).unwrap();
        let mut board = aruco::CharucoBoard::create(columns as i32, rows as i32, 1.0, 0.7, &family).unwrap();
        let (width, height) = (columns * square + 2 * margin, rows * square + 2 * margin);
        let mut drawn = Mat::default();
        board.draw(Size::new(width as i32, height as i32), &mut drawn, margin as i32, 1).unwrap();
        let picture = GreyPicture::new(width, height, drawn.data_bytes().unwrap().to_vec()).unwrap();
        let wanted = [Pattern::Charuco {
            squares: [columns, rows],
            square: 1.0,
            marker: 0.7,
            dictionary: Dictionary::Aruco6x6_250,
            first_id: 0,
        }];
        let found = OpenCvDetector::new().unwrap().detect(&picture, None, &wanted).unwrap();
        assert_eq!(found.len(), (columns - 1) * (rows - 1), "{rows} rows");
        for (number, corner) in (0..).zip(&found) {
            assert_eq!((corner.corner, corner.tag), (number, None));
            let (column, row) = (number as usize % (columns - 1), number as usize / (columns - 1));
            // Between two pixels, hence the half.
            let truth = [column, row].map(|place| (margin + (place + 1) * square) as f64 - 0.5);
            assert!(
                (corner.pixel[0] - truth[0]).hypot(corner.pixel[1] - truth[1]) < 0.05,
                "{rows} rows: {corner:?} {truth:?}"
            );
        }
    }
}
