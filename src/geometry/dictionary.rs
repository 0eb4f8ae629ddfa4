//! The names of tag dictionaries.
//!
//! A layout has to be checked long before a picture is opened, and on machines that have no
//! OpenCV: is the dictionary's name known, is id 300 in a dictionary of 250, how wide is one
//! cell of the black border? So the list lives here, apart from the detector, and depends on nothing.

use std::fmt;

/// A predefined family of square tags, by OpenCV's numbering.
///
/// All have a black border one cell wide around `bits_per_side` x `bits_per_side` data cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Dictionary {
    /// 4 x 4 data cells, 50 tags.
    Aruco4x4_50,
    /// 4 x 4 data cells, 100 tags.
    Aruco4x4_100,
    /// 4 x 4 data cells, 250 tags.
    Aruco4x4_250,
    /// 4 x 4 data cells, 1000 tags.
    Aruco4x4_1000,
    /// 5 x 5 data cells, 50 tags.
    Aruco5x5_50,
    /// 5 x 5 data cells, 100 tags.
    Aruco5x5_100,
    /// 5 x 5 data cells, 250 tags.
    Aruco5x5_250,
    /// 5 x 5 data cells, 1000 tags.
    Aruco5x5_1000,
    /// 6 x 6 data cells, 50 tags.
    Aruco6x6_50,
    /// 6 x 6 data cells, 100 tags.
    Aruco6x6_100,
    /// 6 x 6 data cells, 250 tags.
    Aruco6x6_250,
    /// 6 x 6 data cells, 1000 tags.
    Aruco6x6_1000,
    /// 7 x 7 data cells, 50 tags.
    Aruco7x7_50,
    /// 7 x 7 data cells, 100 tags.
    Aruco7x7_100,
    /// 7 x 7 data cells, 250 tags.
    Aruco7x7_250,
    /// 7 x 7 data cells, 1000 tags.
    Aruco7x7_1000,
    /// The 5 x 5 tags of the first ArUco library.
    ArucoOriginal,
    /// AprilRobotics' family 16h5.
    AprilTag16h5,
    /// AprilRobotics' family 25h9.
    AprilTag25h9,
    /// AprilRobotics' family 36h10.
    AprilTag36h10,
    /// AprilRobotics' family 36h11.
    AprilTag36h11,
}

/// (dictionary, canonical name, data cells a side, number of tags)
const TABLE: [(Dictionary, &str, usize, u32); 21] = [
    (Dictionary::Aruco4x4_50, "4x4_50", 4, 50),
    (Dictionary::Aruco4x4_100, "4x4_100", 4, 100),
    (Dictionary::Aruco4x4_250, "4x4_250", 4, 250),
    (Dictionary::Aruco4x4_1000, "4x4_1000", 4, 1000),
    (Dictionary::Aruco5x5_50, "5x5_50", 5, 50),
    (Dictionary::Aruco5x5_100, "5x5_100", 5, 100),
    (Dictionary::Aruco5x5_250, "5x5_250", 5, 250),
    (Dictionary::Aruco5x5_1000, "5x5_1000", 5, 1000),
    (Dictionary::Aruco6x6_50, "6x6_50", 6, 50),
    (Dictionary::Aruco6x6_100, "6x6_100", 6, 100),
    (Dictionary::Aruco6x6_250, "6x6_250", 6, 250),
    (Dictionary::Aruco6x6_1000, "6x6_1000", 6, 1000),
    (Dictionary::Aruco7x7_50, "7x7_50", 7, 50),
    (Dictionary::Aruco7x7_100, "7x7_100", 7, 100),
    (Dictionary::Aruco7x7_250, "7x7_250", 7, 250),
    (Dictionary::Aruco7x7_1000, "7x7_1000", 7, 1000),
    (Dictionary::ArucoOriginal, "aruco_original", 5, 1024),
    (Dictionary::AprilTag16h5, "apriltag_16h5", 4, 30),
    (Dictionary::AprilTag25h9, "apriltag_25h9", 5, 35),
    (Dictionary::AprilTag36h10, "apriltag_36h10", 6, 2320),
    (Dictionary::AprilTag36h11, "apriltag_36h11", 6, 587),
];

impl Dictionary {
    /// Reads a name in any of the spellings people use: `6x6_250`, `DICT_6X6_250`, `aruco_original`,
    /// `original`, `apriltag_36h11`, `36h11`. Upper and lower case are alike; `None` if unknown.
    ///
    /// ```
    /// use cellmap::geometry::dictionary::Dictionary;
    /// assert_eq!(Dictionary::parse("DICT_APRILTAG_36h11"), Dictionary::parse("36h11"));
    /// assert_eq!(Dictionary::parse("6x6_251"), None);
    /// ```
    #[must_use]
    pub fn parse(name: &str) -> Option<Self> {
        let lower = name.trim().to_ascii_lowercase();
        let bare = lower.strip_prefix("dict_").unwrap_or(&lower);
        TABLE.iter().find(|row| row.1 == bare || short_name(row.1) == bare).map(|row| row.0)
    }

    /// The name a layout and a report use: `6x6_250`, `aruco_original`, `apriltag_36h11`.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.row().1
    }

    /// Number of tags; ids run from 0 to one less.
    #[must_use]
    pub fn tag_count(self) -> u32 {
        self.row().3
    }

    /// Data cells along one side, without the border.
    #[must_use]
    pub fn bits_per_side(self) -> usize {
        self.row().2
    }

    /// Cells along one side with the black border on both ends: the unit that `size` is divided into.
    #[must_use]
    pub fn cells_per_side(self) -> usize {
        self.row().2 + 2
    }

    /// Whether the family is AprilRobotics', whose tags OpenCV keeps turned by 180 degrees.
    #[must_use]
    pub fn is_april_tag(self) -> bool {
        self.name().starts_with("apriltag_")
    }

    /// What dictionaries of the same bits share: `6x6_50` is the beginning of `6x6_1000`, so a tag of one is a tag of the other.
    #[must_use]
    pub fn family(self) -> &'static str {
        match self.name().split_once('_') {
            Some((family @ ("4x4" | "5x5" | "6x6" | "7x7"), _)) => family,
            _ => self.name(),
        }
    }

    /// Every dictionary, in OpenCV's order: the place in it is OpenCV's number of the dictionary.
    pub fn all() -> impl Iterator<Item = Self> {
        TABLE.iter().map(|row| row.0)
    }

    fn row(self) -> &'static (Self, &'static str, usize, u32) {
        // The discriminants count from 0 in the table's order; a test holds the two together.
        &TABLE[self as usize]
    }
}

/// `aruco_original` -> `original`, `apriltag_36h11` -> `36h11`; other names are short already.
fn short_name(canonical: &str) -> &str {
    canonical.strip_prefix("aruco_").or_else(|| canonical.strip_prefix("apriltag_")).unwrap_or(canonical)
}

impl fmt::Display for Dictionary {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_is_read_back_in_every_spelling() {
        for (place, dictionary) in Dictionary::all().enumerate() {
            assert_eq!(dictionary as usize, place);
            assert_eq!(TABLE[place].0, dictionary);
            let name = dictionary.name();
            for spelling in [name.to_owned(), name.to_uppercase(), format!("DICT_{name}"), short_name(name).to_owned()]
            {
                assert_eq!(Dictionary::parse(&spelling), Some(dictionary), "{spelling}");
            }
        }
        assert_eq!(Dictionary::all().count(), 21);
    }

    #[test]
    fn unknown_names_are_refused() {
        for name in ["", "6x6", "6x6_251", "dict_", "36h12", "aruco"] {
            assert_eq!(Dictionary::parse(name), None, "{name}");
        }
    }
}
