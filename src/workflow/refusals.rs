//! What a recording or a layout lacks to be solved.

use crate::complaint::Complaint;
use crate::frames::{FrameId, FrameTree};
use crate::layout::{Layout, Motion};
use crate::solve::PlanError;

/// A measurement at a configuration that the robot's file does not have.
pub(super) fn no_motion(layout: &Layout, error: &PlanError) -> Complaint {
    let PlanError::NoMotion { robot, .. } = error;
    let file = layout.robots.iter().find(|known| known.name == *robot).map(|robot| match &robot.motion {
        Motion::Joints { file, .. } | Motion::FlangePoses { file } => layout.recording.join(file),
    });
    Complaint::of(
        file.as_deref().unwrap_or(&layout.file),
        error.to_string(),
        "add the line, or remove the measurements of that configuration",
    )
}

/// Which pieces the cell is in, and what would join them.
pub(super) fn in_pieces(layout: &Layout, tree: &FrameTree, floating: &[(FrameId, Vec<FrameId>)]) -> Complaint {
    let name = |frame: FrameId| if frame == 0 { layout.world.clone() } else { tree.frames[frame].name.clone() };
    let quoted = |frames: &[FrameId]| frames.iter().map(|f| format!("`{}`", name(*f))).collect::<Vec<_>>().join(", ");
    let mut words = Vec::new();
    let mut remedies = Vec::new();
    for (body, frames) in floating {
        words.push(format!(
            "{} {} not tied to `{}`",
            quoted(frames),
            if frames.len() == 1 { "is" } else { "are" },
            name(*body)
        ));
        let first = name(frames[0]);
        let camera = frames.iter().find(|frame| tree.cameras.contains(frame));
        let helper = match camera {
            Some(camera) => format!("let `{}` see something that is tied to `{}`", name(*camera), name(*body)),
            None => format!("let something that is tied to `{}` see `{first}`", name(*body)),
        };
        remedies.push(format!("{helper}, or give `{first}` a pose"));
    }
    let pieces = floating.len() + 1;
    let count = if pieces == 2 { "two".to_owned() } else { pieces.to_string() };
    Complaint::of(&layout.file, format!("the cell is in {count} pieces: {}", words.join("; ")), remedies.join("; "))
}
