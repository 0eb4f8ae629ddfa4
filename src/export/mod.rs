//! What other programs read: the solution as YAML and JSON.

pub mod findings;
pub mod solution;

pub use crate::layout::Document;
