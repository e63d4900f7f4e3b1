//! Speeds of the rotors for order tracking: from ESC telemetry, or from duty and voltage with the scale that the
//! vibration shows.

use super::orders::{Comb, Shaken};
use crate::log::{FlightLog, names};
use crate::model::ModelVersion;
use crate::predict::noise::median;
use crate::predict::{PredictError, Predictor};
use std::f64::consts::TAU;

/// Slowest line that is looked for, Hz: below, a vehicle's own motion is as fast.
pub(super) const SLOWEST_HZ: f64 = 25.0;
/// Fastest that a sensor shows, in shares of its rate.
pub(super) const FASTEST: f64 = 0.45;
/// Neighbours of a scale with which it is compared, and scales that count as the same, in its logarithm.
const NEIGHBOURS: f64 = 0.25;
const SAME_SPEED: f64 = 0.016;
/// Blocks that are used in a search.
pub(super) const SEARCH_BLOCKS: usize = 40;
/// How far the power of the best scale must stand above the median of all, in median absolute deviations.
const LEAST_PEAK: f64 = 12.0;
/// Least part of the best scale's peak (in ln power) that a half or a third of it must have to be the speed.
const LEAST_SLOWER: f64 = 0.2;
/// A rotor's own scale relative to the common one: telemetry, and a thrust map from which each motor differs.
pub(super) const OWN_SCALE_TOLD: f64 = 0.003;
pub(super) const OWN_SCALE_FROM_DUTY: f64 = 0.04;

/// Speeds as measured, rad/s, rotor by rotor; `None` where a rotor has none.
pub(super) fn measured(log: &FlightLog) -> Option<Vec<Vec<f64>>> {
    let count = log.rotor_count();
    let columns: Vec<Vec<f64>> = (1..=count)
        .filter_map(|rotor| log.column(&names::rotor_speed(rotor)).map(<[f64]>::to_vec))
        .collect();
    let turning = |column: &Vec<f64>| column.iter().any(|speed| *speed > 0.0);
    (count > 0 && columns.len() == count && columns.iter().all(turning)).then_some(columns)
}

/// Speeds over their mean in the air, from the thrust that the model has from duty and voltage: Ω ∝ √f.
///
/// # Errors
/// The log cannot be compared with the model.
pub(super) fn from_thrust(
    log: &FlightLog,
    model: &ModelVersion,
    air: &[(f64, f64)],
) -> Result<Vec<Vec<f64>>, PredictError> {
    let predictor = Predictor::new(&model.documents(), &model.instances(), &model.catalogue()?, log)?;
    let mut speeds: Vec<Vec<f64>> = predictor.thrust_at(&log.time_s)?;
    for thrust in speeds.iter_mut().flatten() {
        *thrust = thrust.max(0.0).sqrt();
    }
    let mean = mean_in(&log.time_s, &speeds, air);
    for speed in speeds.iter_mut().flatten() {
        *speed /= mean;
    }
    Ok(speeds)
}

/// Mean of all rotors in the air.
pub(super) fn mean_in(time_s: &[f64], speeds: &[Vec<f64>], air: &[(f64, f64)]) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for (from, to) in air {
        let rows = time_s.partition_point(|t| t < from)..time_s.partition_point(|t| t < to);
        for speed in speeds.iter().flat_map(|s| &s[rows.clone()]).filter(|s| s.is_finite()) {
            sum += speed;
            count += 1.0;
        }
    }
    sum / count
}

/// The common scale, rad/s, at which the lines of rotors stand out most, for speeds that are known up to it; `None` if
/// none does.
///
/// Every scale is tried; its power is compared with the median of its neighbours, because vibration without a line
/// decreases with the frequency. Blades pass two or three times per turn, often louder than the imbalance: if a half or
/// a third of the best scale stands out as well, that is the speed.
pub(super) fn scale_of(shaken: &Shaken<'_>, rate_hz: f64) -> Option<f64> {
    let comb = Comb::between(TAU * SLOWEST_HZ, TAU * FASTEST * rate_hz);
    if comb.count < 2 {
        return None;
    }
    let scales: Vec<f64> = (0..comb.count).map(|k| comb.scale(k)).collect();
    let power: Vec<f64> = shaken
        .power_at(&comb, SEARCH_BLOCKS)
        .iter()
        .map(|p| p.max(f64::MIN_POSITIVE).ln())
        .collect();
    let over: Vec<f64> = (0..power.len())
        .map(|k| {
            let near = |other: usize| (scales[other] / scales[k]).ln().abs() < NEIGHBOURS;
            let mut neighbours: Vec<f64> = (0..power.len())
                .filter(|other| near(*other))
                .map(|other| power[other])
                .collect();
            power[k] - median(&mut neighbours)
        })
        .collect();
    let typical = median(&mut over.iter().map(|x| x.abs()).collect::<Vec<_>>()).max(1e-12);
    let peak_near = |scale: f64| {
        let near = (0..scales.len()).filter(|k| (scales[*k] / scale).ln().abs() < SAME_SPEED);
        near.max_by(|a, b| over[*a].total_cmp(&over[*b]))
            .filter(|k| over[*k] > LEAST_PEAK * typical)
    };
    let best = (0..scales.len()).max_by(|a, b| over[*a].total_cmp(&over[*b]))?;
    let best = peak_near(scales[best])?;
    let stands_out = |k: &usize| over[*k] > LEAST_SLOWER * over[best];
    let slower = [3.0, 2.0]
        .into_iter()
        .find_map(|blades| peak_near(scales[best] / blades).filter(stands_out));
    Some(scales[slower.unwrap_or(best)])
}
