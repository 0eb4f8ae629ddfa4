//! Dark (or bright) patches of a picture, and how far each reaches to the left and to the right.
//!
//! A tag's black border is one connected patch, and because a square in perspective is convex, all that matters of its
//! outline is its leftmost and rightmost pixel on every row. So no contour is ever followed: rows are cut into
//! runs, runs that touch (8 neighbours) are united, and of the patches that are of a tag's size the extents are
//! collected. Clutter costs a few nanoseconds a run.

use std::cell::RefCell;
use std::ops::Range;

use pulp::{Simd, WithSimd};

use super::darker::{Darker, WORD};
use super::tiles::{TILE, Tiles};
use crate::detect::picture::GreyPicture;
use crate::detect::wide::dispatch;

/// A patch that is longer than this many px in one direction may be a tag, if in neither it is smaller than its cells can be seen.
const LEAST_LONG: u32 = 8;

/// What is known of a patch, or of a part of it that was united with another since.
#[derive(Debug, Clone, Copy)]
struct Label {
    /// A label of the same patch, not after this one. The rest counts where this is the label itself.
    parent: u32,
    left: u32,
    right: u32,
    top: u32,
    bottom: u32,
    area: u32,
}

/// Extents of a patch, row by row from `top`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Patch<'a> {
    pub top: u32,
    /// Leftmost pixel on each row.
    pub left: &'a [u32],
    /// One beyond the rightmost pixel on each row.
    pub right: &'a [u32],
    /// Number of pixels.
    pub area: u32,
}

/// What is found in a picture's patches, without the rest of them.
#[derive(Debug, Default)]
pub(super) struct Patches {
    left: Vec<u32>,
    right: Vec<u32>,
    /// First row, place of its extents, rows, area.
    patches: Vec<[u32; 4]>,
}

impl Patches {
    pub fn iter(&self) -> impl Iterator<Item = Patch<'_>> {
        self.patches.iter().filter_map(|[top, first, rows, area]| {
            let range = *first as usize..(*first + *rows) as usize;
            Some(Patch { top: *top, left: self.left.get(range.clone())?, right: self.right.get(range)?, area: *area })
        })
    }
}

/// The runs of one shade, row after row: dark or bright pixels beside each other.
#[derive(Debug, Default)]
struct Runs {
    /// First pixel and one beyond the last; each row is closed by a [`CLOSED`]. Beyond `used` there is room.
    runs: Vec<[u32; 2]>,
    used: usize,
    /// The label of each run's patch.
    names: Vec<u32>,
    labels: Vec<Label>,
    /// Where each row's runs begin; one more at the end.
    rows: Vec<u32>,
    /// Places of the first runs of the row above and of this one.
    above: usize,
    here: usize,
}

/// Right of all runs.
const CLOSED: [u32; 2] = [u32::MAX; 2];

impl Runs {
    fn clear(&mut self) {
        self.labels.clear();
        self.rows.clear();
        self.rows.push(1);
        // Above the first row there is nothing.
        self.room(1)[0] = CLOSED;
        (self.above, self.here, self.used) = (0, 1, 1);
    }

    /// At least so many places for runs after those that are there.
    fn room(&mut self, count: usize) -> &mut [[u32; 2]] {
        let least = self.used + count;
        if self.runs.len() < least {
            self.runs.resize(2 * least, CLOSED);
        }
        &mut self.runs[self.used..]
    }

    /// Unites the runs of the row that just ended with those above it.
    fn end_row(&mut self) {
        let row = self.rows.len() as u32 - 1;
        self.room(1)[0] = CLOSED;
        let (old, new) = self.runs.split_at(self.here);
        let above = &old[self.above..];
        let new = &new[..self.used - self.here];
        if self.names.len() <= self.used {
            self.names.resize(2 * self.used + 2, 0);
        }
        let (names, mine) = self.names.split_at_mut(self.here);
        let names = &names[self.above..];
        let mut at = 0;
        for ([start, end], name) in new.iter().zip(mine) {
            while above[at][1] < *start {
                at += 1;
            }
            let area = end - start;
            if above[at][0] <= *end {
                let mut first = root(&mut self.labels, names[at]);
                // The last one that touches may touch the next run too.
                while above[at + 1][0] <= *end {
                    at += 1;
                    let other = root(&mut self.labels, names[at]);
                    if other != first {
                        first = unite(&mut self.labels, first, other);
                    }
                }
                let label = &mut self.labels[first as usize];
                label.left = label.left.min(*start);
                label.right = label.right.max(*end);
                label.bottom = row;
                label.area += area;
                *name = first;
            } else {
                *name = self.labels.len() as u32;
                self.labels.push(Label { parent: *name, left: *start, right: *end, top: row, bottom: row, area });
            }
        }
        self.used += 1;
        self.rows.push(self.used as u32);
        (self.above, self.here) = (self.here, self.used);
    }

    /// Keeps the patches that may be tags.
    fn patches(&mut self, width: u32, shortest: u32, tiles: &Tiles) -> Patches {
        const NONE: u32 = u32::MAX;
        let height = self.rows.len() as u32 - 1;
        let mut found = Patches::default();
        // For each label where its patch's extents would begin if the patch began as many rows higher as the picture has.
        let mut places: Vec<u32> = Vec::with_capacity(self.labels.len());
        let mut total = 0u32;
        for (k, label) in (0..).zip(&self.labels) {
            if label.parent != k {
                // Parents come first.
                places.push(places[label.parent as usize]);
                continue;
            }
            let (across, down) = (label.right - label.left, label.bottom - label.top + 1);
            let whole = label.left > 0 && label.top > 0 && label.right < width && label.bottom + 1 < height;
            // A closed border has at least twice the pixels of its box's two sides, less what slant takes away.
            let kept = whole
                && across.max(down) >= LEAST_LONG
                && across.min(down) >= shortest
                && u64::from(label.area) * 4 >= u64::from(across + down) * 5
                && tiles.want(label.left..label.right, label.top..label.bottom + 1);
            places.push(if kept { total + (height - label.top) } else { NONE });
            if kept {
                found.patches.push([label.top, total, down, label.area]);
                total += down;
            }
        }
        found.left.resize(total as usize, u32::MAX);
        found.right.resize(total as usize, 0);
        let mut from = self.rows[0] as usize;
        for (row, to) in (0..).zip(&self.rows[1..]) {
            let range = from..*to as usize - 1;
            for ([start, end], name) in self.runs[range.clone()].iter().zip(&self.names[range]) {
                let place = places[*name as usize];
                if place != NONE {
                    let at = (place + row - height) as usize;
                    found.left[at] = found.left[at].min(*start);
                    found.right[at] = found.right[at].max(*end);
                }
            }
            from = *to as usize;
        }
        found
    }
}

/// The label that counts for a patch.
#[inline(always)]
fn root(labels: &mut [Label], mut label: u32) -> u32 {
    loop {
        let parent = labels[label as usize].parent;
        if parent == label {
            return label;
        }
        let grandparent = labels[parent as usize].parent;
        labels[label as usize].parent = grandparent;
        label = grandparent;
    }
}

/// Makes one patch of two; returns the label that counts from now on.
fn unite(labels: &mut [Label], one: u32, other: u32) -> u32 {
    let (first, second) = (one.min(other), one.max(other));
    let gone = labels[second as usize];
    labels[second as usize].parent = first;
    let kept = &mut labels[first as usize];
    kept.left = kept.left.min(gone.left);
    kept.right = kept.right.max(gone.right);
    kept.top = kept.top.min(gone.top);
    kept.bottom = kept.bottom.max(gone.bottom);
    kept.area += gone.area;
    first
}

thread_local! {
    /// The memory of the last picture's runs: getting it anew from the system each time costs as much as filling it.
    static MEMORY: RefCell<[Runs; 2]> = RefCell::default();
}

/// The dark and the bright patches that may be tags, as far as they are wanted.
pub(super) fn patches(picture: &GreyPicture, tiles: &Tiles, wanted: Wanted) -> [Patches; 2] {
    MEMORY.with_borrow_mut(|[dark, bright]| {
        match wanted {
            Wanted { dark: true, bright: true, .. } => collect::<true, true>(picture, tiles, dark, bright),
            Wanted { dark: true, bright: false, .. } => collect::<true, false>(picture, tiles, dark, bright),
            Wanted { dark: false, bright: true, .. } => collect::<false, true>(picture, tiles, dark, bright),
            Wanted { dark: false, bright: false, .. } => return [Patches::default(), Patches::default()],
        }
        let width = picture.width() as u32;
        // A pixel a cell, and half a pixel may be lost on either side.
        let shortest = (wanted.fewest_cells as u32).saturating_sub(1);
        let found = [dark.patches(width, shortest, tiles), bright.patches(width, shortest, tiles)];
        for runs in [dark, bright] {
            // A giant picture's memory is not kept.
            if runs.runs.len() > 1 << 18 {
                runs.runs = Vec::new();
                runs.names = Vec::new();
            }
            runs.labels.shrink_to(1 << 16);
        }
        found
    })
}

/// The shades that are looked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Wanted {
    pub dark: bool,
    pub bright: bool,
    /// Cells along the edge of the tags, at least.
    pub fewest_cells: usize,
}

/// Words without contrast that are looked at with those beside them rather than left out.
const GAP: usize = 2;

fn collect<const DARK: bool, const BRIGHT: bool>(
    picture: &GreyPicture,
    tiles: &Tiles,
    dark_runs: &mut Runs,
    bright_runs: &mut Runs,
) {
    let (width, height) = (picture.width(), picture.height());
    dark_runs.clear();
    bright_runs.clear();
    let count = width.div_ceil(WORD);
    let mut levels = vec![0u8; count * WORD];
    // Bit by bit: where there is contrast, and what is dark.
    let (mut contrast, mut words) = (vec![0u64; count], vec![0u64; count]);
    let mut spans: Vec<Range<usize>> = Vec::new();
    let darker = Darker::new();
    for row in 0..height {
        if row % TILE == 0 {
            let first = row / TILE * tiles.columns;
            let thresholds = tiles.thresholds.get(first..first + tiles.columns).unwrap_or(&[]);
            for (word, eight) in contrast.iter_mut().zip(thresholds.chunks(WORD / TILE)) {
                let mut levels = [0; WORD / TILE];
                levels[..eight.len()].copy_from_slice(eight);
                *word = set_bytes(u64::from_le_bytes(levels));
            }
            if !width.is_multiple_of(WORD) {
                contrast[count - 1] &= (1 << (width % WORD)) - 1;
            }
            spans.clear();
            for at in (0..count).filter(|at| contrast[*at] != 0) {
                match spans.last_mut() {
                    Some(span) if at <= span.end + GAP => span.end = at + 1,
                    _ => spans.push(at..at + 1),
                }
            }
            for span in &spans {
                let levels = levels[span.start * WORD..span.end * WORD].as_chunks_mut::<TILE>().0;
                for (eight, threshold) in levels.iter_mut().zip(&thresholds[span.start * WORD / TILE..]) {
                    *eight = [*threshold; TILE];
                }
            }
        }
        let pixels = picture.pixels().get(row * width..(row + 1) * width).unwrap_or(&[]);
        for span in &spans {
            let (begin, end) = (span.start * WORD, (span.end * WORD).min(width));
            let words = &mut words[span.clone()];
            darker.compare(&pixels[begin..end], &levels[begin..end], words);
            if DARK {
                cut(words, begin as u32, end as u32, dark_runs);
            }
            if BRIGHT {
                words.iter_mut().zip(&contrast[span.clone()]).for_each(|(word, contrast)| *word = !*word & contrast);
                cut(words, begin as u32, end as u32, bright_runs);
            }
        }
        if DARK {
            dark_runs.end_row();
        }
        if BRIGHT {
            bright_runs.end_row();
        }
    }
}

/// A word whose bytes have all their bits where those of another have any.
fn set_bytes(word: u64) -> u64 {
    const LOW: u64 = 0x7f7f_7f7f_7f7f_7f7f;
    // Anything above 0 carries into the highest bit of its byte.
    let any = (((word & LOW) + LOW) | word) & !LOW;
    (any >> 7) * 0xff
}

/// Cuts a part of a row into runs of pixels whose bits are set.
fn cut(words: &[u64], begin: u32, end: u32, runs: &mut Runs) {
    let places = runs.room((words.len() + 2) * WORD / 2).as_flattened_mut();
    let mut count = dispatch(Changes { words, begin, places: &mut *places });
    if count % 2 == 1 {
        places[count] = end;
        count += 1;
    }
    runs.used += count / 2;
}

/// The places where the bits of some words change, which are unset before the first; their number.
struct Changes<'a> {
    words: &'a [u64],
    begin: u32,
    /// Two words more than the words have bits.
    places: &'a mut [u32],
}

impl WithSimd for Changes<'_> {
    type Output = usize;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> usize {
        const AT_ONCE: usize = 6;
        let (mut count, mut at, mut last) = (0, self.begin, 0);
        for word in self.words {
            let mut changes = word ^ ((word << 1) | last);
            let all = changes.count_ones() as usize;
            let places = &mut self.places[count..count + WORD + AT_ONCE];
            // Some at once, whether there are so many or not: asking each time is what costs.
            for some in places.chunks_exact_mut(AT_ONCE).take(all.div_ceil(AT_ONCE)) {
                for place in some {
                    *place = at + changes.trailing_zeros();
                    changes &= changes.wrapping_sub(1);
                }
            }
            count += all;
            last = word >> (WORD - 1);
            at += WORD as u32;
        }
        count
    }
}

#[cfg(test)]
mod tests {
    use super::set_bytes;

    #[test]
    fn bytes_are_set_where_there_is_anything() {
        let mut value = 0x9e37_79b9_7f4a_7c15_u64;
        for step in 0..200 {
            value = value.wrapping_mul(0xd134_2543_de82_ef95).wrapping_add(1);
            // Zeros are rare by chance.
            let bytes = value.rotate_left(17).to_le_bytes().map(|byte| if byte % 3 == step % 3 { 0 } else { byte });
            let expected = bytes.map(|byte| if byte == 0 { 0 } else { 0xff });
            assert_eq!(set_bytes(u64::from_le_bytes(bytes)).to_le_bytes(), expected, "{bytes:?}");
        }
    }
}
