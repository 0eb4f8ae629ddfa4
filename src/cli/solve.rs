//! `cellmap solve`.

use clap::Args;
use std::path::PathBuf;
use std::process::ExitCode;

use super::findings::show_findings;
use super::output::{print_json, print_table, say, shown};
use super::{LayoutArguments, NOT_TRUSTWORTHY, use_threads};
use cellmap::complaint::{Complaint, InputError};
use cellmap::export::{Document, covariance, findings, solution};
use cellmap::geometry::rotation;
use cellmap::layout::SolverChoice;
use cellmap::recording::{Recording, atomic};
use cellmap::report::report_solved;
use cellmap::workflow::between::{Between, between};
use cellmap::workflow::memory;
use cellmap::workflow::solve::{SolveRequest, Solved, solve};
use cellmap::workflow::streamed::Streamed;

#[derive(Args, Debug)]
#[command(
    after_help = "Example:\n  cellmap solve layout.yaml --report report.html\n  cellmap solve layout.yaml --between left arm.base"
)]
pub(super) struct Solve {
    #[command(flatten)]
    pub(super) common: LayoutArguments,
    /// Where the solution goes [default: solution.yaml in the recording]; the same as JSON goes beside it
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Corners to use in place of the layout's own
    #[arg(long, value_name = "FILE")]
    detections: Option<PathBuf>,
    /// Start from the poses of this layout or solution
    #[arg(long, value_name = "FILE")]
    start: Option<PathBuf>,
    /// Also the pose of B in A and its sigmas; repeatable
    #[arg(long, num_args = 2, value_names = ["A", "B"])]
    between: Vec<String>,
    /// Configuration for `--between` [default: the first]
    #[arg(long, value_name = "N", requires = "between")]
    at: Option<u64>,
    /// Also the covariance of everything found (JSON)
    #[arg(long, value_name = "FILE")]
    covariance: Option<PathBuf>,
    /// Also write a report with figures (HTML)
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Equations: auto, dense or sparse [default: auto]
    #[arg(long, value_name = "HOW", value_enum, hide_possible_values = true)]
    solver: Option<How>,
    /// Memory for the solve, such as 500M or 2G [default: no limit]
    #[arg(long, value_name = "SIZE", value_parser = memory::bytes)]
    memory: Option<u64>,
    /// Worker threads [default: one a core]; the result has the same bits for any number
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
}

/// The words of `--solver`.
#[derive(clap::ValueEnum, Clone, Copy, Debug)]
enum How {
    Auto,
    Dense,
    Sparse,
}

impl Solve {
    pub(super) fn run(self) -> Result<ExitCode, InputError> {
        use_threads(self.threads);
        let layout = self.common.read()?;
        let out = self.out.clone().unwrap_or_else(|| layout.recording.join("solution.yaml"));
        let solver = match self.solver {
            None | Some(How::Auto) => SolverChoice::Auto,
            Some(How::Dense) => SolverChoice::Dense,
            Some(How::Sparse) => SolverChoice::Sparse,
        };
        let (detections, start, memory) = (self.detections.clone(), self.start.clone(), self.memory);
        let request = SolveRequest { detections, start, solver, memory };
        let solved = solve(layout, &request)?;
        solution::write(&out, &solved).map_err(|e| {
            Complaint::of(&out, format!("the file cannot be written: {e}"), "say where else with `--out FILE`")
        })?;
        let between = self.between(&solved)?;
        if let Some(file) = &self.covariance {
            if !solved.covariance.is_whole() {
                return Err(Complaint::of(
                    file,
                    format!("the covariance of {} unknowns is not kept whole", solved.plan.unknowns.count),
                    "ask for pairs of frames with `--between A B`, or use `--solver dense` if there is room",
                )
                .into());
            }
            let text = covariance::document(&solved).to_json();
            let written = text.and_then(|text| atomic::write(file, |out| writeln!(out, "{text}")));
            written.map_err(|e| {
                Complaint::of(
                    file,
                    format!("the file cannot be written: {e}"),
                    "say where else with `--covariance FILE`",
                )
            })?;
        }
        if let Some(report) = &self.report {
            super::report::put(report, &report_solved(&solved, &request)?)?;
        }
        if self.common.json {
            print_json(&as_json(&solved, &between));
        } else {
            show(&solved);
            between.iter().for_each(show_between);
            say!("wrote {} and the same as JSON", shown(&out));
            if let Some(file) = &self.covariance {
                say!("wrote {}: both covariances of everything found", shown(file));
            }
            if let Some(report) = &self.report {
                say!("wrote {}: open it in a browser", shown(report));
            }
        }
        Ok(if solved.trustworthy() { ExitCode::SUCCESS } else { ExitCode::from(NOT_TRUSTWORTHY) })
    }
}

impl Solve {
    /// The pairs of frames asked for; the recording is read again only if there are any, and not if it does not fit into memory.
    fn between(&self, solved: &Solved) -> Result<Vec<Between>, InputError> {
        if self.between.is_empty() {
            return Ok(Vec::new());
        }
        let read;
        let recording = match &solved.streamed {
            Some(streamed) => &streamed.recording,
            None => {
                read = Recording::read(&solved.layout, self.detections.as_deref())?;
                &read
            }
        };
        self.between.chunks_exact(2).map(|pair| between(solved, recording, &pair[0], &pair[1], self.at)).collect()
    }
}

fn between_json(one: &Between) -> Document {
    let pose = &one.found.pose;
    let turn = rotation::log(&pose.rotation).map(f64::to_degrees);
    let sigma = |source: usize, part: usize| {
        let scale = if part == 0 { 1e3 } else { 1f64.to_degrees() };
        Document::known(&[0, 1, 2].map(|i| one.found.sigma[source][3 * part + i].map(|s| s * scale)))
    };
    let covariance = |m: &nalgebra::DMatrix<f64>| {
        Document::List(m.row_iter().map(|row| Document::numbers(&row.iter().copied().collect::<Vec<f64>>())).collect())
    };
    Document::map([
        ("from", Document::text(&one.from)),
        ("to", Document::text(&one.to)),
        ("configuration", one.configuration.map_or(Document::Null, Document::Whole)),
        ("xyz_mm", Document::numbers((pose.translation * 1e3).as_slice())),
        ("rotvec_deg", Document::numbers(turn.as_slice())),
        ("sigma_xyz_mm", sigma(2, 0)),
        ("sigma_rotvec_deg", sigma(2, 1)),
        ("information_sigma_xyz_mm", sigma(0, 0)),
        ("information_sigma_rotvec_deg", sigma(0, 1)),
        ("clusters_sigma_xyz_mm", sigma(1, 0)),
        ("clusters_sigma_rotvec_deg", sigma(1, 1)),
        ("information_covariance_m_rad", covariance(&one.found.information)),
        ("clusters_covariance_m_rad", covariance(&one.found.clusters)),
    ])
}

fn show_between(one: &Between) {
    let document = between_json(one);
    let at = one.configuration.map_or(String::new(), |id| format!(" at configuration {id}"));
    say!("{}_from_{}{at}:", one.from, one.to);
    say!("  x y z {} mm, 1 sigma {}", numbers(&document, "xyz_mm", 3), numbers(&document, "sigma_xyz_mm", 3));
    let (turn, sigma) = (numbers(&document, "rotvec_deg", 4), numbers(&document, "sigma_rotvec_deg", 4));
    say!("  rotation vector {turn} deg, 1 sigma {sigma}");
}

fn as_json(solved: &Solved, between: &[Between]) -> Document {
    let s = &solved.seconds;
    let number = Document::Number;
    let mut entries = vec![
        ("iterations".to_owned(), Document::Whole(solved.report.iterations as u64)),
        ("thinned_iterations".to_owned(), Document::Whole(solved.report.thinned as u64)),
    ];
    entries.extend(findings::fit(solved));
    entries.push(("faults".to_owned(), findings::faults(&solved.faults)));
    entries.push(("undetermined".to_owned(), findings::undetermined(solved)));
    entries.push(("weak".to_owned(), findings::weak(solved)));
    entries.push(("remarks".to_owned(), findings::remarks(solved)));
    entries.push(("scales".to_owned(), findings::scales(solved)));
    let solver = solved.plan.solver();
    entries.push((
        "solver".to_owned(),
        Document::map([
            ("form", Document::text(solver.name())),
            ("shared_unknowns", Document::Whole(solver.unknowns as u64)),
            ("dense_multiplications", number(solver.dense_work())),
            ("sparse_multiplications", solver.sparse_work.map_or(Document::Null, number)),
            ("why", Document::text(solver.words())),
        ]),
    ));
    entries.push((
        "seconds".to_owned(),
        Document::map([
            ("read", number(s.read)),
            ("initialise", number(s.initialise)),
            ("linearise", number(s.linearise)),
            ("factorise", number(s.factorise)),
            ("evaluate", number(s.evaluate)),
            ("covariance", number(s.covariance)),
            ("diagnose", number(s.diagnose)),
            ("total", number(s.total)),
        ]),
    ));
    if let (Some(streamed), Some(Document::Map(mut told))) = (&solved.streamed, findings::streamed(solved)) {
        let (looked_through, first, passes) = &streamed.seconds;
        told.push((
            "seconds".to_owned(),
            Document::map([
                ("looked_through", number(*looked_through)),
                ("first", number(*first)),
                ("passes", Document::numbers(passes)),
            ]),
        ));
        entries.push(("streamed".to_owned(), Document::Map(told)));
    }
    entries.push(("poses".to_owned(), Document::Map(findings::poses(solved))));
    let parameters = findings::parameters(solved);
    if !parameters.is_empty() {
        entries.push(("parameters".to_owned(), Document::Map(parameters)));
    }
    if !between.is_empty() {
        entries.push(("between".to_owned(), Document::List(between.iter().map(between_json).collect())));
    }
    Document::Map(entries)
}

/// The numbers of a list, each with `decimals`.
fn numbers(document: &Document, key: &str, decimals: usize) -> String {
    let Document::Map(entries) = document else { return String::new() };
    let Some((_, Document::Row(items))) = entries.iter().find(|(k, _)| k == key) else { return String::new() };
    let one = |item: &Document| match item {
        Document::Number(value) => format!("{value:.decimals$}"),
        _ => "?".to_owned(),
    };
    items.iter().map(one).collect::<Vec<_>>().join(" ")
}

fn show(solved: &Solved) {
    let mut rows = Vec::new();
    for (key, pose) in findings::poses(solved) {
        let fixed = matches!(&pose, Document::Map(entries) if entries.iter().any(|(k, v)| k == "kind" && *v == Document::text("fixed")));
        if fixed {
            continue;
        }
        rows.push(vec![key, numbers(&pose, "xyz_mm", 2), numbers(&pose, "rotvec_deg", 3)]);
        rows.push(vec![
            "  1 sigma".to_owned(),
            numbers(&pose, "sigma_xyz_mm", 2),
            numbers(&pose, "sigma_rotvec_deg", 3),
        ]);
    }
    print_table(&["pose", "x y z, mm", "rotation vector, deg"], &rows);
    say!("");
    for (name, found) in findings::parameters(solved) {
        let Document::Map(entries) = found else { continue };
        let parts: Vec<String> = entries
            .iter()
            .map(|(key, value)| match value {
                Document::Map(inner) => match (inner.first(), inner.get(1)) {
                    (Some((_, Document::Number(v))), Some((_, Document::Number(s)))) => {
                        format!("{key} {v:.5} +- {s:.5}")
                    }
                    (Some((_, Document::Number(v))), _) => format!("{key} {v:.5} (undetermined)"),
                    _ => String::new(),
                },
                _ => String::new(),
            })
            .collect();
        say!("{name}:");
        for chunk in parts.chunks(3) {
            say!("  {}", chunk.join(", "));
        }
    }
    let report = &solved.report;
    let part = match report.thinned {
        0 => String::new(),
        count => format!(" of all measurements and {count} of a part"),
    };
    say!("{} after {} linearisations{part}", report.termination.words(), report.iterations);
    let r = &solved.summary;
    if let Some(rms) = r.rms_px() {
        say!("residual: {rms:.3} px a coordinate over {} corners", r.corners.0);
    }
    if let Some([t, a]) = r.rms_poses() {
        say!("residual: {:.3} mm and {:.3} deg over {} measured poses", t * 1e3, a.to_degrees(), r.poses.0);
    }
    if let Some(e) = r.rms_points() {
        say!("residual: {:.3} mm over {} measured points", e * 1e3, r.points.0);
    }
    if let Some(e) = r.rms_contacts() {
        say!("residual: {:.3} mm over {} contacts", e * 1e3, r.contacts.0);
    }
    if solved.rejected.total() > 0 {
        let j = &solved.rejected;
        say!(
            "set aside as not belonging: {} corners, {} poses, {} points, {} contacts",
            j.corners,
            j.poses,
            j.points,
            j.contacts
        );
        if j.unplaced > 0 {
            say!("left out, too little of a moving target was seen: {} measurements", j.unplaced);
        }
    }
    let s = &solved.seconds;
    say!(
        "time: {:.3} s reading, {:.3} initialising, {:.3} linearising, {:.3} factorising,\n      {:.3} evaluating, {:.3} covariance; {:.3} s in all",
        s.read,
        s.initialise,
        s.linearise,
        s.factorise,
        s.evaluate,
        s.covariance,
        s.total
    );
    if solved.plan.solver().sparse_work.is_some() {
        say!("{}", solved.plan.solver().words());
    }
    if let Some(streamed) = &solved.streamed {
        show_streamed(streamed);
    }
    for t in solved.tallies.iter().filter(|t| t.rejected > 0) {
        let of = t.accepted + t.rejected;
        say!("  of `{}` by `{}`: {} of {of} corners", t.target, t.camera, t.rejected);
    }
    show_findings(solved);
}

/// How a recording was solved that does not fit into memory.
fn show_streamed(streamed: &Streamed) {
    let [first, all] = streamed.configurations;
    say!(
        "in {} of memory: {} corners of {all} configurations, of which {first} (one of {}) were solved first in {:.3} s;",
        memory::words(streamed.memory),
        streamed.corners,
        streamed.stride,
        streamed.seconds.1
    );
    let passes: Vec<String> = streamed.seconds.2.iter().map(|seconds| format!("{seconds:.3}")).collect();
    say!(
        "      {:.3} s to look through the files, then passes of {} s in {} pieces",
        streamed.seconds.0,
        passes.join(", "),
        streamed.chunks
    );
    say!(
        "      poses, standard deviations and counts are those of all; factors, remarks and faults those of the {first}"
    );
}
