//! `check`: a layout explained in words, before anything runs.

use std::collections::{BTreeMap, BTreeSet};

use crate::complaint::{Complaint, InputError, nearest};
use crate::frames::{Edge, FrameId, FrameTree, Freedom, pieces};
use crate::geometry::Pattern;
use crate::layout::images::{ImagePattern, PictureFile};
use crate::layout::{Layout, Motion, PoseSpec};
use crate::recording::{DEFAULT_DETECTIONS, Recording, RobotMotion};
use crate::solve::Plan;

/// What `check` found.
#[derive(Clone, Debug, PartialEq)]
pub struct Checked {
    /// The frames as lines of a tree.
    pub tree: Vec<String>,
    /// Sentences about robots, cameras, targets and measurements.
    pub facts: Vec<String>,
    /// What stands in the way of solving, each with a remedy.
    pub warnings: Vec<String>,
    /// Poses to be found.
    pub unknown: usize,
    /// Poses given.
    pub known: usize,
    /// Pictures found.
    pub pictures: usize,
    /// Configurations recorded.
    pub configurations: usize,
    /// Frames that no measurement reaches.
    pub unreached: Vec<String>,
}

/// Explains a layout and its recording.
///
/// # Errors
/// Faults of the files of the recording; pictures of configurations without joint values.
pub fn check(layout: &Layout) -> Result<Checked, InputError> {
    let blank = nothing_recorded(layout);
    let recording = if blank { empty(layout) } else { Recording::read_motion(layout)? };
    let tree = FrameTree::new(layout);
    let mut checked = Checked {
        tree: draw(layout, &tree),
        facts: Vec::new(),
        warnings: Vec::new(),
        unknown: 0,
        known: 0,
        pictures: 0,
        configurations: 0,
        unreached: Vec::new(),
    };
    for edge in &tree.static_edges {
        if edge.freedom == Freedom::Fixed { checked.known += 1 } else { checked.unknown += 1 }
    }
    let configurations: BTreeSet<u64> = recording.motions.iter().flat_map(|motion| motion.configurations()).collect();
    checked.configurations = configurations.len();
    for (robot, motion) in layout.robots.iter().zip(&recording.motions) {
        let how = match &robot.motion {
            Motion::Joints { chain, .. } => counted(chain.joint_count(), "joint"),
            Motion::FlangePoses { .. } => "reported flange poses".to_owned(),
        };
        let stops = counted(motion.configurations().len(), "configuration");
        let stops = if blank { "nothing recorded yet".to_owned() } else { stops };
        checked.facts.push(format!("robot `{}`: {how}, {stops}", robot.name));
    }
    let pictures = check_pictures(layout, &recording)?;
    for (camera, found) in layout.cameras.iter().zip(&pictures) {
        checked.pictures += found.len();
        let lens = match &camera.intrinsics {
            None => "no lens".to_owned(),
            Some(intrinsics) => {
                let [width, height] = intrinsics.size();
                let refined = if camera.refine.is_empty() { "" } else { ", lens to be refined" };
                format!("{width} x {height} {}{refined}", intrinsics.model().name())
            }
        };
        if let (Some(images), true, false) = (&camera.images, found.is_empty(), layout.observations.given || blank) {
            checked.warnings.push(format!("camera `{}` has no pictures: nothing matches `{images}`", camera.name));
        }
        let seen = if camera.images.is_some() { counted(found.len(), "picture") } else { "no pictures".to_owned() };
        checked.facts.push(format!("camera `{}`: {lens}, {seen}", camera.name));
    }
    for target in &layout.targets {
        let what = match &target.pattern {
            None => match &target.geometry {
                crate::geometry::TargetGeometry::Points(points) => counted(points.len(), "point"),
                _ => "known through measured poses".to_owned(),
            },
            Some(Pattern::Tags { dictionary, ids }) => {
                format!("{} of {}", counted(ids.len(), "tag"), dictionary.name())
            }
            Some(Pattern::Checkerboard { columns, rows }) => format!("checkerboard, {columns} x {rows} inner corners"),
            Some(Pattern::Charuco { squares, dictionary, .. }) => {
                format!("ChArUco board, {} x {} squares, {}", squares[0], squares[1], dictionary.name())
            }
        };
        let moves = if target.moves { ", moves" } else { "" };
        checked.facts.push(format!("target `{}`: {what}{moves}", target.name));
    }
    check_measurements(layout, &tree, blank, &mut checked)?;
    if let Some(meant) = misspelt_world(layout) {
        checked.warnings.push(format!("the world `{}` is a frame of its own; did you mean `{meant}`?", layout.world));
    }
    Ok(checked)
}

/// Whether a cell has been described but not driven: no robot's file, no picture and no measurement is there.
fn nothing_recorded(layout: &Layout) -> bool {
    let moved = layout.robots.iter().any(|robot| match &robot.motion {
        Motion::Joints { file, .. } | Motion::FlangePoses { file } => layout.recording.join(file).exists(),
    });
    let measured = observation_files(layout).iter().any(|file| layout.recording.join(file).exists());
    let seen = || {
        let patterns = layout.cameras.iter().filter_map(|camera| ImagePattern::parse(camera.images.as_deref()?).ok());
        patterns.into_iter().any(|pattern| !pattern.find(&layout.recording).is_empty())
    };
    !layout.robots.is_empty() && !moved && !measured && !seen()
}

/// The files of measurements that a layout names, or the one it would have.
fn observation_files(layout: &Layout) -> Vec<&str> {
    let o = &layout.observations;
    if !o.given {
        return vec![DEFAULT_DETECTIONS];
    }
    [&o.detections, &o.target_poses, &o.points, &o.contacts].into_iter().flatten().map(String::as_str).collect()
}

/// A recording of nothing.
fn empty(layout: &Layout) -> Recording {
    let motions = layout.robots.iter().map(|robot| match &robot.motion {
        Motion::Joints { .. } => RobotMotion::Joints(BTreeMap::new()),
        Motion::FlangePoses { .. } => RobotMotion::Flange(BTreeMap::new()),
    });
    Recording { motions: motions.collect(), ..Recording::default() }
}

/// `1 tag`, `2 tags`.
fn counted(count: usize, what: &str) -> String {
    if count == 1 { format!("1 {what}") } else { format!("{count} {what}s") }
}

/// The pictures of each camera.
///
/// # Errors
/// A picture of a configuration at which no robot of the layout was recorded.
pub fn check_pictures(layout: &Layout, recording: &Recording) -> Result<Vec<Vec<PictureFile>>, InputError> {
    let mut all = Vec::new();
    for camera in &layout.cameras {
        let pattern = camera.images.as_deref().map(ImagePattern::parse);
        let Some(Ok(pattern)) = pattern else {
            all.push(Vec::new());
            continue;
        };
        let found = pattern.find(&layout.recording);
        let orphan = found.iter().find(|picture| {
            !recording.motions.is_empty() && !recording.motions.iter().any(|motion| motion.knows(picture.configuration))
        });
        if let Some(picture) = orphan {
            let robot = &layout.robots[0];
            let file = match &robot.motion {
                Motion::Joints { file, .. } | Motion::FlangePoses { file } => layout.recording.join(file),
            };
            return Err(Complaint::of(
                &file,
                format!(
                    "configuration {} has the picture `{}` but no joint values",
                    picture.configuration,
                    picture.path.display()
                ),
                "add the line, or remove the picture",
            )
            .into());
        }
        all.push(found);
    }
    Ok(all)
}

/// What the measurements reach, if there are any yet.
fn check_measurements(layout: &Layout, tree: &FrameTree, blank: bool, checked: &mut Checked) -> Result<(), InputError> {
    if !layout.observations.given && !layout.recording.join(DEFAULT_DETECTIONS).exists() {
        checked.facts.push("measurements: none yet; `cellmap detect` makes them from the pictures".to_owned());
        return Ok(());
    }
    if blank {
        let files: Vec<String> = observation_files(layout).iter().map(|file| format!("`{file}`")).collect();
        checked.facts.push(format!("measurements: none yet; they are to come in {}", files.join(", ")));
        return Ok(());
    }
    let recording = Recording::read(layout, None)?;
    let mut parts = Vec::new();
    for (count, what) in [
        (recording.corners.len(), "corners"),
        (recording.poses.len(), "whole poses"),
        (recording.points.len(), "points"),
        (recording.contacts.len(), "contacts"),
    ] {
        if count > 0 {
            parts.push(format!("{count} {what}"));
        }
    }
    checked.facts.push(format!("measurements: {}", parts.join(", ")));
    let Ok(plan) = Plan::new(layout, tree, &recording) else { return Ok(()) };
    let found = pieces(
        tree,
        plan.groups.iter().map(|group| (&group.path, group.blocks.iter().map(|block| block.configuration).collect())),
    );
    let name = |frame: &FrameId| tree.frames[*frame].name.clone();
    for frame in &found.unseen {
        checked.unreached.push(name(frame));
        checked.warnings.push(format!("`{}` cannot be found: no measurement sees it or anything on it", name(frame)));
    }
    for (body, frames) in &found.floating {
        let names: Vec<String> = frames.iter().map(|frame| format!("`{}`", name(frame))).collect();
        let root = if *body == 0 { layout.world.clone() } else { name(body) };
        checked.unreached.extend(frames.iter().map(name));
        checked.warnings.push(format!(
            "{} cannot be found: nothing ties {} to `{root}`",
            names.join(", "),
            if names.len() == 1 { "it" } else { "them" }
        ));
    }
    Ok(())
}

/// A world that is nearly, but not quite, the name of something in the cell.
fn misspelt_world(layout: &Layout) -> Option<&str> {
    let names: Vec<&str> = layout
        .targets
        .iter()
        .map(|target| target.name.as_str())
        .chain(layout.cameras.iter().map(|camera| camera.name.as_str()))
        .chain(layout.sensors.iter().map(|sensor| sensor.name.as_str()))
        .collect();
    let plain = !names.contains(&layout.world.as_str()) && !layout.world.contains('.');
    if plain { nearest(&layout.world, names) } else { None }
}

/// The frames of a layout as lines of a tree, whatever the state of its recording.
#[must_use]
pub fn tree_of(layout: &Layout) -> Vec<String> {
    draw(layout, &FrameTree::new(layout))
}

/// The tree, a line a frame: what hangs on what, and whether its pose is known.
fn draw(layout: &Layout, tree: &FrameTree) -> Vec<String> {
    let mut lines = vec![layout.world.clone()];
    draw_children(layout, tree, 0, "", &mut lines);
    lines
}

fn draw_children(layout: &Layout, tree: &FrameTree, parent: FrameId, indent: &str, lines: &mut Vec<String>) {
    // A frame that is the world itself and link frames that carry nothing are passed through.
    let mut children: Vec<FrameId> = Vec::new();
    let mut queue: Vec<FrameId> =
        (0..tree.frames.len()).filter(|f| tree.frames[*f].parent == Some(parent)).rev().collect();
    while let Some(frame) = queue.pop() {
        let own: Vec<FrameId> =
            (0..tree.frames.len()).filter(|f| tree.frames[*f].parent == Some(frame)).rev().collect();
        let bare_link = matches!(tree.frames[frame].edge, Edge::Link { .. })
            && own.len() == 1
            && matches!(tree.frames[own[0]].edge, Edge::Link { .. });
        if bare_link || tree.frames[frame].name == layout.world {
            queue.extend(own);
        } else {
            children.push(frame);
        }
    }
    for (i, &frame) in children.iter().enumerate() {
        let last = i + 1 == children.len();
        let mark = match tree.frames[frame].edge {
            Edge::Root => String::new(),
            Edge::Static(edge) => match &tree.static_edges[edge].spec {
                PoseSpec::Unknown if tree.static_edges[edge].freedom == Freedom::Translation => {
                    "place unknown".to_owned()
                }
                PoseSpec::Unknown | PoseSpec::Hidden(_) => "unknown".to_owned(),
                PoseSpec::Fixed(_) => "known".to_owned(),
                PoseSpec::Start(_) => "unknown, with a start".to_owned(),
                PoseSpec::Prior(..) => "unknown, with a prior".to_owned(),
            },
            Edge::Moving(_) => "unknown at each configuration".to_owned(),
            Edge::Link { .. } => "moved by the joints".to_owned(),
        };
        let (branch, below) = if last { ("└─ ", "   ") } else { ("├─ ", "│  ") };
        lines.push(format!("{indent}{branch}{}  ({mark})", tree.frames[frame].name));
        draw_children(layout, tree, frame, &format!("{indent}{below}"), lines);
    }
}
