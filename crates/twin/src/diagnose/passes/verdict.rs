//! Verdict: the named effects are accepted if there is no evidence against them and nothing else is left.

use super::Pass;
use super::held_out::HeldOutCheck;
use super::refinement::LEFT_FACTOR;
use crate::diagnose::result::{Diagnosis, Finding, HeldOutError, Verdict};
use crate::diagnose::state::{Doubt, State};
use crate::diagnose::words::in_sentence;
use crate::diagnose::{calibration, findings, words};
use crate::estimation::parameters::QUANTILE_95;
use crate::estimation::parameters::number;
use crate::estimation::problem::Problem;
use crate::estimation::unseen::{FORCE, QUANTITIES, VOLTAGE};
use crate::predict::PredictError;

pub(crate) struct FinalVerdict;

impl Pass for FinalVerdict {
    fn name(&self) -> &'static str {
        "Verdict"
    }

    fn run(&self, state: &mut State<'_>) -> Result<(), PredictError> {
        let diagnosis = &mut state.diagnosis;
        let unexplained = &mut diagnosis.goodness.unexplained;
        let stretched = state.left > LEFT_FACTOR * state.threshold && unexplained.is_empty();
        if stretched {
            unexplained.push(words::doubt(&Doubt::StretchedClutter));
        }
        // Fast errors pass for noise, and small errors of many parameters explain what the model as it is handed on does not. One that is
        // known within intervals leaves more than noise, and gusts are a force that no model predicts.
        let (gusts, within) = (state.weather.is_some(), state.has_intervals);
        let beyond = diagnosis.held_out.iter().filter(|error| {
            let is_forced = gusts && error.quantity == QUANTITIES[FORCE].0;
            let is_beyond = if within {
                error.is_far_beyond_noise()
            } else {
                error.is_beyond_noise()
            };
            error.quantity != QUANTITIES[VOLTAGE].0 && !is_forced && is_beyond
        });
        let beyond: Vec<String> = beyond.map(words::beyond_noise).collect();
        let is_left = stretched || !beyond.is_empty();
        unexplained.extend(beyond);
        // A guess may be anything; that a constant is wrong which somebody wrote down takes blocks that no fit has seen, by more than they scatter.
        let guessed = diagnosis.calibrate.iter().any(|one| one.source.is_guess());
        let proved = diagnosis.held_out.iter().any(HeldOutError::falls);
        // And no guess is contradicted by a fit with which the prediction of unseen blocks becomes worse.
        let risen = diagnosis.held_out.iter().any(HeldOutCheck::contradicts_no_guess);
        if !(guessed || proved) || risen {
            diagnosis.calibrate.clear();
        }
        let blocking = diagnosis.calibrate.iter().filter(|one| one.blocking);
        let constants: Vec<String> = blocking.map(|one| one.key.clone()).collect();
        forget_nothing_measured(diagnosis);
        let coarse = state
            .problem
            .logs
            .iter()
            .any(|log| log.predictor.noise().supply_m_s2 > 0.0);
        forget_what_nothing_needs(diagnosis, (!coarse).then_some(state.unseen_gain));
        diagnosis.verdict = if !constants.is_empty() {
            Verdict::CalibrateFirst { constants }
        } else if state.doubts.is_empty() {
            findings::verdict(diagnosis, is_left)
        } else {
            Verdict::OutsideCatalogue
        };
        if !matches!(diagnosis.verdict, Verdict::CalibrateFirst { .. }) {
            forget_what_raises(diagnosis, &state.doubts);
        }
        let nothing_named =
            diagnosis.effects.is_empty() && diagnosis.sensor_or_timing.is_empty() && diagnosis.calibrate.is_empty();
        if nothing_named && diagnosis.verdict == Verdict::OutsideCatalogue {
            // They are the errors of a fit that is not believed.
            diagnosis.held_out.clear();
        }
        // While something is unexplained, intervals are too narrow to contradict a guess.
        if state.doubts.is_empty() && diagnosis.goodness.unexplained.is_empty() {
            let learned = calibration::learned(&state.problem)?;
            let known: Vec<String> = diagnosis.calibrate.iter().map(|one| one.key.clone()).collect();
            let new = learned.into_iter().filter(|one| !known.contains(&one.key));
            diagnosis.calibrate.extend(new);
        }
        widen(&mut state.diagnosis, &state.problem);
        let diagnosis = &mut state.diagnosis;
        let doubts = state.doubts.iter().map(words::doubt);
        diagnosis.goodness.unexplained.extend(doubts);
        Ok(())
    }
}

/// Adds to the intervals what lies between the rows of the logs. Only now: that an effect is there, the rows tell.
fn widen(diagnosis: &mut Diagnosis, problem: &Problem) {
    let Some(first) = problem.logs.first() else { return };
    let steps = problem.logs.iter().map(|log| log.predictor.series().step_s);
    let step_s = steps.fold(0.0, f64::max);
    for finding in diagnosis.effects.iter_mut().chain(&mut diagnosis.sensor_or_timing) {
        let declared = first.predictor.catalogue().find(&finding.instance.effect);
        let (Some(declared), Some(own)) = (declared, finding.parameters.first_mut()) else {
            continue;
        };
        let lag_s = first.predictor.nominal.thrust_lag_up_s;
        let open = declared.search.between_rows.half_width(own.value, step_s, lag_s);
        own.deviation = own.deviation.hypot(open / QUANTILE_95);
        own.interval_95 = own.interval_95.hypot(open);
        if let Some(constant) = &mut finding.constant {
            constant.interval_95 = constant.interval_95.hypot(open * constant.value.abs());
        }
    }
}

/// "Drag-to-lift ratio, d = 0.007 ± 0.014" is no finding: what may be 0 in all its parameters is not named.
fn forget_nothing_measured(diagnosis: &mut Diagnosis) {
    let may_be_nothing = |finding: &Finding| {
        !finding.parameters.is_empty() && finding.parameters.iter().all(|p| p.value.abs() <= p.interval_95)
    };
    let (nothing, rest): (Vec<Finding>, Vec<Finding>) = diagnosis.effects.drain(..).partition(may_be_nothing);
    diagnosis.effects = rest;
    if !nothing.is_empty() {
        let names: Vec<String> = nothing.iter().map(|finding| in_sentence(&finding.label)).collect();
        diagnosis
            .notes
            .push(format!("rejected: {}; its interval contains 0", names.join(", ")));
    }
}

/// A flight without an error that calls for an explanation, whose unseen blocks are predicted no better with what was
/// found: it is the noise of an input (a coarse voltage), not physics.
///
/// * `unseen_gain`: ln of the likelihood ratio on unseen blocks; absent where errors of a coarse voltage, which are alike
///   on all blocks, make it meaningless
fn forget_what_nothing_needs(diagnosis: &mut Diagnosis, unseen_gain: Option<f64>) {
    /// ln of a likelihood ratio on unseen blocks that proves an effect which no error of a quantity shows.
    const PROVED: f64 = 5.0;
    /// Deviations by which an error has to fall instead.
    const BY_FAR: f64 = 2.0;
    let tested = diagnosis
        .held_out
        .iter()
        .filter(|error| error.change_deviation.is_finite());
    let (mut count, mut better) = (0, false);
    for error in tested {
        count += 1;
        better |= error.improves_by(if unseen_gain.is_some() { 1.0 } else { BY_FAR });
    }
    if diagnosis.effects.is_empty()
        || diagnosis.goodness.explained_share.is_some()
        || count == 0
        || better
        || unseen_gain.is_some_and(|gain| gain > PROVED)
    {
        return;
    }
    let names: Vec<String> = diagnosis
        .effects
        .drain(..)
        .map(|finding| in_sentence(&finding.label))
        .collect();
    diagnosis.notes.push(format!(
        "rejected: {}; no error calls for it, and unseen blocks are predicted no better with it",
        names.join(", ")
    ));
}

/// Nothing is called present with which the prediction of blocks that no fit has seen becomes worse, not even as a part of the error.
fn forget_what_raises(diagnosis: &mut Diagnosis, doubts: &[Doubt]) {
    let risen = doubts.iter().find_map(|doubt| match doubt {
        Doubt::HeldOutRises(quantity) => diagnosis.held_out.iter().find(|error| error.quantity == *quantity),
        _ => None,
    });
    let Some(risen) = risen else { return };
    if diagnosis.effects.is_empty() && diagnosis.sensor_or_timing.is_empty() {
        return;
    }
    let with = format!(
        "with it the {} error on unseen blocks rises from {} to {} {}",
        risen.quantity,
        number(risen.before),
        number(risen.after),
        risen.unit
    );
    let all = diagnosis.effects.drain(..).chain(diagnosis.sensor_or_timing.drain(..));
    let names: Vec<String> = all.map(|finding| in_sentence(&finding.label)).collect();
    diagnosis.notes.push(format!("rejected: {}; {with}", names.join(", ")));
    // They are the errors of what has been rejected.
    diagnosis.held_out.clear();
}
