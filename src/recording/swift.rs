//! A quick way to read `detections.csv` as detectors write it: all cores, one pass over the bytes, no quoting, no complaints.
//!
//! Whatever is out of the ordinary (quotes, spaces, unknown names, numbers that are none, a corner given twice) makes it give up, and the
//! careful reader of [`super::detections`] says what is wrong and where. Every row is written where it stays: the lines are found first,
//! then read into one array.

use rayon::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::cells::{cell, ends, number_at, one_of, whole};
use super::corners::{CornerRow, Corners};
use super::detections::{COLUMNS, COVARIANCE, feature_of};
use super::names::Names;
use crate::geometry::{Feature, TargetGeometry};
use crate::layout::{Layout, Target};

/// Bytes in which one task looks for lines.
const PIECE: usize = 1 << 18;

/// Lines that a task reads at least.
const LINES: usize = 1024;

/// Cells of a line at most.
const MOST_CELLS: usize = 32;

/// What a cell of a line holds.
#[derive(Clone, Copy)]
enum Column {
    Configuration,
    Shot,
    Camera,
    Target,
    Tag,
    Corner,
    Pixel(usize),
    Covariance(usize),
    Other,
}

/// The rows of a file in the order of [`CornerRow::key`]; none if there is anything unusual about it.
pub(super) fn read(bytes: &[u8], layout: &Layout) -> Option<Corners> {
    let header_end = memchr::memchr(b'\n', bytes)? + 1;
    let columns = columns(&bytes[..header_end])?;
    let starts = starts(bytes, header_end);
    let reader = Reader::new(layout, bytes, &columns);
    let odd = AtomicBool::new(false);
    let read = |last: &mut Last, start: &usize| {
        let row = if odd.load(Ordering::Relaxed) { None } else { reader.row(*start, last) };
        row.unwrap_or_else(|| {
            odd.store(true, Ordering::Relaxed);
            BLANK
        })
    };
    let mut rows = Vec::new();
    starts.par_iter().with_min_len(LINES).map_init(Last::default, read).collect_into_vec(&mut rows);
    if odd.into_inner() {
        return None;
    }
    drop(starts);
    if !ascending(&rows) {
        rows.sort_by(|a, b| a.key().cmp(&b.key()));
        if !ascending(&rows) {
            return None;
        }
    }
    Some(Corners::named(Arc::new(Names::of(layout)), rows.iter()))
}

/// Stands where a line could not be read; such rows are never handed out.
const BLANK: CornerRow = CornerRow {
    configuration: 0,
    shot: 0,
    camera: 0,
    target: 0,
    feature: Feature::BoardCorner(0),
    pixel: [0.0; 2],
    covariance: None,
};

/// Whether the rows are in order and no two are of the same corner.
fn ascending(rows: &[CornerRow]) -> bool {
    rows.par_windows(2).with_min_len(LINES).all(|pair| pair[0].key() < pair[1].key())
}

/// What the cells of every line hold, by the header.
fn columns(header: &[u8]) -> Option<Vec<Column>> {
    let names = std::str::from_utf8(header).ok()?.trim_end_matches(['\r', '\n']).split(',');
    let mut columns = Vec::new();
    let mut seen = [0usize; COLUMNS.len() + COVARIANCE.len()];
    for name in names {
        let place = COLUMNS.iter().chain(&COVARIANCE).position(|known| *known == name);
        place.into_iter().for_each(|place| seen[place] += 1);
        columns.push(match place {
            Some(0) => Column::Configuration,
            Some(1) => Column::Shot,
            Some(2) => Column::Camera,
            Some(3) => Column::Target,
            Some(4) => Column::Tag,
            Some(5) => Column::Corner,
            Some(place @ 6..=7) => Column::Pixel(place - 6),
            Some(place) => Column::Covariance(place - COLUMNS.len()),
            None => Column::Other,
        });
    }
    let (needed, covariance) = seen.split_at(COLUMNS.len());
    let whole = needed.iter().all(|count| *count == 1) && matches!(covariance, [0, 0, 0] | [1, 1, 1]);
    (whole && columns.len() <= MOST_CELLS).then_some(columns)
}

/// Where the lines begin that are not empty.
fn starts(bytes: &[u8], first: usize) -> Vec<usize> {
    let filled = |start: &usize| !matches!(&bytes[*start..], [] | [b'\n', ..] | [b'\r', b'\n', ..] | [b'\r']);
    let body = &bytes[first..];
    let pieces: Vec<Vec<usize>> = body
        .par_chunks(PIECE)
        .enumerate()
        .map(|(number, piece)| {
            let ends = memchr::memchr_iter(b'\n', piece);
            ends.map(|end| first + number * PIECE + end + 1).filter(&filled).collect()
        })
        .collect();
    let mut starts = Vec::with_capacity(1 + pieces.iter().map(Vec::len).sum::<usize>());
    starts.extend(Some(first).filter(&filled));
    pieces.iter().for_each(|piece| starts.extend(piece));
    starts
}

/// What lines are read with.
struct Reader<'a> {
    layout: &'a Layout,
    bytes: &'a [u8],
    columns: &'a [Column],
    /// Names that stand for themselves in a file; none for one that needs quotes.
    cameras: Vec<Option<&'a [u8]>>,
    targets: Vec<Option<&'a [u8]>>,
    /// How many corners each target has if it is a board.
    boards: Vec<u64>,
}

/// What was found on the line before: most likely the same again.
#[derive(Default)]
struct Last {
    camera: usize,
    target: usize,
    /// A tag that this target has.
    tag: Option<(usize, u32)>,
}

impl<'a> Reader<'a> {
    fn new(layout: &'a Layout, bytes: &'a [u8], columns: &'a [Column]) -> Self {
        let name = |name: &'a String| {
            let alone = plain(name) && !name.contains([',', '\n']);
            alone.then_some(name.as_bytes())
        };
        let corners = |target: &Target| match target.geometry {
            TargetGeometry::Board { columns, rows, .. } => columns as u64 * rows as u64,
            _ => 0,
        };
        Self {
            layout,
            bytes,
            columns,
            // A camera without a lens has no corners.
            cameras: layout.cameras.iter().map(|c| c.intrinsics.as_ref().and_then(|_| name(&c.name))).collect(),
            targets: layout.targets.iter().map(|target| name(&target.name)).collect(),
            boards: layout.targets.iter().map(corners).collect(),
        }
    }

    /// The line that begins at `at`.
    fn row(&self, mut at: usize, last: &mut Last) -> Option<CornerRow> {
        let mut row = BLANK;
        let (mut tag, mut corner): (&[u8], u64) = (&[], 0);
        let (mut covariance, mut given) = ([0.0; 3], 0);
        for (number, column) in self.columns.iter().enumerate() {
            if number > 0 {
                // Fewer cells than the header has.
                at = (self.bytes.get(at) == Some(&b',')).then_some(at + 1)?;
            }
            let rest = &self.bytes[at..];
            at += match column {
                Column::Configuration => whole(rest, &mut row.configuration)?,
                Column::Shot => whole(rest, &mut row.shot)?,
                Column::Corner => whole(rest, &mut corner)?,
                Column::Camera => one_of(rest, &self.cameras, last.camera, &mut row.camera)?,
                Column::Target => one_of(rest, &self.targets, last.target, &mut row.target)?,
                Column::Tag => {
                    tag = &rest[..cell(rest)];
                    tag.len()
                }
                Column::Pixel(axis) => number_at(rest, &mut row.pixel[*axis])?,
                Column::Covariance(_) if ends(rest, 0) => 0,
                Column::Covariance(place) => {
                    given += 1;
                    number_at(rest, &mut covariance[*place])?
                }
                Column::Other => {
                    let length = cell(rest);
                    // Quotes and lone carriage returns can hide the end of a cell.
                    memchr::memchr2(b'"', b'\r', &rest[..length]).is_none().then_some(length)?
                }
            };
        }
        // More cells than the header has.
        if self.bytes.get(at) == Some(&b',') {
            return None;
        }
        row.covariance = match (given, covariance) {
            (0, _) => None,
            // The careful reader's own conditions.
            (3, [suu, suv, svv]) if suu > 0.0 && svv > 0.0 && suu * svv - suv * suv > 0.0 => Some(covariance),
            _ => return None,
        };
        row.feature = self.feature(row.target, tag, corner, last)?;
        (last.camera, last.target) = (row.camera, row.target);
        Some(row)
    }

    fn feature(&self, target: usize, tag: &[u8], corner: u64, last: &mut Last) -> Option<Feature> {
        if tag.is_empty() && corner < self.boards[target] {
            return Some(Feature::BoardCorner(u32::try_from(corner).ok()?));
        }
        let geometry = &self.layout.targets[target].geometry;
        let mut id = 0;
        if let TargetGeometry::Tags(_) = geometry
            && whole(tag, &mut id) == Some(tag.len())
        {
            let (id, corner) = (u32::try_from(id).ok()?, u8::try_from(corner).ok().filter(|corner| *corner < 4)?);
            let feature = Feature::TagCorner(id, corner);
            if last.tag != Some((target, id)) {
                geometry.has(&feature).then_some(())?;
                last.tag = Some((target, id));
            }
            return Some(feature);
        }
        let tag = std::str::from_utf8(tag).ok().filter(|tag| plain(tag))?;
        feature_of(geometry, tag, corner).filter(|feature| geometry.has(feature))
    }
}

/// Text that means itself in a CSV file: no quotes, nothing to trim.
fn plain(text: &str) -> bool {
    text.trim() == text && !text.contains(['"', '\r'])
}
