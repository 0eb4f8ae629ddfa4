//! Writes a recording of three cameras' corners into a folder, to time and weigh `cellmap solve` on it: 7500 pictures, ten at each of 250 stops, or as many as
//! are asked for. Every picture shows 40 corners.
//!
//! `cargo run --release --example paper_size_recording -- FOLDER [STOPS SHOTS]`

use std::io::Write;
use std::path::Path;

use cellmap::layout::parse_layout;
use cellmap::recording::{RobotMotion, write_detections};
use cellmap::simulate::paper_size;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (folder, stops, shots) = match arguments.as_slice() {
        [folder] => (folder, 250, 10),
        [folder, stops, shots] => (folder, stops.parse()?, shots.parse()?),
        _ => return Err("FOLDER [STOPS SHOTS]".into()),
    };
    let folder = Path::new(folder);
    std::fs::create_dir_all(folder)?;
    let truth = parse_layout(Path::new("truth.yaml"), &paper_size::truth(), None)?;
    let recording = paper_size::record(&truth, stops, shots, 40, 0.1);
    std::fs::write(folder.join("truth.yaml"), paper_size::truth())?;
    std::fs::write(folder.join("layout.yaml"), paper_size::hidden(false))?;
    std::fs::write(folder.join("layout_free_lens.yaml"), paper_size::hidden(true))?;
    write_detections(&folder.join("detections.csv"), &truth, &recording.corners)?;
    let mut joints = std::fs::File::create(folder.join("joints.csv"))?;
    writeln!(joints, "configuration,robot,q1,q2,q3,q4,q5,q6")?;
    if let RobotMotion::Joints(values) = &recording.motions[0] {
        for (configuration, q) in values {
            let cells: Vec<String> = q.iter().map(|q| format!("{:.10}", q.to_degrees())).collect();
            writeln!(joints, "{configuration},ur3,{}", cells.join(","))?;
        }
    }
    println!("{} corners in {}", recording.corners.len(), folder.display());
    Ok(())
}
