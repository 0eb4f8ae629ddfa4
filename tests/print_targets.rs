//! Targets on paper: the PDF is rasterised at 600 dpi and searched for tags, as a camera would, knowing nothing of where they were put.

use cellmap::geometry::dictionary::Dictionary;
use cellmap::layout::{Layout, parse_layout};
use cellmap::print::{Paper, PrintError, PrintOptions, Printed, PrintedTag, print};
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;

const DPI: f64 = 600.0;

fn layout(targets: &str) -> Layout {
    let text = format!("cellmap: 1\nunits: {{length: mm, angle: deg}}\nworld: w\ntargets:\n{targets}");
    parse_layout(Path::new("layout.yaml"), &text, None).unwrap()
}

fn options(paper: Paper) -> PrintOptions {
    PrintOptions { paper, targets: Vec::new(), tile: false }
}

/// A page in grey, 0 for black.
struct Raster {
    width: usize,
    height: usize,
    grey: Vec<u8>,
}

impl Raster {
    fn at(&self, x: f64, y: f64) -> f64 {
        let (x, y) = ((x.max(0.0) as usize).min(self.width - 1), (y.max(0.0) as usize).min(self.height - 1));
        f64::from(self.grey[y * self.width + x])
    }
}

/// Pages by an independent renderer; what is transparent is paper.
fn rasterise(pdf: &[u8]) -> Vec<Raster> {
    let pdf = hayro::Pdf::new(Arc::new(pdf.to_vec())).unwrap();
    let scale = (DPI / 72.0) as f32;
    let settings = hayro::RenderSettings { x_scale: scale, y_scale: scale, ..Default::default() };
    let interpreter = hayro::InterpreterSettings::default();
    pdf.pages()
        .iter()
        .map(|page| {
            let pixmap = hayro::render(page, &interpreter, &settings);
            let (width, height) = (usize::from(pixmap.width()), usize::from(pixmap.height()));
            let grey = pixmap
                .data_as_u8_slice()
                .chunks_exact(4)
                .map(|p| (u16::from(p[0]) + 255 - u16::from(p[3])).min(255) as u8)
                .collect();
            Raster { width, height, grey }
        })
        .collect()
}

/// Black areas that hang together: left, top, right, bottom (px, right and bottom beyond).
fn areas(page: &Raster) -> Vec<[usize; 4]> {
    let mut seen = vec![false; page.grey.len()];
    let mut all = Vec::new();
    for start in 0..page.grey.len() {
        if seen[start] || page.grey[start] >= 128 {
            continue;
        }
        let mut found = [usize::MAX, usize::MAX, 0, 0];
        let mut stack = vec![start];
        seen[start] = true;
        while let Some(at) = stack.pop() {
            let (x, y) = (at % page.width, at / page.width);
            found = [found[0].min(x), found[1].min(y), found[2].max(x + 1), found[3].max(y + 1)];
            let mut visit = |next: usize| {
                if !seen[next] && page.grey[next] < 128 {
                    seen[next] = true;
                    stack.push(next);
                }
            };
            if x > 0 {
                visit(at - 1);
            }
            if x + 1 < page.width {
                visit(at + 1);
            }
            if y > 0 {
                visit(at - page.width);
            }
            if y + 1 < page.height {
                visit(at + page.width);
            }
        }
        all.push(found);
    }
    all
}

/// The length of ink (mm) along a line through an area's border, to a fraction of a pixel.
fn ink(page: &Raster, area: [usize; 4], along_x: bool, share: f64) -> f64 {
    let (from, to, across, width) = if along_x {
        (area[0], area[2], area[1], area[3] - area[1])
    } else {
        (area[1], area[3], area[0], area[2] - area[0])
    };
    let line = across as f64 + share * width as f64;
    let sum: f64 = (from.saturating_sub(3)..to + 3)
        .map(|i| 255.0 - if along_x { page.at(i as f64, line) } else { page.at(line, i as f64) })
        .sum();
    sum / 255.0 / DPI * 25.4
}

/// Every tag of some dictionaries on a page: dictionary, id, size (mm) across and down.
fn find_tags(page: &Raster, dictionaries: &[Dictionary]) -> Vec<(Dictionary, u32, f64, f64)> {
    let mut found = Vec::new();
    for area in areas(page) {
        let (width, height) = (area[2] - area[0], area[3] - area[1]);
        if width < 60 || width.abs_diff(height) > 2 {
            continue;
        }
        for &dictionary in dictionaries {
            let side = dictionary.cells_per_side();
            let cell = width as f64 / side as f64;
            let white = |column: usize, row: usize| {
                page.at(area[0] as f64 + (column as f64 + 0.5) * cell, area[1] as f64 + (row as f64 + 0.5) * cell)
                    > 128.0
            };
            let seen: Vec<bool> = (0..side * side).map(|i| white(i % side, i / side)).collect();
            let id = (0..dictionary.tag_count()).find(|id| dictionary.cells(*id).unwrap() == seen);
            if let Some(id) = id {
                let share = 0.5 / side as f64;
                found.push((dictionary, id, ink(page, area, true, share), ink(page, area, false, share)));
                break;
            }
        }
    }
    found
}

/// Prints, rasterises, finds, and compares with what was asked for.
fn check(printed: &Printed, expected: &[(Dictionary, u32, f64)]) {
    let dictionaries: BTreeSet<Dictionary> = expected.iter().map(|e| e.0).collect();
    let dictionaries: Vec<Dictionary> = dictionaries.into_iter().collect();
    let pages = rasterise(&printed.pdf);
    assert_eq!(pages.len(), printed.pages.len());
    let mut found: Vec<_> = pages.iter().flat_map(|page| find_tags(page, &dictionaries)).collect();
    found.sort_by_key(|f| (f.0, f.1));
    let mut expected = expected.to_vec();
    expected.sort_by_key(|e| (e.0, e.1));
    let ids = |list: &[(Dictionary, u32)]| list.to_vec();
    assert_eq!(
        ids(&found.iter().map(|f| (f.0, f.1)).collect::<Vec<_>>()),
        ids(&expected.iter().map(|e| (e.0, e.1)).collect::<Vec<_>>())
    );
    for (found, expected) in found.iter().zip(&expected) {
        assert!((found.2 - expected.2).abs() < 0.05, "{found:?} {expected:?}");
        assert!((found.3 - expected.2).abs() < 0.05, "{found:?} {expected:?}");
    }
}

#[test]
fn every_printed_tag_is_found_with_its_id_and_size() {
    let (six, four, april) = (Dictionary::Aruco6x6_250, Dictionary::Aruco4x4_50, Dictionary::AprilTag36h11);
    let layout = layout(
        "  table: {tags: {dictionary: 6x6_250, grid: {columns: 3, rows: 2, size: 42, gap: 12, first_id: 3}}}\n  \
         one: {tags: {dictionary: 4x4_50, size: 33.7, ids: [7]}}\n  \
         loose: {tags: {dictionary: 4x4_50, size: 25, ids: [8, 9]}}\n  \
         april: {april_grid: {columns: 3, rows: 2, size: 30, spacing: 0.3}}\n",
    );
    let printed = print(&layout, &options(Paper::A4)).unwrap();
    let mut expected: Vec<_> = (3..9).map(|id| (six, id, 42.0)).collect();
    expected.extend([(four, 7, 33.7), (four, 8, 25.0), (four, 9, 25.0)]);
    expected.extend((0..6).map(|id| (april, id, 30.0)));
    check(&printed, &expected);
}

#[test]
fn a_page_a_tag_and_letter_paper_hold_the_same_tags() {
    let layout = layout("  cube: {tags: {dictionary: 5x5_100, cube: {edge: 40, size: 30, ids: [4, 5, 6, 7, 8]}}}\n");
    let expected: Vec<_> = (4..9).map(|id| (Dictionary::Aruco5x5_100, id, 30.0)).collect();
    let pages = print(&layout, &options(Paper::Tag)).unwrap();
    assert_eq!(pages.pages.len(), 5);
    check(&pages, &expected);
    let net = print(&layout, &options(Paper::Letter)).unwrap();
    assert_eq!((net.pages.len(), &net.notes), (1, &Vec::new()));
    check(&net, &expected);
}

/// Folding the net brings every tag to where the layout has it: neighbours in the net share an edge of the cube.
#[test]
fn a_net_folds_to_the_cube() {
    let layout = layout("  cube: {tags: {dictionary: 5x5_100, cube: {edge: 40, size: 30, ids: [4, 5, 6, 7, 8, 9]}}}\n");
    let printed = print(&layout, &options(Paper::A4)).unwrap();
    let cellmap::geometry::TargetGeometry::Tags(faces) = &layout.targets[0].geometry else { panic!() };
    let corner = |id: u32, i: usize| {
        let face = faces.iter().find(|face| face.id == id).unwrap();
        face.target_from_tag.unwrap() * cellmap::geometry::target::tag_corners(face.size)[i]
    };
    let tags = &printed.pages[0].tags;
    assert_eq!(tags.len(), 6);
    let mut neighbours = 0;
    for a in tags {
        for b in tags.iter().filter(|b| b.id > a.id) {
            let middle = |tag: &PrintedTag| [0, 1].map(|i| tag.corners.iter().map(|c| c[i]).sum::<f64>() / 4.0);
            let (ma, mb) = (middle(a), middle(b));
            if ((ma[0] - mb[0]).hypot(ma[1] - mb[1]) - 40.0).abs() > 1e-6 {
                continue;
            }
            neighbours += 1;
            // The two corners of each that are nearest to the fold lie 5 mm from it: 10 mm apart on paper, 5 * sqrt 2 on the cube.
            let mut pairs = 0;
            for i in 0..4 {
                for j in 0..4 {
                    let paper = (a.corners[i][0] - b.corners[j][0]).hypot(a.corners[i][1] - b.corners[j][1]);
                    if (paper - 10.0).abs() < 1e-6 {
                        pairs += 1;
                        let apart = (corner(a.id, i) - corner(b.id, j)).norm() * 1e3;
                        assert!((apart - 50f64.sqrt()).abs() < 1e-6, "{} {} {apart}", a.id, b.id);
                    }
                }
            }
            assert_eq!(pairs, 2);
        }
    }
    assert_eq!(neighbours, 5);
}

/// Boards, tags turned in their plane and a family with data around its border: every cell and square is where the page's list says.
#[test]
fn boards_and_turned_tags_have_their_cells_in_place() {
    let layout = layout(
        "  shelf: {charuco: {squares: [6, 4], square: 24, marker: 17, dictionary: 4x4_50}}\n  \
         solid:\n    tags:\n      dictionary: 6x6_250\n      places:\n        \
         - {id: 1, size: 30, pose: {xyz: [0, 0, 0], rpy: [0, 0, 0]}}\n        \
         - {id: 2, size: 30, pose: {xyz: [60, 10, 0], rpy: [0, 0, 30]}}\n        \
         - {id: 3, size: 30, pose: {xyz: [0, 0, 40], rpy: [90, 0, 0]}}\n  \
         ring: {tags: {dictionary: apriltag_standard41h12, size: 40, ids: [5]}}\n",
    );
    let printed = print(&layout, &options(Paper::A4)).unwrap();
    let pages = rasterise(&printed.pdf);
    let mut tags = 0;
    for (page, raster) in printed.pages.iter().zip(&pages) {
        for tag in &page.tags {
            tags += 1;
            let (side, edge) = (tag.dictionary.cells_per_side(), tag.dictionary.edge_cells() as f64);
            let beyond = (side as f64 - edge) / 2.0;
            let cells = tag.dictionary.cells(tag.id).unwrap();
            for (i, white) in cells.iter().enumerate() {
                let [u, v] = [(i % side) as f64, (i / side) as f64].map(|at| (at + 0.5 - beyond) / edge);
                let [a, b, _, d] = tag.corners;
                let at = [0, 1].map(|k| (a[k] + u * (b[k] - a[k]) + v * (d[k] - a[k])) / 25.4 * DPI);
                assert_eq!(raster.at(at[0], at[1]) > 128.0, *white, "tag {} cell {i}", tag.id);
            }
        }
    }
    // 12 markers, three tags of the solid (two in one plane), one with a ring.
    assert_eq!(tags, 12 + 3 + 1);
}

#[test]
fn a_checkerboard_has_true_squares() {
    let layout = layout("  board: {checkerboard: {corners: [5, 4], square: 25}}\n");
    let printed = print(&layout, &options(Paper::A4)).unwrap();
    let pages = rasterise(&printed.pdf);
    let squares: Vec<[usize; 4]> = areas(&pages[0])
        .into_iter()
        .filter(|area| (area[2] - area[0]).abs_diff(591) < 4 && (area[3] - area[1]).abs_diff(591) < 4)
        .collect();
    assert_eq!(squares.len(), 15);
    for area in &squares {
        for along_x in [true, false] {
            let size = ink(&pages[0], *area, along_x, 0.3);
            assert!((size - 25.0).abs() < 0.05, "{size}");
        }
    }
    // The first square, left of and above the others, is black.
    let left = squares.iter().map(|a| a[0]).min().unwrap();
    let top = squares.iter().map(|a| a[1]).min().unwrap();
    assert!(squares.iter().any(|a| a[0].abs_diff(left) < 3 && a[1].abs_diff(top) < 3));
}

#[test]
fn what_is_too_large_is_refused_or_tiled() {
    let layout =
        layout("  big: {tags: {dictionary: 6x6_250, grid: {columns: 4, rows: 3, size: 90, gap: 20, first_id: 0}}}\n");
    let error = print(&layout, &options(Paper::A4)).unwrap_err();
    let PrintError::TooLarge { fits, .. } = &error else { panic!("{error}") };
    assert_eq!(*fits, Some("a2"));
    let one = print(&layout, &options(Paper::A2)).unwrap();
    assert_eq!(one.pages.len(), 1);
    let tiled = print(&layout, &PrintOptions { tile: true, ..options(Paper::A4) }).unwrap();
    assert!(tiled.pages.len() > 3, "{}", tiled.pages.len());
    // Tags that one page holds whole are as large there as on the large sheet.
    let whole: Vec<&PrintedTag> = tiled.pages.iter().flat_map(|page| &page.tags).collect();
    assert!(!whole.is_empty());
    let expected: Vec<_> = whole.iter().map(|tag| (Dictionary::Aruco6x6_250, tag.id, 90.0)).collect();
    check(&tiled, &expected);
}

#[test]
fn nothing_and_nobody_are_said() {
    let layout =
        layout("  ball: {points: {tip: [0, 0, 1]}}\n  tag: {tags: {dictionary: 4x4_50, size: 20, ids: [1]}}\n");
    let only = |name: &str| PrintOptions { targets: vec![name.to_owned()], ..options(Paper::A4) };
    assert_eq!(print(&layout, &only("ball")), Err(PrintError::Nothing));
    assert_eq!(print(&layout, &only("bell")), Err(PrintError::NoSuchTarget("bell".to_owned())));
    let printed = print(&layout, &options(Paper::A4)).unwrap();
    assert_eq!(printed.notes, ["`ball` is not printed: it has no pattern"]);
    assert_eq!(printed.pdf, print(&layout, &options(Paper::A4)).unwrap().pdf, "the same layout gives the same bytes");
}
