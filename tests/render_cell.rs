//! Whole pictures: the same bits however they are made, and things where a person expects them.

use cellmap::geometry::target::tag_corners;
use cellmap::layout::{Layout, parse_layout};
use cellmap::recording::{Recording, RobotMotion};
use cellmap::simulate::Cell;
use cellmap::simulate::render::{Exposure, Look, PictureFormat, Scene, encode, light, render};
use rayon::prelude::*;
use std::collections::BTreeMap;

const DEMO: &str = include_str!("../layouts/demo.yaml");

fn motion() -> Recording {
    let stops =
        [[-1.9, -1.75, 1.9, -1.7, -1.55, 0.4], [-2.1, -1.6, 1.7, -1.6, -1.4, 0.9], [-1.7, -1.9, 2.0, -1.8, -1.6, -0.5]];
    let joints: BTreeMap<u64, Vec<f64>> = stops.iter().enumerate().map(|(i, q)| (i as u64 + 1, q.to_vec())).collect();
    Recording { motions: vec![RobotMotion::Joints(joints)], ..Recording::default() }
}

fn small_demo() -> Layout {
    // A quarter of the size, so that the test is quick: all sizes and focal lengths by two.
    let text = DEMO
        .replace(
            "size: [1280, 720], focal: [1100, 1100], centre: [640.3, 358.9]",
            "size: [640, 360], focal: [550, 550], centre: [320, 180]",
        )
        .replace(
            "size: [1280, 720], focal: [1085, 1086], centre: [637.8, 361.5]",
            "size: [640, 360], focal: [543, 543], centre: [318, 181]",
        )
        .replace(
            "size: [960, 600], focal: [760, 760], centre: [479.5, 299.5]",
            "size: [480, 300], focal: [380, 380], centre: [239, 149]",
        );
    parse_layout("demo.yaml".as_ref(), &text, None).unwrap()
}

#[test]
fn the_same_bits_on_any_number_of_threads_and_in_any_order() {
    let (layout, recording) = (small_demo(), motion());
    let cell = Cell::new(&layout, &recording);
    let work: Vec<(usize, u64, u64)> =
        (0..3).flat_map(|c| (1..=3).flat_map(move |k| (0..2).map(move |s| (c, k, s)))).collect();
    let shoot = |scene: &Scene, &(camera, stop, shot): &(usize, u64, u64)| {
        render(&cell, scene, camera, stop, shot, &Exposure::default()).unwrap()
    };
    let scene = Scene::new(&cell, &Look::full(3));
    let forwards: Vec<_> = work.iter().map(|item| shoot(&scene, item)).collect();
    let again = Scene::new(&cell, &Look::full(3));
    let mut backwards: Vec<_> = work.iter().rev().map(|item| shoot(&again, item)).collect();
    backwards.reverse();
    let shared = Scene::new(&cell, &Look::full(3));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    let parallel: Vec<_> = pool.install(|| work.par_iter().map(|item| shoot(&shared, item)).collect());
    assert!(forwards == backwards && forwards == parallel);
    // Shots differ by their noise only, configurations by more, other seeds by everything.
    assert_ne!(forwards[0], forwards[1]);
    let quiet = |stop, shot| render(&cell, &scene, 0, stop, shot, &Exposure::perfect()).unwrap();
    assert_eq!(quiet(1, 0), quiet(1, 1));
    assert_ne!(quiet(1, 0), quiet(2, 0));
    let other = Scene::new(&cell, &Look::full(4));
    assert_ne!(quiet(1, 0), render(&cell, &other, 0, 1, 0, &Exposure::perfect()).unwrap());
}

#[test]
fn clutter_never_hides_a_target() {
    let (layout, recording) = (small_demo(), motion());
    let cell = Cell::new(&layout, &recording);
    for seed in 0..3 {
        let bare = Look { clutter: false, shadows: false, ..Look::full(seed) };
        let scenes = [Scene::new(&cell, &bare), Scene::new(&cell, &Look { clutter: true, ..bare })];
        for (camera, described) in layout.cameras.iter().enumerate() {
            let lens = described.intrinsics.as_ref().unwrap();
            for stop in 1..=3 {
                let [without, with] = scenes.each_ref().map(|scene| light(&cell, scene, camera, stop).unwrap().1);
                let changed = without.iter().zip(&with).filter(|(a, b)| a != b).count();
                let mut looked = 0;
                for (target, frame) in layout.targets.iter().zip(&cell.tree.targets) {
                    let cellmap::geometry::TargetGeometry::Tags(faces) = &target.geometry else { continue };
                    let pose = cell.pose(cell.tree.cameras[camera], *frame, stop).unwrap();
                    for face in faces {
                        let place = pose * face.target_from_tag.unwrap();
                        if (place.rotation * nalgebra::Vector3::z()).dot(&place.translation) > 0.0 {
                            continue;
                        }
                        for corner in tag_corners(face.size) {
                            let Some(at) = lens.project(&(place * (corner * 0.99))) else { continue };
                            let [w, h] = lens.size().map(f64::from);
                            if at.x < 0.0 || at.y < 0.0 || at.x > w - 1.0 || at.y > h - 1.0 {
                                continue;
                            }
                            let index = at.y as usize * w as usize + at.x as usize;
                            looked += 1;
                            let apart = (without[index] - with[index]).abs();
                            assert!(apart < 1e-3, "seed {seed} camera {camera} stop {stop} at {at:?}");
                        }
                    }
                }
                assert!(
                    camera == 2 || (looked > 0 && changed > 100),
                    "camera {camera}: {looked} corners, {changed} pixels"
                );
            }
        }
    }
}

#[test]
fn a_robot_hides_what_is_behind_it_and_darkens_what_is_under_it() {
    let (layout, recording) = (small_demo(), motion());
    let cell = Cell::new(&layout, &recording);
    let still = Recording::default();
    let empty = Cell::new(&layout, &still);
    let look = Look { clutter: false, ..Look::full(1) };
    let (_, with) = light(&cell, &Scene::new(&cell, &look), 0, 1).unwrap();
    let (_, without) = light(&empty, &Scene::new(&empty, &look), 0, 1).unwrap();
    let darker = with.iter().zip(&without).filter(|(a, b)| **a < 0.8 * **b).count();
    let brighter = with.iter().zip(&without).filter(|(a, b)| **a > 1.2 * **b).count();
    let same = with.iter().zip(&without).filter(|(a, b)| a == b).count();
    assert!(darker > 2000 && brighter > 500 && same > with.len() / 3, "{darker} {brighter} {same}");
}

#[test]
fn a_camera_that_is_nowhere_takes_no_picture() {
    let (layout, recording) = (small_demo(), motion());
    let cell = Cell::new(&layout, &recording);
    let scene = Scene::new(&cell, &Look::full(1));
    assert!(render(&cell, &scene, 2, 99, 0, &Exposure::default()).is_none(), "no joint values at configuration 99");
    assert!(render(&cell, &scene, 7, 1, 0, &Exposure::default()).is_none(), "no camera 7");
    assert!(
        render(&cell, &scene, 0, 99, 0, &Exposure::default()).is_some(),
        "a fixed camera sees the room all the same"
    );
}

#[test]
fn files_hold_the_picture() {
    let (layout, recording) = (small_demo(), motion());
    let cell = Cell::new(&layout, &recording);
    let picture = render(&cell, &Scene::new(&cell, &Look::full(1)), 0, 1, 0, &Exposure::default()).unwrap();
    let dir = tempfile::tempdir().unwrap();
    for name in ["a.png", "a.pgm", "a.jpg"] {
        let format = PictureFormat::of_name(name).unwrap();
        std::fs::write(dir.path().join(name), encode(&picture, format).unwrap()).unwrap();
        let read = cellmap::detect::GreyPicture::read(&dir.path().join(name), Some([640, 360])).unwrap();
        let apart = read.pixels().iter().zip(picture.pixels()).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
        assert!(if name == "a.jpg" { apart < 30 } else { apart == 0 }, "{name}: {apart}");
    }
    assert_eq!(PictureFormat::of_name("a.webp"), None);
}
