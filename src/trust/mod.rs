//! How far an answer can be trusted: residuals, standard deviations, and the directions that nothing determines.

pub mod covariance;
pub mod outliers;
pub mod residuals;
mod span;
pub mod structure;
pub mod undetermined;

pub use covariance::{Covariance, covariance};
pub use residuals::{Residuals, residuals};
pub use structure::Cause;
pub use undetermined::{Evidence, Undetermined, explain};
