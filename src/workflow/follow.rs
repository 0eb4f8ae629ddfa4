//! What the residuals of a sound fit still tell: a factor on the distances, and what they follow.

use std::time::Instant;

use super::repair::rescaled;
use super::solve::{Solved, solve_plain};
use crate::geometry::Pose;
use crate::recording::Recording;
use crate::solve::Normal;
use crate::trust::systematic::{Factor, systematic};
use crate::trust::{Covariance, Evidence, Remark, Residuals, Scale, scale_remarks, scales};

/// Where all distances have a factor, one linear step from a cell that was solved with it is not exact: solves once more without it, and adds what is
/// left.
pub(super) fn follow_scale(solved: &mut Solved, recording: &Recording, start: &[(String, Pose)]) {
    let whole = solved.scales.iter().find(|scale| scale.of.is_none()).map(|scale| scale.excess);
    let named = solved.remarks.iter().any(|remark| remark.factor == Factor::Scale);
    let Some(excess) = whole.filter(|_| named) else { return };
    let (layout, mended) = rescaled(&solved.layout, recording, excess);
    let Ok(again) = solve_plain(layout, &mended, start, Vec::new(), Instant::now(), true) else { return };
    if again.scales.len() != solved.scales.len() {
        return;
    }
    for (scale, rest) in solved.scales.iter_mut().zip(&again.scales) {
        scale.excess = (1.0 + excess) * (1.0 + rest.excess) - 1.0;
        scale.sigma = rest.sigma;
    }
    let targets: Vec<String> = solved.layout.targets.iter().map(|target| target.name.clone()).collect();
    solved.remarks.retain(|remark| remark.factor != Factor::Scale);
    solved.remarks.splice(0..0, scale_remarks(&solved.scales, &targets));
}

/// What the residuals still tell: factors on distances, and what they follow. Nothing where directions are open.
pub(super) fn follow_up(
    evidence: &Evidence<'_>,
    residuals: &Residuals,
    covariance: &Covariance,
    believed: &Normal,
) -> (Vec<Scale>, Vec<Remark>) {
    if !covariance.open.is_empty() {
        return (Vec::new(), Vec::new());
    }
    let scales = scales(evidence, believed, covariance.noise);
    let targets: Vec<String> = evidence.layout.targets.iter().map(|target| target.name.clone()).collect();
    let mut remarks = scale_remarks(&scales, &targets);
    remarks.extend(systematic(evidence, residuals));
    (scales, remarks)
}
