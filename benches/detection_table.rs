//! The detector against rendered truth, in one go: recall, false ids, accuracy, honesty of the covariances, time; then hard cases as
//! curves. With the feature `opencv`, OpenCV's finder stands beside it on the same pictures, interleaved.
//!
//! `cargo bench --bench detection_table`, or with `--features opencv`. `-- quick` takes fewer pictures.

#[path = "../tests/support/rendering.rs"]
mod rendering;
#[path = "../tests/support/scene.rs"]
mod scene;

use std::time::Instant;

use cellmap::detect::edge_lines::Lens;
use cellmap::detect::native::NativeDetector;
use cellmap::detect::{Detector, Dictionary, GreyPicture, Pattern};
use cellmap::geometry::{Intrinsics, LensModel};
use scene::{Scene, Tally, Truth, USUAL};

struct Run {
    tally: Tally,
    /// Least time a picture, ms, over the pictures.
    times: Vec<f64>,
}

fn detectors() -> Vec<Box<dyn Detector>> {
    #[allow(unused_mut)]
    let mut all: Vec<Box<dyn Detector>> = vec![Box::new(NativeDetector)];
    #[cfg(feature = "opencv")]
    all.push(Box::new(cellmap::detect::opencv::OpenCvDetector::new().expect("OpenCV starts")));
    all
}

fn run(
    detectors: &[Box<dyn Detector>],
    scene: &Scene,
    pictures: u64,
    repeats: usize,
    lens: Option<&dyn Lens>,
) -> Vec<Run> {
    let ids = (0..scene.dictionary.tag_count()).collect();
    let wanted = [Pattern::Tags { dictionary: scene.dictionary, ids }];
    let mut runs: Vec<Run> = detectors.iter().map(|_| Run { tally: Tally::default(), times: Vec::new() }).collect();
    for seed in 0..pictures {
        let (picture, truth): (GreyPicture, Vec<Truth>) = scene.render(seed, lens);
        for (detector, run) in detectors.iter().zip(&mut runs) {
            let (mut least, mut found) = (f64::MAX, Vec::new());
            for _ in 0..repeats {
                let began = Instant::now();
                found = detector.detect(&picture, lens, &wanted).expect("nothing fails");
                least = least.min(began.elapsed().as_secs_f64() * 1e3);
            }
            let corners: Vec<_> =
                found.iter().filter_map(|c| Some((c.tag?, c.corner as usize, c.pixel, c.covariance?))).collect();
            run.tally.add(&truth, &corners);
            run.times.push(least);
        }
    }
    runs
}

fn print(name: &str, detectors: &[Box<dyn Detector>], runs: &[Run]) {
    let mut first = None;
    for (detector, run) in detectors.iter().zip(runs) {
        let t = &run.tally;
        let mut times = run.times.clone();
        times.sort_by(f64::total_cmp);
        let (median, worst) = (times[times.len() / 2], times[times.len() - 1]);
        let ratio = first.map_or(String::new(), |first: f64| format!("  x{:.1}", median / first));
        first.get_or_insert(median);
        let offset = t.mean_offset();
        println!(
            "| {name} | {} | {:.4} | {} | {:.4} | {:+.4} {:+.4} | {:+.4} | {:.2} | {median:.2} (worst {worst:.2}){ratio} |",
            detector.name(),
            t.recall(),
            t.false_ids,
            t.rms(),
            offset[0],
            offset[1],
            t.mean_pull(),
            t.mean_normalised(),
        );
    }
}

fn main() {
    let quick = std::env::args().any(|argument| argument == "quick");
    let detectors = detectors();
    println!("| case | detector | recall | false ids | rms px | offset px | pull px | normalised | ms a picture |");
    println!("|---|---|---|---|---|---|---|---|---|");
    let many = if quick { 10 } else { 60 };
    for clutter in [false, true] {
        for noise in [2.0, 4.0] {
            let scene = Scene { clutter, noise, ..USUAL };
            let name = format!("{} noise {noise}", if clutter { "cluttered" } else { "clean" });
            print(&name, &detectors, &run(&detectors, &scene, many, 5, None));
        }
    }
    for blur in [1.5, 2.0] {
        print(&format!("clean blur {blur}"), &detectors, &run(&detectors, &Scene { blur, ..USUAL }, many / 2, 1, None));
    }
    print("inverted", &detectors, &run(&detectors, &Scene { inverted: true, ..USUAL }, many / 4, 1, None));
    for dictionary in [Dictionary::Aruco4x4_50, Dictionary::Aruco6x6_250, Dictionary::AprilTag16h5] {
        let empty = Scene { clutter: true, tags: 0, dictionary, ..USUAL };
        let native = &detectors[..1];
        let pictures = if quick { 50 } else { 1000 };
        print(&format!("no tags, {pictures} pictures, {dictionary}"), native, &run(native, &empty, pictures, 1, None));
    }
    let few = if quick { 2 } else { 10 };
    let hard = |name: &str, scene: Scene| print(name, &detectors, &run(&detectors, &scene, few, 1, None));
    for size in [12.0, 16.0, 20.0, 28.0, 40.0] {
        hard(&format!("size {size}"), Scene { size: [size, size], tilt: [0.0, 0.5], ..USUAL });
    }
    for tilt in [60.0_f64, 70.0, 75.0, 80.0] {
        hard(&format!("tilt {tilt}"), Scene { tilt: [tilt.to_radians(), tilt.to_radians()], ..USUAL });
    }
    for blur in [1.0, 2.0, 3.0] {
        hard(&format!("blur {blur}"), Scene { blur, ..USUAL });
    }
    for motion in [3.0, 6.0, 10.0] {
        hard(&format!("smear {motion}"), Scene { motion, ..USUAL });
    }
    for noise in [8.0, 12.0, 20.0] {
        hard(&format!("noise {noise}"), Scene { noise, ..USUAL });
    }
    for gamma in [0.45, 2.2] {
        hard(&format!("gamma {gamma}"), Scene { gamma, ..USUAL });
    }
    for exposure in [0.15, 0.3, 1.4] {
        hard(&format!("exposure {exposure}"), Scene { exposure, ..USUAL });
    }
    hard("JPEG 30", Scene { jpeg: Some(30), ..USUAL });
    hard("hidden 0.2 of a side", Scene { hidden: 0.2, ..USUAL });
    let lens = |model, distortion: &[f64]| {
        Intrinsics::new(model, [1280, 720], [700.0, 700.0], [639.5, 359.5], distortion).expect("a good lens")
    };
    let barrel = lens(LensModel::Brown, &[-0.28, 0.07, 0.0, 0.0, 0.0]);
    print("barrel", &detectors, &run(&detectors, &USUAL, few, 1, Some(&barrel)));
    let fisheye = lens(LensModel::KannalaBrandt, &[0.05, -0.01, 0.0, 0.0]);
    print("fisheye", &detectors, &run(&detectors, &USUAL, few, 1, Some(&fisheye)));
}
