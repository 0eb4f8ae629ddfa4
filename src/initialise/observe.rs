//! From the plan's blocks to candidate poses, and back from poses to the numbering of symmetric boards.

use nalgebra::{Vector2, Vector3};
use rayon::prelude::*;

use super::consensus::{Votes, consensus, nearest};
use super::register::rigid_fit;
use super::robust_pose::robust_poses_from_points;
use crate::frames::FrameTree;
use crate::geometry::{Feature, Intrinsics, Pose, TargetGeometry};
use crate::layout::Layout;
use crate::solve::{Block, Group, GroupKind, Plan};

/// Pictures of one target by one camera from which poses are taken at most, spread evenly: more would not change the start.
const MOST_PICTURES: usize = 300;

/// Candidate poses of a target at one configuration.
#[derive(Clone, Debug)]
pub(super) struct Observation {
    /// Index into the plan's configurations.
    pub(super) configuration: usize,
    /// The candidates, best first.
    pub(super) votes: Votes,
}

/// The observations of a group: every block that shows enough for a pose.
pub(super) fn observe(layout: &Layout, tree: &FrameTree, plan: &Plan, group: &Group) -> Vec<Observation> {
    let stride = if group.compiled.moving.is_empty() { group.blocks.len().div_ceil(MOST_PICTURES).max(1) } else { 1 };
    let blocks: Vec<&Block> = group.blocks.iter().step_by(stride).collect();
    let symmetries = board_of(layout, tree, group).map_or(Vec::new(), half_turns);
    let one = |block: &&Block| {
        let (candidates, weight): (Vec<Pose>, usize) = match group.kind {
            GroupKind::Corners { camera } => {
                let intrinsics = layout.cameras[camera].intrinsics.as_ref()?;
                (picture_candidates(layout, tree, plan, group, block, intrinsics), block.end - block.start)
            }
            GroupKind::Poses => {
                let poses: Vec<Pose> =
                    plan.measurements.poses[block.start..block.end].iter().flatten().copied().collect();
                (representatives(&poses), block.end - block.start)
            }
            GroupKind::Points => {
                let pairs: Vec<(Vector3<f64>, Vector3<f64>)> =
                    plan.measurements.points[block.start..block.end].iter().flatten().copied().collect();
                (solid_fit(&pairs).into_iter().collect(), pairs.len())
            }
            GroupKind::Contacts => (Vec::new(), 0),
        };
        let first = candidates.first()?;
        let distance = first.translation.norm();
        let candidates = if symmetries.is_empty() {
            candidates
        } else {
            candidates.iter().flat_map(|pose| symmetries.iter().map(|turn| *pose * *turn)).collect()
        };
        Some(Observation {
            configuration: block.configuration,
            votes: Votes { candidates, weight: weight as f64, distance },
        })
    };
    blocks.par_iter().filter_map(one).collect()
}

/// What several shots of one pose agree on, and what those that disagree with it agree on: flipped tags come in two crowds.
fn representatives(poses: &[Pose]) -> Vec<Pose> {
    let vote = |pose: &Pose| Votes { candidates: vec![*pose], weight: 1.0, distance: pose.translation.norm() };
    let votes: Vec<Votes> = poses.iter().map(vote).collect();
    let Some((first, _)) = consensus(&votes) else { return Vec::new() };
    let others: Vec<Votes> = votes.into_iter().filter(|vote| nearest(vote, &first).1 >= 1.0).collect();
    let second = consensus(&others).map(|(pose, _)| pose);
    std::iter::once(first).chain(second).collect()
}

/// A rigid fit of at least three points that are not in one place or on one line.
fn solid_fit(pairs: &[(Vector3<f64>, Vector3<f64>)]) -> Option<Pose> {
    let first = pairs.first()?.0;
    let spread = pairs.iter().map(|(place, _)| (place - first).norm()).fold(0.0, f64::max);
    let (a, b) = pairs.iter().find_map(|(p, _)| {
        pairs.iter().find(|(q, _)| (p - first).cross(&(q - first)).norm() > 1e-3 * spread * spread).map(|(q, _)| (p, q))
    })?;
    debug_assert!(a != b);
    rigid_fit(pairs)
}

/// The checkerboard that a group shows, if its numbering is open.
fn board_of<'a>(layout: &'a Layout, tree: &FrameTree, group: &Group) -> Option<&'a TargetGeometry> {
    let target = tree.targets.iter().position(|frame| *frame == group.path.to)?;
    let geometry = &layout.targets[target].geometry;
    (geometry.symmetries().len() > 1).then_some(geometry)
}

/// `target_from_target` for each numbering that a board's symmetry allows: the turn that maps corner `i` to where corner `map[i]` is.
fn half_turns(geometry: &TargetGeometry) -> Vec<Pose> {
    let place = |index: u32| geometry.place(&Feature::BoardCorner(index)).unwrap_or_default();
    let fits = geometry.symmetries().into_iter().filter_map(|map| {
        let pairs: Vec<_> = map.iter().enumerate().map(|(i, &to)| (place(i as u32), place(to))).collect();
        // A turn in the board's plane: flat points leave the mirror image open, the rigid fit picks the proper rotation.
        rigid_fit(&pairs).map(|fit| fit.inverse())
    });
    fits.collect()
}

fn picture_candidates(
    layout: &Layout,
    tree: &FrameTree,
    plan: &Plan,
    group: &Group,
    block: &Block,
    intrinsics: &Intrinsics,
) -> Vec<Pose> {
    let m = &plan.measurements;
    let range = block.start..block.end;
    let shots = shot_ranges(plan, block);
    // Shots of a symmetric board may be numbered differently from each other: the first speaks for all.
    let range = if board_of(layout, tree, group).is_some() { shots[0].clone() } else { range };
    let (mut points, mut image) = (Vec::new(), Vec::new());
    for (point, pixel) in means(range.map(|i| (m.place(i), m.pixel(i)))) {
        if let Ok(ideal) = intrinsics.undistort(&pixel) {
            points.push(point);
            image.push(ideal);
        }
    }
    robust_poses_from_points(&points, &image).into_iter().map(|candidate| candidate.pose).collect()
}

/// Every different point with the mean of its pixels: several shots from one place show it at one pixel but for noise.
fn means(corners: impl Iterator<Item = ([f64; 3], [f64; 2])>) -> Vec<(Vector3<f64>, Vector2<f64>)> {
    let mut sums: Vec<([f64; 3], [f64; 2], f64)> = Vec::new();
    let mut next = 0;
    for (point, pixel) in corners {
        // Shots list their corners in the same order.
        let place = match sums.get(next) {
            Some((known, ..)) if *known == point => next,
            _ => sums.iter().position(|(known, ..)| *known == point).unwrap_or_else(|| {
                sums.push((point, [0.0; 2], 0.0));
                sums.len() - 1
            }),
        };
        let (_, sum, count) = &mut sums[place];
        *sum = [sum[0] + pixel[0], sum[1] + pixel[1]];
        *count += 1.0;
        next = place + 1;
    }
    sums.into_iter().map(|(point, sum, count)| (point.into(), Vector2::from(sum) / count)).collect()
}

/// The corners of a block, shot by shot.
fn shot_ranges(plan: &Plan, block: &Block) -> Vec<std::ops::Range<usize>> {
    plan.measurements.appearances(block.start..block.end).map(|(range, _)| range).collect()
}

/// Gives the corners of symmetric boards the numbering that fits `poses` (`sensor_from_target` by group and block). Returns the number of boards
/// that were turned.
pub(super) fn renumber_boards(layout: &Layout, tree: &FrameTree, plan: &mut Plan, poses: &[Vec<Pose>]) -> usize {
    let mut turned = 0;
    for (group, poses) in plan.groups.clone().iter().zip(poses) {
        let (Some(geometry), GroupKind::Corners { camera }) = (board_of(layout, tree, group), group.kind) else {
            continue;
        };
        let Some(intrinsics) = &layout.cameras[camera].intrinsics else { continue };
        let maps = geometry.symmetries();
        let place = |corner: u32| geometry.place(&Feature::BoardCorner(corner));
        // Where the plan has the board's corners, once one of them needs another's place.
        let mut known: Option<u32> = None;
        for (block, pose) in group.blocks.iter().zip(poses) {
            for range in shot_ranges(plan, block) {
                let numbered = |map: &[u32]| -> Option<Vec<u32>> {
                    let to = |i: usize| match plan.measurements.feature(i) {
                        Feature::BoardCorner(index) => map.get(*index as usize).copied(),
                        _ => None,
                    };
                    range.clone().map(to).collect()
                };
                let error = |corners: &[u32]| -> Option<f64> {
                    let one = |(corner, i): (&u32, usize)| {
                        Some(match intrinsics.project(&(*pose * place(*corner)?)) {
                            Some(pixel) => (pixel - Vector2::from(plan.measurements.pixel(i))).norm_squared(),
                            None => 1e12,
                        })
                    };
                    corners.iter().zip(range.clone()).map(one).sum()
                };
                let best = maps
                    .iter()
                    .enumerate()
                    .filter_map(|(rank, map)| numbered(map).and_then(|corners| Some((rank, error(&corners)?, corners))))
                    .min_by(|a, b| a.1.total_cmp(&b.1));
                if let Some((rank, _, corners)) = best
                    && rank > 0
                {
                    turned += 1;
                    let first = *known.get_or_insert_with(|| {
                        let all = (0..maps[0].len() as u32).map(|corner| place(corner).unwrap_or_default().into());
                        plan.measurements.add_places(all)
                    });
                    for (corner, i) in corners.into_iter().zip(range) {
                        plan.measurements.put_at(i, first + corner);
                    }
                }
            }
        }
    }
    turned
}
