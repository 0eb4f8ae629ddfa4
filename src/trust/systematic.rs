//! What is left over and follows something: distance, viewing angle, the place in the picture, a joint.
//!
//! Noise averages out and is in the standard deviations; what follows something does neither. For every camera the residuals of tags, boards and
//! measured poses are sorted into bins of a factor, and the means of the bins held against their own scatter. All of one tag or board in a picture
//! count as one, all pictures of a configuration as one, and where camera and target stand still, all pictures of a tag, because they repeat the
//! same error.

use std::collections::BTreeMap;

use super::residuals::Residuals;
use super::responses::{Response, responses};
use super::undetermined::Evidence;
use crate::recording::RobotMotion;
use crate::solve::Group;

/// What residuals follow.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Factor {
    /// The scale of all distances.
    Scale,
    /// How far the target is.
    Distance,
    /// How far its face leans from the line of sight.
    Angle,
    /// Where it is in the picture.
    ImagePlace,
    /// The value of a robot's joint.
    Joint,
}

impl Factor {
    /// The word that files carry.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Scale => "scale",
            Self::Distance => "distance",
            Self::Angle => "viewing_angle",
            Self::ImagePlace => "image_place",
            Self::Joint => "joint",
        }
    }
}

/// Something that a reader should know although the fit is sound.
#[derive(Clone, Debug, PartialEq)]
pub struct Remark {
    /// What it follows.
    pub factor: Factor,
    /// What, in one sentence without a full stop.
    pub what: String,
    /// What to check.
    pub remedy: String,
    /// How large it is, from the least to the greatest bin (px or mm; a scale in per cent).
    pub size: f64,
    /// `px`, `mm` or `%`.
    pub unit: &'static str,
    /// Half the width of a 95 % interval of a scale, per cent.
    pub interval: Option<f64>,
}

/// Bins of a factor with one dimension; fewer, where there is little to put in.
const BINS: usize = 5;
/// Independent means that a bin needs, and bins that a verdict needs.
const MEANS: usize = 6;
const LEAST_BINS: usize = 3;
/// What the bins' means scatter more than their members let expect (the F statistic of one-way analysis of variance, Fisher 1925), beyond chance
/// even among all the factors that are looked at.
const CLEAR: f64 = 16.0;
/// Differences between bins smaller than this share of the scatter within bins are of no matter.
const MATTERS: f64 = 0.7;
/// Remarks of one camera at most.
const TOLD: usize = 3;

/// A bin's place on the factor, the mean and variance of its independent means, and their number.
#[derive(Clone, Copy, Debug)]
struct Bin {
    at: [f64; 2],
    mean: f64,
    variance: f64,
    count: f64,
}

/// Where a response stands on a factor.
#[derive(Clone, Copy, Debug)]
enum Value {
    Along(f64),
    InPicture([f64; 2]),
}

impl Value {
    fn at(self) -> [f64; 2] {
        match self {
            Self::Along(value) => [value, 0.0],
            Self::InPicture(place) => place,
        }
    }
}

/// The remarks on one solution, the largest (against the scatter) of each camera first.
#[must_use]
pub fn systematic(evidence: &Evidence<'_>, residuals: &Residuals) -> Vec<Remark> {
    let mut by_camera: BTreeMap<(usize, bool), Vec<Response>> = BTreeMap::new();
    for group in 0..evidence.plan.groups.len() {
        let responses = responses(evidence, residuals, group);
        if let Some(first) = responses.first() {
            by_camera.entry((first.camera, first.pose)).or_default().extend(responses);
        }
    }
    let mut all = Vec::new();
    for ((camera, pose), responses) in &by_camera {
        let name = &evidence.layout.cameras[*camera].name;
        let unit = if *pose { ("mm", 1e3) } else { ("px", 1.0) };
        let mut found: Vec<(f64, Remark)> = Vec::new();
        found.extend(follows(
            responses,
            |r| Some(Value::Along(r.distance)),
            ALONG,
            |bins, size| {
                (Factor::Distance, distance_words(name, bins, unit), SIZE_REMEDY.to_owned(), size * unit.1, unit.0)
            },
        ));
        found.extend(follows(
            responses,
            |r| r.angle.map(Value::Along),
            ALONG,
            |bins, size| {
                let (low, high) = ends(bins);
                let what = format!(
                    "`{name}`: targets seen under {:.0} deg appear {:.3} {} {}, under {:.0} deg {:.3} {} {}",
                    low.at[0].to_degrees(),
                    low.mean.abs() * unit.1,
                    unit.0,
                    larger(low.mean, *pose),
                    high.at[0].to_degrees(),
                    high.mean.abs() * unit.1,
                    unit.0,
                    larger(high.mean, *pose)
                );
                (
                    Factor::Angle,
                    what,
                    "check how corners are refined, and that the targets are flat".to_owned(),
                    size * unit.1,
                    unit.0,
                )
            },
        ));
        for axis in [ACROSS_X, ACROSS_Y] {
            found.extend(follows(
                responses,
                |r| Some(Value::InPicture(r.place)),
                axis,
                |bins, size| {
                    let worst = bins.iter().fold(bins[0], |a, b| if b.mean.abs() > a.mean.abs() { *b } else { a });
                    let what = format!(
                        "`{name}`: what is seen in the {} of the picture is {:.3} {} too far {}",
                        region(worst.at),
                        worst.mean.abs() * unit.1,
                        unit.0,
                        direction(axis, worst.mean)
                    );
                    let remedy = if *pose {
                        "check the lens that the poses were measured with".to_owned()
                    } else {
                        format!("refine the lens of `{name}` (`refine: [focal, centre, distortion]`), or calibrate it")
                    };
                    (Factor::ImagePlace, what, remedy, size * unit.1, unit.0)
                },
            ));
        }
        found.extend(joints(evidence, responses, name, unit));
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut told = Vec::new();
        for (_, remark) in found {
            if !told.contains(&remark.factor) && told.len() < TOLD {
                told.push(remark.factor);
                all.push(remark);
            }
        }
    }
    all
}

/// Which component of a response is looked at: along the line of sight, or across it.
const ALONG: usize = 2;
const ACROSS_X: usize = 0;
const ACROSS_Y: usize = 1;

const SIZE_REMEDY: &str = "check tag sizes, the focal length and how corners are refined";

fn ends(bins: &[Bin]) -> (Bin, Bin) {
    (bins[0], bins[bins.len() - 1])
}

fn larger(mean: f64, pose: bool) -> &'static str {
    match (pose, mean > 0.0) {
        (false, true) => "too large",
        (false, false) => "too small",
        (true, true) => "too far",
        (true, false) => "too near",
    }
}

fn distance_words(name: &str, bins: &[Bin], (unit, scale): (&str, f64)) -> String {
    let (low, high) = ends(bins);
    let pose = unit == "mm";
    format!(
        "`{name}`: targets at {:.2} m appear {:.3} {unit} {}, at {:.2} m {:.3} {unit} {}",
        low.at[0],
        low.mean.abs() * scale,
        larger(low.mean, pose),
        high.at[0],
        high.mean.abs() * scale,
        larger(high.mean, pose)
    )
}

fn direction(axis: usize, mean: f64) -> &'static str {
    match (axis, mean > 0.0) {
        (ACROSS_X, true) => "right",
        (ACROSS_X, false) => "left",
        (_, true) => "down",
        (_, false) => "up",
    }
}

fn region(at: [f64; 2]) -> &'static str {
    let third = |x: f64| if x < 1.0 / 3.0 { 0 } else { usize::from(x > 2.0 / 3.0) + 1 };
    let names = [
        ["upper left", "upper middle", "upper right"],
        ["left", "middle", "right"],
        ["lower left", "lower middle", "lower right"],
    ];
    names[third(at[1])][third(at[0])]
}

/// The joint that residuals follow most clearly.
fn joints(
    evidence: &Evidence<'_>,
    responses: &[Response],
    name: &str,
    (unit, scale): (&'static str, f64),
) -> Option<(f64, Remark)> {
    let mut best: Option<(f64, Remark)> = None;
    for (robot, described) in evidence.layout.robots.iter().enumerate() {
        let RobotMotion::Joints(values) = &evidence.recording.motions[robot] else { continue };
        let crosses = |group: &Group| group.path.robots().any(|walked| walked == robot);
        let crossed: Vec<bool> = evidence.plan.groups.iter().map(crosses).collect();
        let count = values.values().next().map_or(0, Vec::len);
        for joint in 0..count {
            let value = |r: &Response| {
                let joints = values.get(&evidence.plan.configurations[r.configuration]).filter(|_| crossed[r.group])?;
                Some(Value::Along(joints[joint]))
            };
            for axis in [ACROSS_X, ACROSS_Y, ALONG] {
                let found = follows(responses, value, axis, |bins, size| {
                    let (low, high) = ends(bins);
                    let what = format!(
                        "`{name}`: with joint {} of `{}` at {:.1} deg the residual is {:+.3} {unit}, at {:.1} deg {:+.3} {unit}",
                        joint + 1,
                        described.name,
                        low.at[0].to_degrees(),
                        low.mean * scale,
                        high.at[0].to_degrees(),
                        high.mean * scale
                    );
                    let remedy = format!(
                        "let the links of `{}` be found (`identify`), or check its joint values against its model",
                        described.name
                    );
                    (Factor::Joint, what, remedy, size * scale, unit)
                });
                if let Some(found) = found
                    && best.as_ref().is_none_or(|known| found.0 > known.0)
                {
                    best = Some(found);
                }
            }
        }
    }
    best
}

/// Whether a component follows a factor: how clearly, and the remark that `words` makes of the bins and the range of their means.
fn follows(
    responses: &[Response],
    factor: impl Fn(&Response) -> Option<Value>,
    component: usize,
    words: impl FnOnce(&[Bin], f64) -> (Factor, String, String, f64, &'static str),
) -> Option<(f64, Remark)> {
    let bins = bins(responses, factor, component)?;
    let all: f64 = bins.iter().map(|bin| bin.count).sum();
    let mean = bins.iter().map(|bin| bin.mean * bin.count).sum::<f64>() / all;
    let within: f64 = bins.iter().map(|bin| bin.variance * (bin.count - 1.0)).sum();
    let scatter = (within / (all - bins.len() as f64)).sqrt();
    let between: f64 = bins.iter().map(|bin| bin.count * (bin.mean - mean).powi(2)).sum();
    let clear = between / (bins.len() - 1) as f64 / (scatter * scatter);
    let (low, high) = bins.iter().fold((f64::MAX, f64::MIN), |(l, h), bin| (l.min(bin.mean), h.max(bin.mean)));
    if clear < CLEAR || high - low < MATTERS * scatter {
        return None;
    }
    let (factor, what, remedy, size, unit) = words(&bins, high - low);
    Some(((high - low) / scatter, Remark { factor, what, remedy, size, unit, interval: None }))
}

/// The means of a component in bins of a factor: five of equal counts along one dimension, thirds of the picture in two.
fn bins(responses: &[Response], factor: impl Fn(&Response) -> Option<Value>, component: usize) -> Option<Vec<Bin>> {
    let mut valued: Vec<(Value, &Response)> = responses.iter().filter_map(|r| Some((factor(r)?, r))).collect();
    if let Value::Along(_) = valued.first()?.0 {
        valued.sort_by(|a, b| a.0.at()[0].total_cmp(&b.0.at()[0]));
    }
    let count = valued.len();
    // Few independent means are put into few bins.
    let mut clusters: Vec<u64> = valued.iter().map(|(_, r)| r.cluster).collect();
    clusters.sort_unstable();
    clusters.dedup();
    let number = if clusters.len() < 2 * BINS * MEANS { LEAST_BINS } else { BINS };
    let mut members: BTreeMap<usize, Vec<&(Value, &Response)>> = BTreeMap::new();
    for (i, one) in valued.iter().enumerate() {
        let third = |x: f64| if x < 1.0 / 3.0 { 0 } else { usize::from(x > 2.0 / 3.0) + 1 };
        let bin = match one.0 {
            Value::InPicture([x, y]) => 3 * third(y) + third(x),
            Value::Along(_) => i * number / count,
        };
        members.entry(bin).or_default().push(one);
    }
    let bins: Vec<Bin> = members.values().filter_map(|members| bin(members, component)).collect();
    (bins.len() >= LEAST_BINS).then_some(bins)
}

fn bin(members: &[&(Value, &Response)], component: usize) -> Option<Bin> {
    let mut clusters: BTreeMap<u64, (f64, f64)> = BTreeMap::new();
    for (_, response) in members {
        let sum = clusters.entry(response.cluster).or_default();
        *sum = (sum.0 + response.value[component], sum.1 + 1.0);
    }
    let means: Vec<f64> = clusters.values().map(|(sum, count)| sum / count).collect();
    if means.len() < MEANS {
        return None;
    }
    let count = means.len() as f64;
    let mean = means.iter().sum::<f64>() / count;
    let variance = means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (count - 1.0);
    let at = |axis: usize| members.iter().map(|(value, _)| value.at()[axis]).sum::<f64>() / members.len() as f64;
    (variance > 0.0).then(|| Bin { at: [at(0), at(1)], mean, variance, count })
}
