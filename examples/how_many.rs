//! How many configurations and cameras are needed? The paper's open question, answered on its experiment A: the standard deviation that cellmap states for the
//! robot's base, beside how far from the truth the base really is over many seeds.
//!
//! `cargo run --release --example how_many -- [SEEDS] [FILE.svg]` prints a table as Markdown and draws the figure.

use std::collections::BTreeMap;
use std::path::Path;

use cellmap::layout::{Layout, read_layout};
use cellmap::recording::{Recording, RobotMotion};
use cellmap::simulate::{Simulated, paths, simulate};
use cellmap::trust::Source;
use cellmap::workflow::solve::{Solved, solve_recording};
use plotters::prelude::*;
use rayon::prelude::*;

/// Numbers of configurations that are tried.
const STOPS: [usize; 9] = [5, 8, 12, 20, 35, 60, 100, 160, 250];

/// Stated and real standard deviation of the base, mm: of its translation (root mean square an axis).
struct Point {
    stops: usize,
    cameras: usize,
    stated: f64,
    found: f64,
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let seeds: u64 = arguments.next().map_or(Ok(40), |text| text.parse())?;
    let figure = arguments.next();
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("layouts/paper_experiment_a.yaml");
    let mut layout = read_layout(&file, None)?;
    layout.simulate.shots = 1;
    // What the simulation does to the robot the solver is told.
    layout.robots[0].repeatability = Some(layout.simulate.repeatability);
    let path = paths::generate(&layout, 250, 1)?;
    let mut points = Vec::new();
    println!("| configurations | cameras | stated sigma, mm | real, mm | ratio |");
    println!("|---|---|---|---|---|");
    for cameras in 1..=3 {
        let mut cell = layout.clone();
        cell.cameras.truncate(cameras);
        for stops in STOPS {
            let all: Vec<(f64, f64)> =
                (0..seeds).into_par_iter().filter_map(|seed| one(&cell, &path[0], stops, seed)).collect();
            if all.len() < seeds as usize {
                eprintln!(
                    "{} of {seeds} with {stops} stops and {cameras} cameras could not be solved",
                    seeds as usize - all.len()
                );
            }
            let mean =
                |part: fn(&(f64, f64)) -> f64| (all.iter().map(part).sum::<f64>() / all.len() as f64).sqrt() * 1e3;
            let point = Point { stops, cameras, stated: mean(|p| p.0), found: mean(|p| p.1) };
            let ratio = point.found / point.stated;
            println!("| {stops} | {cameras} | {:.4} | {:.4} | {ratio:.2} |", point.stated, point.found);
            points.push(point);
        }
    }
    if let Some(figure) = figure {
        draw(Path::new(&figure), &points)?;
    }
    Ok(())
}

/// Variance an axis of the base's translation as stated, and the square of its error: m^2. `None` where the base was not determined.
fn one(layout: &Layout, path: &RobotMotion, stops: usize, seed: u64) -> Option<(f64, f64)> {
    let RobotMotion::Joints(values) = path else { return None };
    // Stops spread over the long path, others for each seed.
    let chosen: BTreeMap<u64, Vec<f64>> = (0..stops as u64)
        .filter_map(|i| values.get(&(1 + (i * 250 / stops as u64 + seed * 37) % 250)).map(|q| (i + 1, q.clone())))
        .collect();
    let Simulated { truth, told, recording, logged, .. } =
        simulate(layout, vec![RobotMotion::Joints(chosen)], seed, 1.0).ok()?;
    let recording = Recording { motions: logged, ..recording };
    let solved: Solved = solve_recording(told, &recording, &[], Vec::new(), std::time::Instant::now()).ok()?;
    let edge = solved.tree.static_edges.iter().position(|edge| edge.key == "world_from_ur3.base")?;
    let block = &solved.plan.unknowns.blocks[solved.plan.unknowns.edge(edge)?];
    let sigma = solved.covariance.pose_sigma(&solved.tree, &solved.state, block, Source::Both);
    let stated: Option<f64> = sigma[..3].iter().map(|s| s.map(|s| s * s)).sum();
    let error = solved.state.static_poses[edge].translation - truth.robots[0].pose.truth()?.translation;
    Some((stated? / 3.0, error.norm_squared() / 3.0))
}

fn draw(file: &Path, points: &[Point]) -> Result<(), Box<dyn std::error::Error>> {
    let root = SVGBackend::new(file, (720, 420)).into_drawing_area();
    root.fill(&WHITE)?;
    let values = || points.iter().flat_map(|p| [p.stated, p.found]).filter(|v| v.is_finite() && *v > 0.0);
    let (low, high) = values().fold((f64::INFINITY, 0.0_f64), |(low, high), v| (low.min(v), high.max(v)));
    let mut chart = ChartBuilder::on(&root)
        .margin(12)
        .x_label_area_size(40)
        .y_label_area_size(60)
        .build_cartesian_2d((4.5..280.0).log_scale(), (0.8 * low..1.2 * high).log_scale())?;
    chart
        .configure_mesh()
        .light_line_style(RGBColor(236, 236, 236))
        .x_desc("configurations")
        .y_desc("standard deviation of the base, mm an axis")
        .x_label_formatter(&|x| format!("{x:.0}"))
        .y_label_formatter(&|y| format!("{y:.2}"))
        .draw()?;
    // Colours that people who see few colours can tell apart (Okabe and Ito).
    let colours = [RGBColor(213, 94, 0), RGBColor(0, 114, 178), RGBColor(0, 158, 115)];
    for (cameras, colour) in (1..).zip(colours) {
        let own = || points.iter().filter(move |p| p.cameras == cameras);
        let name = if cameras == 1 { "1 camera".to_owned() } else { format!("{cameras} cameras") };
        chart
            .draw_series(LineSeries::new(own().map(|p| (p.stops as f64, p.stated)), colour.stroke_width(2)))?
            .label(format!("{name}, stated"))
            .legend(move |(x, y)| PathElement::new(vec![(x, y), (x + 20, y)], colour.stroke_width(2)));
        chart
            .draw_series(own().map(|p| Circle::new((p.stops as f64, p.found), 4, colour.filled())))?
            .label(format!("{name}, real"))
            .legend(move |(x, y)| Circle::new((x + 10, y), 4, colour.filled()));
    }
    chart.configure_series_labels().background_style(WHITE.mix(0.85)).border_style(RGBColor(200, 200, 200)).draw()?;
    root.present()?;
    Ok(())
}
