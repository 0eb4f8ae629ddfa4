//! Recordings with known truth: a layout whose poses are all known becomes measurements and pictures.
//!
//! Nothing here is used to solve; it exists so that every claim about accuracy can be checked, and so that a newcomer has something to run.
//!
//! Data flows one way: [`paths`] drives the robots (keeping their [`bodies`] out of each other's way), [`record`] asks the true [`Cell`] where
//! everything is and makes measurements of it, [`faults`] spoils some of them, and `picture` draws what the cameras saw. [`knowledge`] splits the
//! layout into what is true and what a solver is told.

pub mod bodies;
mod cell;
mod corners;
pub mod faults;
pub mod knowledge;
mod moving;
pub mod obstacles;
mod others;
pub mod paper_size;
pub mod paths;
mod picture;
pub mod random;
pub mod record;
pub mod render;
mod visible;

pub use cell::{Cell, Disturbances};
pub use corners::{CornerNoise, corners};
pub use picture::{PictureNoise, Plate, plates, png, render};
pub use record::{Simulated, simulate};
