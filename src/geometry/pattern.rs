//! How a target looks to a detector.

use super::dictionary::Dictionary;

/// What to look for in a picture.
#[derive(Clone, Debug, PartialEq)]
pub enum Pattern {
    /// Square tags of one dictionary with these ids.
    Tags {
        /// The dictionary.
        dictionary: Dictionary,
        /// The ids on the target.
        ids: Vec<u32>,
    },
    /// A checkerboard of `columns` x `rows` *inner* corners, both at least 2.
    Checkerboard {
        /// Inner corners along x.
        columns: usize,
        /// Inner corners along y.
        rows: usize,
    },
    /// A ChArUco board.
    Charuco {
        /// Squares along x and y.
        squares: [usize; 2],
        /// Edge of a square (any unit, the same as `marker`).
        square: f64,
        /// Edge of a marker.
        marker: f64,
        /// The dictionary of the markers.
        dictionary: Dictionary,
        /// The id of the marker nearest to the first corner; the others count on from it.
        first_id: u32,
    },
}
