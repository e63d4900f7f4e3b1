//! Gust covariance: whether gusts explain the rest, and which effects only stood in for them.

use super::Pass;
use super::goodness::judge;
use crate::diagnose::state::State;
use crate::diagnose::strategies::covariance::{self, Gusts};
use crate::estimation::normal::Posterior;
use crate::estimation::posterior::posterior_of;
use crate::estimation::problem::Problem;
use crate::estimation::scores::{Scored, score, weakest};
use crate::estimation::settle::move_to;
use crate::estimation::whiteness::{self, UNEXPLAINED_SCORE};
use crate::predict::PredictError;
use crate::predict::channels::{F, KV};

pub(crate) struct GustCovariance;

impl Pass for GustCovariance {
    fn name(&self) -> &'static str {
        "Gust covariance"
    }

    fn searches(&self) -> bool {
        true
    }

    fn run(&self, state: &mut State<'_>) -> Result<(), PredictError> {
        if state.diagnosis.goodness.unexplained.is_empty() || state.problem.active.is_empty() {
            return Ok(());
        }
        let posterior = state.posterior()?;
        let Some(first) = covariance::find(&state.problem, &posterior)? else {
            return Ok(());
        };
        // What a wind does depends on the drag, which is another one now.
        state.problem.advance(&first.posterior.mean);
        state.problem.linearise(&|_| ())?;
        let (about, _) = posterior_of(&state.problem)?;
        let Some(found) = covariance::find(&state.problem, &about)? else {
            return Ok(());
        };
        state.left = 0.0;
        let found = drop_stand_ins(state, found)?;
        state.diagnosis.goodness = judge(&state.problem, &state.before, &found.fits);
        state.weather = Some(found);
        Ok(())
    }
}

/// Drops the effects that only imitated gusts, one after the other; returns the gusts without them.
fn drop_stand_ins(state: &mut State<'_>, mut gusts: Gusts) -> Result<Gusts, PredictError> {
    while let Some(without) = without_stand_in(&state.problem, &gusts.posterior, state.threshold)? {
        let (about, _) = posterior_of(&without)?;
        let Some(found) = covariance::find(&without, &about)? else {
            break;
        };
        let stays = |candidate: usize| without.active.iter().any(|a| a.candidate == candidate);
        state.named.retain(|one| stays(one.candidate));
        state.problem = without;
        gusts = found;
    }
    Ok(gusts)
}

/// Whether gusts through a drag that was found explain more than any further effect would, and leave none. An onset that only the gusts
/// called for is dropped.
pub(crate) fn gusts_lead(
    problem: &mut Problem,
    posterior: &Posterior,
    scored: &[Scored],
    threshold: f64,
) -> Result<bool, PredictError> {
    let fits = whiteness::fits(problem, &posterior.mean);
    let mut forces = fits.iter().flat_map(|own| (F..KV).filter_map(|c| own[c]));
    if problem.active.is_empty() || !forces.any(|fit| fit.score() > UNEXPLAINED_SCORE) {
        return Ok(false);
    }
    let evidence = |scored: &[Scored]| scored.first().map_or(0.0, |s| s.opened.log_bayes_factor);
    let leads = |problem: &Problem, posterior: &Posterior| -> Result<bool, PredictError> {
        Ok(covariance::find(problem, posterior)?.is_some_and(|found| {
            found.gain > evidence(scored) && evidence(&score(problem, &found.posterior)) < threshold
        }))
    };
    if leads(problem, posterior)? {
        return Ok(true);
    }
    if problem.active.iter().all(|a| a.onset_s.is_none()) {
        return Ok(false);
    }
    let mut plain = problem.clone();
    for one in &mut plain.active {
        one.onset_s = None;
    }
    let fitted = plain.fit(&plain.active)?;
    move_to(&mut plain, &fitted)?;
    let about = posterior_of(&plain)?.0;
    let without_onset = leads(&plain, &about)?;
    if without_onset {
        *problem = plain;
    }
    Ok(without_onset)
}

/// The problem without the effect that imitated gusts, if there is one: with the gusts in the noise its evidence falls
/// below `threshold`. Over a flight, gusts have a mean that looks like wind, and a slow part that looks like a tilt.
///
/// * `posterior`: with the gusts in the noise
fn without_stand_in(problem: &Problem, posterior: &Posterior, threshold: f64) -> Result<Option<Problem>, PredictError> {
    let acts_through = problem
        .logs
        .first()
        .and_then(|log| covariance::declared(log.predictor.catalogue()))
        .map_or(&[][..], |gusts| gusts.needs);
    let prior = problem.deviations(&problem.active);
    let weakest = weakest(problem, posterior, &prior, acts_through);
    let Some((candidate, _)) = weakest.filter(|(_, evidence)| *evidence < threshold) else {
        return Ok(None);
    };
    let mut without = problem.clone();
    without.active.retain(|a| a.candidate != candidate);
    let fitted = without.fit(&without.active)?;
    move_to(&mut without, &fitted)?;
    Ok(Some(without))
}
