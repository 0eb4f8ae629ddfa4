//! tour comes later
pub mod complaint;
pub mod detect;
pub mod export;
pub mod frames;
pub mod geometry;
pub mod identify;
pub mod initialise;
pub mod layout;
pub mod recording;
pub mod robot;
pub mod simulate;
pub mod solve;
pub mod trust;
pub mod workflow;

/// The version of this program.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");
