//! Findings that are not missing physics: a constant that was guessed, and for which the flights indicate another
//! value.
//!
//! A vehicle whose inertia no log determined has that of its class. A flight that then needs another inertia does not
//! lack an effect; it calls for a calibration, and anything else that seems to be missing is reported only after that
//! ([`set_apart`]).
//!
//! A guess with a smaller error is absorbed by the small errors that every parameter is allowed, so nothing is found;
//! but the flights may determine the constant far better than its class does, and then report it ([`learned`]): with
//! all guesses open at the same time, each with the interval of its class as its prior, about a point to which the
//! first such fit has moved.

use rotortwin_plant::effects::{ChannelGroup, CorrectionScale, EffectClass};

use super::result::{Calibration, Correction, Finding};
use crate::estimation::candidates::{Candidate, Library};
use crate::estimation::columns::{Active, instances};
use crate::estimation::normal::Posterior;
use crate::estimation::normal::not_finite;
use crate::estimation::parameters::QUANTILE_95;
use crate::estimation::posterior::pulled;
use crate::estimation::problem::Problem;
use crate::model::ConstantInterval;
use crate::predict::{CHANNELS, Nuisances, PredictError};

/// Share of the prior's deviation below which the flights determine a guess "much better" than its class.
const NARROWED: f64 = 0.5;
/// Share of the prior's deviation by which a guess must be off for a calibration to be worthwhile.
const WORTH_TELLING: f64 = 0.25;
/// Distance of the guess from the flights' value, in deviations, from which it is reported as off: three in a thousand
/// by chance.
const CLEARLY_OFF: f64 = 3.0;

/// Share of the measured signal that must be explained, in the channel where a far-off constant shows most, once all is
/// found.
const PROOF: f64 = 0.5;
/// The same during the search: other constants may be wrong as well.
pub(crate) const PROOF_SO_FAR: f64 = 0.3;
/// Length of the means used for that, s.
const PROOF_MEAN_S: f64 = 0.1;

/// Findings, separated by what they may be reported as.
pub(crate) struct Parted {
    /// What no guessed constant explains.
    pub(crate) found: Vec<Finding>,
    /// Guesses that the flights contradict.
    pub(crate) calibrations: Vec<Calibration>,
    /// Names of effects that may only compensate for these guesses; they are not named before the guesses are
    /// calibrated.
    pub(crate) withheld: Vec<String>,
}

/// Takes the findings that are errors of guessed constants, or of constants that are far off, out of the others. Of
/// several that are errors of one constant, the first is reported. With a contradicted constant, no effect of the whole
/// vehicle is named that shows only where such constants show: several wrong constants together look like one of them,
/// and like a density or a mass; if one is far off, so do faults of single rotors and of sensors. An effect that acts
/// through such a constant, as a wind through the drag, is named.
pub(crate) fn set_apart(found: Vec<Finding>, library: &Library) -> Parted {
    let far_off = found.iter().any(|finding| far_off(finding, library).is_some());
    let mut calibrations: Vec<Calibration> = Vec::new();
    let mut rest: Vec<Finding> = found
        .into_iter()
        .filter(|finding| {
            let Some(wanted) = calibration(finding, library, far_off) else {
                return true;
            };
            if calibrations.iter().all(|known| known.key != wanted.key) {
                calibrations.push(wanted);
            }
            false
        })
        .collect();
    let declared = |finding: &Finding| {
        let mut all = library.candidates.iter();
        all.find(|c| c.declaration.id == finding.instance.effect)
            .map(|c| c.declaration)
    };
    let acts_through = |finding: &Finding, constant: &Calibration| {
        declared(finding).is_some_and(|d| d.needs.contains(&constant.correction.effect.as_str()))
    };
    // A wind is not another value of the drag that it acts through, nor the fault of one rotor another value of what all have: such a guess
    // is fitted as well, and blocks nothing as long as its class contains the value.
    for constant in &mut calibrations {
        let can_be = (constant.low..=constant.high).contains(&constant.wanted);
        let of_one_rotor = |finding: &Finding| declared(finding).is_some_and(|d| d.per_rotor);
        let apart = !rest.is_empty() && rest.iter().all(of_one_rotor);
        constant.blocking = !(can_be && (apart || rest.iter().any(|finding| acts_through(finding, constant))));
    }
    let mut withheld = Vec::new();
    if calibrations.iter().any(|constant| constant.blocking) {
        let wrong = |c: &&Candidate| {
            let constant = c.constant.as_ref().map(|(_, constant)| &constant.key);
            c.guess.is_some() || constant.is_some_and(|key| calibrations.iter().any(|known| known.key == *key))
        };
        let shown: Vec<ChannelGroup> = library
            .candidates
            .iter()
            .filter(wrong)
            .flat_map(|c| c.declaration.channels)
            .copied()
            .collect();
        rest.retain(|finding| {
            let makes_up = declared(finding).is_some_and(|d| {
                (far_off || (d.class == EffectClass::Physics && !d.per_rotor))
                    && d.channels.iter().all(|group| shown.contains(group))
            }) && !calibrations.iter().any(|constant| acts_through(finding, constant));
            if makes_up {
                withheld.push(super::words::in_sentence(&finding.label));
            }
            !makes_up
        });
    }
    Parted {
        found: rest,
        calibrations,
        withheld,
    }
}

/// Takes out constants that are far off according to a finding but do not [`prove`](proof) it; returns their names.
///
/// # Errors
/// The effects together yield an invalid vehicle.
pub(crate) fn without_proof(found: &mut Vec<Finding>, problem: &Problem) -> Result<Vec<String>, PredictError> {
    let library = &problem.library;
    if found.iter().all(|finding| far_off(finding, library).is_none()) {
        return Ok(Vec::new());
    }
    let nuisances: Vec<Nuisances> = problem.logs.iter().map(|log| log.nuisances).collect();
    let explained = explained(problem, &problem.active, &nuisances)?;
    let mut without = Vec::new();
    found.retain(|finding| {
        let stays = far_off(finding, library).is_none_or(|place| proof(problem, place, &explained) > PROOF);
        if !stays {
            without.push(finding.label.clone());
        }
        stays
    });
    Ok(without)
}

/// Share of the measured signal that is explained in the channel where a candidate shows most. A regressor that carries
/// almost no information in a channel has a factor near 0, whatever the constant is: a yaw that follows the rotors'
/// acceleration, which the model lacks, seems to require four times the inertia.
pub(crate) fn proof(problem: &Problem, candidate: usize, explained: &[f64; CHANNELS]) -> f64 {
    let columns = problem.library.columns_of(candidate);
    let energy = |channel: usize| -> f64 {
        let logs = problem.linear.iter().zip(&problem.logs);
        logs.flat_map(|(linear, log)| columns.iter().map(move |j| &linear.columns[log.nuisance_count() + j]))
            .filter_map(|column| column[channel].as_ref())
            .flatten()
            .map(|&x| f64::from(x) * f64::from(x))
            .sum()
    };
    let strongest = (0..CHANNELS).max_by(|&a, &b| energy(a).total_cmp(&energy(b)));
    strongest.map_or(0.0, |channel| explained[channel])
}

/// Share of the measured signal that a point explains in each channel, with means over 0.1 s, about 0 and not about
/// their mean: a mass is identified from the mean of the force.
///
/// # Errors
/// The effects together yield an invalid vehicle.
pub(crate) fn explained(
    problem: &Problem,
    active: &[Active],
    nuisances: &[Nuisances],
) -> Result<[f64; CHANNELS], PredictError> {
    let effects = instances(&problem.library, active);
    let mut sums = [(0.0, 0.0); CHANNELS];
    for (log, nuisances) in problem.logs.iter().zip(nuisances) {
        let residuals = log.predictor.residuals(nuisances, &effects)?;
        let rows = (PROOF_MEAN_S / log.predictor.series().step_s).round().max(1.0) as usize;
        for (channel, (left, all)) in sums.iter_mut().enumerate() {
            let (raw, mask) = (&residuals.raw[channel], &residuals.mask[channel]);
            let measured = log.predictor.measured(channel);
            for start in (0..raw.len().saturating_sub(rows)).step_by(rows) {
                let range = start..start + rows;
                if mask[range.clone()].iter().all(|counts| *counts) {
                    let mean = |x: &[f64]| x[range.clone()].iter().sum::<f64>() / rows as f64;
                    *left += mean(raw).powi(2);
                    *all += mean(&measured).powi(2);
                }
            }
        }
    }
    Ok(sums.map(|(left, all)| if all > 0.0 { 1.0 - left / all } else { 0.0 }))
}

/// Index of the candidate of a finding.
fn candidate_of(finding: &Finding, library: &Library) -> Option<usize> {
    let instance = &finding.instance;
    library
        .candidates
        .iter()
        .position(|c| c.declaration.id == instance.effect && c.rotor == instance.rotor)
}

/// Index of the candidate of a finding, if it is the error of a constant that is off by factors.
fn far_off(finding: &Finding, library: &Library) -> Option<usize> {
    let values: Vec<f64> = finding.parameters.iter().map(|p| p.value).collect();
    candidate_of(finding, library).filter(|&place| library.candidates[place].is_far_off(&values, finding.onset_s))
}

/// The constant whose error a finding is, if it was guessed, or if a constant is `far_off`.
fn calibration(finding: &Finding, library: &Library, far_off: bool) -> Option<Calibration> {
    let candidate = &library.candidates[candidate_of(finding, library)?];
    let guess = candidate.guess.as_ref().map(|guess| (guess.parameter, &guess.constant));
    let constant = candidate
        .constant
        .as_ref()
        .map(|(parameter, constant)| (*parameter, constant));
    let (parameter, constant) = guess.or(constant.filter(|_| far_off))?;
    let fitted = &finding.parameters[parameter];
    let mut found = wanted(
        candidate,
        (parameter, constant),
        (fitted.value, fitted.interval_95),
        finding.ln_bayes_factor,
        true,
    )?;
    // Fitted together: the others belong to this value.
    for one in &finding.parameters {
        let correction = &mut found.correction;
        correction.parameters.insert(one.name.clone(), one.value);
        correction.deviations.insert(one.name.clone(), one.deviation);
    }
    Some(found)
}

/// What a constant should be, from its error as found and half the 95 % interval of that.
fn wanted(
    candidate: &Candidate,
    (parameter, constant): (usize, &ConstantInterval),
    (error, interval_95): (f64, f64),
    ln_bayes_factor: f64,
    blocking: bool,
) -> Option<Calibration> {
    let (offset, unit) = match candidate.parameters[parameter].corrects?.scale {
        CorrectionScale::Share => (constant.value, constant.value.abs()),
        CorrectionScale::Difference => (1.0, 1.0),
        CorrectionScale::Whole => return None,
    };
    Some(Calibration {
        key: constant.key.clone(),
        name: constant.name.clone(),
        unit: constant.unit.clone(),
        value: constant.value,
        low: constant.low,
        high: constant.high,
        source: constant.source,
        wanted: constant.value + offset * error,
        wanted_interval_95: unit * interval_95,
        ln_bayes_factor,
        blocking,
        how: constant.how.clone(),
        better: constant.better.clone(),
        correction: correction(candidate, parameter, error, interval_95),
    })
}

/// Possible exponents of a rotor's thrust over duty and over voltage: 1 to 2 by momentum theory and ESC, with a margin
/// for what a fit about a curved law gives. 13 motors on a thrust stand have 1.40 to 1.92 over voltage
/// (docs/bench-fit.md).
const EXPONENTS: [(&str, std::ops::Range<f64>); 2] =
    [("rotors.thrust_slope", 0.5..3.0), ("rotors.voltage_slope", 0.2..3.0)];

/// False if no vehicle has such a value: an exponent of thrust near 0, or a negative value of a quantity that is
/// positive in all vehicles of the class.
pub(crate) fn can_be(calibration: &Calibration) -> bool {
    let exponent = EXPONENTS.iter().find(|(key, _)| *key == calibration.key);
    match exponent {
        Some((_, possible)) => possible.contains(&calibration.wanted),
        None => calibration.low <= 0.0 || calibration.wanted > 0.0,
    }
}

/// The effect with this error of one of its parameters, and nothing else.
fn correction(candidate: &Candidate, parameter: usize, error: f64, interval_95: f64) -> Correction {
    let names = || candidate.parameters.iter().map(|one| one.name.to_string());
    let mut values = candidate.neutral();
    values[parameter] = error;
    let deviation = |place| {
        if place == parameter {
            interval_95 / QUANTILE_95
        } else {
            0.0
        }
    };
    Correction {
        effect: candidate.declaration.id.to_owned(),
        rotor: candidate.rotor,
        parameters: names().zip(values).collect(),
        deviations: names()
            .enumerate()
            .map(|(place, name)| (name, deviation(place)))
            .collect(),
    }
}

/// A guess in the problem: its candidate and the index of its unknown.
struct Open {
    candidate: usize,
    unknown: usize,
    /// Deviation of the unknown, from the interval of the constant.
    deviation: f64,
    size: f64,
}

/// Guessed constants that are not errors of what was named, with one parameter each.
fn open_guesses(problem: &Problem) -> Vec<Open> {
    let (library, offset) = (&problem.library, problem.nuisances());
    let mut keys: Vec<&str> = Vec::new();
    let named = |candidate: usize| problem.active.iter().any(|a| a.candidate == candidate);
    // What was named may be the error of the same constant.
    for (place, candidate) in library.candidates.iter().enumerate() {
        if let Some(guess) = candidate.guess.as_ref().filter(|_| named(place)) {
            keys.push(&guess.constant.key);
        }
    }
    let mut open = Vec::new();
    for (place, candidate) in library.candidates.iter().enumerate() {
        let Some(guess) = candidate.guess.as_ref() else {
            continue;
        };
        let Some(column) = candidate.columns[guess.parameter] else {
            continue;
        };
        if keys.contains(&guess.constant.key.as_str()) {
            continue;
        }
        keys.push(&guess.constant.key);
        let size = library.columns[column].size;
        open.push(Open {
            candidate: place,
            unknown: offset + column,
            deviation: guess.deviation / size,
            size,
        });
    }
    open
}

/// The posterior with every guess free within its interval.
fn posterior(problem: &Problem, open: &[Open]) -> Result<Posterior, PredictError> {
    let mut prior = problem.deviations(&problem.active);
    for one in open {
        prior[one.unknown] = one.deviation;
    }
    pulled(problem, problem.normal(|_| true), &prior).ok_or_else(not_finite)
}

/// Guesses within their class for which nothing was named, but which the flights determine much better and with another
/// value.
///
/// # Errors
/// One sentence: the model cannot be evaluated at the values that the flights indicate.
pub(crate) fn learned(problem: &Problem) -> Result<Vec<Calibration>, PredictError> {
    let open = open_guesses(problem);
    if open.is_empty() {
        return Ok(Vec::new());
    }
    let first = posterior(problem, &open)?;
    let deviation = |posterior: &Posterior, at: usize| posterior.covariance.at(at, at).max(0.0).sqrt();
    let narrow: Vec<&Open> = open
        .iter()
        .filter(|one| deviation(&first, one.unknown) < NARROWED * one.deviation)
        .filter(|one| first.mean[one.unknown].abs() > CLEARLY_OFF * deviation(&first, one.unknown))
        .collect();
    if narrow.is_empty() {
        return Ok(Vec::new());
    }
    // A third of an inertia is not a small step: it is evaluated at the value it leads to.
    let mut there = problem.clone();
    there.active.extend(narrow.iter().map(|one| Active {
        candidate: one.candidate,
        values: problem.library.candidates[one.candidate].neutral(),
        onset_s: None,
    }));
    there.advance(&first.mean);
    there.linearise(&|_| ())?;
    let second = posterior(&there, &open)?;
    Ok(narrow
        .into_iter()
        .filter_map(|one| {
            let candidate = &problem.library.candidates[one.candidate];
            let guess = candidate.guess.as_ref()?;
            let at = there.active.iter().find(|a| a.candidate == one.candidate)?.values[guess.parameter];
            let error = at + second.mean[one.unknown] * one.size;
            let deviation = deviation(&second, one.unknown);
            let off = error.abs() / (deviation * one.size);
            // Savage and Dickey: the prior's density at no error over the posterior's.
            let ln_bayes_factor = (deviation / one.deviation).ln() + 0.5 * off * off;
            let worth_telling = error.abs() > WORTH_TELLING * guess.deviation;
            (worth_telling && deviation < NARROWED * one.deviation && off > CLEARLY_OFF)
                .then(|| {
                    wanted(
                        candidate,
                        (guess.parameter, &guess.constant),
                        (error, QUANTILE_95 * deviation * one.size),
                        ln_bayes_factor,
                        false,
                    )
                })
                .flatten()
                .filter(can_be)
        })
        .collect())
}
