//! Where the corners of each kind of target lie.

use cellmap::geometry::{Feature, Pose, TargetGeometry};
use nalgebra::Vector3;

fn at(geometry: &TargetGeometry, feature: Feature) -> [f64; 3] {
    geometry.place(&feature).unwrap().into()
}

#[test]
fn a_tags_corners_go_round_as_printed() {
    let tag = TargetGeometry::single_tag(5, 0.05);
    assert_eq!(at(&tag, Feature::TagCorner(5, 0)), [-0.025, 0.025, 0.0]);
    assert_eq!(at(&tag, Feature::TagCorner(5, 1)), [0.025, 0.025, 0.0]);
    assert_eq!(at(&tag, Feature::TagCorner(5, 2)), [0.025, -0.025, 0.0]);
    assert_eq!(at(&tag, Feature::TagCorner(5, 3)), [-0.025, -0.025, 0.0]);
    assert!(tag.place(&Feature::TagCorner(6, 0)).is_none());
    assert!(!tag.has(&Feature::TagCorner(5, 4)));
}

#[test]
fn a_grid_is_numbered_like_text_and_an_april_grid_like_kalibrs() {
    let grid = TargetGeometry::grid(2, 2, 0.1, 0.02, 10);
    // Tag 10 is top left, its top-left corner the highest and leftmost of all.
    let close = |place: [f64; 3], expected: [f64; 3]| (Vector3::from(place) - Vector3::from(expected)).norm() < 1e-12;
    assert!(close(at(&grid, Feature::TagCorner(10, 0)), [-0.11, 0.11, 0.0]));
    assert!(close(at(&grid, Feature::TagCorner(13, 2)), [0.11, -0.11, 0.0]));
    let april = TargetGeometry::april_grid(3, 2, 0.1, 0.5, 0);
    let near = |feature, expected: [f64; 3]| {
        let place = at(&april, feature);
        assert!((Vector3::from(place) - Vector3::from(expected)).norm() < 1e-12, "{place:?}");
    };
    near(Feature::TagCorner(0, 3), [0.0, 0.0, 0.0]);
    near(Feature::TagCorner(1, 3), [0.15, 0.0, 0.0]);
    near(Feature::TagCorner(3, 3), [0.0, 0.15, 0.0]);
    near(Feature::TagCorner(5, 1), [0.4, 0.25, 0.0]);
}

#[test]
fn the_faces_of_a_cube_look_outwards_and_stand_upright() {
    let cube = TargetGeometry::cube(0.1, 0.08, &[1, 2, 3, 4, 5, 6]);
    let TargetGeometry::Tags(faces) = &cube else { panic!("a cube is tags") };
    let normals =
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]];
    for (face, normal) in faces.iter().zip(normals) {
        let pose: Pose = face.target_from_tag.unwrap();
        assert!((pose.rotation * Vector3::z() - Vector3::from(normal)).norm() < 1e-12);
        assert!((pose.translation - Vector3::from(normal) * 0.05).norm() < 1e-12);
    }
    for face in &faces[..4] {
        let up = face.target_from_tag.unwrap().rotation * Vector3::y();
        assert!((up - Vector3::z()).norm() < 1e-12, "side tags have their top towards +z");
    }
}

#[test]
fn boards_and_points_are_found_by_number_and_name() {
    let board = TargetGeometry::Board { columns: 3, rows: 4, square: 0.05, numbered: false };
    assert_eq!(at(&board, Feature::BoardCorner(5)), [0.1, 0.05, 0.0]);
    assert!(board.place(&Feature::BoardCorner(12)).is_none());
    let points = TargetGeometry::Points(vec![("tip".into(), Some(Vector3::new(0.0, 0.0, 0.1))), ("ball".into(), None)]);
    assert!(points.place(&Feature::Point("ball".into())).is_none());
    assert!(points.has(&Feature::Point("ball".into())));
    assert!(!points.has(&Feature::Point("bull".into())));
}

#[test]
fn symmetries_are_those_that_colours_leave_open() {
    let turns =
        |columns, rows, numbered| TargetGeometry::Board { columns, rows, square: 1.0, numbered }.symmetries().len();
    assert_eq!(turns(3, 4, false), 1, "one odd, one even: the colours decide");
    assert_eq!(turns(6, 4, false), 2);
    assert_eq!(turns(5, 7, false), 2);
    assert_eq!(turns(4, 4, false), 4, "a square even board looks the same after a quarter turn");
    assert_eq!(turns(5, 5, false), 2);
    assert_eq!(turns(4, 6, true), 1, "a ChArUco board numbers itself");
    // Every numbering is a rigid turn of the board: distances stay.
    let board = TargetGeometry::Board { columns: 4, rows: 4, square: 1.0, numbered: false };
    let place = |i: u32| board.place(&Feature::BoardCorner(i)).unwrap();
    for map in board.symmetries() {
        for (i, j) in [(0u32, 1u32), (0, 4), (2, 13)] {
            let (a, b) = (map[i as usize], map[j as usize]);
            assert!(((place(i) - place(j)).norm() - (place(a) - place(b)).norm()).abs() < 1e-12);
        }
    }
}
