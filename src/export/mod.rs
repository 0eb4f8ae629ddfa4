//! What other programs read: the solution as YAML and JSON.

pub mod document;
pub mod findings;
mod paths;
pub mod solution;

pub use document::Document;
