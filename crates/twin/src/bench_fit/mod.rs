//! Bench measurements to vehicle constants: thrust over duty and voltage, battery, motor lag.
//!
//! ```text
//!  CSV of a test stand or log ─▶ table::Table (roles, units) ─▶ thrust | battery | lag ─▶ Fit (rivals, intervals) ─▶ report, vehicle file
//! ```
//! Every fit has rivals: the same data under several structures, ranked by AICc and by the error on points that the fit did not see.
//! Intervals are 95 %: from the Gauss–Newton covariance where residuals look white, from a block bootstrap where they do not.
//! Limits: ordinary least squares, so outliers count in full; a parameter that the data cannot determine is reported as
//! such, not guessed.

pub mod battery;
pub mod fit;
pub mod lag;
pub mod report;

pub mod table;
pub mod thrust;
pub mod write;

pub use fit::{Fit, FittedModel, FittedParameter};
pub use table::{Mapping, Table};

/// A rejection in one sentence: what, where, what was expected.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FitError(pub String);

impl std::fmt::Display for FitError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for FitError {}

pub(crate) fn refuse<T>(sentence: impl Into<String>) -> Result<T, FitError> {
    Err(FitError(sentence.into()))
}
