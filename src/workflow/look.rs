//! Looking at pictures: several at once, and those of one configuration one after the other.
//!
//! A robot stands still while a camera takes several pictures. What its first picture shows, or its first two where that shows a tag in part, is expected in the
//! others, as long as they show the same (see [`Neighbour`]). They are the first that the recording has, whoever looks at them and when, so that
//! the result is the same bits on any number of threads and after any interruption.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::path::Path;

use super::neighbour::{Neighbour, Shown};
use super::predict::Prediction;
use crate::detect::drawing::draw_to;
use crate::detect::{Corner, Detector, GreyPicture, Lens, Pattern};
use crate::geometry::Intrinsics;
use crate::layout::Layout;
use crate::layout::images::PictureFile;

/// Pictures of a configuration that are searched at most before it is known what to expect in the others.
const FIRSTS: usize = 2;

/// Pattern, tag, corner, pixel and covariance of a corner, as the journal keeps it.
pub(super) type JournalCorner = (usize, Option<u32>, u32, [f64; 2], Option<[f64; 3]>);

/// One picture's line in the journal.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Done {
    pub camera: usize,
    pub configuration: u64,
    pub shot: u64,
    /// Size and modification time: a picture that was taken anew is looked at anew.
    pub stamp: (u64, u64),
    pub corners: Vec<JournalCorner>,
    pub failure: Option<String>,
}

/// A picture and the camera that took it.
pub(super) type Taken<'a> = (usize, &'a PictureFile);

/// What is looked for, and how.
pub(super) struct Looking<'a> {
    pub layout: &'a Layout,
    pub detector: &'a dyn Detector,
    pub wanted: &'a [Pattern],
    pub prediction: Option<&'a Prediction>,
    pub draw: Option<&'a Path>,
    pub search_all: bool,
}

/// What is known after a look: what the journal keeps, and what the picture shows if it could be used.
type Looked = (Done, Option<Shown>);

impl Looking<'_> {
    /// Looks at some of the pictures, which are sorted by camera, configuration and shot as `all` are. Results are in the same order.
    pub fn at(&self, some: &[Taken<'_>], all: &[Taken<'_>]) -> Vec<Done> {
        let groups: Vec<&[Taken<'_>]> = some.chunk_by(|a, b| key(a) == key(b)).collect();
        // Groups side by side and the pictures of each too: a thread that has none of its own left takes some of another's.
        let looked: Vec<Vec<Done>> = groups
            .par_iter()
            .map(|group| {
                let (mut done, neighbour) = self.begin(group, all);
                let rest = group.get(done.len()..).unwrap_or(&[]);
                done.par_extend(rest.par_iter().map(|taken| self.look(taken, neighbour.as_ref(), false).0));
                done
            })
            .collect();
        looked.into_iter().flatten().collect()
    }

    /// Looks at as many of the first pictures of one configuration as tell what to expect in the others; gives what they show if they are among those asked for.
    fn begin(&self, group: &[Taken<'_>], all: &[Taken<'_>]) -> (Vec<Done>, Option<Neighbour>) {
        let Some(taken) = group.first() else { return (Vec::new(), None) };
        let begin = all.partition_point(|other| key(other) < key(taken));
        let firsts = all[begin..].iter().take(FIRSTS).take_while(|other| key(other) == key(taken));
        let (mut done, mut seen): (Vec<Done>, Vec<Shown>) = (Vec::new(), Vec::new());
        for first in firsts {
            // Nothing is left that would have to be told.
            if self.search_all || done.len() == group.len() {
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
    fn look(&self, (camera, file): &Taken<'_>, neighbour: Option<&Neighbour>, keep: bool) -> Looked {
        let mut done = Done {
            camera: *camera,
            configuration: file.configuration,
            shot: file.shot,
            stamp: stamp(&file.path),
            corners: Vec::new(),
            failure: None,
        };
        match self.shown(*camera, file, neighbour, keep) {
            Ok(shown) => {
                let plain = |c: &Corner| (c.pattern, c.tag, c.corner, c.pixel, c.covariance);
                done.corners = shown.corners.iter().map(plain).collect();
                (done, Some(shown))
            }
            Err(reason) => {
                done.failure = Some(reason);
                (done, None)
            }
        }
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

/// How many of some pictures make about so many without a configuration's being cut in two, if its pictures are not very many.
pub(super) fn whole_groups(some: &[Taken<'_>], about: usize) -> usize {
    let (about, most) = (about.min(some.len()), some.len().min(4 * about));
    (about..most).find(|end| *end == 0 || key(&some[*end]) != key(&some[*end - 1])).unwrap_or(most)
}

fn key(taken: &Taken<'_>) -> (usize, u64) {
    (taken.0, taken.1.configuration)
}

/// Size and modification time of a file.
pub(super) fn stamp(path: &Path) -> (u64, u64) {
    let Ok(data) = std::fs::metadata(path) else { return (0, 0) };
    let time = data.modified().ok().and_then(|t| t.duration_since(std::time::UNIX_EPOCH).ok());
    (data.len(), time.map_or(0, |t| t.as_nanos() as u64))
}
