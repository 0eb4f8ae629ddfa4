//! The joint least-squares problem: one path formula for every kind of measurement, condensed before it is expanded.
//!
//! All corners of one target seen at one configuration by one camera act on the unknowns only through the twist of `camera_from_target` and
//! that camera's lens. So each such *block* first becomes one small symmetric matrix over (twist, lens, residual), straight from the corners
//! (`corners`, a register of points at a time; [`kernels`] for the other kinds), and is then expanded once through the chain Jacobian of its path ([`assemble`]). This equals Gauss-Newton on all corners exactly,
//! also under robust weights, and is why a cell of 7500 pictures solves in a fraction of a second.
//!
//! The layout and the recording are compiled once ([`Plan`]); the loop that follows knows only indices. The same bits come out on any
//! number of threads: work is cut by data, results are folded in the order of the data.

mod approach;
pub mod assemble;
mod chain;
mod chunk;
mod corners;
mod cut;
mod dense;
mod equations;
mod expand;
mod gather;
pub mod kernels;
mod lanes;
mod lens_lanes;
mod lines;
mod local;
mod loss;
mod mean;
mod measurements;
mod minimise;
mod normal;
mod pack;
pub mod passes;
mod pattern;
mod plan;
mod prior;
mod refined;
mod report;
mod robots;
mod robust_lanes;
mod share;
mod sparse;
mod state;
mod step;
mod system;
pub mod terms;
mod thinned;
mod unknowns;

pub use assemble::{Assembler, Normal};
pub use equations::Solver;
pub use loss::Loss;
pub use measurements::{Contact, Measurements};
pub use minimise::minimise;
pub(crate) use pattern::Pattern;
pub use plan::{Block, Group, GroupKind, Plan, PlanError, Stop};
pub use prior::Priors;
pub use report::{Options, Report, Seconds, Termination};
pub(crate) use sparse::{Factor, Symbolic};
pub use state::State;
pub use unknowns::{Unknown, UnknownKind, Unknowns};
