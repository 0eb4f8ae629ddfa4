//! How time and memory of a solve grow with the number of pictures: one robot, three cameras, every picture at a configuration of its own.
//!
//! `cargo run --release --example solver_growth -- CURVE.svg PICTURES...` prints a table and draws the curve. Each solve is that of a fresh process which
//! reads the problem from a file, as a user's is: what an earlier one or making the recording left over would be taken from the system again or not as
//! the size has it.

#[path = "../benches/support/problem_file.rs"]
mod problem_file;
#[path = "../benches/support/processor.rs"]
mod processor;
#[path = "../benches/support/sizes.rs"]
mod sizes;

use std::fmt::Write;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

use cellmap::frames::FrameTree;
use cellmap::solve::{Assembler, Options, Plan, Priors, minimise};
use processor::processor_seconds;

/// What a process says of its solve.
#[derive(Clone, Copy)]
struct Solved {
    seconds: f64,
    processor: f64,
    /// Of the processor's time, what the system took: to give memory, above all.
    system: f64,
    linearisations: f64,
    corners: f64,
    megabytes: f64,
}

/// One row of the table.
struct Measured {
    pictures: u64,
    least: f64,
    /// The medians of all rounds.
    median: Solved,
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (file, pictures) = arguments.split_first().ok_or("CURVE.svg PICTURES...")?;
    if let ("solve", [problem]) = (file.as_str(), pictures) {
        return solve(Path::new(problem));
    }
    println!(
        "| pictures | corners | layout and search, s: median, least | processor s, of it the system's | linearisations | peak memory, MB | bytes a corner |"
    );
    println!("|---|---|---|---|---|---|---|");
    let mut all = Vec::new();
    for count in pictures {
        let measured = measure(count.parse()?)?;
        let Solved { seconds, processor, system, linearisations, corners, megabytes } = measured.median;
        println!(
            "| {count} | {corners} | {seconds:.4}, {:.4} | {processor:.4}, {system:.2} | {linearisations} | {megabytes:.0} | {:.0} |",
            measured.least,
            megabytes * 1e6 / corners
        );
        all.push(measured);
    }
    std::fs::write(file, curve(&all))?;
    Ok(())
}

/// Reads a problem, solves it and tells how that went: the numbers of [`Solved`].
fn solve(file: &Path) -> Result<(), Box<dyn std::error::Error>> {
    let given = problem_file::read(file)?;
    let tree = FrameTree::new(&given.layout);
    let plan = Plan::new(&given.layout, &tree, &given.recording)?;
    let (clock, processor, system) = (Instant::now(), processor_seconds(), system_seconds()?);
    let mut state = given.start.clone();
    let mut assembler = Assembler::new(&given.layout, &given.recording, &plan, Priors::default());
    let report = minimise(&mut assembler, &tree, &mut state, &Options::default());
    drop(assembler);
    let seconds = clock.elapsed().as_secs_f64();
    let (processor, system) = (processor_seconds() - processor, system_seconds()? - system);
    if !report.termination.converged() {
        return Err(report.termination.words().into());
    }
    let status = std::fs::read_to_string("/proc/self/status")?;
    let peak =
        status.lines().find_map(|line| line.strip_prefix("VmHWM:")?.trim().strip_suffix(" kB")?.parse::<f64>().ok());
    let megabytes = peak.ok_or("the system does not say how much memory is used")? * 1024.0 / 1e6;
    println!("{seconds} {processor} {system} {} {} {megabytes}", report.iterations, plan.measurements.corner_count());
    Ok(())
}

/// The processor's time that the system has spent on this process, in ticks of a hundredth.
fn system_seconds() -> Result<f64, Box<dyn std::error::Error>> {
    let text = std::fs::read_to_string("/proc/self/stat")?;
    // The program's name, in parentheses, may hold spaces.
    let after = text.rsplit(')').next().and_then(|rest| rest.split_whitespace().nth(12));
    Ok(after.ok_or("the system does not say how long it worked")?.parse::<f64>()? * 0.01)
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
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("problem");
    let problem = sizes::problem(size, false);
    let tree = FrameTree::new(&problem.layout);
    let plan = Plan::new(&problem.layout, &tree, &problem.recording)?;
    let start = sizes::wrong_start(&problem, &tree, &plan);
    problem_file::write(BufWriter::new(File::create(&file)?), &problem.text, &problem.recording, &start)?;
    drop((plan, problem, tree));
    // Small solves are repeated more often, since the clock's and the system's noise is large beside them.
    let rounds = (100_000 / pictures).clamp(7, 25);
    let mut all = Vec::new();
    for _ in 0..rounds {
        let done = Command::new(std::env::current_exe()?).arg("solve").arg(&file).output()?;
        let said = String::from_utf8(done.stdout)?;
        let values = said.split_whitespace().map(str::parse).collect::<Result<Vec<f64>, _>>()?;
        let [seconds, processor, system, linearisations, corners, megabytes] = values[..] else {
            return Err(String::from_utf8_lossy(&done.stderr).into());
        };
        all.push(Solved { seconds, processor, system, linearisations, corners, megabytes });
    }
    let middle = |what: fn(&Solved) -> f64| {
        let mut values: Vec<f64> = all.iter().map(what).collect();
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let median = Solved {
        seconds: middle(|one| one.seconds),
        processor: middle(|one| one.processor),
        system: middle(|one| one.system),
        linearisations: middle(|one| one.linearisations),
        corners: middle(|one| one.corners),
        megabytes: middle(|one| one.megabytes),
    };
    let least = all.iter().fold(f64::INFINITY, |least, one| least.min(one.seconds));
    Ok(Measured { pictures, least, median })
}

/// Both curves on logarithmic axes, with a line of slope one for comparison.
fn curve(all: &[Measured]) -> String {
    let (width, height, margin) = (640.0, 420.0, 60.0);
    let decade = |value: f64| value.log10();
    let (low, high) = (decade(all[0].pictures as f64).floor(), decade(all[all.len() - 1].pictures as f64).ceil());
    let x = |pictures: f64| margin + (decade(pictures) - low) / (high - low) * (width - 2.0 * margin);
    // As many decades upwards as sideways, from the first point's own decade.
    let floor = decade(all[0].median.seconds).floor();
    let y = |seconds: f64| height - margin - (decade(seconds) - floor) / (high - low) * (height - 2.0 * margin);
    let bottom = decade(all[0].median.megabytes).floor();
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
    let ideal = first.median.seconds * last.pictures as f64 / first.pictures as f64;
    let ends = vec![(x(first.pictures as f64), y(first.median.seconds)), (x(last.pictures as f64), y(ideal))];
    line(ends, "stroke=\"#999\" stroke-dasharray=\"4 4\"");
    line(
        all.iter().map(|m| (x(m.pictures as f64), y(m.median.seconds))).collect(),
        "stroke=\"#0b62a4\" stroke-width=\"2\"",
    );
    line(
        all.iter().map(|m| (x(m.pictures as f64), y_memory(m.median.megabytes))).collect(),
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
