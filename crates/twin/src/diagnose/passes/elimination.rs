//! Backward elimination: effects that later findings have made superfluous leave.

use super::Pass;
use crate::diagnose::state::State;
use crate::estimation::columns::Active;
use crate::estimation::gauss_newton::Fitted;
use crate::estimation::posterior::posterior_of;
use crate::estimation::problem::Problem;
use crate::estimation::scores::weakest;
use crate::estimation::settle::{move_to, settled};
use crate::predict::PredictError;

pub(crate) struct BackwardElimination;

impl Pass for BackwardElimination {
    fn name(&self) -> &'static str {
        "Backward elimination"
    }

    fn run(&self, state: &mut State<'_>) -> Result<(), PredictError> {
        while let Some(fitted) = superfluous(&state.problem, state.threshold)? {
            let stays = |candidate: usize| fitted.active.iter().any(|a| a.candidate == candidate);
            state.named.retain(|one| stays(one.candidate));
            move_to(&mut state.problem, &fitted)?;
            settled(&mut state.problem)?;
        }
        Ok(())
    }
}

/// The fit without an effect that a later finding has made superfluous, if there is one.
fn superfluous(problem: &Problem, threshold: f64) -> Result<Option<Fitted>, PredictError> {
    if problem.active.len() < 2 {
        return Ok(None);
    }
    let (posterior, prior) = posterior_of(problem)?;
    let Some((candidate, _)) = weakest(problem, &posterior, &prior, &[]).filter(|(_, evidence)| *evidence <= threshold)
    else {
        return Ok(None);
    };
    let others: Vec<Active> = problem
        .active
        .iter()
        .filter(|a| a.candidate != candidate)
        .cloned()
        .collect();
    let (with, without) = (problem.fit(&problem.active)?, problem.fit(&others)?);
    Ok((with.log_evidence - without.log_evidence < threshold).then_some(without))
}
