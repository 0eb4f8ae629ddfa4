//! `validate`: how good an answer is on measurements that it was not fitted to.
//!
//! A small residual is no accuracy. So the cell is solved again and again without a part of the recording, and what was left out judges: configurations
//! held out in folds, one camera after the other, one half against the other. What the whole fit sets aside as not belonging is left out
//! everywhere; nothing else is, and what a part predicts is compared as it is, without a robust loss.

use rayon::prelude::*;
use std::collections::BTreeSet;
use std::path::PathBuf;
use std::time::Instant;

use super::measured::{Sight, sights};
use super::place::Places;
use super::published::{Boards, boards, samples};
use super::solve::{Solved, solve_plain};
use super::solved_layout::solved_layout;
use crate::complaint::{Complaint, InputError};
use crate::frames::{FrameTree, Step};
use crate::geometry::{Pose, rotation};
use crate::identify::{Sample, free};
use crate::layout::{Layout, LossSetting, PoseSpec};
use crate::recording::Recording;
use crate::trust::Source;

/// What to validate with.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ValidateRequest {
    /// Parts into which the configurations are split; each is held out once.
    pub folds: usize,
    /// Corners that take the place of the layout's own.
    pub detections: Option<PathBuf>,
}

impl Default for ValidateRequest {
    fn default() -> Self {
        Self { folds: 10, detections: None }
    }
}

/// How measurements fit a solution.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Fit {
    /// Root mean square of the corners, px a coordinate.
    pub px: Option<f64>,
    /// Root mean square distance between where a sensor sees a target (or point) that a robot moves against it and where the solution has it, m.
    pub distance: Option<f64>,
}

/// What one camera sees against what the others predict.
#[derive(Clone, Debug, PartialEq)]
pub struct LeftOut {
    /// The camera.
    pub camera: String,
    /// Positions compared.
    pub positions: usize,
    /// Root mean square and largest distance, m; none where the rest does not hang together without the camera.
    pub distance: Option<[f64; 2]>,
    /// The root mean square distance where the camera takes part in the fit, m.
    pub fitted: Option<f64>,
}

/// How a pose differs between the halves of a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Repeated {
    /// `parent_from_child`.
    pub key: String,
    /// Distance of the origins (m) and angle (rad).
    pub apart: [f64; 2],
    /// The largest difference of a component in standard deviations of the difference.
    pub sigmas: Option<f64>,
}

/// The published method and the joint solve, both fitted to one half of the configurations, on the tool positions of the other.
#[derive(Clone, Debug, PartialEq)]
pub struct Published {
    /// The robot.
    pub robot: String,
    /// Positions of the other half.
    pub positions: usize,
    /// Root mean square distance of the published method's prediction, m.
    pub published: f64,
    /// That of the joint solve's, m.
    pub joint: f64,
}

/// A validated cell.
#[derive(Clone, Debug, PartialEq)]
pub struct Validated {
    /// Configurations.
    pub configurations: usize,
    /// Measurements that the whole fit set aside.
    pub aside: usize,
    /// The whole fit on itself.
    pub fitted: Fit,
    /// Each fold's measurements under the fit to the others; none where the rest could not be solved.
    pub folds: Vec<Option<Fit>>,
    /// The same with every link parameter left as the layout has it, where the layout finds links.
    pub nominal_links: Option<Vec<Option<Fit>>>,
    /// Every camera, where there are at least two.
    pub cameras: Vec<LeftOut>,
    /// Every pose found, first half against second; empty where a half could not be solved.
    pub halves: Vec<Repeated>,
    /// The published method beside the joint solve, where it applies.
    pub published: Option<Published>,
    /// Wall time, s.
    pub seconds: f64,
}

/// The root of the mean square over folds.
#[must_use]
pub fn mean(folds: &[Option<Fit>], part: impl Fn(&Fit) -> Option<f64>) -> Option<f64> {
    let all: Vec<f64> = folds.iter().flatten().filter_map(part).collect();
    (!all.is_empty()).then(|| (all.iter().map(|x| x * x).sum::<f64>() / all.len() as f64).sqrt())
}

/// Validates a layout on its recording.
///
/// # Errors
/// As [`super::solve::solve`]; fewer configurations than twice the folds.
pub fn validate(layout: &Layout, request: &ValidateRequest) -> Result<Validated, InputError> {
    let began = Instant::now();
    let recording = Recording::read(layout, request.detections.as_deref())?;
    let whole = solve_plain(layout.clone(), &recording, &[], Vec::new(), began, false)?;
    let configurations = whole.plan.configurations.len();
    if request.folds < 2 || configurations < 2 * request.folds {
        return Err(Complaint::of(
            &layout.file,
            format!("{configurations} configurations cannot be split into {} folds", request.folds),
            "give at least 2 and at most half as many `--folds N` as there are configurations",
        )
        .into());
    }
    let validation = Validation::new(layout, recording, &whole);
    let folds: Vec<BTreeSet<u64>> = (0..request.folds).map(|fold| validation.every(request.folds, fold)).collect();
    let identifies = layout.robots.iter().any(|robot| !robot.identify.is_empty());
    let nominal = identifies.then(|| {
        let mut nominal = validation.layout.clone();
        nominal.robots.iter_mut().for_each(|robot| robot.identify.clear());
        validation.folds(&nominal, &folds)
    });
    Ok(Validated {
        configurations,
        aside: whole.rejected.total(),
        fitted: validation.fit(&whole, &validation.recording),
        folds: validation.folds(&validation.layout, &folds),
        nominal_links: nominal,
        cameras: validation.cameras(),
        halves: validation.halves(),
        published: validation.published(),
        seconds: began.elapsed().as_secs_f64(),
    })
}

/// What all comparisons share.
struct Validation<'a> {
    /// The layout, to be fitted by least squares.
    layout: Layout,
    /// What belongs.
    recording: Recording,
    /// Poses of the whole fit, from which every search starts.
    start: Vec<(String, Pose)>,
    whole: &'a Solved,
}

impl<'a> Validation<'a> {
    fn new(layout: &Layout, mut recording: Recording, whole: &'a Solved) -> Self {
        let m = &whole.plan.measurements;
        let aside: BTreeSet<usize> = (0..m.corner_count()).filter(|i| !m.is_kept(*i)).map(|i| m.row(i)).collect();
        recording.corners.retain_each(|_, row| !aside.contains(&row));
        let mut layout = layout.clone();
        // Corners that do not belong are gone; poses and points are still judged by the layout's own loss.
        if recording.poses.is_empty() && recording.points.is_empty() && recording.contacts.is_empty() {
            layout.solve.loss = LossSetting::Squared;
        }
        let edges = whole.tree.static_edges.iter().zip(&whole.state.static_poses);
        let start = edges.map(|(edge, pose)| (edge.key.clone(), *pose)).collect();
        Self { layout, recording, start, whole }
    }

    /// Every `step`-th configuration from the `first`.
    fn every(&self, step: usize, first: usize) -> BTreeSet<u64> {
        self.whole.plan.configurations.iter().skip(first).step_by(step).copied().collect()
    }

    /// The recording where `keep` holds of a configuration.
    fn part(&self, keep: impl Fn(u64) -> bool) -> Recording {
        let r = &self.recording;
        let mut corners = r.corners.clone();
        corners.retain(|one| keep(one.configuration));
        Recording {
            motions: r.motions.clone(),
            corners,
            poses: r.poses.iter().filter(|row| keep(row.configuration)).cloned().collect(),
            points: r.points.iter().filter(|row| keep(row.configuration)).cloned().collect(),
            contacts: r.contacts.iter().filter(|row| keep(row.configuration)).cloned().collect(),
            ..Recording::default()
        }
    }

    fn solve(&self, layout: &Layout, recording: &Recording) -> Option<Solved> {
        solve_plain(layout.clone(), recording, &self.start, Vec::new(), Instant::now(), false).ok()
    }

    /// How a recording fits a solution: everything that was found is held fixed, and nothing is set aside. Robots stand where their log says.
    fn judge(&self, solved: &Solved, recording: &Recording) -> Option<Solved> {
        let mut fixed = solved_layout(solved);
        fixed.solve.loss = LossSetting::Squared;
        fixed.robots.iter_mut().for_each(|robot| robot.repeatability = None);
        self.solve(&fixed, recording)
    }

    fn fit(&self, solved: &Solved, recording: &Recording) -> Fit {
        let Some(judged) = self.judge(solved, recording) else { return Fit::default() };
        Fit { px: judged.summary.rms_px(), distance: root_mean_square(&distances(&judged, recording, None)) }
    }

    fn folds(&self, layout: &Layout, folds: &[BTreeSet<u64>]) -> Vec<Option<Fit>> {
        let one = |held: &BTreeSet<u64>| {
            let solved = self.solve(layout, &self.part(|c| !held.contains(&c)))?;
            Some(self.fit(&solved, &self.part(|c| held.contains(&c))))
        };
        folds.par_iter().map(one).collect()
    }

    fn cameras(&self) -> Vec<LeftOut> {
        let count = self.layout.cameras.len();
        if count < 2 {
            return Vec::new();
        }
        // Judged anew, since the rows of the whole fit count what was set aside.
        let judged = self.judge(self.whole, &self.recording);
        let fitted =
            judged.as_ref().map_or(Vec::new(), |solved| sights(&Places { solved, recording: &self.recording }));
        (0..count)
            .into_par_iter()
            .map(|camera| {
                let frame = self.whole.tree.cameras[camera];
                let own: Vec<f64> =
                    fitted.iter().filter(|s| s.by == frame && moves(self.whole, s)).map(apart).collect();
                let predicted = self.without(camera).unwrap_or_default();
                LeftOut {
                    camera: self.layout.cameras[camera].name.clone(),
                    positions: predicted.len(),
                    distance: root_mean_square(&predicted)
                        .map(|rms| [rms, predicted.iter().copied().fold(0.0, f64::max)]),
                    fitted: root_mean_square(&own),
                }
            })
            .collect()
    }

    /// Distances between where a camera sees what a robot moves against it and where the others, who know nothing of that camera, say it is. Where the
    /// camera itself stands is taken from what it sees of still things, if it sees any.
    fn without(&self, camera: usize) -> Option<Vec<f64>> {
        let mut rest = self.part(|_| true);
        rest.corners.retain(|row| row.camera != camera);
        rest.poses.retain(|row| row.camera != camera);
        let mut own = self.part(|_| true);
        own.corners.retain(|row| row.camera == camera);
        own.poses.retain(|row| row.camera == camera);
        (own.points, own.contacts) = (Vec::new(), Vec::new());
        let others = self.solve(&self.layout, &rest).filter(|solved| solved.report.termination.converged())?;
        let mut layout = solved_layout(&others);
        layout.solve.loss = LossSetting::Squared;
        let tree = &self.whole.tree;
        let known = |target: usize| !others.unseen.contains(&tree.targets[target]);
        own.corners.retain(|row| known(row.target));
        own.poses.retain(|row| known(row.target));
        let spec = &self.layout.cameras[camera].pose;
        if !matches!(spec, PoseSpec::Fixed(_)) && self.layout.cameras[camera].name != self.layout.world {
            let key = tree.static_edges.iter().find(|edge| edge.frame == tree.cameras[camera]).map(|edge| &edge.key);
            let pose = self.start.iter().find(|(known, _)| Some(known) == key).map(|(_, pose)| *pose)?;
            layout.cameras[camera].pose = PoseSpec::Start(pose);
            layout.cameras[camera].intrinsics.clone_from(&solved_layout(self.whole).cameras[camera].intrinsics);
            let still = |target: usize| tree.path(tree.cameras[camera], tree.targets[target]).is_static();
            let mut seen = own.clone();
            seen.corners.retain(|row| still(row.target));
            seen.poses.retain(|row| still(row.target));
            let from = if seen.corners.is_empty() && seen.poses.is_empty() { &own } else { &seen };
            let placed = self.solve(&layout, from)?;
            layout.cameras[camera].pose = PoseSpec::Fixed(placed.state.static_poses[edge_of(&placed.tree, camera)?]);
        }
        let judged = self.solve(&layout, &own)?;
        Some(distances(&judged, &own, Some(camera)))
    }

    fn halves(&self) -> Vec<Repeated> {
        let solve = |first: usize| {
            let half = self.every(2, first);
            self.solve(&self.layout, &self.part(|c| half.contains(&c)))
        };
        let (first, second) = rayon::join(|| solve(0), || solve(1));
        let (Some(first), Some(second)) = (first, second) else { return Vec::new() };
        let sigma = |solved: &Solved, edge: usize| {
            let block = &solved.plan.unknowns.blocks[solved.plan.unknowns.edge(edge)?];
            Some(solved.covariance.pose_sigma(&solved.tree, &solved.state, block, Source::Both))
        };
        let one = |(index, edge): (usize, &crate::frames::StaticEdge)| {
            let (a, b) = (sigma(&first, index)?, sigma(&second, index)?);
            let (ours, theirs) = (first.state.static_poses[index], second.state.static_poses[index]);
            let shift = ours.translation - theirs.translation;
            let turn = ours.rotation * rotation::log(&(ours.rotation.inverse() * theirs.rotation));
            let differences = shift.iter().chain(turn.iter()).zip(a.into_iter().zip(b));
            let ratios =
                differences.filter_map(|(d, (a, b))| Some(d.abs() / a?.hypot(b?)).filter(|ratio| ratio.is_finite()));
            let apart = [shift.norm(), turn.norm()];
            Some(Repeated { key: edge.key.clone(), apart, sigmas: ratios.reduce(f64::max) })
        };
        first.tree.static_edges.iter().enumerate().filter_map(one).collect()
    }

    /// The published method against the joint solve: positions of the tool from the pictures of both boards, the first half to fit, the second to judge.
    fn published(&self) -> Option<Published> {
        let Boards { robot, world, tool } = boards(&self.layout)?;
        let first = self.every(2, 0);
        let known: Vec<(u64, Sample)> = samples(&self.layout, &self.recording, robot, world, tool);
        let fit: Vec<Sample> = known.iter().filter(|(c, _)| first.contains(c)).map(|(_, sample)| *sample).collect();
        let judge: Vec<Sample> = known.iter().filter(|(c, _)| !first.contains(c)).map(|(_, sample)| *sample).collect();
        let found = free(&fit).filter(|found| found.converged && found.condition < 1e12)?;
        let solved = self.solve(&self.layout, &self.part(|c| first.contains(&c)))?;
        let tree = &solved.tree;
        let board = place_of(&solved, tree.targets[world])?;
        let board_from_base = board.inverse() * place_of(&solved, tree.robots[robot][0])?;
        let flange_from_tool =
            solved.state.static_poses[tree.static_edges.iter().position(|e| e.frame == tree.targets[tool])?];
        let errors = |predict: &dyn Fn(&Sample) -> nalgebra::Vector3<f64>| -> Vec<f64> {
            judge.iter().map(|sample| (predict(sample) - sample.world_point).norm()).collect()
        };
        let published = errors(&|s| found.matrix * (s.base_from_flange * found.tool) + found.origin);
        let joint = errors(&|s| board_from_base * (s.base_from_flange * flange_from_tool.translation));
        Some(Published {
            robot: self.layout.robots[robot].name.clone(),
            positions: judge.len(),
            published: root_mean_square(&published)?,
            joint: root_mean_square(&joint)?,
        })
    }
}

/// `world_from_frame` of a frame that stands still.
fn place_of(solved: &Solved, frame: usize) -> Option<Pose> {
    if frame == 0 { Some(Pose::identity()) } else { solved.world_from(&solved.tree.frames[frame].name) }
}

fn edge_of(tree: &FrameTree, camera: usize) -> Option<usize> {
    tree.static_edges.iter().position(|edge| edge.frame == tree.cameras[camera])
}

/// Whether a robot moves what is seen against who sees it.
fn moves(solved: &Solved, sight: &Sight) -> bool {
    solved.tree.path(sight.by, sight.of).steps.iter().any(|step| matches!(step, Step::Robot { .. }))
}

fn apart(sight: &Sight) -> f64 {
    (sight.measured.translation - sight.computed.translation).norm()
}

/// How far what robots move is seen from where a solution has it, m; by one camera or by all.
fn distances(solved: &Solved, recording: &Recording, camera: Option<usize>) -> Vec<f64> {
    let all = sights(&Places { solved, recording });
    let by = camera.map(|camera| solved.tree.cameras[camera]);
    all.iter().filter(|s| moves(solved, s) && by.is_none_or(|by| s.by == by)).map(apart).collect()
}

fn root_mean_square(all: &[f64]) -> Option<f64> {
    (!all.is_empty()).then(|| (all.iter().map(|x| x * x).sum::<f64>() / all.len() as f64).sqrt())
}
