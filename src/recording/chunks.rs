//! Reading what some configurations have out of files of corners that are too large to be held.

use rayon::prelude::*;
use sha2::{Digest as _, Sha256};
use std::io::{Read, Seek, SeekFrom};
use std::ops::RangeInclusive;

use super::corners::Corners;
use super::detections::{Piece, read_pieces};
use super::index::{CornerIndex, IndexedFile, MOST_RUNS, SEGMENT, Segment, mark, unreadable};
use crate::complaint::{Complaint, InputError};
use crate::layout::Layout;

/// Which configurations are wanted.
#[derive(Clone, Copy, Debug)]
pub enum Wanted<'a> {
    /// All of them.
    All,
    /// These, ascending.
    These(&'a [u64]),
}

impl Wanted<'_> {
    fn contains(self, configuration: u64) -> bool {
        match self {
            Self::All => true,
            Self::These(these) => these.binary_search(&configuration).is_ok(),
        }
    }

    /// Whether there is one from `start` up to but not including `end`.
    fn meets(self, start: u64, end: u64) -> bool {
        match self {
            Self::All => true,
            Self::These(these) => these.get(these.partition_point(|c| *c < start)).is_some_and(|next| *next < end),
        }
    }
}

/// Two files with one corner.
pub(super) fn twice(layout: &Layout) -> InputError {
    let what = "two files of `observations` hold the same measurement";
    Complaint::of(&layout.file, what, "name every file once, and give repeated measurements different shots").into()
}

impl CornerIndex {
    /// Neighbouring configurations with at most so many corners together, one after the other: every number lies in one of the ranges. A configuration that has
    /// more stands alone.
    #[must_use]
    pub fn chunks(&self, most: usize) -> Vec<RangeInclusive<u64>> {
        let (mut starts, mut corners) = (vec![0], 0);
        for (&configuration, &count) in &self.configurations {
            if corners > 0 && corners + count as usize > most {
                starts.push(configuration);
                corners = 0;
            }
            corners += count as usize;
        }
        let ends = starts.iter().skip(1).map(|start| start - 1).chain([u64::MAX]);
        starts.iter().copied().zip(ends).map(|(start, end)| start..=end).collect()
    }

    /// Bytes that are read in vain at most with every chunk: segments reach over its ends.
    #[must_use]
    pub fn waste(&self) -> usize {
        self.files.iter().map(|file| file.runs.len().min(MOST_RUNS) * 2 * SEGMENT as usize).sum()
    }

    /// The corners of all configurations of a range that are wanted.
    ///
    /// # Errors
    /// A file that is no longer what it was; a corner that is given twice.
    pub fn read_corners(
        &self,
        layout: &Layout,
        range: &RangeInclusive<u64>,
        wanted: Wanted<'_>,
    ) -> Result<Corners, InputError> {
        let here = |configuration: u64| range.contains(&configuration) && wanted.contains(configuration);
        let of_file = |file: &IndexedFile| read_pieces(&file.path, layout, file.pieces(range, wanted)?, here);
        let parts: Result<Vec<Corners>, InputError> = self.files.iter().map(of_file).collect();
        Corners::together(parts?).ok_or_else(|| twice(layout))
    }

    /// The corners of some configurations (ascending), read chunk by chunk.
    ///
    /// # Errors
    /// As [`CornerIndex::read_corners`].
    pub fn read_some(
        &self,
        layout: &Layout,
        chunks: &[RangeInclusive<u64>],
        these: &[u64],
    ) -> Result<Corners, InputError> {
        let parts = chunks.iter().map(|range| self.read_corners(layout, range, Wanted::These(these)));
        let parts: Result<Vec<Corners>, InputError> = parts.collect();
        Corners::together(parts?).ok_or_else(|| twice(layout))
    }
}

impl IndexedFile {
    /// The lines of some configurations, and a few more.
    fn pieces(&self, range: &RangeInclusive<u64>, wanted: Wanted<'_>) -> Result<Vec<Piece>, InputError> {
        let mut pieces = Vec::new();
        for run in &self.runs {
            // The last segment that begins at or before the range, and all that begin within.
            let first = run.partition_point(|segment| segment.configuration <= *range.start()).saturating_sub(1);
            let last = run.partition_point(|segment| segment.configuration <= *range.end());
            let end = |place: usize| run.get(place + 1).map_or(u64::MAX, |next| next.configuration);
            let mut place = first;
            while place < last {
                let start = place;
                while place < last && wanted.meets(run[place].configuration, end(place)) {
                    place += 1;
                }
                if start < place {
                    pieces.push(self.piece(&run[start..place])?);
                }
                place += 1;
            }
        }
        Ok(pieces)
    }

    fn piece(&self, segments: &[Segment]) -> Result<Piece, InputError> {
        let (start, end) = (segments[0].bytes.start, segments[segments.len() - 1].bytes.end);
        let mut text = vec![0; self.header.len() + (end - start) as usize];
        text[..self.header.len()].copy_from_slice(&self.header);
        let lines = &mut text[self.header.len()..];
        let mut file = &self.file;
        let read = file.seek(SeekFrom::Start(start)).and_then(|_| file.read_exact(lines));
        match read {
            Err(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => return Err(self.changed()),
            Err(e) => return Err(unreadable(&self.path, &e)),
            Ok(()) => {}
        }
        let same = segments.par_iter().all(|segment| {
            let bytes = &lines[(segment.bytes.start - start) as usize..(segment.bytes.end - start) as usize];
            mark(Sha256::new_with_prefix(bytes)) == segment.mark
        });
        if same {
            Ok(Piece { text, header: self.header.len(), passed_over: segments[0].lines })
        } else {
            Err(self.changed())
        }
    }

    fn changed(&self) -> InputError {
        let what = "the file was changed while it was being solved from: it is read several times";
        Complaint::of(&self.path, what, "let nothing write to it meanwhile, and solve again").into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layout::parse_layout;
    use crate::recording::{Recording, read_detections};
    use std::path::{Path, PathBuf};

    const LAYOUT: &str = "
cellmap: 1
units: {length: m, angle: deg}
world: table
cameras:
  left: {intrinsics: {model: pinhole, size: [640, 480], focal: [500, 500], centre: [320, 240]}}
  right: {intrinsics: {model: pinhole, size: [640, 480], focal: [500, 500], centre: [320, 240]}}
targets:
  board: {checkerboard: {corners: [4, 3], square: 0.02}}
";
    const HEADER: &str = "configuration,shot,camera,target,tag,corner,u,v";

    fn layout() -> Layout {
        parse_layout(Path::new("layout.yaml"), LAYOUT, None).unwrap()
    }

    /// Lines of two cameras at many configurations; the second misses every third.
    fn lines(configurations: u64) -> Vec<(u64, String)> {
        let mut all = Vec::new();
        for (camera, step) in [("left", 1), ("right", 3)] {
            for configuration in (0..configurations).step_by(step) {
                for corner in 0..12 {
                    let u = (configuration * 7 + corner) % 640;
                    all.push((configuration, format!("{configuration},0,{camera},board,,{corner},{u}.25,{corner}.5")));
                }
            }
        }
        all
    }

    fn write(folder: &Path, lines: &[(u64, String)]) -> PathBuf {
        let path = folder.join("detections.csv");
        let text: Vec<&str> = lines.iter().map(|(_, line)| line.as_str()).collect();
        std::fs::write(&path, format!("{HEADER}\n{}\n", text.join("\n"))).unwrap();
        path
    }

    fn index(path: &Path, layout: &Layout) -> Result<CornerIndex, InputError> {
        CornerIndex::read(&[path.to_owned()], layout, &|one, _| (one.camera, one.target))
    }

    #[test]
    fn the_chunks_of_a_file_are_all_of_it_by_camera_or_by_configuration() {
        let (layout, folder) = (layout(), tempfile::tempdir().unwrap());
        let mut lines = lines(4000);
        for sorted in [false, true] {
            if sorted {
                lines.sort_by_key(|(configuration, _)| *configuration);
            }
            let path = write(folder.path(), &lines);
            let index = index(&path, &layout).unwrap();
            assert_eq!(index.files[0].runs.len(), if sorted { 1 } else { 2 });
            assert!(index.files[0].runs[0].len() > 20, "several segments");
            let whole = read_detections(&path, &layout).unwrap();
            assert_eq!(index.corners(), whole.len());
            assert_eq!(index.digests[&path], Recording::read(&layout, Some(&path)).unwrap().digests[&path]);
            let chunks = index.chunks(5000);
            assert_eq!(chunks.len(), 13);
            let mut all = 0;
            for range in &chunks {
                let rows = index.read_corners(&layout, range, Wanted::All).unwrap();
                assert!(rows.len() <= 5000 && rows.iter().all(|row| range.contains(&row.configuration)));
                let expected = whole.iter().filter(|row| range.contains(&row.configuration));
                assert!(rows.iter().eq(expected));
                all += rows.len();
            }
            assert_eq!(all, whole.len());
            assert_eq!(index.seen[&(1, 0)].count(), 1334);
            let some: Vec<u64> = (0..4000).filter(|configuration| configuration % 100 == 3).collect();
            let found = index.read_some(&layout, &chunks, &some).unwrap();
            assert!(found.iter().eq(whole.iter().filter(|row| row.configuration % 100 == 3)));
        }
    }

    #[test]
    fn faults_name_their_lines_wherever_they_stand() {
        let (layout, folder) = (layout(), tempfile::tempdir().unwrap());
        // Far behind the first block.
        let many = lines(20_000);
        let mut bad = many.clone();
        bad[250_000].1 = "4,0,left,plate,,1,1,2".to_owned();
        let path = write(folder.path(), &bad);
        let told = index(&path, &layout).err().unwrap().to_string();
        assert!(
            told.ends_with(":250002: the layout has no target `plate`; did you mean `board`?")
                || told.contains(":250002: the layout has no target `plate`"),
            "{told}"
        );
        let mut double = many;
        let again = double[250_000].clone();
        double.push(again);
        let path = write(folder.path(), &double);
        let told = index(&path, &layout).unwrap().read_corners(&layout, &(0..=u64::MAX), Wanted::All).unwrap_err();
        let line = double.len() + 1;
        assert!(
            told.to_string().contains(&format!(":{line}: this corner is given twice, first on line 250002")),
            "{told}"
        );
    }

    #[test]
    fn lines_in_no_order_are_refused() {
        let (layout, folder) = (layout(), tempfile::tempdir().unwrap());
        let mut lines = lines(3000);
        lines.sort_by_key(|(configuration, _)| std::cmp::Reverse(*configuration));
        let path = write(folder.path(), &lines);
        let told = index(&path, &layout).err().unwrap().to_string();
        let words = "a smaller one stands after a larger for the 1024th time: the lines are not in order";
        assert!(told.contains(words), "{told}");
        assert!(told.contains("sort -s -t, -k1,1n"), "{told}");
    }

    #[test]
    fn a_file_that_changes_is_noticed() {
        let (layout, folder) = (layout(), tempfile::tempdir().unwrap());
        let lines = lines(2000);
        let path = write(folder.path(), &lines);
        let index = index(&path, &layout).unwrap();
        let read = || index.read_corners(&layout, &(1500..=1600), Wanted::All);
        assert_eq!(read().unwrap().len(), 101 * 12 + 34 * 12);
        // In place, as an editor or a copy over it does: the open file sees it.
        let text = std::fs::read_to_string(&path).unwrap();
        let other = text.replacen("\n1550,0,left,board,,3,", "\n1550,0,left,board,,3,1", 1);
        assert_ne!(text, other);
        std::fs::write(&path, other).unwrap();
        let told = read().unwrap_err().to_string();
        assert!(told.contains("the file was changed while it was being solved from"), "{told}");
        std::fs::write(&path, &text[..1000]).unwrap();
        assert!(read().unwrap_err().to_string().contains("the file was changed"));
    }
}
