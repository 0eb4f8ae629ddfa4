//! Where what stands in a file of corners that is too large to be held.
//!
//! Detectors write corners camera by camera, and each camera's by configuration. So a file is a row of *runs*, in each of which configurations
//! ascend: one a camera, or one in all if the file is in order of configurations. One pass over the file finds the runs and cuts them into *segments* of whole
//! configurations; then all that any configurations have is read without reading the rest ([`super::chunks`]). The same pass reads every line with the
//! reader of a whole file, so that a fault is told before anything else is done.

use rayon::prelude::*;
use sha2::{Digest as _, Sha256};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use super::Digest;
use super::corners::Appearance;
use super::detections::{Piece, read_pieces};
use super::evenly::Evenly;
use crate::complaint::{Complaint, InputError};
use crate::geometry::Feature;
use crate::layout::{Layout, plain};

/// Bytes read at once.
pub(super) const BLOCK: usize = 1 << 22;
/// Bytes that a segment has at least, if its run has as many.
pub(super) const SEGMENT: u64 = 1 << 14;
/// Runs of a file at most: each is looked at for every chunk.
pub(super) const MOST_RUNS: usize = 1024;

/// What is to be seen often enough in any part of a recording that is looked at alone: who sees, and what.
pub type Pair = (usize, usize);

/// Some neighbouring lines of a run.
#[derive(Clone, Debug)]
pub(super) struct Segment {
    /// The configuration of its first line; earlier lines of the run belong to smaller ones.
    pub(super) configuration: u64,
    /// Its bytes.
    pub(super) bytes: std::ops::Range<u64>,
    /// Lines before it, the header not counted.
    pub(super) lines: usize,
    /// The beginning of its SHA-256.
    pub(super) mark: u64,
}

/// A file of corners and where what stands in it.
#[derive(Debug)]
pub(super) struct IndexedFile {
    pub(super) path: PathBuf,
    pub(super) file: File,
    /// The first line, its end included.
    pub(super) header: Vec<u8>,
    pub(super) runs: Vec<Vec<Segment>>,
}

/// Files of corners and where what stands in them.
#[derive(Debug, Default)]
pub struct CornerIndex {
    pub(super) files: Vec<IndexedFile>,
    /// Every configuration and how many corners it has.
    pub configurations: BTreeMap<u64, u32>,
    /// Some of the configurations of each pair, spread evenly over all of them.
    pub seen: BTreeMap<Pair, Evenly>,
    /// The SHA-256 of each file.
    pub digests: BTreeMap<PathBuf, Digest>,
}

impl CornerIndex {
    /// Reads files of corners through once; `pair` tells of a corner by whom what was seen.
    ///
    /// # Errors
    /// As [`super::read_detections`], but for a corner that is given twice far apart; lines that are in no order.
    pub fn read(
        paths: &[PathBuf],
        layout: &Layout,
        pair: &(dyn Fn(&Appearance, &Feature) -> Pair + Sync),
    ) -> Result<Self, InputError> {
        let mut index = Self::default();
        for path in paths {
            let file = index.read_file(path, layout, pair)?;
            index.files.push(file);
        }
        Ok(index)
    }

    /// Tells of a measurement that is no corner.
    pub fn note(&mut self, pair: Pair, configuration: u64) {
        self.configurations.entry(configuration).or_default();
        self.seen.entry(pair).or_default().note(configuration);
    }

    /// The corners of all configurations.
    #[must_use]
    pub fn corners(&self) -> usize {
        self.configurations.values().map(|count| *count as usize).sum()
    }

    fn read_file(
        &mut self,
        path: &Path,
        layout: &Layout,
        pair: &(dyn Fn(&Appearance, &Feature) -> Pair + Sync),
    ) -> Result<IndexedFile, InputError> {
        let file = File::open(path).map_err(|e| unreadable(path, &e))?;
        let mut from = Blocks { path, file: &file, rest: Vec::new(), ended: false };
        let mut whole = Sha256::new();
        let mut block = from.next()?;
        let header_end = memchr::memchr(b'\n', &block).map_or(block.len(), |end| end + 1);
        let header: Vec<u8> = block.drain(..header_end).collect();
        whole.update(&header);
        // Faults of the header are told before it is asked which cell holds the configuration.
        let alone = Piece { text: header.clone(), header: header.len(), passed_over: 0 };
        read_pieces(path, layout, vec![alone], |_| true)?;
        let names = String::from_utf8_lossy(&header);
        let mut names = names.trim_start_matches('\u{feff}').split(',');
        let column = names.position(|name| name.trim().trim_matches('"') == "configuration").unwrap_or(0);
        let mut cutter = Cutter::new(path, column, header.len() as u64);
        while !block.is_empty() {
            let text = [&header[..], &block].concat();
            let pieces = vec![Piece { text, header: header.len(), passed_over: cutter.lines }];
            let (corners, cut) = rayon::join(
                || read_pieces(path, layout, pieces, |_| true),
                || {
                    whole.update(&block);
                    cutter.cut(&block, &mut self.configurations)
                },
            );
            let corners = corners?;
            cut?;
            let sights = corners.appearances().par_iter().map(|one| {
                let mut pairs: Vec<Pair> = one.corners().map(|corner| pair(one, corners.feature(corner))).collect();
                pairs.dedup();
                (pairs, one.configuration)
            });
            let sights: Vec<(Vec<Pair>, u64)> = sights.collect();
            for (pairs, configuration) in sights {
                pairs.into_iter().for_each(|pair| self.seen.entry(pair).or_default().note(configuration));
            }
            block = from.next()?;
        }
        self.digests.insert(path.to_owned(), whole.finalize().into());
        let runs = cutter.close(&mut self.configurations);
        Ok(IndexedFile { path: path.to_owned(), file, header, runs })
    }
}

/// A file in blocks of whole lines.
struct Blocks<'a> {
    path: &'a Path,
    file: &'a File,
    rest: Vec<u8>,
    ended: bool,
}

impl Blocks<'_> {
    /// The next block; empty at the end.
    fn next(&mut self) -> Result<Vec<u8>, InputError> {
        let mut block = std::mem::take(&mut self.rest);
        if self.ended {
            return Ok(block);
        }
        let want = (BLOCK - block.len()) as u64;
        let read = self.file.take(want).read_to_end(&mut block).map_err(|e| unreadable(self.path, &e))?;
        self.ended = (read as u64) < want;
        if !self.ended {
            let Some(end) = memchr::memrchr(b'\n', &block) else {
                let what = format!("{BLOCK} bytes follow each other without the end of a line");
                return Err(Complaint::of(
                    self.path,
                    what,
                    "check that the file is a table with one line for each corner",
                )
                .into());
            };
            self.rest = block.split_off(end + 1);
            self.rest.reserve(BLOCK - self.rest.len());
        }
        Ok(block)
    }
}

/// Cuts lines into runs and segments.
struct Cutter<'a> {
    path: &'a Path,
    /// The cell that holds the configuration.
    column: usize,
    runs: Vec<Vec<Segment>>,
    /// The segment that is still growing, and what its bytes were so far.
    open: Option<(Segment, Sha256)>,
    /// Bytes and lines before what comes next.
    at: u64,
    lines: usize,
    /// The configuration of the lines before, and how many of them there are.
    last: Option<(u64, u32)>,
}

impl<'a> Cutter<'a> {
    fn new(path: &'a Path, column: usize, at: u64) -> Self {
        Self { path, column, runs: Vec::new(), open: None, at, lines: 0, last: None }
    }

    /// Cuts a block of whole lines.
    fn cut(&mut self, block: &[u8], counts: &mut BTreeMap<u64, u32>) -> Result<(), InputError> {
        let (mut start, mut hashed) = (0, 0);
        while start < block.len() {
            let end = memchr::memchr(b'\n', &block[start..]).map_or(block.len(), |end| start + end + 1);
            if let Some(configuration) = configuration_of(&block[start..end], self.column) {
                let before = self.last.map(|(before, _)| before);
                let new_run = before.is_none_or(|before| configuration < before);
                let at = self.at + start as u64;
                let full = before.is_none_or(|before| before < configuration)
                    && self.open.as_ref().is_none_or(|(open, _)| at - open.bytes.start >= SEGMENT);
                if new_run || full {
                    self.hash(&block[hashed..start]);
                    hashed = start;
                    self.close_segment(at);
                    if new_run {
                        self.new_run(before, configuration)?;
                    }
                    let segment = Segment { configuration, bytes: at..at, lines: self.lines, mark: 0 };
                    self.open = Some((segment, Sha256::new()));
                }
                self.count(configuration, counts);
            }
            self.lines += 1;
            start = end;
        }
        self.hash(&block[hashed..]);
        self.at += block.len() as u64;
        Ok(())
    }

    fn hash(&mut self, bytes: &[u8]) {
        if let Some((_, hash)) = &mut self.open {
            hash.update(bytes);
        }
    }

    fn close_segment(&mut self, end: u64) {
        if let (Some((mut segment, hash)), Some(run)) = (self.open.take(), self.runs.last_mut()) {
            segment.bytes.end = end;
            segment.mark = mark(hash);
            run.push(segment);
        }
    }

    fn new_run(&mut self, before: Option<u64>, configuration: u64) -> Result<(), InputError> {
        if self.runs.len() == MOST_RUNS {
            let line = self.lines + 2;
            let what = format!(
                "configuration {configuration} stands after {}, and a smaller one stands after a larger for the {MOST_RUNS}th time: the lines are not in \
                 order of configurations, neither as a whole nor camera by camera, so that the file cannot be read in pieces",
                before.unwrap_or(0)
            );
            let key = self.column + 1;
            let remedy = format!(
                "sort it by configuration, `(head -n 1 IN.csv; tail -n +2 IN.csv | sort -s -t, -k{key},{key}n) > OUT.csv`, or give more `--memory`"
            );
            return Err(Complaint::at(self.path, line, what, remedy).into());
        }
        self.runs.push(Vec::new());
        Ok(())
    }

    fn count(&mut self, configuration: u64, counts: &mut BTreeMap<u64, u32>) {
        match &mut self.last {
            Some((last, count)) if *last == configuration => *count += 1,
            last => {
                let done = last.replace((configuration, 1));
                add(done, counts);
            }
        }
    }

    fn close(mut self, counts: &mut BTreeMap<u64, u32>) -> Vec<Vec<Segment>> {
        self.close_segment(self.at);
        add(self.last, counts);
        self.runs
    }
}

fn add(counted: Option<(u64, u32)>, counts: &mut BTreeMap<u64, u32>) {
    if let Some((configuration, count)) = counted {
        *counts.entry(configuration).or_default() += count;
    }
}

/// Eight bytes of a hash: what a file that is changed by mistake does not keep.
pub(super) fn mark(hash: Sha256) -> u64 {
    hash.finalize().iter().take(8).fold(0, |mark, byte| mark << 8 | u64::from(*byte))
}

/// The number in a cell of a line that the reader has taken; none for an empty line.
fn configuration_of(line: &[u8], column: usize) -> Option<u64> {
    let text = if line.contains(&b'"') {
        let mut reader = csv::ReaderBuilder::new().has_headers(false).from_reader(line);
        let record = reader.byte_records().next()?.ok()?;
        record.get(column)?.to_vec()
    } else {
        line.split(|byte| *byte == b',').nth(column)?.to_vec()
    };
    std::str::from_utf8(&text).ok()?.trim().parse().ok()
}

pub(super) fn unreadable(path: &Path, error: &std::io::Error) -> InputError {
    let remedy = "paths are relative to the recording's folder, by default the layout's own";
    Complaint::of(path, format!("the file cannot be read: {}", plain(error)), remedy).into()
}
