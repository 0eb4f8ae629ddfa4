//! Plates on pages: side by side in rows, with captions, crop marks, orientation marks and a ruler.

use super::plate::{Plate, PrintedTag};
use super::shapes::{Point, Shape, line, words, wrap};
use super::tiles;
use super::{Paper, PrintError, PrintOptions};

/// A page ready to be written.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Page {
    /// Width and height, mm.
    pub(super) size: [f64; 2],
    /// From the top left corner, y down.
    pub(super) shapes: Vec<Shape>,
    /// Where every tag stands.
    pub(super) tags: Vec<PrintedTag>,
    /// The plates on it.
    pub(super) plates: Vec<String>,
}

/// What no printer prints, mm.
pub(super) const MARGIN: f64 = 8.0;
/// The strip of the ruler, mm.
pub(super) const FOOTER: f64 = 12.0;
/// Around a plate, for crop marks, mm.
const AROUND: f64 = 4.0;
/// Height of caption words and of their lines, mm.
const WORDS: f64 = 2.5;
const LINE: f64 = 3.4;
/// The orientation mark beside a caption, mm.
const MARK: f64 = 11.0;
/// A caption is not set narrower than this, mm.
const NARROWEST: f64 = 46.0;

/// A plate with its caption and marks.
struct Block {
    size: [f64; 2],
    shapes: Vec<Shape>,
    tags: Vec<PrintedTag>,
    title: String,
}

fn block(plate: Plate) -> Block {
    let inner = plate.size[0].max(NARROWEST);
    let lines: Vec<String> = plate.caption.iter().flat_map(|text| wrap(text, WORDS, inner - MARK)).collect();
    let below = (lines.len() as f64 * LINE).max(if plate.axes.is_empty() { 0.0 } else { MARK - 1.0 });
    let below = if below > 0.0 { below + 1.5 } else { 0.0 };
    let size = [inner + 2.0 * AROUND, plate.size[1] + 2.0 * AROUND + below];
    let mut shapes = Vec::new();
    if plate.crop {
        crop_marks([AROUND, AROUND], plate.size, &mut shapes);
    }
    let top = plate.size[1] + 2.0 * AROUND;
    orientation_mark([AROUND, top], &plate.axes, &mut shapes);
    let left = AROUND + if plate.axes.is_empty() { 0.0 } else { MARK };
    for (i, text) in lines.into_iter().enumerate() {
        shapes.push(words([left, top + WORDS + i as f64 * LINE], WORDS, 0.25, text));
    }
    shapes.extend(plate.shapes.into_iter().map(|shape| shape.moved([AROUND, AROUND])));
    Block { size, shapes, tags: shifted(plate.tags, [AROUND, AROUND]), title: plate.title }
}

pub(super) fn shifted(tags: Vec<PrintedTag>, by: Point) -> Vec<PrintedTag> {
    let shift = |mut tag: PrintedTag| {
        tag.corners = tag.corners.map(|[x, y]| [x + by[0], y + by[1]]);
        tag
    };
    tags.into_iter().map(shift).collect()
}

/// Short lines outside the corners of a rectangle.
pub(super) fn crop_marks([x, y]: Point, [width, height]: [f64; 2], shapes: &mut Vec<Shape>) {
    let (near, far) = (1.0, 3.5);
    for (cx, sx) in [(x, -1.0), (x + width, 1.0)] {
        for (cy, sy) in [(y, -1.0), (y + height, 1.0)] {
            shapes.push(line([cx + sx * near, cy], [cx + sx * far, cy], 0.12, 0.3));
            shapes.push(line([cx, cy + sy * near], [cx, cy + sy * far], 0.12, 0.3));
        }
    }
}

/// Arrows along the target's axes.
fn orientation_mark(at: Point, axes: &[(String, Point)], shapes: &mut Vec<Shape>) {
    // An arrow that points up needs its foot lower.
    let down = axes.iter().any(|(_, to)| to[1] > 0.0);
    let foot = [at[0] + 2.0, at[1] + if down { 2.0 } else { 9.0 }];
    for (name, [dx, dy]) in axes {
        let tip = [foot[0] + 5.0 * dx, foot[1] + 5.0 * dy];
        shapes.push(line(foot, tip, 0.25, 0.0));
        let (back, side) = ([tip[0] - 1.4 * dx, tip[1] - 1.4 * dy], [-dy * 0.7, dx * 0.7]);
        let head = vec![tip, [back[0] + side[0], back[1] + side[1]], [back[0] - side[0], back[1] - side[1]]];
        shapes.push(Shape::Fill { outlines: vec![head], grey: 0.0 });
        let label =
            [tip[0] + 0.8 * dx + if *dx == 0.0 { 0.8 } else { 0.0 }, tip[1] + if *dy == 0.0 { 0.8 } else { 0.0 }];
        shapes.push(words(label, 2.4, 0.0, name.clone()));
    }
}

/// A ruler with its own numbers, at the bottom of a page.
pub(super) fn footer(size: [f64; 2], number: Option<(usize, usize)>, shapes: &mut Vec<Shape>) {
    let room = size[0] - 2.0 * MARGIN;
    let length = (room / 10.0).floor().clamp(1.0, 10.0) * 10.0;
    let (left, base) = (MARGIN, size[1] - MARGIN);
    shapes.push(line([left, base], [left + length, base], 0.15, 0.0));
    for mm in 0..=length as usize {
        let height = if mm.is_multiple_of(10) {
            3.0
        } else if mm.is_multiple_of(5) {
            2.2
        } else {
            1.4
        };
        let x = left + mm as f64;
        shapes.push(line([x, base], [x, base - height], 0.1, 0.0));
        if mm.is_multiple_of(10) {
            shapes.push(words([x - 1.0, base - 3.6], 1.8, 0.2, mm.to_string()));
        }
    }
    shapes.push(words([left, base + 2.8], 1.9, 0.2, format!("{length:.0} mm: print at 100 %, then measure")));
    if let (Some((page, pages)), true) = (number, room > length + 40.0) {
        shapes.push(words(
            [left + length + 6.0, base],
            2.2,
            0.3,
            format!("page {page} of {pages}, cellmap {}", crate::VERSION),
        ));
    }
}

fn room(size: [f64; 2]) -> [f64; 2] {
    [size[0] - 2.0 * MARGIN, size[1] - 2.0 * MARGIN - FOOTER]
}

/// The page, upright or lying, on which something fits.
fn page_for(needed: [f64; 2], paper: Paper) -> Option<[f64; 2]> {
    let [width, height] = paper.size()?;
    [[width, height], [height, width]].into_iter().find(|page| {
        let room = room(*page);
        needed[0] <= room[0] && needed[1] <= room[1]
    })
}

/// Whether a plate fits on a paper.
pub(super) fn fits(plate: &Plate, paper: Paper) -> bool {
    paper.size().is_none() || page_for(block(plate.clone()).size, paper).is_some()
}

/// Puts plates on pages.
pub(super) fn arrange(plates: Vec<Plate>, options: &PrintOptions) -> Result<Vec<Page>, PrintError> {
    let mut pages = if options.paper == Paper::Tag {
        plates.into_iter().map(own_page).collect()
    } else {
        on_paper(plates, options)?
    };
    let count = pages.len();
    for (i, page) in pages.iter_mut().enumerate() {
        footer(page.size, Some((i + 1, count)), &mut page.shapes);
    }
    Ok(pages)
}

fn own_page(plate: Plate) -> Page {
    let block = block(plate);
    let size = [block.size[0] + 2.0 * MARGIN, block.size[1] + 2.0 * MARGIN + FOOTER];
    let mut page = Page { size, shapes: Vec::new(), tags: Vec::new(), plates: Vec::new() };
    put(&mut page, block, [MARGIN, MARGIN]);
    page
}

fn put(page: &mut Page, block: Block, at: Point) {
    page.shapes.extend(block.shapes.into_iter().map(|shape| shape.moved(at)));
    page.tags.extend(shifted(block.tags, at));
    page.plates.push(block.title);
}

fn on_paper(plates: Vec<Plate>, options: &PrintOptions) -> Result<Vec<Page>, PrintError> {
    let mut pages: Vec<Page> = Vec::new();
    // Where the next plate of the last page goes, and how high its row is.
    let (mut at, mut row) = ([0.0, 0.0], 0.0);
    for plate in plates {
        let whole = plate.clone();
        let block = block(plate);
        let Some(size) = page_for(block.size, options.paper) else {
            if !options.tile {
                return Err(too_large(&block, options.paper));
            }
            pages.extend(tiles::tiles(whole, options.paper));
            // The next plate begins a page of its own.
            at = [0.0, f64::INFINITY];
            continue;
        };
        let place = pages.last().and_then(|page| {
            let room = room(page.size);
            if at[0] + block.size[0] <= room[0] && at[1] + block.size[1] <= room[1] {
                return Some(at);
            }
            let below = [0.0, at[1] + row];
            (block.size[0] <= room[0] && below[1] + block.size[1] <= room[1]).then_some(below)
        });
        let place = place.unwrap_or_else(|| {
            pages.push(Page { size, shapes: Vec::new(), tags: Vec::new(), plates: Vec::new() });
            [0.0, 0.0]
        });
        row = if place[0] == 0.0 { block.size[1] } else { f64::max(row, block.size[1]) };
        at = [place[0] + block.size[0], place[1]];
        if let Some(page) = pages.last_mut() {
            put(page, block, [MARGIN + place[0], MARGIN + place[1]]);
        }
    }
    Ok(pages)
}

fn too_large(block: &Block, paper: Paper) -> PrintError {
    let fits = Paper::ALL.into_iter().find(|other| page_for(block.size, *other).is_some()).map(Paper::name);
    let [width, height] = block.size.map(|side| side.ceil() as u32);
    PrintError::TooLarge { title: block.title.clone(), width, height, paper: paper.name(), fits }
}
