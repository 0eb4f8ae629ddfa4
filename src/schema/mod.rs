//! What may stand in a layout, in a robot file and in a target file: one table of keys.
//!
//! From [`keys::SECTIONS`] come the JSON Schema for editors ([`json_schema`]) and the key page of the book ([`markdown`]). A test asks the parser which keys it
//! knows in every section and holds the table to the answer, so that neither can say what the program does not read.

mod json;
pub mod keys;
mod page;

pub use json::json_schema;
pub use keys::{Key, Kind, SECTIONS, Section};
pub use page::markdown;

/// A kind of file that a schema describes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum File {
    /// A layout, or a solution.
    Layout,
    /// A robot model file.
    Robot,
    /// A target file.
    Target,
    /// A file of intrinsics.
    Intrinsics,
}

impl File {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Layout, Self::Robot, Self::Target, Self::Intrinsics];

    /// Its name, which is that of its section.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Layout => "layout",
            Self::Robot => "robot_file",
            Self::Target => "target_file",
            Self::Intrinsics => "intrinsics",
        }
    }
}
