//! Measurements that do not belong: found by their residual against the scale that the bulk shows, and set aside.

use std::collections::BTreeMap;

use super::residuals::Residuals;
use crate::frames::FrameId;
use crate::layout::Layout;
use crate::solve::{Group, GroupKind, Measurements, Plan};

/// A residual this many times the bulk's scale is set aside. Of a two-dimensional Gaussian four in a million lie beyond; what real cells show there is
/// wrong ids, dragged corners and shifted logs.
const TIMES: f64 = 5.0;
/// Corners of one path may scatter up to this many times more than all corners do before it is called wrong: where a robot does not stop exactly, what is seen
/// across it scatters more than what stands still, and to cut off its larger errors would hide how inexact it is.
const WIDER: f64 = 4.0;
/// Fewer corners than this say nothing about a scale of their own.
const FEW: usize = 40;

/// How many of each kind have been set aside.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rejected {
    /// Corners.
    pub corners: usize,
    /// Measured poses.
    pub poses: usize,
    /// Measured points.
    pub points: usize,
    /// Contacts.
    pub contacts: usize,
    /// Measurements of moving targets at configurations where too little of them was seen.
    pub unplaced: usize,
}

/// How the corners of one target in one camera's pictures fared.
#[derive(Clone, Debug, PartialEq)]
pub struct Tally {
    /// The camera's name.
    pub camera: String,
    /// The target's name.
    pub target: String,
    /// Corners that fit.
    pub accepted: usize,
    /// Corners set aside.
    pub rejected: usize,
    /// Root mean square residual of those that fit, px a coordinate.
    pub rms_px: Option<f64>,
}

impl Tally {
    /// Takes in other corners.
    fn add(&mut self, more: &Self) {
        let sum = |t: &Self| t.rms_px.map_or(0.0, |rms| rms * rms * t.accepted as f64);
        let squares = sum(self) + sum(more);
        self.accepted += more.accepted;
        self.rejected += more.rejected;
        self.rms_px = (self.accepted > 0).then(|| (squares / self.accepted as f64).sqrt());
    }

    /// Takes other corners into all counts, which stay in the order of the layout.
    pub fn add_all(all: &mut Vec<Self>, more: Vec<Self>, layout: &Layout) {
        for one in more {
            match all.iter_mut().find(|known| known.camera == one.camera && known.target == one.target) {
                Some(known) => known.add(&one),
                None => all.push(one),
            }
        }
        let camera = |one: &Self| layout.cameras.iter().position(|camera| camera.name == one.camera);
        let target = |one: &Self| layout.targets.iter().position(|target| target.name == one.target);
        all.sort_by_key(|one| (camera(one), target(one)));
    }
}

/// Counts corners by camera and target, in the order of the layout.
#[must_use]
pub fn tally(layout: &Layout, plan: &Plan, residuals: &Residuals) -> Vec<Tally> {
    let mut counts: BTreeMap<(usize, usize), (usize, usize, f64)> = BTreeMap::new();
    let m = &plan.measurements;
    for (range, one) in m.appearances(0..m.corner_count()) {
        let count = counts.entry((one.camera, one.target)).or_default();
        for residual in residuals.corners(range) {
            match residual {
                Some([u, v]) => *count = (count.0 + 1, count.1, count.2 + u * u + v * v),
                None => count.1 += 1,
            }
        }
    }
    let one = |((camera, target), (accepted, rejected, sum)): ((usize, usize), (usize, usize, f64))| Tally {
        camera: layout.cameras[camera].name.clone(),
        target: layout.targets[target].name.clone(),
        accepted,
        rejected,
        rms_px: (accepted > 0).then(|| (sum / (2.0 * accepted as f64)).sqrt()),
    };
    counts.into_iter().map(one).collect()
}

impl Rejected {
    /// Counts more.
    pub fn add(&mut self, more: Self) {
        self.corners += more.corners;
        self.poses += more.poses;
        self.points += more.points;
        self.contacts += more.contacts;
        self.unplaced += more.unplaced;
    }

    /// All kinds together.
    #[must_use]
    pub fn total(&self) -> usize {
        self.corners + self.poses + self.points + self.contacts + self.unplaced
    }
}

/// Sets aside in the plan what lies far outside, and says how many more there are than before.
pub fn reject(plan: &mut Plan, residuals: &Residuals) -> Rejected {
    let mut found = reject_unseen(plan, residuals);
    found.add(Gates::of(plan, residuals).set_aside(plan, residuals));
    found
}

/// How far off measurements may be: squared norms in the layout's standard deviations.
#[derive(Clone, Debug, PartialEq)]
pub struct Gates {
    /// Corners, by kind and ends of their path; of a path that is not among them, any other corner's limit.
    corners: BTreeMap<(GroupKind, FrameId, FrameId), f64>,
    other: f64,
    /// Translations and rotations of whole poses: a pose that fails one is set aside whole.
    poses: [f64; 2],
    points: f64,
    contacts: f64,
}

impl Gates {
    /// Nothing is too far off.
    #[must_use]
    pub fn open() -> Self {
        let wide = f64::INFINITY;
        Self { corners: BTreeMap::new(), other: wide, poses: [wide; 2], points: wide, contacts: wide }
    }

    /// By the scale that the bulk of the residuals shows.
    #[must_use]
    pub fn of(plan: &Plan, residuals: &Residuals) -> Self {
        let m = &plan.measurements;
        let [poses, points, contacts] = &residuals.whitened;
        let other = limit((0..m.corner_count()).filter_map(|i| whitened(m, residuals, i)).collect(), MEDIANS[1]);
        let of_path = |group: &Group| {
            let indices = group.blocks.iter().flat_map(|block| block.start..block.end);
            let own: Vec<f64> = indices.filter_map(|i| whitened(m, residuals, i)).collect();
            let own = if own.len() < FEW { other } else { limit(own, MEDIANS[1]) };
            (key(group), own.clamp(other, WIDER * WIDER * other))
        };
        let of_corners = plan.groups.iter().filter(|group| matches!(group.kind, GroupKind::Corners { .. }));
        let half = |part: usize| -> Vec<f64> { poses.iter().skip(part).step_by(2).copied().collect() };
        Self {
            corners: of_corners.map(of_path).collect(),
            other,
            poses: [0, 1].map(|part| limit(seen(&half(part), &residuals.poses), MEDIANS[2])),
            points: limit(seen(points, &residuals.points), MEDIANS[2]),
            contacts: limit(seen(contacts, &residuals.contacts), MEDIANS[0]),
        }
    }

    /// Sets aside in the plan what is farther off, and says how much that is.
    pub fn set_aside(&self, plan: &mut Plan, residuals: &Residuals) -> Rejected {
        let mut found = Rejected::default();
        let m = &mut plan.measurements;
        let [poses, points, contacts] = &residuals.whitened;
        for group in plan.groups.iter().filter(|group| matches!(group.kind, GroupKind::Corners { .. })) {
            let most = self.corners.get(&key(group)).copied().unwrap_or(self.other);
            for i in group.blocks.iter().flat_map(|block| block.start..block.end) {
                if whitened(m, residuals, i).is_some_and(|squared| squared > most) {
                    m.set_aside(i);
                    found.corners += 1;
                }
            }
        }
        for (i, pose) in m.poses.iter_mut().enumerate() {
            if pose.is_some() && (poses[2 * i] > self.poses[0] || poses[2 * i + 1] > self.poses[1]) {
                *pose = None;
                found.poses += 1;
            }
        }
        found.points += set_aside(&mut m.points, points, self.points);
        found.contacts += set_aside(&mut m.contacts, contacts, self.contacts);
        found
    }

    /// What the measurements that [`Gates::set_aside`] has found cost: each as much as one that just passes.
    #[must_use]
    pub fn price(&self, plan: &Plan, residuals: &Residuals) -> f64 {
        let [poses, points, contacts] = &residuals.whitened;
        let corners = plan.groups.iter().filter(|group| matches!(group.kind, GroupKind::Corners { .. })).map(|group| {
            let most = self.corners.get(&key(group)).copied().unwrap_or(self.other);
            let beyond = |i: &usize| whitened(&plan.measurements, residuals, *i).is_some_and(|squared| squared > most);
            most * group.blocks.iter().flat_map(|block| block.start..block.end).filter(beyond).count() as f64
        });
        let pose = |both: &[f64]| {
            let beyond = both[0] > self.poses[0] || both[1] > self.poses[1];
            if beyond { self.poses[0].min(both[0]) + self.poses[1].min(both[1]) } else { 0.0 }
        };
        let others = |squared: &[f64], most: f64| squared.iter().filter(|s| **s > most).map(|_| most).sum::<f64>();
        let whole = poses.chunks_exact(2).map(pose).sum::<f64>();
        0.5 * (corners.sum::<f64>() + whole + others(points, self.points) + others(contacts, self.contacts))
    }
}

fn key(group: &Group) -> (GroupKind, FrameId, FrameId) {
    (group.kind, group.path.from, group.path.to)
}

/// How far the bulk of the measurements is off, in the layout's standard deviations and at least one, and the share of all that lies far outside that.
#[must_use]
pub fn contamination(plan: &Plan, residuals: &Residuals) -> (f64, f64) {
    let (mut scale, mut far, mut all) = (1.0_f64, 0, 0);
    let m = &plan.measurements;
    let [poses, points, contacts] = &residuals.whitened;
    let pairs = residuals.poses.iter().flat_map(|pose| [pose; 2]);
    let pairs: Vec<f64> = poses.iter().zip(pairs).filter(|(_, seen)| seen.is_some()).map(|(s, _)| *s).collect();
    let (points, contacts) = (seen(points, &residuals.points), seen(contacts, &residuals.contacts));
    let mut judge = |squared: &mut dyn Iterator<Item = f64>, again: &mut dyn Iterator<Item = f64>, median: f64| {
        let limit = limit(squared.collect(), median);
        if limit.is_finite() {
            scale = scale.max(limit.sqrt() / TIMES);
        }
        for s in again {
            far += usize::from(s > limit);
            all += 1;
        }
    };
    // Corners are gone through twice: a copy of what they weigh would be held for nothing.
    let corners = || (0..m.corner_count()).filter_map(|i| whitened(m, residuals, i));
    judge(&mut corners(), &mut corners(), MEDIANS[1]);
    for (squared, median) in [(&pairs, MEDIANS[2]), (&points, MEDIANS[2]), (&contacts, MEDIANS[0])] {
        judge(&mut squared.iter().copied(), &mut squared.iter().copied(), median);
    }
    (scale, far as f64 / all.max(1) as f64)
}

/// The squared whitened norm of a corner that was accepted and can be seen.
fn whitened(m: &Measurements, residuals: &Residuals, i: usize) -> Option<f64> {
    residuals.corner(i).map(|d| m.whitened(i, d))
}

fn seen<T>(squared: &[f64], of: &[Option<T>]) -> Vec<f64> {
    squared.iter().zip(of).filter(|(_, one)| one.is_some()).map(|(s, _)| *s).collect()
}

/// Sets aside corners that the camera could not see from where it was found to be: a misread id, not a measurement.
pub fn reject_unseen(plan: &mut Plan, residuals: &Residuals) -> Rejected {
    let mut found = Rejected::default();
    let m = &mut plan.measurements;
    for i in 0..m.corner_count() {
        if m.is_kept(i) && residuals.corner(i).is_none() {
            m.set_aside(i);
            found.corners += 1;
        }
    }
    found
}

/// Medians of the chi-squared distribution with one, two and three degrees of freedom.
const MEDIANS: [f64; 3] = [0.455, 1.386, 2.366];

fn set_aside<T>(all: &mut [Option<T>], squared: &[f64], limit: f64) -> usize {
    let mut count = 0;
    for (one, s) in all.iter_mut().zip(squared) {
        if one.is_some() && *s > limit {
            *one = None;
            count += 1;
        }
    }
    count
}

/// The squared norm beyond which a residual is set aside: the bulk's scale from the median of the squared norms, but never below what
/// the layout calls one standard deviation, so that perfect data rejects nothing.
fn limit(mut all: Vec<f64>, median_of_unit: f64) -> f64 {
    if all.is_empty() {
        return f64::INFINITY;
    }
    let middle = all.len() / 2;
    let (_, median, _) = all.select_nth_unstable_by(middle, f64::total_cmp);
    TIMES * TIMES * (*median / median_of_unit).max(1.0)
}
