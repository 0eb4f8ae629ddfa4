//! A corner costs what it is: a number for its name and a pixel in the recording, three small numbers in the plan.

use std::alloc::System;
use std::path::Path;

use cellmap::frames::FrameTree;
use cellmap::layout::parse_layout;
use cellmap::recording::{Corners, read_detections, write_detections};
use cellmap::simulate::paper_size;
use cellmap::solve::Plan;
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// What is still held of all that was allocated while something was made, bytes.
fn held<T>(make: impl FnOnce() -> T) -> (T, f64) {
    let region = Region::new(ALLOCATOR);
    let made = make();
    let change = region.change();
    (made, change.bytes_allocated as f64 - change.bytes_deallocated as f64)
}

#[test]
fn a_corner_is_held_once() {
    let layout = parse_layout(Path::new("truth.yaml"), &paper_size::truth(), None).unwrap();
    let mut recording = paper_size::record(&layout, 30, 10, 40, 0.1);
    let count = recording.corners.len();
    assert_eq!(count, 3 * 300 * 40);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("detections.csv");
    write_detections(&path, &layout, &recording.corners).unwrap();
    recording.corners = Corners::default();
    let (corners, bytes) = held(|| read_detections(&path, &layout).unwrap());
    assert_eq!(corners.len(), count);
    // 20 bytes, some room to spare, and one appearance for 40 corners.
    assert!(bytes < 24.0 * count as f64, "{} bytes a corner", bytes / count as f64);
    recording.corners = corners;
    let tree = FrameTree::new(&layout);
    let (plan, bytes) = held(|| Plan::new(&layout, &tree, &recording).unwrap());
    assert_eq!(plan.measurements.corner_count(), count);
    assert!(bytes < 11.0 * count as f64, "{} bytes a corner", bytes / count as f64);
}
