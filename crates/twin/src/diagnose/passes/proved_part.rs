//! Proved part: where an error on unseen blocks rises with all that was named, those effects stay with which none rises and one falls.
//!
//! Selection goes by evidence on all blocks. On a real vehicle much stays unexplained, and an effect that is taken for a piece of it may make
//! another quantity worse than before (a torque, where the force became better). That speaks against this effect, not against the others.

use super::Pass;
use super::goodness::GoodnessOfFit;
use super::held_out::{errors, rises_from_to};
use crate::diagnose::named::Named;
use crate::diagnose::state::State;
use crate::estimation::columns::Active;
use crate::estimation::problem::Problem;
use crate::estimation::settle::{move_to, settled};
use crate::estimation::unseen::HeldOutError;
use crate::predict::PredictError;

pub(crate) struct ProvedPart;

impl Pass for ProvedPart {
    fn name(&self) -> &'static str {
        "Proved part"
    }

    fn searches(&self) -> bool {
        true
    }

    fn run(&self, state: &mut State<'_>) -> Result<(), PredictError> {
        // Beside a guess of a constant that is wrong an error may rise with the right value; and what gusts leave has no blocks of its own.
        if state.problem.active.len() < 2 || state.weather.is_some() || has_constants(&state.problem) {
            return Ok(());
        }
        let whole = errors(&state.problem, &state.plain)?;
        let Some(risen) = whole.iter().find(|error| error.rises()).cloned() else {
            return Ok(());
        };
        let mut now = state.problem.clone();
        while now.active.len() > 1 {
            // Of each trial the score alone is kept: the columns of a problem are large.
            let mut best: Option<(usize, f64)> = None;
            for place in (0..now.active.len()).filter(|&place| !is_needed(&now, place)) {
                if state.time_is_up() {
                    return Ok(());
                }
                let score = score(&errors(&without(&now, place)?, &state.plain)?);
                if best.is_none_or(|(_, known)| score > known) {
                    best = Some((place, score));
                }
            }
            let Some((place, _)) = best else { return Ok(()) };
            now = without(&now, place)?;
            let found = errors(&now, &state.plain)?;
            if !found.iter().any(HeldOutError::rises) && found.iter().any(HeldOutError::falls) {
                take(state, now, &risen);
                return GoodnessOfFit.run(state);
            }
        }
        Ok(())
    }
}

/// True if the error of a constant that was guessed, or that is off by factors, is among what was named.
fn has_constants(problem: &Problem) -> bool {
    problem.active.iter().any(|one| {
        let entry = &problem.library.candidates[one.candidate];
        entry.guess.is_some() || entry.is_far_off(&one.values)
    })
}

/// True if another effect does nothing without the one at a place.
fn is_needed(problem: &Problem, place: usize) -> bool {
    let id = |one: &Active| problem.library.candidates[one.candidate].declaration.id;
    let own = id(&problem.active[place]);
    problem.active.iter().enumerate().any(|(other, one)| {
        other != place
            && problem.library.candidates[one.candidate]
                .declaration
                .needs
                .contains(&own)
    })
}

/// The fit without the effect at a place.
fn without(problem: &Problem, place: usize) -> Result<Problem, PredictError> {
    let mut others = problem.active.clone();
    others.remove(place);
    let mut rest = problem.clone();
    let fitted = rest.fit(&others)?;
    move_to(&mut rest, &fitted)?;
    settled(&mut rest)?;
    Ok(rest)
}

/// Sum of the explained shares; what makes an error larger than it was counts in full.
fn score(errors: &[HeldOutError]) -> f64 {
    errors.iter().map(HeldOutError::explained_share).sum()
}

/// Goes on with a part of what was named, and says what was left out.
fn take(state: &mut State<'_>, part: Problem, risen: &HeldOutError) {
    let stays = |one: &Named| part.active.iter().any(|active| active.candidate == one.candidate);
    let gone = state.named.iter().filter(|one| !stays(one));
    let labels: Vec<String> = gone
        .map(|one| part.library.candidates[one.candidate].label().to_lowercase())
        .collect();
    state.set_aside = labels;
    state.diagnosis.notes.push(format!(
        "not believed: {}; {}",
        state.set_aside.join(", "),
        rises_from_to(risen)
    ));
    state.named.retain(stays);
    state.problem = part;
}
