//! A quick way to read `detections.csv` as detectors write it: all cores, one pass over the bytes, no quoting, no complaints.
//!
//! Whatever is out of the ordinary (quotes, spaces, unknown names, numbers that are none, a corner given twice) makes it give up, and the
//! careful reader of [`super::detections`] says what is wrong and where. A file goes through a small window, so that its text is never in memory as a
//! whole: new pages cost more than reading them.

use rayon::prelude::*;
use sha2::{Digest as _, Sha256};
use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::sync::Arc;

use super::Digest;
use super::cells::{cell, ends, number_at, one_of, whole};
use super::corners::{Appearance, Corners};
use super::detections::{COLUMNS, COVARIANCE, Piece, feature_of};
use super::held::Held;
use super::names::Names;
use crate::geometry::{Feature, TargetGeometry};
use crate::layout::{Layout, Target};

/// Bytes of a file in memory at a time.
const WINDOW: usize = 1 << 20;

/// Bytes that one task reads, about.
const PIECE: usize = 1 << 15;

/// Bytes of a line at least, about: makes room for what a piece holds.
const SHORT_LINE: usize = 32;

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

/// The corners of a file and the SHA-256 of its bytes; none if there is anything unusual about it.
pub(super) fn read(path: &Path, layout: &Layout) -> Option<(Corners, Digest)> {
    let file = File::open(path).ok()?;
    let size = file.metadata().ok()?.len() as usize;
    read_through(WINDOW.min(size + 1), file, size, layout)
}

/// Reads about `size` bytes, header first, through a window of so many bytes.
pub(super) fn read_through(
    window: usize,
    mut source: impl Read,
    size: usize,
    layout: &Layout,
) -> Option<(Corners, Digest)> {
    let mut window = vec![0; window];
    let (mut hash, mut held) = (Sha256::new(), Held::default());
    let mut reader: Option<Reader<'_>> = None;
    // Bytes of a line whose end is not in the window yet stand at its beginning.
    let mut filled = 0;
    loop {
        let old = filled;
        filled += fill(&mut source, &mut window[old..]).ok()?;
        let at_end = filled < window.len();
        let mut lines = &window[..filled];
        if !at_end {
            // A line longer than the window is unusual.
            lines = &lines[..=memchr::memrchr(b'\n', lines)?];
        }
        let whole = lines.len();
        if reader.is_none() {
            let header = memchr::memchr(b'\n', lines)? + 1;
            reader = Some(Reader::new(layout, &lines[..header])?);
            lines = &lines[header..];
        }
        let first = held.len() == 0;
        let (done, ()) = rayon::join(|| reader.as_ref()?.lines(lines, &mut held), || hash.update(&window[old..filled]));
        done?;
        if at_end {
            break;
        }
        if first {
            // As dense as the first window, and a little more.
            let windows = size as f64 / whole as f64 - 1.0;
            held.reserve((1.05 * windows * held.len() as f64) as usize);
        }
        window.copy_within(whole..filled, 0);
        filled -= whole;
    }
    Some((reader?.finish(held)?, hash.finalize().into()))
}

/// The corners of some pieces of a file; none if there is anything unusual about them.
pub(super) fn read_pieces(pieces: &[Piece], layout: &Layout) -> Option<Corners> {
    let Some(first) = pieces.first() else { return Some(Corners::default()) };
    let reader = Reader::new(layout, first.text.get(..first.header)?)?;
    let mut held = Held::default();
    for piece in pieces {
        reader.lines(piece.text.get(piece.header..)?, &mut held)?;
    }
    reader.finish(held)
}

/// Reads until there is no more or no more room.
fn fill(source: &mut impl Read, mut room: &mut [u8]) -> std::io::Result<usize> {
    let mut count = 0;
    while !room.is_empty() {
        match source.read(room) {
            Ok(0) => break,
            Ok(more) => {
                count += more;
                room = &mut room[more..];
            }
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(count)
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

/// What lines are read with.
struct Reader<'a> {
    layout: &'a Layout,
    columns: Vec<Column>,
    /// How many columns at the beginning say what a corner belongs to, and nothing else; none unless all that do are among them.
    leading: usize,
    /// Names that stand for themselves in a file; none for one that needs quotes.
    cameras: Vec<Option<&'a [u8]>>,
    targets: Vec<Option<&'a [u8]>>,
    /// The first corner's number and how many there are, of each target that is a board.
    boards: Vec<(u32, u64)>,
    names: Arc<Names>,
}

/// What was found on the line before: most likely the same again.
struct Last<'a> {
    /// What the line's corner belongs to.
    one: Appearance,
    /// The leading cells of the line and the comma after them, if they stand for that.
    leading: Option<&'a [u8]>,
    /// A tag that this target has: target, id, the number of its first corner.
    tag: Option<(usize, u32, u32)>,
}

impl<'a> Reader<'a> {
    fn new(layout: &'a Layout, header: &[u8]) -> Option<Self> {
        let columns = columns(header)?;
        let name = |name: &'a String| {
            let alone = plain(name) && !name.contains([',', '\n']);
            alone.then_some(name.as_bytes())
        };
        let names = Names::of(layout);
        let board = |(i, target): (usize, &Target)| match target.geometry {
            TargetGeometry::Board { columns, rows, .. } => {
                (names.first(i).unwrap_or_default(), columns as u64 * rows as u64)
            }
            _ => (0, 0),
        };
        let boards = layout.targets.iter().enumerate().map(board).collect();
        let of_corner =
            |column: &Column| matches!(column, Column::Tag | Column::Corner | Column::Pixel(_) | Column::Covariance(_));
        let leading = columns.iter().take_while(|column| !of_corner(column)).count();
        let rest = columns[leading..].iter();
        let all = rest.filter(|column| !of_corner(column) && !matches!(column, Column::Other)).count() == 0;
        Some(Self {
            layout,
            columns,
            leading: if all { leading } else { 0 },
            // A camera without a lens has no corners.
            cameras: layout.cameras.iter().map(|c| c.intrinsics.as_ref().and_then(|_| name(&c.name))).collect(),
            targets: layout.targets.iter().map(|target| name(&target.name)).collect(),
            boards,
            names: Arc::new(names),
        })
    }

    /// Appends the corners of whole lines.
    fn lines(&self, bytes: &[u8], held: &mut Held) -> Option<()> {
        let mut pieces = Vec::with_capacity(bytes.len() / PIECE + 1);
        let mut rest = bytes;
        while !rest.is_empty() {
            let end = rest.get(PIECE..).and_then(|after| Some(PIECE + memchr::memchr(b'\n', after)? + 1));
            let (piece, after) = rest.split_at(end.unwrap_or(rest.len()));
            pieces.push(piece);
            rest = after;
        }
        let parts: Vec<Option<Held>> = pieces.par_iter().map(|piece| self.piece(piece)).collect();
        parts.into_iter().try_for_each(|part| part.map(|part| held.append(&part)))
    }

    /// The corners of a few whole lines.
    fn piece(&self, bytes: &[u8]) -> Option<Held> {
        let mut held = Held::default();
        held.reserve(bytes.len() / SHORT_LINE);
        let mut last = Last { one: Appearance::default(), leading: None, tag: None };
        let mut at = 0;
        while at < bytes.len() {
            let rest = &bytes[at..];
            at += match rest {
                [b'\n', ..] => 1,
                [b'\r', b'\n', ..] => 2,
                [b'\r'] => 1,
                _ => self.row(rest, &mut last, &mut held)?,
            };
        }
        Some(held)
    }

    /// Appends the corner of the line at the beginning of `line`; the place of the line's end.
    #[inline]
    fn row<'b>(&self, line: &'b [u8], last: &mut Last<'b>, held: &mut Held) -> Option<usize> {
        let (mut at, mut first) = (0, 0);
        if let Some(leading) = last.leading.filter(|leading| line.starts_with(leading)) {
            (at, first) = (leading.len() - 1, self.leading);
        }
        let known = first > 0;
        let mut one = last.one;
        let (mut tag, mut corner): (&[u8], u64) = (&[], 0);
        let (mut pixel, mut covariance, mut given) = ([0.0; 2], [0.0; 3], 0);
        for (number, column) in self.columns.iter().enumerate().skip(first) {
            if number > first || known {
                // Fewer cells than the header has.
                at = (line.get(at) == Some(&b',')).then_some(at + 1)?;
            }
            let rest = &line[at..];
            at += match column {
                Column::Configuration => whole(rest, &mut one.configuration)?,
                Column::Shot => whole(rest, &mut one.shot)?,
                Column::Corner => whole(rest, &mut corner)?,
                Column::Camera => one_of(rest, &self.cameras, last.one.camera, &mut one.camera)?,
                Column::Target => one_of(rest, &self.targets, last.one.target, &mut one.target)?,
                Column::Tag => {
                    tag = &rest[..cell(rest)];
                    tag.len()
                }
                Column::Pixel(axis) => number_at(rest, &mut pixel[*axis])?,
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
            if !known && number + 1 == self.leading {
                last.leading = Some(line.get(..=at)?);
            }
        }
        // More cells than the header has.
        if line.get(at) == Some(&b',') {
            return None;
        }
        let covariance = match (given, covariance) {
            (0, _) => None,
            // The careful reader's own conditions.
            (3, [suu, suv, svv]) if suu > 0.0 && svv > 0.0 && suu * svv - suv * suv > 0.0 => Some(covariance),
            _ => return None,
        };
        last.one = one;
        let mark = self.mark(one.target, tag, corner, last)?;
        held.push(&one, mark, pixel, covariance);
        Some(at)
    }

    /// The number of the corner that two cells name.
    #[inline]
    fn mark(&self, target: usize, tag: &[u8], corner: u64, last: &mut Last<'_>) -> Option<u32> {
        let (first, count) = self.boards[target];
        if tag.is_empty() && corner < count {
            return Some(first + corner as u32);
        }
        let geometry = &self.layout.targets[target].geometry;
        let mut id = 0;
        if let TargetGeometry::Tags(_) = geometry
            && whole(tag, &mut id) == Some(tag.len())
        {
            let (id, corner) = (u32::try_from(id).ok()?, u32::try_from(corner).ok().filter(|corner| *corner < 4)?);
            let first = match last.tag.filter(|tag| (tag.0, tag.1) == (target, id)) {
                Some((.., first)) => first,
                None => {
                    let first = self.names.mark(target, &Feature::TagCorner(id, 0))?;
                    last.tag = Some((target, id, first));
                    first
                }
            };
            return Some(first + corner);
        }
        let tag = std::str::from_utf8(tag).ok().filter(|tag| plain(tag))?;
        self.names.mark(target, &feature_of(geometry, tag, corner)?)
    }

    /// The corners in order; none if one is given twice.
    fn finish(self, mut held: Held) -> Option<Corners> {
        held.order().then(|| Corners::new(self.names, held))
    }
}

/// Text that means itself in a CSV file: no quotes, nothing to trim.
fn plain(text: &str) -> bool {
    text.trim() == text && !text.contains(['"', '\r'])
}
