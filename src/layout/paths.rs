//! How a layout that is written names files, so that it can be loaded from the folder it stands in.

use std::path::Path;

use super::document::Document;

/// How a layout names files so that it can be loaded from its own folder.
#[derive(Debug)]
pub struct Paths<'a> {
    recording: &'a Path,
    layout_folder: &'a Path,
    /// Whether the names keep their meaning: the layout will stand in the recording, or the files will come along.
    at_home: bool,
}

impl<'a> Paths<'a> {
    /// For a layout that is written into `folder` while its files stay where they are.
    #[must_use]
    pub fn new(layout: &'a super::Layout, folder: &Path) -> Self {
        let same = |a: &Path, b: &Path| matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b);
        let layout_folder = layout.file.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        Self { recording: &layout.recording, layout_folder, at_home: same(&layout.recording, folder) }
    }

    /// A file of the recording.
    pub(super) fn data(&self, file: &str) -> Document {
        if self.at_home { Document::text(file) } else { Self::absolute(&self.recording.join(file)) }
    }

    /// A robot, target or lens file: in the recording or beside the layout.
    pub(super) fn description(&self, file: &str) -> Document {
        if self.recording.join(file).exists() {
            self.data(file)
        } else {
            Self::absolute(&self.layout_folder.join(file))
        }
    }

    fn absolute(path: &Path) -> Document {
        // A pattern of pictures is no file that exists: its folder is made absolute, not it.
        let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        Document::text(absolute.display().to_string())
    }
}
