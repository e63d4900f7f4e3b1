//! Forward selection: rank, refine, add, linearise anew; then goodness, verdict, words.

use rotortwin_plant::effects::{Catalogue, EffectClass, EffectInstance, ParameterKind};

use super::evidence::{Posterior, minimum_size, open};
use super::fit::{Fitted, Problem, fitted_residual, position_of};
use super::goodness::{self, channel_fits, judge, weights};
use super::library::{Candidate, Library};
use super::linear::{Active, Linear, LogState};
use super::ranking::{Scored, detectable, parameters, parameters_of, priors, score, table};
use super::result::{Diagnosis, Finding, Goodness, Rival, Timing, Verdict};
use super::trials::{Trial, Trials};
use super::{Options, THRESHOLD, THRESHOLD_AT_REST, charge, gusts, held_out, onset, trials, wiring, words};
use crate::predict::channels::{F, KV};
use crate::predict::{CHANNELS, NAMES, Nuisances, PredictError, Predictor};

/// Most candidates that are refined in one round.
const REFINED: usize = 4;
/// Share of the best ln Bayes factor from which a candidate is refined.
const REFINED_SHARE: f64 = 0.35;
/// Evidence gap below which a rival counts as compatible.
const COMPATIBLE_GAP: f64 = 5.0;
/// Evidence gap below which the flight cannot tell.
const UNTOLD_GAP: f64 = 1.5;
/// Least explained share of an answer.
const LEAST_SHARE: f64 = 0.9;
/// Gain of ln evidence from which an onset is believed.
const ONSET_GAIN: f64 = 8.0;
/// Evidence over the threshold that must not be left unnamed.
const LEFT_FACTOR: f64 = 3.0;
/// Scales of the clutter over which the final values are averaged.
const CLUTTER_SCALES: [f64; 5] = [0.1, 0.2, 0.4, 0.7, 1.0];
/// Step in posterior deviations from which a point is fitted anew, and how often.
const SETTLED_DEVIATIONS: f64 = 1.5;
const MOST_SETTLINGS: usize = 2;
/// Speed and rate (root mean square about the mean) below which a flight counts as at rest.
const REST_SPEED_M_S: f64 = 0.3;
const REST_RATE_RAD_S: f64 = 0.08;

/// A named effect with what its round knew.
struct Named {
    candidate: usize,
    log_bayes_factor: f64,
    posterior: f64,
    minimum: f64,
    compatible: Vec<Rival>,
    lost: Vec<Rival>,
    /// Found together with the effect through which it acts: its rivals have not been tried beside that.
    together: bool,
}

pub(crate) fn search(
    predictors: Vec<Predictor>,
    catalogue: &Catalogue,
    model: &[EffectInstance],
    options: &Options<'_>,
    start: f64,
) -> Result<Diagnosis, PredictError> {
    let rotors = predictors[0].series().rotors;
    let mut library = Library::new(catalogue, rotors, &predictors[0].vehicle_size());
    // What the model has already is not looked for; its clutter stays as that of the others.
    library.retain(|c| model.iter().all(|m| m.effect != c.declaration.id || m.rotor != c.rotor));
    library.tighten(|one| {
        predictors[0]
            .effect_set(&Nuisances::default(), std::slice::from_ref(one))
            .is_ok()
    });
    let notes: Vec<String> = predictors
        .iter()
        .flat_map(|p| p.notes().into_iter().map(|note| format!("{}: {note}", p.name)))
        .collect();
    let names: Vec<String> = predictors.iter().map(|p| p.name.clone()).collect();
    let testable = predictors.iter().any(|p| (0..CHANNELS).any(|c| p.has(c)));
    let threshold = if predictors.iter().all(at_rest) {
        THRESHOLD_AT_REST
    } else {
        THRESHOLD
    };
    let logs: Vec<LogState> = predictors
        .into_iter()
        .map(|predictor| LogState {
            predictor,
            nuisances: Nuisances::default(),
        })
        .collect();
    let mut diagnosis = Diagnosis {
        verdict: Verdict::NothingTestable,
        sentence: String::new(),
        effects: Vec::new(),
        sensor_or_timing: Vec::new(),
        ranking: Vec::new(),
        not_testable: Vec::new(),
        detectable: Vec::new(),
        goodness: Goodness {
            explained_share: None,
            channels: Vec::new(),
            unexplained: Vec::new(),
        },
        held_out: Vec::new(),
        proposal: None,
        trim: None,
        logs: names,
        notes,
        threshold,
        timing: Timing::default(),
    };
    if !testable {
        diagnosis.sentence = words::sentence(&diagnosis);
        return Ok(diagnosis);
    }
    let mut problem = Problem {
        weights: vec![[1.0; CHANNELS]; logs.len()],
        library,
        logs,
        linear: Vec::new(),
        active: Vec::new(),
    };
    (options.progress)("fitting rotor biases and charge", 0.02);
    problem.fit_nuisances()?;
    let plain: Vec<Nuisances> = problem.logs.iter().map(LogState::plain_nuisances).collect();

    let mut named: Vec<Named> = Vec::new();
    if let Some((active, gain)) = wiring::find(&problem) {
        named.push(Named {
            candidate: active.candidate,
            log_bayes_factor: gain,
            posterior: 1.0,
            minimum: f64::INFINITY,
            compatible: Vec::new(),
            lost: Vec::new(),
            together: false,
        });
        problem.active.push(active);
        problem.fit_nuisances()?;
    }
    let mut before = None;
    // Evidence that is left when nothing more is named.
    let mut left = 0.0;
    let mut looked_again = false;
    let mut to_rank = true;
    for round in 0..=options.most_effects {
        let done = round as f64 / (options.most_effects + 1) as f64;
        let text = if round == 0 {
            "sensitivities of the library"
        } else {
            "looking for a further effect"
        };
        (options.progress)(text, 0.05 + 0.9 * done);
        let per = 0.6 / (options.most_effects + 1) as f64;
        problem.linearise(&|share| (options.progress)(text, 0.05 + 0.9 * done + per * share))?;
        trust(&mut problem);
        let posterior = settled(&mut problem)?.0;
        if before.is_none() {
            before = Some(goodness::fits(&problem, &posterior.mean));
        }
        let scored = score(&problem, &posterior);
        let special = if round < options.most_effects {
            trials::trials(&problem, &posterior, threshold)
        } else {
            Trials::default()
        };
        left = scored.first().map_or(0.0, |s| s.opened.log_bayes_factor);
        if to_rank {
            to_rank = false;
            diagnosis.ranking = table(&problem, &scored)?;
            (diagnosis.not_testable, diagnosis.detectable) =
                detectable(&problem, &scored, &special.worst_minimum, threshold);
        }
        if round == 0 {
            diagnosis.timing.ranked_s = (options.clock)() - start;
        }
        if round == options.most_effects {
            break;
        }
        if gusts_lead(&mut problem, &posterior, &scored, threshold)? {
            break;
        }
        (options.progress)("refining the leading candidates", 0.05 + 0.9 * done + per);
        let Some((fitted, found)) = best_of(&problem, &posterior, &scored, &special, threshold)? else {
            if left < LEFT_FACTOR * threshold || looked_again {
                break;
            }
            // What the ranking saw and no fit confirms may be a charge that stood on the wrong side of a kink of the battery's chart.
            looked_again = true;
            to_rank = round == 0;
            let fitted = problem.fit(&problem.active)?;
            problem.accept(&fitted);
            continue;
        };
        problem.accept(&fitted);
        named.extend(found);
    }
    if problem.active.len() > 1 {
        (options.progress)("looking again at what was found first", 0.9);
        reconsider(&mut problem, &mut named, threshold)?;
    }
    (options.progress)("goodness of fit", 0.95);
    let (mut posterior, mut deviations) = settled(&mut problem)?;
    while let Some(fitted) = superfluous(&problem, &posterior, &deviations, threshold)? {
        named.retain(|one| fitted.active.iter().any(|a| a.candidate == one.candidate));
        move_to(&mut problem, &fitted)?;
        (posterior, deviations) = settled(&mut problem)?;
    }
    let before = before.unwrap_or_default();
    let mut after = goodness::fits(&problem, &posterior.mean);
    if problem.active.is_empty() && coloured(&after) {
        // Nothing was named, but the nuisances may have stopped at a kink of the battery's chart.
        let fitted = problem.fit(&[])?;
        move_to(&mut problem, &fitted)?;
        posterior = posterior_of(&problem)?.0;
        after = goodness::fits(&problem, &posterior.mean);
    }
    let mut goodness = judge(&problem, &before, &after);
    let mut weather = None;
    if !goodness.unexplained.is_empty() && !problem.active.is_empty() {
        (options.progress)("gusts", 0.96);
        weather = gusts::find(&problem, &posterior)?;
        if let Some(first) = &weather {
            // What a wind does depends on the drag, which is another one now.
            problem.advance(&first.posterior.mean);
            problem.linearise(&|_| ())?;
            let (about, _) = posterior_of(&problem)?;
            weather = gusts::find(&problem, &about)?;
            (posterior, left) = match &weather {
                Some(second) => (second.posterior.clone(), 0.0),
                None => (about, left),
            };
        }
        while let Some(first) = &weather
            && let Some(without) = gusts::without_stand_in(&problem, &first.posterior, threshold)?
        {
            let (about, _) = posterior_of(&without)?;
            let Some(found) = gusts::find(&without, &about)? else {
                break;
            };
            named.retain(|one| without.active.iter().any(|a| a.candidate == one.candidate));
            problem = without;
            posterior = found.posterior.clone();
            weather = Some(found);
        }
        if let Some(found) = &weather {
            goodness = judge(&problem, &before, &found.fits);
        }
    }
    if left > LEFT_FACTOR * threshold && goodness.unexplained.is_empty() {
        // The clutter had to stretch far beyond its prior: white residuals then say nothing.
        goodness
            .unexplained
            .push("what only implausible parameters would explain".to_owned());
    }
    diagnosis.goodness = goodness;
    diagnosis.held_out = held_out::errors(&problem, &plain)?;
    let about = if weather.is_some() { None } else { averaged(&problem) };
    let mut findings = findings(&problem, named, about.as_ref().unwrap_or(&posterior));
    findings.extend(weather.and_then(|found| weather_finding(&problem, &found)));
    for finding in findings {
        if matches!(finding.class, EffectClass::Physics | EffectClass::Noise) {
            diagnosis.effects.push(finding);
        } else {
            diagnosis.sensor_or_timing.push(finding);
        }
    }
    if look_alikes(&problem) {
        diagnosis
            .goodness
            .unexplained
            .push("what three effects of one kind patch together".to_owned());
        diagnosis.verdict = Verdict::OutsideCatalogue;
    } else {
        diagnosis.verdict = verdict(&diagnosis);
    }
    diagnosis.sentence = words::sentence(&diagnosis);
    (options.progress)("done", 1.0);
    Ok(diagnosis)
}

/// True for a flight that hardly moves.
fn at_rest(predictor: &Predictor) -> bool {
    let series = predictor.series();
    let spread = |x: &[rotortwin_plant::Vector3]| {
        let count = x.len() as f64;
        (0..3)
            .map(|i| {
                let mean = x.iter().map(|v| v[i]).sum::<f64>() / count;
                x.iter().map(|v| (v[i] - mean) * (v[i] - mean)).sum::<f64>() / count
            })
            .sum::<f64>()
            .sqrt()
    };
    spread(&series.smooth.velocity) < REST_SPEED_M_S && spread(&series.smooth.rates) < REST_RATE_RAD_S
}

/// Takes a fit over, linearises about it, and asks anew which channels to trust.
pub(super) fn move_to(problem: &mut Problem, fitted: &Fitted) -> Result<(), PredictError> {
    problem.accept(fitted);
    problem.linearise(&|_| ())?;
    trust(problem);
    Ok(())
}

/// Lowers the trust in channels that even the whole library with wide priors leaves coloured.
fn trust(problem: &mut Problem) {
    for one in &mut problem.weights {
        *one = [1.0; CHANNELS];
    }
    let normal = problem.normal(|_| true);
    let wide = vec![1.0; problem.size()];
    if let Some(posterior) = Posterior::new(&normal, &wide) {
        for l in 0..problem.logs.len() {
            let fits = channel_fits(
                &problem.logs[l].predictor,
                &fitted_residual(problem, l, &posterior.mean),
            );
            problem.weights[l] = weights(&fits);
        }
    }
}

/// Posterior about the present point, as a step from it, with the prior's pull.
fn posterior_of(problem: &Problem) -> Result<(Posterior, Vec<f64>), PredictError> {
    let mut normal = problem.normal(|_| true);
    let prior = problem.deviations(&problem.active);
    let position = position_of(&problem.library, &problem.logs, &problem.active);
    for ((g, x), d) in normal.gradient.iter_mut().zip(&position).zip(&prior) {
        *g -= x / (d * d);
    }
    Posterior::new(&normal, &prior)
        .map(|p| (p, prior))
        .ok_or_else(|| PredictError("the log holds numbers that make no fit".into()))
}

/// Posterior averaged over how far real vehicles are off their nominal values: the clutter's prior times [`CLUTTER_SCALES`], each by
/// its evidence. Where the flight shows no clutter, a finding is known better than where it does.
fn averaged(problem: &Problem) -> Option<Posterior> {
    let mut normal = problem.normal(|_| true);
    let prior = problem.deviations(&problem.active);
    let position = position_of(&problem.library, &problem.logs, &problem.active);
    let plain = normal.gradient.clone();
    let mut all: Vec<(f64, Posterior)> = Vec::new();
    for scale in CLUTTER_SCALES {
        let scaled: Vec<f64> = prior.iter().map(|d| if *d < 1.0 { d * scale } else { *d }).collect();
        for (i, g) in normal.gradient.iter_mut().enumerate() {
            *g = plain[i] - position[i] / (scaled[i] * scaled[i]);
        }
        // The evidence is that about the point, so that the pull towards 0 counts there, too.
        let penalty: f64 = position.iter().zip(&scaled).map(|(x, d)| (x / d) * (x / d)).sum();
        let posterior = Posterior::new(&normal, &scaled)?;
        all.push((posterior.log_evidence - 0.5 * penalty, posterior));
    }
    let best = all.iter().map(|(e, _)| *e).fold(f64::NEG_INFINITY, f64::max);
    let weights: Vec<f64> = all.iter().map(|(e, _)| (e - best).exp()).collect();
    let total: f64 = weights.iter().sum();
    let (_, mut mixed) = all[0].clone();
    for (i, mean) in mixed.mean.iter_mut().enumerate() {
        *mean = all.iter().zip(&weights).map(|((_, p), w)| w * p.mean[i]).sum::<f64>() / total;
    }
    for i in 0..mixed.mean.len() {
        for j in 0..mixed.mean.len() {
            let of = |(_, p): &(f64, Posterior)| {
                p.covariance.at(i, j) + (p.mean[i] - mixed.mean[i]) * (p.mean[j] - mixed.mean[j])
            };
            let value = all.iter().zip(&weights).map(|(one, w)| w * of(one)).sum::<f64>() / total;
            *mixed.covariance.at_mut(i, j) = value;
        }
    }
    Some(mixed)
}

/// True if a channel is not white.
fn coloured(fits: &[[Option<goodness::ChannelFit>; CHANNELS]]) -> bool {
    let mut all = fits.iter().flatten().flatten();
    all.any(|fit| fit.score() > goodness::UNEXPLAINED_SCORE)
}

/// Posterior about a point that has settled: where the linearisation wants to move the effects or the nuisances further than their
/// deviation, they are fitted and linearised anew.
fn settled(problem: &mut Problem) -> Result<(Posterior, Vec<f64>), PredictError> {
    for _ in 0..MOST_SETTLINGS {
        let (posterior, deviations) = posterior_of(problem)?;
        let offset = problem.nuisances();
        let active = problem.library.columns.iter().enumerate().filter(|(_, column)| {
            let of = |a: &Active| a.candidate == column.candidate;
            problem.active.iter().any(of)
        });
        let far = (0..offset).chain(active.map(|(j, _)| offset + j)).any(|i| {
            let deviation = posterior.covariance.at(i, i).max(0.0).sqrt();
            posterior.mean[i].abs() > SETTLED_DEVIATIONS * deviation
        });
        if !far || problem.active.is_empty() {
            return Ok((posterior, deviations));
        }
        let fitted = problem.fit(&problem.active)?;
        move_to(problem, &fitted)?;
    }
    posterior_of(problem)
}

/// True if the values lie in the plausible range within two deviations, and the sizes are large enough to be seen.
fn implausible(problem: &Problem, candidate: usize, fitted: &Fitted) -> Option<String> {
    let entry = &problem.library.candidates[candidate];
    let active = fitted.active.iter().find(|a| a.candidate == candidate)?;
    entry.parameters.iter().enumerate().find_map(|(i, p)| {
        let deviation = entry.columns[i].map_or(0.0, |j| fitted.deviations[j] * p.size);
        let value = active.values[i];
        let margin = 2.0 * deviation + 0.25 * (p.plausible_high - p.plausible_low);
        let outside = value > p.plausible_high + margin || value < p.plausible_low - margin;
        (p.kind == ParameterKind::Size && outside).then(|| {
            format!("{} = {} {}", p.symbol, words::number(value), p.unit)
                .trim_end()
                .to_owned()
        })
    })
}

/// False for a linear estimate far outside of what real vehicles have, by more than half the plausible range: no refinement brings
/// that back.
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
            // What cannot be at all (a rotor of negative inertia) is out even if it is near.
            let (low, high) = entry.limits[column.parameter];
            let possible = entry.is_log_fault()
                || p.kind != ParameterKind::Size
                || (value <= high + 3.0 * deviation && value >= low - 3.0 * deviation);
            possible && value <= p.plausible_high + margin && value >= p.plausible_low - margin
        })
}

/// What is worth a fit in this round: the leading candidates of the linear ranking, special starts, effects that set in late, and
/// effects of the battery each at its own charge.
fn possible(
    problem: &Problem,
    posterior: &Posterior,
    scored: &[Scored],
    special: &Trials,
    threshold: f64,
) -> Vec<Trial> {
    let plausible: Vec<&Scored> = scored.iter().filter(|s| linearly_plausible(problem, s)).collect();
    let first = plausible.first().map_or(0.0, |s| s.opened.log_bayes_factor);
    let best_special = special.starts.first().map_or(0.0, |t| t.log_bayes_factor);
    let least = threshold.max(REFINED_SHARE * first.max(best_special));
    let mut chosen: Vec<Trial> = Vec::new();
    for (place, one) in plausible.iter().take(REFINED).enumerate() {
        // The first of the ranking in any case, as a special start promises what its fit may not keep; but none whose shape is free, which
        // would bend to whatever the special start is about.
        let shapeless = problem.library.candidates[one.candidate]
            .parameters
            .iter()
            .all(|p| p.kind == ParameterKind::Size);
        let least = if place == 0 && shapeless { threshold } else { least };
        if one.opened.log_bayes_factor >= least {
            chosen.push(trials::plain(problem, one));
        }
    }
    for start in special
        .starts
        .iter()
        .take_while(|t| t.log_bayes_factor >= least)
        .take(REFINED)
    {
        // Beside the plain start, not instead of it: which of two shapes is near enough only the fits tell.
        chosen.push(start.clone());
    }
    let evidence = |c: usize| {
        scored
            .iter()
            .find(|s| s.candidate == c)
            .map(|s| s.opened.log_bayes_factor)
    };
    let late = onset::late_candidates(problem, posterior);
    for &(candidate, gain) in late.iter().take(2) {
        let known = chosen.iter().any(|t| t.open.iter().any(|a| a.candidate == candidate));
        let over = evidence(candidate).unwrap_or(0.0);
        if !known && gain > least.max(over + ONSET_GAIN) {
            chosen.extend(
                scored
                    .iter()
                    .find(|s| s.candidate == candidate)
                    .map(|s| trials::plain(problem, s)),
            );
        }
    }
    let leading: Vec<_> = chosen
        .iter()
        .flat_map(|t| &t.open)
        .map(|a| problem.library.candidates[a.candidate].declaration)
        .collect();
    chosen.extend(wiring::guess(problem, &leading));
    if charge::wanted(problem, posterior, scored, threshold) {
        chosen.extend(charge::starts(problem));
    }
    chosen
}

/// The best candidate of a round (with the companion that it needs) and its fit, if it passes.
fn best_of(
    problem: &Problem,
    posterior: &Posterior,
    scored: &[Scored],
    special: &Trials,
    threshold: f64,
) -> Result<Option<(Fitted, Vec<Named>)>, PredictError> {
    let possible = possible(problem, posterior, scored, special, threshold);
    if possible.is_empty() {
        return Ok(None);
    }
    let null = problem.fit(&problem.active)?;
    // Candidates that were opened, the one in question last; fit; gain of ln evidence.
    let mut tried: Vec<(Vec<usize>, Fitted, f64)> = Vec::new();
    for trial in &possible {
        let opened: Vec<usize> = trial.open.iter().map(|a| a.candidate).collect();
        let mut open = problem.active.clone();
        open.extend(trial.open.iter().cloned());
        // A candidate whose fit leaves what is a vehicle at all is out.
        if let Ok(fitted) = problem.fit_from(&open, trial.charge) {
            let gain = fitted.log_evidence - null.log_evidence;
            tried.push((opened, fitted, gain));
        }
        let [only] = trial.open.as_slice() else { continue };
        if trial.charge.is_some() || problem.library.candidates[only.candidate].is_log_fault() {
            continue;
        }
        if let Some((onset_s, _)) = onset::scan(problem, only.candidate).filter(|(_, gain)| *gain > ONSET_GAIN) {
            let mut open = problem.active.clone();
            open.push(Active {
                onset_s: Some(onset_s),
                ..only.clone()
            });
            if let Ok(fitted) = problem.fit(&open) {
                // The scan chose the time among all; the gain must pay for that.
                let gain = fitted.log_evidence - null.log_evidence - ONSET_GAIN;
                tried.push((vec![only.candidate], fitted, gain));
            }
        }
    }
    tried.sort_by(|a, b| b.2.total_cmp(&a.2));
    let excuses: Vec<Option<String>> = tried
        .iter()
        .map(|(opened, fitted, _)| opened.iter().find_map(|&c| implausible(problem, c, fitted)))
        .collect();
    let Some(winner) = (0..tried.len()).find(|&i| excuses[i].is_none()) else {
        return Ok(None);
    };
    let (opened, fitted, gain) = &tried[winner];
    let Some(&candidate) = opened.last() else {
        return Ok(None);
    };
    let sizes: Vec<(bool, f64)> = opened
        .iter()
        .map(|&c| large_enough(problem, c, fitted, threshold))
        .collect();
    // A size that its own shape leaves uncertain may still be beyond doubt as a whole.
    let beyond_doubt = *gain > LEFT_FACTOR * threshold;
    if *gain <= threshold || !(beyond_doubt || sizes.iter().all(|(seen, _)| *seen)) {
        return Ok(None);
    }
    let (mut compatible, mut lost) = (Vec::new(), Vec::new());
    for (i, (others, _, other_gain)) in tried.iter().enumerate() {
        // The same with a companion, or from another start, is no rival.
        if others.iter().any(|c| opened.contains(c)) {
            continue;
        }
        let Some(&other) = others.last() else { continue };
        if compatible.iter().chain(&lost).any(|r: &(usize, Rival)| r.0 == other) {
            continue;
        }
        let (a, b) = (
            &problem.library.candidates[candidate],
            &problem.library.candidates[other],
        );
        let gap = gain - other_gain;
        let close = gap < COMPATIBLE_GAP && excuses[i].is_none();
        let rival = Rival {
            effect: b.declaration.id.to_owned(),
            rotor: b.rotor,
            label: b.label(),
            evidence_gap: gap,
            reason: if close {
                "this flight fits it nearly as well".into()
            } else {
                words::why_lost(a, b, gap, excuses[i].clone())
            },
        };
        if close {
            compatible.push((other, rival));
        } else {
            lost.push((other, rival));
        }
    }
    // Equal prior odds over all candidates; those that were not refined by their linear evidence.
    let largest = *gain;
    let mut odds = 0.0;
    for one in scored {
        let refined = tried
            .iter()
            .filter(|t| t.0.last() == Some(&one.candidate))
            .map(|t| t.2)
            .fold(f64::NEG_INFINITY, f64::max);
        let own = if refined.is_finite() {
            refined
        } else {
            one.opened.log_bayes_factor.min(largest)
        };
        odds += (own - largest).exp();
    }
    let mut compatible: Vec<Rival> = compatible.into_iter().map(|(_, r)| r).collect();
    let mut lost: Vec<Rival> = lost.into_iter().map(|(_, r)| r).collect();
    let mut found: Vec<Named> = Vec::new();
    // The rivals are those of the effect in question, the last.
    for (&candidate, &(_, minimum)) in opened.iter().zip(&sizes).rev() {
        found.push(Named {
            candidate,
            log_bayes_factor: *gain,
            posterior: 1.0 / odds.max(1.0),
            minimum,
            compatible: std::mem::take(&mut compatible),
            lost: std::mem::take(&mut lost),
            together: found.is_empty() && opened.len() > 1,
        });
    }
    found.reverse();
    Ok(Some((fitted.clone(), found)))
}

/// Whether gusts through a drag that was found explain more than any further effect would, and leave none. An onset that only the gusts
/// called for is dropped.
fn gusts_lead(
    problem: &mut Problem,
    posterior: &Posterior,
    scored: &[Scored],
    threshold: f64,
) -> Result<bool, PredictError> {
    let fits = goodness::fits(problem, &posterior.mean);
    let mut forces = fits.iter().flat_map(|own| (F..KV).filter_map(|c| own[c]));
    if problem.active.is_empty() || !forces.any(|fit| fit.score() > goodness::UNEXPLAINED_SCORE) {
        return Ok(false);
    }
    let evidence = |scored: &[Scored]| scored.first().map_or(0.0, |s| s.opened.log_bayes_factor);
    let leads = |problem: &Problem, posterior: &Posterior| -> Result<bool, PredictError> {
        Ok(gusts::find(problem, posterior)?.is_some_and(|found| {
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

/// Looks again for each effect but the last, now that the others are known: what was found first was found while all else was missing,
/// and may have been another effect that took over a part of the rest. For the last, too, if it came together with the effect through
/// which it acts: beside that another one may do as well.
fn reconsider(problem: &mut Problem, named: &mut [Named], threshold: f64) -> Result<(), PredictError> {
    for place in 0..problem.active.len() {
        let id = |p: &Problem, a: &Active| p.library.candidates[a.candidate].declaration;
        let removed = problem.active[place].clone();
        let own = id(problem, &removed);
        let together = named.iter().any(|n| n.candidate == removed.candidate && n.together);
        let bound = problem.active.iter().any(|other| {
            let needs = id(problem, other).needs;
            other.candidate != removed.candidate
                && (needs.contains(&own.id) || (!together && own.needs.contains(&id(problem, other).id)))
        });
        let last = place + 1 == problem.active.len();
        if bound || (last && !together) || problem.library.columns_of(removed.candidate).is_empty() {
            continue;
        }
        let mut without = problem.clone();
        without.active.remove(place);
        without.linearise(&|_| ())?;
        trust(&mut without);
        let (posterior, _) = settled(&mut without)?;
        let scored = score(&without, &posterior);
        let special = trials::trials(&without, &posterior, threshold);
        let Some((fitted, mut found)) = best_of(&without, &posterior, &scored, &special, threshold)? else {
            continue;
        };
        let [only] = found.as_slice() else { continue };
        let same = only.candidate == removed.candidate;
        if same && !together {
            continue;
        }
        let mut open = without.active.clone();
        open.push(removed.clone());
        // A clear gain: the first finding has its reasons and its rivals written down already.
        if !together && fitted.log_evidence < without.fit(&open)?.log_evidence + UNTOLD_GAP {
            continue;
        }
        if let (Some(slot), Some(new)) = (named.iter_mut().find(|n| n.candidate == removed.candidate), found.pop()) {
            *slot = new;
        }
        move_to(&mut without, &fitted)?;
        *problem = without;
    }
    Ok(())
}

/// Whether one of the sizes reaches what the flight can show by the fit, and the smallest such size of the first parameter.
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
        // What is left of the precision without the prior.
        let information = (1.0 / (fitted.deviations[j] * fitted.deviations[j]) - 1.0).max(0.0);
        let least = minimum_size(information, column.spike, threshold) * column.size;
        if first.is_infinite() {
            first = least;
        }
        seen |= active.values[column.parameter].abs() >= least;
    }
    (seen, first)
}

/// The fit without an effect that a later finding has made superfluous, if there is one.
fn superfluous(
    problem: &Problem,
    posterior: &Posterior,
    prior: &[f64],
    threshold: f64,
) -> Result<Option<Fitted>, PredictError> {
    if problem.active.len() < 2 {
        return Ok(None);
    }
    let Some((candidate, _)) = weakest(problem, posterior, prior, &[]).filter(|(_, evidence)| *evidence <= threshold)
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

/// The active effect with the least evidence, and that evidence, nats; effects that another one or `kept` acts through stay out of it.
pub(super) fn weakest(problem: &Problem, posterior: &Posterior, prior: &[f64], kept: &[&str]) -> Option<(usize, f64)> {
    let position = position_of(&problem.library, &problem.logs, &problem.active);
    let mut weakest: Option<(usize, f64)> = None;
    for active in &problem.active {
        let (places, spikes, slabs) = priors(problem, active.candidate);
        // A gross error has no columns; an effect that acts through another one keeps it.
        let id = problem.library.candidates[active.candidate].declaration.id;
        let needed = problem.active.iter().any(|other| {
            let needs = problem.library.candidates[other.candidate].declaration.needs;
            other.candidate != active.candidate && needs.contains(&id)
        });
        if places.is_empty() || needed || kept.contains(&id) {
            continue;
        }
        let now: Vec<f64> = places.iter().map(|&i| prior[i]).collect();
        let at: Vec<f64> = places.iter().map(|&i| position[i]).collect();
        // The posterior is about the point with the prior about 0: what the data alone say is asked for again.
        let Some(opened) = open(posterior, &places, &spikes, &now, &slabs, &at) else {
            continue;
        };
        if weakest.is_none_or(|(_, least)| opened.log_bayes_factor < least) {
            weakest = Some((active.candidate, opened.log_bayes_factor));
        }
    }
    weakest
}

/// Findings with the final values.
fn findings(problem: &Problem, named: Vec<Named>, posterior: &Posterior) -> Vec<Finding> {
    let position = position_of(&problem.library, &problem.logs, &problem.active);
    let offset = problem.nuisances();
    named
        .into_iter()
        .filter_map(|one| {
            let active = problem.active.iter().find(|a| a.candidate == one.candidate)?;
            let entry = &problem.library.candidates[one.candidate];
            let mut values = active.values.clone();
            let mut deviations = vec![0.0; values.len()];
            for &j in &problem.library.columns_of(one.candidate) {
                let column = &problem.library.columns[j];
                let value = values[column.parameter] + posterior.mean[offset + j] * column.size;
                values[column.parameter] = entry.clamped(column.parameter, value);
                deviations[column.parameter] =
                    posterior.covariance.at(offset + j, offset + j).max(0.0).sqrt() * column.size;
            }
            let mut finding = Finding {
                instance: entry.instance(&values, active.onset_s)?,
                label: entry.label(),
                class: entry.declaration.class,
                equation: entry.declaration.equation.to_owned(),
                parameters: parameters(&problem.library, one.candidate, &values, &deviations),
                ln_bayes_factor: one.log_bayes_factor,
                posterior: one.posterior,
                channels: strongest(problem, one.candidate, &position),
                also_compatible: one.compatible,
                lost: one.lost,
                onset_s: active.onset_s,
                reason: String::new(),
            };
            finding.reason = words::why_found(&finding, one.minimum.is_finite().then_some(one.minimum));
            Some(finding)
        })
        .collect()
}

/// Gusts as a finding.
fn weather_finding(problem: &Problem, found: &gusts::Gusts) -> Option<Finding> {
    let declared = problem.logs.first()?.predictor.catalogue().find(gusts::ID)?;
    let candidate = Candidate {
        declaration: declared,
        parameters: declared.parameters.to_vec(),
        rotor: None,
        columns: vec![None; declared.parameters.len()],
        limits: declared.parameters.iter().map(|p| p.accepted()).collect(),
    };
    let values = [found.rms_m_s, found.correlation_s];
    let mut finding = Finding {
        instance: candidate.instance(&values, None)?,
        label: candidate.label(),
        class: declared.class,
        equation: declared.equation.to_owned(),
        parameters: parameters_of(declared.parameters, &values, &found.deviations),
        ln_bayes_factor: found.gain,
        posterior: 1.0,
        channels: (F..KV)
            .filter(|&c| problem.logs.iter().any(|log| log.predictor.has(c)))
            .map(|c| NAMES[c].to_owned())
            .collect(),
        also_compatible: Vec::new(),
        lost: Vec::new(),
        onset_s: None,
        reason: String::new(),
    };
    finding.reason = words::why_found(&finding, None)
        + "; noise through the drag that was found, white once filtered, and no function of velocity or place";
    Some(finding)
}

/// True if three effects at work are each easily confused with one of the others: together they draw a curve through an error that
/// is none of theirs.
fn look_alikes(problem: &Problem) -> bool {
    let named = |a: &Active| problem.library.candidates[a.candidate].declaration;
    let alike = problem.active.iter().filter(|a| {
        problem.active.iter().any(|b| {
            a.candidate != b.candidate
                && (named(a).confused_with.contains(&named(b).id) || named(b).confused_with.contains(&named(a).id))
        })
    });
    alike.count() >= 3
}

/// Channels by the energy that the effect has in them; those with at least 5 % of it.
fn strongest(problem: &Problem, candidate: usize, position: &[f64]) -> Vec<String> {
    let offset = problem.nuisances();
    let mut energy = [0.0; CHANNELS];
    for (l, linear) in problem.linear.iter().enumerate() {
        let linear: &Linear = linear;
        let own = problem.logs[l].nuisance_count();
        for &j in &problem.library.columns_of(candidate) {
            for (channel, column) in linear.columns[own + j].iter().enumerate() {
                if let Some(column) = column {
                    let square: f64 = column.iter().map(|&x| f64::from(x) * f64::from(x)).sum();
                    energy[channel] += square * position[offset + j] * position[offset + j];
                }
            }
        }
    }
    let total: f64 = energy.iter().sum();
    let mut order: Vec<usize> = (0..CHANNELS).filter(|&c| energy[c] > 0.05 * total).collect();
    order.sort_by(|&a, &b| energy[b].total_cmp(&energy[a]));
    order.into_iter().map(|c| NAMES[c].to_owned()).collect()
}

fn verdict(diagnosis: &Diagnosis) -> Verdict {
    let ids = |findings: &[Finding]| findings.iter().map(|f| f.instance.effect.clone()).collect::<Vec<_>>();
    let nothing = diagnosis.effects.is_empty() && diagnosis.sensor_or_timing.is_empty();
    let unexplained = !diagnosis.goodness.unexplained.is_empty();
    let share = diagnosis.goodness.explained_share;
    if unexplained && (nothing || share.is_some_and(|share| share < LEAST_SHARE)) {
        return Verdict::OutsideCatalogue;
    }
    if nothing {
        return Verdict::Agrees;
    }
    if diagnosis.effects.is_empty() {
        return Verdict::LogFault {
            effects: ids(&diagnosis.sensor_or_timing),
        };
    }
    if let [only] = diagnosis.effects.as_slice() {
        let untold: Vec<String> = only
            .also_compatible
            .iter()
            .filter(|r| r.evidence_gap < UNTOLD_GAP)
            .map(|r| r.effect.clone())
            .collect();
        if !untold.is_empty() {
            let mut group = vec![only.instance.effect.clone()];
            group.extend(untold);
            return Verdict::CannotTell { group };
        }
    }
    Verdict::Missing {
        effects: ids(&diagnosis.effects),
    }
}
