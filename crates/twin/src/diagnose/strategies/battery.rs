//! Starts of fits of the battery voltage: charge at the start and all effects that show in the voltage together.
//!
//! The open-circuit voltage is a chart with kinks, so a fit that starts at the wrong charge stays there, and effects
//! other than the true one absorb the rest. The voltage is slow: on means of 0.1 s, every charge is tried with the
//! effects fitted to it. Changes of the thrust act through the slope of the rotors' power, computed once.

use rayon::prelude::*;
use rotortwin_plant::effects::{AtBattery, ChannelGroup, EffectDeclaration, ParameterKind, Strategy};

use super::slow_voltage::{CHARGES, EFFECT_STEP, Fit, Point};
use super::start::{Trial, active_at};
use crate::estimation::columns::{Active, instances};
use crate::estimation::gauss_newton::Fitted;
use crate::estimation::normal::{Posterior, open};
use crate::estimation::posterior::pulled;
use crate::estimation::problem::{Problem, fitted_residual, position_of};
use crate::estimation::scores::{Scored, priors};
use crate::estimation::whiteness::{UNEXPLAINED_SCORE, channel_fits};
use crate::predict::{PredictError, Prediction, Source, channels::V};

/// Length of a mean, s.
const MEAN_S: f64 = 0.1;

/// Minima that are searched over the charge, most steps of the effect at each charge, and sections of the interval.
const SEARCHED: usize = 3;

/// Loss of ln likelihood against the best effect up to which an effect is still fitted.
const WORTH: f64 = 200.0;

/// Most effects that are fitted.
const MOST_EFFECTS: usize = 3;

/// Where the slow voltage has two minima this close, nats, and further apart than a cell, the whole log decides between them.
const MINIMA_GAP: f64 = 30.0;

/// True if the voltage is not explained, or an effect of the battery would explain a part of it.
pub(crate) fn wanted(problem: &Problem, posterior: &Posterior, scored: &[Scored], threshold: f64) -> bool {
    let [log] = problem.logs.as_slice() else {
        return false;
    };
    if !log.predictor.has(V) {
        return false;
    }
    let hint = scored
        .iter()
        .any(|s| of_battery(problem, s.candidate) && s.opened.log_bayes_factor > threshold);
    // An effect that scales the thrust may be due to a wrong voltage in Eq. 19: at the right charge the voltage itself
    // decides.
    let scales = scored
        .iter()
        .filter(|s| s.opened.log_bayes_factor > threshold)
        .any(|s| {
            let declared = problem.library.candidates[s.candidate].declaration;
            let others = declared.confused_with.iter();
            others
                .filter_map(|id| log.predictor.catalogue().find(id))
                .any(at_battery)
        });
    if hint || scales {
        return true;
    }
    let residual = fitted_residual(problem, 0, &posterior.mean);
    channel_fits(&log.predictor, &residual)[V].is_some_and(|fit| fit.score() > UNEXPLAINED_SCORE)
}

/// Best charge for each effect of the battery, best effects first. Empty for several logs and where no voltage is tested.
pub(crate) fn starts(problem: &Problem) -> Vec<Trial> {
    let [log] = problem.logs.as_slice() else {
        return Vec::new();
    };
    if !log.predictor.has(V) {
        return Vec::new();
    }
    let Some(rest) = posterior_without_voltage(problem, &[]) else {
        return Vec::new();
    };
    let mut found: Vec<Trial> = (0..problem.library.candidates.len())
        .filter(|&c| of_battery(problem, c))
        .filter(|&c| problem.active.iter().all(|a| a.candidate != c))
        .collect::<Vec<_>>()
        .into_par_iter()
        .filter_map(|c| scan(problem, Some(c), &rest))
        .flatten_iter()
        .collect();
    found.sort_by(|a, b| b.log_bayes_factor.total_cmp(&a.log_bayes_factor));
    let best = found.first().map_or(0.0, |t| t.log_bayes_factor);
    let is_worth = |t: &Trial| t.log_bayes_factor > best - WORTH;
    let mut effects: Vec<usize> = Vec::new();
    for one in found.iter().filter(|t| is_worth(t)) {
        if !effects.contains(&one.open[0].candidate) {
            effects.push(one.open[0].candidate);
        }
    }
    let of_sensor = |t: &Trial| of_sensor(problem, t.open[0].candidate);
    // Gain and offset of the sensor differ by less than small errors of the other constants, which a scan does not know: the fit decides
    // between them.
    let leading = &effects[..effects.len().min(MOST_EFFECTS)];
    let leads = |t: &Trial| is_worth(t) && leading.contains(&t.open[0].candidate);
    let sensor = found.iter().any(|t| leads(t) && of_sensor(t));
    found.retain(|t| leads(t) || (sensor && of_sensor(t)));
    found
}

/// The active effects fitted, from their present values and from those that a search over all charges finds: effects
/// named one after the other keep the charge of the first of them, and the next one must not merely compensate for
/// that.
pub(crate) fn fit_anywhere(problem: &Problem) -> Result<Fitted, PredictError> {
    let here = problem.fit(&problem.active)?;
    Ok(match elsewhere(problem)? {
        Some(there) if there.log_evidence > here.log_evidence => there,
        _ => here,
    })
}

/// The best fit from a start of a search over all charges; `None` where no effect of the battery was named or its charge is not known
/// from one log.
pub(crate) fn elsewhere(problem: &Problem) -> Result<Option<Fitted>, PredictError> {
    if !may_stand_elsewhere(problem) {
        return Ok(None);
    }
    let rest = posterior_without_voltage(problem, &[]);
    let trials = rest.and_then(|rest| scan(problem, None, &rest)).unwrap_or_default();
    let fits = trials
        .iter()
        .filter_map(|trial| problem.fit_from(&trial.moved, trial.charge).ok());
    Ok(fits.max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence)))
}

/// True if an effect of the battery was named and its charge can be searched.
pub(crate) fn may_stand_elsewhere(problem: &Problem) -> bool {
    let one_log = problem.logs.len() == 1 && problem.logs[0].predictor.has(V);
    one_log && problem.active.iter().any(|a| of_battery(problem, a.candidate))
}

/// Effects of the battery and of its sensor.
fn of_battery(problem: &Problem, candidate: usize) -> bool {
    at_battery(problem.library.candidates[candidate].declaration)
}

fn at_battery(declared: &EffectDeclaration) -> bool {
    matches!(declared.search.strategy, Strategy::BatteryState(_))
}

/// Errors of the voltage's sensor, of one parameter each.
fn of_sensor(problem: &Problem, candidate: usize) -> bool {
    problem.library.candidates[candidate].declaration.search.strategy == Strategy::BatteryState(AtBattery::Sensor)
}

/// The evidence of all other channels, with the parameters at `opened` as free as the open effects. The priors' pull
/// counts: at the present point biases of the rotors may imitate the effect in question.
fn posterior_without_voltage(problem: &Problem, opened: &[usize]) -> Option<Posterior> {
    let mut without_voltage = problem.weights.clone();
    for weights in &mut without_voltage {
        weights[V] = 0.0;
    }
    let normal = problem.normal_with(&without_voltage, |_| true);
    let mut prior = problem.deviations(&problem.active);
    for &i in opened {
        prior[i] = 1.0;
    }
    pulled(problem, normal, &prior)
}

/// Effects that a search over the charge moves: the active ones that show in the voltage, and a further one.
fn moving(problem: &Problem, further: Option<usize>) -> Vec<usize> {
    let active = problem.active.iter().map(|a| a.candidate);
    active
        .filter(|&c| shows_in(problem, c, ChannelGroup::Voltage) && !problem.library.columns_of(c).is_empty())
        .chain(further)
        .collect()
}

fn shows_in(problem: &Problem, candidate: usize, channel: ChannelGroup) -> bool {
    let declared = problem.library.candidates[candidate].declaration;
    declared.channels.contains(&channel)
}

/// The active effects with the moving ones at `theta`, plausible sizes from where they do nothing.
fn with_moved(problem: &Problem, moving: &[usize], theta: &[f64]) -> Vec<Active> {
    let mut active = problem.active.clone();
    let mut rest = theta;
    for &candidate in moving {
        let own;
        (own, rest) = rest.split_at(problem.library.columns_of(candidate).len());
        let moved = active_at(problem, candidate, own);
        match active.iter_mut().find(|a| a.candidate == candidate) {
            Some(one) => one.values = moved.values,
            None => active.push(moved),
        }
    }
    active
}

/// The best charge for a further effect, or for the active ones alone, and a second one that is nearly as good.
fn scan(problem: &Problem, further: Option<usize>, rest: &Posterior) -> Option<Vec<Trial>> {
    let log = &problem.logs[0];
    let moving = moving(problem, further);
    let (mut gain, mut places) = (0.0, Vec::new());
    if let Some(further) = further {
        let (own, spikes, slabs) = priors(problem, further);
        gain = open(rest, &own, &spikes, &spikes, &slabs, &vec![0.0; own.len()])?.log_bayes_factor;
        places = own;
    }
    let opened = posterior_without_voltage(problem, &places)?;
    let columns: Vec<usize> = moving.iter().flat_map(|&c| problem.library.columns_of(c)).collect();
    let places: Vec<usize> = columns.iter().map(|j| problem.nuisances() + j).collect();
    let position = position_of(&problem.library, &problem.logs, &problem.active);
    let estimate: Vec<f64> = places.iter().map(|&i| position[i] + opened.mean[i]).collect();
    let prior = opened.covariance.part(&places).cholesky()?.inverse();
    let mut nuisances = log.nuisances;
    for (i, bias) in nuisances
        .rotor_bias_n
        .iter_mut()
        .enumerate()
        .take(log.predictor.series().rotors)
    {
        *bias += opened.mean[problem.global(0, i)] * log.nuisance_size(i);
    }
    let base_at = |theta: &[f64]| -> Option<Prediction> {
        let at_work = with_moved(problem, &moving, theta);
        let set = log
            .predictor
            .effect_set(&nuisances, &instances(&problem.library, &at_work))
            .ok()?;
        Some(log.predictor.predict(&set, Source::Smooth, None))
    };
    let base = base_at(&estimate)?;
    let mut coarse = log.predictor.coarse_voltage(&base, MEAN_S);
    // What changes the thrust changes the current; a wrong reading of the voltage does so through Eq. 19.
    let on_thrust = |j: usize| shows_in(problem, problem.library.columns[j].candidate, ChannelGroup::Force);
    for (place, _) in columns.iter().enumerate().filter(|(_, j)| on_thrust(**j)) {
        let mut next = estimate.clone();
        next[place] += EFFECT_STEP;
        let moved = log.predictor.coarse_voltage(&base_at(&next)?, MEAN_S);
        coarse.slope_towards(&moved, place, 1.0 / EFFECT_STEP);
    }
    let weight = coarse.weight * problem.weights[0][V];
    let predict = |charge: f64, theta: &[f64]| -> Option<Vec<f64>> {
        let mut nuisances = nuisances;
        nuisances.charge = charge;
        let active = with_moved(problem, &moving, theta);
        let set = log
            .predictor
            .effect_set(&nuisances, &instances(&problem.library, &active))
            .ok()?;
        let shift: Vec<f64> = theta.iter().zip(&estimate).map(|(t, e)| t - e).collect();
        Some(log.predictor.coarse_prediction(&set, &base, &coarse, &shift))
    };
    let fit = Fit {
        predict: &predict,
        measured: &coarse.measured,
        weight,
        estimate: &estimate,
        prior: &prior,
    };
    let start: Vec<f64> = columns
        .iter()
        .zip(&places)
        .zip(&estimate)
        .map(|((&j, &place), &estimate)| {
            let column = &problem.library.columns[j];
            if Some(column.candidate) != further {
                return position[place];
            }
            // Without information of their own the sizes start at a tenth: neutral shapes would have no column.
            let declared = &problem.library.candidates[column.candidate].parameters[column.parameter];
            if declared.kind == ParameterKind::Size && estimate.abs() < 0.02 {
                0.1
            } else {
                estimate
            }
        })
        .collect();
    let mut minima = Vec::with_capacity(CHARGES);
    for i in 0..CHARGES {
        let target = (i as f64 + 0.5) / CHARGES as f64;
        let charge = target - log.predictor.initial_charge();
        minima.push(fit.descend(charge, start.clone())?);
    }
    minima.sort_by(|a, b| a.value.total_cmp(&b.value));
    for minimum in minima.iter_mut().take(SEARCHED) {
        if let Some(lower) = fit.searched(minimum).filter(|lower| lower.value < minimum.value) {
            *minimum = lower;
        }
    }
    minima.sort_by(|a, b| a.value.total_cmp(&b.value));
    let first = minima.first()?;
    let second = minima[1..].iter().find(|m| {
        let apart = (m.charge - first.charge).abs() > 1.0 / CHARGES as f64;
        apart && m.value < first.value + MINIMA_GAP
    });
    let trial = |minimum: &Point| {
        let (open, moved) = with_moved(problem, &moving, &minimum.theta)
            .into_iter()
            .partition(|a| Some(a.candidate) == further);
        Trial {
            open,
            moved,
            // Comparable among these trials only.
            log_bayes_factor: gain - minimum.value,
            charge: Some(minimum.charge),
        }
    };
    Some(std::iter::once(first).chain(second).map(trial).collect())
}
