//! The detector against rendered truth, in one go: recall, false ids, accuracy, honesty of the covariances, time; then hard cases as
//! curves. Beside it, on the same pictures and interleaved: OpenCV's `detectMarkers`, where `CELLMAP_OPENCV_PYTHON` names a Python that has
//! `opencv-contrib-python-headless`; and OpenCV's finder with cellmap's measuring, with the feature `opencv`.
//!
//! `cargo bench --bench detection_table`, or with `--features opencv`. `-- quick` takes fewer pictures, `-- WORD` only cases whose name has the word.

#[path = "peers/opencv/mod.rs"]
mod opencv_peer;
#[path = "../tests/support/rendering.rs"]
mod rendering;
#[path = "../tests/support/scene.rs"]
mod scene;

use std::time::Instant;

use cellmap::detect::edge_lines::Lens;
use cellmap::detect::native::NativeDetector;
use cellmap::detect::{Corner, Detector, Dictionary, GreyPicture, Pattern};
use cellmap::geometry::{Intrinsics, LensModel};
use opencv_peer::Peer;
use scene::{Scene, Tally, Truth, USUAL};

/// Id, corner, pixel, covariance.
type Found = (u32, usize, [f64; 2], [f64; 3]);

/// Who is measured.
enum Contender {
    Library(Box<dyn Detector>),
    Peer(Peer),
}

impl Contender {
    fn name(&self) -> String {
        match self {
            Self::Library(detector) => detector.name().to_owned(),
            Self::Peer(peer) => peer.name().to_owned(),
        }
    }

    /// Least time in ms, and what was found. A corner without a covariance counts with one that says nothing.
    fn look(
        &mut self,
        picture: &GreyPicture,
        lens: Option<&dyn Lens>,
        scene: &Scene,
        repeats: usize,
    ) -> (f64, Vec<Found>) {
        match self {
            Self::Library(detector) => {
                let ids = (0..scene.dictionary.tag_count()).collect();
                let wanted = [Pattern::Tags { dictionary: scene.dictionary, ids }];
                let (mut least, mut found) = (f64::MAX, Vec::new());
                for _ in 0..repeats {
                    let began = Instant::now();
                    found = detector.detect(picture, lens, &wanted).expect("nothing fails");
                    least = least.min(began.elapsed().as_secs_f64() * 1e3);
                }
                let plain = |c: Corner| Some((c.tag?, c.corner as usize, c.pixel, c.covariance?));
                (least, found.into_iter().filter_map(plain).collect())
            }
            Self::Peer(peer) => {
                let (ms, found) = peer.look(picture, scene.dictionary, repeats);
                let corners = found.into_iter().flat_map(|(id, quad)| {
                    (0..4).map(move |corner: usize| (id, corner, quad[corner], [f64::INFINITY, 0.0, f64::INFINITY]))
                });
                (ms, corners.collect())
            }
        }
    }
}

struct Run {
    tally: Tally,
    /// Least time of a picture, ms, over the pictures.
    times: Vec<f64>,
}

struct Table {
    contenders: Vec<Contender>,
    /// Fewer pictures.
    quick: bool,
    /// Only cases whose name has this word.
    word: Option<String>,
}

impl Table {
    fn case(&mut self, name: &str, scene: Scene, pictures: u64, repeats: usize, lens: Option<&dyn Lens>) {
        if self.word.as_ref().is_some_and(|word| !name.contains(word.as_str())) {
            return;
        }
        let mut runs: Vec<Run> =
            self.contenders.iter().map(|_| Run { tally: Tally::default(), times: Vec::new() }).collect();
        let inverted = Contender::Library(Box::new(NativeDetector::with_inverted()));
        let first = if scene.inverted { Some(std::mem::replace(&mut self.contenders[0], inverted)) } else { None };
        for seed in 0..pictures {
            let (picture, truth): (GreyPicture, Vec<Truth>) = scene.render(seed, lens);
            for (contender, run) in self.contenders.iter_mut().zip(&mut runs) {
                let (least, found) = contender.look(&picture, lens, &scene, repeats);
                run.tally.add(&truth, &found);
                run.times.push(least);
            }
        }
        let mut native = None;
        for (contender, run) in self.contenders.iter().zip(&mut runs) {
            let t = &run.tally;
            run.times.sort_by(f64::total_cmp);
            let (median, worst) = (run.times[run.times.len() / 2], run.times[run.times.len() - 1]);
            let ratio = native.map_or(String::new(), |native: f64| format!(" x{:.1}", median / native));
            native.get_or_insert(median);
            let [x, y] = t.mean_offset();
            let accuracy = if t.corners == 0.0 {
                "- | - | - | -".to_owned()
            } else {
                let normalised = t.mean_normalised();
                let normalised = if normalised > 0.0 { format!("{normalised:.2}") } else { "-".to_owned() };
                format!("{:.4} | {x:+.4} {y:+.4} | {:+.4} | {normalised}", t.rms(), t.mean_pull())
            };
            let recall = if t.tags > 0.0 { format!("{:.4}", t.recall()) } else { "-".to_owned() };
            println!(
                "| {name} | {} | {recall} | {} | {accuracy} | {median:.2} (worst {worst:.2}){ratio} |",
                contender.name(),
                t.false_ids
            );
        }
        if let Some(first) = first {
            self.contenders[0] = first;
        }
    }

    fn hard(&mut self, name: &str, scene: Scene) {
        let few = if self.quick { 2 } else { 10 };
        self.case(name, scene, few, 1, None);
    }
}

fn main() {
    let words: Vec<String> = std::env::args().skip(1).filter(|word| !word.starts_with("--")).collect();
    let quick = words.iter().any(|word| word == "quick");
    let mut contenders = vec![Contender::Library(Box::new(NativeDetector::new()))];
    #[cfg(feature = "opencv")]
    contenders
        .push(Contender::Library(Box::new(cellmap::detect::opencv::OpenCvDetector::new().expect("OpenCV starts"))));
    match Peer::start() {
        Some(peer) => contenders.push(Contender::Peer(peer)),
        None => println!("without OpenCV's own detectMarkers: CELLMAP_OPENCV_PYTHON names no Python that has it\n"),
    }
    let word = words.into_iter().find(|word| word != "quick");
    let mut table = Table { contenders, quick, word };
    println!("| case | detector | recall | false ids | rms px | offset px | pull px | normalised | ms a picture |");
    println!("|---|---|---|---|---|---|---|---|---|");
    let many = if quick { 10 } else { 60 };
    for clutter in [false, true] {
        for noise in [2.0, 4.0] {
            let name = format!("{} noise {noise}", if clutter { "cluttered" } else { "clean" });
            table.case(&name, Scene { clutter, noise, ..USUAL }, many, 5, None);
        }
    }
    table.case("inverted", Scene { inverted: true, ..USUAL }, many / 4, 1, None);
    for dictionary in [Dictionary::Aruco4x4_50, Dictionary::Aruco6x6_250, Dictionary::AprilTag16h5] {
        let pictures = if quick { 50 } else { 1000 };
        let empty = Scene { clutter: true, tags: 0, dictionary, ..USUAL };
        table.case(&format!("no tags, {pictures} pictures, {dictionary}"), empty, pictures, 1, None);
    }
    for size in [12.0, 16.0, 20.0, 28.0, 40.0] {
        table.hard(&format!("size {size}"), Scene { size: [size, size], tilt: [0.0, 0.5], ..USUAL });
    }
    for tilt in [60.0_f64, 70.0, 75.0, 80.0] {
        table.hard(&format!("tilt {tilt}"), Scene { tilt: [tilt.to_radians(), tilt.to_radians()], ..USUAL });
    }
    for blur in [1.0, 1.5, 2.0, 3.0] {
        table.hard(&format!("blur {blur}"), Scene { blur, ..USUAL });
    }
    for motion in [3.0, 6.0, 10.0] {
        table.hard(&format!("smear {motion}"), Scene { motion, ..USUAL });
    }
    for noise in [8.0, 12.0, 20.0] {
        table.hard(&format!("loud {noise}"), Scene { noise, ..USUAL });
    }
    for gamma in [0.45, 2.2] {
        table.hard(&format!("gamma {gamma}"), Scene { gamma, ..USUAL });
        table.hard(&format!("gamma {gamma} size 20"), Scene { gamma, size: [20.0; 2], tilt: [0.0, 0.5], ..USUAL });
    }
    for exposure in [0.15, 0.3, 1.4] {
        table.hard(&format!("exposure {exposure}"), Scene { exposure, ..USUAL });
    }
    table.hard("JPEG 30", Scene { jpeg: Some(30), ..USUAL });
    for hidden in [0.1, 0.2, 0.3] {
        table.hard(&format!("hidden {hidden} of a side"), Scene { hidden, ..USUAL });
    }
    let few = if quick { 2 } else { 10 };
    let lens = |model, distortion: &[f64]| {
        Intrinsics::new(model, [1280, 720], [700.0, 700.0], [639.5, 359.5], distortion).expect("a good lens")
    };
    let barrel = lens(LensModel::Brown, &[-0.28, 0.07, 0.0, 0.0, 0.0]);
    table.case("barrel", USUAL, few, 1, Some(&barrel));
    let fisheye = lens(LensModel::KannalaBrandt, &[0.05, -0.01, 0.0, 0.0]);
    table.case("fisheye", USUAL, few, 1, Some(&fisheye));
}
