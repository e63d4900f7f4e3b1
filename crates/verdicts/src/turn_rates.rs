//! Body rates in deg/s in a flight that hardly turns, where no motion stands out of the noise of the attitude.
//!
//! Over windows of T, level and with η = (roll, pitch, yaw),
//!
//! ```text
//!  η(t+T) − η(t) = k ∫ ω dt + noise of η        k = 1 in rad/s, π/180 in deg/s
//!  k̂ = Σ Δη ∫ω / Σ (∫ω)²    σ² = Σ (Δη − k̂ ∫ω)² / (n Σ (∫ω)²)      Δη, ∫ω less their means, over all axes
//! ```
//! Noise of ω makes k̂ smaller, so k̂ alone says nothing. Rates are said to be in deg/s if k̂ is that of deg/s within
//! [`TOLERANCE`] and [`SURE`] deviations from 0, which noise alone imitates only where it has just that power.
//!
//! Limits: tilted flight is left out (the import checks motion by itself); a flight whose attitude is all noise is
//! passed over in silence.

use rotortwin_twin::log::{FindingKind, FlightLog, GAP_FACTOR, names};
use std::f64::consts::PI;

/// Length of a window, s: the true motion grows with it faster than the integrated noise of the rates.
const WINDOW_S: f64 = 0.4;
/// Largest roll and pitch of a level flight, rad.
const LEVEL_RAD: f64 = 0.3;
/// Factor by which k̂ may differ from π/180.
const TOLERANCE: f64 = 1.25;
/// Least k̂ over its deviation.
const SURE: f64 = 8.0;
/// Fewest windows.
const FEWEST: usize = 50;

/// Evidence that the body rates are in deg/s, one sentence; `None` where there is none, or where the import found it.
pub(crate) fn in_degrees(log: &FlightLog) -> Option<String> {
    let is_known = |kind: FindingKind| log.report.findings.iter().any(|finding| finding.kind == kind);
    if is_known(FindingKind::RatesInDegrees) || is_known(FindingKind::AnglesInDegrees) {
        return None;
    }
    let (attitude, rates) = (log.vector(names::ATTITUDE)?, log.vector(names::RATES)?);
    let rate_hz = log.sample_rate_hz();
    let rows = (WINDOW_S * rate_hz).round().max(2.0) as usize;
    let longest_s = WINDOW_S * GAP_FACTOR;
    let level = |row: usize| attitude[0][row].abs() < LEVEL_RAD && attitude[1][row].abs() < LEVEL_RAD;
    let mut pairs: Vec<[[f64; 2]; 3]> = Vec::new();
    for first in (0..log.time_s.len().saturating_sub(rows)).step_by(rows) {
        let last = first + rows;
        if !level(first) || !level(last) || log.time_s[last] - log.time_s[first] > longest_s {
            continue;
        }
        let pair: [[f64; 2]; 3] = std::array::from_fn(|axis| {
            let turn = wrapped(attitude[axis][last] - attitude[axis][first]);
            let steps = first..last;
            let integral = steps
                .map(|row| 0.5 * (rates[axis][row] + rates[axis][row + 1]) * (log.time_s[row + 1] - log.time_s[row]));
            [turn, integral.sum()]
        });
        if pair.as_flattened().iter().all(|value| value.is_finite()) {
            pairs.push(pair);
        }
    }
    if pairs.len() < FEWEST {
        return None;
    }
    let [gain, deviation] = gain_of(&pairs);
    let degree = PI / 180.0;
    let is_degree = (degree / TOLERANCE..degree * TOLERANCE).contains(&gain) && gain > SURE * deviation;
    is_degree.then(|| {
        format!(
            "{}: the attitude turns by {:.4} ± {:.4} of what the body rates say, π/180 = {degree:.4}: they are in deg/s, expected rad/s (a mapping for \
             'rotortwin log import' converts them)",
            FindingKind::RatesInDegrees,
            gain,
            1.96 * deviation
        )
    })
}

/// k̂ and its standard deviation.
fn gain_of(pairs: &[[[f64; 2]; 3]]) -> [f64; 2] {
    let count = pairs.len() as f64;
    let [mut turn_turn, mut turn_rate, mut rate_rate] = [0.0; 3];
    for axis in 0..3 {
        let means = [0, 1].map(|side| pairs.iter().map(|pair| pair[axis][side]).sum::<f64>() / count);
        for pair in pairs {
            let [turn, rate] = [0, 1].map(|side| pair[axis][side] - means[side]);
            turn_turn += turn * turn;
            turn_rate += turn * rate;
            rate_rate += rate * rate;
        }
    }
    let gain = turn_rate / rate_rate.max(f64::MIN_POSITIVE);
    let left = (turn_turn - gain * turn_rate).max(0.0);
    [gain, (left / (3.0 * count * rate_rate).max(f64::MIN_POSITIVE)).sqrt()]
}

/// An angle in [−π, π).
fn wrapped(angle: f64) -> f64 {
    (angle + PI).rem_euclid(2.0 * PI) - PI
}
