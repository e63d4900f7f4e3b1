//! Forward selection: round by round everything is linearised and ranked, the leading candidates are fitted, and the best is named, until
//! none passes.

use super::Pass;
use super::gusts::gusts_lead;
use super::refinement::{LEFT_FACTOR, best_of};
use crate::diagnose::ranking::{detectable, table};
use crate::diagnose::state::State;
use crate::diagnose::strategies::trials::{Trials, trials};
use crate::estimation::scores::score;
use crate::estimation::settle::{settled, trust};
use crate::estimation::whiteness::fits;
use crate::predict::PredictError;

/// Share of the search that is behind it when the first round begins, and that of all rounds.
const BEGINS: f64 = 0.05;
const ROUNDS: f64 = 0.9;
/// Share of all rounds that is spent on linearising.
const LINEARISING: f64 = 0.6;

pub(crate) struct ForwardSelection;

impl Pass for ForwardSelection {
    fn name(&self) -> &'static str {
        "Forward selection"
    }

    fn run(&self, state: &mut State<'_>) -> Result<(), PredictError> {
        let mut looked_again = false;
        let mut to_rank = true;
        for round in 0..=most_effects(state) {
            // The first round ranks what an answer consists of; the others begin only while there is time.
            if round > 0 && state.time_is_up() {
                return Ok(());
            }
            match next(state, round, std::mem::take(&mut to_rank))? {
                Round::Named => {}
                Round::Nothing => return Ok(()),
                Round::Unconfirmed if state.left < LEFT_FACTOR * state.threshold || looked_again => return Ok(()),
                Round::Unconfirmed => {
                    // A candidate of the ranking that no fit confirms may come from a charge on the wrong side of a
                    // kink in the battery's curve.
                    looked_again = true;
                    to_rank = round == 0;
                    let fitted = state.problem.fit(&state.problem.active)?;
                    state.problem.accept(&fitted);
                }
            }
        }
        Ok(())
    }
}

/// Number of effects to look for; one that turns out to be a guessed constant leaves room for another.
fn most_effects(state: &State<'_>) -> usize {
    state.options.most_effects + state.problem.library.guesses()
}

/// How a round ended.
enum Round {
    /// With another effect.
    Named,
    /// There is no further effect to look for: the requested number is named, or gusts explain the rest.
    Nothing,
    /// No fit confirmed the ranking's candidates.
    Unconfirmed,
}

/// One round about the present point; with `rank` its tables go into the diagnosis.
fn next(state: &mut State<'_>, round: usize, rank: bool) -> Result<Round, PredictError> {
    let (options, threshold) = (state.options, state.threshold);
    let last = most_effects(state);
    let rounds = (last + 1) as f64;
    let done = BEGINS + ROUNDS * round as f64 / rounds;
    let text = if round == 0 {
        "sensitivities of the library"
    } else {
        "looking for a further effect"
    };
    (options.progress)(text, done);
    let per = LINEARISING / rounds;
    state
        .problem
        .linearise(&|share| (options.progress)(text, done + per * share))?;
    trust(&mut state.problem);
    let posterior = settled(&mut state.problem)?.0;
    if state.before.is_empty() {
        state.before = fits(&state.problem, &posterior.mean);
    }
    let scored = score(&state.problem, &posterior);
    let special = if round < last {
        trials(&state.problem, &posterior, threshold)
    } else {
        Trials::default()
    };
    state.left = scored.first().map_or(0.0, |s| s.opened.log_bayes_factor);
    if rank {
        let diagnosis = &mut state.diagnosis;
        diagnosis.ranking = table(&state.problem, &scored)?;
        (diagnosis.not_testable, diagnosis.detectable) =
            detectable(&state.problem, &scored, &special.worst_minimum, threshold);
    }
    if round == 0 {
        state.diagnosis.timing.ranked_s = (options.clock)() - state.began_s;
    }
    if round == last || gusts_lead(&mut state.problem, &posterior, &scored, threshold)? {
        return Ok(Round::Nothing);
    }
    if state.time_is_up() {
        return Ok(Round::Nothing);
    }
    (options.progress)("refining the leading candidates", done + per);
    let Some((fitted, found)) = best_of(&state.problem, &posterior, &scored, &special, threshold)? else {
        return Ok(Round::Unconfirmed);
    };
    state.problem.accept(&fitted);
    state.named.extend(found);
    Ok(Round::Named)
}
