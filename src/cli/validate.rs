//! `cellmap validate`.

use clap::Args;
use std::path::PathBuf;
use std::process::ExitCode;

use super::LayoutArguments;
use super::output::{print_json, print_table, say};
use super::use_threads;
use cellmap::complaint::InputError;
use cellmap::export::Document;
use cellmap::workflow::validate::{Fit, ValidateRequest, Validated, mean, validate};

#[derive(Args, Debug)]
#[command(after_help = "Example:\n  cellmap validate layout.yaml --folds 5")]
pub(super) struct Validate {
    #[command(flatten)]
    pub(super) common: LayoutArguments,
    /// Parts into which the configurations are split, each held out once
    #[arg(long, value_name = "N", default_value_t = 10)]
    folds: usize,
    /// Corners to use in place of the layout's own
    #[arg(long, value_name = "FILE")]
    detections: Option<PathBuf>,
    /// Worker threads [default: one a core]
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
}

impl Validate {
    pub(super) fn run(self) -> Result<ExitCode, InputError> {
        use_threads(self.threads);
        let request = ValidateRequest { folds: self.folds, detections: self.detections };
        let validated = validate(&self.common.read()?, &request)?;
        if self.common.json {
            print_json(&as_json(&validated));
        } else {
            show(&validated);
        }
        Ok(ExitCode::SUCCESS)
    }
}

fn optional(value: Option<f64>) -> Document {
    value.map_or(Document::Null, Document::Number)
}

fn fit(fit: Option<&Fit>) -> Document {
    let part = |pick: fn(&Fit) -> Option<f64>| optional(fit.and_then(pick));
    Document::map([("rms_px", part(|f| f.px)), ("rms_mm", part(|f| f.distance.map(|d| d * 1e3)))])
}

fn folds(all: &[Option<Fit>]) -> Document {
    Document::map([
        ("rms_px", optional(mean(all, |f| f.px))),
        ("rms_mm", optional(mean(all, |f| f.distance).map(|d| d * 1e3))),
        ("folds", Document::List(all.iter().map(|one| fit(one.as_ref())).collect())),
    ])
}

fn as_json(v: &Validated) -> Document {
    let camera = |c: &cellmap::workflow::validate::LeftOut| {
        let entries = Document::map([
            ("positions", Document::Whole(c.positions as u64)),
            ("rms_mm", optional(c.distance.map(|d| d[0] * 1e3))),
            ("largest_mm", optional(c.distance.map(|d| d[1] * 1e3))),
            ("fitted_rms_mm", optional(c.fitted.map(|d| d * 1e3))),
        ]);
        (c.camera.clone(), entries)
    };
    let half = |r: &cellmap::workflow::validate::Repeated| {
        let entries = Document::map([
            ("translation_mm", Document::Number(r.apart[0] * 1e3)),
            ("rotation_deg", Document::Number(r.apart[1].to_degrees())),
            ("within_sigma", optional(r.sigmas)),
        ]);
        (r.key.clone(), entries)
    };
    let published = v.published.as_ref().map_or(Document::Null, |p| {
        Document::map([
            ("robot", Document::text(&p.robot)),
            ("positions", Document::Whole(p.positions as u64)),
            ("published_rms_mm", Document::Number(p.published * 1e3)),
            ("joint_rms_mm", Document::Number(p.joint * 1e3)),
        ])
    });
    Document::map([
        ("configurations", Document::Whole(v.configurations as u64)),
        ("rejected", Document::Whole(v.aside as u64)),
        ("fitted", fit(Some(&v.fitted))),
        ("held_out", folds(&v.folds)),
        ("held_out_nominal_links", v.nominal_links.as_ref().map_or(Document::Null, |all| folds(all))),
        ("without_camera", Document::Map(v.cameras.iter().map(camera).collect())),
        ("halves", Document::Map(v.halves.iter().map(half).collect())),
        ("published", published),
        ("seconds", Document::Number(v.seconds)),
    ])
}

/// Poses shown of the halves: the ones that differ most.
const SHOWN: usize = 8;

fn show(v: &Validated) {
    let cell =
        |value: Option<f64>, decimals: usize| value.map_or_else(|| "-".to_owned(), |x| format!("{x:.decimals$}"));
    let row = |name: &str, px: Option<f64>, distance: Option<f64>| {
        vec![name.to_owned(), cell(px, 3), cell(distance.map(|d| d * 1e3), 3)]
    };
    let held = |name: &str, all: &[Option<Fit>]| row(name, mean(all, |f| f.px), mean(all, |f| f.distance));
    say!("{} configurations in {} folds, {} measurements set aside", v.configurations, v.folds.len(), v.aside);
    say!("");
    let mut rows = vec![row("fitted to all", v.fitted.px, v.fitted.distance), held("held out", &v.folds)];
    if let Some(nominal) = &v.nominal_links {
        rows.push(held("held out, links as in the layout", nominal));
    }
    print_table(&["what robots move", "px", "mm"], &rows);
    let failed = v.folds.iter().filter(|fold| fold.is_none()).count();
    if failed > 0 {
        say!("{failed} folds could not be judged: what was left did not determine the cell");
    }
    if !v.cameras.is_empty() {
        say!("");
        let rows: Vec<Vec<String>> = v
            .cameras
            .iter()
            .map(|c| {
                let [rms, most] = [0, 1].map(|i| cell(c.distance.map(|d| d[i] * 1e3), 3));
                vec![c.camera.clone(), c.positions.to_string(), rms, most, cell(c.fitted.map(|d| d * 1e3), 3)]
            })
            .collect();
        print_table(&["camera left out", "positions", "rms mm", "largest", "rms mm with it"], &rows);
    }
    if !v.halves.is_empty() {
        say!("");
        let mut worst: Vec<_> = v.halves.iter().collect();
        worst.sort_by(|a, b| b.apart[0].total_cmp(&a.apart[0]));
        let rows: Vec<Vec<String>> = worst
            .iter()
            .take(SHOWN)
            .map(|r| {
                let turn = cell(Some(r.apart[1].to_degrees()), 4);
                vec![r.key.clone(), cell(Some(r.apart[0] * 1e3), 3), turn, cell(r.sigmas, 1)]
            })
            .collect();
        print_table(&["one half against the other", "mm", "deg", "sigmas"], &rows);
        if worst.len() > SHOWN {
            say!("and {} more that differ less", worst.len() - SHOWN);
        }
    }
    if let Some(p) = &v.published {
        say!("");
        say!("`{}`, fitted to one half, on {} tool positions of the other:", p.robot, p.positions);
        say!("  published method {:.3} mm, cellmap {:.3} mm", p.published * 1e3, p.joint * 1e3);
    }
    say!("{:.2} s", v.seconds);
}
