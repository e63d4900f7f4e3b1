//! Which effect a round of the forward selection adds: candidates worth a fit, their fits, and the best that passes, with its rivals.

use rayon::prelude::*;
use rotortwin_plant::effects::{ChannelGroup, EffectClass, ParameterKind};

use crate::diagnose::calibration;
use crate::diagnose::named::{Named, Quantity, RivalFit};
use crate::diagnose::strategies::cut::Cuts;
use crate::diagnose::strategies::start::{Trial, plain};
use crate::diagnose::strategies::trials::Trials;
use crate::diagnose::strategies::{battery, discrete, onset};
use crate::estimation::columns::{Active, in_order, instances};
use crate::estimation::gauss_newton::Fitted;
use crate::estimation::normal::{Posterior, minimum_size, open};
use crate::estimation::problem::Problem;
use crate::estimation::rate_noise;
use crate::estimation::scores::{Scored, opened_mean, priors};
use crate::estimation::whiteness::assumed_fits;
use crate::predict::PredictError;
use crate::predict::channels::{F, KA, KV, M};

/// Evidence above the threshold that must not remain unexplained.
pub(crate) const LEFT_FACTOR: f64 = 3.0;

/// Largest number of candidates that are refined in one round.
const REFINED: usize = 4;

/// Share of the best ln Bayes factor from which a candidate is refined.
const REFINED_SHARE: f64 = 0.35;

/// Evidence by which a guess that fits less well still goes before another explanation.
const GUESS_FIRST: f64 = 5.0;

/// chi² per sample from which a channel has more noise than its sensor.
const NOISY: f64 = 1.5;

/// The best candidate of a round (with the companion that it needs) and its fit, if it passes.
pub(crate) fn best_of(
    problem: &Problem,
    posterior: &Posterior,
    scored: &[Scored],
    special: &Trials,
    threshold: f64,
) -> Result<Option<(Fitted, Vec<Named>)>, PredictError> {
    let cuts = onset::cuts(problem);
    let possible = possible(problem, posterior, (scored, special, cuts.as_ref()), threshold)?;
    if possible.is_empty() {
        return Ok(None);
    }
    let null = if possible.iter().any(|trial| trial.charge.is_some()) {
        battery::fit_anywhere(problem)?
    } else {
        problem.fit(&problem.active)?
    };
    let all = in_order(
        possible
            .par_iter()
            .map(|trial| fits_of(problem, posterior, (trial, cuts.as_ref()), &null)),
    )?;
    let mut tried: Vec<Tried> = all.into_iter().flatten().collect();
    tried.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    let implausible: Vec<Option<Quantity>> = tried
        .iter()
        .map(|one| {
            one.opened
                .iter()
                .find_map(|&c| implausible_size(problem, c, &one.fitted))
        })
        .collect();
    let is_far_off = |one: &Tried| {
        one.opened.iter().copied().find(|&c| {
            let active = one.fitted.active.iter().find(|a| a.candidate == c);
            active.is_some_and(|a| problem.library.candidates[c].is_far_off(&a.values, a.onset_s))
        })
    };
    let mut far_off = vec![false; tried.len()];
    let mut possible: Vec<usize> = Vec::new();
    for (i, one) in tried.iter().enumerate().filter(|&(i, _)| implausible[i].is_none()) {
        if let Some(candidate) = is_far_off(one) {
            far_off[i] = true;
            let explained = calibration::explained(problem, &one.fitted.active, &one.fitted.nuisances)?;
            if calibration::proof(problem, candidate, &explained) < calibration::PROOF_SO_FAR {
                continue;
            }
        }
        possible.push(i);
    }
    // A constant that is far off must lead by more than the evidence that remains unexplained: an effect may look like
    // it, too.
    let first = possible.first().copied();
    let near = possible.iter().copied().find(|&i| !far_off[i]);
    let winner = match (first, near) {
        (Some(far), Some(near)) if tried[far].gain > tried[near].gain + LEFT_FACTOR * threshold => Some(far),
        (first, near) => near.or(first),
    };
    // What was guessed is wrong more often than what was measured.
    let is_guess = |i: &usize| {
        let opened = &tried[*i].opened;
        opened.iter().all(|&c| problem.library.candidates[c].guess.is_some())
    };
    let winner = winner.map(|best| {
        let mut guesses = possible.iter().copied().filter(is_guess);
        let as_good = guesses.find(|&i| tried[i].gain > tried[best].gain - GUESS_FIRST);
        as_good.unwrap_or(best)
    });
    let Some(winner) = winner else {
        return Ok(None);
    };
    let Tried { opened, fitted, gain } = &tried[winner];
    // The gain that re-estimated noise would give the model without the effect is not evidence for the effect.
    if *gain - noise_shift(problem, posterior, opened) <= threshold {
        return Ok(None);
    }
    let sizes: Vec<(bool, f64)> = opened
        .iter()
        .map(|&c| large_enough(problem, c, fitted, threshold))
        .collect();
    // A size that is uncertain because of the shape may still be beyond doubt as a whole.
    let beyond_doubt = *gain > LEFT_FACTOR * threshold;
    if *gain <= threshold || !(beyond_doubt || sizes.iter().all(|(seen, _)| *seen)) {
        return Ok(None);
    }
    let mut rivals: Vec<RivalFit> = Vec::new();
    for (one, implausible) in tried.iter().zip(implausible) {
        // The same candidate with a companion, or from another start, is not a rival.
        if one.opened.iter().any(|c| opened.contains(c)) {
            continue;
        }
        let Some(&candidate) = one.opened.last() else { continue };
        if rivals.iter().all(|rival| rival.candidate != candidate) {
            rivals.push(RivalFit {
                candidate,
                gap: gain - one.gain,
                implausible,
            });
        }
    }
    // Equal prior odds for all candidates; those that were not refined enter with their linear evidence.
    let largest = *gain;
    let mut odds = 0.0;
    for one in scored {
        let refined = tried
            .iter()
            .filter(|t| t.opened.last() == Some(&one.candidate))
            .map(|t| t.gain)
            .fold(f64::NEG_INFINITY, f64::max);
        let own = if refined.is_finite() {
            refined
        } else {
            one.opened.log_bayes_factor.min(largest)
        };
        odds += (own - largest).exp();
    }
    let mut found: Vec<Named> = Vec::new();
    // The rivals are those of the effect in question, the last.
    for (&candidate, &(_, minimum)) in opened.iter().zip(&sizes).rev() {
        found.push(Named {
            candidate,
            log_bayes_factor: *gain,
            posterior: 1.0 / odds.max(1.0),
            minimum,
            rivals: std::mem::take(&mut rivals),
            together: found.is_empty() && opened.len() > 1,
        });
    }
    found.reverse();
    Ok(Some((fitted.clone(), found)))
}

/// Difference in nats between estimating the noise of the rates without and with the effects.
fn noise_shift(problem: &Problem, posterior: &Posterior, opened: &[usize]) -> f64 {
    let (mut places, mut spikes, mut slabs) = (Vec::new(), Vec::new(), Vec::new());
    for &candidate in opened {
        let own = priors(problem, candidate);
        places.extend(own.0);
        spikes.extend(own.1);
        slabs.extend(own.2);
    }
    let offset = vec![0.0; places.len()];
    // A gross error has no columns: it has its own test.
    match open(posterior, &places, &spikes, &spikes, &slabs, &offset) {
        Some(wide) if !places.is_empty() => {
            rate_noise::shift(problem, &posterior.mean, &opened_mean(posterior, &places, &wide))
        }
        _ => 0.0,
    }
}

/// A fit of a trial.
#[derive(Debug, Clone)]
struct Tried {
    /// Candidates that it opened, the one in question last.
    opened: Vec<usize>,
    fitted: Fitted,
    /// Gain of ln evidence.
    gain: f64,
}

/// The fits of a trial: from its start, and from where the effect may set in. None if these leave the range of possible
/// vehicles.
fn fits_of(
    problem: &Problem,
    posterior: &Posterior,
    (trial, cuts): (&Trial, Option<&Cuts>),
    null: &Fitted,
) -> Result<Vec<Tried>, PredictError> {
    let mut tried = Vec::new();
    let opened: Vec<usize> = trial.open.iter().map(|a| a.candidate).collect();
    if let Ok(fitted) = problem.fit_from(&trial.beside(&problem.active), trial.charge) {
        let gain = gain_of(problem, &opened, &fitted, null)?;
        tried.push(Tried { opened, fitted, gain });
    }
    let [only] = trial.open.as_slice() else {
        return Ok(tried);
    };
    if trial.charge.is_some() || problem.library.candidates[only.candidate].is_log_fault() {
        return Ok(tried);
    }
    let least = onset::least_gain(problem, only.candidate);
    let onset = cuts.and_then(|cuts| onset::scan(problem, posterior, only.candidate, cuts));
    if let Some((onset_s, _)) = onset.filter(|(_, gain)| *gain > least) {
        let mut open = problem.active.clone();
        open.push(Active {
            onset_s: Some(onset_s),
            ..only.clone()
        });
        if let Ok(fitted) = problem.fit(&open) {
            let grows = problem.library.candidates[only.candidate].declaration.search.grows;
            let span_s = if grows { GROWTH_SPAN_S } else { STEP_SPAN_S };
            let fitted = at_its_onset(problem, only.candidate, fitted, span_s);
            tried.push(Tried {
                opened: vec![only.candidate],
                // The scan chose the time among all; the gain must pay for that.
                gain: fitted.log_evidence - null.log_evidence - least,
                fitted,
            });
        }
    }
    Ok(tried)
}

/// Half a span of onsets about one that a scan found, s: of an effect that grows from then on, whose rate is sensitive to
/// it, and of one that is there at once. How often the span may be moved.
const GROWTH_SPAN_S: f64 = 0.5;
const STEP_SPAN_S: f64 = 0.05;
const ONSET_MOVES: usize = 3;

/// The fit of an effect at the onset with the most evidence. The scan cuts columns that have passed the chain off: it finds
/// what acts before the lag of the rotors one lag late (a blade that breaks, to which the thrust falls off with the lag),
/// and what grows to a quarter of a second. The fits here pass through the chain from their onset on. Near its maximum the
/// evidence is taken for a parabola in the onset.
///
/// * `span_s`: half the span of the parabola
fn at_its_onset(problem: &Problem, candidate: usize, fitted: Fitted, span_s: f64) -> Fitted {
    let mut best = fitted;
    for _ in 0..ONSET_MOVES {
        let place = best.active.iter().position(|a| a.candidate == candidate);
        let Some((place, now)) = place.and_then(|place| Some((place, best.active[place].onset_s?))) else {
            break;
        };
        let at = |onset_s: f64| {
            let mut open = best.active.clone();
            open[place].onset_s = Some(onset_s.max(0.0));
            problem.fit(&open).ok()
        };
        let (Some(before), Some(after)) = (at(now - span_s), at(now + span_s)) else {
            break;
        };
        let (fall, bend) = (
            0.5 * (after.log_evidence - before.log_evidence),
            after.log_evidence - 2.0 * best.log_evidence + before.log_evidence,
        );
        let step = if bend < 0.0 {
            (-fall / bend).clamp(-2.0, 2.0)
        } else {
            2.0 * fall.signum()
        };
        let better = [at(now + step * span_s), Some(before), Some(after)];
        let better = better.into_iter().flatten();
        let Some(next) = better.max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence)) else {
            break;
        };
        if next.log_evidence <= best.log_evidence {
            break;
        }
        best = next;
        if step.abs() < 1.0 {
            break;
        }
    }
    best
}

/// Gain of ln evidence over the fit without the last of the opened candidates.
///
/// A delayed channel of the log hides from the residual at zero latency that the vehicle responds to the channel's
/// noise before the log contains it: the model without the latency predicts noise, and looks better than it is (on the
/// calm helix by 30 nats). So a latency is weighed where it is fitted, where the causes come before their effects,
/// against its own clutter there. This does not apply to the latency of the IMU, which has rivals (the delay of the
/// command, a flex): all are weighed against the same model without them.
fn gain_of(problem: &Problem, opened: &[usize], fitted: &Fitted, null: &Fitted) -> Result<f64, PredictError> {
    let late = opened.last().is_some_and(|&c| {
        let declaration = problem.library.candidates[c].declaration;
        declaration.class == EffectClass::TimingFault && !declaration.channels.contains(&ChannelGroup::Force)
    });
    let without = if late {
        fitted.log_evidence_as_clutter(problem)?
    } else {
        null.log_evidence
    };
    Ok(fitted.log_evidence - without)
}

/// What is worth a fit in this round: the leading candidates of the linear ranking, special starts, effects that set in late, and
/// effects of the battery, each at its own charge.
fn possible(
    problem: &Problem,
    posterior: &Posterior,
    (scored, special, cuts): (&[Scored], &Trials, Option<&Cuts>),
    threshold: f64,
) -> Result<Vec<Trial>, PredictError> {
    let plausible: Vec<&Scored> = scored.iter().filter(|s| linearly_plausible(problem, s)).collect();
    let first = plausible.first().map_or(0.0, |s| s.opened.log_bayes_factor);
    let best_special = special.starts.first().map_or(0.0, |t| t.log_bayes_factor);
    // The clutter may explain fast errors, or they pass for noise: no linear estimate is evidence then. A fit may still be, and has to
    // pass the threshold.
    let worth = if is_noisy(problem)? { 0.0 } else { threshold };
    let least = worth.max(REFINED_SHARE * first.max(best_special));
    let mut chosen: Vec<Trial> = Vec::new();
    for (place, one) in plausible.iter().take(REFINED).enumerate() {
        // The first of the ranking in any case, as a special start may promise more than its fit delivers; but none
        // with a free shape, which would adapt to whatever the special start is about.
        let shapeless = problem.library.candidates[one.candidate]
            .parameters
            .iter()
            .all(|p| p.kind == ParameterKind::Size);
        let least = if place == 0 && shapeless { worth } else { least };
        if one.opened.log_bayes_factor >= least {
            chosen.push(plain(problem, one));
        }
    }
    for start in special
        .starts
        .iter()
        .take_while(|t| t.log_bayes_factor >= least)
        .take(REFINED)
    {
        // In addition to the plain start, not instead of it: only the fits tell which of two shapes is close enough.
        chosen.push(start.clone());
    }
    let evidence = |c: usize| {
        scored
            .iter()
            .find(|s| s.candidate == c)
            .map(|s| s.opened.log_bayes_factor)
    };
    let late = cuts.map_or_else(Vec::new, |cuts| onset::late_candidates(problem, posterior, cuts));
    for &(candidate, gain) in late.iter().take(2) {
        let known = chosen.iter().any(|t| t.open.iter().any(|a| a.candidate == candidate));
        let over = evidence(candidate).unwrap_or(0.0);
        if !known && gain > least.max(over + onset::least_gain(problem, candidate)) {
            chosen.extend(
                scored
                    .iter()
                    .find(|s| s.candidate == candidate)
                    .map(|s| plain(problem, s)),
            );
        }
    }
    let leading: Vec<_> = chosen
        .iter()
        .flat_map(|t| &t.open)
        .map(|a| problem.library.candidates[a.candidate].declaration)
        .collect();
    chosen.extend(discrete::guess(problem, &leading));
    if battery::wanted(problem, posterior, scored, threshold) {
        chosen.extend(battery::starts(problem));
    }
    Ok(chosen)
}

/// True if the model, with what was named and without the clutter, leaves more in a force or torque channel than the noise of its sensor.
fn is_noisy(problem: &Problem) -> Result<bool, PredictError> {
    let effects = instances(&problem.library, &problem.active);
    for log in &problem.logs {
        let fits = assumed_fits(&log.predictor, log.residual(&effects)?);
        let mut channels = (F..KV).chain(M..KA);
        if channels.any(|c| fits[c].is_some_and(|fit| fit.chi2 > NOISY)) {
            return Ok(true);
        }
    }
    Ok(false)
}

/// False for a linear estimate far outside what real vehicles have, by more than half the plausible range: no
/// refinement brings that back.
fn linearly_plausible(problem: &Problem, one: &Scored) -> bool {
    let entry = &problem.library.candidates[one.candidate];
    problem
        .library
        .columns_of(one.candidate)
        .iter()
        .enumerate()
        .all(|(a, &j)| {
            let column = &problem.library.columns[j];
            let p = &entry.parameters[column.parameter];
            let value = p.default_value() + one.opened.estimate[a] * column.size;
            let deviation = one.opened.covariance.at(a, a).max(0.0).sqrt() * column.size;
            let margin = 0.5 * (p.plausible_high - p.plausible_low) + 3.0 * deviation;
            let (least, most) = entry.reach(column.parameter);
            // A value that is impossible (a rotor of negative inertia) is excluded even if it is close.
            let (low, high) = entry.limits[column.parameter];
            let constant = matches!(entry.constant, Some((place, _)) if place == column.parameter);
            let possible = entry.is_log_fault()
                || constant
                || p.kind != ParameterKind::Size
                || (value <= high + 3.0 * deviation && value >= low - 3.0 * deviation);
            // For an effect that divides by 1 + d, the linear estimate of a constant that is too large is off by up to
            // one over the remaining share.
            let least = if constant { least / (1.0 + least) } else { least };
            possible && value <= most + margin && value >= least - margin
        })
}

/// The first size outside the plausible range by more than a quarter of it and two deviations.
fn implausible_size(problem: &Problem, candidate: usize, fitted: &Fitted) -> Option<Quantity> {
    let entry = &problem.library.candidates[candidate];
    let active = fitted.active.iter().find(|a| a.candidate == candidate)?;
    entry.parameters.iter().enumerate().find_map(|(i, p)| {
        let deviation = entry.columns[i].map_or(0.0, |j| fitted.deviations[j] * p.size);
        let value = active.values[i];
        // The range in which a written constant may be off is wide enough; a value beyond it is not accepted as far
        // off. What sets in is no constant.
        let constant = active.onset_s.is_none() && matches!(entry.constant, Some((place, _)) if place == i);
        let ((least, most), margin) = if constant {
            (entry.reach(i), 0.0)
        } else {
            let range = (p.plausible_low, p.plausible_high);
            (range, 2.0 * deviation + 0.25 * (range.1 - range.0))
        };
        let outside = value > most + margin || value < least - margin;
        (p.kind == ParameterKind::Size && outside).then_some(Quantity {
            symbol: p.symbol,
            value,
            unit: p.unit,
        })
    })
}

/// Whether one of the sizes reaches what the flight can show according to the fit, and the smallest such size of the
/// first parameter.
fn large_enough(problem: &Problem, candidate: usize, fitted: &Fitted, threshold: f64) -> (bool, f64) {
    let Some(active) = fitted.active.iter().find(|a| a.candidate == candidate) else {
        return (false, f64::INFINITY);
    };
    let entry = &problem.library.candidates[candidate];
    let (mut seen, mut first) = (false, f64::INFINITY);
    for j in problem.library.columns_of(candidate) {
        let column = &problem.library.columns[j];
        let p = &entry.parameters[column.parameter];
        if p.kind != ParameterKind::Size {
            continue;
        }
        // The precision without the prior.
        let information = (1.0 / (fitted.deviations[j] * fitted.deviations[j]) - 1.0).max(0.0);
        let least = minimum_size(information, column.spike, threshold) * column.size;
        if first.is_infinite() {
            first = least;
        }
        seen |= active.values[column.parameter].abs() >= least;
    }
    (seen, first)
}
