//! Looking at pictures: several at once, and those of one configuration one after the other.
//!
//! A robot stands still while a camera takes several pictures. What its first picture shows, or its first two where that shows a tag in part, is expected in the
//! others, as long as they show the same (see [`Neighbour`]). They are the first that the recording has, whoever looks at them and when, so that
//! the result is the same bits on any number of threads and after any interruption.

use rayon::prelude::*;
use std::path::Path;

use super::journal::Done;
use super::neighbour::{Neighbour, Shown};
use super::predict::Prediction;
use crate::detect::drawing::draw_to;
use crate::detect::{Corner, Detector, GreyPicture, Lens, Pattern};
use crate::geometry::{Feature, Intrinsics};
use crate::layout::Layout;
use crate::layout::images::PictureFile;
use crate::recording::{CornerRow, detection_lines};

/// Pictures of a configuration that are searched at most before it is known what to expect in the others.
const FIRSTS: usize = 2;

/// A picture and the camera that took it.
pub(super) type Taken<'a> = (usize, &'a PictureFile);

/// What is looked for, and how.
pub(super) struct Looking<'a> {
    pub layout: &'a Layout,
    pub detector: &'a dyn Detector,
    pub wanted: &'a [Pattern],
    /// The target behind each pattern.
    pub targets: &'a [usize],
    pub prediction: Option<&'a Prediction>,
    pub draw: Option<&'a Path>,
    pub search_all: bool,
    /// Whether no more pictures are to be looked at.
    pub stopped: &'a (dyn Fn() -> bool + Sync),
    /// Told of each picture as soon as it is done.
    pub each: &'a (dyn Fn(&Done) + Sync),
}

/// What is known after a look: what the journal keeps, and what the picture shows if it could be used.
type Looked = (Done, Option<Shown>);

impl Looking<'_> {
    /// Looks at some pictures of one configuration; `all` are those of the recording, sorted by camera, configuration and shot as `some` are. Results are in the
    /// same order; there are fewer if it was stopped.
    pub fn at(&self, some: &[Taken<'_>], all: &[Taken<'_>]) -> Vec<Done> {
        let (mut done, neighbour) = self.begin(some, all);
        // The configurations go side by side, and the pictures of each too: a thread that has no configuration of its own left takes some of another's pictures.
        let rest = some.get(done.len()..).unwrap_or(&[]);
        let looked =
            rest.par_iter().map(|taken| (!(self.stopped)()).then(|| self.look(taken, neighbour.as_ref(), false).0));
        done.extend(looked.collect::<Vec<Option<Done>>>().into_iter().flatten());
        done
    }

    /// Looks at as many of the first pictures of one configuration as tell what to expect in the others; gives what they show if they are among those asked for.
    fn begin(&self, group: &[Taken<'_>], all: &[Taken<'_>]) -> (Vec<Done>, Option<Neighbour>) {
        let Some(taken) = group.first() else { return (Vec::new(), None) };
        let begin = all.partition_point(|other| place(other) < place(taken));
        let firsts = all[begin..].iter().take(FIRSTS).take_while(|other| place(other) == place(taken));
        let (mut done, mut seen): (Vec<Done>, Vec<Shown>) = (Vec::new(), Vec::new());
        for first in firsts {
            // Nothing is left that would have to be told.
            if self.search_all || done.len() == group.len() || (self.stopped)() {
                break;
            }
            let (one, shown) = self.look(first, None, true);
            if group.iter().any(|taken| taken.1.shot == first.1.shot) {
                done.push(one);
            }
            let Some(shown) = shown else { continue };
            seen.push(shown);
            if let Some(neighbour) = Neighbour::of(&seen, self.wanted) {
                return (done, Some(neighbour));
            }
        }
        (done, None)
    }

    /// Looks at a picture. With `keep` for what it says of others that show the same.
    fn look(&self, taken: &Taken<'_>, neighbour: Option<&Neighbour>, keep: bool) -> Looked {
        let (camera, file) = *taken;
        let stamp = stamp(&file.path);
        let looked = self.shown(camera, file, neighbour, keep);
        let mut done = Done {
            camera,
            configuration: file.configuration,
            shot: file.shot,
            stamp,
            tags: 0,
            corners: 0,
            targets: Vec::new(),
            lines: String::new(),
            failure: None,
        };
        match &looked {
            Ok(shown) => self.note(&shown.corners, &mut done),
            Err(reason) => done.failure = Some(reason.clone()),
        }
        (self.each)(&done);
        (done, looked.ok())
    }

    /// Puts down what was found in a picture.
    fn note(&self, corners: &[Corner], done: &mut Done) {
        let rows: Vec<CornerRow> = corners
            .iter()
            .map(|corner| CornerRow {
                configuration: done.configuration,
                shot: done.shot,
                camera: done.camera,
                target: self.targets[corner.pattern],
                feature: match corner.tag {
                    Some(tag) => Feature::TagCorner(tag, corner.corner as u8),
                    None => Feature::BoardCorner(corner.corner),
                },
                pixel: corner.pixel,
                covariance: corner.covariance,
            })
            .collect();
        done.tags = corners.chunk_by(|a, b| (a.pattern, a.tag) == (b.pattern, b.tag)).count();
        done.corners = rows.len();
        done.targets = rows.iter().map(|row| row.target).collect();
        done.targets.dedup();
        done.lines = detection_lines(self.layout, &rows);
    }

    fn shown(
        &self,
        camera: usize,
        file: &PictureFile,
        neighbour: Option<&Neighbour>,
        keep: bool,
    ) -> Result<Shown, String> {
        let intrinsics = self.layout.cameras[camera].intrinsics.as_ref();
        let picture = GreyPicture::read(&file.path, intrinsics.map(Intrinsics::size)).map_err(|e| e.to_string())?;
        let lens = intrinsics.map(|i| i as &dyn Lens);
        let predicted;
        let expected = match neighbour.and_then(|neighbour| neighbour.expected_in(&picture)) {
            Some(expected) => expected,
            None => {
                let of = |prediction: &Prediction| prediction.of(self.layout, camera, file.configuration);
                predicted = self.prediction.map(of).unwrap_or_default();
                &predicted
            }
        };
        let (corners, known) = if keep {
            self.detector.detect_known(&picture, lens, self.wanted, expected)
        } else {
            self.detector.detect_expected(&picture, lens, self.wanted, expected).map(|corners| (corners, Vec::new()))
        }
        .map_err(|e| e.to_string())?;
        if let Some(folder) = self.draw {
            let name = &self.layout.cameras[camera].name;
            let drawing = folder.join(format!("{name}_{:04}_{:02}.png", file.configuration, file.shot));
            draw_to(&drawing, &picture, &corners).map_err(|e| e.to_string())?;
        }
        Ok(Shown { picture, corners, known })
    }
}

/// Which configuration of which camera.
pub(super) fn place(taken: &Taken<'_>) -> (usize, u64) {
    (taken.0, taken.1.configuration)
}

/// Size and modification time of a file.
pub(super) fn stamp(path: &Path) -> (u64, u64) {
    let Ok(data) = std::fs::metadata(path) else { return (0, 0) };
    let time = data.modified().ok().and_then(|t| t.duration_since(std::time::UNIX_EPOCH).ok());
    (data.len(), time.map_or(0, |t| t.as_nanos() as u64))
}
