//! A quick way to read `detections.csv` as detectors write it: all cores, no quoting, no complaints.
//!
//! Whatever is out of the ordinary (quotes, spaces, unknown names, numbers that are none, a corner given twice) makes it give up, and the
//! careful reader of [`super::detections`] says what is wrong and where.

use rayon::prelude::*;

use super::detections::{COLUMNS, COVARIANCE, CornerRow, feature_of};
use crate::layout::Layout;

/// Bytes that one task parses.
const PIECE: usize = 1 << 18;

/// Cells of a line at most.
const MOST_CELLS: usize = 16;

/// The rows of a file in the order of [`CornerRow::key`]; none if there is anything unusual about it.
pub(super) fn read(bytes: &[u8], layout: &Layout) -> Option<Vec<CornerRow>> {
    let (header, body) = bytes.split_at(bytes.iter().position(|byte| *byte == b'\n')? + 1);
    let names: Vec<&str> = std::str::from_utf8(header).ok()?.trim_end_matches(['\r', '\n']).split(',').collect();
    if names.len() > MOST_CELLS {
        return None;
    }
    let place = |wanted: &str| {
        let mut found = names.iter().enumerate().filter(|(_, name)| **name == wanted);
        let first = found.next()?.0;
        found.next().is_none().then_some(first)
    };
    let mut places = [0; COLUMNS.len()];
    for (place_of, name) in places.iter_mut().zip(COLUMNS) {
        *place_of = place(name)?;
    }
    let covariance = match COVARIANCE.map(place) {
        [Some(suu), Some(suv), Some(svv)] => Some([suu, suv, svv]),
        [None, None, None] => None,
        _ => return None,
    };
    let reader = Reader { layout, cells: names.len(), places, covariance };
    let mut pieces = Vec::with_capacity(body.len() / PIECE + 1);
    let mut rest = body;
    while !rest.is_empty() {
        let reach = rest.len().min(PIECE);
        let end = rest[reach..].iter().position(|byte| *byte == b'\n').map_or(rest.len(), |at| reach + at + 1);
        let (piece, after) = rest.split_at(end);
        pieces.push(piece);
        rest = after;
    }
    let parsed: Vec<Vec<CornerRow>> = pieces.par_iter().map(|piece| reader.piece(piece)).collect::<Option<_>>()?;
    let mut rows = Vec::with_capacity(parsed.iter().map(Vec::len).sum());
    parsed.into_iter().for_each(|part| rows.extend(part));
    if !ascending(&rows) {
        rows.sort_by(|a, b| a.key().cmp(&b.key()));
        if !ascending(&rows) {
            return None;
        }
    }
    Some(rows)
}

/// Whether the rows are in order and no two are of the same corner.
fn ascending(rows: &[CornerRow]) -> bool {
    rows.par_windows(2).all(|pair| pair[0].key() < pair[1].key())
}

/// What lines are read with.
struct Reader<'a> {
    layout: &'a Layout,
    /// Cells of a line.
    cells: usize,
    /// The cell of each of [`COLUMNS`].
    places: [usize; COLUMNS.len()],
    covariance: Option<[usize; 3]>,
}

impl Reader<'_> {
    fn piece(&self, bytes: &[u8]) -> Option<Vec<CornerRow>> {
        let mut rows = Vec::with_capacity(bytes.len() / 40);
        let mut last = (0, 0);
        for line in bytes.split(|byte| *byte == b'\n') {
            let line = line.strip_suffix(b"\r").unwrap_or(line);
            if !line.is_empty() {
                let row = self.row(line, last)?;
                last = (row.camera, row.target);
                rows.push(row);
            }
        }
        Some(rows)
    }

    /// One line; `last` are the camera and target of the one before, which are most likely the same.
    fn row(&self, line: &[u8], last: (usize, usize)) -> Option<CornerRow> {
        let mut cells: [&[u8]; MOST_CELLS] = [&[]; MOST_CELLS];
        let mut count = 0;
        for cell in line.split(|byte| *byte == b',') {
            *cells.get_mut(count)? = cell;
            count += 1;
        }
        if count != self.cells {
            return None;
        }
        let [configuration, shot, camera, target, tag, corner, u, v] = self.places.map(|place| cells[place]);
        let camera = one_of(camera, last.0, self.layout.cameras.len(), |i| &self.layout.cameras[i].name)?;
        let target = one_of(target, last.1, self.layout.targets.len(), |i| &self.layout.targets[i].name)?;
        self.layout.cameras[camera].intrinsics.as_ref()?;
        let geometry = &self.layout.targets[target].geometry;
        let tag = std::str::from_utf8(tag).ok().filter(|tag| plain(tag))?;
        let feature = feature_of(geometry, tag, whole(corner)?).filter(|feature| geometry.has(feature))?;
        let covariance = match self.covariance.map(|places| places.map(|place| cells[place])) {
            None | Some([b"", b"", b""]) => None,
            Some(texts) => {
                let [suu, suv, svv] = [number(texts[0])?, number(texts[1])?, number(texts[2])?];
                // The careful reader's own conditions.
                (suu > 0.0 && svv > 0.0 && suu * svv - suv * suv > 0.0).then_some(Some([suu, suv, svv]))?
            }
        };
        Some(CornerRow {
            configuration: whole(configuration)?,
            shot: whole(shot)?,
            camera,
            target,
            feature,
            pixel: [number(u)?, number(v)?],
            covariance,
        })
    }
}

/// Text that means itself in a CSV file: no quotes, nothing to trim.
fn plain(text: &str) -> bool {
    text.trim() == text && !text.contains(['"', '\r'])
}

fn one_of<'a>(text: &[u8], likely: usize, count: usize, name: impl Fn(usize) -> &'a String) -> Option<usize> {
    let is = |i: &usize| name(*i).as_bytes() == text && plain(name(*i));
    Some(likely).filter(|i| *i < count).filter(is).or_else(|| (0..count).find(is))
}

fn whole(text: &[u8]) -> Option<u64> {
    if text.is_empty() || text.len() > 19 {
        return None;
    }
    text.iter().try_fold(0u64, |value, byte| byte.is_ascii_digit().then(|| value * 10 + u64::from(byte - b'0')))
}

/// Powers of ten that are exact in double precision.
const TENS: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20,
    1e21, 1e22,
];

/// A finite number. A mantissa below 2^53 times or over an exact power of ten is one correctly rounded operation (W. D. Clinger, *How to read
/// floating point numbers accurately*, 1990); anything else is left to the standard library.
fn number(text: &[u8]) -> Option<f64> {
    decimal(text).or_else(|| std::str::from_utf8(text).ok()?.parse().ok().filter(|value: &f64| value.is_finite()))
}

fn decimal(text: &[u8]) -> Option<f64> {
    let (negative, digits) = match text {
        [b'-', rest @ ..] => (true, rest),
        _ => (false, text),
    };
    let (mut mantissa, mut exponent, mut seen, mut point) = (0u64, 0i32, 0, false);
    let mut at = 0;
    while let Some(byte) = digits.get(at) {
        match byte {
            b'0'..=b'9' => {
                seen += 1;
                if seen > 18 {
                    return None;
                }
                mantissa = mantissa * 10 + u64::from(byte - b'0');
                exponent -= i32::from(point);
            }
            b'.' if !point => point = true,
            _ => break,
        }
        at += 1;
    }
    if seen == 0 || mantissa >= 1 << 53 {
        return None;
    }
    match digits.get(at) {
        None => {}
        Some(b'e' | b'E') => {
            let (sign, power) = match &digits[at + 1..] {
                [b'-', rest @ ..] => (-1, rest),
                [b'+', rest @ ..] | rest => (1, rest),
            };
            if power.len() > 3 {
                return None;
            }
            exponent += sign * i32::try_from(whole(power)?).ok()?;
        }
        Some(_) => return None,
    }
    let scale = *TENS.get(exponent.unsigned_abs() as usize)?;
    let value = if exponent < 0 { mantissa as f64 / scale } else { mantissa as f64 * scale };
    Some(if negative { -value } else { value })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn what_is_no_number_is_none() {
        for text in
            ["", "-", ".", "e5", "1e", "1e+", "1.2.3", "0x10", "nan", "inf", "1_000", " 1", "1 ", "--1", "1e400"]
        {
            assert_eq!(number(text.as_bytes()), None, "{text}");
        }
        for text in ["-1", "+1", "1.5", "", "18446744073709551616"] {
            assert_eq!(whole(text.as_bytes()), None, "{text}");
        }
    }

    proptest! {
        #[test]
        fn numbers_are_the_standard_librarys_to_the_last_bit(value in proptest::num::f64::NORMAL, digits in 0usize..18) {
            for text in [format!("{value:.digits$e}"), format!("{:.digits$}", value % 1e6), format!("{value}")] {
                let expected: f64 = text.parse().unwrap();
                let found = number(text.as_bytes());
                prop_assert_eq!(found.map(f64::to_bits), Some(expected).filter(|x| x.is_finite()).map(f64::to_bits), "{}", text);
            }
        }
    }
}
