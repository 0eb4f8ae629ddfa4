//! How time and memory of a solve grow with the number of pictures: one robot, three cameras, every picture at a configuration of its own.
//!
//! `cargo run --release --example solver_growth -- CURVE.svg PICTURES...` prints a table and draws the curve.

#[path = "../benches/support/sizes.rs"]
mod sizes;

use std::fmt::Write;
use std::time::Instant;

use cellmap::frames::FrameTree;
use cellmap::solve::{Assembler, Options, Plan, Priors, minimise};

/// One row of the table.
struct Measured {
    pictures: u64,
    corners: usize,
    seconds: f64,
    iterations: usize,
    megabytes: f64,
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (file, pictures) = arguments.split_first().ok_or("CURVE.svg PICTURES...")?;
    println!("| pictures | corners | layout and search, s | linearisations | peak memory, MB | bytes a corner |");
    println!("|---|---|---|---|---|---|");
    let mut all = Vec::new();
    for count in pictures {
        let measured = measure(count.parse()?)?;
        println!(
            "| {} | {} | {:.4} | {} | {:.0} | {:.0} |",
            measured.pictures,
            measured.corners,
            measured.seconds,
            measured.iterations,
            measured.megabytes,
            measured.megabytes * 1e6 / measured.corners as f64
        );
        all.push(measured);
    }
    std::fs::write(file, curve(&all))?;
    Ok(())
}

fn measure(pictures: u64) -> Result<Measured, Box<dyn std::error::Error>> {
    let size = sizes::Size {
        spaces: 1,
        robots: 1,
        cameras: 3,
        stops: pictures / 3,
        shots: 1,
        board: sizes::Board::Small,
        plates: 0,
    };
    let problem = sizes::problem(size, false);
    let tree = FrameTree::new(&problem.layout);
    let plan = Plan::new(&problem.layout, &tree, &problem.recording)?;
    let start = sizes::wrong_start(&problem, &tree, &plan);
    // The peak of this solve, not that of the recording's making.
    std::fs::write("/proc/self/clear_refs", "5")?;
    // Small solves are repeated, so that the clock's and the system's noise is small beside them.
    let rounds = (100_000 / pictures).clamp(3, 25);
    let mut times = Vec::new();
    let mut iterations = 0;
    for _ in 0..rounds {
        let clock = Instant::now();
        let mut state = start.clone();
        let mut assembler = Assembler::new(&problem.layout, &problem.recording, &plan, Priors::default());
        let report = minimise(&mut assembler, &tree, &mut state, &Options::default());
        times.push(clock.elapsed().as_secs_f64());
        if !report.termination.converged() {
            return Err(report.termination.words().into());
        }
        iterations = report.iterations;
    }
    times.sort_by(f64::total_cmp);
    let status = std::fs::read_to_string("/proc/self/status")?;
    let peak =
        status.lines().find_map(|line| line.strip_prefix("VmHWM:")?.trim().strip_suffix(" kB")?.parse::<f64>().ok());
    Ok(Measured {
        pictures,
        corners: plan.measurements.corner_count(),
        seconds: times[times.len() / 2],
        iterations,
        megabytes: peak.ok_or("the system does not say how much memory is used")? * 1024.0 / 1e6,
    })
}

/// Both curves on logarithmic axes, with a line of slope one for comparison.
fn curve(all: &[Measured]) -> String {
    let (width, height, margin) = (640.0, 420.0, 60.0);
    let decade = |value: f64| value.log10();
    let (low, high) = (decade(all[0].pictures as f64).floor(), decade(all[all.len() - 1].pictures as f64).ceil());
    let x = |pictures: f64| margin + (decade(pictures) - low) / (high - low) * (width - 2.0 * margin);
    // As many decades upwards as sideways, from the first point's own decade.
    let floor = decade(all[0].seconds).floor();
    let y = |seconds: f64| height - margin - (decade(seconds) - floor) / (high - low) * (height - 2.0 * margin);
    let bottom = decade(all[0].megabytes).floor();
    let y_memory = |mb: f64| height - margin - (decade(mb) - bottom) / (high - low) * (height - 2.0 * margin);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" font-size=\"12\">\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n"
    );
    for step in 0..=(high - low) as i32 {
        let (power, across) = (10f64.powf(low + f64::from(step)), 10f64.powf(floor + f64::from(step)));
        let (gx, gy) = (x(power), y(across));
        let (right, top, base) = (width - margin, margin, height - margin);
        let _ = write!(
            svg,
            "<path d=\"M{gx:.1} {top}V{base}M{margin} {gy:.1}H{right}\" stroke=\"#ddd\" fill=\"none\"/>\n\
             <text x=\"{gx:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{power}</text>\n\
             <text x=\"{:.1}\" y=\"{gy:.1}\" text-anchor=\"end\">{across} s</text>\n\
             <text x=\"{:.1}\" y=\"{gy:.1}\">{} MB</text>\n",
            base + 18.0,
            margin - 6.0,
            right + 6.0,
            10f64.powf(bottom + f64::from(step))
        );
    }
    let mut line = |points: Vec<(f64, f64)>, style: &str| {
        let path: Vec<String> = points.iter().map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
        let _ = writeln!(svg, "<polyline points=\"{}\" fill=\"none\" {style}/>", path.join(" "));
    };
    let (first, last) = (&all[0], &all[all.len() - 1]);
    let ideal = first.seconds * last.pictures as f64 / first.pictures as f64;
    let ends = vec![(x(first.pictures as f64), y(first.seconds)), (x(last.pictures as f64), y(ideal))];
    line(ends, "stroke=\"#999\" stroke-dasharray=\"4 4\"");
    line(all.iter().map(|m| (x(m.pictures as f64), y(m.seconds))).collect(), "stroke=\"#0b62a4\" stroke-width=\"2\"");
    line(
        all.iter().map(|m| (x(m.pictures as f64), y_memory(m.megabytes))).collect(),
        "stroke=\"#c1440e\" stroke-width=\"2\"",
    );
    let _ = writeln!(
        svg,
        "<text x=\"{margin}\" y=\"24\"><tspan fill=\"#0b62a4\">time of a solve</tspan>, <tspan fill=\"#c1440e\">peak memory</tspan>, \
         <tspan fill=\"#777\">dashed: time in proportion</tspan></text>\n\
         <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">pictures of 40 corners</text>\n</svg>",
        width / 2.0,
        height - 16.0
    );
    svg
}
