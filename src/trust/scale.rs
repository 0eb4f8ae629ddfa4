//! Whether all distances are too long or too short by a common factor.
//!
//! A robot's links are a ruler, a target's printed size is another, and a lens or a corner that is always pulled inwards makes a third. If they disagree,
//! the poses absorb most of it and the residual stays small, but everything is where the wrong ruler has it. So after the solve a factor on
//! the distances is fitted by one more linearised step, for all of them together and for each camera and each target, with an interval from the scatter between
//! configurations (the sandwich of H. White, *A heteroskedasticity-consistent covariance matrix estimator*, Econometrica 48, 1980, with one score for each
//! cluster of measurements).

use nalgebra::DVector;
use rayon::prelude::*;
use std::collections::BTreeMap;

use super::bordered::{Placed, Solver};
use super::influence::{Added, Term, terms};
use super::systematic::{Factor, Remark};
use super::undetermined::Evidence;
use crate::complaint::list;
use crate::frames::FrameId;
use crate::solve::{Normal, Plan};

/// What a factor acts on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScaleKind {
    /// Distances from a sensor to a target: measured over true.
    Distances,
    /// A focal length: as the residuals have it over as told.
    Focal,
}

/// A factor on distances or a focal length as the residuals have it.
#[derive(Clone, Debug, PartialEq)]
pub struct Scale {
    /// On what it acts.
    pub kind: ScaleKind,
    /// Whose: a camera, a target, or all of them (`None`).
    pub of: Option<String>,
    /// The factor, minus one.
    pub excess: f64,
    /// Its standard deviation, from the scatter between clusters.
    pub sigma: f64,
}

/// Clusters that a verdict needs.
const CLUSTERS: usize = 8;
/// A factor known to less than this is not told.
const KNOWN: f64 = 0.02;
/// A factor is named when it is this many standard deviations from nothing, and at least so large.
const CLEAR: f64 = 4.0;
const LARGE: f64 = 0.002;
/// Half a 95 % interval in standard deviations.
const INTERVAL: f64 = 1.96;

/// The factors on all distances, on each camera's and on each target's. Empty where nothing else tells how long anything is. `believed` is the
/// information of the priors, `noise` the fitted noise.
///
/// Costs about one linearisation. Targets that move by themselves or touch have unknowns of their own and are not judged.
#[must_use]
pub fn scales(evidence: &Evidence<'_>, believed: &Normal, noise: f64) -> Vec<Scale> {
    let Some((terms, columns)) = terms(evidence).filter(|(_, columns)| !columns.is_empty()) else { return Vec::new() };
    let problem = Problem { plan: evidence.plan, terms: &terms, believed, weight: noise * noise };
    let name = |frame: FrameId| evidence.tree.frames[frame].name.clone();
    let distances: Vec<Added> = columns.iter().filter(|column| column.kind == ScaleKind::Distances).copied().collect();
    let whole = vec![(None, distances.clone())];
    let by = |columns: &[Added], of: &dyn Fn(&Added) -> FrameId| {
        let mut groups: BTreeMap<FrameId, Vec<Added>> = BTreeMap::new();
        columns.iter().for_each(|column| groups.entry(of(column)).or_default().push(*column));
        groups.into_iter().map(|(frame, columns)| (Some(name(frame)), columns)).collect::<Vec<_>>()
    };
    let mut all = fit(&problem, &whole);
    // Of a camera with corners its focal length is doubted, of one that measures poses its distances.
    let focal = |from: FrameId| columns.iter().any(|column| column.kind == ScaleKind::Focal && column.from == from);
    let cameras: Vec<Added> =
        columns.iter().filter(|c| c.kind == ScaleKind::Focal || !focal(c.from)).copied().collect();
    for groups in [by(&cameras, &|column| column.from), by(&distances, &|column| column.to)] {
        if groups.len() > 1 {
            all.extend(fit(&problem, &groups));
        }
    }
    all
}

/// What is fitted.
struct Problem<'a> {
    plan: &'a Plan,
    terms: &'a [Term],
    believed: &'a Normal,
    /// What the priors' information is multiplied by.
    weight: f64,
}

/// Fits one factor for each group of columns, all of them together with everything else.
fn fit(problem: &Problem<'_>, groups: &[(Option<String>, Vec<Added>)]) -> Vec<Scale> {
    let (terms, shared) = (problem.terms, problem.plan.unknowns.count);
    let count = shared + groups.len();
    // Where each column of the plan goes.
    let mut place: BTreeMap<usize, usize> = (0..shared).map(|i| (i, i)).collect();
    for (i, (_, columns)) in groups.iter().enumerate() {
        columns.iter().for_each(|column| {
            place.insert(column.column, shared + i);
        });
    }
    let places =
        |term: &Term| -> Vec<Option<usize>> { term.columns.iter().map(|column| place.get(column).copied()).collect() };
    let mut gradient = DVector::zeros(count);
    for term in terms {
        for (a, value) in places(term).into_iter().zip(term.gradient.iter()) {
            if let Some(a) = a {
                gradient[a] += value;
            }
        }
    }
    let added: Vec<Placed<'_>> = terms.iter().map(|term| (places(term), &term.information)).collect();
    let Some(solver) = Solver::new(problem.plan, &added, problem.believed, problem.weight, count) else {
        return Vec::new();
    };
    let step = -solver.solve(&gradient);
    let clusters = terms.len() as f64;
    // Scores after the step, so that the factor itself is no scatter.
    let after: Vec<DVector<f64>> = terms
        .iter()
        .zip(&added)
        .map(|(term, (at, _))| {
            let taken = DVector::from_iterator(at.len(), at.iter().map(|a| a.map_or(0.0, |a| step[a])));
            &term.gradient + &term.information * taken
        })
        .collect();
    let one = |(i, (of, columns)): (usize, &(Option<String>, Vec<Added>))| {
        let mut unit = DVector::zeros(count);
        unit[shared + i] = 1.0;
        let influence = solver.solve(&unit);
        let score = |((at, _), after): (&Placed<'_>, &DVector<f64>)| {
            at.iter().zip(after.iter()).map(|(a, g)| a.map_or(0.0, |a| influence[a] * g)).sum::<f64>()
        };
        let squares: f64 = added.iter().zip(&after).map(|pair| score(pair).powi(2)).sum();
        let sigma = (squares * clusters / (clusters - 1.0)).sqrt();
        // What the information alone allows: clusters that agree by chance are no proof.
        let honest = sigma.is_finite() && sigma < KNOWN && influence[shared + i].sqrt() < KNOWN;
        honest.then(|| Scale { kind: columns[0].kind, of: of.clone(), excess: step[shared + i], sigma })
    };
    if (clusters as usize) < CLUSTERS {
        return Vec::new();
    }
    groups.par_iter().enumerate().filter_map(one).collect()
}

/// Factors that are significant and large enough to matter, in words.
#[must_use]
pub fn scale_remarks(scales: &[Scale], targets: &[String]) -> Vec<Remark> {
    let clear = |scale: &&Scale| scale.excess.abs() > CLEAR * scale.sigma && scale.excess.abs() > LARGE;
    let far = |excess: f64| if excess > 0.0 { "too far" } else { "too near" };
    let interval = |scale: &Scale| {
        let ends = [-INTERVAL, INTERVAL].map(|k| 100.0 * (scale.excess + k * scale.sigma).abs());
        format!("{:.2} to {:.2} %", ends[0].min(ends[1]), ends[0].max(ends[1]))
    };
    let remark = |scale: &Scale, what: String, remedy: String| Remark {
        factor: Factor::Scale,
        what,
        remedy,
        size: 100.0 * scale.excess,
        unit: "%",
        interval: Some(100.0 * INTERVAL * scale.sigma),
    };
    let parts = |of_target: bool| -> Vec<&Scale> {
        let of = |scale: &&Scale| scale.of.as_ref().is_some_and(|name| targets.contains(name) == of_target);
        scales.iter().filter(of).collect()
    };
    let mut all = Vec::new();
    let sure = |scale: &Scale| scale.excess.abs() / scale.sigma;
    let whole = scales.iter().find(|scale| scale.of.is_none());
    // One that stands out among several, and explains more than a factor on everything, is the culprit; if none does, it is all of them.
    for of_target in [true, false] {
        let parts = parts(of_target);
        let out: Vec<&&Scale> = parts.iter().filter(|scale| clear(scale)).collect();
        if let [one] = out[..]
            && parts.len() > 1
            && whole.is_none_or(|whole| sure(one) > sure(whole))
        {
            let name = one.of.clone().unwrap_or_default();
            let (percent, interval) = (100.0 * one.excess.abs(), interval(one));
            let (what, remedy) = match (one.kind, of_target) {
                (ScaleKind::Focal, _) => (
                    format!(
                        "the focal length of `{name}` fits if it is {percent:.2} % {} than told (95 % interval {interval})",
                        if one.excess > 0.0 { "longer" } else { "shorter" }
                    ),
                    format!("calibrate `{name}`, or let its focal length be found (`refine: [focal]`)"),
                ),
                (ScaleKind::Distances, true) => (
                    format!("`{name}` appears {percent:.2} % {} (95 % interval {interval})", far(one.excess)),
                    "check its printed size, and how its corners are refined".to_owned(),
                ),
                (ScaleKind::Distances, false) => (
                    format!("what `{name}` sees appears {percent:.2} % {} (95 % interval {interval})", far(one.excess)),
                    "check its focal length, and how its poses are measured".to_owned(),
                ),
            };
            all.push(remark(one, what, remedy));
        }
    }
    if let Some(whole) = whole.filter(clear)
        && all.is_empty()
    {
        let cameras = parts(false);
        let by: Vec<String> = cameras
            .iter()
            .filter(|scale| scale.kind == ScaleKind::Distances)
            .filter_map(|scale| scale.of.as_ref().map(|name| format!("`{name}` {:+.2} %", 100.0 * scale.excess)))
            .collect();
        let by = if by.is_empty() { String::new() } else { format!("; by camera {}", by.join(", ")) };
        let what = format!(
            "targets appear {:.2} % {} (95 % interval {}){by}",
            100.0 * whole.excess.abs(),
            far(whole.excess),
            interval(whole)
        );
        let sizes = if targets.is_empty() {
            String::new()
        } else {
            format!(" of {}", list(targets.iter().map(String::as_str)))
        };
        all.push(remark(
            whole,
            what,
            format!("check the printed size{sizes}, the focal lengths, and how corners are refined"),
        ));
    }
    all
}
