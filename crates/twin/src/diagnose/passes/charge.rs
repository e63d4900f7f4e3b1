//! Charge search: the charge at the start is looked for again once all is named.

use crate::diagnose::strategies::battery::elsewhere;
use crate::estimation::problem::Problem;
use crate::estimation::settle::move_to;
use crate::predict::PredictError;

/// Gain of ln evidence for which the charge moves once all is named.
const LEAST_GAIN_AGAIN: f64 = 1.0;

/// Moves to where a search over all charges finds a clearly better fit. Returns true if there is one.
pub(crate) fn look_again(problem: &mut Problem) -> Result<bool, PredictError> {
    let Some(there) = elsewhere(problem)? else {
        return Ok(false);
    };
    let better = there.log_evidence > problem.fit(&problem.active)?.log_evidence + LEAST_GAIN_AGAIN;
    if better {
        move_to(problem, &there)?;
    }
    Ok(better)
}
