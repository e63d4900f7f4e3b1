//! Absolute goodness of fit: which channels the effects found leave unexplained, and what share of the slow error they explain.

use super::Pass;
use crate::diagnose::result::{ChannelGoodness, Goodness};
use crate::diagnose::state::State;
use crate::diagnose::supply;
use crate::estimation::posterior::posterior_of;
use crate::estimation::problem::Problem;
use crate::estimation::settle::move_to;
use crate::estimation::whiteness::{ChannelFit, UNEXPLAINED_SCORE, coloured, fits};
use crate::predict::{CHANNELS, NAMES, PredictError};

/// Slow excess of all channels, as a normal score, below which there is nothing to explain.
const NO_EXCESS_SCORE: f64 = 6.0;

pub(crate) struct GoodnessOfFit;

impl Pass for GoodnessOfFit {
    fn name(&self) -> &'static str {
        "Goodness of fit"
    }

    fn run(&self, state: &mut State<'_>) -> Result<(), PredictError> {
        let problem = &mut state.problem;
        let mut after = fits(problem, &posterior_of(problem)?.0.mean);
        if problem.active.is_empty() && coloured(&after) {
            // Nothing was named, but the nuisances may have stopped at a kink of the battery's chart.
            let fitted = problem.fit(&[])?;
            move_to(problem, &fitted)?;
            after = fits(problem, &posterior_of(problem)?.0.mean);
        }
        state.diagnosis.goodness = judge(problem, &state.before, &after);
        supply::tell(problem, &mut state.diagnosis.goodness)?;
        Ok(())
    }
}

/// Joins the fits before and after.
pub(crate) fn judge(
    problem: &Problem,
    before: &[[Option<ChannelFit>; CHANNELS]],
    after: &[[Option<ChannelFit>; CHANNELS]],
) -> Goodness {
    let mut goodness = Goodness {
        explained_share: None,
        channels: Vec::new(),
        unexplained: Vec::new(),
    };
    let (mut excess_before, mut excess_after, mut means) = (0.0, 0.0, 0.0);
    for (l, log) in problem.logs.iter().enumerate() {
        for channel in 0..CHANNELS {
            let (Some(old), Some(new)) = (&before[l][channel], &after[l][channel]) else {
                continue;
            };
            // One noise level for both, that of the better fit.
            let slow_before = old.slow * (old.level * old.level) / (new.level * new.level);
            excess_before += slow_before - new.means;
            excess_after += new.slow - new.means;
            means += new.means;
            if new.score() > UNEXPLAINED_SCORE {
                goodness.unexplained.push(if problem.logs.len() == 1 {
                    NAMES[channel].to_owned()
                } else {
                    format!("{} of {}", NAMES[channel], log.predictor.name)
                });
            }
            goodness.channels.push(ChannelGoodness {
                log: log.predictor.name.clone(),
                channel: NAMES[channel].to_owned(),
                chi2_before: old.chi2,
                chi2_after: new.chi2,
                block_variance: new.slow / new.means.max(1.0),
                whiteness_score: new.score(),
            });
        }
    }
    if excess_before > NO_EXCESS_SCORE * (2.0 * means).sqrt() {
        goodness.explained_share = Some(1.0 - excess_after / excess_before);
    }
    goodness
}
