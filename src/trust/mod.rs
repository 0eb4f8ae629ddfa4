//! How far an answer can be trusted: residuals, standard deviations, and the directions that nothing determines.

pub mod between;
pub mod covariance;
pub mod outliers;
pub mod residuals;
pub mod sandwich;
mod span;
pub mod structure;
pub mod undetermined;

pub use covariance::{Covariance, Source, covariance};
pub use residuals::{Residuals, residuals};
pub use structure::Cause;
pub use undetermined::{Evidence, Undetermined, explain};
