//! Backward elimination: removes effects that later findings have made superfluous, those without which unseen blocks
//! are predicted as well, and those of an impossible size that show where no other effect does.

use super::Pass;
use super::held_out::unproved;
use crate::diagnose::findings;
use crate::diagnose::state::State;
use crate::diagnose::words::in_sentence;
use crate::estimation::columns::Active;
use crate::estimation::gauss_newton::Fitted;
use crate::estimation::posterior::posterior_of;
use crate::estimation::problem::{Problem, position_of};
use crate::estimation::scores::{score, weakest};
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
        while let Some((candidate, fitted)) = unproved(&state.problem)? {
            let label = in_sentence(&state.problem.library.candidates[candidate].label());
            state.named.retain(|one| one.candidate != candidate);
            move_to(&mut state.problem, &fitted)?;
            let (posterior, _) = settled(&mut state.problem)?;
            // The evidence for it is left unexplained.
            let first = score(&state.problem, &posterior).into_iter().next();
            state.left = first.map_or(0.0, |best| best.opened.log_bayes_factor);
            state.diagnosis.notes.push(format!(
                "rejected: {label}, without which the blocks that a fit has not seen are predicted as well"
            ));
        }
        while let Some((candidate, channels)) = impossible(&state.problem)? {
            let label = in_sentence(&state.problem.library.candidates[candidate].label());
            let mut others = state.problem.active.clone();
            others.retain(|one| one.candidate != candidate);
            let fitted = state.problem.fit(&others)?;
            state.named.retain(|one| one.candidate != candidate);
            move_to(&mut state.problem, &fitted)?;
            settled(&mut state.problem)?;
            state.diagnosis.notes.push(format!(
                "rejected: {label}, of an impossible size; the channels it was found in ({}) stay unexplained",
                channels.join(", ")
            ));
        }
        Ok(())
    }
}

/// An effect of a size that cannot be, with the channels in which it shows, if it shows most where none of the others do: it says nothing
/// against those. One that shares its channel with others stays, and is a doubt about all of them. One that is known by approximation only
/// leaves in any case: its own error is the nearest reason for such a size.
fn impossible(problem: &Problem) -> Result<Option<(usize, Vec<String>)>, PredictError> {
    let is_approximate = |one: &Active| problem.library.candidates[one.candidate].declaration.search.blur > 0.0;
    if problem.active.len() < 2 && !problem.active.iter().any(is_approximate) {
        return Ok(None);
    }
    let (posterior, _) = posterior_of(problem)?;
    let position = position_of(&problem.library, &problem.logs, &problem.active);
    let shown = |candidate: usize| findings::strongest(problem, candidate, &position);
    Ok(problem.active.iter().find_map(|one| {
        let entry = &problem.library.candidates[one.candidate];
        let (values, deviations) = findings::values_of(problem, one, &posterior);
        if problem.library.columns_of(one.candidate).is_empty()
            || findings::can_be(entry, &values, &deviations, one.onset_s)
        {
            return None;
        }
        let channels = shown(one.candidate);
        let most = channels.first()?;
        let apart = problem
            .active
            .iter()
            .filter(|other| other.candidate != one.candidate)
            .all(|other| !shown(other.candidate).contains(most));
        (apart || is_approximate(one)).then_some((one.candidate, channels))
    }))
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
