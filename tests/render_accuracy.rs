//! Edges in rendered pictures against the corners of the truth: a detector is judged by these pictures, so they must be far better than it is.

use cellmap::geometry::Intrinsics;
use cellmap::geometry::target::tag_corners;
use cellmap::layout::{Layout, parse_layout};
use cellmap::recording::Recording;
use cellmap::simulate::Cell;
use cellmap::simulate::render::{Look, Scene, light};
use nalgebra::{Vector2, Vector3};

fn layout(lens: &str, poses: &[(f64, f64, f64, f64, f64, f64)]) -> Layout {
    let tags: String = poses
        .iter()
        .enumerate()
        .map(|(i, (x, y, z, r, p, w))| {
            format!(
                "  t{i}: {{tags: {{dictionary: 6x6_250, size: 90, ids: [{i}]}}, pose: {{xyz: [{x}, {y}, {z}], rpy: [{r}, {p}, {w}]}}}}\n"
            )
        })
        .collect();
    let text = format!(
        "cellmap: 1\nunits: {{length: mm, angle: deg}}\nworld: eye\ncameras:\n  eye:\n    intrinsics: {{{lens}}}\ntargets:\n{tags}"
    );
    parse_layout("x.yaml".as_ref(), &text, None).unwrap()
}

const PINHOLE: &str = "model: pinhole, size: [1280, 720], focal: [1100, 1100], centre: [639.5, 359.5]";
const BROWN: &str = "model: brown, size: [1280, 720], focal: [1100, 1101], centre: [640.2, 358.9], distortion: [-0.28, 0.11, 0.001, -0.0008, 0]";
const RATIONAL: &str = "model: rational, size: [1280, 720], focal: [900, 900], centre: [641, 360], distortion: [0.3, 0.1, 0.0004, -0.0002, 0.02, 0.6, 0.2, 0.05]";
const FISHEYE: &str = "model: fisheye, size: [1280, 720], focal: [500, 500], centre: [640, 360], distortion: [-0.02, 0.004, -0.001, 0.0002]";

/// How far each point of the four border edges lies from where it should, px along the edge's outward normal. In a noise-free picture an edge's place is where the
/// light lost between a point well outside and one well inside says it is.
fn edge_errors(layout: &Layout, look: &Look) -> Vec<Vec<f64>> {
    let recording = Recording::default();
    let cell = Cell::new(layout, &recording);
    let scene = Scene::new(&cell, look);
    let (size, picture) = light(&cell, &scene, 0, 0).unwrap();
    let lens: &Intrinsics = layout.cameras[0].intrinsics.as_ref().unwrap();
    let mut errors = Vec::new();
    for target in &cell.tree.targets {
        let pose = cell.pose(cell.tree.cameras[0], *target, 0).unwrap();
        let corners = tag_corners(0.09);
        let mut own = Vec::new();
        for side in 0..4 {
            let (a, b) = (corners[side], corners[(side + 1) % 4]);
            let project = |s: f64, out: f64| -> Vector2<f64> {
                let outward = Vector3::new(0.5 * (a.x + b.x), 0.5 * (a.y + b.y), 0.0).normalize();
                lens.project(&(pose * (a + (b - a) * s + outward * out))).unwrap()
            };
            let middle = project(0.5, 1e-4) - project(0.5, 0.0);
            let horizontal = middle.y.abs() > middle.x.abs();
            // Walk along the rows (columns) that the edge crosses, and sum across it.
            let along = usize::from(!horizontal);
            let across = 1 - along;
            let (from, to) = (project(0.12, 0.0)[along], project(0.88, 0.0)[along]);
            let (first, last) = (from.min(to).ceil() as i64, from.max(to).floor() as i64);
            for line in first..=last {
                // Where on this line of pixels the true edge lies, averaged over the pixel's width.
                let crossing = |at: f64| {
                    let (mut low, mut high) = (0.0, 1.0);
                    let rising = project(1.0, 0.0)[along] > project(0.0, 0.0)[along];
                    for _ in 0..60 {
                        let s = 0.5 * (low + high);
                        if (project(s, 0.0)[along] < at) == rising { low = s } else { high = s }
                    }
                    project(0.5 * (low + high), 0.0)[across]
                };
                let line_f = line as f64;
                let truth = (crossing(line_f - 0.25) + crossing(line_f + 0.25) + 4.0 * crossing(line_f)) / 6.0;
                let value = |k: i64| {
                    let (x, y) = if horizontal { (line, k) } else { (k, line) };
                    (x >= 0 && y >= 0 && (x as usize) < size[0] && (y as usize) < size[1])
                        .then(|| f64::from(picture[y as usize * size[0] + x as usize]))
                };
                let near = truth.round() as i64;
                let cell_px = (project(0.5, 0.0) - project(0.5, 0.09 / 8.0)).norm();
                let reach = (0.55 * cell_px).floor().min(4.0) as i64;
                let values: Option<Vec<f64>> = (near - reach..=near + reach).map(value).collect();
                let Some(values) = values else { continue };
                let (before, after) = (values[0], values[values.len() - 1]);
                // All pixels wholly before the edge have `before`, all after it `after`; the sum tells where it is.
                let sum: f64 = values.iter().map(|v| (v - after) / (before - after)).sum();
                let found = (near - reach) as f64 - 0.5 + sum;
                let (outward, slope) = (middle[across].signum(), middle.normalize()[across].abs());
                own.push((found - truth) * outward * slope);
            }
        }
        errors.push(own);
    }
    errors
}

fn check(name: &str, lens: &str, poses: &[(f64, f64, f64, f64, f64, f64)]) {
    let layout = layout(lens, poses);
    // Shadows and shading change slowly across a tag; the plain look has shading only, so that what is measured is the edges.
    let errors = edge_errors(&layout, &Look::plain(1));
    for (tag, own) in errors.iter().enumerate() {
        let n = own.len() as f64;
        let mean = own.iter().sum::<f64>() / n;
        let rms = (own.iter().map(|e| e * e).sum::<f64>() / n).sqrt();
        let worst = own.iter().fold(0.0f64, |m, e| m.max(e.abs()));
        println!("{name} tag {tag}: {n} points, mean {mean:+.5}, rms {rms:.5}, worst {worst:.5} px");
        assert!(own.len() > 40, "{name}: only {} points", own.len());
        assert!(
            mean.abs() < 0.001 && rms < 0.003 && worst < 0.005,
            "{name} tag {tag}: mean {mean} rms {rms} worst {worst}"
        );
    }
}

const CENTRE: (f64, f64, f64, f64, f64, f64) = (3.0, -4.0, 700.0, 180.0, 0.0, 7.0);
const BORDER: (f64, f64, f64, f64, f64, f64) = (340.0, 10.0, 700.0, 180.0, 10.0, 31.0);
const CORNER: (f64, f64, f64, f64, f64, f64) = (-335.0, -165.0, 700.0, 165.0, -12.0, -20.0);
const TILTED: (f64, f64, f64, f64, f64, f64) = (-120.0, 60.0, 600.0, 120.0, 0.0, 15.0);
const TURNED: (f64, f64, f64, f64, f64, f64) = (150.0, 90.0, 650.0, 180.0, 60.0, -33.0);

#[test]
fn edges_are_where_they_should_be_through_every_lens() {
    for (name, lens) in [("pinhole", PINHOLE), ("brown", BROWN), ("rational", RATIONAL), ("fisheye", FISHEYE)] {
        check(name, lens, &[CENTRE, BORDER, CORNER, TILTED, TURNED]);
    }
}

#[test]
fn a_pixel_is_the_mean_over_its_area() {
    // A pixel's neighbourhood sampled 64 x 64 times by inverting the exact lens, against the rendered value, at every pixel of a tag in a distorted corner.
    let layout = layout(BROWN, &[CORNER]);
    let (recording, look) = (Recording::default(), Look::plain(1));
    let cell = Cell::new(&layout, &recording);
    let scene = Scene::new(&cell, &look);
    let (size, picture) = light(&cell, &scene, 0, 0).unwrap();
    let lens = layout.cameras[0].intrinsics.as_ref().unwrap();
    let tag_from_camera = cell.pose(cell.tree.targets[0], cell.tree.cameras[0], 0).unwrap();
    let cells = cellmap::geometry::dictionary::Dictionary::Aruco6x6_250.cells(0).unwrap();
    let white_at = |pixel: Vector2<f64>| {
        let ray = tag_from_camera.rotation * lens.ray(&pixel).unwrap();
        let p = tag_from_camera.translation - ray * (tag_from_camera.translation.z / ray.z);
        let place = [p.x / 0.09 * 8.0 + 4.0, 4.0 - p.y / 0.09 * 8.0];
        let inside = place.iter().all(|v| (0.0..8.0).contains(v));
        !inside || cells[place[1] as usize * 8 + place[0] as usize]
    };
    let centre = lens.project(&(tag_from_camera.inverse() * Vector3::zeros())).unwrap();
    let (mut worst, mut edges) = (0.0f64, 0);
    for row in (centre.y as usize - 30..centre.y as usize + 30).step_by(3) {
        let start = row * size[0];
        let around: Vec<f32> = picture[start + centre.x as usize - 40..start + centre.x as usize + 40].to_vec();
        let (dark, bright) = (around.iter().copied().fold(9.0, f32::min), around.iter().copied().fold(0.0, f32::max));
        for column in centre.x as usize - 40..centre.x as usize + 40 {
            let corner = |x: f64, y: f64| white_at(Vector2::new(column as f64 + x, row as f64 + y));
            let four = [corner(-0.5, -0.5), corner(0.5, -0.5), corner(0.5, 0.5), corner(-0.5, 0.5)];
            if four.iter().all(|c| *c == four[0]) {
                continue;
            }
            let at = |i: usize| (i as f64 + 0.5) / 64.0 - 0.5;
            let sampled = (0..64 * 64).filter(|k| corner(at(k % 64), at(k / 64))).count() as f64 / 4096.0;
            let rendered = f64::from((picture[start + column] - dark) / (bright - dark));
            worst = worst.max((sampled - rendered).abs());
            edges += 1;
        }
    }
    println!("{edges} pixels on edges, worst {worst:.4}");
    assert!(edges > 100);
    // Shading across the tag and the sampling itself are some thousandths.
    assert!(worst < 0.004, "{worst}");
}
