//! Lagged thrust of the rotors over one part of a flight.

use std::ops::Range;

use super::curve::Curve;
use super::grid::Grid;

/// Thrust of one rotor over mass, m/s², for the rows of a part.
#[derive(Debug, Clone, Default)]
pub(crate) struct Lagged {
    /// At the row.
    pub(crate) at: Vec<f64>,
    /// Mean from the row to the next.
    pub(crate) mean: Vec<f64>,
}

/// f' = (T(u(t − d), V) − f)/τ, exact for a duty that is held over a step.
///
/// * `delay_s` may be negative by less than a step.
pub(crate) fn lagged(
    grid: &Grid,
    part: &Range<usize>,
    rotor: usize,
    curve: &Curve,
    lag_s: f64,
    delay_s: f64,
) -> Lagged {
    let step = grid.step_s;
    let whole = (delay_s / step).floor();
    let late_s = delay_s - whole * step;
    let shift = whole as i64;
    let duty = &grid.duty[rotor];
    let static_thrust = |row: i64| -> f64 {
        let row = row.clamp(part.start as i64, grid.rows as i64 - 1) as usize;
        let volts = grid.voltage.as_ref().map_or(f64::NAN, |v| v[row]);
        curve.hover * curve.shape(duty[row]) * curve.voltage_factor(volts)
    };
    let decay = |seconds: f64| (-seconds / lag_s).exp();
    let (first, second) = (decay(late_s), decay(step - late_s));
    // Integral of the lag's response over a span h: T h + (f − T) τ (1 − e^(−h/τ)).
    let mut before = static_thrust(part.start as i64 - shift - 1);
    let mut thrust = before;
    let mut out = Lagged {
        at: Vec::with_capacity(part.len()),
        mean: Vec::with_capacity(part.len()),
    };
    for row in part.clone() {
        let held = static_thrust(row as i64 - shift);
        out.at.push(thrust);
        let mut area = before * late_s + (thrust - before) * lag_s * (1.0 - first);
        thrust = before + (thrust - before) * first;
        area += held * (step - late_s) + (thrust - held) * lag_s * (1.0 - second);
        thrust = held + (thrust - held) * second;
        out.mean.push(area / step);
        before = held;
    }
    out
}
