//! The cell with one robot, three cameras, a board, a cube of tags and a pallet, on one path, computed once for each number of stops.
#![allow(dead_code)]

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use cellmap::layout::Layout;
use cellmap::recording::{Recording, RobotMotion};

use super::cells;

/// The layout with every pose.
pub fn truth() -> Layout {
    cells::layout(&cells::one_robot_truth())
}

/// What the solver is told.
pub fn told() -> String {
    cells::hidden(&cells::one_robot_truth())
}

/// A path on which its cameras see what they need.
pub fn path(stops: u64) -> Vec<RobotMotion> {
    static PATHS: Mutex<BTreeMap<u64, Vec<RobotMotion>>> = Mutex::new(BTreeMap::new());
    let mut paths = PATHS.lock().unwrap_or_else(PoisonError::into_inner);
    paths.entry(stops).or_insert_with(|| cells::one_robot_path(stops)).clone()
}

/// What is recorded along it with little noise.
pub fn clean(stops: u64) -> Recording {
    static RECORDINGS: Mutex<BTreeMap<u64, Recording>> = Mutex::new(BTreeMap::new());
    let motions = path(stops);
    let mut recordings = RECORDINGS.lock().unwrap_or_else(PoisonError::into_inner);
    recordings.entry(stops).or_insert_with(|| cells::record(&truth(), motions, 0.05, 17)).clone()
}
