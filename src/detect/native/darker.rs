//! What of a row of pixels is dark, a bit a pixel.

use pulp::{Arch, Simd, WithSimd};

/// Pixels of a word.
pub(super) const WORD: usize = 64;

/// Compares pixels with levels by the widest registers that the machine has.
#[derive(Debug, Clone, Copy)]
pub(super) struct Darker(Arch);

impl Darker {
    pub fn new() -> Self {
        Self(Arch::new())
    }

    /// Bits of `words`, from the lowest on, tell whether a pixel is darker than its level; those beyond the last pixel are not set.
    #[inline]
    pub fn compare(self, pixels: &[u8], levels: &[u8], words: &mut [u64]) {
        #[cfg(target_arch = "x86_64")]
        if let Arch::V4(simd) = self.0 {
            return simd.vectorize(InOne { simd, pixels, levels, words });
        }
        self.0.dispatch(InEights { pixels, levels, words });
    }
}

/// On machines whose comparison gives a bit a pixel.
#[cfg(target_arch = "x86_64")]
struct InOne<'a> {
    simd: pulp::x86::V4,
    pixels: &'a [u8],
    levels: &'a [u8],
    words: &'a mut [u64],
}

#[cfg(target_arch = "x86_64")]
impl pulp::NullaryFnOnce for InOne<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { simd, pixels, levels, words } = self;
        let darker =
            |pixels: &[u8; WORD], levels: &[u8; WORD]| simd.cmp_lt_u8x64(pulp::cast(*pixels), pulp::cast(*levels)).0;
        let (whole, rest) = pixels.as_chunks::<WORD>();
        let (whole_levels, rest_levels) = levels.as_chunks::<WORD>();
        for (word, (pixels, levels)) in words.iter_mut().zip(whole.iter().zip(whole_levels)) {
            *word = darker(pixels, levels);
        }
        if let (Some(word), false) = (words.get_mut(whole.len()), rest.is_empty()) {
            // Nothing is darker than 0.
            let (mut pixels, mut levels) = ([0; WORD], [0; WORD]);
            pixels[..rest.len()].copy_from_slice(rest);
            levels[..rest_levels.len()].copy_from_slice(rest_levels);
            *word = darker(&pixels, &levels);
        }
    }
}

/// On all others: a byte a pixel, then eight of them together.
struct InEights<'a> {
    pixels: &'a [u8],
    levels: &'a [u8],
    words: &'a mut [u64],
}

impl WithSimd for InEights<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for (word, (pixels, levels)) in
            self.words.iter_mut().zip(self.pixels.chunks(WORD).zip(self.levels.chunks(WORD)))
        {
            let mut flags = [0u8; WORD];
            for (flag, (pixel, level)) in flags.iter_mut().zip(pixels.iter().zip(levels)) {
                *flag = u8::from(pixel < level);
            }
            // Byte i of an eight, which is 0 or 1, becomes bit i of the highest byte.
            *word = flags.as_chunks::<8>().0.iter().rev().fold(0, |word, eight| {
                (word << 8) | (u64::from_le_bytes(*eight).wrapping_mul(0x0102_0408_1020_4080) >> 56)
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_machine_sees_the_same() {
        let value = |k: usize, salt: usize| ((k * k * 31 + k * 7 + salt) % 251) as u8;
        for width in [1, 7, 8, 63, 64, 65, 130, 192] {
            let pixels: Vec<u8> = (0..width).map(|k| value(k, 3)).collect();
            let levels: Vec<u8> = (0..width).map(|k| value(k, 90)).collect();
            let count = width.div_ceil(WORD);
            let mut expected = vec![0u64; count];
            for k in (0..width).filter(|k| pixels[*k] < levels[*k]) {
                expected[k / WORD] |= 1 << (k % WORD);
            }
            let (mut native, mut plain) = (vec![u64::MAX; count], vec![u64::MAX; count]);
            Darker::new().compare(&pixels, &levels, &mut native);
            Darker(Arch::Scalar).compare(&pixels, &levels, &mut plain);
            assert_eq!((&native, &plain), (&expected, &expected), "{width} pixels");
        }
    }
}
