//! What other programs read: the solution as YAML and JSON, and the cell in the formats of others.

pub mod covariance;
pub mod findings;
pub mod formats;
pub mod solution;

pub use crate::layout::Document;
