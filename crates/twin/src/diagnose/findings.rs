//! The findings of a search in the form of its result: final values, the fate of their rivals, and the verdict.

use std::collections::BTreeSet;

use rotortwin_plant::effects::{ChannelGroup, EffectClass, ParameterKind};

use super::THRESHOLD;
use super::named::{Named, RivalFit, UNTOLD_GAP};
use super::result::{ConstantWanted, Diagnosis, Finding, HeldOutError, Outcome, Rival, Verdict};
use super::strategies::{along, covariance};
use crate::estimation::candidates::Candidate;
use crate::estimation::columns::Active;
use crate::estimation::linearisation::Linear;
use crate::estimation::normal::Posterior;
use crate::estimation::parameters::QUANTILE_95;
use crate::estimation::parameters::{parameters, parameters_of};
use crate::estimation::problem::{Problem, position_of};
use crate::predict::channels::{F, KV, group};
use crate::predict::{CHANNELS, NAMES};

/// Least explained share of an answer.
const LEAST_SHARE: f64 = 0.9;

/// Evidence gap below which a rival counts as compatible: it takes as much to exclude an effect as to name one. A fit that ended beside
/// the best charge of the battery has cost the right one of two faults of the voltage sensor 5 nats.
const COMPATIBLE_GAP: f64 = THRESHOLD;

/// Whether the sizes of an effect are possible: within the plausible range of the vehicle, with a margin of a tenth of
/// it, not all of them less than their own deviation, and none that the effect is nothing without possibly 0. A fit may leave the range with another effect present or with
/// the clutter at another width.
pub(crate) fn can_be(entry: &Candidate, values: &[f64], deviations: &[f64], onset_s: Option<f64>) -> bool {
    let sizes: Vec<usize> = (0..entry.parameters.len())
        .filter(|&i| entry.parameters[i].kind == ParameterKind::Size)
        .collect();
    let is_absent = |i: usize| entry.parameters[i].is_essential && values[i].abs() <= QUANTILE_95 * deviations[i];
    if (0..values.len()).any(is_absent) {
        return false;
    }
    // A guess may turn out to be anything, and a constant that somebody wrote down wrong; neither sets in.
    let is_guess = entry.guess.is_some() && onset_s.is_none();
    (is_guess || entry.is_far_off(values, onset_s) || sizes.iter().all(|&i| entry.is_plausible(i, values[i])))
        && (sizes.is_empty() || sizes.iter().any(|&i| values[i].abs() > deviations[i]))
}

/// Values of an effect at work and their deviations by a posterior about the present point.
pub(crate) fn values_of(problem: &Problem, active: &Active, posterior: &Posterior) -> (Vec<f64>, Vec<f64>) {
    let entry = &problem.library.candidates[active.candidate];
    let offset = problem.nuisances();
    let mut values = active.values.clone();
    let mut deviations = vec![0.0; values.len()];
    // A slope with a corner that is fitted, too, is twice as uncertain as one whose corner is known.
    let corner = if entry.declaration.search.grows && active.onset_s.is_some() {
        2.0
    } else {
        1.0
    };
    for &j in &problem.library.columns_of(active.candidate) {
        let column = &problem.library.columns[j];
        let value = values[column.parameter] + posterior.mean[offset + j] * column.size;
        values[column.parameter] = entry.clamped(column.parameter, value);
        let deviation = posterior.covariance.at(offset + j, offset + j).max(0.0).sqrt();
        deviations[column.parameter] = corner * deviation * column.size;
    }
    let sizes = entry.parameters.iter().zip(&values);
    let sizes = sizes.filter(|(parameter, _)| parameter.kind == ParameterKind::Size);
    let unknown = entry.declaration.search.blur * sizes.map(|(_, size)| size * size).sum::<f64>().sqrt() / QUANTILE_95;
    for deviation in &mut deviations {
        *deviation = deviation.hypot(unknown);
    }
    (values, deviations)
}

/// Findings with the final values, and the names of those whose size cannot be.
pub(crate) fn findings(problem: &Problem, named: Vec<Named>, posterior: &Posterior) -> (Vec<Finding>, Vec<String>) {
    let mut impossible = Vec::new();
    let position = position_of(&problem.library, &problem.logs, &problem.active);
    let found = named
        .into_iter()
        .filter_map(|one| {
            let active = problem.active.iter().find(|a| a.candidate == one.candidate)?;
            let entry = &problem.library.candidates[one.candidate];
            let (values, deviations) = values_of(problem, active, posterior);
            let too_small = below(entry, &values, one.minimum);
            let (mut compatible, mut lost) = (Vec::new(), Vec::new());
            let named = |candidate: usize| problem.active.iter().any(|a| a.candidate == candidate);
            for rival in one.rivals.iter().filter(|rival| !named(rival.candidate)) {
                let rival = fared(problem, entry, rival, too_small);
                match rival.outcome {
                    Outcome::AsGood => compatible.push(rival),
                    _ => lost.push(rival),
                }
            }
            // Candidates that fit equally well come before those that are only not separable.
            let (near, lost): (Vec<Rival>, Vec<Rival>) = lost
                .into_iter()
                .partition(|rival| rival.outcome == Outcome::TooSmallToTell);
            compatible.extend(near);
            let finding = Finding {
                instance: entry.instance(&values, active.onset_s)?,
                label: entry.label(),
                class: entry.declaration.class,
                equation: entry.declaration.equation.to_owned(),
                parameters: parameters(&problem.library, one.candidate, &values, &deviations),
                ln_bayes_factor: one.log_bayes_factor,
                posterior: one.posterior,
                channels: strongest(problem, one.candidate, &position),
                also_compatible: compatible,
                lost,
                onset_s: active.onset_s,
                reason: String::new(),
                seen_from: one.minimum.is_finite().then_some(one.minimum),
                constant: constant_of(entry, &values, &deviations, active.onset_s),
                picture: None,
            };
            if !can_be(entry, &values, &deviations, active.onset_s) {
                // For effects known only approximately, such a size is an error of the approximation, not a sign of
                // something else.
                if entry.declaration.search.blur == 0.0 {
                    impossible.push(finding.label);
                }
                return None;
            }
            Some(finding)
        })
        .collect();
    (found, impossible)
}

/// The constant whose error an effect is, if the vehicle document has a number for it, and what it should be.
fn constant_of(entry: &Candidate, values: &[f64], deviations: &[f64], onset_s: Option<f64>) -> Option<ConstantWanted> {
    let (place, constant) = entry.constant.as_ref().filter(|_| onset_s.is_none())?;
    // For a share of a level without a unit, the parameter already says everything.
    (!constant.unit.is_empty()).then(|| ConstantWanted {
        name: constant.name.clone(),
        unit: constant.unit.clone(),
        value: constant.value,
        wanted: constant.value * (1.0 + values[*place]),
        interval_95: QUANTILE_95 * constant.value.abs() * deviations[*place],
    })
}

/// The result of a rival compared with the named effect; a look-alike of something that came out `too_small` did not
/// lose.
fn fared(problem: &Problem, named: &Candidate, rival: &RivalFit, too_small: bool) -> Rival {
    let other = &problem.library.candidates[rival.candidate];
    // Of channels that no log has, nothing is left or explained.
    let measured = |wanted: &ChannelGroup| {
        (0..CHANNELS).any(|c| group(c) == *wanted && problem.logs.iter().any(|log| log.predictor.has(c)))
    };
    let declared = named.declaration;
    let outcome = if rival.gap < COMPATIBLE_GAP && rival.implausible.is_none() {
        Outcome::AsGood
    } else if too_small && declared.confused_with.contains(&other.declaration.id) {
        // A size below the detectable one is not known well enough to conclude that a look-alike lost.
        Outcome::TooSmallToTell
    } else if let Some(quantity) = rival.implausible {
        Outcome::Implausible(quantity)
    } else {
        let left: Vec<ChannelGroup> = declared
            .channels
            .iter()
            .filter(|wanted| !other.declaration.channels.contains(wanted) && measured(wanted))
            .copied()
            .collect();
        if left.is_empty() {
            Outcome::OtherShape(declared.excited_by)
        } else {
            Outcome::Leaves(left)
        }
    };
    Rival {
        effect: other.declaration.id.to_owned(),
        rotor: other.rotor,
        label: other.label(),
        evidence_gap: rival.gap,
        reason: String::new(),
        outcome,
    }
}

/// True if the only size of an effect came out below the smallest detectable size.
fn below(entry: &Candidate, values: &[f64], minimum: f64) -> bool {
    let mut sizes = (0..values.len()).filter(|&i| entry.parameters[i].kind == ParameterKind::Size);
    let (Some(only), None) = (sizes.next(), sizes.next()) else {
        return false;
    };
    minimum.is_finite() && values[only].abs() < minimum
}

/// Gusts as a finding.
pub(crate) fn weather_finding(problem: &Problem, found: &covariance::Gusts) -> Option<Finding> {
    let declared = covariance::declared(problem.logs.first()?.predictor.catalogue())?;
    let candidate = Candidate {
        declaration: declared,
        parameters: declared.parameters.to_vec(),
        rotor: None,
        columns: vec![None; declared.parameters.len()],
        limits: declared.parameters.iter().map(|p| p.accepted()).collect(),
        guess: None,
        constant: None,
    };
    let values = [found.rms_m_s, found.correlation_s];
    Some(Finding {
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
        seen_from: None,
        constant: None,
        picture: None,
    })
}

/// Channels by the energy that the effect has in them; those with at least 5 % of it.
pub(crate) fn strongest(problem: &Problem, candidate: usize, position: &[f64]) -> Vec<String> {
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

/// True if three active effects are each easily confused with one of the others: together they can follow the curve of
/// an error that is none of theirs. Those that one mistake brings along count as one.
pub(crate) fn look_alikes(problem: &Problem) -> bool {
    let named = |a: &Active| problem.library.candidates[a.candidate].declaration;
    let mistake = |a: &Active| along::mistake(problem, a);
    let alike = problem.active.iter().filter(|a| {
        problem.active.iter().any(|b| {
            mistake(a) != mistake(b)
                && (named(a).confused_with.contains(&named(b).id) || named(b).confused_with.contains(&named(a).id))
        })
    });
    alike.map(mistake).collect::<BTreeSet<_>>().len() >= 3
}

/// * `is_left`: an error is left that no channel shows: it passes for noise, or small errors of all parameters were stretched to implausible ones
pub(crate) fn verdict(diagnosis: &Diagnosis, is_left: bool) -> Verdict {
    let ids = |findings: &[Finding]| findings.iter().map(|f| f.instance.effect.clone()).collect::<Vec<_>>();
    let nothing = diagnosis.effects.is_empty() && diagnosis.sensor_or_timing.is_empty();
    let unexplained = !diagnosis.goodness.unexplained.is_empty();
    let share = diagnosis.goodness.explained_share;
    if unexplained && (nothing || is_left || share.is_some_and(|share| share < LEAST_SHARE)) {
        // What unseen blocks prove stands, whatever the rest is; but noise such as gusts takes up any error, and proves nothing.
        let can_be = |finding: &Finding| {
            finding.class == EffectClass::Physics && finding.parameters.iter().all(|parameter| parameter.plausible)
        };
        if !diagnosis.effects.is_empty()
            && diagnosis.effects.iter().all(can_be)
            && diagnosis.held_out.iter().any(HeldOutError::falls)
        {
            return Verdict::PartlyMissing {
                effects: ids(&diagnosis.effects),
            };
        }
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
