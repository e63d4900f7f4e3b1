//! Flights that differ.
//!
//! A diagnosis of several logs takes one vehicle for all of them. A propeller that broke between two flights, or a log with a fault of its
//! own among others, makes that untrue: then nothing explains them together. The flights are diagnosed one by one, and if each is
//! explained, those with the same answer once more together. What each has is then the answer, instead of what none of them has.

use std::collections::BTreeSet;

use super::result::{Diagnosis, Finding, FlightsApart, NotTestable, Verdict};
use super::words;
use crate::predict::PredictError;

/// Times the smallest size that shows in a flight, by which a finding of another flight would certainly have shown.
const CERTAINLY_SHOWS: f64 = 2.0;
/// Deviations by which two sizes of one effect certainly differ.
const CERTAINLY: f64 = 5.0;

/// The search over the flights at these places; `None` once the time is up.
type Search<'a> = &'a dyn Fn(&[usize]) -> Result<Option<Diagnosis>, PredictError>;

/// Diagnoses `count` flights one by one, and those with the same answer together; by groups in the order of the flights. `None` if
/// one of them has no explanation, or all have the same. That nothing explains all of them together is known.
///
/// # Errors
/// Those of the search.
pub(super) fn each_alone(count: usize, search: Search<'_>) -> Result<Option<Vec<Diagnosis>>, PredictError> {
    let mut alike: Vec<(Vec<usize>, Vec<Diagnosis>)> = Vec::new();
    for flight in 0..count {
        let Some(found) = search(&[flight])?.filter(is_whole) else {
            return Ok(None);
        };
        match alike.iter_mut().find(|(_, group)| answer(&group[0]) == answer(&found)) {
            Some((flights, group)) => {
                flights.push(flight);
                group.push(found);
            }
            None => alike.push((vec![flight], vec![found])),
        }
    }
    let mut groups = Vec::new();
    for (flights, alone) in alike {
        let is_known = [1, count].contains(&alone.len());
        let together = if is_known {
            None
        } else {
            search(&flights)?.filter(is_whole)
        };
        match together.filter(|together| answer(together) == answer(&alone[0])) {
            Some(together) => groups.push(together),
            // Each agrees, and together they do not: what all have is too small to show in one.
            None if found(&alone[0]).next().is_none() => return Ok(None),
            // One name, and sizes that may differ.
            None => groups.extend(alone),
        }
    }
    let differ = groups.windows(2).any(|two| answer(&two[0]) != answer(&two[1]));
    Ok((groups.len() > 1 && (differ || are_contradicted(&groups))).then_some(groups))
}

/// Puts the answers of groups of flights in the place of one that explains nothing.
pub(super) fn tell(together: &mut Diagnosis, groups: Vec<Diagnosis>) {
    let changed = are_contradicted(&groups);
    together.verdict = Verdict::FlightsDiffer { changed };
    // Those of a fit that is not believed.
    together.effects.clear();
    together.sensor_or_timing.clear();
    together.calibrate.clear();
    together.held_out.clear();
    let apart = groups.into_iter().map(|found| FlightsApart {
        logs: found.logs,
        verdict: found.verdict,
        sentence: found.sentence,
        effects: found.effects,
        sensor_or_timing: found.sensor_or_timing,
        held_out: found.held_out,
    });
    together.apart = apart.collect();
    words::render(together);
}

/// True if an answer names this effect, or as what else its findings may be.
pub(super) fn speaks_of(diagnosis: &Diagnosis, effect: &str) -> bool {
    found(diagnosis)
        .any(|one| one.instance.effect == effect || one.also_compatible.iter().any(|rival| rival.effect == effect))
}

/// True if what one group has, another contradicts.
fn are_contradicted(groups: &[Diagnosis]) -> bool {
    let findings = || groups.iter().flat_map(found);
    let mut groups = groups.iter();
    groups.any(|one| findings().any(|finding| contradicts(finding, one)))
}

fn is_whole(found: &Diagnosis) -> bool {
    let whole = matches!(
        found.verdict,
        Verdict::Agrees | Verdict::Missing { .. } | Verdict::CannotTell { .. } | Verdict::LogFault { .. }
    );
    whole && found.stopped_at_s.is_none()
}

fn found(diagnosis: &Diagnosis) -> impl Iterator<Item = &Finding> {
    diagnosis.effects.iter().chain(&diagnosis.sensor_or_timing)
}

/// What a diagnosis names, whatever its sizes.
fn answer(diagnosis: &Diagnosis) -> BTreeSet<(&str, Option<usize>)> {
    found(diagnosis)
        .map(|finding| (finding.instance.effect.as_str(), finding.instance.rotor))
        .collect()
}

/// True if flights with another answer contradict a finding: they would certainly have shown it, or have another size of it.
fn contradicts(finding: &Finding, other: &Diagnosis) -> bool {
    let (effect, rotor) = (&finding.instance.effect, finding.instance.rotor);
    let own = |name: &str| finding.parameters.iter().find(|own| own.name == name);
    let mut same = found(other).filter(|one| one.instance.effect == *effect).peekable();
    if same.peek().is_some() {
        return same.filter(|one| one.instance.rotor == rotor).any(|one| {
            one.parameters.iter().any(|theirs| {
                own(&theirs.name).is_some_and(|own| {
                    (own.value - theirs.value).abs() > CERTAINLY * own.deviation.hypot(theirs.deviation)
                })
            })
        });
    }
    let is_of = |one: &&NotTestable| one.effect == *effect && one.rotor == rotor;
    let sizes = other.detectable.iter().filter(is_of);
    sizes
        .filter_map(|one| own(&one.parameter).zip(one.minimum_size))
        .any(|(own, minimum)| own.value.abs() > CERTAINLY_SHOWS * minimum)
}
