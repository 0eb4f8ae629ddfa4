//! Recordings with known truth: a layout whose poses are all known becomes corners and pictures.
//!
//! Nothing here is used to solve; it exists so that every claim about accuracy can be checked, and so that a newcomer has something to run.

pub mod bodies;
mod cell;
mod corners;
pub mod demo;
pub mod paper_size;
mod picture;
pub mod render;

pub use cell::Cell;
pub use corners::{CornerNoise, corners};
pub use picture::{PictureNoise, Plate, plates, png, render};
