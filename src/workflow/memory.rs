//! How much memory a solve needs, and what part of a recording fits into less.

use std::collections::BTreeSet;
use std::io::Read;
use std::path::{Path, PathBuf};

use crate::complaint::{Complaint, InputError};
use crate::frames::{FrameTree, Step};
use crate::layout::{Layout, Motion, Robot, plain};
use crate::recording::{CornerIndex, Evenly, Pair};

/// Bytes of the program itself and of what it holds for a moment, before there is any measurement.
const PROGRAM: u64 = 30_000_000;
/// Bytes a corner that a whole solve holds at its peak, the matrices of [`of_configuration`] beside them (`benches/results/memory.md`).
const WHOLE: u64 = 100;
/// Bytes a corner that stay of it while the passes are made.
const KEPT: u64 = 70;
/// Bytes a corner of a chunk that a pass holds at its peak.
const CHUNK: u64 = 320;
/// Bytes a corner that no cell comes to, so that nothing needs to be looked at.
const PLENTY: u64 = 5000;
/// Bytes that each byte of a file becomes which is read in vain.
const IN_VAIN: u64 = 4;
/// Bytes of a configuration's count, and of each robot's values there.
const CONFIGURATION: u64 = 48;
const VALUES: u64 = 130;
/// Bytes of a measured pose, point or contact.
const OTHER: u64 = 500;
/// Square matrices of all unknowns that are held at once.
const MATRICES: u64 = 16;
/// Bytes for what is left of the recording at least, or there is nothing to begin with.
const LEAST: u64 = 16_000_000;
/// Configurations at which whoever sees something is looked at in the part that is solved first, if there are as many.
const SEEN: usize = 20;

/// Whether the corners of these files fit into the memory whatever the cell is.
///
/// # Errors
/// A file that cannot be read.
pub(super) fn is_plenty(memory: u64, files: &[PathBuf]) -> Result<bool, InputError> {
    let mut need = PROGRAM;
    for path in files {
        let (bytes, of_line) = measure(path).map_err(|e| {
            let remedy = "paths are relative to the recording's folder, by default the layout's own";
            Complaint::of(path, format!("the file cannot be read: {}", plain(&e)), remedy)
        })?;
        need += bytes / of_line * PLENTY;
    }
    Ok(need <= memory)
}

/// The bytes of a file, and of one of its lines, judged from the first ones.
fn measure(path: &Path) -> std::io::Result<(u64, u64)> {
    let mut file = std::fs::File::open(path)?;
    let mut first = vec![0; 1 << 16];
    let mut filled = 0;
    while filled < first.len() {
        match file.read(&mut first[filled..])? {
            0 => break,
            more => filled += more,
        }
    }
    let lines = first[..filled].iter().filter(|byte| **byte == b'\n').count();
    Ok((file.metadata()?.len(), (filled / lines.max(1)).max(1) as u64))
}

/// How a recording is shared out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Shares {
    /// One of so many configurations is solved first.
    pub(super) stride: u64,
    /// Which ones, ascending; a few more where something is seen seldom.
    pub(super) first: Vec<u64>,
    /// Corners of a chunk at most.
    pub(super) chunk: usize,
}

/// Shares a recording out so that all that is held at once fits into the memory; none if it fits as it is.
///
/// # Errors
/// Memory that nothing useful fits into.
pub(super) fn shares(
    memory: u64,
    layout: &Layout,
    tree: &FrameTree,
    index: &CornerIndex,
    others: usize,
) -> Result<Option<Shares>, InputError> {
    let unknowns = unknowns(layout, tree);
    let apiece = of_configuration(layout, tree, index, unknowns);
    let need_of = |corners: u64, configurations: usize| corners * WHOLE + configurations as u64 * apiece;
    let fixed = PROGRAM
        + index.configurations.len() as u64 * (CONFIGURATION + VALUES * layout.robots.len() as u64)
        + others as u64 * OTHER
        + index.waste() as u64 * IN_VAIN
        + 8 * MATRICES * unknowns * unknowns;
    let widest = u64::from(index.configurations.values().copied().max().unwrap_or(0));
    let too_little = |need: u64| {
        let what = format!("the recording cannot be solved in {} of memory", words(memory));
        let remedy = format!("give at least `--memory {}`", words(need.div_ceil(1_000_000) * 1_000_000));
        InputError::from(Complaint::of(&layout.file, what, remedy))
    };
    if fixed + need_of(index.corners() as u64, index.configurations.len()) <= memory {
        return Ok(None);
    }
    let few = need_of(2 * SEEN as u64 * widest, 2 * SEEN);
    let need = fixed + LEAST.max(few).max(4 * CHUNK * widest);
    let room = memory.checked_sub(fixed).filter(|_| memory >= need).ok_or_else(|| too_little(need))?;
    let mut stride = 2;
    loop {
        let first = first(index, stride);
        let corners: u64 = first.iter().map(|c| u64::from(index.configurations[c])).sum();
        let need = need_of(corners, first.len());
        // The first solve may take all that is left; what stays of it leaves enough for chunks.
        if need <= room && 2 * KEPT * corners <= room {
            let chunk = ((room - KEPT * corners) / CHUNK) as usize;
            return Ok(Some(Shares { stride, first, chunk }));
        }
        if stride > index.configurations.len() as u64 {
            return Err(too_little(fixed + need.max(2 * KEPT * corners)));
        }
        stride += stride.div_ceil(8);
    }
}

/// Bytes that judging an answer holds of each configuration: a matrix of all that is unknown along its paths, with factors on the distances of what is seen.
fn of_configuration(layout: &Layout, tree: &FrameTree, index: &CornerIndex, unknowns: u64) -> u64 {
    let columns = |&(from, to): &Pair| -> u64 {
        let of_step = |step: &Step| match *step {
            Step::Static { edge, .. } => tree.static_edges[edge].freedom.count(),
            Step::Moving { .. } => 0,
            Step::Robot { robot, .. } => links(&layout.robots[robot]),
        };
        let steps: usize = tree.path(from, to).steps.iter().map(of_step).sum();
        let lens =
            tree.cameras.iter().position(|camera| *camera == from).map(|camera| layout.cameras[camera].refine.len());
        (steps + lens.unwrap_or(0)) as u64
    };
    let times = |seen: &Evenly| seen.count();
    let pairs: u64 = index.seen.values().map(times).sum();
    let touched: u64 = index.seen.iter().map(|(pair, seen)| columns(pair) * times(seen)).sum();
    let all = (index.configurations.len() as u64).max(1);
    let wide = unknowns.min(touched.div_ceil(all)) + 1 + 2 * pairs.div_ceil(all);
    8 * wide * wide
}

/// One of each so many neighbouring configurations, and more of those at which something is seen that is seen seldom. Which one is drawn by lot, always the
/// same way: robots that take turns, or light that changes with the hour, must not meet a regular choice.
fn first(index: &CornerIndex, stride: u64) -> Vec<u64> {
    let all: Vec<u64> = index.configurations.keys().copied().collect();
    let drawn =
        all.chunks(stride as usize).enumerate().map(|(place, some)| some[lot(place as u64) as usize % some.len()]);
    let mut first: BTreeSet<u64> = drawn.collect();
    for seen in index.seen.values().filter(|seen| seen.count() / stride < SEEN as u64) {
        first.extend(seen.some(SEEN));
    }
    first.into_iter().collect()
}

/// A number that looks like chance (SplitMix64; G. Steele, D. Lea, C. Flood, OOPSLA 2014).
fn lot(place: u64) -> u64 {
    let mut z = place.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Shared unknowns at most.
fn unknowns(layout: &Layout, tree: &FrameTree) -> u64 {
    let poses: usize = tree.static_edges.iter().map(|edge| edge.freedom.count()).sum();
    let lenses: usize = layout.cameras.iter().map(|camera| camera.refine.len()).sum();
    let links: usize = layout.robots.iter().map(links).sum();
    (poses + lenses + links) as u64
}

/// Unknown link parameters of a robot.
fn links(robot: &Robot) -> usize {
    match &robot.motion {
        Motion::Joints { chain, .. } => chain.joint_count() * robot.identify.len(),
        Motion::FlangePoses { .. } => 0,
    }
}

/// A size as it is given: `500M`, `1.5G`. In thousands, as the makers of memory count.
///
/// # Errors
/// What is wrong with it, and how to write it.
pub fn bytes(text: &str) -> Result<u64, String> {
    let number = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let times = match text[number.len()..].to_ascii_uppercase().trim_end_matches('B') {
        "K" => 1e3,
        "M" => 1e6,
        "G" => 1e9,
        "T" => 1e12,
        "" => return Err("say of what, such as `500M` or `2G`".to_owned()),
        _ => return Err("the units are K, M, G and T".to_owned()),
    };
    match number.parse::<f64>() {
        Ok(value) if value > 0.0 && value.is_finite() => Ok((value * times) as u64),
        _ => Err("write a number and its unit, such as `500M` or `2G`".to_owned()),
    }
}

/// A size in words that [`bytes`] reads.
#[must_use]
pub fn words(bytes: u64) -> String {
    match bytes {
        b if b.is_multiple_of(1_000_000_000) => format!("{}G", b / 1_000_000_000),
        b if b.is_multiple_of(1_000_000) => format!("{}M", b / 1_000_000),
        b => format!("{}K", b.div_ceil(1000)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read_with_their_unit_and_refused_without() {
        for (text, expected) in
            [("500M", 500_000_000), ("1.5g", 1_500_000_000), ("200MB", 200_000_000), ("64k", 64_000)]
        {
            assert_eq!(bytes(text), Ok(expected), "{text}");
        }
        for text in ["", "500", "M", "-1M", "0M", "2X", "500 M", "infM", "nanG", "1e400M"] {
            assert!(bytes(text).is_err(), "{text}");
        }
        for size in ["500M", "3G", "12K"] {
            assert_eq!(words(bytes(size).unwrap()), size);
        }
    }
}
