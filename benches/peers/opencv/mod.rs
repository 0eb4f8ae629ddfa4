//! OpenCV's own detector in a process of its own; see `serve.py` beside this file.

use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use cellmap::detect::{Dictionary, GreyPicture};
use serde_json::{Value, json};

/// An id and its four corners.
type Quad = (u32, [[f64; 2]; 4]);

/// A running `serve.py`.
pub struct Peer {
    process: Child,
    to: ChildStdin,
    from: BufReader<ChildStdout>,
    name: String,
}

impl Peer {
    /// Starts the Python that `CELLMAP_OPENCV_PYTHON` names; `None` if there is none or it has no OpenCV.
    pub fn start() -> Option<Self> {
        let python = std::env::var_os("CELLMAP_OPENCV_PYTHON")?;
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/benches/peers/opencv/serve.py");
        let mut process = Command::new(python).arg(script).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().ok()?;
        let (to, mut from) = (process.stdin.take()?, BufReader::new(process.stdout.take()?));
        let greeting = answer(&mut from)?;
        let name = format!("OpenCV {} SUBPIX", greeting["version"].as_str()?);
        Some(Self { process, to, from, name })
    }

    pub fn name(&self) -> &str {
        &self.name
    }

    /// Least time of a call in ms, ids and corners. Nothing, at no cost, for a dictionary that OpenCV does not have.
    pub fn look(&mut self, picture: &GreyPicture, dictionary: Dictionary, repeats: usize) -> (f64, Vec<Quad>) {
        let Some(name) = opencv_name(dictionary) else { return (0.0, Vec::new()) };
        let ask = json!({"dictionary": name, "width": picture.width(), "height": picture.height(), "repeats": repeats});
        let sent = writeln!(self.to, "{ask}").and_then(|()| self.to.write_all(picture.pixels()));
        sent.and_then(|()| self.to.flush()).expect("serve.py reads");
        let answer = answer(&mut self.from).expect("serve.py answers");
        let number = |value: &Value| value.as_f64().expect("a number");
        // OpenCV keeps AprilRobotics' families turned by half a turn.
        let turn = if dictionary.is_april_tag() { 2 } else { 0 };
        let (ids, quads) = (answer["ids"].as_array().expect("ids"), answer["corners"].as_array().expect("corners"));
        let found = ids.iter().zip(quads).map(|(id, quad)| {
            let corner = |k: usize| [0, 1].map(|axis: usize| number(&quad[(k + turn) % 4][axis]));
            (number(id) as u32, [0, 1, 2, 3].map(corner))
        });
        (number(&answer["ms"]), found.collect())
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        // It has nothing to lose.
        let _ = self.process.kill().and_then(|()| self.process.wait());
    }
}

fn answer(from: &mut impl BufRead) -> Option<Value> {
    let mut line = String::new();
    from.read_line(&mut line).ok()?;
    serde_json::from_str(&line).ok()
}

/// `DICT_6X6_250` for `6x6_250`.
fn opencv_name(dictionary: Dictionary) -> Option<String> {
    let name = dictionary.to_string().to_uppercase();
    dictionary.opencv_number()?;
    Some(match dictionary {
        Dictionary::ArucoOriginal => "DICT_ARUCO_ORIGINAL".to_owned(),
        Dictionary::ArucoMip36h12 => "DICT_ARUCO_MIP_36h12".to_owned(),
        _ => format!("DICT_{}", name.replace("36H", "36h").replace("16H", "16h").replace("25H", "25h")),
    })
}
