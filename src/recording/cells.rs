//! Names and numbers in the cells of a line, read from its bytes where they stand: each reader takes what is left of the line and says how long the cell is.

/// Whether a cell ends at a place.
#[inline]
pub(super) fn ends(rest: &[u8], at: usize) -> bool {
    match rest.get(at) {
        None | Some(b',' | b'\n') => true,
        Some(b'\r') => matches!(rest.get(at + 1), None | Some(b'\n')),
        Some(_) => false,
    }
}

/// The length of a cell that may hold anything.
pub(super) fn cell(rest: &[u8]) -> usize {
    let length = rest.iter().position(|byte| matches!(byte, b',' | b'\n')).unwrap_or(rest.len());
    let at_end_of_line = rest.get(length) != Some(&b',');
    if at_end_of_line && rest[..length].ends_with(b"\r") { length - 1 } else { length }
}

/// The place of the name that a cell holds, most likely the same as before; the cell's length.
#[inline]
pub(super) fn one_of(rest: &[u8], names: &[Option<&[u8]>], likely: usize, place: &mut usize) -> Option<usize> {
    let length = |name: &Option<&[u8]>| {
        let name = (*name)?;
        (rest.starts_with(name) && ends(rest, name.len())).then_some(name.len())
    };
    let found = match names.get(likely).and_then(length) {
        Some(length) => (likely, length),
        None => names.iter().enumerate().find_map(|(place, name)| Some((place, length(name)?)))?,
    };
    *place = found.0;
    Some(found.1)
}

/// A whole number in a cell of its own; its length.
#[inline]
pub(super) fn whole(rest: &[u8], value: &mut u64) -> Option<usize> {
    let (length, found) = digits(rest);
    *value = found;
    (length > 0 && length <= 19 && ends(rest, length)).then_some(length)
}

/// How many digits there are, and their value if they are at most nineteen.
#[inline]
fn digits(rest: &[u8]) -> (usize, u64) {
    let (mut length, mut value) = (0, 0u64);
    while let Some(byte @ b'0'..=b'9') = rest.get(length) {
        value = value.wrapping_mul(10).wrapping_add(u64::from(byte - b'0'));
        length += 1;
    }
    (length, value)
}

/// Powers of ten that are exact in double precision.
const TENS: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20,
    1e21, 1e22,
];

/// Powers of ten that a whole number holds.
const WHOLE_TENS: [u64; 19] = {
    let mut tens = [1; 19];
    let mut i = 1;
    while i < 19 {
        tens[i] = tens[i - 1] * 10;
        i += 1;
    }
    tens
};

/// A finite number in a cell of its own; its length. A mantissa below 2^53 times or over an exact power of ten is one correctly rounded operation
/// (W. D. Clinger, *How to read floating point numbers accurately*, 1990); anything else is left to the standard library.
pub(super) fn number_at(rest: &[u8], value: &mut f64) -> Option<usize> {
    if let Some((length, found)) = decimal(rest)
        && ends(rest, length)
    {
        *value = found;
        return Some(length);
    }
    let text = &rest[..cell(rest)];
    *value = std::str::from_utf8(text).ok()?.parse().ok().filter(|value: &f64| value.is_finite())?;
    Some(text.len())
}

fn decimal(rest: &[u8]) -> Option<(usize, f64)> {
    let negative = rest.first() == Some(&b'-');
    let mut at = usize::from(negative);
    let (before, mut mantissa) = digits(&rest[at..]);
    at += before;
    let (mut seen, mut exponent) = (before, 0);
    if rest.get(at) == Some(&b'.') {
        let (after, fraction) = digits(&rest[at + 1..]);
        at += 1 + after;
        seen += after;
        // Checked below: neither part has more than eighteen digits.
        mantissa = mantissa.wrapping_mul(WHOLE_TENS[after.min(18)]).wrapping_add(fraction);
        exponent = -i32::try_from(after).ok()?;
    }
    if seen == 0 || seen > 18 || mantissa >= 1 << 53 {
        return None;
    }
    if let Some(b'e' | b'E') = rest.get(at) {
        let sign = match rest.get(at + 1) {
            Some(b'-') => -1,
            _ => 1,
        };
        at += 1 + usize::from(matches!(rest.get(at + 1), Some(b'-' | b'+')));
        let (length, power) = digits(&rest[at..]);
        if length == 0 || length > 3 {
            return None;
        }
        at += length;
        exponent += sign * i32::try_from(power).ok()?;
    }
    let scale = *TENS.get(exponent.unsigned_abs() as usize)?;
    let value = if exponent < 0 { mantissa as f64 / scale } else { mantissa as f64 * scale };
    Some((at, if negative { -value } else { value }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A text that must be one number and nothing else.
    fn number(text: &str) -> Option<f64> {
        let mut value = 0.0;
        number_at(text.as_bytes(), &mut value).filter(|length| *length == text.len()).map(|_| value)
    }

    #[test]
    fn what_is_no_number_is_none() {
        for text in
            ["", "-", ".", "e5", "1e", "1e+", "1.2.3", "0x10", "nan", "inf", "1_000", " 1", "1 ", "--1", "1e400"]
        {
            assert_eq!(number(text), None, "{text}");
        }
        for text in ["-1", "+1", "1.5", "", "18446744073709551616", "1\r2", "1 "] {
            assert_eq!(whole(text.as_bytes(), &mut 0), None, "{text}");
        }
    }

    #[test]
    fn a_cell_ends_where_a_comma_or_a_line_does() {
        for rest in ["12", "12,", "12\n", "12\r\n", "12\r", "12,3\r\n"] {
            assert_eq!((whole(rest.as_bytes(), &mut 0), cell(rest.as_bytes())), (Some(2), 2), "{rest:?}");
            assert_eq!(number_at(rest.as_bytes(), &mut 0.0), Some(2), "{rest:?}");
        }
        assert_eq!(cell(b"a\rb,"), 3);
        assert_eq!(cell(b"\r,"), 1);
    }

    proptest! {
        #[test]
        fn numbers_are_the_standard_librarys_to_the_last_bit(value in proptest::num::f64::NORMAL, digits in 0usize..18) {
            for text in [format!("{value:.digits$e}"), format!("{:.digits$}", value % 1e6), format!("{value}")] {
                let expected: f64 = text.parse().unwrap();
                let found = number(&text);
                prop_assert_eq!(found.map(f64::to_bits), Some(expected).filter(|x| x.is_finite()).map(f64::to_bits), "{}", text);
            }
        }

        #[test]
        fn digits_in_any_arrangement_are_the_standard_librarys(text in "-?[0-9]{0,24}\\.?[0-9]{0,24}(e-?[0-9]{1,3})?") {
            let expected = text.parse::<f64>().ok().filter(|x| x.is_finite());
            prop_assert_eq!(number(&text).map(f64::to_bits), expected.map(f64::to_bits), "{}", text);
        }
    }
}
