//! Maps a robotic workcell from camera pictures and joint values.
//!
//! A cell is a tree of frames: robots, cameras, targets, each mounted on something. A YAML layout says what there is, a recording
//! what was seen, and one joint least-squares problem finds where everything is and how far each number can be trusted.
//!
//! # Conventions
//! - `a_from_b` is the rigid transform with `p_a = a_from_b * p_b`; names cancel when composed.
//! - Metres, radians and pixels everywhere inside; files state their units.
//! - The centre of the top-left pixel is (0, 0). A camera looks along z, x to the right, y down.
//! - Transforms are perturbed on the right, `T * Exp(d)` with `d = (translation, rotation)`.
//!
//! # The tour
//! Data flows one way, and a folder knows only those above it in this list:
//! [`geometry`] (transforms, lenses, targets), [`robot`] (chains), [`layout`] (YAML to a checked model), [`recording`] (CSV files),
//! [`frames`] (who hangs on what), [`detect`] (pixels to corners), [`initialise`] (no guess needed), [`mod@solve`] (the least squares), [`trust`]
//! (what is certain), [`identify`] (the published method), [`simulate`] (truth to test against), [`workflow`] (the commands as functions),
//! [`export`] (what others read), [`mod@print`] (targets on paper), [`report`] (what people look at), [`schema`]
//! (every key, for editors and the book).
//!
//! # Example
//! Two poses and a point:
//! ```
//! use cellmap::geometry::Pose;
//! use nalgebra::Vector3;
//!
//! let world_from_base = Pose::from_translation(1.0, 0.0, 0.0);
//! let base_from_flange = Pose::from_rotation_vector(&Vector3::new(0.0, 0.0, std::f64::consts::FRAC_PI_2));
//! let world_from_flange = world_from_base * base_from_flange;
//! let tip_in_world = world_from_flange * Vector3::new(0.1, 0.0, 0.0);
//! assert!((tip_in_world - Vector3::new(1.0, 0.1, 0.0)).norm() < 1e-12);
//! ```
//! A whole cell, from files to poses:
//! ```no_run
//! use cellmap::layout::read_layout;
//! use cellmap::workflow::solve::{SolveRequest, solve};
//!
//! let layout = read_layout("cell.yaml".as_ref(), None)?;
//! let solved = solve(layout, &SolveRequest::default())?;
//! println!("{:?}", solved.world_from("ur3.base"));
//! # Ok::<(), cellmap::complaint::InputError>(())
//! ```

#![warn(missing_docs)]
// Module essays point to the files that hold the details, public or not.
#![allow(rustdoc::private_intra_doc_links)]
#![cfg_attr(
    not(test),
    warn(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, clippy::print_stderr)
)]

pub mod complaint;
pub mod detect;
pub mod export;
pub mod frames;
pub mod geometry;
pub mod identify;
pub mod initialise;
pub mod layout;
pub mod print;
pub mod recording;
pub mod report;
pub mod robot;
pub mod schema;
pub mod simulate;
pub mod solve;
pub mod trust;
pub mod workflow;

/// The version of this program.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");
