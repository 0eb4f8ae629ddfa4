//! The residuals of a solution, kind by kind.

use std::ops::Range;

use crate::geometry::lens::{Lens, with_lens};
use crate::geometry::{LensModel, Pose};
use crate::layout::Layout;
use crate::solve::kernels::pose_residuals;
use crate::solve::{GroupKind, Loss, Plan, State};

/// What is left of the measurements at a state.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Residuals {
    /// (du, dv) in px of each corner of the plan; not numbers where it was rejected or cannot be seen.
    corners: Vec<[f64; 2]>,
    /// Translation (m) and rotation (rad) errors of each measured pose.
    pub poses: Vec<Option<[f64; 2]>>,
    /// Error (m) of each measured point.
    pub points: Vec<Option<f64>>,
    /// Error (m) of each contact.
    pub contacts: Vec<Option<f64>>,
    /// Squared whitened norm of each pose's translation and rotation; of each point; of each contact.
    pub whitened: [Vec<f64>; 3],
    /// Sum of robust weight times squared whitened residual.
    pub weighted_sum: f64,
}

/// How far accepted measurements are off, all of a kind together.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Summary {
    /// Corners, and the sum of their squares (px^2).
    pub corners: (usize, f64),
    /// Whole poses, and the sums of the squares of translations (m^2) and rotations (rad^2).
    pub poses: (usize, [f64; 2]),
    /// Points, and the sum of their squares (m^2).
    pub points: (usize, f64),
    /// Contacts, and the sum of their squares (m^2).
    pub contacts: (usize, f64),
}

impl Summary {
    /// Takes in other measurements.
    pub fn add(&mut self, more: &Self) {
        let sum = |a: (usize, f64), b: (usize, f64)| (a.0 + b.0, a.1 + b.1);
        self.corners = sum(self.corners, more.corners);
        self.poses = (self.poses.0 + more.poses.0, [0, 1].map(|i| self.poses.1[i] + more.poses.1[i]));
        self.points = sum(self.points, more.points);
        self.contacts = sum(self.contacts, more.contacts);
    }

    /// Root mean square over the accepted corners, px a coordinate.
    #[must_use]
    pub fn rms_px(&self) -> Option<f64> {
        root_mean_square(self.corners.0, self.corners.1, 2.0)
    }

    /// Root mean square translation (m) and rotation (rad) error of measured poses.
    #[must_use]
    pub fn rms_poses(&self) -> Option<[f64; 2]> {
        let part = |i: usize| root_mean_square(self.poses.0, self.poses.1[i], 1.0);
        Some([part(0)?, part(1)?])
    }

    /// Root mean square error (m) of measured points.
    #[must_use]
    pub fn rms_points(&self) -> Option<f64> {
        root_mean_square(self.points.0, self.points.1, 1.0)
    }

    /// Root mean square error (m) of contacts.
    #[must_use]
    pub fn rms_contacts(&self) -> Option<f64> {
        root_mean_square(self.contacts.0, self.contacts.1, 1.0)
    }
}

fn root_mean_square(count: usize, sum: f64, each: f64) -> Option<f64> {
    (count > 0).then(|| (sum / (each * count as f64)).sqrt())
}

impl Residuals {
    /// (du, dv) in px of a corner of the plan; none where it was rejected or cannot be seen.
    #[must_use]
    pub fn corner(&self, i: usize) -> Option<[f64; 2]> {
        Some(self.corners[i]).filter(|d| !d[0].is_nan())
    }

    /// As [`Residuals::corner`], of neighbouring corners.
    pub fn corners(&self, range: Range<usize>) -> impl Iterator<Item = Option<[f64; 2]>> {
        range.map(|i| self.corner(i))
    }

    /// The corners that were accepted and can be seen.
    pub fn seen(&self) -> impl Iterator<Item = [f64; 2]> {
        self.corners(0..self.corners.len()).flatten()
    }

    /// All of a kind together.
    #[must_use]
    pub fn summary(&self) -> Summary {
        let sum = |squares: &mut dyn Iterator<Item = f64>| squares.fold((0, 0.0), |(n, sum), s| (n + 1, sum + s));
        let corners = sum(&mut self.seen().map(|d| d[0] * d[0] + d[1] * d[1]));
        let [translations, rotations] = [0, 1].map(|i| sum(&mut self.poses.iter().flatten().map(|e| e[i] * e[i])));
        Summary {
            corners,
            poses: (translations.0, [translations.1, rotations.1]),
            points: sum(&mut self.points.iter().flatten().map(|e| e * e)),
            contacts: sum(&mut self.contacts.iter().flatten().map(|e| e * e)),
        }
    }
}

/// Computes the residuals at a state whose blocks have the transforms `poses[group][block]`.
#[must_use]
pub fn residuals(layout: &Layout, plan: &Plan, state: &State, poses: &[Vec<Pose>], loss: Loss) -> Residuals {
    let m = &plan.measurements;
    let mut all = Residuals {
        corners: vec![[f64::NAN; 2]; m.corner_count()],
        poses: vec![None; m.poses.len()],
        points: vec![None; m.points.len()],
        contacts: vec![None; m.contacts.len()],
        whitened: [2 * m.poses.len(), m.points.len(), m.contacts.len()].map(|n| vec![0.0; n]),
        weighted_sum: 0.0,
    };
    for (group, poses) in plan.groups.iter().zip(poses) {
        for (block, pose) in group.blocks.iter().zip(poses) {
            for i in block.start..block.end {
                match group.kind {
                    GroupKind::Corners { camera } => {
                        let model =
                            layout.cameras[camera].intrinsics.as_ref().map_or(LensModel::Pinhole, |x| x.model());
                        let point: [f64; 3] = (*pose * nalgebra::Vector3::from(m.place(i))).into();
                        let projected = with_lens!(model, L => L::project(&state.lenses[camera], &point));
                        if m.is_kept(i)
                            && let Some(pixel) = projected
                        {
                            let d = [pixel[0] - m.pixel(i)[0], pixel[1] - m.pixel(i)[1]];
                            all.corners[i] = d;
                            all.weighted_sum += weighted(m.whitened(i, d), loss);
                        }
                    }
                    GroupKind::Poses => {
                        if let Some(measured) = &m.poses[i] {
                            let sigma = plan.settings.pose_sigma;
                            let (t, r) = pose_residuals(measured, pose, sigma);
                            all.poses[i] = Some([t.norm() * sigma[0], r.norm() * sigma[1]]);
                            (all.whitened[0][2 * i], all.whitened[0][2 * i + 1]) = (t.norm_squared(), r.norm_squared());
                            all.weighted_sum += weighted(t.norm_squared(), loss) + weighted(r.norm_squared(), loss);
                        }
                    }
                    GroupKind::Points => {
                        if let Some((place, measured)) = &m.points[i] {
                            let error = (*pose * *place - measured).norm();
                            let s = (error / plan.settings.point_sigma).powi(2);
                            all.points[i] = Some(error);
                            all.whitened[1][i] = s;
                            all.weighted_sum += weighted(s, loss);
                        }
                    }
                    GroupKind::Contacts => {
                        if let Some(contact) = &m.contacts[i] {
                            let error = (*pose * contact.b - contact.a).norm() - contact.distance;
                            let s = (error / plan.settings.contact_sigma).powi(2);
                            all.contacts[i] = Some(error);
                            all.whitened[2][i] = s;
                            all.weighted_sum += weighted(s, loss);
                        }
                    }
                }
            }
        }
    }
    all
}

fn weighted(squared: f64, loss: Loss) -> f64 {
    squared * loss.evaluate(squared).1
}
