//! A problem in a file, so that a fresh process holds what solving needs and nothing of how the problem was made.
//!
//! Little-endian doubles: of the layout's text its bytes, and the text; for each robot its configurations and joints; the corners; the start.
#![allow(dead_code)]

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Error, ErrorKind, Read, Result, Write};
use std::path::Path;

use cellmap::geometry::{Feature, Pose};
use cellmap::layout::{Layout, parse_layout};
use cellmap::recording::{CornerRow, Corners, Recording, RobotMotion};
use cellmap::solve::State;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// What a solver is given.
pub struct Given {
    pub layout: Layout,
    pub recording: Recording,
    pub start: State,
}

/// Writes numbers.
pub fn numbers(out: &mut impl Write, values: &[f64]) -> Result<()> {
    values.iter().try_for_each(|value| out.write_all(&value.to_le_bytes()))
}

/// Writes a pose: quaternion (x, y, z, w), then translation.
pub fn pose(out: &mut impl Write, pose: &Pose) -> Result<()> {
    let (q, t) = (pose.rotation.coords, pose.translation);
    numbers(out, &[q.x, q.y, q.z, q.w, t.x, t.y, t.z])
}

/// Writes a problem whose robots are known by joints and whose corners are boards'.
pub fn write(mut out: impl Write, text: &str, recording: &Recording, start: &State) -> Result<()> {
    numbers(&mut out, &[text.len() as f64])?;
    out.write_all(text.as_bytes())?;
    for motion in &recording.motions {
        let RobotMotion::Joints(values) = motion else { return Err(bad("a robot without joints")) };
        numbers(&mut out, &[values.len() as f64, values.values().next().map_or(0.0, |first| first.len() as f64)])?;
        for (configuration, joints) in values {
            numbers(&mut out, &[*configuration as f64])?;
            numbers(&mut out, joints)?;
        }
    }
    numbers(&mut out, &[recording.corners.len() as f64])?;
    for row in &recording.corners {
        let Feature::BoardCorner(corner) = row.feature else { return Err(bad("no board's corner")) };
        let names = [row.configuration as f64, row.shot as f64, row.camera as f64, row.target as f64];
        numbers(&mut out, &names)?;
        numbers(&mut out, &[f64::from(corner), row.pixel[0], row.pixel[1]])?;
    }
    numbers(&mut out, &[start.static_poses.len() as f64])?;
    start.static_poses.iter().try_for_each(|one| pose(&mut out, one))?;
    numbers(
        &mut out,
        &[start.moving_poses.len() as f64, start.moving_poses.first().map_or(0.0, |one| one.len() as f64)],
    )?;
    start.moving_poses.iter().flatten().try_for_each(|one| pose(&mut out, one))?;
    start.lenses.iter().try_for_each(|lens| numbers(&mut out, lens))?;
    out.flush()
}

/// Reads what [`write`] wrote.
pub fn read(file: &Path) -> Result<Given> {
    let mut from = BufReader::new(File::open(file)?);
    let mut text = vec![0; count(&mut from)?];
    from.read_exact(&mut text)?;
    let text = String::from_utf8(text).map_err(|_| bad("the layout is no text"))?;
    let layout = parse_layout(Path::new("layout.yaml"), &text, None).map_err(|e| bad(&e.to_string()))?;
    drop(text);
    let motion = |from: &mut BufReader<File>| -> Result<RobotMotion> {
        let (configurations, joints) = (count(from)?, count(from)?);
        let one = |_| Ok((count(from)? as u64, (0..joints).map(|_| number(from)).collect::<Result<_>>()?));
        Ok(RobotMotion::Joints((0..configurations).map(one).collect::<Result<BTreeMap<_, _>>>()?))
    };
    let motions = layout.robots.iter().map(|_| motion(&mut from)).collect::<Result<_>>()?;
    let mut fault = None;
    let rows = (0..count(&mut from)?).map(|_| {
        let mut values = [0.0; 7];
        for value in &mut values {
            *value = number(&mut from).unwrap_or_else(|e| {
                fault = Some(e);
                f64::NAN
            });
        }
        let [configuration, shot, camera, target, corner, u, v] = values;
        CornerRow {
            configuration: configuration as u64,
            shot: shot as u64,
            camera: camera as usize,
            target: target as usize,
            feature: Feature::BoardCorner(corner as u32),
            pixel: [u, v],
            covariance: None,
        }
    });
    let corners = Corners::ascending(&layout, rows);
    if let Some(fault) = fault {
        return Err(fault);
    }
    let corners = corners.ok_or_else(|| bad("corners that the layout does not have"))?;
    let statics = (0..count(&mut from)?).map(|_| read_pose(&mut from)).collect::<Result<_>>()?;
    let (edges, configurations) = (count(&mut from)?, count(&mut from)?);
    let mut moved = || (0..configurations).map(|_| read_pose(&mut from)).collect::<Result<Vec<Pose>>>();
    let moving_poses = (0..edges).map(|_| moved()).collect::<Result<_>>()?;
    let mut lenses = vec![[0.0; 12]; layout.cameras.len()];
    for value in lenses.iter_mut().flatten() {
        *value = number(&mut from)?;
    }
    let corrections = layout.robots.iter().map(|_| Vec::new()).collect();
    let start = State { static_poses: statics, moving_poses, corrections, lenses };
    Ok(Given { layout, recording: Recording { motions, corners, ..Recording::default() }, start })
}

fn bad(what: &str) -> Error {
    Error::new(ErrorKind::InvalidData, what)
}

fn number(from: &mut impl Read) -> Result<f64> {
    let mut bytes = [0; 8];
    from.read_exact(&mut bytes)?;
    Ok(f64::from_le_bytes(bytes))
}

fn count(from: &mut impl Read) -> Result<usize> {
    Ok(number(from)? as usize)
}

/// To the last bit: a quaternion that is normalised once more may be another.
fn read_pose(from: &mut impl Read) -> Result<Pose> {
    let mut values = [0.0; 7];
    for value in &mut values {
        *value = number(from)?;
    }
    let [x, y, z, w, a, b, c] = values;
    Ok(Pose {
        rotation: UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z)),
        translation: Vector3::new(a, b, c),
    })
}
