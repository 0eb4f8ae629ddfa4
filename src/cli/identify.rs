//! `cellmap identify`.

use clap::Args;
use nalgebra::Matrix3;
use std::process::ExitCode;

use super::output::{print_json, print_table, say};
use super::{LayoutArguments, NOT_TRUSTWORTHY};
use cellmap::complaint::InputError;
use cellmap::export::Document;
use cellmap::geometry::rotation;
use cellmap::workflow::identify::{Identified, IdentifyRequest, identify};

#[derive(Args, Debug)]
#[command(after_help = "Example:\n  cellmap identify layout.yaml --robot ur3 --sensor cam1")]
pub(super) struct Identify {
    #[command(flatten)]
    pub(super) common: LayoutArguments,
    /// The robot [default: the only one]
    #[arg(long)]
    robot: Option<String>,
    /// The tool point [default: the only one measured]
    #[arg(long)]
    point: Option<String>,
    /// Use only this sensor's points; may be repeated [default: all]
    #[arg(long = "sensor", value_name = "NAME")]
    sensors: Vec<String>,
}

/// The paper's names of the nine entries, in its order.
const ENTRIES: [(&str, usize, usize); 9] = [
    ("r11", 0, 0),
    ("r21", 1, 0),
    ("r31", 2, 0),
    ("r12", 0, 1),
    ("r22", 1, 1),
    ("r32", 2, 1),
    ("r13", 0, 2),
    ("r23", 1, 2),
    ("r33", 2, 2),
];

impl Identify {
    pub(super) fn run(self) -> Result<ExitCode, InputError> {
        let layout = self.common.read()?;
        let request = IdentifyRequest { robot: self.robot, point: self.point, sensors: self.sensors };
        let found = identify(&layout, &request)?;
        if self.common.json {
            print_json(&as_json(&found))
        } else {
            show(&found)
        }
        let fine = found.free.converged && found.free.condition < 1e12;
        Ok(if fine { ExitCode::SUCCESS } else { ExitCode::from(NOT_TRUSTWORTHY) })
    }
}

fn parameters(origin: [f64; 3], matrix: &Matrix3<f64>, tool: [f64; 3]) -> Document {
    let mut entries = Vec::new();
    let mut put = |name: &str, value: f64| entries.push((name.to_owned(), Document::Number(value)));
    for (name, value) in ["x0_mm", "y0_mm", "z0_mm"].into_iter().zip(origin) {
        put(name, value * 1e3);
    }
    for (name, row, column) in ENTRIES {
        put(name, matrix[(row, column)]);
    }
    for (name, value) in ["xe_mm", "ye_mm", "ze_mm"].into_iter().zip(tool) {
        put(name, value * 1e3);
    }
    Document::Map(entries)
}

fn as_json(found: &Identified) -> Document {
    let free = &found.free;
    let rigid = found.rigid.as_ref().map_or(Document::Null, |rigid| {
        Document::map([
            ("iterations", Document::Whole(rigid.iterations as u64)),
            ("converged", Document::Flag(rigid.converged)),
            ("rms_mm", Document::Number(rigid.rms * 1e3)),
            (
                "parameters",
                parameters(
                    rigid.world_from_base.translation.into(),
                    &rigid.world_from_base.rotation_matrix(),
                    rigid.tool.into(),
                ),
            ),
        ])
    });
    Document::map([
        ("robot", Document::text(&found.robot)),
        ("point", Document::text(&found.point)),
        ("measurements", Document::Whole(found.measurements as u64)),
        ("iterations", Document::Whole(free.iterations as u64)),
        ("converged", Document::Flag(free.converged)),
        ("rms_mm", Document::Number(free.rms * 1e3)),
        ("condition", Document::Number(free.condition)),
        ("parameters", parameters(free.origin.into(), &free.matrix, free.tool.into())),
        ("rigid", rigid),
    ])
}

fn show(found: &Identified) {
    let free = &found.free;
    say!("robot `{}`, point `{}`, {} measurements", found.robot, found.point, found.measurements);
    let rigid = found.rigid.as_ref();
    let pair = |name: &str, a: f64, b: Option<f64>, decimals: usize| {
        let cell = |value: f64| format!("{value:.decimals$}");
        vec![name.to_owned(), cell(a), b.map_or_else(|| "?".to_owned(), cell)]
    };
    let mut rows = Vec::new();
    for (i, name) in ["x0 mm", "y0 mm", "z0 mm"].iter().enumerate() {
        rows.push(pair(name, free.origin[i] * 1e3, rigid.map(|r| r.world_from_base.translation[i] * 1e3), 2));
    }
    let turn = rigid.map(|r| r.world_from_base.rotation_matrix());
    for (name, row, column) in ENTRIES {
        rows.push(pair(name, free.matrix[(row, column)], turn.map(|m| m[(row, column)]), 3));
    }
    for (i, name) in ["xe mm", "ye mm", "ze mm"].iter().enumerate() {
        rows.push(pair(name, free.tool[i] * 1e3, rigid.map(|r| r.tool[i] * 1e3), 2));
    }
    rows.push(pair("rms mm", free.rms * 1e3, rigid.map(|r| r.rms * 1e3), 3));
    print_table(&["", "as published", "true rotation"], &rows);
    say!(
        "{} after {} steps, condition {:.1}",
        if free.converged { "converged" } else { "not converged" },
        free.iterations,
        free.condition
    );
    let stretch: Vec<String> = (0..3).map(|i| format!("{:.3}", free.matrix.column(i).norm())).collect();
    say!("lengths of the free matrix's columns: {} (a rotation has 1)", stretch.join(" "));
    if let Some(rigid) = rigid {
        let turn = rotation::log(&rigid.world_from_base.rotation).map(f64::to_degrees);
        say!("true rotation as rotation vector: {:.3} {:.3} {:.3} deg", turn.x, turn.y, turn.z);
    }
}
