//! From a YAML layout to a checked model of the cell.
//!
//! Everything a layout can get wrong is found here, before any picture is opened, and all of it at once: each complaint names file,
//! line, reason and remedy. What comes out ([`Layout`]) is in metres and radians and needs no further checks.

pub mod builtin;
mod cameras;
mod document;
pub mod fields;
pub mod images;
pub mod model;
mod names;
mod paths;
pub(crate) mod poses;
mod read;
mod robots;
pub mod simulate;
mod tags;
mod targets;
pub mod write;
pub mod yaml;

pub use cameras::parse_intrinsics;
pub use document::Document;
pub use model::*;
pub use paths::Paths;
pub use read::{parse_layout, plain, read_layout};
pub use robots::parse_model;
pub use tags::{TagPlaces, parse_target};
