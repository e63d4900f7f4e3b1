//! Onset test: drops onsets that were needed only while another effect was missing.

use super::Pass;
use crate::diagnose::state::State;
use crate::diagnose::strategies::onset::least_gain;
use crate::estimation::problem::Problem;
use crate::estimation::settle::move_to;
use crate::predict::PredictError;

pub(crate) struct OnsetTest;

impl Pass for OnsetTest {
    fn name(&self) -> &'static str {
        "Onset test"
    }

    fn run(&self, state: &mut State<'_>) -> Result<(), PredictError> {
        // The onset of an effect alone was weighed when it was taken.
        if state.problem.active.len() < 2 {
            return Ok(());
        }
        doubt_onsets(&mut state.problem)
    }
}

fn doubt_onsets(problem: &mut Problem) -> Result<(), PredictError> {
    for place in 0..problem.active.len() {
        if problem.active[place].onset_s.is_none() {
            continue;
        }
        let mut from_the_start = problem.active.clone();
        from_the_start[place].onset_s = None;
        let (with, without) = (problem.fit(&problem.active)?, problem.fit(&from_the_start)?);
        if with.log_evidence - without.log_evidence < least_gain(problem, problem.active[place].candidate) {
            move_to(problem, &without)?;
        }
    }
    Ok(())
}
