//! A plate larger than the paper, spread over pages that overlap.
//!
//! Neighbouring pages repeat a strip. Crosses in the plate's white margin stand on both pages: lay one cross on the other, and the seam fits.

use super::arrange::{FOOTER, MARGIN, Page, crop_marks, shifted};
use super::plate::Plate;
use super::shapes::{Point, Shape, line, words};
use super::{Paper, PrintedTag};

/// What two neighbours share, mm.
const OVERLAP: f64 = 12.0;
/// Around the tile for crop marks and words, mm.
const EDGE: f64 = 5.0;

/// Where tiles of length `tile` begin along a side of length `whole`.
fn starts(whole: f64, tile: f64) -> Vec<f64> {
    let step = tile - OVERLAP;
    let count = ((whole - OVERLAP) / step).ceil().max(1.0) as usize;
    (0..count).map(|i| i as f64 * step).collect()
}

/// The pages of a plate.
pub(super) fn tiles(plate: Plate, paper: Paper) -> Vec<Page> {
    let Some([width, height]) = paper.size() else { return Vec::new() };
    let room = |[w, h]: [f64; 2]| [w - 2.0 * MARGIN - 2.0 * EDGE, h - 2.0 * MARGIN - FOOTER - 2.0 * EDGE];
    let count =
        |page: [f64; 2]| starts(plate.size[0], room(page)[0]).len() * starts(plate.size[1], room(page)[1]).len();
    let (upright, lying) = ([width, height], [height, width]);
    let page = if count(lying) < count(upright) { lying } else { upright };
    let [tile_width, tile_height] = room(page);
    let (columns, rows) = (starts(plate.size[0], tile_width), starts(plate.size[1], tile_height));
    let mut shapes = plate.shapes.clone();
    crosses(plate.size, &columns, &rows, &mut shapes);
    let mut pages = Vec::new();
    for (r, top) in rows.iter().enumerate() {
        for (c, left) in columns.iter().enumerate() {
            let size = [tile_width.min(plate.size[0] - left), tile_height.min(plate.size[1] - top)];
            let corner = [MARGIN + EDGE, MARGIN + EDGE];
            let by = [corner[0] - left, corner[1] - top];
            let moved = shapes.iter().cloned().map(|shape| shape.moved(by)).collect();
            let mut on_page = vec![Shape::Clipped { corner, size, shapes: moved }];
            crop_marks(corner, size, &mut on_page);
            let title =
                format!("{}: row {} of {}, column {} of {}", plate.title, r + 1, rows.len(), c + 1, columns.len());
            on_page.push(words([corner[0], MARGIN + 2.0], 2.4, 0.25, format!("{title}; lay cross on cross")));
            let last = r + 1 == rows.len() && c + 1 == columns.len();
            if last {
                let below = corner[1] + size[1] + 4.0;
                for (i, text) in plate.caption.iter().enumerate().take(2) {
                    let at = [corner[0], below + 3.0 * i as f64];
                    if at[1] < page[1] - MARGIN - FOOTER {
                        on_page.push(words(at, 2.2, 0.25, text.clone()));
                    }
                }
            }
            pages.push(Page {
                size: page,
                shapes: on_page,
                tags: whole_tags(&plate.tags, by, corner, size),
                plates: vec![title],
            });
        }
    }
    pages
}

/// The tags of which a tile shows everything.
fn whole_tags(tags: &[PrintedTag], by: Point, corner: Point, size: [f64; 2]) -> Vec<PrintedTag> {
    let inside = |tag: &PrintedTag| {
        tag.corners.iter().all(|p| (0..2).all(|i| p[i] >= corner[i] - 1e-9 && p[i] <= corner[i] + size[i] + 1e-9))
    };
    shifted(tags.to_vec(), by).into_iter().filter(inside).collect()
}

/// A cross at both ends of every seam, in the middle of the overlap and of the white margin.
fn crosses(size: [f64; 2], columns: &[f64], rows: &[f64], shapes: &mut Vec<Shape>) {
    let inset = 2.5;
    let mut cross = |[x, y]: Point| {
        shapes.push(line([x - 2.0, y], [x + 2.0, y], 0.12, 0.0));
        shapes.push(line([x, y - 2.0], [x, y + 2.0], 0.12, 0.0));
    };
    for start in &columns[1..] {
        cross([start + 0.5 * OVERLAP, inset]);
        cross([start + 0.5 * OVERLAP, size[1] - inset]);
    }
    for start in &rows[1..] {
        cross([inset, start + 0.5 * OVERLAP]);
        cross([size[0] - inset, start + 0.5 * OVERLAP]);
    }
}
