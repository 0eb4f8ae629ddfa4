//! Group laws and Jacobians of rotations and rigid transforms, at the identity, next to it, and everywhere.

use cellmap::geometry::pose::{left_jacobian, left_jacobian_inverse, parts, right_jacobian, right_jacobian_inverse};
use cellmap::geometry::{Pose, Twist, rotation};
use nalgebra::{Matrix3, Matrix6, Vector3};
use proptest::prelude::*;

/// Twists whose rotation stays short of pi, with the corners of the parameter space among them.
fn twists() -> impl Strategy<Value = Twist> {
    let scale =
        prop_oneof![Just(0.0), Just(1e-8), Just(1e-4), Just(0.1), Just(0.499), Just(0.501), Just(1.0), Just(1.7)];
    (scale, prop::array::uniform6(-1.0f64..1.0)).prop_map(|(scale, x)| Twist::from_row_slice(&x) * scale)
}

fn close(a: &Pose, b: &Pose) -> f64 {
    let (t, r) = (a.inverse() * *b).magnitude();
    t.max(r)
}

proptest! {
    #[test]
    fn exp_and_log_undo_each_other(x in twists()) {
        let back = Pose::exp(&x).log();
        prop_assert!((back - x).norm() < 1e-12 * (1.0 + x.norm()), "{back} {x}");
    }

    #[test]
    fn the_group_laws_hold(x in twists(), y in twists(), z in twists()) {
        let (a, b, c) = (Pose::exp(&x), Pose::exp(&y), Pose::exp(&z));
        prop_assert!(close(&((a * b) * c), &(a * (b * c))) < 1e-13);
        prop_assert!(close(&(a * a.inverse()), &Pose::identity()) < 1e-14);
        prop_assert!(close(&(a * Pose::identity()), &a) < 1e-15);
        let p = Vector3::new(0.3, -1.2, 2.0);
        prop_assert!(((a * b) * p - a * (b * p)).norm() < 1e-13);
    }

    #[test]
    fn the_adjoint_moves_a_twist_across(x in twists(), d in twists()) {
        let a = Pose::exp(&x);
        let d = d * 0.3;
        prop_assert!(close(&(a * Pose::exp(&d)), &(Pose::exp(&(a.adjoint() * d)) * a)) < 1e-12);
        prop_assert!((a.adjoint() * a.inverse_adjoint() - Matrix6::identity()).norm() < 1e-12);
    }

    #[test]
    fn jacobians_are_the_slopes_of_exp(x in twists()) {
        let (left, right) = (left_jacobian(&x), right_jacobian(&x));
        let h = 1e-6;
        for i in 0..6 {
            let mut d = Twist::zeros();
            d[i] = h;
            let (up, down) = (Pose::exp(&(x + d)), Pose::exp(&(x - d)));
            let numeric_right = (Pose::exp(&x).inverse() * up).log() - (Pose::exp(&x).inverse() * down).log();
            let numeric_left = (up * Pose::exp(&x).inverse()).log() - (down * Pose::exp(&x).inverse()).log();
            prop_assert!((numeric_right / (2.0 * h) - right.column(i)).norm() < 1e-8);
            prop_assert!((numeric_left / (2.0 * h) - left.column(i)).norm() < 1e-8);
        }
        prop_assert!((left * left_jacobian_inverse(&x) - Matrix6::identity()).norm() < 1e-11);
        prop_assert!((right * right_jacobian_inverse(&x) - Matrix6::identity()).norm() < 1e-11);
    }

    #[test]
    fn rotation_jacobians_invert(x in twists()) {
        let (_, phi) = parts(&x);
        prop_assert!((rotation::left_jacobian(&phi) * rotation::left_jacobian_inverse(&phi) - Matrix3::identity()).norm() < 1e-12);
        prop_assert!((rotation::right_jacobian(&phi) * rotation::right_jacobian_inverse(&phi) - Matrix3::identity()).norm() < 1e-12);
    }
}

#[test]
fn log_is_right_next_to_a_half_turn() {
    for angle in [3.0, 3.1, std::f64::consts::PI - 1e-9] {
        let v = Vector3::new(0.48, -0.6, 0.64) * angle;
        assert!((rotation::log(&rotation::exp(&v)) - v).norm() < 1e-9, "{angle}");
    }
}

#[test]
fn a_thousand_retractions_stay_on_the_group() {
    let mut pose = Pose::identity();
    for i in 0..1000 {
        let i = f64::from(i);
        pose = pose.retract(&Twist::new(0.01, 0.02, -0.01, i.sin(), i.cos(), 0.3));
    }
    assert!((pose.rotation.norm() - 1.0).abs() < 1e-15);
}

#[test]
fn the_nearest_rotation_forgives_scale_and_refuses_nonsense() {
    let turn = rotation::exp(&Vector3::new(0.3, -0.7, 1.1));
    let scaled = turn.to_rotation_matrix().into_inner() * 1.3;
    assert!(rotation::nearest_rotation(&scaled).unwrap().angle_to(&turn) < 1e-12);
    assert!(rotation::nearest_rotation(&Matrix3::zeros()).is_none());
    assert!(rotation::nearest_rotation(&Matrix3::repeat(f64::NAN)).is_none());
}

#[test]
fn rpy_is_urdfs() {
    // Roll about the fixed x, then pitch about the fixed y, then yaw about the fixed z.
    let r = rotation::from_rpy([0.1, 0.2, 0.3]);
    let turn = |axis: Vector3<f64>, angle: f64| rotation::exp(&(axis * angle));
    let expected = turn(Vector3::z(), 0.3) * turn(Vector3::y(), 0.2) * turn(Vector3::x(), 0.1);
    assert!(r.angle_to(&expected) < 1e-14);
}
