//! Several flights in different air: each one alone.
//!
//! A diagnosis of several logs takes one vehicle and one wind for all of them. Outdoors each flight has a wind of its
//! own, so that together nothing explains their forces. Where that is the answer, and an effect of the air is found in
//! a flight alone, the answer says what each of them says alone.

use rotortwin_plant::effects::{Catalogue, Place};

use super::result::{Diagnosis, Finding, FlightAlone, Verdict};
use super::words::{in_sentence, parameters};
use super::{Options, diagnose};
use crate::log::FlightLog;
use crate::model::ModelVersion;
use crate::predict::PredictError;

/// Most flights that are taken alone.
const MOST_FLIGHTS: usize = 8;
/// Flights without an effect of the air after which the others are not tried.
const ENOUGH_WITHOUT: usize = 2;

/// Adds to the diagnosis of several logs what each of them says alone, if an effect of the air is among that and the logs together have
/// no explanation. The time limit is that of both.
///
/// # Errors
/// The model's effects are not valid. A flight that cannot be diagnosed alone is a note.
pub fn add_flights_alone(
    diagnosis: &mut Diagnosis,
    logs: &[FlightLog],
    model: &ModelVersion,
    options: &Options<'_>,
) -> Result<(), PredictError> {
    let is_open = matches!(
        diagnosis.verdict,
        Verdict::OutsideCatalogue | Verdict::PartlyMissing { .. }
    );
    if !is_open || !(2..=MOST_FLIGHTS).contains(&logs.len()) {
        return Ok(());
    }
    let catalogue = model.with_documents(&options.effects).catalogue()?;
    let (start_s, spent_s) = ((options.clock)(), diagnosis.timing.total_s);
    let mut alone = Vec::new();
    for (place, log) in logs.iter().enumerate() {
        // The share of the whole search never falls.
        let text = format!("flight {} of {} alone", place + 1, logs.len());
        (options.progress)(&text, 0.999);
        let left_s = options.time_limit_s - spent_s - ((options.clock)() - start_s);
        let without = alone.iter().filter(|one: &&FlightAlone| !one.is_of_the_air).count();
        if left_s <= 0.0 || without >= ENOUGH_WITHOUT {
            return Ok(());
        }
        let of_one = Options {
            effects: options.effects.clone(),
            baseline: Vec::new(),
            most_effects: options.most_effects,
            progress: &|_, _| (),
            clock: options.clock,
            time_limit_s: left_s,
        };
        let found = match diagnose(std::slice::from_ref(log), model, &of_one) {
            Ok(found) => found,
            // What the flights say together is not lost for it.
            Err(refused) => {
                let note = format!("{} could not be diagnosed alone: {refused}", log.name);
                diagnosis.notes.push(note);
                return Ok(());
            }
        };
        alone.push(FlightAlone {
            log: log.name.clone(),
            is_of_the_air: found.effects.iter().any(|one| is_of_the_air(one, &catalogue)),
            sentence: found.sentence,
            effects: found.effects.into_iter().chain(found.sensor_or_timing).collect(),
            verdict: found.verdict,
        });
    }
    if alone.iter().any(|one| one.is_of_the_air) {
        diagnosis.sentence = format!("{}. Together: {}", sentence(&alone), diagnosis.sentence);
        diagnosis.alone = alone;
    }
    diagnosis.timing.total_s += (options.clock)() - start_s;
    Ok(())
}

/// True for what belongs to the air of a flight, not to the vehicle.
fn is_of_the_air(finding: &Finding, catalogue: &Catalogue) -> bool {
    let declaration = catalogue.find(&finding.instance.effect);
    declaration.is_some_and(|declaration| declaration.places.contains(&Place::Wind))
}

/// `… Alone, a1: rotor drag, k_d = …; constant wind, w_N = …. a2: …`.
fn sentence(alone: &[FlightAlone]) -> String {
    let told: Vec<String> = alone
        .iter()
        .map(|one| {
            let found: Vec<String> = one
                .effects
                .iter()
                .map(|finding| format!("{}, {}", in_sentence(&finding.label), parameters(finding)))
                .collect();
            let found = match (found.is_empty(), &one.verdict) {
                (true, Verdict::Agrees) => "nothing is missing".to_owned(),
                (true, _) => "not in the catalogue".to_owned(),
                (false, Verdict::PartlyMissing { .. } | Verdict::OutsideCatalogue) => {
                    format!("in part {}", found.join("; "))
                }
                (false, _) => found.join("; "),
            };
            format!("{}: {found}", one.log)
        })
        .collect();
    let has_each = if alone.iter().all(|one| one.is_of_the_air) {
        ", and these have one each"
    } else {
        ""
    };
    format!(
        "One wind is taken for all flights of a diagnosis{has_each}. Alone, {}",
        told.join(". ")
    )
}
