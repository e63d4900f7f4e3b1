//! Several flights in different winds.
//!
//! A diagnosis of several logs takes one vehicle and one wind for all of them. Outdoors each flight has a wind of its own, so that together
//! nothing explains their forces. Where that is the answer, the flights are diagnosed once more, the steady wind of each fitted with its
//! other nuisances. That answer stands if it is a whole one, and differs from the first by nothing else: so there are these winds.

use super::result::{Diagnosis, FlightWind, Verdict};
use super::words;
use crate::estimation::columns::LogState;
use crate::estimation::normal::Posterior;
use crate::estimation::parameters::FittedParameter;
use crate::estimation::parameters::QUANTILE_95;
use crate::estimation::problem::Problem;
use crate::model::{ModelVersion, steady_wind};
use crate::predict::PredictError;
use crate::predict::channels::{F, M};

/// Deviations by which a wind of one flight must differ from that of another.
const APART: f64 = 5.0;
/// Length of the mean of the unit vectors along the heading from which a flight turns too little: a standard deviation of 14°.
const TURNS_TOO_LITTLE: f64 = 0.97;

/// The answer of a search by the model with a wind of each flight, if it is a whole one.
///
/// # Errors
/// The effects of the model are not valid.
pub(super) fn accepted(mut found: Diagnosis, model: &ModelVersion) -> Result<Option<Diagnosis>, PredictError> {
    let is_whole = matches!(found.verdict, Verdict::Agrees | Verdict::Missing { .. });
    if !is_whole || found.stopped_at_s.is_some() || !are_proved(&found.winds) {
        return Ok(None);
    }
    if found.verdict == Verdict::Agrees {
        let wind = steady_wind(&model.catalogue()?).map(|wind| wind.id.to_owned());
        found.verdict = Verdict::Missing {
            effects: wind.into_iter().collect(),
        };
        words::render(&mut found);
    }
    Ok(Some(found))
}

/// Winds of the flights of a problem, by their posterior.
pub(super) fn winds(problem: &Problem, posterior: &Posterior) -> Vec<FlightWind> {
    let flights = problem.logs.iter().enumerate();
    flights
        .filter(|(_, log)| log.predictor.has_own_wind())
        .map(|(l, log)| {
            let components = steady_wind(log.predictor.catalogue()).map_or(&[][..], |wind| wind.parameters);
            FlightWind {
                log: log.predictor.name.clone(),
                distinguished: turns(log),
                parameters: (log.charge_place() + 1..log.nuisance_count())
                    .zip(components)
                    .map(|(which, component)| {
                        let (place, size) = (problem.global(l, which), log.nuisance_size(which));
                        let deviation = size * posterior.covariance.at(place, place).max(0.0).sqrt();
                        let (low, high) = log.nuisance_bounds(which);
                        let value = log.nuisance(which) + size * log.nuisance_step(which, posterior.mean[place]);
                        FittedParameter {
                            name: component.name.to_owned(),
                            symbol: component.symbol.to_owned(),
                            unit: component.unit.to_owned(),
                            value,
                            deviation,
                            interval_95: QUANTILE_95 * deviation,
                            plausible: low < value && value < high,
                        }
                    })
                    .collect(),
            }
        })
        .collect()
}

/// True if the heading of a flight changes far enough to tell what turns with the vehicle from what does not.
fn turns(log: &LogState) -> bool {
    let Some(force) = (F..M).find_map(|channel| log.predictor.whitener(channel)) else {
        return false;
    };
    let attitude = log.predictor.series().smooth.attitude.iter().enumerate();
    let headings = attitude
        .filter(|(k, _)| force.counts(*k))
        .map(|(_, attitude)| attitude[2]);
    let (sum, count) = headings.fold(([0.0, 0.0], 0.0), |([north, east], count), yaw| {
        ([north + libm::cos(yaw), east + libm::sin(yaw)], count + 1.0)
    });
    libm::hypot(sum[0], sum[1]) < TURNS_TOO_LITTLE * count
}

/// True if two flights have different winds, and none is beyond all winds.
fn are_proved(winds: &[FlightWind]) -> bool {
    let apart =
        |a: &FittedParameter, b: &FittedParameter| (a.value - b.value).abs() > APART * a.deviation.hypot(b.deviation);
    let differ = winds.iter().enumerate().any(|(i, one)| {
        let others = winds[..i].iter();
        others
            .flat_map(|other| one.parameters.iter().zip(&other.parameters))
            .any(|(a, b)| apart(a, b))
    });
    differ
        && winds
            .iter()
            .flat_map(|one| &one.parameters)
            .all(|parameter| parameter.plausible)
}
