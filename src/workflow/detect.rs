//! `detect`: from pictures to corners, in parallel, resumable, in bounded memory.

use rayon::prelude::*;
use sha2::{Digest, Sha256};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use super::check::check_pictures;
use super::dictionary::wrong_dictionary;
use super::journal::{Done, Journal, journal_path, read_journal};
use super::look::{Looking, Taken, place, stamp};
use super::predict::Prediction;
use crate::complaint::{Complaint, InputError};
use crate::detect::{Detector, Lens, Pattern};
use crate::geometry::Intrinsics;
use crate::layout::Layout;
use crate::layout::images::PictureFile;
use crate::recording::{Recording, write_detection_lines};
use crate::trust::Fault;

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
    let fingerprint = fingerprint(layout, detector.name(), &wanted, &targets, watch);
    let known = read_journal(&journal_path, &fingerprint);
    let fail = |e: std::io::Error| cannot_write(out, &e);
    let kept =
        Kept { journal: Journal::open(&journal_path, &fingerprint, &known).map_err(fail)?, pictures: 0, failure: None };
    let (kept, unwritten) = (Mutex::new(kept), AtomicBool::new(false));
    let lock = || kept.lock().unwrap_or_else(PoisonError::into_inner);
    let tell = |kept: &mut Kept| {
        kept.pictures += 1;
        (watch.progress)(kept.pictures, work.len());
    };
    let looking = Looking {
        layout,
        detector,
        wanted: &wanted,
        targets: &targets,
        prediction: prediction.as_ref(),
        draw: watch.draw,
        search_all: watch.search_all,
        stopped: &|| watch.stop.load(Ordering::Relaxed) || unwritten.load(Ordering::Relaxed),
        each: &|done| {
            let line = serde_json::to_string(done).map_err(std::io::Error::other);
            let mut kept = lock();
            if let Err(error) = line.and_then(|line| kept.journal.append(&line)) {
                kept.failure = Some(error);
                unwritten.store(true, Ordering::Relaxed);
            }
            tell(&mut kept);
        },
    };
    (watch.progress)(0, work.len());
    let configurations: Vec<&[Taken<'_>]> = work.chunk_by(|a, b| place(a) == place(b)).collect();
    // The whole recording at once: no thread waits for another before the end.
    let done = configurations.par_iter().map(|pictures| {
        let earlier = |(camera, file): &&Taken<'_>| {
            let done = known.get(&(*camera, file.configuration, file.shot)).filter(|_| watch.draw.is_none())?;
            (done.stamp == stamp(&file.path)).then(|| done.clone())
        };
        let old: Vec<Option<Done>> = pictures.iter().map(|taken| earlier(&taken)).collect();
        old.iter().flatten().for_each(|_| tell(&mut lock()));
        let new: Vec<Taken<'_>> =
            pictures.iter().zip(&old).filter(|(_, old)| old.is_none()).map(|(new, _)| *new).collect();
        let mut done = looking.at(&new, &work);
        let resumed = old.len() - new.len();
        done.extend(old.into_iter().flatten());
        done.sort_by_key(|done| done.shot);
        (done, resumed)
    });
    let done: Vec<(Vec<Done>, usize)> = done.collect();
    let mut kept = kept.into_inner().unwrap_or_else(PoisonError::into_inner);
    kept.failure.map_or(Ok(()), Err).and_then(|()| kept.journal.write()).map_err(fail)?;
    let mut result = Detected {
        detector: detector.name().to_owned(),
        pictures: done.iter().map(|(done, _)| done.len()).sum(),
        resumed: done.iter().map(|(_, resumed)| resumed).sum(),
        ..Detected::default()
    };
    if result.pictures < work.len() {
        result.interrupted = true;
        result.seconds = began.elapsed().as_secs_f64();
        return Ok(result);
    }
    for (one, (_, file)) in done.iter().flat_map(|(done, _)| done).zip(&work) {
        if let Some(reason) = &one.failure {
            result.failed.push(Failure { picture: file.path.clone(), reason: reason.clone() });
        }
        result.pictures_with_detections += usize::from(one.corners > 0);
        result.tags += one.tags;
        result.corners += one.corners;
    }
    if result.failed.len() == result.pictures {
        let first = &result.failed[0];
        return Err(Complaint::of(
            &first.picture,
            format!("none of the {} pictures could be used; the first: {}", result.pictures, first.reason),
            "check the pictures against `images` and the `size` of the intrinsics",
        )
        .into());
    }
    let seen: BTreeSet<usize> =
        done.iter().flat_map(|(done, _)| done).flat_map(|done| done.targets.iter().copied()).collect();
    let missing: Vec<usize> = targets.iter().copied().filter(|target| !seen.contains(target)).collect();
    if !missing.is_empty() {
        result.faults.extend(wrong_dictionary(layout, detector, &work, &missing));
    }
    let lines = done.iter().flat_map(|(done, _)| done).map(|done| done.lines.as_str());
    write_detection_lines(out, lines).map_err(fail)?;
    kept.journal.remove();
    result.seconds = began.elapsed().as_secs_f64();
    Ok(result)
}

/// What threads share while pictures are looked at.
struct Kept {
    journal: Journal,
    /// Pictures done so far.
    pictures: usize,
    /// Why the journal cannot be written.
    failure: Option<std::io::Error>,
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

/// What a journal must agree on to be continued: everything that detection and the lines of its result depend on.
fn fingerprint(layout: &Layout, detector: &str, wanted: &[Pattern], targets: &[usize], watch: &Watch<'_>) -> String {
    let lenses: Vec<_> = layout.cameras.iter().map(|c| (&c.name, &c.images, &c.intrinsics)).collect();
    let names: Vec<_> = targets.iter().map(|target| (*target, &layout.targets[*target].name)).collect();
    let (predict, search_all) = (watch.predict.map(|file| (file, stamp(file))), watch.search_all);
    let text = format!("{} {detector} {wanted:?} {names:?} {lenses:?} {predict:?} {search_all}", crate::VERSION);
    Sha256::digest(text.as_bytes()).iter().map(|byte| format!("{byte:02x}")).collect()
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
