//! Lenses: derivatives against numbers, undistortion against projection, and honesty outside the domain.

use cellmap::geometry::lens::{Brown, KannalaBrandt, Lens, MAX_PARAMETERS, Pinhole, Projection, Rational};
use cellmap::geometry::{Intrinsics, IntrinsicsError, LensModel, UndistortError};
use nalgebra::{Vector2, Vector3};
use proptest::prelude::*;

const BROWN: [f64; 5] = [-0.21, 0.13, 0.0011, -0.0007, -0.04];
const RATIONAL: [f64; 8] = [0.4, 0.05, 0.0009, -0.0004, 0.01, 0.7, 0.12, 0.02];
const FISHEYE: [f64; 4] = [-0.012, 0.021, -0.017, 0.004];

fn parameters(distortion: &[f64]) -> [f64; MAX_PARAMETERS] {
    let mut p = [0.0; MAX_PARAMETERS];
    p[..4].copy_from_slice(&[910.0, 905.0, 640.4, 357.2]);
    p[4..4 + distortion.len()].copy_from_slice(distortion);
    p
}

/// Central differences of a lens against its own derivatives, relative to their size.
fn check<L: Lens>(p: &[f64; MAX_PARAMETERS], point: [f64; 3]) {
    let at: Projection = L::project_with_derivatives(p, &point).unwrap();
    let plain = L::project(p, &point).unwrap();
    assert!((plain[0] - at.pixel[0]).abs() + (plain[1] - at.pixel[1]).abs() < 1e-10);
    let near = |numeric: f64, analytic: f64, what: &str| {
        assert!(
            (numeric - analytic).abs() < 1e-6 * (1.0 + analytic.abs()),
            "{what}: {numeric} {analytic} at {point:?}"
        );
    };
    for axis in 0..3 {
        let h = 1e-6;
        let shifted = |s: f64| {
            let mut q = point;
            q[axis] += s;
            L::project(p, &q).unwrap()
        };
        let (up, down) = (shifted(h), shifted(-h));
        for i in 0..2 {
            near((up[i] - down[i]) / (2.0 * h), at.by_point[i][axis], "point");
        }
    }
    for k in 0..L::COUNT {
        let h = 1e-6 * (1.0 + p[k].abs());
        let shifted = |s: f64| {
            let mut q = *p;
            q[k] += s;
            L::project(&q, &point).unwrap()
        };
        let (up, down) = (shifted(h), shifted(-h));
        for i in 0..2 {
            near((up[i] - down[i]) / (2.0 * h), at.by_parameter[i][k], "parameter");
        }
    }
}

proptest! {
    #[test]
    fn derivatives_agree_with_differences(x in -0.7f64..0.7, y in -0.5f64..0.5, z in 0.4f64..3.0) {
        let point = [x * z, y * z, z];
        check::<Pinhole>(&parameters(&[]), point);
        check::<Brown>(&parameters(&BROWN), point);
        check::<Rational>(&parameters(&RATIONAL), point);
        check::<KannalaBrandt>(&parameters(&FISHEYE), point);
    }

    #[test]
    fn undistortion_undoes_projection(x in -0.6f64..0.6, y in -0.4f64..0.4) {
        let models = [
            (LensModel::Pinhole, &[][..]),
            (LensModel::Brown, &BROWN),
            (LensModel::Rational, &RATIONAL),
            (LensModel::KannalaBrandt, &FISHEYE),
        ];
        for (model, distortion) in models {
            let lens = Intrinsics::new(model, [1280, 720], [910.0, 905.0], [640.4, 357.2], distortion).unwrap();
            let pixel = lens.project(&Vector3::new(x, y, 1.0)).unwrap();
            let back = lens.undistort(&pixel).unwrap();
            prop_assert!((back - Vector2::new(x, y)).norm() < 1e-10, "{model:?} {back} {x} {y}");
        }
    }
}

#[test]
fn derivatives_hold_on_the_axis_and_far_off_it() {
    for point in [[0.0, 0.0, 1.0], [1e-8, -1e-8, 0.5], [1.5, 1.0, 1.0]] {
        check::<Pinhole>(&parameters(&[]), point);
        check::<Brown>(&parameters(&BROWN), point);
        check::<Rational>(&parameters(&RATIONAL), point);
    }
    // A fisheye divides by the distance from its axis, and sees sideways and backwards.
    for off in [0.0, 1e-300, 1e-160, 1e-12, 1e-8, 1e-6, 1e-4, 1e-3, 1e-2] {
        for z in [0.3, 1.0, 4.0] {
            check::<KannalaBrandt>(&parameters(&FISHEYE), [0.6 * off, -0.8 * off, z]);
            check::<KannalaBrandt>(&parameters(&[]), [off, 0.0, z]);
        }
    }
    for point in [[1.0, 0.2, 0.01], [1.0, 0.3, 0.0], [1.0, 0.3, -0.4]] {
        check::<KannalaBrandt>(&parameters(&FISHEYE), point);
    }
}

#[test]
fn derivatives_hold_at_the_edge_of_the_domain() {
    // A barrel distortion folds where r (1 + k1 r^2) turns back; next to it the slope along the radius nearly vanishes.
    let fold = 1.0 / (3.0f64 * 0.3).sqrt();
    for r in [0.9, 0.99, 0.9999].map(|share| share * fold) {
        check::<Brown>(&parameters(&[-0.3]), [0.6 * r, 0.8 * r, 1.0]);
    }
    // Next to a pole of the rational model's denominator, and close before the camera.
    let pole = 1.0 / 0.4f64.sqrt();
    check::<Rational>(&parameters(&[0.0, 0.0, 0.0, 0.0, 0.0, -0.4]), [0.9 * pole, 0.0, 1.0]);
    for z in [0.05, 0.01] {
        check::<Pinhole>(&parameters(&[]), [0.4 * z, -0.3 * z, z]);
        check::<Brown>(&parameters(&BROWN), [0.4 * z, -0.3 * z, z]);
        check::<Rational>(&parameters(&RATIONAL), [0.4 * z, -0.3 * z, z]);
        check::<KannalaBrandt>(&parameters(&FISHEYE), [0.4 * z, -0.3 * z, z]);
    }
}

#[test]
fn a_fisheye_gives_back_rays_beyond_ninety_degrees() {
    let lens =
        Intrinsics::new(LensModel::KannalaBrandt, [1200, 1200], [300.0, 300.0], [600.0, 600.0], &FISHEYE).unwrap();
    let ray = Vector3::new(1.0, 0.3, -0.2).normalize();
    let pixel = lens.project(&ray).unwrap();
    assert!((lens.ray(&pixel).unwrap() - ray).norm() < 1e-10);
    // On the plane in front of the camera that ray has no place.
    assert_eq!(lens.undistort(&pixel), Err(UndistortError::OutsideDomain));
}

#[test]
fn behind_the_lens_nothing_is_seen() {
    for model in [LensModel::Pinhole, LensModel::Brown, LensModel::Rational] {
        let zeros = vec![0.0; model.distortion_count()];
        let lens = Intrinsics::new(model, [640, 480], [500.0, 500.0], [320.0, 240.0], &zeros).unwrap();
        assert!(lens.project(&Vector3::new(0.1, 0.1, -1.0)).is_none());
        assert!(lens.project(&Vector3::new(0.1, 0.1, 0.0)).is_none());
    }
}

#[test]
fn undistortion_says_where_its_domain_ends() {
    // With k1 = -0.3 the image ends at r = 1/sqrt(0.9): no ray reaches further out.
    let lens =
        Intrinsics::new(LensModel::Brown, [1280, 720], [600.0, 600.0], [640.0, 360.0], &[-0.3, 0.0, 0.0, 0.0, 0.0])
            .unwrap();
    let limit: f64 = 1.0 / 0.9f64.sqrt();
    let rim = limit * (1.0 - 0.3 * limit * limit);
    assert!(lens.undistort(&Vector2::new(640.0 + 600.0 * rim * 0.999, 360.0)).is_ok());
    assert_eq!(lens.undistort(&Vector2::new(640.0 + 600.0 * rim * 1.01, 360.0)), Err(UndistortError::OutsideDomain));
    // And a point beyond the fold, which the bare polynomial would put back inside the picture, is not seen.
    assert!(lens.project(&Vector3::new(1.5 * limit, 0.0, 1.0)).is_none());
}

#[test]
fn impossible_intrinsics_are_refused() {
    let make = |size, focal, centre, k: &[f64]| Intrinsics::new(LensModel::Brown, size, focal, centre, k);
    let good = [0.0; 5];
    assert_eq!(make([0, 10], [1.0, 1.0], [0.0, 0.0], &good), Err(IntrinsicsError::Size(0, 10)));
    assert_eq!(make([10, 10], [1.0, -2.0], [0.0, 0.0], &good), Err(IntrinsicsError::Focal(-2.0)));
    assert_eq!(make([10, 10], [1.0, 2.0], [f64::NAN, 0.0], &good), Err(IntrinsicsError::NotFinite("principal point")));
    let words = make([10, 10], [1.0, 2.0], [0.0, 0.0], &[0.0; 4]).unwrap_err().to_string();
    assert_eq!(words, "the model `brown` takes 5 distortion coefficients, not 4");
}
