//! Several flights in different winds.
//!
//! A diagnosis of several logs takes one vehicle and one wind for all of them. Outdoors each flight has a wind of its own, so that together
//! nothing explains their forces. Where that is the answer, the flights are diagnosed once more, the steady wind of each fitted with its
//! other nuisances. That answer stands if it is a whole one, and differs from the first by nothing else: so there are these winds.

use super::result::{Diagnosis, FlightWind, Verdict};
use super::{Options, search_by, words};
use crate::estimation::columns::LogState;
use crate::estimation::normal::Posterior;
use crate::estimation::parameters::{FittedParameter, QUANTILE_95};
use crate::estimation::problem::Problem;
use crate::log::FlightLog;
use crate::model::{ModelVersion, steady_wind};
use crate::predict::PredictError;
use crate::predict::channels::{F, M};

/// Deviations by which a wind of one flight must differ from that of another.
const APART: f64 = 5.0;
/// Length of the mean of the unit vectors along the heading from which a flight turns too little: a standard deviation of 14°.
const TURNS_TOO_LITTLE: f64 = 0.97;
/// Share of the progress that the search in one wind has, where one in the winds of the flights may follow.
const FIRST_SEARCH: f64 = 0.6;

/// The search, and where it ends without an explanation of several flights, that with a wind of each flight's own, if that explains them.
pub(super) fn diagnose_in_winds(
    logs: &[FlightLog],
    model: &ModelVersion,
    options: &Options<'_>,
) -> Result<Diagnosis, PredictError> {
    if logs.len() < 2 || model.wind_of_each_flight {
        return search_by(logs, model, options);
    }
    let start = (options.clock)();
    let first = |text: &str, share: f64| (options.progress)(text, FIRST_SEARCH * share);
    let mut found = search_by(logs, model, &part(options, &first, options.time_limit_s))?;
    let is_open = matches!(found.verdict, Verdict::OutsideCatalogue | Verdict::PartlyMissing { .. });
    let left_s = options.time_limit_s - ((options.clock)() - start);
    if !is_open || left_s <= 0.0 {
        return Ok(found);
    }
    let second = |text: &str, share: f64| {
        let text = format!("each flight in a wind of its own: {text}");
        (options.progress)(&text, FIRST_SEARCH + (1.0 - FIRST_SEARCH) * share);
    };
    let in_winds = match search_by(logs, &model.with_own_winds(), &part(options, &second, left_s)) {
        Ok(in_winds) => in_winds,
        // What the flights say in one wind is not lost for it.
        Err(refused) => {
            found
                .notes
                .push(format!("not tried with a wind of each flight's own: {refused}"));
            return Ok(found);
        }
    };
    let is_whole = matches!(in_winds.verdict, Verdict::Agrees | Verdict::Missing { .. });
    if !is_whole || in_winds.stopped_at_s.is_some() || !are_proved(&in_winds.winds) {
        return Ok(found);
    }
    let mut found = in_winds;
    if found.verdict == Verdict::Agrees {
        let catalogue = model.with_documents(&options.effects).catalogue()?;
        let wind = steady_wind(&catalogue).map(|wind| wind.id.to_owned());
        found.verdict = Verdict::Missing {
            effects: wind.into_iter().collect(),
        };
        words::render(&mut found);
    }
    Ok(found)
}

/// The options of one of the two searches.
fn part<'a>(options: &Options<'a>, progress: &'a (dyn Fn(&str, f64) + Sync), time_limit_s: f64) -> Options<'a> {
    Options {
        effects: options.effects.clone(),
        baseline: Vec::new(),
        most_effects: options.most_effects,
        progress,
        clock: options.clock,
        time_limit_s,
    }
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
