//! `compare`: two layouts, or a solution and a truth, pose by pose.

use std::collections::BTreeMap;

use crate::complaint::{Complaint, InputError};
use crate::frames::{Edge, FrameTree, Step};
use crate::geometry::{Pose, TargetGeometry, rotation};
use crate::layout::Layout;

/// How one pose differs.
#[derive(Clone, Debug, PartialEq)]
pub struct PoseDifference {
    /// `parent_from_child` in the first layout's words.
    pub key: String,
    /// Distance of the origins, m.
    pub translation: f64,
    /// Angle between the orientations, rad.
    pub rotation: f64,
    /// The largest ratio of a component's difference to its standard deviation in either layout; none where no standard deviation is known.
    pub within_sigma: Option<f64>,
}

/// Two layouts compared.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Comparison {
    /// Every pose that both give.
    pub poses: Vec<PoseDifference>,
    /// Poses that only one of the two gives.
    pub missing: Vec<String>,
}

impl Comparison {
    /// The largest distance, m.
    #[must_use]
    pub fn worst_translation(&self) -> f64 {
        self.poses.iter().map(|pose| pose.translation).fold(0.0, f64::max)
    }

    /// The pose that lies farthest from the other in its standard deviations, and how many.
    #[must_use]
    pub fn farthest(&self) -> Option<(&str, f64)> {
        let known = self.poses.iter().filter_map(|pose| Some((pose.key.as_str(), pose.within_sigma?)));
        known.max_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// The largest angle, rad.
    #[must_use]
    pub fn worst_rotation(&self) -> f64 {
        self.poses.iter().map(|pose| pose.rotation).fold(0.0, f64::max)
    }
}

/// A tree with the poses that its layout gives.
struct Known<'a> {
    layout: &'a Layout,
    tree: FrameTree,
}

impl<'a> Known<'a> {
    fn new(layout: &'a Layout) -> Self {
        Self { layout, tree: FrameTree::new(layout) }
    }

    fn frame(&self, name: &str) -> Option<usize> {
        // The root goes by the layout's own word for it.
        let found = self.tree.frames.iter().skip(1).position(|frame| frame.name == name).map(|place| place + 1);
        found.or_else(|| (name == self.layout.world).then_some(0))
    }

    /// `a_from_b` where everything between is given and stands still.
    fn between(&self, a: usize, b: usize) -> Option<Pose> {
        self.tree.path(a, b).steps.iter().try_fold(Pose::identity(), |pose, step| match *step {
            Step::Static { edge, inverse } => {
                let value = self.tree.static_edges[edge].spec.pose()?;
                Some(pose * if inverse { value.inverse() } else { value })
            }
            _ => None,
        })
    }

    /// The places of the tags and points on a target that this layout gives, under the keys they have where they are unknown.
    fn parts(&self) -> Vec<(String, Pose)> {
        let of = |target: &str, part: String, pose: Pose| (format!("{target}_from_{target}.{part}"), pose);
        let mut parts = Vec::new();
        for target in &self.layout.targets {
            match &target.geometry {
                TargetGeometry::Tags(faces) => parts.extend(
                    faces.iter().filter_map(|f| Some(of(&target.name, format!("tag{}", f.id), f.target_from_tag?))),
                ),
                TargetGeometry::Points(points) => {
                    parts.extend(points.iter().filter_map(|(name, place)| {
                        let at = (*place)?;
                        Some(of(&target.name, name.clone(), Pose::from_translation(at.x, at.y, at.z)))
                    }));
                }
                TargetGeometry::None | TargetGeometry::Board { .. } => {}
            }
        }
        parts
    }

    fn sigma(&self, key: &str) -> Option<[Option<f64>; 6]> {
        self.layout.solved.iter().find(|solved| solved.key == key).map(|solved| solved.sigma)
    }
}

/// Compares every pose of `first` with the same pose in `second`, whatever it is mounted on there: frames are matched by name.
///
/// # Errors
/// When the two have no pose in common.
pub fn compare(first: &Layout, second: &Layout) -> Result<Comparison, InputError> {
    let (a, b) = (Known::new(first), Known::new(second));
    let mut comparison = Comparison::default();
    for edge in &a.tree.static_edges {
        let frame = &a.tree.frames[edge.frame];
        let (Some(parent), Edge::Static(_)) = (frame.parent, frame.edge) else { continue };
        if frame.name == first.world {
            continue;
        }
        let parent_name = if parent == 0 { &first.world } else { &a.tree.frames[parent].name };
        let ours = a.between(parent, edge.frame);
        let theirs = b.frame(parent_name).zip(b.frame(&frame.name)).and_then(|(p, c)| b.between(p, c));
        let (Some(ours), Some(theirs)) = (ours, theirs) else {
            if ours.is_some() {
                comparison.missing.push(edge.key.clone());
            }
            continue;
        };
        let sigma = a.sigma(&edge.key).or_else(|| b.sigma(&edge.key));
        comparison.poses.push(difference(edge.key.clone(), &ours, &theirs, sigma));
    }
    compare_parts(&a, &b, &mut comparison);
    if comparison.poses.is_empty() {
        return Err(Complaint::of(
            &second.file,
            format!("it gives no pose that `{}` gives too", first.file.display()),
            "compare two layouts of one cell: frames are matched by name",
        )
        .into());
    }
    Ok(comparison)
}

/// Compares the tags and points on targets whose places one of the two layouts had to find. Those that both were told are not news.
fn compare_parts(a: &Known<'_>, b: &Known<'_>, comparison: &mut Comparison) {
    let theirs: BTreeMap<String, Pose> = b.parts().into_iter().collect();
    for (key, ours) in a.parts() {
        let Some(sigma) = a.sigma(&key).or_else(|| b.sigma(&key)) else { continue };
        match theirs.get(&key) {
            Some(theirs) => comparison.poses.push(difference(key, &ours, theirs, Some(sigma))),
            None => comparison.missing.push(key),
        }
    }
}

/// How one pose differs: distance, angle, and both in standard deviations (`sigma`: m in the parent's axes, then rad in the parent's axes).
fn difference(key: String, ours: &Pose, theirs: &Pose, sigma: Option<[Option<f64>; 6]>) -> PoseDifference {
    let apart = ours.translation - theirs.translation;
    let turn = ours.rotation * rotation::log(&(ours.rotation.inverse() * theirs.rotation));
    PoseDifference {
        key,
        translation: apart.norm(),
        rotation: turn.norm(),
        within_sigma: sigma.and_then(|sigma| {
            let differences = apart.iter().chain(turn.iter());
            let ratios = differences.zip(sigma).filter_map(|(d, s)| s.filter(|s| *s > 0.0).map(|s| d.abs() / s));
            ratios.reduce(f64::max)
        }),
    }
}
