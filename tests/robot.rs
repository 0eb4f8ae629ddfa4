//! Chains: the three conventions, their derivatives, and the built-in models.

use cellmap::geometry::{Pose, Twist};
use cellmap::layout::{builtin, parse_model};
use cellmap::robot::{Chain, JointKind, Link, LinkShape, PARAMETERS_PER_LINK, urdf};
use nalgebra::Vector3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::{FRAC_PI_2, PI};
use std::path::{Path, PathBuf};

fn chain(links: Vec<Link>) -> Chain {
    Chain {
        base_from_first: Pose::exp(&Twist::new(0.1, -0.2, 0.3, 0.2, 0.1, -0.4)),
        links,
        last_from_flange: Pose::exp(&Twist::new(0.0, 0.05, 0.1, -0.3, 0.2, 0.6)),
    }
}

/// Six links of one convention, one of them sliding.
fn mixed(shape: impl Fn(f64) -> LinkShape) -> Chain {
    let link = |i: usize| Link {
        shape: shape(i as f64),
        joint: if i == 2 { JointKind::Prismatic } else { JointKind::Revolute },
    };
    chain((0..6).map(link).collect())
}

fn all() -> Vec<Chain> {
    let numbers = |i: f64| [0.3 * i - 0.7, 0.2 - 0.05 * i, 0.4 * i, 0.1 + 0.02 * i];
    vec![
        mixed(|i| LinkShape::Mdh(numbers(i))),
        mixed(|i| LinkShape::Dh(numbers(i))),
        mixed(|i| LinkShape::Urdf {
            origin: Pose::exp(&Twist::new(0.1, 0.02 * i, 0.2, 0.3, -0.2 * i, 0.1)),
            axis: Vector3::new(0.2, -0.5 + 0.1 * i, 0.8).normalize(),
        }),
    ]
}

const JOINTS: [f64; 6] = [0.3, -1.1, 0.25, 0.9, -0.4, 2.0];

/// Where derivatives are looked at: anywhere, at rest, next to it, with axes in line and turned by half and whole turns.
fn places() -> Vec<[f64; 6]> {
    let mut random = ChaCha8Rng::seed_from_u64(6);
    let mut all = vec![JOINTS, [0.0; 6], [1e-9; 6], [0.0, -FRAC_PI_2, 0.1, -FRAC_PI_2, 1e-12, 0.0], [PI; 6]];
    all.push([2.0 * PI, -PI, 0.0, 1e-7, -1e-7, 50.0]);
    all.extend((0..8).map(|_| std::array::from_fn(|_| random.random_range(-3.0..3.0))));
    all
}

#[test]
fn parameter_jacobians_agree_with_differences() {
    for (chain, joints) in all().iter().flat_map(|chain| places().into_iter().map(move |joints| (chain, joints))) {
        let count = chain.joint_count() * PARAMETERS_PER_LINK;
        let wanted: Vec<usize> = (0..count).collect();
        for corrections in [vec![0.0; count], (0..count).map(|i| 0.003 * (i as f64).sin()).collect()] {
            for (from, to) in [(0, 7), (2, 5), (0, 3), (4, 7)] {
                let (pose, jacobian) = chain.segment_with_parameters(&joints, &corrections, from, to, &wanted);
                assert_eq!(pose, chain.segment(&joints, &corrections, from, to));
                for k in 0..count {
                    let h = 1e-5;
                    let shifted = |s: f64| {
                        let mut c = corrections.clone();
                        c[k] += s;
                        (pose.inverse() * chain.segment(&joints, &c, from, to)).log()
                    };
                    let numeric = (shifted(h) - shifted(-h)) / (2.0 * h);
                    let off = (numeric - jacobian.column(k)).norm();
                    assert!(off < 1e-8, "parameter {k} from {from} to {to} at {joints:?}: {off}");
                }
            }
        }
    }
}

#[test]
fn joint_jacobians_agree_with_differences() {
    for (chain, joints) in all().iter().flat_map(|chain| places().into_iter().map(move |joints| (chain, joints))) {
        let jacobian = chain.joint_jacobian(&joints);
        let pose = chain.base_from_flange(&joints);
        for k in 0..6 {
            let h = 1e-5;
            let shifted = |s: f64| {
                let mut q = joints;
                q[k] += s;
                (pose.inverse() * chain.base_from_flange(&q)).log()
            };
            let off = ((shifted(h) - shifted(-h)) / (2.0 * h) - jacobian.column(k)).norm();
            assert!(off < 1e-8, "joint {k} at {joints:?}: {off}");
        }
    }
}

#[test]
fn segments_compose() {
    for chain in all() {
        let whole = chain.base_from_flange(&JOINTS);
        let split = chain.segment(&JOINTS, &[], 0, 3) * chain.segment(&JOINTS, &[], 3, 7);
        assert!((whole.inverse() * split).magnitude().0 < 1e-14);
    }
}

#[test]
fn mdh_is_the_papers_equation() {
    // A = Rx(alpha) Tx(a) Rz(theta + q) Tz(d)
    let link = Link { shape: LinkShape::Mdh([0.5, 0.2, 0.1, 0.3]), joint: JointKind::Revolute };
    let one = Chain { base_from_first: Pose::identity(), links: vec![link], last_from_flange: Pose::identity() };
    let turn = |x: f64, z: f64| Pose::from_rotation_vector(&Vector3::new(x, 0.0, z));
    let expected = turn(0.5, 0.0)
        * Pose::from_translation(0.2, 0.0, 0.0)
        * turn(0.0, 0.1 + 0.7)
        * Pose::from_translation(0.0, 0.0, 0.3);
    assert!((expected.inverse() * one.base_from_flange(&[0.7])).magnitude().0 < 1e-15);
}

#[test]
fn built_in_robots_read_and_reach_what_their_makers_say() {
    // Universal Robots' working radius, mm, plus the wrist beyond it.
    let reach = [("ur3", 500.0), ("ur5", 850.0), ("ur10", 1300.0), ("ur3e", 500.0), ("ur5e", 850.0), ("ur10e", 1300.0)];
    for name in builtin::robot_names() {
        let text = builtin::robot_model(name).unwrap();
        let chain = parse_model(Path::new(name), text, Some("mdh")).unwrap();
        assert_eq!(chain.joint_count(), 6);
        if let Some((_, radius)) = reach.iter().find(|(known, _)| *known == name) {
            let bound = chain.reach() * 1e3;
            assert!(bound > *radius && bound < 2.0 * radius, "{name}: {bound}");
        }
    }
}

#[test]
fn the_urdf_and_the_mdh_of_one_robot_agree() {
    let folder = PathBuf::from("../shared/data/robots");
    if !folder.is_dir() {
        println!("skipped: no recordings");
        return;
    }
    for name in ["kr16_2", "kr210l150", "lbr_iiwa_14_r820"] {
        let by_urdf = urdf::read_chain(&folder.join(format!("kuka/{name}.urdf")), "base_link", "tool0").unwrap();
        let path = folder.join(format!("{name}_mdh.yaml"));
        let by_mdh = parse_model(&path, &std::fs::read_to_string(&path).unwrap(), None).unwrap();
        let joints: Vec<f64> = (0..by_mdh.joint_count()).map(|i| 0.7 * (i as f64 + 1.0).sin()).collect();
        let (t, r) = (by_urdf.base_from_flange(&joints).inverse() * by_mdh.base_from_flange(&joints)).magnitude();
        assert!(t < 1e-8 && r < 1e-8, "{name}: {t} {r}");
    }
    for name in builtin::robot_names() {
        let path = folder.join(format!("{name}_mdh.yaml"));
        let theirs = parse_model(&path, &std::fs::read_to_string(&path).unwrap(), None).unwrap();
        let ours = parse_model(Path::new(name), builtin::robot_model(name).unwrap(), None).unwrap();
        let (t, r) = (theirs.base_from_flange(&JOINTS).inverse() * ours.base_from_flange(&JOINTS)).magnitude();
        assert!(t < 1e-9 && r < 1e-9, "{name}: {t} {r}");
    }
}
