//! The journal of a detection run: a line a picture, so that a run that was stopped or killed is gone on with and nothing is looked at twice.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Lines are written together when so much time has passed: no more work is lost where the machine loses its power.
const BETWEEN: Duration = Duration::from_millis(500);

/// What is known of a picture that was looked at: its line in the journal.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Done {
    pub camera: usize,
    pub configuration: u64,
    pub shot: u64,
    /// Size and modification time: a picture that was taken anew is looked at anew.
    pub stamp: (u64, u64),
    /// Tags found (a board counts once).
    pub tags: usize,
    pub corners: usize,
    /// Targets of which something was found.
    pub targets: Vec<usize>,
    /// The corners as lines of `detections.csv`.
    pub lines: String,
    pub failure: Option<String>,
}

/// Camera, configuration and shot of a picture.
pub(super) type Key = (usize, u64, u64);

impl Done {
    pub fn key(&self) -> Key {
        (self.camera, self.configuration, self.shot)
    }
}

/// Where an unfinished run keeps what it has done.
pub(super) fn journal_path(out: &Path) -> PathBuf {
    let mut name = out.file_name().unwrap_or_default().to_owned();
    name.push(".unfinished");
    out.with_file_name(name)
}

/// What an earlier run has done, if it was the same but for its end.
pub(super) fn read_journal(path: &Path, fingerprint: &str) -> BTreeMap<Key, Done> {
    let Ok(text) = std::fs::read_to_string(path) else { return BTreeMap::new() };
    let mut lines = text.lines();
    if lines.next() != Some(fingerprint) {
        return BTreeMap::new();
    }
    // A line that was being written when the run was killed is no JSON and is done again.
    lines.filter_map(|line| serde_json::from_str::<Done>(line).ok()).map(|done| (done.key(), done)).collect()
}

/// The journal of a run that is under way.
pub(super) struct Journal {
    path: PathBuf,
    file: std::fs::File,
    /// Lines that are not yet written, and when some were last.
    waiting: String,
    written: Instant,
}

impl Journal {
    /// Begins one, or goes on with one of which something is `known`.
    pub fn open(path: &Path, fingerprint: &str, known: &BTreeMap<Key, Done>) -> std::io::Result<Self> {
        if let Some(folder) = path.parent().filter(|p| !p.as_os_str().is_empty()) {
            std::fs::create_dir_all(folder)?;
        }
        let file = if known.is_empty() {
            let mut file = std::fs::File::create(path)?;
            writeln!(file, "{fingerprint}")?;
            file
        } else {
            let mut file = std::fs::OpenOptions::new().append(true).open(path)?;
            // Ends a line that was cut short.
            writeln!(file)?;
            file
        };
        Ok(Self { path: path.to_owned(), file, waiting: String::new(), written: Instant::now() })
    }

    /// Adds a picture's line, in any order.
    pub fn append(&mut self, line: &str) -> std::io::Result<()> {
        self.waiting.push_str(line);
        self.waiting.push('\n');
        if self.written.elapsed() < BETWEEN { Ok(()) } else { self.write() }
    }

    /// Writes what waits.
    pub fn write(&mut self) -> std::io::Result<()> {
        self.file.write_all(self.waiting.as_bytes())?;
        self.waiting.clear();
        self.written = Instant::now();
        Ok(())
    }

    /// The run is complete. A journal that cannot be removed does no harm: it agrees with the result.
    pub fn remove(self) {
        let _ = std::fs::remove_file(&self.path);
    }
}
