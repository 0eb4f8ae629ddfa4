//! Numbers with a few decimals, as the standard formats write them but several times faster: a recording has millions.
//!
//! A number is scaled to a whole one by a power of ten that is exact, so that the product is wrong by half a unit of its last place at most. Where that could
//! change how it is rounded, and wherever else anything is unusual, the standard format has the word.

use std::fmt::Write;

/// How near a scaled number may lie to where it would be rounded the other way.
const UNDECIDED: f64 = 1e-3;
/// Scaled numbers from here on are not exact enough.
const LARGEST: f64 = 1e11;

/// Powers of ten up to the last one that is exact.
const POWERS: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20,
    1e21, 1e22,
];

/// As `{:.decimals$}`.
pub(super) fn push_fixed(text: &mut String, value: f64, decimals: usize) {
    match POWERS.get(decimals).and_then(|power| rounded(value.abs() * power)) {
        // Zero may be a negative one.
        Some(whole) if whole > 0 => {
            if value < 0.0 {
                text.push('-');
            }
            let one = 10_u64.pow(decimals as u32);
            push_whole(text, whole / one, 1);
            if decimals > 0 {
                text.push('.');
                push_whole(text, whole % one, decimals);
            }
        }
        _ => {
            let _ = write!(text, "{value:.decimals$}");
        }
    }
}

/// As `{:.4e}`.
pub(super) fn push_scientific(text: &mut String, value: f64) {
    // From the power of two: a whole number that is right or one too small.
    let two = (value.to_bits() >> 52 & 0x7ff) as i32 - 1023;
    let least = (two * 1233) >> 12;
    let scaled = |exponent: i32| POWERS.get((4 - exponent) as usize).map_or(f64::NAN, |power| value.abs() * power);
    let exponent = if scaled(least) < 100_000.0 { least } else { least + 1 };
    let scaled = scaled(exponent);
    match rounded(scaled) {
        Some(whole) if (10_000..100_000).contains(&whole) && scaled >= 10_000.0 => {
            if value < 0.0 {
                text.push('-');
            }
            push_whole(text, whole / 10_000, 1);
            text.push('.');
            push_whole(text, whole % 10_000, 4);
            text.push('e');
            if exponent < 0 {
                text.push('-');
            }
            push_whole(text, u64::from(exponent.unsigned_abs()), 1);
        }
        _ => {
            let _ = write!(text, "{value:.4e}");
        }
    }
}

/// The whole number next to a positive one, if there is no doubt which it is.
fn rounded(value: f64) -> Option<u64> {
    // Conversion to integers cuts towards zero and saturates.
    let whole = value as u64;
    let part = value - whole as f64;
    let sure = value < LARGEST && (part - 0.5).abs() > UNDECIDED;
    sure.then(|| whole + u64::from(part > 0.5))
}

/// A whole number with at least so many digits, which are 20 at most.
pub(super) fn push_whole(text: &mut String, mut value: u64, digits: usize) {
    let mut places = [b'0'; 20];
    let mut first = places.len();
    while value > 0 {
        first -= 1;
        places[first] = b'0' + (value % 10) as u8;
        value /= 10;
    }
    let first = first.min(places.len() - digits.min(places.len()));
    text.extend(places[first..].iter().map(|digit| char::from(*digit)));
}

#[cfg(test)]
mod tests {
    use super::{push_fixed, push_scientific, push_whole};

    fn same(value: f64) {
        let mut text = String::new();
        for decimals in [0, 1, 4, 10] {
            push_fixed(&mut text, value, decimals);
            assert_eq!(text, format!("{value:.decimals$}"));
            text.clear();
        }
        push_scientific(&mut text, value);
        assert_eq!(text, format!("{value:.4e}"));
    }

    #[test]
    fn unusual_numbers_are_written_as_ever() {
        for value in
            [0.0, -0.0, f64::NAN, f64::INFINITY, 1e300, 5e-324, 0.5, 1.5, 2.5, 0.00005, 1.00005, 12345.00005, 0.1]
        {
            same(value);
            same(-value);
        }
        for k in -30..30 {
            let power = 10_f64.powi(k);
            for value in [power, power.next_up(), power.next_down(), 9.99995 * power, 9.999949 * power, 1.00005 * power]
            {
                same(value);
            }
        }
        let mut text = String::new();
        for value in [0, 7, 1234, u64::MAX] {
            push_whole(&mut text, value, 3);
            assert_eq!(text, format!("{value:03}"));
            text.clear();
        }
    }

    proptest::proptest! {
        #[test]
        fn any_number_is_written_as_ever(bits: u64, pixel in -1e4..1e4, exponent in -25.0..8.0_f64, tie in 0_u32..40_000_000) {
            same(f64::from_bits(bits));
            same(pixel);
            same(10_f64.powf(exponent));
            // Many of them lie exactly half-way.
            same(f64::from(tie) / 32768.0);
        }
    }
}
