//! The commands as functions: a layout in, a result out, nothing printed.
//!
//! Programs that use the library start here; the binary does nothing else than call these and show what they return.

pub mod between;
pub mod check;
pub mod compare;
pub mod demo;
pub mod detect;
pub mod diagnose;
mod dictionary;
mod explanations;
mod follow;
pub mod identify;
mod journal;
mod localise;
mod look;
pub(crate) mod measured;
pub mod memory;
mod neighbour;
pub mod new;
pub(crate) mod place;
pub mod predict;
pub mod published;
mod refusals;
mod repair;
mod robust;
pub mod simulate;
pub mod solve;
pub mod solved_layout;
pub mod streamed;
pub mod validate;
