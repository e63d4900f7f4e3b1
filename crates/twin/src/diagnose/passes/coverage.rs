//! Coverage: which effects could not be considered, and what would make them testable.

use super::Pass;
use crate::diagnose::considered::not_considered;
use crate::diagnose::state::State;
use crate::predict::PredictError;

pub(crate) struct Coverage;

impl Pass for Coverage {
    fn name(&self) -> &'static str {
        "Coverage"
    }

    fn run(&self, state: &mut State<'_>) -> Result<(), PredictError> {
        let diagnosis = &mut state.diagnosis;
        diagnosis.not_considered = not_considered(&state.problem, diagnosis);
        // Another manoeuvre does not help where a column is missing.
        let missing = &diagnosis.not_considered;
        let lacks = |effect: &str| {
            missing
                .iter()
                .any(|one| one.effect == effect && !one.columns.is_empty())
        };
        diagnosis.not_testable.retain(|row| !lacks(&row.effect));
        diagnosis.ranking.retain(|row| !lacks(&row.effect));
        Ok(())
    }
}
