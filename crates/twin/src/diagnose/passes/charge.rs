//! Charge search: the charge at the start is searched for again once all effects are named.

use super::Pass;
use crate::diagnose::state::State;
use crate::diagnose::strategies::battery::elsewhere;
use crate::estimation::problem::Problem;
use crate::estimation::scores::score;
use crate::estimation::settle::{move_to, settled};
use crate::predict::PredictError;

/// Gain of ln evidence for which the charge moves once all is named.
const LEAST_GAIN_AGAIN: f64 = 1.0;

pub(crate) struct ChargeSearch;

impl Pass for ChargeSearch {
    fn name(&self) -> &'static str {
        "Charge search"
    }

    fn searches(&self) -> bool {
        true
    }

    fn run(&self, state: &mut State<'_>) -> Result<(), PredictError> {
        let moved = look_again(&mut state.problem)?;
        let (posterior, _) = settled(&mut state.problem)?;
        if moved {
            // What was left may have been the charge.
            state.left = score(&state.problem, &posterior)
                .first()
                .map_or(0.0, |s| s.opened.log_bayes_factor);
        }
        Ok(())
    }
}

/// Moves to where a search over all charges finds a clearly better fit. Returns true if there is one.
fn look_again(problem: &mut Problem) -> Result<bool, PredictError> {
    let Some(there) = elsewhere(problem)? else {
        return Ok(false);
    };
    let better = there.log_evidence > problem.fit(&problem.active)?.log_evidence + LEAST_GAIN_AGAIN;
    if better {
        move_to(problem, &there)?;
    }
    Ok(better)
}
