//! Estimation: parameters of effects and nuisances of flights from whitened residuals.
//!
//! ```text
//! candidates ─▶ columns, gram ─▶ linearisation ─▶ normal equations ─▶ posterior, scores
//!                     │               │                                  │
//!                     │               └──────────▶ gauss_newton ◀────────┘ settle: until the point stands
//!                     └─▶ least_squares (priors, bounds, damping, pivots, covariance) ◀─ nuisances
//!                              ▲ refits of a model, bench fits, trims against healthy flights
//! ```
//! `least_squares` is the iteration of small fits; `gauss_newton` that of effects together with the clutter of the
//! whole library, whose steps are judged by their evidence. For modules with iterations of their own, and the reasons,
//! see docs/decisions/0047.

pub(crate) mod candidates;
pub(crate) mod clutter;
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
pub mod unseen;
pub(crate) mod whiteness;
