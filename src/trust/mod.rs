//! How far an answer can be trusted: residuals, standard deviations, and the directions that nothing determines.

pub mod covariance;
pub mod outliers;
pub mod residuals;
pub mod undetermined;

pub use covariance::{Covariance, covariance};
pub use residuals::{Residuals, residuals};
pub use undetermined::{Undetermined, explain};
