//! Edge lines against exact truth: how far off, in which direction, and do the covariances say so?

#[path = "support/rendering.rs"]
mod common;
use cellmap::detect::edge_lines::{Lens, Refinement, refine_quad};
use common::{Random, SQUARE, Tag, View, render};

#[derive(Default, Debug)]
struct Tally {
    corners: f64,
    weak: f64,
    squares: f64,
    offset: [f64; 2],
    pull: f64,
    normalised: f64,
    worst: f64,
}

impl Tally {
    fn add(&mut self, found: [f64; 2], truth: [f64; 2], centre: [f64; 2], covariance: [f64; 3]) {
        let e = [found[0] - truth[0], found[1] - truth[1]];
        let out = [truth[0] - centre[0], truth[1] - centre[1]];
        self.corners += 1.0;
        self.squares += e[0] * e[0] + e[1] * e[1];
        self.offset = [self.offset[0] + e[0], self.offset[1] + e[1]];
        self.pull += (e[0] * out[0] + e[1] * out[1]) / out[0].hypot(out[1]);
        let [suu, suv, svv] = covariance;
        self.normalised +=
            (e[0] * e[0] * svv - 2.0 * e[0] * e[1] * suv + e[1] * e[1] * suu) / (suu * svv - suv * suv) / 2.0;
        self.worst = self.worst.max(e[0].hypot(e[1]));
    }
    fn rms(&self) -> f64 {
        (self.squares / self.corners / 2.0).sqrt()
    }
    fn print(&self, name: &str) {
        println!(
            "{name}: corners {} weak {} rms {:.4} px an axis, offset {:+.4} {:+.4}, pull outwards {:+.4}, normalised {:.2}, worst {:.3}",
            self.corners,
            self.weak,
            self.rms(),
            self.offset[0] / self.corners,
            self.offset[1] / self.corners,
            self.pull / self.corners,
            self.normalised / self.corners,
            self.worst
        );
    }
}

/// A mild Brown lens with one radial term.
struct Barrel {
    k1: f64,
    focal: f64,
    centre: [f64; 2],
}

impl Lens for Barrel {
    fn undistort(&self, pixel: [f64; 2]) -> Option<[f64; 2]> {
        let d = [(pixel[0] - self.centre[0]) / self.focal, (pixel[1] - self.centre[1]) / self.focal];
        let mut p = d;
        for _ in 0..30 {
            let f = 1.0 + self.k1 * (p[0] * p[0] + p[1] * p[1]);
            p = [d[0] / f, d[1] / f];
        }
        Some([self.centre[0] + self.focal * p[0], self.centre[1] + self.focal * p[1]])
    }
    fn distort(&self, ideal: [f64; 2]) -> Option<[f64; 2]> {
        let p = [(ideal[0] - self.centre[0]) / self.focal, (ideal[1] - self.centre[1]) / self.focal];
        let f = 1.0 + self.k1 * (p[0] * p[0] + p[1] * p[1]);
        Some([self.centre[0] + self.focal * p[0] * f, self.centre[1] + self.focal * p[1] * f])
    }
}

struct Setting {
    tags: usize,
    bits: usize,
    size: [f64; 2],
    tilt: f64,
    blur: f64,
    noise: f64,
    rough: f64,
    lens: Option<Barrel>,
    use_lens: bool,
}

const USUAL: Setting = Setting {
    tags: 100,
    bits: 6,
    size: [44.0, 93.0],
    tilt: 1.047,
    blur: 0.7,
    noise: 2.0,
    rough: 0.5,
    lens: None,
    use_lens: true,
};

fn measure(name: &str, setting: &Setting) -> Tally {
    let mut random = Random(7);
    let mut tally = Tally::default();
    let mut seconds = 0.0;
    for _ in 0..setting.tags {
        let size = random.between(setting.size[0], setting.size[1]);
        let extent = (1.9 * size) as usize;
        let place = [extent as f64 / 2.0 + random.unit(), extent as f64 / 2.0 + random.unit()];
        let view = View::random(&mut random, place, size, setting.tilt);
        let tag = Tag::random(&mut random, setting.bits);
        let lens = setting.lens.as_ref().map(|lens| lens as &dyn Lens);
        let picture = render(&mut random, extent, extent, setting.blur, setting.noise, |pixel| {
            tag.value(view.plane(lens.map_or(pixel, |lens| lens.undistort(pixel).unwrap())))
        });
        let truth = SQUARE.map(|corner| {
            let ideal = view.ideal(corner);
            lens.map_or(ideal, |lens| lens.distort(ideal).unwrap())
        });
        let centre = [0, 1].map(|axis: usize| truth.iter().map(|corner| corner[axis]).sum::<f64>() / 4.0);
        // As a contour finder's: on the dark side, and rough.
        let rough = truth.map(|corner| {
            let out = [corner[0] - centre[0], corner[1] - centre[1]];
            let length = out[0].hypot(out[1]);
            [0, 1].map(|axis: usize| corner[axis] - 0.7 * out[axis] / length + setting.rough * random.normal())
        });
        let start = std::time::Instant::now();
        let refined = refine_quad(&picture, lens.filter(|_| setting.use_lens), rough, setting.bits + 2);
        seconds += start.elapsed().as_secs_f64();
        for (corner, truth) in refined.iter().zip(truth) {
            match corner {
                Refinement::Refined { pixel, covariance } => tally.add(*pixel, truth, centre, *covariance),
                Refinement::Weak(_) => tally.weak += 1.0,
            }
        }
    }
    tally.print(name);
    println!("    {:.3} ms a tag", seconds * 1e3 / setting.tags as f64);
    tally
}

#[test]
fn usual_tags_are_exact_and_unbiased() {
    let tally = measure("usual", &USUAL);
    assert!(tally.rms() < 0.03);
    assert!(tally.pull.abs() / tally.corners < 0.005);
    assert!(tally.offset.iter().all(|sum| sum.abs() / tally.corners < 0.005));
    let normalised = tally.normalised / tally.corners;
    assert!((0.6..1.6).contains(&normalised), "{normalised}");
    assert!(tally.weak / (tally.weak + tally.corners) < 0.02);
}

#[test]
fn a_bent_side_is_straightened_by_the_lens() {
    // A wide lens: a side of 150 px is bent by about a pixel.
    let lens = || Some(Barrel { k1: -0.15, focal: 400.0, centre: [100.0, 60.0] });
    let setting = Setting { tags: 16, size: [100.0, 200.0], tilt: 0.6, lens: lens(), ..USUAL };
    let with = measure("lens known", &setting);
    let without = measure("lens not told", &Setting { use_lens: false, ..setting });
    assert!(with.rms() < 0.03);
    assert!(with.pull.abs() / with.corners < 0.005);
    assert!(without.rms() > 3.0 * with.rms(), "the test would show nothing");
}

/// Where cells are a few pixels wide the data behind the border blurs into the edge. Such tags must be called weak, or
/// carry a covariance that owns up to it.
#[test]
fn small_tags_do_not_boast() {
    for (size, tilt) in [([14.0, 20.0], 0.5), ([20.0, 28.0], 0.7), ([28.0, 44.0], 1.0)] {
        let tally = measure(&format!("small {size:?}"), &Setting { size, tilt, tags: 100, ..USUAL });
        let normalised = tally.normalised / tally.corners.max(1.0);
        assert!(tally.rms() < 0.2 || tally.corners == 0.0);
        assert!(normalised < 3.0, "{normalised}");
    }
}

#[test]
fn what_cannot_be_measured_is_weak_and_nothing_panics() {
    let mut random = Random(1);
    let tag = Tag::random(&mut random, 6);
    let view = View::random(&mut random, [50.0, 50.0], 50.0, 0.2);
    let picture = render(&mut random, 100, 100, 0.7, 2.0, |pixel| tag.value(view.plane(pixel)));
    let truth = SQUARE.map(|corner| view.ideal(corner));
    let all_weak = |corners: [Refinement; 4]| corners.iter().all(|corner| matches!(corner, Refinement::Weak(_)));
    assert!(!all_weak(refine_quad(&picture, None, truth, 8)));
    // The other way round is a quadrangle too; its border still is dark inside.
    let [a, b, c, d] = truth;
    assert!(!all_weak(refine_quad(&picture, None, [d, c, b, a], 8)));

    let blank = render(&mut random, 100, 100, 0.0, 2.0, |_| 120.0);
    assert!(all_weak(refine_quad(&blank, None, truth, 8)));
    let negative = render(&mut random, 100, 100, 0.7, 2.0, |pixel| 255.0 - tag.value(view.plane(pixel)));
    assert!(all_weak(refine_quad(&negative, None, truth, 8)), "bright inside is no tag");
    let far = truth.map(|corner| [corner[0] + 1e6, corner[1] - 1e7]);
    let not_a_number = truth.map(|corner| [corner[0], f64::NAN]);
    for rough in [[[0.0; 2]; 4], far, not_a_number, [[f64::INFINITY; 2]; 4], [a, c, b, d], [a, b, b, d]] {
        assert!(all_weak(refine_quad(&picture, None, rough, 8)), "{rough:?}");
    }
    for cells in [0, 1, usize::MAX] {
        let _ = refine_quad(&picture, None, truth, cells);
    }
    // A third of one side hidden by something bright: its two corners may go, the others stay.
    let hidden = render(&mut random, 100, 100, 0.7, 2.0, |pixel| {
        let on_tag = view.plane(pixel);
        if on_tag[0] > -0.2 && on_tag[0] < 0.2 && on_tag[1] < -0.35 { 215.0 } else { tag.value(on_tag) }
    });
    for (corner, truth) in refine_quad(&hidden, None, truth, 8).iter().zip(truth).skip(2) {
        let Refinement::Refined { pixel, .. } = corner else { panic!("{corner:?}") };
        assert!((pixel[0] - truth[0]).hypot(pixel[1] - truth[1]) < 0.06);
    }
}
