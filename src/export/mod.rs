//! What other programs read: the solution as YAML and JSON.

pub mod document;
pub mod solution;

pub use document::Document;
