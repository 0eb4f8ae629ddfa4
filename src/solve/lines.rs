//! Memory in whole lines of the processor's cache: a register that lies in two of them takes twice as long to read or write.

/// Bytes of a line of the processor's cache, which is as much as the largest register holds.
const LINE: usize = 64;

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

/// So many numbers of a buffer, which begin with a whole line; of what is in them only what was there before in the same buffer.
#[inline(always)]
pub(super) fn in_lines(buffer: &mut Vec<f64>, count: usize) -> &mut [f64] {
    buffer.resize(room_in_lines(count), 0.0);
    let start = buffer.as_ptr().align_offset(LINE).min(room_in_lines(0));
    &mut buffer[start..start + count]
}

/// How many numbers the buffer must have room for.
pub(super) const fn room_in_lines(count: usize) -> usize {
    count + LINE / size_of::<f64>()
}
