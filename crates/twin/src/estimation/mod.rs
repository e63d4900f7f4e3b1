//! Estimation: parameters of effects and nuisances of flights from whitened residuals.
//!
//! ```text
//! candidates ─▶ columns, gram ─▶ linearisation ─▶ normal equations ─▶ posterior, scores
//!                                     │                                  │
//!                                     └──────────▶ gauss_newton ◀────────┘ settle: until the point stands
//! ```
//! All fits of the twin to flights are made of these.

pub(crate) mod candidates;
pub(crate) mod columns;
pub(crate) mod dense;
pub(crate) mod gauss_newton;
pub(crate) mod gram;
pub(crate) mod least_squares;
pub(crate) mod linearisation;
pub(crate) mod normal;
pub(crate) mod nuisances;
pub mod parameters;
pub(crate) mod posterior;
pub(crate) mod priors;
pub(crate) mod problem;
pub(crate) mod rate_noise;
pub(crate) mod scores;
pub(crate) mod settle;
pub(crate) mod whiteness;
