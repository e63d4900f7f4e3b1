//! What duties do to the turn rates: changes of both from window to window.
//!
//! Duties go through the rotors' lag, then both sides are taken over windows of T and differenced, which removes trim and slow torques:
//!
//! ```text
//! Δ(ω(t+T) − ω(t))  ~  Σ_i arm_i Δ(mean duty_i over T)        per axis
//! ```

use super::kinematics::mean;
use crate::log::resample::usual_rate_hz;
use crate::log::{FlightLog, names};

/// Length of a window, s.
const WINDOW_S: f64 = 0.08;
/// A window has at least this many rows.
const FEWEST_ROWS: usize = 4;

/// Changes from a window to the next one, for each pair of neighbours whose rows have values.
pub struct TurnChanges {
    /// Of the mean duty behind the lag, by rotor; where the log has no duty, of the squared speed.
    pub duty: Vec<Vec<f64>>,
    /// Of the difference of the turn rates between end and start of a window, by axis, rad/s.
    pub turn: Vec<[f64; 3]>,
}

impl FlightLog {
    /// Changes from window to window of the duties and of what they turn; `None`: a column is missing.
    ///
    /// * `lag_s`: of the rotors
    pub fn turn_changes(&self, lag_s: f64) -> Option<TurnChanges> {
        let rates = self.vector(names::RATES)?;
        let rate_hz = usual_rate_hz(&self.time_s);
        let rows = FEWEST_ROWS.max((WINDOW_S * rate_hz).round() as usize);
        let speeds: Vec<Vec<f64>>;
        let mut duties = self.duties();
        let mut share = 1.0 - (-1.0 / (rate_hz * lag_s)).exp();
        if duties.is_empty() {
            // Measured speeds include the lag; their squares are proportional to the thrusts.
            speeds = (1..=self.rotor_count())
                .map(|rotor| self.column(&names::rotor_speed(rotor)))
                .map(|speed| Some(speed?.iter().map(|speed| speed * speed).collect()))
                .collect::<Option<_>>()?;
            duties = speeds.iter().map(Vec::as_slice).collect();
            share = 1.0;
        }
        let lagged: Vec<Vec<f64>> = duties.iter().map(|duty| lagged(duty, share)).collect();
        let mut windows: Vec<(Vec<f64>, [f64; 3])> = Vec::new();
        let mut first = 0;
        while first + rows < self.time_s.len() {
            let last = first + rows;
            let input = lagged.iter().map(|duty| mean(&duty[first..last])).collect();
            windows.push((input, [0, 1, 2].map(|axis| rates[axis][last] - rates[axis][first])));
            first = last;
        }
        let mut changes = TurnChanges {
            duty: Vec::new(),
            turn: Vec::new(),
        };
        for pair in windows.windows(2) {
            let [before, after] = [&pair[0], &pair[1]];
            let duty: Vec<f64> = after.0.iter().zip(&before.0).map(|(now, then)| now - then).collect();
            let turn = [0, 1, 2].map(|axis| after.1[axis] - before.1[axis]);
            if duty.iter().chain(&turn).all(|value| value.is_finite()) {
                changes.duty.push(duty);
                changes.turn.push(turn);
            }
        }
        Some(changes)
    }
}

/// Through a first-order lag; a row without a value changes nothing.
fn lagged(duty: &[f64], share: f64) -> Vec<f64> {
    let mut state = duty.iter().copied().find(|value| value.is_finite()).unwrap_or(0.0);
    duty.iter()
        .map(|value| {
            let now = state;
            if value.is_finite() {
                state += share * (value - state);
            }
            now
        })
        .collect()
}
