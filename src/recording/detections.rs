//! Corners in pictures: `detections.csv`.

use std::borrow::Borrow;
use std::fmt::Write as _;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;

use super::corners::{CornerRow, Corners};
use super::names::Names;
use super::table::Table;
use super::{Digest, atomic, swift};
use crate::complaint::InputError;
use crate::geometry::{Feature, TargetGeometry};
use crate::layout::Layout;

pub(super) const COLUMNS: [&str; 8] = ["configuration", "shot", "camera", "target", "tag", "corner", "u", "v"];
pub(super) const COVARIANCE: [&str; 3] = ["suu", "suv", "svv"];
/// Decimals of a pixel that are written.
const DECIMALS: usize = 4;

/// Reads a file of corners, sorted by [`CornerRow::key`].
///
/// # Errors
/// Faults of the file; names, tags or corners that the layout does not have; a covariance that is not positive definite; a corner given twice.
pub fn read_detections(path: &Path, layout: &Layout) -> Result<Corners, InputError> {
    read_and_digest(path, layout).map(|(corners, _)| corners)
}

/// As [`read_detections`], with the SHA-256 of the very bytes that were read: known where nothing about the file is unusual.
pub(super) fn read_and_digest(path: &Path, layout: &Layout) -> Result<(Corners, Option<Digest>), InputError> {
    match swift::read(path, layout) {
        Some((corners, digest)) => Ok((corners, Some(digest))),
        None => read_carefully(path, layout).map(|corners| (corners, None)),
    }
}

/// The reader that knows what is wrong with a file and where.
fn read_carefully(path: &Path, layout: &Layout) -> Result<Corners, InputError> {
    each_once(path, layout, rows_of(Table::open(path, &COLUMNS)?, layout)?)
}

/// Lines of a file under its header.
pub(super) struct Piece {
    pub(super) text: Vec<u8>,
    /// Bytes of the header.
    pub(super) header: usize,
    /// Lines of the file between the header and the rest.
    pub(super) passed_over: usize,
}

/// As [`read_detections`], but only some pieces of the file, and of their corners only those at configurations that are wanted.
pub(super) fn read_pieces(
    path: &Path,
    layout: &Layout,
    pieces: Vec<Piece>,
    wanted: impl Fn(u64) -> bool,
) -> Result<Corners, InputError> {
    if let Some(mut corners) = swift::read_pieces(&pieces, layout) {
        corners.retain(|one| wanted(one.configuration));
        return Ok(corners);
    }
    let mut rows = Vec::new();
    for Piece { text, passed_over, .. } in pieces {
        rows.extend(rows_of(Table::part(path, text, passed_over, &COLUMNS)?, layout)?);
    }
    rows.retain(|(row, _)| wanted(row.configuration));
    each_once(path, layout, rows)
}

/// The rows of a table and the lines that they stand on.
fn rows_of(mut table: Table, layout: &Layout) -> Result<Vec<(CornerRow, usize)>, InputError> {
    let [configuration, shot, camera, target, tag, corner, u, v] = table.columns(COLUMNS);
    let covariance = table.column("suu").map(|_| table.columns(COVARIANCE));
    let cameras: Vec<&str> = layout.cameras.iter().map(|camera| camera.name.as_str()).collect();
    let targets: Vec<&str> = layout.targets.iter().map(|target| target.name.as_str()).collect();
    let mut rows: Vec<(CornerRow, usize)> = Vec::new();
    while let Some(row) = table.next_row()? {
        let camera = row.one_of(camera, "camera", &cameras)?;
        let target = row.one_of(target, "target", &targets)?;
        if layout.cameras[camera].intrinsics.is_none() {
            return Err(row.complaint(
                format!("camera `{}` has corners but no `intrinsics` in the layout", cameras[camera]),
                "add `intrinsics` to the camera",
            ));
        }
        let (tag, corner) = (row.text(tag)?, row.whole(corner)?);
        let geometry = &layout.targets[target].geometry;
        let feature = feature_of(geometry, tag, corner).filter(|feature| geometry.has(feature)).ok_or_else(|| {
            row.complaint(
                format!("target `{}` has no tag `{tag}` with corner {corner}", targets[target]),
                "check the target's geometry in the layout against the detector's",
            )
        })?;
        let covariance = match covariance {
            Some(columns) if !row.text(columns[0])?.is_empty() => {
                let [suu, suv, svv] = row.numbers(columns)?;
                if suu <= 0.0 || svv <= 0.0 || suu * svv - suv * suv <= 0.0 {
                    return Err(row.complaint(
                        "the covariance is not positive definite",
                        "suu and svv must be positive and suu svv > suv^2",
                    ));
                }
                Some([suu, suv, svv])
            }
            _ => None,
        };
        let pixel = row.numbers([u, v])?;
        let found = CornerRow {
            configuration: row.whole(configuration)?,
            shot: row.whole(shot)?,
            camera,
            target,
            feature,
            pixel,
            covariance,
        };
        rows.push((found, row.line));
    }
    Ok(rows)
}

/// Puts rows into order; two of one corner are a fault.
fn each_once(path: &Path, layout: &Layout, mut rows: Vec<(CornerRow, usize)>) -> Result<Corners, InputError> {
    rows.sort_by(|(a, _), (b, _)| a.key().cmp(&b.key()));
    if let Some(pair) = rows.windows(2).find(|pair| pair[0].0.key() == pair[1].0.key()) {
        let (first, second) = (pair[0].1.min(pair[1].1), pair[0].1.max(pair[1].1));
        return Err(crate::complaint::Complaint::at(
            path,
            second,
            format!("this corner is given twice, first on line {first}"),
            "keep one of the lines",
        )
        .into());
    }
    Ok(Corners::named(Arc::new(Names::of(layout)), rows.iter().map(|(row, _)| row)))
}

pub(super) fn feature_of(geometry: &TargetGeometry, tag: &str, corner: u64) -> Option<Feature> {
    match geometry {
        TargetGeometry::None => None,
        TargetGeometry::Tags(_) => Some(Feature::TagCorner(tag.parse().ok()?, u8::try_from(corner).ok()?)),
        TargetGeometry::Board { .. } => {
            tag.is_empty().then_some(()).and_then(|()| Some(Feature::BoardCorner(u32::try_from(corner).ok()?)))
        }
        TargetGeometry::Points(_) => (corner == 0).then(|| Feature::Point(tag.to_owned())),
    }
}

/// Writes corners in the order given, with four decimals of a pixel (a hundredth of the best detector's noise).
///
/// # Errors
/// When the file cannot be written; an older file then stands untouched.
pub fn write_detections<R: Borrow<CornerRow>>(
    path: &Path,
    layout: &Layout,
    rows: impl IntoIterator<Item = R>,
) -> std::io::Result<()> {
    write_rounded(path, layout, rows, DECIMALS)
}

/// As [`write_detections`], with ten decimals of a pixel: for corners that no detector has seen.
///
/// # Errors
/// As [`write_detections`].
pub fn write_exact_detections<R: Borrow<CornerRow>>(
    path: &Path,
    layout: &Layout,
    rows: impl IntoIterator<Item = R>,
) -> std::io::Result<()> {
    write_rounded(path, layout, rows, 10)
}

/// The lines that [`write_detections`] writes for some corners.
#[must_use]
pub fn detection_lines(layout: &Layout, rows: &[CornerRow]) -> String {
    let mut lines = String::with_capacity(100 * rows.len());
    rows.iter().for_each(|row| push_row(&mut lines, layout, row, DECIMALS));
    lines
}

/// As [`write_detections`], from lines that are there already.
///
/// # Errors
/// As [`write_detections`].
pub fn write_detection_lines<'a>(path: &Path, lines: impl IntoIterator<Item = &'a str>) -> std::io::Result<()> {
    atomic::write(path, |out| {
        write_header(out)?;
        lines.into_iter().try_for_each(|lines| out.write_all(lines.as_bytes()))
    })
}

fn write_header(out: &mut dyn Write) -> std::io::Result<()> {
    writeln!(out, "{},{}", COLUMNS.join(","), COVARIANCE.join(","))
}

fn write_rounded<R: Borrow<CornerRow>>(
    path: &Path,
    layout: &Layout,
    rows: impl IntoIterator<Item = R>,
    decimals: usize,
) -> std::io::Result<()> {
    atomic::write(path, |out| {
        write_header(out)?;
        let mut line = String::new();
        for row in rows {
            line.clear();
            push_row(&mut line, layout, row.borrow(), decimals);
            out.write_all(line.as_bytes())?;
        }
        Ok(())
    })
}

fn push_row(lines: &mut String, layout: &Layout, row: &CornerRow, decimals: usize) {
    let (tag, corner) = match &row.feature {
        Feature::TagCorner(tag, corner) => (tag.to_string(), u32::from(*corner)),
        Feature::BoardCorner(corner) => (String::new(), *corner),
        Feature::Point(name) => (name.clone(), 0),
    };
    let (camera, target) = (&layout.cameras[row.camera].name, &layout.targets[row.target].name);
    let [u, v] = row.pixel;
    // Writing to a string cannot fail.
    let _ = write!(lines, "{},{},{camera},{target},{tag},{corner},", row.configuration, row.shot);
    let _ = write!(lines, "{u:.decimals$},{v:.decimals$},");
    let _ = match row.covariance {
        Some([suu, suv, svv]) => writeln!(lines, "{suu:.4e},{suv:.4e},{svv:.4e}"),
        None => writeln!(lines, ",,"),
    };
}

#[cfg(test)]
mod tests {
    use super::*;
    use sha2::{Digest as _, Sha256};

    const LAYOUT: &str = "
cellmap: 1
units: {length: m, angle: deg}
world: table
cameras:
  left: {intrinsics: {model: pinhole, size: [640, 480], focal: [500, 500], centre: [320, 240]}}
  blind: {pose: {xyz: [0, 0, 0], rpy: [0, 0, 0]}}
targets:
  board: {checkerboard: {corners: [3, 2], square: 0.02}}
  cube: {tags: {dictionary: 4x4_50, grid: {columns: 2, rows: 1, size: 0.05, gap: 0.01, first_id: 7}}}
  tip: {points: {end: [0, 0, 0.1]}}
";

    /// Files that the quick reader takes, and what it must refuse: both readers must agree on all of them.
    #[test]
    fn the_quick_reader_agrees_with_the_careful_one_or_refuses() {
        let layout = crate::layout::parse_layout(Path::new("layout.yaml"), LAYOUT, None).unwrap();
        let header = "configuration,shot,camera,target,tag,corner,u,v,suu,suv,svv";
        let good = [
            "2,0,left,cube,8,3,1.25,-3.5e1,0.1,0.01,0.2",
            "1,0,left,board,,5,10.12345678901234567890,20,,,",
            "1,1,left,tip,end,0,100.0000,200.1234,1.0000e-2,0.0000e0,1.0000e-2",
            "1,0,left,cube,7,0,1,2,,,",
        ];
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("detections.csv");
        let both = |text: String| {
            std::fs::write(&path, &text).unwrap();
            (swift::read(&path, &layout).map(|found| found.0), read_carefully(&path, &layout))
        };
        for end in ["\n", "\r\n"] {
            let (quick, careful) = both(format!("{header}{end}{}{end}", good.join(end)));
            assert_eq!(quick.unwrap(), careful.unwrap());
        }
        let (quick, careful) =
            both("v,u,corner,tag,target,camera,shot,configuration,extra\n2,1,0,7,cube,left,0,1,x".into());
        assert_eq!(quick.unwrap(), careful.unwrap());
        let bad = [
            "1,0,left,board,,6,1,2,,,",
            "1,0,left,board,0,1,1,2,,,",
            "1,0,right,board,,1,1,2,,,",
            "1,0,blind,board,,1,1,2,,,",
            "1,0,left,plate,,1,1,2,,,",
            "1,0,left,cube,9,1,1,2,,,",
            "1,0,left,cube,8,4,1,2,,,",
            "1,0,left,tip,end,1,1,2,,,",
            "-1,0,left,board,,1,1,2,,,",
            "1,0,left,board,,1,nan,2,,,",
            "1,0,left,board,,1,1,inf,,,",
            "1,0,left,board,,1,,2,,,",
            "1,0,left,board,,1,1,2,1,2,1",
            "1,0,left,board,,1,1,2,1,,1",
            "1,0,left,board,,1,1,2",
            "1,0,left,board,,5,1,2,,,",
        ];
        for line in bad {
            let (quick, careful) = both(format!("{header}\n{}\n{line}\n", good.join("\n")));
            assert!(quick.is_none() && careful.is_err(), "{line}");
        }
        // A last line without an end, and empty lines, are nothing unusual.
        let (quick, careful) = both(format!("{header}\n\n{}\r\n\r\n{}\r", good[0], good[1]));
        assert_eq!(quick.unwrap(), careful.unwrap());
        // Unusual but sound: left to the careful reader.
        for line in ["3,0,\"left\",board,,1,1,2,,,", "3,0, left,board,,1,1,2,,,", "+3,0,left,board,,1,1,2,,,"] {
            let (quick, careful) = both(format!("{header}\n{line}\n"));
            assert!(quick.is_none() && careful.is_ok(), "{line}");
        }
    }

    /// Lines in any order, and a picture's lines apart from each other, through windows that end anywhere.
    #[test]
    fn neither_the_order_of_lines_nor_the_window_matters() {
        let layout = crate::layout::parse_layout(Path::new("layout.yaml"), LAYOUT, None).unwrap();
        let mut lines: Vec<String> = Vec::new();
        for configuration in 1..40 {
            let covariance = if configuration % 3 == 0 { "0.25,0,0.5" } else { ",," };
            lines.extend(
                (0..6).map(|i| format!("{configuration},0,left,board,,{i},{i}.5,{configuration},{covariance}")),
            );
            lines.extend((0..4).map(|i| format!("{configuration},0,left,cube,8,{i},{i}.25,{configuration},,,")));
            lines.push(format!("{configuration},1,left,tip,end,0,3,4,,,"));
        }
        let text = |lines: &[String]| {
            format!("configuration,shot,camera,target,tag,corner,u,v,suu,suv,svv\n{}\n", lines.join("\n"))
        };
        let read = |text: &str, window: usize| swift::read_through(window, text.as_bytes(), text.len(), &layout);
        let (straight, _) = read(&text(&lines), 1 << 20).unwrap();
        assert_eq!(straight.len(), lines.len());
        assert_eq!((straight.appearances().len(), straight.covariance(0)), (39 * 3, None));
        assert_eq!(straight.covariance(2 * 11), Some([0.25, 0.0, 0.5]));
        // A stride that is prime to the count visits every line.
        let scattered: Vec<String> = (0..lines.len()).map(|i| lines[i * 31 % lines.len()].clone()).collect();
        for window in [80, 97, 200, 1000, 5000] {
            assert_eq!(read(&text(&lines), window).unwrap().0, straight);
            assert_eq!(read(&text(&scattered), window).unwrap().0, straight);
        }
        assert!(read(&text(&lines), 40).is_none(), "the header is longer than the window");
        lines.push(lines[17].clone());
        assert!(read(&text(&lines), 1000).is_none(), "a corner is given twice");
    }

    #[test]
    fn the_digest_is_of_the_bytes_that_were_read() {
        let layout = crate::layout::parse_layout(Path::new("layout.yaml"), LAYOUT, None).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("detections.csv");
        let text = format!("{}\n1,0,left,board,,1,1,2\n", COLUMNS.join(","));
        std::fs::write(&path, &text).unwrap();
        let (rows, digest) = read_and_digest(&path, &layout).unwrap();
        assert_eq!((rows.len(), digest), (1, Some(Sha256::digest(text.as_bytes()).into())));
        // The careful reader opens the file again: what it read is for others to hash.
        std::fs::write(&path, text.replace("left", "\"left\"")).unwrap();
        assert_eq!(read_and_digest(&path, &layout).unwrap(), (rows, None));
    }

    proptest::proptest! {
        /// A good file with a piece taken out, doubled, put in or cut off: what the quick reader takes, the careful one reads the same.
        #[test]
        fn the_quick_reader_never_takes_what_the_careful_one_reads_otherwise(
            at in 0usize..400, length in 0usize..40, put in "[-0-9a-z,.+\"\r\n \u{feff}]{0,12}", end in 0usize..600, kind in 0..4, window in 64usize..700,
        ) {
            let layout = crate::layout::parse_layout(Path::new("layout.yaml"), LAYOUT, None).unwrap();
            let mut text = "configuration,shot,camera,target,tag,corner,u,v,suu,suv,svv\n\
                2,0,left,cube,8,3,1.25,-3.5e1,0.1,0.01,0.2\n1,0,left,board,,5,10.125,20,,,\n1,1,left,tip,end,0,100.0000,200.1234,1e-2,0.0,1e-2\n\
                1,0,left,cube,7,0,1,2,,,\n3,12,left,cube,7,0,1,2,,,\n3,13,left,board,,0,1.00,2.75,0.25,-0.125,0.5\n".as_bytes().to_vec();
            let at = at.min(text.len());
            let piece = text[at..(at + length).min(text.len())].to_vec();
            match kind {
                0 => drop(text.splice(at..at + piece.len(), put.bytes())),
                1 => drop(text.splice(at..at, piece)),
                2 => drop(text.splice(at..at, put.bytes())),
                _ => text[at..].iter_mut().zip(put.bytes()).for_each(|(byte, put)| *byte ^= put),
            }
            text.truncate(end);
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("detections.csv");
            std::fs::write(&path, &text).unwrap();
            if let Some((corners, digest)) = swift::read_through(window, text.as_slice(), text.len(), &layout) {
                proptest::prop_assert_eq!(corners, read_carefully(&path, &layout).unwrap(), "{}", String::from_utf8_lossy(&text));
                proptest::prop_assert_eq!(digest, <Digest>::from(Sha256::digest(&text)));
            }
        }
    }
}
