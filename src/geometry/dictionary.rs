//! The names of tag dictionaries.
//!
//! A layout has to be checked long before a picture is opened, and on machines that have no
//! OpenCV: is the dictionary's name known, is id 300 in a dictionary of 250, how wide is one
//! cell of the black border? So the list lives here, apart from the detector, and depends on nothing.

use std::fmt;

/// A predefined family of square tags, by OpenCV's numbering.
///
/// All but the last have a black border one cell wide around their data cells.
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
    /// The 6 x 6 tags that ArUco's authors found by mixed integer programming.
    ArucoMip36h12,
    /// AprilRobotics' family tagStandard41h12: a ring of data around the border, nine data cells in it.
    AprilTagStandard41h12,
}

/// One line of [`TABLE`].
struct Row {
    dictionary: Dictionary,
    name: &'static str,
    bits_per_side: usize,
    tags: u32,
    correctable: u32,
}

const fn row(dictionary: Dictionary, name: &'static str, bits_per_side: usize, tags: u32, correctable: u32) -> Row {
    Row { dictionary, name, bits_per_side, tags, correctable }
}

/// Dictionary, canonical name, data cells a side (with the border and all for a family that has data around it), number of tags, and how many
/// wrong cells can be mended: no more than half the smallest distance between two tags in any two rotations.
const TABLE: [Row; 23] = [
    row(Dictionary::Aruco4x4_50, "4x4_50", 4, 50, 1),
    row(Dictionary::Aruco4x4_100, "4x4_100", 4, 100, 1),
    row(Dictionary::Aruco4x4_250, "4x4_250", 4, 250, 1),
    row(Dictionary::Aruco4x4_1000, "4x4_1000", 4, 1000, 0),
    row(Dictionary::Aruco5x5_50, "5x5_50", 5, 50, 3),
    row(Dictionary::Aruco5x5_100, "5x5_100", 5, 100, 3),
    row(Dictionary::Aruco5x5_250, "5x5_250", 5, 250, 2),
    row(Dictionary::Aruco5x5_1000, "5x5_1000", 5, 1000, 2),
    row(Dictionary::Aruco6x6_50, "6x6_50", 6, 50, 6),
    row(Dictionary::Aruco6x6_100, "6x6_100", 6, 100, 5),
    row(Dictionary::Aruco6x6_250, "6x6_250", 6, 250, 5),
    row(Dictionary::Aruco6x6_1000, "6x6_1000", 6, 1000, 4),
    row(Dictionary::Aruco7x7_50, "7x7_50", 7, 50, 9),
    row(Dictionary::Aruco7x7_100, "7x7_100", 7, 100, 8),
    row(Dictionary::Aruco7x7_250, "7x7_250", 7, 250, 8),
    row(Dictionary::Aruco7x7_1000, "7x7_1000", 7, 1000, 6),
    row(Dictionary::ArucoOriginal, "aruco_original", 5, 1024, 1),
    row(Dictionary::AprilTag16h5, "apriltag_16h5", 4, 30, 2),
    row(Dictionary::AprilTag25h9, "apriltag_25h9", 5, 35, 4),
    row(Dictionary::AprilTag36h10, "apriltag_36h10", 6, 2320, 4),
    row(Dictionary::AprilTag36h11, "apriltag_36h11", 6, 587, 5),
    row(Dictionary::ArucoMip36h12, "aruco_mip_36h12", 6, 250, 5),
    row(Dictionary::AprilTagStandard41h12, "apriltag_standard41h12", 9, 2115, 5),
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
        TABLE.iter().find(|row| row.name == bare || short_names(row.name).contains(&bare)).map(|row| row.dictionary)
    }

    /// The name a layout and a report use: `6x6_250`, `aruco_original`, `apriltag_36h11`.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.row().name
    }

    /// Number of tags; ids run from 0 to one less.
    #[must_use]
    pub fn tag_count(self) -> u32 {
        self.row().tags
    }

    /// Cells along one side of the whole printed pattern, border included.
    #[must_use]
    pub fn cells_per_side(self) -> usize {
        if self.data_around_border() { self.row().bits_per_side } else { self.row().bits_per_side + 2 }
    }

    /// Cells along the edge that `size` measures and that a detector finds: the border's outer edge, or for a family with data around the border,
    /// the edge between its black and its white ring.
    #[must_use]
    pub fn edge_cells(self) -> usize {
        if self.data_around_border() { 5 } else { self.cells_per_side() }
    }

    /// Whether data cells stand around the border, which is then black outside its edge and white within.
    #[must_use]
    pub fn data_around_border(self) -> bool {
        self == Self::AprilTagStandard41h12
    }

    /// How many wrong cells can be mended without taking one tag for another.
    #[must_use]
    pub fn correctable_cells(self) -> u32 {
        self.row().correctable
    }

    /// OpenCV's number of the dictionary; `None` if OpenCV does not have it. The last one came with OpenCV 4.7.
    #[must_use]
    pub fn opencv_number(self) -> Option<i32> {
        (self != Self::AprilTagStandard41h12).then_some(self as i32)
    }

    /// The cells of a tag as printed, row by row from the top left, border included: whether each is white. `None` if there is no such tag.
    ///
    /// ```
    /// use cellmap::geometry::dictionary::Dictionary;
    /// let cells = Dictionary::Aruco6x6_250.cells(7).unwrap();
    /// assert_eq!(cells.len(), 64);
    /// assert!(cells[..8].iter().all(|white| !white), "the border is black");
    /// assert_eq!(Dictionary::Aruco6x6_250.cells(250), None);
    /// ```
    #[must_use]
    pub fn cells(self, id: u32) -> Option<Vec<bool>> {
        if id >= self.tag_count() {
            return None;
        }
        let stored = self.row().bits_per_side;
        let bytes = (stored * stored).div_ceil(8);
        let code = self.codes().get(id as usize * bytes..(id as usize + 1) * bytes)?;
        // A code of fewer bits than its bytes hold begins with zeros.
        let skip = if self.data_around_border() { 0 } else { 8 * bytes - stored * stored };
        let bit = |i: usize| code[(i + skip) / 8] & (0x80 >> ((i + skip) % 8)) != 0;
        let side = self.cells_per_side();
        let border = (side - stored) / 2;
        let cell = |i: usize| {
            let (column, row) = ((i % side).wrapping_sub(border), (i / side).wrapping_sub(border));
            column < stored && row < stored && bit(row * stored + column)
        };
        Some((0..side * side).map(cell).collect())
    }

    /// The stored codes: a tag after the other, row by row from the top left as printed, first cell in the highest bit. They are the codes of OpenCV's
    /// predefined dictionaries and, for the families called AprilTag, of AprilRobotics' library (turned by half a turn against OpenCV's).
    fn codes(self) -> &'static [u8] {
        match self.family() {
            "4x4" => include_bytes!("tag_codes/aruco_4x4.bin"),
            "5x5" => include_bytes!("tag_codes/aruco_5x5.bin"),
            "6x6" => include_bytes!("tag_codes/aruco_6x6.bin"),
            "7x7" => include_bytes!("tag_codes/aruco_7x7.bin"),
            "aruco_original" => include_bytes!("tag_codes/aruco_original.bin"),
            "aruco_mip_36h12" => include_bytes!("tag_codes/aruco_mip_36h12.bin"),
            "apriltag_16h5" => include_bytes!("tag_codes/apriltag_16h5.bin"),
            "apriltag_25h9" => include_bytes!("tag_codes/apriltag_25h9.bin"),
            "apriltag_36h10" => include_bytes!("tag_codes/apriltag_36h10.bin"),
            "apriltag_36h11" => include_bytes!("tag_codes/apriltag_36h11.bin"),
            _ => include_bytes!("tag_codes/apriltag_standard41h12.bin"),
        }
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
        TABLE.iter().map(|row| row.dictionary)
    }

    fn row(self) -> &'static Row {
        // The discriminants count from 0 in the table's order; a test holds the two together.
        &TABLE[self as usize]
    }
}

/// The shorter spellings of a name: `original`, `36h11`, `mip_36h12` and `36h12`, `standard41h12` and `41h12`.
fn short_names(canonical: &str) -> [&str; 2] {
    let short = canonical.strip_prefix("aruco_").or_else(|| canonical.strip_prefix("apriltag_")).unwrap_or(canonical);
    let shorter = short.strip_prefix("mip_").or_else(|| short.strip_prefix("standard")).unwrap_or(short);
    [short, shorter]
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
            assert_eq!(TABLE[place].dictionary, dictionary);
            let name = dictionary.name();
            let [short, shorter] = short_names(name).map(str::to_owned);
            for spelling in [name.to_owned(), name.to_uppercase(), format!("DICT_{name}"), short, shorter] {
                assert_eq!(Dictionary::parse(&spelling), Some(dictionary), "{spelling}");
            }
        }
        assert_eq!(Dictionary::all().count(), 23);
    }

    #[test]
    fn unknown_names_are_refused() {
        for name in ["", "6x6", "6x6_251", "dict_", "36h13", "aruco"] {
            assert_eq!(Dictionary::parse(name), None, "{name}");
        }
    }

    /// The stored codes are whole, and no two tags of a dictionary are nearer to each other, in any rotation, than its correction allows.
    #[test]
    fn tags_differ_by_more_than_what_is_mended() {
        for dictionary in Dictionary::all().filter(|d| d.tag_count() <= 250) {
            let side = dictionary.cells_per_side();
            let turn = |cells: &[bool]| -> Vec<bool> {
                (0..side * side).map(|i| cells[(side - 1 - i % side) * side + i / side]).collect()
            };
            let tags: Vec<Vec<bool>> = (0..dictionary.tag_count()).map(|id| dictionary.cells(id).unwrap()).collect();
            let bytes = dictionary.row().bits_per_side.pow(2).div_ceil(8);
            assert!(tags.len() * bytes <= dictionary.codes().len());
            let mut nearest = usize::MAX;
            for (i, tag) in tags.iter().enumerate() {
                let mut turned = tag.clone();
                for quarter in 0..4 {
                    for (j, other) in tags.iter().enumerate().take(i + 1) {
                        if (quarter, j) != (0, i) {
                            nearest = nearest.min(turned.iter().zip(other).filter(|(a, b)| a != b).count());
                        }
                    }
                    turned = turn(&turned);
                }
            }
            assert!(nearest > 2 * dictionary.correctable_cells() as usize, "{dictionary}: {nearest}");
        }
    }
}
