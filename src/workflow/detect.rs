//! `detect`: from pictures to corners, in parallel, resumable, in bounded memory.

use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use super::check::check_pictures;
use super::dictionary::wrong_dictionary;
use super::look::{Done, JournalCorner, Looking, stamp, whole_groups};
use super::predict::Prediction;
use crate::complaint::{Complaint, InputError};
use crate::detect::{Detector, Lens, Pattern};
use crate::geometry::{Feature, Intrinsics};
use crate::layout::Layout;
use crate::layout::images::PictureFile;
use crate::recording::{CornerRow, Recording, write_detections};
use crate::trust::Fault;

/// Pictures that are looked at, at least, before the journal is written again.
const TOGETHER: usize = 40;
/// Seconds that pass from one entry in the journal to the next if pictures are quick: at each a thread may wait for the last picture of another.
const BETWEEN: f64 = 0.5;

/// A picture that gave nothing because it could not be used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failure {
    /// Where it is.
    pub picture: PathBuf,
    /// Why.
    pub reason: String,
}

/// What a detection run found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Detected {
    /// Pictures looked at, failed ones included.
    pub pictures: usize,
    /// Pictures in which something was found.
    pub pictures_with_detections: usize,
    /// Tags found (a board counts once a picture).
    pub tags: usize,
    /// Corners found.
    pub corners: usize,
    /// The detector's name.
    pub detector: String,
    /// Wall time of this run, seconds.
    pub seconds: f64,
    /// Pictures that an interrupted run had done already.
    pub resumed: usize,
    /// Pictures that could not be used.
    pub failed: Vec<Failure>,
    /// What is wrong with the description of the targets, as far as pictures show it.
    pub faults: Vec<Fault>,
    /// Whether the run was stopped before the end; the journal then keeps what is done.
    pub interrupted: bool,
}

/// What the caller sees of progress, and how it says stop.
pub struct Watch<'a> {
    /// Called with (pictures done, pictures in all).
    pub progress: &'a (dyn Fn(usize, usize) + Sync),
    /// Set it to stop after the pictures in hand.
    pub stop: &'a AtomicBool,
    /// A folder for the pictures with what was found drawn into them. All are looked at anew then.
    pub draw: Option<&'a Path>,
    /// A solution that says where tags must be.
    pub predict: Option<&'a Path>,
    /// Search every picture, even one that shows the same as the first of its configuration.
    pub search_all: bool,
}

impl std::fmt::Debug for Watch<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Watch").field("stop", self.stop).finish_non_exhaustive()
    }
}

/// Detects all targets in all pictures of a layout and writes the corners to `out`.
///
/// # Errors
/// Faults of the recording; no pictures; no picture that could be used; a file that cannot be written.
pub fn detect(layout: &Layout, detector: &dyn Detector, out: &Path, watch: &Watch<'_>) -> Result<Detected, InputError> {
    let began = Instant::now();
    let recording = Recording::read_motion(layout)?;
    let pictures = check_pictures(layout, &recording)?;
    let work: Vec<(usize, &PictureFile)> =
        pictures.iter().enumerate().flat_map(|(camera, files)| files.iter().map(move |file| (camera, file))).collect();
    if work.is_empty() {
        return Err(no_pictures(layout).into());
    }
    let (wanted, targets) = wanted(layout)?;
    let prediction = watch.predict.map(|solution| Prediction::read(solution, layout)).transpose()?;
    let journal_path = journal_path(out);
    let fingerprint = fingerprint(layout, detector.name(), &wanted, watch);
    let mut known = read_journal(&journal_path, &fingerprint);
    let fail = |e: std::io::Error| cannot_write(out, &e);
    let mut journal = Journal::open(&journal_path, &fingerprint, &known).map_err(fail)?;
    let mut done: Vec<Done> = Vec::with_capacity(work.len());
    let mut result = Detected { detector: detector.name().to_owned(), ..Detected::default() };
    let looking = Looking {
        layout,
        detector,
        wanted: &wanted,
        prediction: prediction.as_ref(),
        draw: watch.draw,
        search_all: watch.search_all,
    };
    (watch.progress)(0, work.len());
    let (mut rest, mut together) = (&work[..], TOGETHER);
    while !rest.is_empty() {
        if watch.stop.load(Ordering::Relaxed) {
            result.interrupted = true;
            result.pictures = done.len();
            result.seconds = began.elapsed().as_secs_f64();
            return Ok(result);
        }
        let (chunk, later) = rest.split_at(whole_groups(rest, together));
        rest = later;
        let (known, clock) = (&mut known, Instant::now());
        let (old, new): (Vec<_>, Vec<_>) = chunk.iter().partition(|(camera, file)| {
            watch.draw.is_none()
                && known
                    .get(&(*camera, file.configuration, file.shot))
                    .is_some_and(|done| done.stamp == stamp(&file.path))
        });
        result.resumed += old.len();
        done.extend(old.iter().filter_map(|(camera, file)| known.remove(&(*camera, file.configuration, file.shot))));
        let fresh = looking.at(&new, &work);
        journal.append(&fresh).map_err(fail)?;
        done.extend(fresh);
        let quick = new.len() as f64 * BETWEEN / clock.elapsed().as_secs_f64().max(1e-3);
        together = (quick as usize).clamp(TOGETHER, 25 * TOGETHER);
        (watch.progress)(done.len(), work.len());
    }
    let mut rows = Vec::new();
    for one in &done {
        result.pictures += 1;
        if let Some(reason) = &one.failure {
            let file = pictures[one.camera].iter().find(|f| (f.configuration, f.shot) == (one.configuration, one.shot));
            let picture = file.map(|file| file.path.clone()).unwrap_or_default();
            result.failed.push(Failure { picture, reason: reason.clone() });
        }
        result.pictures_with_detections += usize::from(!one.corners.is_empty());
        let mut seen: Vec<(usize, Option<u32>)> = one.corners.iter().map(|c| (c.0, c.1)).collect();
        seen.dedup();
        result.tags += seen.len();
        rows.extend(one.corners.iter().map(|corner| row(one, &targets, corner)));
    }
    result.corners = rows.len();
    if result.failed.len() == result.pictures {
        let first = &result.failed[0];
        return Err(Complaint::of(
            &first.picture,
            format!("none of the {} pictures could be used; the first: {}", result.pictures, first.reason),
            "check the pictures against `images` and the `size` of the intrinsics",
        )
        .into());
    }
    let missing: Vec<usize> =
        targets.iter().copied().filter(|target| !rows.iter().any(|row| row.target == *target)).collect();
    if !missing.is_empty() {
        result.faults.extend(wrong_dictionary(layout, detector, &work, &missing));
    }
    rows.sort_by(|a, b| a.key().cmp(&b.key()));
    write_detections(out, layout, &rows).map_err(fail)?;
    journal.remove();
    result.seconds = began.elapsed().as_secs_f64();
    Ok(result)
}

fn row(one: &Done, targets: &[usize], corner: &JournalCorner) -> CornerRow {
    let (pattern, tag, index, pixel, covariance) = *corner;
    CornerRow {
        configuration: one.configuration,
        shot: one.shot,
        camera: one.camera,
        target: targets[pattern],
        feature: match tag {
            Some(tag) => Feature::TagCorner(tag, index as u8),
            None => Feature::BoardCorner(index),
        },
        pixel,
        covariance,
    }
}

/// What is looked for, and the target behind each pattern.
fn wanted(layout: &Layout) -> Result<(Vec<Pattern>, Vec<usize>), InputError> {
    let targets = layout.targets.iter().enumerate();
    let found: Vec<(Pattern, usize)> = targets.filter_map(|(i, t)| Some((t.pattern.clone()?, i))).collect();
    if found.is_empty() {
        return Err(Complaint::of(
            &layout.file,
            "no target can be looked for in pictures",
            "give a target `tags`, `checkerboard`, `charuco` or `april_grid`",
        )
        .into());
    }
    Ok(found.into_iter().unzip())
}

fn no_pictures(layout: &Layout) -> Complaint {
    match layout.cameras.iter().find_map(|camera| Some((camera, camera.images.as_ref()?))) {
        Some((camera, images)) => Complaint::at(
            &layout.file,
            camera.line,
            format!(
                "no picture was found; camera `{}` looks for `{images}` in `{}`",
                camera.name,
                layout.recording.display()
            ),
            "check the pattern, or say where the recording is with `--recording DIR`",
        ),
        None => Complaint::of(
            &layout.file,
            "no camera has `images`",
            "add `images: folder/{configuration:04}.png` to a camera",
        ),
    }
}

fn cannot_write(path: &Path, error: &std::io::Error) -> InputError {
    Complaint::of(path, format!("the file cannot be written: {error}"), "say where else with `--out FILE`").into()
}

/// Where an unfinished run keeps what it has done.
fn journal_path(out: &Path) -> PathBuf {
    let mut name = out.file_name().unwrap_or_default().to_owned();
    name.push(".unfinished");
    out.with_file_name(name)
}

/// What a journal must agree on to be continued: everything that detection depends on.
fn fingerprint(layout: &Layout, detector: &str, wanted: &[Pattern], watch: &Watch<'_>) -> String {
    let lenses: BTreeMap<&str, _> =
        layout.cameras.iter().map(|c| (c.name.as_str(), (&c.images, &c.intrinsics))).collect();
    let (predict, search_all) = (watch.predict.map(|file| (file, stamp(file))), watch.search_all);
    let text = format!("{} {detector} {wanted:?} {lenses:?} {predict:?} {search_all}", crate::VERSION);
    Sha256::digest(text.as_bytes()).iter().map(|byte| format!("{byte:02x}")).collect()
}

fn read_journal(path: &Path, fingerprint: &str) -> BTreeMap<(usize, u64, u64), Done> {
    let Ok(text) = std::fs::read_to_string(path) else { return BTreeMap::new() };
    let mut lines = text.lines();
    if lines.next() != Some(fingerprint) {
        return BTreeMap::new();
    }
    // A line that was being written when the run was killed is no JSON and is done again.
    lines
        .filter_map(|line| serde_json::from_str::<Done>(line).ok())
        .map(|done| ((done.camera, done.configuration, done.shot), done))
        .collect()
}

/// The journal of a run, a line a picture.
struct Journal {
    path: PathBuf,
    file: std::fs::File,
}

impl Journal {
    fn open(path: &Path, fingerprint: &str, known: &BTreeMap<(usize, u64, u64), Done>) -> std::io::Result<Self> {
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
        Ok(Self { path: path.to_owned(), file })
    }

    fn append(&mut self, done: &[Done]) -> std::io::Result<()> {
        let mut text = String::new();
        for one in done {
            text.push_str(&serde_json::to_string(one).map_err(std::io::Error::other)?);
            text.push('\n');
        }
        self.file.write_all(text.as_bytes())
    }

    /// The run is complete. A journal that cannot be removed does no harm: it agrees with the result.
    fn remove(self) {
        let _ = std::fs::remove_file(&self.path);
    }
}

impl Lens for Intrinsics {
    fn undistort(&self, pixel: [f64; 2]) -> Option<[f64; 2]> {
        let ideal = Self::undistort(self, &nalgebra::Vector2::from(pixel)).ok()?;
        let (focal, centre) = (self.focal(), self.centre());
        Some([ideal.x * focal[0] + centre[0], ideal.y * focal[1] + centre[1]])
    }

    fn distort(&self, ideal: [f64; 2]) -> Option<[f64; 2]> {
        let (focal, centre) = (self.focal(), self.centre());
        let point = nalgebra::Vector3::new((ideal[0] - centre[0]) / focal[0], (ideal[1] - centre[1]) / focal[1], 1.0);
        self.project(&point).map(Into::into)
    }
}
