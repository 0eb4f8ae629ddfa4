//! Giving the files of a layout names inside one folder, so that a recording can be carried away whole.

use std::path::{Component, Path, PathBuf};

use crate::layout::{Description, Layout, ModelSource, Motion};

/// A file that comes along.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Copied {
    /// Where it is.
    pub from: PathBuf,
    /// What it is called in the folder.
    pub name: String,
}

/// Renames what a layout names so that every name is one inside the layout's folder, and returns the robot and target files to copy. With `pictures` a
/// camera that has a lens but no pictures gets a pattern for them.
pub fn localise(layout: &mut Layout, pictures: bool) -> Vec<Copied> {
    let beside = layout.file.parent().unwrap_or(Path::new("")).to_owned();
    let recording = layout.recording.clone();
    let mut copied: Vec<Copied> = Vec::new();
    let mut bring = |file: &mut String| {
        let from = Some(recording.join(&*file)).filter(|path| path.exists()).unwrap_or_else(|| beside.join(&*file));
        *file = inside(file);
        let copy = Copied { from, name: file.clone() };
        if !copied.contains(&copy) {
            copied.push(copy);
        }
    };
    for robot in &mut layout.robots {
        match &mut robot.model_source {
            ModelSource::Mdh(file) | ModelSource::Dh(file) | ModelSource::Urdf(file, ..) => bring(file),
            ModelSource::BuiltIn(_) | ModelSource::Reported => {}
        }
        match &mut robot.motion {
            Motion::Joints { file, .. } | Motion::FlangePoses { file } => *file = inside(file),
        }
    }
    for target in &mut layout.targets {
        let Description::Mapping(entries) = &mut target.description else { continue };
        for (_, words) in entries.iter_mut().filter(|(key, _)| key == "tags") {
            let Description::Mapping(inner) = words else { continue };
            for (_, value) in inner.iter_mut().filter(|(key, _)| key == "file") {
                if let Description::Scalar { text, .. } = value {
                    bring(text);
                }
            }
        }
    }
    for camera in &mut layout.cameras {
        let default = || format!("images/{}/{{configuration:04}}_{{shot:02}}.png", camera.name);
        camera.images = match camera.images.take() {
            Some(images) if inside(&images) == images => Some(images),
            Some(_) => Some(default()),
            None => (pictures && camera.intrinsics.is_some()).then(default),
        };
    }
    copied
}

/// A relative name without `..`; the bare file name of any other.
fn inside(file: &str) -> String {
    let path = Path::new(file);
    if path.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir)) {
        return file.to_owned();
    }
    path.file_name().map_or_else(|| file.to_owned(), |name| name.to_string_lossy().into_owned())
}
