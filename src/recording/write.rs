//! Writing motions and measurements: the inverse of the readers, to the last bit of every number.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use super::{PointRow, PoseRow, RobotMotion, atomic};
use crate::geometry::{Feature, Pose, TargetGeometry};
use crate::layout::{Layout, Motion};
use crate::robot::JointKind;

/// Writes the motion of every robot into the files that the layout names, below `folder`; robots that share a file are in it one after the other.
///
/// # Errors
/// When a file cannot be written; an older one then stands untouched.
pub fn write_motions(folder: &Path, layout: &Layout, motions: &[RobotMotion]) -> std::io::Result<()> {
    let file_of = |robot: usize| match &layout.robots[robot].motion {
        Motion::Joints { file, .. } | Motion::FlangePoses { file } => file.as_str(),
    };
    let robots: Vec<usize> = (0..layout.robots.len()).collect();
    for file in robots.iter().map(|robot| file_of(*robot)).collect::<BTreeSet<_>>() {
        let here: Vec<usize> = robots.iter().copied().filter(|robot| file_of(*robot) == file).collect();
        let joints = here.iter().filter_map(|robot| joint_count(layout, *robot)).max();
        atomic::write(&folder.join(file), |out| {
            match joints {
                Some(count) => {
                    let names: Vec<String> = (1..=count).map(|i| format!("q{i}")).collect();
                    writeln!(out, "configuration,robot,{}", names.join(","))?;
                }
                None => writeln!(out, "configuration,robot,x,y,z,qx,qy,qz,qw")?,
            }
            for &robot in &here {
                for (configuration, numbers) in numbers(layout, robot, motions.get(robot)) {
                    let cells: Vec<String> = numbers.iter().map(f64::to_string).collect();
                    let empty = ",".repeat(joints.unwrap_or(0).saturating_sub(numbers.len()));
                    writeln!(out, "{configuration},{},{}{empty}", layout.robots[robot].name, cells.join(","))?;
                }
            }
            Ok(())
        })?;
    }
    Ok(())
}

fn joint_count(layout: &Layout, robot: usize) -> Option<usize> {
    match &layout.robots[robot].motion {
        Motion::Joints { chain, .. } => Some(chain.joint_count()),
        Motion::FlangePoses { .. } => None,
    }
}

/// A robot's values in the layout's units, by configuration.
fn numbers(layout: &Layout, robot: usize, motion: Option<&RobotMotion>) -> BTreeMap<u64, Vec<f64>> {
    let units = layout.units;
    match (motion, &layout.robots[robot].motion) {
        (Some(RobotMotion::Joints(values)), Motion::Joints { chain, .. }) => {
            let scale = |(link, value): (&crate::robot::Link, &f64)| match link.joint {
                JointKind::Revolute => value / units.angle,
                JointKind::Prismatic => value / units.length,
            };
            values.iter().map(|(c, joints)| (*c, chain.links.iter().zip(joints).map(scale).collect())).collect()
        }
        (Some(RobotMotion::Flange(poses)), _) => {
            poses.iter().map(|(c, pose)| (*c, pose_numbers(pose, units.length).to_vec())).collect()
        }
        _ => BTreeMap::new(),
    }
}

fn pose_numbers(pose: &Pose, length: f64) -> [f64; 7] {
    let (t, q) = (pose.translation / length, pose.rotation.coords);
    [t.x, t.y, t.z, q.x, q.y, q.z, q.w]
}

/// Writes whole poses.
///
/// # Errors
/// When the file cannot be written; an older one then stands untouched.
pub fn write_target_poses(path: &Path, layout: &Layout, rows: &[PoseRow]) -> std::io::Result<()> {
    atomic::write(path, |out| {
        writeln!(out, "configuration,shot,camera,target,x,y,z,qx,qy,qz,qw")?;
        for row in rows {
            let (camera, target) = (&layout.cameras[row.camera].name, &layout.targets[row.target].name);
            let cells = pose_numbers(&row.pose, layout.units.length).map(|number| number.to_string());
            writeln!(out, "{},{},{camera},{target},{}", row.configuration, row.shot, cells.join(","))?;
        }
        Ok(())
    })
}

/// Writes points. A name that several targets have is written as `target.name`.
///
/// # Errors
/// When the file cannot be written; an older one then stands untouched.
pub fn write_points(path: &Path, layout: &Layout, rows: &[PointRow]) -> std::io::Result<()> {
    let mut owners: BTreeMap<&str, usize> = BTreeMap::new();
    for target in &layout.targets {
        if let TargetGeometry::Points(points) = &target.geometry {
            points.iter().for_each(|(name, _)| *owners.entry(name).or_default() += 1);
        }
    }
    atomic::write(path, |out| {
        writeln!(out, "configuration,shot,sensor,point,x,y,z")?;
        for row in rows {
            let Feature::Point(name) = &row.feature else { continue };
            let point = match owners.get(name.as_str()) {
                Some(1) => name.clone(),
                _ => format!("{}.{name}", layout.targets[row.target].name),
            };
            let p = row.position / layout.units.length;
            let sensor = &layout.sensors[row.sensor].name;
            writeln!(out, "{},{},{sensor},{point},{},{},{}", row.configuration, row.shot, p.x, p.y, p.z)?;
        }
        Ok(())
    })
}
