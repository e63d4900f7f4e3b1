//! The posterior of a problem about its present point.

use super::normal::{Normal, Posterior, not_finite};
use super::problem::{Problem, position_of};
use crate::predict::PredictError;

/// Posterior about the present point, as a step from it, with the prior's pull.
pub(crate) fn posterior_of(problem: &Problem) -> Result<(Posterior, Vec<f64>), PredictError> {
    let prior = problem.deviations(&problem.active);
    pulled(problem, problem.normal(|_| true), &prior)
        .map(|p| (p, prior))
        .ok_or_else(not_finite)
}

/// Posterior of a normal matrix about the present point: the priors pull towards 0, not towards that point.
pub(crate) fn pulled(problem: &Problem, normal: Normal, prior: &[f64]) -> Option<Posterior> {
    let position = position_of(&problem.library, &problem.logs, &problem.active);
    Posterior::new(&normal.pulled(&position, prior), prior)
}
