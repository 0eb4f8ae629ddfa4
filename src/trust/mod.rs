//! How far an answer can be trusted: residuals, standard deviations, and the directions that nothing determines.

pub mod between;
mod bordered;
pub mod changes;
pub mod covariance;
pub mod culprits;
pub mod fault;
mod flipped;
mod form;
mod influence;
mod inverse;
mod large;
mod lines;
pub mod outliers;
mod parts;
pub mod pieces;
pub mod residuals;
mod responses;
pub mod sandwich;
pub mod scale;
pub mod shifts;
pub mod sightings;
mod span;
pub mod structure;
pub mod systematic;
mod things;
pub mod undetermined;
mod weakest;

pub use covariance::{Covariance, Source, covariance};
pub use fault::{Action, Fault, FaultKind};
pub use residuals::{Residuals, residuals};
pub use scale::{Scale, scale_remarks, scales};
pub use structure::Cause;
pub use systematic::{Remark, systematic};
pub use undetermined::{Evidence, Undetermined, explain};
