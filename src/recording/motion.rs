//! Where robots stand: joint values and reported flange poses.

use nalgebra::{Quaternion, Vector3};
use std::collections::BTreeMap;
use std::path::Path;

use super::table::Table;
use crate::complaint::{Complaint, InputError};
use crate::geometry::Pose;
use crate::layout::poses::checked_unit;
use crate::layout::{Layout, Motion, Units};
use crate::robot::JointKind;

/// Joint values (rad, m) of one robot by configuration.
pub type JointValues = BTreeMap<u64, Vec<f64>>;
/// `base_from_flange` of one robot by configuration.
pub type FlangePoses = BTreeMap<u64, Pose>;

/// Reads the joint values of robot `index` of the layout. Rows of other robots of the layout are passed over.
///
/// # Errors
/// Faults of the file, no row of the robot, the wrong number of joints, a configuration given twice.
pub fn read_joints(path: &Path, layout: &Layout, index: usize) -> Result<JointValues, InputError> {
    let robot = &layout.robots[index];
    let Motion::Joints { chain, .. } = &robot.motion else { return Ok(JointValues::new()) };
    let mut table = Table::open(path, &["configuration", "robot", "q1"])?;
    let [configuration, name] = table.columns(["configuration", "robot"]);
    let columns: Vec<usize> = (1..).map_while(|i| table.column(&format!("q{i}"))).collect();
    let count = chain.joint_count();
    let mut values = JointValues::new();
    while let Some(row) = table.next_row()? {
        // The file of a real cell also lists arms that this layout leaves out.
        if row.text(name)? != robot.name {
            continue;
        }
        let id = row.whole(configuration)?;
        let mut filled = 0;
        for (i, &column) in columns.iter().enumerate() {
            if !row.text(column)?.is_empty() {
                filled = i + 1;
            }
        }
        if filled != count {
            return Err(row.complaint(
                format!("robot `{}` has {count} joints but {filled} values stand here", robot.name),
                "give one value for each joint and leave the other cells empty",
            ));
        }
        let scale = |i: usize| match chain.links[i].joint {
            JointKind::Revolute => layout.units.angle,
            JointKind::Prismatic => layout.units.length,
        };
        let joints: Result<Vec<f64>, InputError> = (0..count).map(|i| Ok(row.number(columns[i])? * scale(i))).collect();
        if values.insert(id, joints?).is_some() {
            return Err(row.complaint(
                format!("configuration {id} of robot `{}` is given twice", robot.name),
                "keep one of the lines",
            ));
        }
    }
    not_empty(path, &robot.name, values.is_empty())?;
    Ok(values)
}

/// Reads the reported flange poses of robot `index` of the layout.
///
/// # Errors
/// Faults of the file, a quaternion that is not of length one, a configuration given twice.
pub fn read_flange_poses(path: &Path, layout: &Layout, index: usize) -> Result<FlangePoses, InputError> {
    let robot = &layout.robots[index].name;
    let names = ["configuration", "robot", "x", "y", "z", "qx", "qy", "qz", "qw"];
    let mut table = Table::open(path, &names)?;
    let [configuration, name] = table.columns(["configuration", "robot"]);
    let columns = table.columns(["x", "y", "z", "qx", "qy", "qz", "qw"]);
    let mut poses = FlangePoses::new();
    while let Some(row) = table.next_row()? {
        if row.text(name)? != robot {
            continue;
        }
        let id = row.whole(configuration)?;
        let pose = pose_of(&row, row.numbers(columns)?, layout.units)?;
        if poses.insert(id, pose).is_some() {
            return Err(
                row.complaint(format!("configuration {id} of robot `{robot}` is given twice"), "keep one of the lines")
            );
        }
    }
    not_empty(path, robot, poses.is_empty())?;
    Ok(poses)
}

/// A pose from x, y, z, qx, qy, qz, qw in a row's units.
pub(super) fn pose_of(row: &super::table::Row<'_>, numbers: [f64; 7], units: Units) -> Result<Pose, InputError> {
    let [x, y, z, qx, qy, qz, qw] = numbers;
    let quaternion = Quaternion::new(qw, qx, qy, qz);
    let rotation = checked_unit(quaternion).ok_or_else(|| {
        row.complaint(
            format!("the quaternion has length {:.4}", quaternion.norm()),
            "a rotation has length 1: check the columns qx, qy, qz, qw",
        )
    })?;
    Ok(Pose::new(rotation, Vector3::new(x, y, z) * units.length))
}

fn not_empty(path: &Path, robot: &str, empty: bool) -> Result<(), InputError> {
    if empty {
        let what = format!("the file has no line for robot `{robot}`");
        return Err(Complaint::of(path, what, "check the column `robot` against the layout").into());
    }
    Ok(())
}
