//! Several flights in different winds.
//!
//! A diagnosis of several logs takes one vehicle and one wind for all of them. Outdoors each flight has a wind of its own, so that together
//! nothing explains their forces. Where that is the answer, the flights are diagnosed once more, the steady wind of each fitted with its
//! other nuisances. That answer stands if it is a whole one, and differs from the first by nothing else: so there are these winds.

use rotortwin_plant::effects::{Catalogue, EffectClass, Place};

use super::result::{Diagnosis, FlightWind, Verdict};
use super::{Options, diagnose_by, words};
use crate::estimation::normal::Posterior;
use crate::estimation::parameters::{FittedParameter, QUANTILE_95};
use crate::estimation::problem::Problem;
use crate::log::FlightLog;
use crate::model::ModelVersion;
use crate::predict::PredictError;

/// Deviations by which a wind of one flight must differ from that of another.
const APART: f64 = 5.0;
/// Names and symbols of the components, as row 4 of the catalogue has them.
const COMPONENTS: [(&str, &str); 2] = [("north_m_s", "w_N"), ("east_m_s", "w_E")];

/// The diagnosis with a wind of each flight's own in place of one that has no explanation, if that explains the flights.
pub(super) fn in_winds_of_their_own(
    found: Diagnosis,
    logs: &[FlightLog],
    model: &ModelVersion,
    options: &Options<'_>,
) -> Result<Diagnosis, PredictError> {
    let is_open = matches!(found.verdict, Verdict::OutsideCatalogue | Verdict::PartlyMissing { .. });
    let left_s = options.time_limit_s - found.timing.total_s;
    if !is_open || logs.len() < 2 || model.wind_of_each_flight || left_s <= 0.0 {
        return Ok(found);
    }
    let progress = |text: &str, share: f64| {
        // The share of the whole search never falls.
        (options.progress)(
            &format!("each flight in a wind of its own: {text}"),
            0.99 + 0.01 * share,
        );
    };
    let in_winds = Options {
        effects: options.effects.clone(),
        baseline: Vec::new(),
        most_effects: options.most_effects,
        progress: &progress,
        clock: options.clock,
        time_limit_s: left_s,
    };
    let catalogue = model.with_documents(&options.effects).catalogue()?;
    let mut again = diagnose_by(logs, &model.with_own_winds(), &in_winds)?;
    let total_s = found.timing.total_s + again.timing.total_s;
    let is_whole = matches!(again.verdict, Verdict::Agrees | Verdict::Missing { .. });
    if !is_whole || !differ(&again.winds) {
        let mut found = found;
        found.timing.total_s = total_s;
        return Ok(found);
    }
    if again.verdict == Verdict::Agrees {
        again.verdict = Verdict::Missing {
            effects: steady_wind(&catalogue),
        };
        words::render(&mut again);
    }
    again.model = found.model;
    again.trim = found.trim;
    again.timing.total_s = total_s;
    Ok(again)
}

/// Winds of the flights of a problem, by their posterior.
pub(super) fn winds(problem: &Problem, posterior: &Posterior) -> Vec<FlightWind> {
    let logs = problem.logs.iter().enumerate();
    logs.filter(|(_, log)| log.predictor.has_own_wind())
        .map(|(l, log)| FlightWind {
            log: log.predictor.name.clone(),
            parameters: (log.charge_place() + 1..log.nuisance_count())
                .zip(COMPONENTS)
                .map(|(which, (name, symbol))| {
                    let (place, size) = (problem.global(l, which), log.nuisance_size(which));
                    let deviation = size * posterior.covariance.at(place, place).max(0.0).sqrt();
                    let (low, high) = log.nuisance_bounds(which);
                    let value = log.nuisance(which) + size * log.nuisance_step(which, posterior.mean[place]);
                    FittedParameter {
                        name: name.to_owned(),
                        symbol: symbol.to_owned(),
                        unit: "m/s".to_owned(),
                        value,
                        deviation,
                        interval_95: QUANTILE_95 * deviation,
                        plausible: low < value && value < high,
                    }
                })
                .collect(),
        })
        .collect()
}

/// True if two flights have different winds.
fn differ(winds: &[FlightWind]) -> bool {
    let apart =
        |a: &FittedParameter, b: &FittedParameter| (a.value - b.value).abs() > APART * a.deviation.hypot(b.deviation);
    winds.iter().enumerate().any(|(i, one)| {
        let others = winds[..i].iter();
        others
            .flat_map(|other| one.parameters.iter().zip(&other.parameters))
            .any(|(a, b)| apart(a, b))
    })
}

/// Ids of the effects that are a wind of all flights.
fn steady_wind(catalogue: &Catalogue) -> Vec<String> {
    let entries = catalogue.entries().iter();
    let winds = entries.filter(|entry| entry.class == EffectClass::Physics && entry.places == [Place::Wind]);
    winds.map(|entry| entry.id.to_owned()).collect()
}

/// ` Each flight has a wind of its own: a1 w_N = …, w_E = …; a2 ….`, as the next sentence of a verdict.
pub(super) fn sentence(winds: &[FlightWind]) -> String {
    if winds.is_empty() {
        return String::new();
    }
    let told: Vec<String> = winds
        .iter()
        .map(|one| {
            let values: Vec<String> = one.parameters.iter().map(words::parameter).collect();
            format!("{} {}", one.log, values.join(", "))
        })
        .collect();
    format!(" Each flight has a wind of its own: {}.", told.join("; "))
}
