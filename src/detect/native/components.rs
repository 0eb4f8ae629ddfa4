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

/// A patch that is longer than this many px in one direction, and
const LEAST_LONG: u32 = 8;
/// this many in the other, may be a tag.
const LEAST_SHORT: u32 = 4;

/// Dark or bright pixels beside each other on one row: `start..end`.
#[derive(Debug, Clone, Copy)]
struct Run {
    start: u32,
    end: u32,
    /// Place of a run of the same patch, not after this one.
    parent: u32,
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
    /// Where each row's runs begin; one more at the end.
    rows: Vec<u32>,
    /// Places of the first runs of the row above and of this one.
    above: usize,
    here: usize,
}

impl Runs {
    fn clear(&mut self) {
        self.runs.clear();
        self.rows.clear();
        self.rows.push(0);
        (self.above, self.here) = (0, 0);
    }

    #[inline(always)]
    fn push(&mut self, start: u32, end: u32) {
        let parent = self.runs.len() as u32;
        self.runs.push(Run { start, end, parent });
    }

    fn root(&mut self, mut run: u32) -> u32 {
        loop {
            let parent = self.runs[run as usize].parent;
            if parent == run {
                return run;
            }
            let grandparent = self.runs[parent as usize].parent;
            self.runs[run as usize].parent = grandparent;
            run = grandparent;
        }
    }

    /// Unites the runs of the row that just ended with those above it.
    fn end_row(&mut self) {
        let end = self.runs.len();
        let mut above = self.above;
        for this in self.here..end {
            let Run { start, end, .. } = self.runs[this];
            while above < self.here && self.runs[above].end < start {
                above += 1;
            }
            let mut touching = above;
            let mut mine = None;
            while touching < self.here && self.runs[touching].start <= end {
                let other = self.root(touching as u32);
                mine = Some(match mine {
                    None => other,
                    Some(mine) => {
                        let (first, second) = (other.min(mine), other.max(mine));
                        self.runs[second as usize].parent = first;
                        first
                    }
                });
                touching += 1;
            }
            if let Some(root) = mine {
                self.runs[this].parent = root;
            }
        }
        self.rows.push(end as u32);
        (self.above, self.here) = (self.here, end);
    }

    /// Keeps the patches that may be tags.
    fn patches(&mut self, width: u32) -> Patches {
        const NONE: u32 = u32::MAX;
        struct Box {
            left: u32,
            right: u32,
            top: u32,
            bottom: u32,
            area: u32,
        }
        let mut boxes: Vec<Box> = Vec::new();
        let height = self.rows.len() as u32 - 1;
        // A parent stands before its children, so one sweep numbers all patches: `parent` becomes the patch's number.
        let mut from = 0;
        for (row, to) in self.rows.iter().skip(1).enumerate() {
            for this in from..*to as usize {
                let Run { start, end, parent } = self.runs[this];
                let patch = if parent as usize == this {
                    boxes.push(Box { left: start, right: end, top: row as u32, bottom: row as u32, area: 0 });
                    boxes.len() as u32 - 1
                } else {
                    self.runs[parent as usize].parent
                };
                self.runs[this].parent = patch;
                let Some(bounds) = boxes.get_mut(patch as usize) else { continue };
                bounds.left = bounds.left.min(start);
                bounds.right = bounds.right.max(end);
                bounds.bottom = row as u32;
                bounds.area += end - start;
            }
            from = *to as usize;
        }
        let mut found = Patches::default();
        let mut places = Vec::with_capacity(boxes.len());
        let mut total = 0u32;
        for bounds in &boxes {
            let (across, down) = (bounds.right - bounds.left, bounds.bottom - bounds.top + 1);
            let whole = bounds.left > 0 && bounds.top > 0 && bounds.right < width && bounds.bottom + 1 < height;
            // A closed border has at least twice the pixels of its box's two sides, less what slant takes away.
            let kept = whole
                && across.max(down) >= LEAST_LONG
                && across.min(down) >= LEAST_SHORT
                && u64::from(bounds.area) * 4 >= u64::from(across + down) * 5;
            places.push(if kept { total.wrapping_sub(bounds.top) } else { NONE });
            if kept {
                found.patches.push([bounds.top, total, down, bounds.area]);
                total += down;
            }
        }
        found.left.resize(total as usize, u32::MAX);
        found.right.resize(total as usize, 0);
        let mut from = 0;
        for (row, to) in self.rows.iter().skip(1).enumerate() {
            for run in &self.runs[from..*to as usize] {
                let place = places[run.parent as usize];
                if place != NONE {
                    let at = place.wrapping_add(row as u32) as usize;
                    found.left[at] = found.left[at].min(run.start);
                    found.right[at] = found.right[at].max(run.end);
                }
            }
            from = *to as usize;
        }
        found
    }
}

thread_local! {
    /// The memory of the last picture's runs: getting it anew from the system each time costs as much as filling it.
    static MEMORY: RefCell<[Runs; 2]> = RefCell::default();
}

/// The dark and the bright patches that may be tags.
pub(super) fn patches(picture: &GreyPicture, tiles: &Tiles) -> [Patches; 2] {
    MEMORY.with_borrow_mut(|[dark, bright]| {
        collect(picture, tiles, dark, bright);
        let width = picture.width() as u32;
        let found = [dark.patches(width), bright.patches(width)];
        for runs in [dark, bright] {
            // A giant picture's memory is not kept.
            runs.runs.shrink_to(1 << 18);
        }
        found
    })
}

fn collect(picture: &GreyPicture, tiles: &Tiles, dark_runs: &mut Runs, bright_runs: &mut Runs) {
    let (width, height) = (picture.width(), picture.height());
    dark_runs.clear();
    bright_runs.clear();
    let padded = tiles.columns * TILE;
    let (mut levels, mut flags) = (vec![0u8; padded], vec![0u8; padded]);
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
            let flags = &mut flags[..pixels.len().next_multiple_of(TILE)];
            arch.dispatch(Darker { pixels, levels, flags });
            // Padding repeats the last pixel, so that a bright run does not end early and a dark one not late.
            let last = flags[pixels.len() - 1];
            flags[pixels.len()..].fill(last);
            cut(flags, span.clone(), dark_runs, bright_runs);
        }
        dark_runs.end_row();
        bright_runs.end_row();
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

/// Cuts a span of a row into runs.
fn cut(flags: &[u8], span: std::ops::Range<usize>, dark: &mut Runs, bright: &mut Runs) {
    const ALL: u64 = 0x0101_0101_0101_0101;
    let (mut begin, mut at) = (span.start as u32, span.start as u32);
    // Eight times the last flag, and that as a bit.
    let (mut last, mut shade) = (0, 0);
    for eight in flags.chunks_exact(TILE) {
        let eight = eight.try_into().map_or(0, u64::from_le_bytes);
        // Mostly nothing changes.
        if eight != last {
            // Byte i, which is 0 or 1, becomes bit i of the highest byte.
            let bits = (eight.wrapping_mul(0x0102_0408_1020_4080) >> 56) as u32;
            let mut changes = bits ^ ((bits << 1) | shade) & 0xff;
            while changes != 0 {
                let bit = changes.trailing_zeros();
                let place = at + bit;
                if place > begin {
                    if (bits >> bit) & 1 == 0 {
                        dark.push(begin, place);
                    } else {
                        bright.push(begin, place);
                    }
                }
                begin = place;
                changes &= changes - 1;
            }
            shade = bits >> 7;
            last = if shade == 1 { ALL } else { 0 };
        }
        at += TILE as u32;
    }
    // Padding repeats the last flag and so changes nothing.
    let end = span.end as u32;
    if shade == 1 {
        dark.push(begin, end);
    } else {
        bright.push(begin, end);
    }
}
