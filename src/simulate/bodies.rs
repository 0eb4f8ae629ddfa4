//! The bodies of robots as capsules, both to draw them and to keep them from running into things.
//!
//! A chain says where its joint axes are, not what the castings between them look like. Each link is drawn as the shortest body that such a chain can
//! have: along its own joint axis, then across to the next one. Where two long links turn about parallel axes and a later offset along these axes brings
//! the arm back (every UR, every SCARA-like elbow), the first of them is drawn beside the second, as it is built: otherwise upper arm and
//! forearm would fold into each other.

use nalgebra::Vector3;

use crate::frames::{FrameId, FrameTree};
use crate::geometry::Pose;
use crate::layout::{Layout, Motion};
use crate::robot::{Chain, JointKind, LinkShape};

/// A ball swept along a segment whose ends hang on frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Capsule {
    /// The frames of the two ends; the same frame unless a sliding joint lies between them.
    pub frames: [FrameId; 2],
    /// The ends of the segment in their frames, m.
    pub ends: [Vector3<f64>; 2],
    /// Radius, m.
    pub radius: f64,
    /// Which link it belongs to: 0 is the base, the last the flange's; capsules of neighbouring links touch always.
    pub link: usize,
}

/// A capsule whose ends are in one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlacedCapsule {
    /// The ends of the segment, m.
    pub ends: [Vector3<f64>; 2],
    /// Radius, m.
    pub radius: f64,
}

impl Capsule {
    /// The capsule in one frame, given `that_from_frame` of each frame; `None` where one of them is not known.
    pub fn place(&self, mut that_from: impl FnMut(FrameId) -> Option<Pose>) -> Option<PlacedCapsule> {
        let a = that_from(self.frames[0])?;
        let b = if self.frames[1] == self.frames[0] { a } else { that_from(self.frames[1])? };
        Some(PlacedCapsule { ends: [a * self.ends[0], b * self.ends[1]], radius: self.radius })
    }
}

impl PlacedCapsule {
    /// The free space between two capsules, m; negative if they overlap.
    #[must_use]
    pub fn clearance(&self, other: &Self) -> f64 {
        segment_distance(&self.ends, &other.ends) - self.radius - other.radius
    }

    /// The free space above a plane through `point` with unit `normal`, m; negative if the capsule dips below it.
    #[must_use]
    pub fn clearance_above(&self, point: &Vector3<f64>, normal: &Vector3<f64>) -> f64 {
        let height = |end: &Vector3<f64>| (end - point).dot(normal);
        height(&self.ends[0]).min(height(&self.ends[1])) - self.radius
    }
}

/// The distance between two segments, m; a segment may be a point.
///
/// Source: Ericson, Real-Time Collision Detection (2005), section 5.1.9.
#[must_use]
pub fn segment_distance(first: &[Vector3<f64>; 2], second: &[Vector3<f64>; 2]) -> f64 {
    let (d1, d2, r) = (first[1] - first[0], second[1] - second[0], first[0] - second[0]);
    let (a, e, b) = (d1.norm_squared(), d2.norm_squared(), d1.dot(&d2));
    let (c, f) = (d1.dot(&r), d2.dot(&r));
    // Divisions by the squared length of a point give no place on it: its only place is 0.
    let along = |numerator: f64, denominator: f64| {
        if denominator > 1e-18 { (numerator / denominator).clamp(0.0, 1.0) } else { 0.0 }
    };
    let mut s = if a * e - b * b > 1e-12 * a * e { along(b * f - c * e, a * e - b * b) } else { 0.0 };
    let mut t = if e > 1e-18 { (b * s + f) / e } else { 0.0 };
    if !(0.0..=1.0).contains(&t) || e <= 1e-18 {
        t = t.clamp(0.0, 1.0);
        s = along(b * t - c, a);
    }
    (first[0] + d1 * s - second[0] - d2 * t).norm()
}

/// A link's body in its own frame: along its joint axis from `entry` to `corner`, then across to `exit` on the next axis.
struct Body {
    entry: Vector3<f64>,
    corner: Vector3<f64>,
    exit: Vector3<f64>,
    axis: Vector3<f64>,
    exit_axis: Vector3<f64>,
    slides: bool,
}

/// A link this much of the reach long is one of the arm's two long ones.
const LONG: f64 = 0.12;
/// Radius at the base and at the flange, as parts of the reach.
const THICK: [f64; 2] = [0.055, 0.034];
/// Reach (m) supposed of a robot whose flange is known but not its links.
const STAND_IN_REACH: f64 = 1.0;

/// The capsules of a robot, from its base to its flange.
#[must_use]
pub fn robot_capsules(layout: &Layout, tree: &FrameTree, robot: usize) -> Vec<Capsule> {
    let frames = &tree.robots[robot];
    let (Some(&base), Some(&flange)) = (frames.first(), frames.last()) else { return Vec::new() };
    let one = |frame, from, to, radius, link| Capsule { frames: [frame; 2], ends: [from, to], radius, link };
    let up = |height: f64| Vector3::new(0.0, 0.0, height);
    let Motion::Joints { chain, .. } = &layout.robots[robot].motion else {
        let radius = THICK[1] * STAND_IN_REACH;
        let pedestal = THICK[0] * STAND_IN_REACH;
        return vec![
            one(base, up(0.0), up(pedestal), 1.2 * pedestal, 0),
            one(flange, up(-4.0 * radius), up(-radius), radius, 1),
        ];
    };
    let reach = chain.reach();
    let count = chain.joint_count();
    let thickness = |link: usize| {
        let part = link.saturating_sub(1) as f64 / count.saturating_sub(1).max(1) as f64;
        reach * (THICK[0] + part * (THICK[1] - THICK[0]))
    };
    let bodies = bodies(chain);
    let mut capsules = Vec::new();
    // The pedestal on which the first link turns.
    let foot = bodies[0].exit;
    let height = (0.45 * foot.norm()).min(0.5 * reach * THICK[0]);
    let rise = if foot.norm() > 1e-6 { foot.normalize() * height } else { Vector3::zeros() };
    capsules.push(one(base, Vector3::zeros(), rise, 1.2 * thickness(0), 0));
    for (link, body) in bodies.iter().enumerate().skip(1) {
        let frame = frames[link];
        let radius = thickness(link);
        let beside = body.axis * offset_beside(&bodies, link, LONG * reach);
        let mut add = |frames: [FrameId; 2], from: Vector3<f64>, to: Vector3<f64>| {
            if frames[0] != frames[1] || (to - from).norm() > 0.2 * radius {
                capsules.push(Capsule { frames, ends: [from, to], radius, link });
            }
        };
        if body.slides {
            add([frames[link - 1], frame], bodies[link - 1].exit, body.corner);
        } else {
            add([frame; 2], body.entry, body.corner + beside);
        }
        let is_last = link == count;
        let end = if is_last { chain.last_from_flange.translation } else { body.exit };
        add([frame; 2], body.corner + beside, end + beside);
        add([frame; 2], end + beside, end);
    }
    shorten_last(&mut capsules);
    capsules
}

/// The last capsule ends flat at the flange in reality: its round end must not reach into the tool.
fn shorten_last(capsules: &mut [Capsule]) {
    let Some(last) = capsules.last_mut().filter(|last| last.link > 0 && last.frames[0] == last.frames[1]) else {
        return;
    };
    let along = last.ends[1] - last.ends[0];
    let length = along.norm();
    if length > 1e-9 {
        last.ends[1] -= along * (last.radius.min(0.7 * length) / length);
    }
}

/// How far along its axis a long link is drawn beside the next long one: the offset that later brings the arm back.
fn offset_beside(bodies: &[Body], link: usize, long: f64) -> f64 {
    let (Some(own), Some(next), Some(after)) = (bodies.get(link), bodies.get(link + 1), bodies.get(link + 2)) else {
        return 0.0;
    };
    let across = |body: &Body| (body.exit - body.corner).norm();
    let parallel = |body: &Body| body.axis.dot(&body.exit_axis) > 0.9999;
    let along = |body: &Body| (body.corner - body.entry).dot(&body.axis);
    let folds = across(own) > long && across(next) > long && parallel(own) && parallel(next);
    let straight = along(next).abs() < 1e-6 && !own.slides && !next.slides && !after.slides;
    if folds && straight { along(after) } else { 0.0 }
}

/// The bodies of all links, the base's first.
fn bodies(chain: &Chain) -> Vec<Body> {
    let zero = Vector3::zeros();
    let z = Vector3::z();
    let turned = |alpha: f64| Vector3::new(0.0, -alpha.sin(), alpha.cos());
    let mut bodies = vec![Body { entry: zero, corner: zero, exit: zero, axis: z, exit_axis: z, slides: false }];
    for (place, link) in chain.links.iter().enumerate() {
        // What the previous body ends with, and what the new one begins with.
        let (exit, exit_axis, entry, corner, axis) = match link.shape {
            LinkShape::Mdh([alpha, a, _, d]) => (Vector3::x() * a, turned(alpha), z * -d, zero, z),
            LinkShape::Dh([alpha, a, _, d]) => {
                let axis = turned(-alpha);
                let corner = Vector3::x() * -a;
                (zero, z, corner - axis * d, corner, axis)
            }
            LinkShape::Urdf { origin, axis } => {
                let exit_axis = origin.rotation * axis;
                let along = origin.translation.dot(&exit_axis);
                (origin.translation - exit_axis * along, exit_axis, axis * -along, zero, axis)
            }
        };
        let base = if place == 0 { chain.base_from_first } else { Pose::identity() };
        if let Some(previous) = bodies.last_mut() {
            previous.exit = base * exit;
            previous.exit_axis = base.rotation * exit_axis;
        }
        let slides = link.joint == JointKind::Prismatic;
        bodies.push(Body { entry, corner, exit: zero, axis, exit_axis: axis, slides });
    }
    // The base's body goes up to where the first link's begins to turn.
    if let (Some(first), Some(LinkShape::Mdh([.., d]) | LinkShape::Dh([.., d]))) =
        (bodies.first_mut(), chain.links.first().map(|link| link.shape))
        && d.abs() > 1e-9
    {
        first.exit += first.exit_axis * (0.5 * d);
    }
    bodies
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layout::parse_layout;

    /// Deterministic numbers in -1..1.
    fn numbers(count: usize) -> Vec<f64> {
        let mut state = 12345u64;
        let mut next = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        };
        (0..count).map(|_| next()).collect()
    }

    fn brute(first: &[Vector3<f64>; 2], second: &[Vector3<f64>; 2]) -> f64 {
        let n = 400;
        let on = |s: &[Vector3<f64>; 2], i: usize| s[0] + (s[1] - s[0]) * (i as f64 / n as f64);
        let pairs = (0..=n).flat_map(|i| (0..=n).map(move |j| (i, j)));
        pairs.map(|(i, j)| (on(first, i) - on(second, j)).norm()).fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn distances_agree_with_brute_force() {
        let random = numbers(12 * 60);
        for (case, v) in random.chunks(12).enumerate() {
            let p = |i: usize| Vector3::new(v[3 * i], v[3 * i + 1], v[3 * i + 2]);
            let mut pair = [[p(0), p(1)], [p(2), p(3)]];
            match case % 5 {
                1 => pair[0][1] = pair[0][0],
                2 => pair[1][1] = pair[1][0],
                3 => pair[1][1] = pair[1][0] + (pair[0][1] - pair[0][0]) * v[11],
                4 => pair = [[p(0), p(0)], [p(1), p(1)]],
                _ => {}
            }
            let (exact, sampled) = (segment_distance(&pair[0], &pair[1]), brute(&pair[0], &pair[1]));
            assert!(exact <= sampled + 1e-12 && sampled - exact < 0.02, "case {case}: {exact} {sampled}");
            assert!((exact - segment_distance(&pair[1], &pair[0])).abs() < 1e-12);
            let capsules = pair.map(|ends| PlacedCapsule { ends, radius: 0.1 });
            assert!((capsules[0].clearance(&capsules[1]) - (exact - 0.2)).abs() < 1e-12);
            let (point, normal) = (p(2), (p(3) - p(0)).normalize());
            let lowest =
                (0..=50).map(|i| (pair[0][0] + (pair[0][1] - pair[0][0]) * (f64::from(i) / 50.0) - point).dot(&normal));
            let lowest = lowest.fold(f64::INFINITY, f64::min) - 0.1;
            assert!((capsules[0].clearance_above(&point, &normal) - lowest).abs() < 1e-12);
        }
    }

    fn capsules_of(model: &str) -> (Vec<Capsule>, FrameTree) {
        let text = format!(
            "cellmap: 1\nunits: {{length: mm, angle: deg}}\nworld: eye\ncameras:\n  eye: {{intrinsics: {{model: pinhole, size: [64, 48], \
             focal: [60, 60], centre: [31.5, 23.5]}}}}\nrobots:\n  arm: {{{model}}}\ntargets:\n  board: {{tags: {{dictionary: 6x6_250, \
             size: 50, ids: [0]}}, mount: arm.flange}}\n"
        );
        let layout = parse_layout("x.yaml".as_ref(), &text, None).unwrap();
        let tree = FrameTree::new(&layout);
        (robot_capsules(&layout, &tree, 0), tree)
    }

    #[test]
    fn an_upper_arm_lies_beside_the_forearm() {
        let (capsules, tree) = capsules_of("model: ur5e, joints: j.csv");
        let of = |link: usize| capsules.iter().filter(move |c| c.link == link).collect::<Vec<_>>();
        assert_eq!(of(2).len(), 3, "shoulder, upper arm, elbow");
        assert_eq!(of(2)[1].ends, [Vector3::new(0.0, 0.0, 0.1333), Vector3::new(-0.425, 0.0, 0.1333)]);
        assert_eq!(of(3)[0].ends, [Vector3::zeros(), Vector3::new(-0.3922, 0.0, 0.0)]);
        assert_eq!(of(4)[0].frames[0], tree.robots[0][4]);
        // Folded back on itself, the arm does not run into itself: the two long links pass beside each other.
        let gap = 0.1333 - of(2)[1].radius - of(3)[0].radius;
        assert!(gap > 0.0, "{gap}");
        let last = capsules.last().unwrap();
        assert!(last.ends[1].z <= -0.5 * last.radius, "the round end stays behind the flange: {last:?}");
    }

    #[test]
    fn every_built_in_robot_has_a_body_of_one_piece() {
        for name in crate::layout::builtin::robot_names() {
            let (capsules, _) = capsules_of(&format!("model: {name}, joints: j.csv"));
            for link in 0..=6 {
                assert!(capsules.iter().any(|c| c.link == link), "{name}: link {link} has no body");
            }
            assert!(capsules.iter().all(|c| c.radius > 0.02 && c.radius < 0.2), "{name}");
        }
    }

    #[test]
    fn a_reported_flange_has_a_stand_in() {
        let (capsules, tree) = capsules_of("flange_poses: f.csv");
        assert_eq!(capsules.len(), 2);
        assert_eq!(capsules[1].frames, [*tree.robots[0].last().unwrap(); 2]);
        assert!(capsules[1].ends[1].z + capsules[1].radius <= 1e-12, "behind the flange");
    }
}
