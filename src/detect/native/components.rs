//! Dark (or bright) patches of a picture, and how far each reaches to the left and to the right.
//!
//! A tag's black border is one connected patch, and because a square in perspective is convex, all that matters of its
//! outline is its leftmost and rightmost pixel on every row. So no contour is ever followed: rows are cut into
//! runs, runs that touch (8 neighbours) are united, and of the patches that are of a tag's size the extents are
//! collected. Clutter costs a few nanoseconds a run.

use std::cell::RefCell;

use pulp::{Arch, Simd, WithSimd};

use super::tiles::{TILE, Tiles};
use crate::detect::picture::GreyPicture;

/// A patch that is longer than this many px in one direction may be a tag, if in neither it is smaller than its cells can be seen.
const LEAST_LONG: u32 = 8;

/// Dark or bright pixels beside each other on one row: `start..end`.
#[derive(Debug, Clone, Copy)]
struct Run {
    start: u32,
    end: u32,
    /// The label of its patch.
    label: u32,
}

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

/// The runs of one shade, row after row.
#[derive(Debug, Default)]
struct Runs {
    runs: Vec<Run>,
    labels: Vec<Label>,
    /// Where each row's runs begin; one more at the end.
    rows: Vec<u32>,
    /// Places of the first runs of the row above and of this one.
    above: usize,
    here: usize,
}

impl Runs {
    fn clear(&mut self) {
        self.runs.clear();
        self.labels.clear();
        self.rows.clear();
        self.rows.push(0);
        (self.above, self.here) = (0, 0);
    }

    #[inline(always)]
    fn push(&mut self, start: u32, end: u32) {
        self.runs.push(Run { start, end, label: 0 });
    }

    /// Unites the runs of the row that just ended with those above it.
    fn end_row(&mut self) {
        let row = self.rows.len() as u32 - 1;
        let end = self.runs.len();
        let (old, new) = self.runs.split_at_mut(self.here);
        let mut above = old.get(self.above..).unwrap_or(&[]);
        for run in new {
            while let [first, rest @ ..] = above
                && first.end < run.start
            {
                above = rest;
            }
            let mut mine = None;
            for other in above.iter().take_while(|other| other.start <= run.end) {
                let other = root(&mut self.labels, other.label);
                mine = Some(match mine {
                    None => other,
                    Some(mine) if mine == other => mine,
                    Some(mine) => unite(&mut self.labels, mine, other),
                });
            }
            let area = run.end - run.start;
            run.label = mine.unwrap_or(self.labels.len() as u32);
            match self.labels.get_mut(run.label as usize) {
                Some(label) => {
                    label.left = label.left.min(run.start);
                    label.right = label.right.max(run.end);
                    label.bottom = row;
                    label.area += area;
                }
                None => self.labels.push(Label {
                    parent: run.label,
                    left: run.start,
                    right: run.end,
                    top: row,
                    bottom: row,
                    area,
                }),
            }
        }
        self.rows.push(end as u32);
        (self.above, self.here) = (self.here, end);
    }

    /// Keeps the patches that may be tags.
    fn patches(&mut self, width: u32, shortest: u32) -> Patches {
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
                && u64::from(label.area) * 4 >= u64::from(across + down) * 5;
            places.push(if kept { total + (height - label.top) } else { NONE });
            if kept {
                found.patches.push([label.top, total, down, label.area]);
                total += down;
            }
        }
        found.left.resize(total as usize, u32::MAX);
        found.right.resize(total as usize, 0);
        let mut from = 0;
        for (row, to) in self.rows.iter().skip(1).enumerate() {
            for run in &self.runs[from..*to as usize] {
                let place = places[run.label as usize];
                if place != NONE {
                    let at = (place + row as u32 - height) as usize;
                    found.left[at] = found.left[at].min(run.start);
                    found.right[at] = found.right[at].max(run.end);
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
        let found = [dark.patches(width, shortest), bright.patches(width, shortest)];
        for runs in [dark, bright] {
            // A giant picture's memory is not kept.
            runs.runs.shrink_to(1 << 18);
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

fn collect<const DARK: bool, const BRIGHT: bool>(
    picture: &GreyPicture,
    tiles: &Tiles,
    dark_runs: &mut Runs,
    bright_runs: &mut Runs,
) {
    let (width, height) = (picture.width(), picture.height());
    dark_runs.clear();
    bright_runs.clear();
    let padded = tiles.columns * TILE;
    let (mut levels, mut flags) = (vec![0u8; padded], vec![0u8; padded.next_multiple_of(WORD)]);
    let mut spans: Vec<std::ops::Range<usize>> = Vec::new();
    let arch = Arch::new();
    for row in 0..height {
        if row % TILE == 0 {
            let first = row / TILE * tiles.columns;
            let thresholds = tiles.thresholds.get(first..first + tiles.columns).unwrap_or(&[]);
            spans.clear();
            let mut begin = 0;
            for part in thresholds.chunk_by(|a, b| (*a == 0) == (*b == 0)) {
                if part[0] != 0 {
                    spans.push(begin * TILE..((begin + part.len()) * TILE).min(width));
                }
                begin += part.len();
            }
            for (eight, threshold) in levels.chunks_exact_mut(TILE).zip(thresholds) {
                eight.fill(*threshold);
            }
        }
        let pixels = picture.pixels().get(row * width..(row + 1) * width).unwrap_or(&[]);
        for span in &spans {
            let (pixels, levels) = (&pixels[span.clone()], &levels[span.clone()]);
            let flags = &mut flags[..pixels.len().next_multiple_of(WORD)];
            arch.dispatch(Darker { pixels, levels, flags });
            // Padding repeats the last pixel, so that a bright run does not end early and a dark one not late.
            let last = flags[pixels.len() - 1];
            flags[pixels.len()..].fill(last);
            cut::<DARK, BRIGHT>(flags, span.clone(), dark_runs, bright_runs);
        }
        if DARK {
            dark_runs.end_row();
        }
        if BRIGHT {
            bright_runs.end_row();
        }
    }
}

/// 1 where a pixel is darker than its level, else 0.
struct Darker<'a> {
    pixels: &'a [u8],
    levels: &'a [u8],
    flags: &'a mut [u8],
}

impl WithSimd for Darker<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for ((flag, value), level) in self.flags.iter_mut().zip(self.pixels).zip(self.levels) {
            *flag = u8::from(value < level);
        }
    }
}

/// Pixels that [`cut`] looks at together.
const WORD: usize = 64;

/// Cuts a span of a row into runs. `flags` is padded with its last value to whole words.
fn cut<const DARK: bool, const BRIGHT: bool>(
    flags: &[u8],
    span: std::ops::Range<usize>,
    dark: &mut Runs,
    bright: &mut Runs,
) {
    let (mut begin, mut at) = (span.start as u32, span.start as u32);
    // The last pixel of the word before.
    let mut shade = u64::from(flags.first().copied().unwrap_or(0));
    for word in flags.chunks_exact(WORD) {
        // Byte i of an eight, which is 0 or 1, becomes bit i of the highest byte.
        let bits = word.chunks_exact(8).rev().fold(0, |bits, eight| {
            let eight = eight.try_into().map_or(0, u64::from_le_bytes);
            (bits << 8) | (eight.wrapping_mul(0x0102_0408_1020_4080) >> 56)
        });
        let mut changes = bits ^ ((bits << 1) | shade);
        while changes != 0 {
            let bit = changes.trailing_zeros();
            let place = at + bit;
            if (bits >> bit) & 1 == 0 {
                if DARK {
                    dark.push(begin, place);
                }
            } else if BRIGHT {
                bright.push(begin, place);
            }
            begin = place;
            changes &= changes - 1;
        }
        shade = bits >> (WORD - 1);
        at += WORD as u32;
    }
    // Padding repeats the last flag and so changes nothing.
    let end = span.end as u32;
    if shade == 1 && DARK {
        dark.push(begin, end);
    }
    if shade == 0 && BRIGHT {
        bright.push(begin, end);
    }
}
