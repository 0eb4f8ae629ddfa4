//! Numbers of the figures: tool paths, clouds, boxes, residuals, correlations.

use serde_json::{Value, json};
use std::collections::BTreeMap;

use super::ReportInput;
use super::scene::{round, spread};
use crate::export::covariance::column_names;
use crate::geometry::{Pose, rotation};
use crate::workflow::measured::Sight;

/// Points of one figure at most: more would only be ink. The tables count all.
const MOST_POINTS: usize = 2500;
/// Bins of a histogram.
const BINS: usize = 61;
/// Unknowns whose correlations are shown one by one.
const MOST_COLUMNS: usize = 90;

/// All figures' numbers.
pub(super) fn figures(input: &ReportInput<'_>, sights: &[Sight]) -> Value {
    json!({
        "paths": paths(input, sights),
        "errors": errors(input, sights),
        "residuals": residuals(input),
        "stops": by_configuration(input, sights),
        "correlation": correlation(input),
    })
}

fn name<'a>(input: &ReportInput<'a>, frame: usize) -> &'a str {
    &input.solved.tree.frames[frame].name
}

fn millimetres(values: impl Iterator<Item = f64>) -> Vec<Value> {
    values.map(|v| round(v * 1e3, 3)).collect()
}

/// Measured and computed places of everything that moves, by target; mm, world axes.
fn paths(input: &ReportInput<'_>, sights: &[Sight]) -> Vec<Value> {
    let mut by_target: BTreeMap<usize, Vec<&Sight>> = BTreeMap::new();
    for sight in sights {
        by_target.entry(sight.of).or_default().push(sight);
    }
    let mut all = Vec::new();
    for (target, mut sights) in by_target {
        sights.sort_by_key(|sight| (sight.configuration, sight.by));
        let middle =
            sights.iter().map(|s| s.computed.translation).sum::<nalgebra::Vector3<f64>>() / sights.len() as f64;
        let moved = sights.iter().map(|s| (s.computed.translation - middle).norm()).fold(0.0, f64::max);
        if moved < 1e-3 {
            continue;
        }
        let mut computed: Vec<&Sight> = Vec::new();
        for sight in &sights {
            if computed.last().is_none_or(|last| last.configuration != sight.configuration) {
                computed.push(sight);
            }
        }
        let computed: Vec<&Sight> = spread(computed.len(), MOST_POINTS).into_iter().map(|i| computed[i]).collect();
        let mut by_sensor: BTreeMap<usize, Vec<&Sight>> = BTreeMap::new();
        for sight in &sights {
            by_sensor.entry(sight.by).or_default().push(sight);
        }
        let most = MOST_POINTS / by_sensor.len().max(1);
        let measured: Vec<Value> = by_sensor
            .into_iter()
            .map(|(sensor, sights)| {
                let shown: Vec<&Sight> = spread(sights.len(), most).into_iter().map(|i| sights[i]).collect();
                let axis = |i: usize| millimetres(shown.iter().map(|s| s.measured.translation[i]));
                let ids: Vec<u64> = shown.iter().map(|s| input.solved.plan.configurations[s.configuration]).collect();
                json!({"by": name(input, sensor), "x": axis(0), "y": axis(1), "z": axis(2), "configuration": ids, "of": sights.len()})
            })
            .collect();
        let axis = |i: usize| millimetres(computed.iter().map(|s| s.computed.translation[i]));
        let ids: Vec<u64> = computed.iter().map(|s| input.solved.plan.configurations[s.configuration]).collect();
        all.push(json!({
            "target": name(input, target),
            "computed": {"x": axis(0), "y": axis(1), "z": axis(2), "configuration": ids},
            "measured": measured,
        }));
    }
    all
}

/// `measured - computed` of every sight by camera: translation (mm, world axes), rotation vector (deg), and where the world would have to be for the
/// picture to be right (mm).
fn errors(input: &ReportInput<'_>, sights: &[Sight]) -> Vec<Value> {
    let mut by_sensor: BTreeMap<usize, Vec<&Sight>> = BTreeMap::new();
    for sight in sights {
        by_sensor.entry(sight.by).or_default().push(sight);
    }
    let most = MOST_POINTS / by_sensor.len().max(1);
    by_sensor
        .into_iter()
        .map(|(sensor, sights)| {
            let shown: Vec<&Sight> = spread(sights.len(), most).into_iter().map(|i| sights[i]).collect();
            let shift = |s: &Sight| s.measured.translation - s.computed.translation;
            let turn = |s: &Sight| rotation::log(&(s.measured.rotation * s.computed.rotation.inverse()));
            // Where this picture sees the world's frame, if the robot and the mounts are right.
            let world = |s: &Sight| -> Pose { s.computed * s.measured.inverse() };
            let axis = |i: usize| millimetres(shown.iter().map(|s| shift(s)[i]));
            let angle = |i: usize| -> Vec<Value> {
                shown.iter().filter(|s| s.turned).map(|s| round(turn(s)[i].to_degrees(), 4)).collect()
            };
            let cloud = |i: usize| millimetres(shown.iter().filter(|s| s.turned).map(|s| world(s).translation[i]));
            let of: Vec<&str> = shown.iter().filter(|s| s.turned).map(|s| name(input, s.of)).collect();
            json!({
                "by": name(input, sensor),
                "of": sights.len(),
                "shift": [axis(0), axis(1), axis(2)],
                "turn": [angle(0), angle(1), angle(2)],
                "world": [cloud(0), cloud(1), cloud(2)],
                "target": of,
            })
        })
        .collect()
}

/// Residuals over the picture and their histogram, by camera.
fn residuals(input: &ReportInput<'_>) -> Vec<Value> {
    let s = input.solved;
    let m = &s.plan.measurements;
    let mut by_camera: BTreeMap<usize, Vec<(usize, [f64; 2])>> = BTreeMap::new();
    for (range, one) in m.appearances(0..m.corner_count()) {
        let seen = range.filter_map(|i| Some((i, s.residuals.corner(i)?)));
        by_camera.entry(one.camera).or_default().extend(seen);
    }
    by_camera.retain(|_, rows| !rows.is_empty());
    by_camera
        .into_iter()
        .map(|(camera, rows)| {
            let size = s.layout.cameras[camera].intrinsics.as_ref().map_or([0, 0], |lens| lens.size());
            let shown: Vec<&(usize, [f64; 2])> =
                spread(rows.len(), MOST_POINTS).into_iter().map(|i| &rows[i]).collect();
            let pixel =
                |axis: usize| -> Vec<Value> { shown.iter().map(|(i, _)| round(m.pixel(*i)[axis], 1)).collect() };
            let rest = |axis: usize| -> Vec<Value> { shown.iter().map(|(_, d)| round(d[axis], 3)).collect() };
            let mut sorted: Vec<f64> = rows.iter().flat_map(|(_, d)| d.map(f64::abs)).collect();
            sorted.sort_by(f64::total_cmp);
            // Wide enough for all but one in five hundred, in whole micropixels: a solution that was written and read again has the same bins.
            let reach = sorted.get(sorted.len() * 998 / 1000).copied().unwrap_or(1.0);
            let reach = (reach * 1e6).ceil().max(1.0) / 1e6;
            let width = 2.0 * reach / BINS as f64;
            let histogram = |axis: usize| {
                let mut bins = vec![0u64; BINS];
                for (_, d) in &rows {
                    let bin = ((d[axis] + reach) / width).floor();
                    bins[(bin.max(0.0) as usize).min(BINS - 1)] += 1;
                }
                bins
            };
            json!({
                "camera": s.layout.cameras[camera].name,
                "size": size,
                "of": rows.len(),
                "u": pixel(0), "v": pixel(1), "du": rest(0), "dv": rest(1),
                "bins": {"from": -reach, "width": width, "u": histogram(0), "v": histogram(1)},
            })
        })
        .collect()
}

/// The root mean square of each configuration: px over its corners, or mm over its poses and points.
fn by_configuration(input: &ReportInput<'_>, sights: &[Sight]) -> Value {
    let s = input.solved;
    let mut pixels: BTreeMap<usize, (f64, f64)> = BTreeMap::new();
    for group in &s.plan.groups {
        if !matches!(group.kind, crate::solve::GroupKind::Corners { .. }) {
            continue;
        }
        for block in &group.blocks {
            let sum = pixels.entry(block.configuration).or_default();
            for d in s.residuals.corners(block.start..block.end).flatten() {
                *sum = (sum.0 + d[0] * d[0] + d[1] * d[1], sum.1 + 2.0);
            }
        }
    }
    let mut shifts: BTreeMap<usize, (f64, f64)> = BTreeMap::new();
    for sight in sights {
        let sum = shifts.entry(sight.configuration).or_default();
        *sum = (sum.0 + (sight.measured.translation - sight.computed.translation).norm_squared(), sum.1 + 1.0);
    }
    let series = |of: BTreeMap<usize, (f64, f64)>, scale: f64| {
        let rows: Vec<(u64, f64)> = of
            .into_iter()
            .filter(|(_, (_, count))| *count > 0.0)
            .map(|(c, (sum, count))| (s.plan.configurations[c], (sum / count).sqrt() * scale))
            .collect();
        let shown: Vec<(u64, f64)> = spread(rows.len(), MOST_POINTS).into_iter().map(|i| rows[i]).collect();
        let values: Vec<Value> = shown.iter().map(|(_, v)| round(*v, 4)).collect();
        json!({"configuration": shown.iter().map(|(c, _)| *c).collect::<Vec<_>>(), "rms": values})
    };
    json!({"px": series(pixels, 1.0), "mm": series(shifts, 1e3)})
}

/// Correlations between unknowns, with their names; the strongest of each pair of blocks where there are many.
fn correlation(input: &ReportInput<'_>) -> Value {
    let s = input.solved;
    let (unknowns, matrix) = (&s.plan.unknowns, &s.covariance.matrix);
    if !input.fresh || unknowns.count == 0 || !s.covariance.is_whole() {
        return Value::Null;
    }
    let sigma: Vec<f64> = (0..unknowns.count).map(|i| matrix[(i, i)].max(0.0).sqrt()).collect();
    let between = |i: usize, j: usize| {
        let product = sigma[i] * sigma[j];
        if product > 0.0 { (matrix[(i, j)] / product).clamp(-1.0, 1.0) } else { 0.0 }
    };
    if unknowns.count <= MOST_COLUMNS {
        let mut labels = Vec::new();
        for block in &unknowns.blocks {
            labels.extend(column_names(s, block));
        }
        let rows: Vec<Vec<Value>> =
            (0..unknowns.count).map(|i| (0..unknowns.count).map(|j| round(between(i, j), 3)).collect()).collect();
        return json!({"labels": labels, "values": rows, "whole": true});
    }
    let blocks = &unknowns.blocks;
    let strongest = |a: &crate::solve::Unknown, b: &crate::solve::Unknown| {
        let pairs = (0..a.count()).flat_map(|i| (0..b.count()).map(move |j| (a.start + i, b.start + j)));
        pairs
            .map(|(i, j)| between(i, j))
            .fold(0.0, |best: f64, value| if value.abs() > best.abs() { value } else { best })
    };
    let rows: Vec<Vec<Value>> =
        blocks.iter().map(|a| blocks.iter().map(|b| round(strongest(a, b), 3)).collect()).collect();
    let labels: Vec<&str> = blocks.iter().map(|block| block.name.as_str()).collect();
    json!({"labels": labels, "values": rows, "whole": false})
}
