//! Measurements by others: whole poses, points and contacts.

use nalgebra::Vector3;
use std::path::Path;

use super::motion::pose_of;
use super::table::{Row, Table};
use crate::complaint::InputError;
use crate::geometry::{Feature, Pose, TargetGeometry};
use crate::layout::Layout;

/// `camera_from_target`, measured.
#[derive(Clone, Debug, PartialEq)]
pub struct PoseRow {
    /// Where all robots stand.
    pub configuration: u64,
    /// Which of several measurements there.
    pub shot: u64,
    /// The camera's place in the layout.
    pub camera: usize,
    /// The target's place in the layout.
    pub target: usize,
    /// `camera_from_target`.
    pub pose: Pose,
}

impl PoseRow {
    /// The order of rows that everything downstream relies on; no two rows share it.
    #[must_use]
    pub fn key(&self) -> (usize, usize, u64, u64) {
        (self.camera, self.target, self.configuration, self.shot)
    }
}

/// A point in a sensor's frame, measured.
#[derive(Clone, Debug, PartialEq)]
pub struct PointRow {
    /// Where all robots stand.
    pub configuration: u64,
    /// Which of several measurements there.
    pub shot: u64,
    /// The sensor's place in the layout.
    pub sensor: usize,
    /// The target's place in the layout.
    pub target: usize,
    /// The point on the target.
    pub feature: Feature,
    /// In the sensor's frame, m.
    pub position: Vector3<f64>,
}

impl PointRow {
    /// The order of rows that everything downstream relies on; no two rows share it.
    #[must_use]
    pub fn key(&self) -> (usize, usize, &Feature, u64, u64) {
        (self.sensor, self.target, &self.feature, self.configuration, self.shot)
    }
}

/// Two points at a known distance.
#[derive(Clone, Debug, PartialEq)]
pub struct ContactRow {
    /// Where all robots stand.
    pub configuration: u64,
    /// The two points: target's place in the layout, and which point.
    pub points: [(usize, Feature); 2],
    /// m.
    pub distance: f64,
}

impl ContactRow {
    /// The order of rows that everything downstream relies on; no two rows share it.
    #[must_use]
    pub fn key(&self) -> (u64, &[(usize, Feature); 2]) {
        (self.configuration, &self.points)
    }
}

/// Rows with the lines they stand on, sorted; two of the same thing are a fault.
fn sorted<T>(
    path: &Path,
    mut rows: Vec<(T, usize)>,
    order: impl Fn(&T, &T) -> std::cmp::Ordering,
) -> Result<Vec<T>, InputError> {
    rows.sort_by(|a, b| order(&a.0, &b.0));
    if let Some(pair) = rows.windows(2).find(|pair| order(&pair[0].0, &pair[1].0).is_eq()) {
        let (first, second) = (pair[0].1.min(pair[1].1), pair[0].1.max(pair[1].1));
        let what = format!("this measurement is given twice, first on line {first}");
        return Err(crate::complaint::Complaint::at(path, second, what, "keep one of the lines").into());
    }
    Ok(rows.into_iter().map(|(row, _)| row).collect())
}

/// Reads a file of whole poses, sorted by camera, target, configuration and shot.
///
/// # Errors
/// Faults of the file, names that the layout does not have, a quaternion that is not of length one, a measurement given twice.
pub fn read_target_poses(path: &Path, layout: &Layout) -> Result<Vec<PoseRow>, InputError> {
    let names = ["configuration", "shot", "camera", "target", "x", "y", "z", "qx", "qy", "qz", "qw"];
    let mut table = Table::open(path, &names)?;
    let [configuration, shot, camera, target] = table.columns(["configuration", "shot", "camera", "target"]);
    let columns = table.columns(["x", "y", "z", "qx", "qy", "qz", "qw"]);
    let cameras: Vec<&str> = layout.cameras.iter().map(|camera| camera.name.as_str()).collect();
    let targets: Vec<&str> = layout.targets.iter().map(|target| target.name.as_str()).collect();
    let mut rows = Vec::new();
    while let Some(row) = table.next_row()? {
        let found = PoseRow {
            configuration: row.whole(configuration)?,
            shot: row.whole(shot)?,
            camera: row.one_of(camera, "camera", &cameras)?,
            target: row.one_of(target, "target", &targets)?,
            pose: pose_of(&row, row.numbers(columns)?, layout.units)?,
        };
        rows.push((found, row.line));
    }
    sorted(path, rows, |a, b| a.key().cmp(&b.key()))
}

/// Reads a file of points, sorted by sensor, target, point, configuration and shot.
///
/// # Errors
/// Faults of the file, a sensor that the layout does not have, a point name that no target or more than one has, a measurement given twice.
pub fn read_points(path: &Path, layout: &Layout) -> Result<Vec<PointRow>, InputError> {
    let names = ["configuration", "shot", "sensor", "point", "x", "y", "z"];
    let mut table = Table::open(path, &names)?;
    let [configuration, shot, sensor, point] = table.columns(["configuration", "shot", "sensor", "point"]);
    let columns = table.columns(["x", "y", "z"]);
    let sensors: Vec<&str> = layout.sensors.iter().map(|sensor| sensor.name.as_str()).collect();
    let mut rows = Vec::new();
    while let Some(row) = table.next_row()? {
        let (target, feature) = find_point(&row, layout, row.text(point)?)?;
        let found = PointRow {
            configuration: row.whole(configuration)?,
            shot: row.whole(shot)?,
            sensor: row.one_of(sensor, "sensor", &sensors)?,
            target,
            feature,
            position: Vector3::from(row.numbers(columns)?) * layout.units.length,
        };
        rows.push((found, row.line));
    }
    sorted(path, rows, |a, b| a.key().cmp(&b.key()))
}

/// Reads a file of contacts, sorted.
///
/// # Errors
/// Faults of the file, targets or points that the layout does not have, a negative distance, a contact given twice.
pub fn read_contacts(path: &Path, layout: &Layout) -> Result<Vec<ContactRow>, InputError> {
    let names = ["configuration", "frame_a", "point_a", "frame_b", "point_b", "distance"];
    let mut table = Table::open(path, &names)?;
    let [configuration, frame_a, point_a, frame_b, point_b, distance] = table.columns(names);
    let targets: Vec<&str> = layout.targets.iter().map(|target| target.name.as_str()).collect();
    let mut rows = Vec::new();
    while let Some(row) = table.next_row()? {
        let mut ends = Vec::with_capacity(2);
        for (frame, point) in [(frame_a, point_a), (frame_b, point_b)] {
            let target = row.one_of(frame, "target", &targets)?;
            let feature = Feature::Point(row.text(point)?.to_owned());
            if !layout.targets[target].geometry.has(&feature) {
                return Err(row.complaint(
                    format!("target `{}` has no point `{}`", targets[target], row.text(point)?),
                    "add it to the target's `points`",
                ));
            }
            ends.push((target, feature));
        }
        let value = row.number(distance)? * layout.units.length;
        if value < 0.0 {
            return Err(row.complaint("the distance is negative", "two points that touch have distance 0"));
        }
        let Ok(points) = <[_; 2]>::try_from(ends) else { continue };
        rows.push((ContactRow { configuration: row.whole(configuration)?, points, distance: value }, row.line));
    }
    sorted(path, rows, |a, b| a.key().cmp(&b.key()))
}

/// `point`, or `target.point` where several targets have a point of that name.
fn find_point(row: &Row<'_>, layout: &Layout, name: &str) -> Result<(usize, Feature), InputError> {
    let (wanted, point) = match name.split_once('.') {
        Some((target, point)) => (Some(target), point),
        None => (None, name),
    };
    let feature = Feature::Point(point.to_owned());
    let owners: Vec<usize> = layout
        .targets
        .iter()
        .enumerate()
        .filter(|(_, target)| wanted.is_none_or(|wanted| wanted == target.name) && target.geometry.has(&feature))
        .map(|(index, _)| index)
        .collect();
    match owners[..] {
        [target] => Ok((target, feature)),
        [] => {
            let known = layout.targets.iter().flat_map(|target| match &target.geometry {
                TargetGeometry::Points(points) => points.iter().map(|(name, _)| name.as_str()).collect(),
                _ => Vec::new(),
            });
            Err(row.complaint(
                format!("no target has a point `{name}`"),
                format!("the layout's points are {}", crate::complaint::list(known.take(12))),
            ))
        }
        [first, second, ..] => Err(row.complaint(
            format!(
                "the point `{name}` is on `{}` and on `{}`",
                layout.targets[first].name, layout.targets[second].name
            ),
            format!("write `{}.{name}`", layout.targets[first].name),
        )),
    }
}
