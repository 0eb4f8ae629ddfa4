//! `identify`: the published 15-parameter method on a layout's measured points.

use crate::complaint::{Complaint, InputError, list, nearest};
use crate::frames::{FrameTree, Step};
use crate::geometry::{Feature, Pose, TargetGeometry};
use crate::identify::{FreeIdentification, RigidIdentification, Sample, free, rigid};
use crate::layout::Layout;
use crate::recording::Recording;

/// What to identify.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct IdentifyRequest {
    /// The robot; may be left out if the layout has one.
    pub robot: Option<String>,
    /// The tool point; may be left out if one was measured.
    pub point: Option<String>,
    /// Use only these sensors; empty for all.
    pub sensors: Vec<String>,
}

/// Both methods side by side.
#[derive(Clone, Debug, PartialEq)]
pub struct Identified {
    /// The robot.
    pub robot: String,
    /// The tool point.
    pub point: String,
    /// Points used.
    pub measurements: usize,
    /// As published.
    pub free: FreeIdentification,
    /// With a true rotation; none where the points do not determine one.
    pub rigid: Option<RigidIdentification>,
}

/// Runs the published method.
///
/// # Errors
/// Faults of the recording; a robot, point or sensor that is not there or not named clearly; too few points.
pub fn identify(layout: &Layout, request: &IdentifyRequest) -> Result<Identified, InputError> {
    let recording = Recording::read(layout, None)?;
    let tree = FrameTree::new(layout);
    let robot = pick(
        layout,
        "robot",
        request.robot.as_deref(),
        &layout.robots.iter().map(|robot| robot.name.as_str()).collect::<Vec<_>>(),
    )?;
    let sensors: Vec<&str> = layout.sensors.iter().map(|sensor| sensor.name.as_str()).collect();
    for wanted in &request.sensors {
        pick(layout, "sensor", Some(wanted), &sensors)?;
    }
    // The tool points that hang on this robot's flange.
    let flange = tree.robots[robot].last().copied().unwrap_or(0);
    let mut points: Vec<&str> = Vec::new();
    for target in
        layout.targets.iter().zip(&tree.targets).filter(|(_, frame)| tree.body(**frame) == flange).map(|(t, _)| t)
    {
        if let TargetGeometry::Points(named) = &target.geometry {
            points.extend(named.iter().map(|(name, _)| name.as_str()));
        }
    }
    points.retain(|name| recording.points.iter().any(|row| row.feature == Feature::Point((*name).to_owned())));
    let point = points[pick(layout, "measured tool point", request.point.as_deref(), &points)?];
    let mut samples = Vec::new();
    for row in &recording.points {
        if row.feature != Feature::Point(point.to_owned()) {
            continue;
        }
        let sensor = &layout.sensors[row.sensor];
        if !request.sensors.is_empty() && !request.sensors.contains(&sensor.name) {
            continue;
        }
        let world_from_sensor = fixed_pose(&tree, tree.sensors[row.sensor]).ok_or_else(|| {
            Complaint::at(
                &layout.file,
                sensor.line,
                format!("the pose of sensor `{}` is not known", sensor.name),
                "the published method measures in the world: name the sensor as the `world`, or give its pose",
            )
        })?;
        let base_from_flange = recording.base_from_flange(layout, robot, row.configuration).ok_or_else(|| {
            Complaint::of(
                &layout.file,
                format!(
                    "configuration {} has a measured point but no joint values of `{}`",
                    row.configuration, layout.robots[robot].name
                ),
                "add the line, or remove the point",
            )
        })?;
        samples.push(Sample { base_from_flange, world_point: world_from_sensor * row.position });
    }
    let found = free(&samples).ok_or_else(|| {
        Complaint::of(
            &layout.file,
            format!("{} measured points do not determine fifteen parameters", samples.len()),
            "the published method needs at least five, and good answers need fifty or more",
        )
    })?;
    Ok(Identified {
        robot: layout.robots[robot].name.clone(),
        point: point.to_owned(),
        measurements: samples.len(),
        free: found,
        rigid: rigid(&samples),
    })
}

/// The place of a name, or of the only one there is.
fn pick(layout: &Layout, kind: &str, wanted: Option<&str>, known: &[&str]) -> Result<usize, Complaint> {
    match (wanted, known) {
        (Some(wanted), _) => known.iter().position(|name| *name == wanted).ok_or_else(|| {
            let remedy = match nearest(wanted, known.iter().copied()) {
                Some(meant) => format!("did you mean `{meant}`?"),
                None => format!("there is {}", list(known.iter().copied())),
            };
            Complaint::of(&layout.file, format!("there is no {kind} `{wanted}`"), remedy)
        }),
        (None, [_]) => Ok(0),
        (None, []) => Err(Complaint::of(
            &layout.file,
            format!("there is no {kind}"),
            "the published method needs a robot whose flange carries a point that a sensor measured",
        )),
        (None, _) => Err(Complaint::of(
            &layout.file,
            format!("there is more than one {kind}: {}", list(known.iter().copied())),
            format!("say which with `--{}`", kind.rsplit(' ').next().unwrap_or(kind)),
        )),
    }
}

/// `world_from_frame` along fixed edges alone.
fn fixed_pose(tree: &FrameTree, frame: usize) -> Option<Pose> {
    tree.path(0, frame).steps.iter().try_fold(Pose::identity(), |pose, step| match *step {
        Step::Static { edge, inverse } => {
            let value = tree.static_edges[edge].spec.pose()?;
            Some(pose * if inverse { value.inverse() } else { value })
        }
        _ => None,
    })
}
