//! Memory in whole lines of the processor's cache: a register that lies in two of them takes twice as long to read or write.

/// Bytes of a line of the processor's cache, which is as much as the largest register holds.
const LINE: usize = 64;
/// Numbers that may have to be passed over to come to the next line.
const SPARE: usize = LINE / size_of::<f64>();

/// Lets the frame of the calling function begin with a whole line, so that each register which has to wait on the stack waits in one line. The compiler
/// aligns a frame only for something that needs it from the start, not for registers; without this a kernel takes a fifth longer or not depending on how deep in
/// the stack it is called.
#[inline(always)]
pub(super) fn align_frame() {
    #[repr(align(64))]
    struct Line(u8);
    let mut line = Line(0);
    std::hint::black_box(&mut line.0);
}

/// So many numbers of a buffer, the first at the beginning of a line. They are zero if the buffer was empty, and otherwise whatever was left in it.
#[inline(always)]
pub(super) fn in_lines(buffer: &mut Vec<f64>, count: usize) -> &mut [f64] {
    buffer.resize(room_in_lines(count), 0.0);
    let start = buffer.as_ptr().align_offset(LINE).min(SPARE);
    &mut buffer[start..start + count]
}

/// How many numbers the buffer of [`in_lines`] must have room for.
pub(super) const fn room_in_lines(count: usize) -> usize {
    count + SPARE
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_begin_with_a_line_wherever_the_buffer_is() {
        for count in [0, 1, 12, 1000] {
            // Buffers of all sizes lie at all kinds of addresses.
            let mut buffers: Vec<Vec<f64>> = (1..40).map(|size| Vec::with_capacity(size * 3)).collect();
            for buffer in &mut buffers {
                let numbers = in_lines(buffer, count);
                assert_eq!((numbers.len(), numbers.as_ptr().addr() % LINE), (count, 0));
                assert!(numbers.iter().all(|number| *number == 0.0));
            }
        }
    }

    #[test]
    fn a_buffer_with_room_stays_where_it_is() {
        let mut buffer = Vec::with_capacity(room_in_lines(100));
        let before = buffer.as_ptr();
        in_lines(&mut buffer, 100);
        assert_eq!(buffer.as_ptr(), before);
    }
}
