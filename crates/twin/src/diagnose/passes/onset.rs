//! Onset test: onsets that were called for only while another effect was missing are dropped.

use crate::diagnose::strategies::onset::ONSET_GAIN;
use crate::estimation::problem::Problem;
use crate::estimation::settle::move_to;
use crate::predict::PredictError;

/// Drops onsets that were called for only while another effect was missing.
pub(crate) fn doubt_onsets(problem: &mut Problem) -> Result<(), PredictError> {
    for place in 0..problem.active.len() {
        if problem.active[place].onset_s.is_none() {
            continue;
        }
        let mut from_the_start = problem.active.clone();
        from_the_start[place].onset_s = None;
        let (with, without) = (problem.fit(&problem.active)?, problem.fit(&from_the_start)?);
        if with.log_evidence - without.log_evidence < ONSET_GAIN {
            move_to(problem, &without)?;
        }
    }
    Ok(())
}
