//! What a search found in the words of its result: findings with final values, and the verdict.

use rotortwin_plant::effects::{ParameterDeclaration, ParameterKind};

use super::named::{Named, UNTOLD_GAP};
use super::result::{Diagnosis, Finding, Rival, Verdict};
use super::strategies::covariance;
use super::words;
use crate::estimation::candidates::Candidate;
use crate::estimation::columns::Active;
use crate::estimation::linearisation::Linear;
use crate::estimation::normal::Posterior;
use crate::estimation::parameters::{parameters, parameters_of};
use crate::estimation::problem::{Problem, position_of};
use crate::predict::channels::{F, KV};
use crate::predict::{CHANNELS, NAMES};

/// Least explained share of an answer.
const LEAST_SHARE: f64 = 0.9;

/// Share of a plausible range by which a value may lie beyond it.
const BEYOND: f64 = 0.1;

/// Whether the sizes of a finding can be: within the plausible range of the vehicle, give or take a tenth of it, and not all of them
/// less than their own deviation. A fit may leave the range with another effect beside it or with the clutter at another width.
fn can_be(entry: &Candidate, finding: &Finding) -> bool {
    let mut sizes = entry
        .parameters
        .iter()
        .zip(&finding.parameters)
        .filter(|(p, _)| p.kind == ParameterKind::Size)
        .peekable();
    let within = |p: &ParameterDeclaration, value: f64| {
        let margin = BEYOND * (p.plausible_high - p.plausible_low);
        (p.plausible_low - margin..=p.plausible_high + margin).contains(&value)
    };
    sizes.clone().all(|(p, found)| within(p, found.value))
        && (sizes.peek().is_none() || sizes.any(|(_, found)| found.value.abs() > found.deviation))
}

/// Findings with the final values, and the names of those whose size cannot be.
pub(crate) fn findings(problem: &Problem, named: Vec<Named>, posterior: &Posterior) -> (Vec<Finding>, Vec<String>) {
    let mut impossible = Vec::new();
    let position = position_of(&problem.library, &problem.logs, &problem.active);
    let offset = problem.nuisances();
    let found = named
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
            let (mut compatible, mut lost) = (one.compatible, one.lost);
            if below(entry, &values, one.minimum) {
                // What came out smaller than what would show is not known well enough to say of a look-alike that it lost.
                let alike = |rival: &Rival| entry.declaration.confused_with.contains(&rival.effect.as_str());
                let (near, far): (Vec<Rival>, Vec<Rival>) = lost.into_iter().partition(alike);
                lost = far;
                compatible.extend(near.into_iter().map(|rival| Rival {
                    reason: "what was found is smaller than what this flight shows for certain".to_owned(),
                    ..rival
                }));
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
                also_compatible: compatible,
                lost,
                onset_s: active.onset_s,
                reason: String::new(),
                picture: None,
            };
            finding.reason = words::why_found(&finding, one.minimum.is_finite().then_some(one.minimum));
            if !can_be(entry, &finding) {
                impossible.push(finding.label);
                return None;
            }
            Some(finding)
        })
        .collect();
    (found, impossible)
}

/// True if the only size of an effect came out below the smallest that would have been seen.
fn below(entry: &Candidate, values: &[f64], minimum: f64) -> bool {
    let mut sizes = (0..values.len()).filter(|&i| entry.parameters[i].kind == ParameterKind::Size);
    let (Some(only), None) = (sizes.next(), sizes.next()) else {
        return false;
    };
    minimum.is_finite() && values[only].abs() < minimum
}

/// Gusts as a finding.
pub(crate) fn weather_finding(problem: &Problem, found: &covariance::Gusts) -> Option<Finding> {
    let declared = problem.logs.first()?.predictor.catalogue().find(covariance::ID)?;
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
        picture: None,
    };
    finding.reason = words::why_found(&finding, None)
        + "; noise through the drag that was found, white once filtered, and no function of velocity or place";
    Some(finding)
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

/// True if three effects at work are each easily confused with one of the others: together they draw a curve through an error that
/// is none of theirs.
pub(crate) fn look_alikes(problem: &Problem) -> bool {
    let named = |a: &Active| problem.library.candidates[a.candidate].declaration;
    let alike = problem.active.iter().filter(|a| {
        problem.active.iter().any(|b| {
            a.candidate != b.candidate
                && (named(a).confused_with.contains(&named(b).id) || named(b).confused_with.contains(&named(a).id))
        })
    });
    alike.count() >= 3
}

pub(crate) fn verdict(diagnosis: &Diagnosis) -> Verdict {
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
