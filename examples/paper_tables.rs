//! Tables 3, 4 and 5 of the paper, side by side: as published, recomputed by its method from its measurements, the same with a true rotation, and cellmap's
//! joint solve of the whole cell from the boards' poses.
//!
//! `cargo run --release --example paper_tables -- FOLDER`
//!
//! The folder has one folder a table (`sim_b`, `exp_a`, `exp_b`), each with `layout_points.yaml`, `layout_poses.yaml` and the files that they name. The authors
//! publish their measurements at github.com/robot-vsb-cz/parameters-identification.

use std::path::{Path, PathBuf};

use cellmap::layout::read_layout;
use cellmap::workflow::identify::{Identified, IdentifyRequest, identify};
use cellmap::workflow::solve::{SolveRequest, Solved, solve};
use nalgebra::{Matrix3, Vector3};

/// One column of the paper: x0, y0, z0 (mm), r11, r21, r31, r12, ... r33, xe, ye, ze (mm).
type Column = [f64; 15];

/// A table's part: its folder, the camera if not all, what is printed above it, and what the paper prints.
struct Part {
    set: &'static str,
    sensor: Option<&'static str>,
    title: &'static str,
    published: Column,
}

const NAMES: [&str; 15] =
    ["x0", "y0", "z0", "r11", "r21", "r31", "r12", "r22", "r32", "r13", "r23", "r33", "xe", "ye", "ze"];

#[rustfmt::skip]
const PARTS: [Part; 6] = [
    Part { set: "sim_b", sensor: None, title: "Table 3, simulation B (truth: 431 555 -460, no rotation, tool 0 0 66)", published: [433.59, 556.01, -458.41, 1.006, -0.006, 0.001, 0.003, 1.004, 0.0, -0.006, -0.001, 1.0, 0.14, 0.23, 64.78] },
    Part { set: "exp_a", sensor: Some("cam1"), title: "Table 4, experiment A, camera 1", published: [432.53, 551.15, -451.33, 1.006, -0.018, -0.004, 0.02, 1.008, 0.0, 0.01, 0.012, 0.99, 0.18, 0.52, 64.09] },
    Part { set: "exp_a", sensor: Some("cam2"), title: "Table 4, experiment A, camera 2", published: [430.81, 561.06, -449.27, 1.024, -0.039, -0.013, 0.014, 1.019, -0.009, 0.01, -0.009, 0.969, 0.49, 0.73, 61.0] },
    Part { set: "exp_a", sensor: Some("cam3"), title: "Table 4, experiment A, camera 3", published: [426.91, 555.45, -456.496, 1.013, -0.015, 0.008, 0.007, 1.004, 0.01, 0.001, -0.006, 1.011, 0.05, 0.68, 66.03] },
    Part { set: "exp_a", sensor: None, title: "Table 4, experiment A, all cameras (stated: 431 555 -460, no rotation, tool 0 0 66)", published: [430.05, 555.96, -452.39, 1.014, -0.024, -0.003, 0.013, 1.011, 0.0, 0.007, -0.001, 0.991, 0.24, 0.65, 63.73] },
    Part { set: "exp_b", sensor: None, title: "Table 5, experiment B (stated: 611 29 -27, tool 0 0 66)", published: [613.88, 30.94, -25.12, 0.506, -0.873, 0.012, 0.872, 0.515, 0.02, -0.016, -0.013, 1.043, -0.05, 0.69, 67.59] },
];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder: PathBuf = std::env::args_os().nth(1).ok_or("give the folder that holds sim_b, exp_a and exp_b")?.into();
    for part in PARTS {
        let set = folder.join(part.set);
        let request =
            IdentifyRequest { sensors: part.sensor.iter().map(|s| (*s).to_owned()).collect(), ..Default::default() };
        let identified = identify(&read_layout(&set.join("layout_points.yaml"), None)?, &request)?;
        // One camera alone is no other cell: the joint solve always takes all.
        let joint = if part.sensor.is_none() { Some(whole_cell(&set)?) } else { None };
        show(&part, &identified, joint.as_ref());
    }
    Ok(())
}

fn whole_cell(set: &Path) -> Result<Solved, Box<dyn std::error::Error>> {
    let layout = read_layout(&set.join("layout_poses.yaml"), None)?;
    Ok(solve(layout, &SolveRequest::default())?)
}

fn column(origin: Vector3<f64>, matrix: Matrix3<f64>, tool: Vector3<f64>) -> Column {
    let mut values = [0.0; 15];
    values[..3].copy_from_slice((origin * 1e3).as_slice());
    values[3..12].copy_from_slice(matrix.as_slice());
    values[12..].copy_from_slice((tool * 1e3).as_slice());
    values
}

fn show(part: &Part, identified: &Identified, joint: Option<&Solved>) {
    let free = &identified.free;
    let mut columns = vec![("published", part.published), ("recomputed", column(free.origin, free.matrix, free.tool))];
    if let Some(rigid) = &identified.rigid {
        let base = &rigid.world_from_base;
        columns.push(("true rotation", column(base.translation, base.rotation_matrix(), rigid.tool)));
    }
    let found = joint.and_then(|solved| {
        let base = solved.world_from(&format!("{}.base", identified.robot))?;
        let tool = solved.pose(&format!("{}.flange_from_tool_board", identified.robot))?;
        Some(column(base.translation, base.rotation_matrix(), tool.translation))
    });
    columns.extend(found.map(|column| ("joint solve", column)));
    println!("\n{}", part.title);
    println!("{:4}{}", "", columns.iter().map(|(name, _)| format!("{name:>15}")).collect::<String>());
    for (i, name) in NAMES.iter().enumerate() {
        let decimals = if (3..12).contains(&i) { 3 } else { 2 };
        let cells: String = columns.iter().map(|(_, values)| format!("{:15.decimals$}", values[i])).collect();
        println!("{name:4}{cells}");
    }
    println!("rms of the recomputed fit {:.3} mm over {} positions", free.rms * 1e3, identified.measurements);
}
