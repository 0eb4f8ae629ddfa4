//! From cells to ids.
//!
//! A dictionary's codes are made once, as whole numbers of up to 64 bits: the data cells row by row, whatever ring of
//! known cells lies between or around them. A code that is read is looked up as it is; only when that
//! fails, and the border has already shown that it is a tag, is it compared with all codes.

use std::collections::HashMap;
use std::sync::OnceLock;

use crate::geometry::dictionary::Dictionary;

/// A pattern that has a tag's rings but is none is read as one at most once in so many cases (small dictionaries: whatever their size makes it).
const CHANCE: f64 = 3000.0;

/// How a family of tags is laid out, and its codes.
#[derive(Debug)]
pub(super) struct Codebook {
    /// Cells along the edge that is found.
    pub edge: usize,
    /// Cells along the whole pattern.
    pub side: usize,
    /// Whether the ring of cells just inside the edge is the bright one.
    pub bright_inside: bool,
    /// How many wrong cells are mended: what the dictionary's distance allows, and less where chance would make tags of clutter.
    pub most_wrong: u32,
    /// Tags whose bright cells are one rectangle: any dark box with a label looks like one.
    plain: Vec<u32>,
    /// The places of the data cells in each of the four turns, in the order of a code's bits.
    data: [Vec<usize>; 4],
    codes: Vec<u64>,
    exact: HashMap<u64, u32>,
}

impl Codebook {
    /// The codebook of a dictionary, made at its first use.
    pub fn of(dictionary: Dictionary) -> &'static Self {
        static BOOKS: [OnceLock<Codebook>; 32] = [const { OnceLock::new() }; 32];
        // There are fewer dictionaries than places.
        BOOKS[dictionary as usize % BOOKS.len()].get_or_init(|| Self::new(dictionary))
    }

    fn new(dictionary: Dictionary) -> Self {
        let (side, edge) = (dictionary.cells_per_side(), dictionary.edge_cells());
        let last = side - 1;
        let turned = |quarters: usize| -> Vec<usize> {
            data_cells(side, edge)
                .map(|cell| {
                    let (row, column) = (cell / side, cell % side);
                    let (row, column) = match quarters {
                        0 => (row, column),
                        1 => (column, last - row),
                        2 => (last - row, last - column),
                        _ => (last - column, row),
                    };
                    row * side + column
                })
                .collect()
        };
        let data = [0, 1, 2, 3].map(turned);
        let codes: Vec<u64> = (0..dictionary.tag_count())
            .filter_map(|id| {
                let cells = dictionary.cells(id)?;
                Some(code(&data[0], &cells))
            })
            .collect();
        let exact = codes.iter().zip(0..).map(|(code, id)| (*code, id)).collect();
        let bits = data[0].len() as u32;
        let most_wrong = believable(bits, codes.len(), dictionary.correctable_cells());
        let plain = (0..dictionary.tag_count())
            .filter(|id| dictionary.cells(*id).is_some_and(|cells| is_rectangle(side, &cells)))
            .collect();
        Self { edge, side, bright_inside: dictionary.data_around_border(), most_wrong, plain, data, codes, exact }
    }

    /// Whether a tag's bright cells are one rectangle.
    pub fn is_plain(&self, id: u32) -> bool {
        self.plain.contains(&id)
    }

    /// Number of data cells.
    pub fn bits(&self) -> usize {
        self.data[0].len()
    }

    /// The tag whose cells these are (row by row, the whole pattern, whether bright) in one of the four turns: id, number of
    /// quarter turns, wrong cells. A turn of 1 means that the pattern's first corner is the second one read.
    pub fn identify(&self, cells: &[bool], most_wrong: u32) -> Option<(u32, usize, u32)> {
        let turned = self.data.each_ref().map(|places| code(places, cells));
        let mut exact =
            turned.iter().enumerate().filter_map(|(quarters, code)| Some((*self.exact.get(code)?, quarters, 0)));
        if let Some(found) = exact.next() {
            // A tag that looks the same after half a turn has no first corner (the original family has such a tag).
            return exact.next().is_none().then_some(found);
        }
        if most_wrong == 0 {
            return None;
        }
        let (mut best, mut tied) = ((most_wrong + 1, 0, 0), false);
        for (id, code) in (0..).zip(&self.codes) {
            for (quarters, read) in turned.iter().enumerate() {
                let wrong = (code ^ read).count_ones();
                if wrong < best.0 {
                    (best, tied) = ((wrong, id, quarters), false);
                } else if wrong == best.0 {
                    tied = true;
                }
            }
        }
        (best.0 <= most_wrong && !tied).then_some((best.1, best.2, best.0))
    }
}

/// The code of the cells at some places.
fn code(places: &[usize], cells: &[bool]) -> u64 {
    places.iter().fold(0, |code, place| (code << 1) | u64::from(cells.get(*place).copied().unwrap_or(false)))
}

/// The most wrong cells, up to a limit, with which a random pattern is still taken for a tag less often than in one of [`CHANCE`] cases.
fn believable(bits: u32, codes: usize, limit: u32) -> u32 {
    // Patterns within so many cells of a code, in any turn.
    let (mut near, mut sphere) = (1.0, 1.0);
    let all = 2.0_f64.powi(bits as i32);
    let mut most = 0;
    for wrong in 1..=limit {
        near *= f64::from(bits + 1 - wrong) / f64::from(wrong);
        sphere += near;
        if 4.0 * codes as f64 * sphere * CHANCE > all {
            break;
        }
        most = wrong;
    }
    most
}

/// Whether the bright cells are all that a rectangle holds.
fn is_rectangle(side: usize, cells: &[bool]) -> bool {
    let bright = || cells.iter().enumerate().filter(|(_, bright)| **bright).map(|(k, _)| [k / side, k % side]);
    let extent = |axis: usize| {
        let (least, most) = bright().fold((side, 0), |(low, high), at| (at[axis].min(low), at[axis].max(high)));
        (most + 1).saturating_sub(least)
    };
    bright().count() == extent(0) * extent(1)
}

/// The places of the data cells, row by row: all but the ring inside the edge and, where data lies around it, the ring outside.
fn data_cells(side: usize, edge: usize) -> impl Iterator<Item = usize> {
    let around = (side - edge) / 2;
    (0..side * side).filter(move |cell| {
        let (row, column) = (cell / side, cell % side);
        // Ring 0 is the outermost.
        let ring = row.min(column).min(side - 1 - row).min(side - 1 - column);
        ring != around && ring + 1 != around
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nothing but tag 1023 of the original family, which is alike after half a turn, is refused.
    #[test]
    fn what_has_no_first_corner_is_refused() {
        for dictionary in Dictionary::all() {
            let book = Codebook::of(dictionary);
            let refused: Vec<u32> = (0..dictionary.tag_count())
                .filter(|id| book.identify(&dictionary.cells(*id).unwrap(), 0).is_none())
                .collect();
            assert_eq!(
                refused,
                if dictionary == Dictionary::ArucoOriginal { vec![1023] } else { vec![] },
                "{dictionary}"
            );
        }
    }

    #[test]
    fn few_tags_look_like_a_box_with_a_label() {
        for dictionary in Dictionary::all() {
            let book = Codebook::of(dictionary);
            let plain: Vec<u32> = (0..dictionary.tag_count()).filter(|id| book.is_plain(*id)).collect();
            let expected = match dictionary.cells_per_side() {
                6 if !dictionary.data_around_border() && book.codes.len() >= 50 => vec![17],
                _ if dictionary == Dictionary::ArucoOriginal => vec![0, 1023],
                _ => vec![],
            };
            assert_eq!(plain, expected, "{dictionary}");
        }
    }

    #[test]
    fn every_tag_is_identified_in_every_turn_and_with_as_many_wrong_cells_as_allowed() {
        for dictionary in Dictionary::all() {
            let book = Codebook::of(dictionary);
            assert!(book.bits() <= 64);
            let side = book.side;
            let data: Vec<usize> = data_cells(side, book.edge).collect();
            let whole = |id: &u32| book.identify(&dictionary.cells(*id).unwrap(), 0).is_some();
            for id in (0..dictionary.tag_count()).filter(whole).step_by(1 + dictionary.tag_count() as usize / 20) {
                let mut cells = dictionary.cells(id).unwrap();
                for quarters in 0..4 {
                    // Read from the pattern's corner `quarters` before the first: the first is then read as number `quarters`.
                    let (found, turns, wrong) = book.identify(&cells, 0).unwrap();
                    assert_eq!((found, turns, wrong), (id, quarters, 0), "{dictionary}");
                    let mut spoilt = cells.clone();
                    for k in 0..dictionary.correctable_cells() as usize {
                        let cell = data[(k * 7 + id as usize) % data.len()];
                        spoilt[cell] = !spoilt[cell];
                    }
                    let found = book.identify(&spoilt, dictionary.correctable_cells());
                    // The original family's tags are too near to each other for any wrong cell to be mended safely.
                    if dictionary != Dictionary::ArucoOriginal || found.is_some() {
                        assert_eq!(found.map(|found| (found.0, found.1)), Some((id, quarters)), "{dictionary} {id}");
                    }
                    // Clockwise by a quarter: what was top-left is now top-right.
                    cells = (0..side * side).map(|i| cells[(side - 1 - i % side) * side + i / side]).collect();
                }
            }
        }
    }
}
