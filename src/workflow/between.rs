//! `solve --between A B`: the pose between two frames of a solved cell, with its standard deviations.

use super::diagnose::{block_poses, evidence};
use super::solve::Solved;
use crate::complaint::{Complaint, InputError, nearest};
use crate::frames::{FrameId, Step};
use crate::recording::Recording;
use crate::trust::between::{Relative, relative};

/// Two frames and what lies between them.
#[derive(Clone, Debug, PartialEq)]
pub struct Between {
    /// In whose axes.
    pub from: String,
    /// Whose pose.
    pub to: String,
    /// The configuration at which a pair that moves against each other was taken; none for one that stands still.
    pub configuration: Option<u64>,
    /// The pose and its uncertainty.
    pub found: Relative,
}

/// The pose of frame `to` in frame `from`. Where a robot or a moving target lies between, at configuration `at`, by default the first at which everything
/// between was recorded and found.
///
/// # Errors
/// A frame that is not there; a configuration at which something between is not known.
pub fn between(
    solved: &Solved,
    recording: &Recording,
    from: &str,
    to: &str,
    at: Option<u64>,
) -> Result<Between, InputError> {
    let (a, b) = (frame(solved, from)?, frame(solved, to)?);
    let path = solved.tree.path(a, b);
    let known = |configuration: usize| {
        path.steps.iter().all(|step| match *step {
            Step::Static { .. } => true,
            Step::Moving { edge, .. } => solved.moved.get(edge).is_some_and(|found| found.contains(&configuration)),
            Step::Robot { robot, .. } => recording.motions[robot].knows(solved.plan.configurations[configuration]),
        })
    };
    let fine: Vec<usize> = (0..solved.plan.configurations.len()).filter(|c| known(*c)).collect();
    let chosen = match at {
        Some(id) if !path.is_static() => fine.iter().copied().find(|c| solved.plan.configurations[*c] == id),
        _ => fine.first().copied(),
    };
    let Some(configuration) = chosen else {
        let when = at.map_or_else(|| "at no configuration".to_owned(), |id| format!("not at configuration {id}"));
        return Err(Complaint::of(
            &solved.layout.file,
            format!("what lies between `{from}` and `{to}` is known {when}"),
            "give a configuration at which every robot and moving target between them was recorded, with `--at N`",
        )
        .into());
    };
    let poses = block_poses(solved, recording);
    let found = relative(&evidence(solved, recording, &poses), &solved.covariance, a, b, configuration);
    let moves = !path.is_static();
    Ok(Between {
        from: from.to_owned(),
        to: to.to_owned(),
        configuration: moves.then(|| solved.plan.configurations[configuration]),
        found,
    })
}

fn frame(solved: &Solved, name: &str) -> Result<FrameId, Complaint> {
    let frames = &solved.tree.frames;
    // The root goes by the layout's own word for it.
    let found = frames.iter().skip(1).position(|frame| frame.name == name).map(|place| place + 1);
    let root = name == "world" || name == solved.layout.world;
    found.or(root.then_some(0)).ok_or_else(|| {
        let remedy = match nearest(name, frames.iter().map(|frame| frame.name.as_str())) {
            Some(meant) => format!("did you mean `{meant}`?"),
            None => "`cellmap check` lists the frames".to_owned(),
        };
        Complaint::of(&solved.layout.file, format!("there is no frame `{name}`"), remedy)
    })
}
