//! One picture of a large cell: the two robots' table, by a fixed camera and by the one on a wrist, as it is and with nothing around it; then how long the lens and the file take.

use cellmap::layout::parse_layout;
use cellmap::recording::{Recording, RobotMotion};
use cellmap::simulate::Cell;
use cellmap::simulate::render::{Exposure, Look, PictureFormat, Scene, encode, light, render};
use criterion::{Criterion, criterion_group, criterion_main};
use std::collections::BTreeMap;

const LAYOUT: &str = include_str!("../layouts/two_robots.yaml");

fn pictures(criterion: &mut Criterion) {
    let Ok(layout) = parse_layout("two_robots.yaml".as_ref(), LAYOUT, None) else { return };
    let stand = |joints: [f64; 6]| RobotMotion::Joints(BTreeMap::from([(1, joints.to_vec())]));
    let motions = vec![stand([0.2, -1.1, 1.5, -1.9, -1.5, 0.3]), stand([-0.3, -1.3, 1.6, -1.7, -1.2, 1.0])];
    let recording = Recording { motions, ..Recording::default() };
    let cell = Cell::new(&layout, &recording);
    let mut group = criterion.benchmark_group("render");
    group.sample_size(10);
    for (kind, look) in [("plain", Look::plain(7)), ("full", Look::full(7))] {
        let scene = Scene::new(&cell, &look);
        for (name, camera) in [("fixed_1280x1024", 0), ("wrist_1280x960", 4)] {
            group.bench_function(format!("{kind}_{name}"), |bencher| {
                bencher.iter(|| render(&cell, &scene, camera, 1, 0, &Exposure::default()));
            });
        }
    }
    let scene = Scene::new(&cell, &Look::full(7));
    if let Some((size, before)) = light(&cell, &scene, 0, 1) {
        group.bench_function("exposure_1280x1024", |bencher| {
            bencher.iter(|| Exposure::default().take(size, before.clone(), 1));
        });
    }
    if let Some(picture) = render(&cell, &scene, 0, 1, 0, &Exposure::default()) {
        for (name, format) in [("png", PictureFormat::Png), ("jpeg", PictureFormat::Jpeg(92))] {
            group.bench_function(format!("{name}_1280x1024"), |bencher| {
                bencher.iter(|| encode(&picture, format).map(|bytes| bytes.len()));
            });
        }
    }
    group.finish();
}

criterion_group!(benches, pictures);
criterion_main!(benches);
