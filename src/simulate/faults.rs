//! What goes wrong in real recordings, done to clean ones.

use nalgebra::{UnitQuaternion, Vector2};
use rand::Rng;
use std::collections::{BTreeMap, BTreeSet};

use super::random::{Purpose, normal, stream};
use crate::geometry::{Feature, Pattern, Pose, TargetGeometry};
use crate::layout::Layout;
use crate::layout::simulate::Outliers;
use crate::recording::{CornerRow, PoseRow, RobotMotion};

/// A corner that a shadow or a reflection drags is off by this much (px), at least and at most.
const DRAGGED: [f64; 2] = [2.0, 12.0];

/// Spoils corners: tags with another tag's id, tags whose corners begin elsewhere, dragged corners. Says how many of each there are.
pub fn spoil_corners(layout: &Layout, rows: &mut Vec<CornerRow>, outliers: &Outliers, seed: u64) -> [usize; 3] {
    let mut counts = [0; 3];
    let mut spoilt = Vec::with_capacity(rows.len());
    for picture in rows.chunk_by(|a, b| picture_of(a) == picture_of(b)) {
        let mut seen: BTreeSet<(&str, u32)> =
            picture.iter().filter_map(|row| Some((family(layout, row.target)?, tag_of(&row.feature)?))).collect();
        for thing in picture.chunk_by(|a, b| (a.target, tag_of(&a.feature)) == (b.target, tag_of(&b.feature))) {
            let first = &thing[0];
            let tag = tag_of(&first.feature);
            let which = [
                first.configuration << 20 | first.shot,
                (first.camera as u64) << 32 | first.target as u64,
                tag.map_or(0, |tag| u64::from(tag) + 1),
            ];
            let mut random = stream(seed, Purpose::Fault, which);
            let [wrong, flipped, dragged] =
                [outliers.wrong_id, outliers.flipped, outliers.dragged].map(|share| random.random::<f64>() < share);
            let mut thing = thing.to_vec();
            if wrong && let Some(owner) = another_tag(layout, first.target, &mut seen, &mut random) {
                counts[0] += 1;
                for row in &mut thing {
                    if let Feature::TagCorner(id, _) = &mut row.feature {
                        (row.target, *id) = owner;
                    }
                }
            }
            if flipped && thing.len() > 1 {
                counts[1] += 1;
                // A tag may be a quarter, half or three quarters of a turn off, a board half a turn.
                let turn = if tag.is_some() { 1 + random.random_range(0..3) } else { 0 };
                let pixels: Vec<[f64; 2]> = thing.iter().map(|row| row.pixel).collect();
                let count = pixels.len();
                for (i, row) in thing.iter_mut().enumerate() {
                    row.pixel = pixels[if tag.is_some() { (i + turn) % count } else { count - 1 - i }];
                }
            }
            if dragged {
                counts[2] += 1;
                let corner = random.random_range(0..thing.len());
                let angle = random.random_range(0.0..std::f64::consts::TAU);
                let by = Vector2::new(angle.cos(), angle.sin()) * random.random_range(DRAGGED[0]..DRAGGED[1]);
                let pixel = &mut thing[corner].pixel;
                *pixel = [pixel[0] + by.x, pixel[1] + by.y];
            }
            spoilt.extend(thing);
        }
    }
    spoilt.sort_by(|a, b| a.key().cmp(&b.key()));
    *rows = spoilt;
    counts
}

fn picture_of(row: &CornerRow) -> (usize, u64, u64) {
    (row.camera, row.configuration, row.shot)
}

fn tag_of(feature: &Feature) -> Option<u32> {
    match feature {
        Feature::TagCorner(id, _) => Some(*id),
        _ => None,
    }
}

fn family(layout: &Layout, target: usize) -> Option<&'static str> {
    match &layout.targets[target].pattern {
        Some(Pattern::Tags { dictionary, .. }) => Some(dictionary.family()),
        _ => None,
    }
}

/// A tag of the cell, of the same dictionary, that is not in the picture yet; it is now.
fn another_tag<'a>(
    layout: &'a Layout,
    target: usize,
    seen: &mut BTreeSet<(&'a str, u32)>,
    random: &mut impl Rng,
) -> Option<(usize, u32)> {
    let family_here = family(layout, target)?;
    let targets = layout.targets.iter().enumerate().filter(|(i, _)| family(layout, *i) == Some(family_here));
    let free: Vec<(usize, u32)> = targets
        .flat_map(|(i, target)| match &target.true_geometry {
            TargetGeometry::Tags(faces) => faces.iter().map(|face| (i, face.id)).collect(),
            _ => Vec::new(),
        })
        .filter(|(_, id)| !seen.contains(&(family_here, *id)))
        .collect();
    let chosen = (!free.is_empty()).then(|| free[random.random_range(0..free.len())])?;
    seen.insert((family_here, chosen.1));
    Some(chosen)
}

/// Spoils whole poses: the mirrored solution that a flat target has. Says how many.
pub fn flip_poses(rows: &mut [PoseRow], share: f64, seed: u64) -> usize {
    let mut count = 0;
    for row in rows {
        let which = [row.configuration << 20 | row.shot, (row.camera as u64) << 32 | row.target as u64, 1 << 40];
        if stream(seed, Purpose::Fault, which).random::<f64>() < share
            && let Some(pose) = mirrored(&row.pose)
        {
            row.pose = pose;
            count += 1;
        }
    }
    count
}

/// The pose whose face leans to the other side of the line of sight: the second solution of a flat target seen from afar.
fn mirrored(pose: &Pose) -> Option<Pose> {
    let sight = pose.translation.try_normalize(1e-9)?;
    let normal = pose.rotation * nalgebra::Vector3::z();
    let leaning = sight * (2.0 * normal.dot(&sight)) - normal;
    let turn = UnitQuaternion::rotation_between(&normal, &leaning)?;
    Some(Pose::new(turn * pose.rotation, pose.translation))
}

/// From `from` on, the log of a robot says where it stood one configuration earlier.
pub fn shift_log(motion: &mut RobotMotion, from: u64) {
    fn shift<T: Clone>(values: &mut BTreeMap<u64, T>, from: u64) {
        let before: Vec<T> = values.range(..from).next_back().map(|(_, value)| value.clone()).into_iter().collect();
        let earlier =
            before.into_iter().chain(values.range(from..).map(|(_, value)| value.clone()).collect::<Vec<_>>());
        for (slot, value) in values.range_mut(from..).zip(earlier) {
            *slot.1 = value;
        }
    }
    match motion {
        RobotMotion::Joints(values) => shift(values, from),
        RobotMotion::Flange(poses) => shift(poses, from),
    }
}

/// A pose that is off by about the given length (m) and angle (rad), in a random direction.
pub fn bumped(pose: &Pose, translation: f64, rotation: f64, seed: u64) -> Pose {
    let mut random = stream(seed, Purpose::Fault, [0, 0, 1 << 41]);
    let mut direction = || nalgebra::Vector3::from_fn(|_, _| normal(&mut random)).normalize();
    let (shift, axis) = (direction(), direction());
    *pose * Pose::new(Pose::from_rotation_vector(&(axis * rotation)).rotation, shift * translation)
}
