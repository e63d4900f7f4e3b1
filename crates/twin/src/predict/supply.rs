//! The voltage that drives the rotors of the model, where its readings are too coarse to be taken one by one.
//!
//! Eq. 19 makes thrust of every reading of the voltage. Errors of the readings then are errors of the predicted thrust,
//! and of the sensitivity to everything that acts through the voltage: errors in variables, which invent an exponent of
//! the voltage or a resistance. Steps of 0.1 V, as many autopilots log them, or 10 Hz do so within one flight.
//!
//! ```text
//! V = ⟨V + R I⟩ − R I,   I = k_P Σ f^1.5/V of the model,   R = −Σ v i/Σ i² of what is faster than the mean ⟨⟩
//! ```
//! What is slow, the charge, is a mean of many readings; what is fast is the sag under the model's current, with the
//! resistance that the readings show. The voltage channel still compares single readings.

use super::noise::{median, white_deviation};
use super::series::{Drive, Series};
use crate::log::running_mean;
use rotortwin_plant::effects::Constants;

/// d ln f/d ln V of Eq. 19 for an ordinary thrust curve.
const TYPICAL_EXPONENT: f64 = 1.5;
/// Error of the thrust by single readings over the noise of the specific force, from which they are too coarse.
const COARSE: f64 = 0.7;
/// Half the length of either of the two means of ⟨⟩, s.
const HALF_S: f64 = 0.5;
/// Mean time for which a coarse reading holds, from which its steps say more than means over it, s.
const LONG_S: f64 = 0.5;
/// What remains of the error of a coarse reading between its steps.
const BETWEEN_STEPS: f64 = 0.3;
/// Largest resistance, over that of the model.
const MOST_RESISTANCE: f64 = 3.0;
/// Least current that varies, over the mean, for the readings to show the resistance.
const LEAST_VARIATION: f64 = 0.02;

/// Readings of a voltage: their noise, and how many rows in a row share one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Readings {
    /// Step between the values, V; 0 if they do not repeat.
    quantum: f64,
    /// Neighbouring rows with the same value, on average.
    rows: f64,
    /// Deviation of a reading besides, V, and of a row, with what rows between two readings miss.
    white: f64,
    row: f64,
    /// Rows that share a reading of a slower stream.
    held_rows: f64,
}

impl Readings {
    /// Of a log; a quantum is the usual step between neighbours in the sorted values, if values repeat.
    pub(crate) fn of(series: &Series) -> Self {
        let (quantum, rows) = quantum_of(&series.voltage);
        let white = white_deviation(&series.voltage);
        Self {
            quantum,
            rows,
            white: if series.slow.voltage > 0.0 {
                series.slow.voltage_reading
            } else {
                white
            },
            row: white.max(series.slow.voltage_row),
            held_rows: series.slow.voltage_rows.max(1.0),
        }
    }

    /// The readings are coarser than their noise, or those of a slower stream: their errors persist.
    pub(crate) fn persist(&self) -> bool {
        self.quantum > 0.0 || self.held_rows > 1.0
    }

    /// Error of a reading, V, as white noise of every row that is as large in means over many rows: of a quantum q/√12,
    /// for as long as a reading persists.
    pub(crate) fn deviation(&self) -> f64 {
        self.of_quantum().max(self.row * self.held_rows.sqrt())
    }

    /// A coarse reading holds for so long that its steps say more than means over it.
    fn hold_long(&self, step_s: f64) -> bool {
        self.rows * step_s > LONG_S
    }

    fn of_quantum(&self) -> f64 {
        self.quantum * (self.rows / 12.0).sqrt()
    }

    /// Error of the specific force by Eq. 19 with [`smoothed`] readings, m/s², as white noise of every row; `None` if
    /// single readings are good enough. A mean over n readings has 1/√n of their error, and keeps it for as long.
    ///
    /// * `accel_m_s2`: noise of the specific force
    pub(crate) fn coarse_error(&self, series: &Series, accel_m_s2: f64, c: &Constants) -> Option<f64> {
        if series.drive != Drive::Duty || series.voltage.is_empty() {
            return None;
        }
        let of_force = |volts: f64| TYPICAL_EXPONENT * c.gravity_m_s2 * volts / mean(&series.voltage);
        let long = (1.0 / series.step_s).min(self.rows);
        let of_quantum = if self.hold_long(series.step_s) {
            BETWEEN_STEPS * self.quantum * (long / 12.0).sqrt()
        } else {
            self.of_quantum()
        };
        let left = of_force(of_quantum.max(self.white * self.held_rows.sqrt()));
        // What the voltage did between two readings of a slower stream is not in the log.
        let coarse = self.held_rows > 1.0 || of_force(self.deviation()) > COARSE * accel_m_s2;
        (left.is_finite() && coarse).then_some(left)
    }
}

/// Step between the values of a column, 0 if they do not repeat, and neighbouring rows with the same value.
fn quantum_of(voltage: &[f64]) -> (f64, f64) {
    /// Rows to a value from which values repeat because of a quantum.
    const REPEATED: usize = 20;
    let mut sorted: Vec<f64> = voltage.iter().copied().filter(|v| v.is_finite()).collect();
    let count = sorted.len();
    let changes = voltage.windows(2).filter(|pair| pair[1] != pair[0]).count();
    sorted.sort_by(f64::total_cmp);
    sorted.dedup_by(|a, b| (*a - *b).abs() < 1e-6);
    let repeat = sorted.len() > 1 && sorted.len() * REPEATED < count;
    let quantum = if repeat {
        median(&mut sorted.windows(2).map(|pair| pair[1] - pair[0]).collect::<Vec<f64>>())
    } else {
        0.0
    };
    (quantum, count as f64 / (changes + 1) as f64)
}

fn mean(values: &[f64]) -> f64 {
    let finite = || values.iter().copied().filter(|v| v.is_finite());
    finite().sum::<f64>() / finite().count().max(1) as f64
}

/// The voltage of Eq. 19, V by row, of coarse readings.
///
/// * `thrust`: of every rotor by the readings themselves, N: `k * rotors + i`
pub(crate) fn smoothed(series: &Series, readings: &Readings, c: &Constants, thrust: &[f64]) -> Vec<f64> {
    let voltage = &series.voltage;
    let mean = mean(voltage);
    let current: Vec<f64> = thrust
        .chunks(series.rotors)
        .map(|rotors| c.power_coefficient_w_per_n15 * rotors.iter().map(|f| f.max(0.0).powf(1.5)).sum::<f64>() / mean)
        .collect();
    let half = (HALF_S / series.step_s).round().max(1.0) as usize;
    let slow = |values: &[f64]| running_mean(&running_mean(values, half), half);
    let fast = |values: &[f64]| -> Vec<f64> {
        values
            .iter()
            .zip(slow(values))
            .map(|(value, slow)| value - slow)
            .collect()
    };
    let (mut ii, mut vi, mut count) = (0.0, 0.0, 0.0);
    for (k, (v, i)) in fast(voltage).into_iter().zip(fast(&current)).enumerate() {
        let time = series.time(k);
        if v.is_finite() && series.air.iter().any(|(from, to)| (*from..=*to).contains(&time)) {
            ii += i * i;
            vi += v * i;
            count += 1.0;
        }
    }
    let usual = current.iter().sum::<f64>() / current.len() as f64;
    let nominal = c.internal_resistance_ohm;
    let resistance = if count > 0.0 && (ii / count).sqrt() > LEAST_VARIATION * usual {
        (-vi / ii).clamp(0.0, MOST_RESISTANCE * nominal)
    } else {
        nominal
    };
    let by_steps = if readings.quantum > 0.0 && readings.hold_long(series.step_s) {
        between_steps(voltage, &current, resistance)
    } else {
        None
    };
    let open = by_steps.unwrap_or_else(|| voltage.iter().zip(&current).map(|(v, i)| v + resistance * i).collect());
    let open = slow(&open);
    let driving = open.iter().zip(&current).zip(voltage);
    // A gap stays one.
    driving
        .map(|((open, i), v)| if v.is_finite() { open - resistance * i } else { f64::NAN })
        .collect()
}

/// V + R I from readings that hold a value for long: where they step, the voltage is midway between the two values, and
/// between the steps a line is nearer than either; `None` with too few steps.
fn between_steps(voltage: &[f64], current: &[f64], resistance: f64) -> Option<Vec<f64>> {
    const FEWEST: usize = 4;
    let steps: Vec<(usize, f64)> = (1..voltage.len())
        .filter(|&k| voltage[k] != voltage[k - 1] && (voltage[k] - voltage[k - 1]).is_finite())
        .map(|k| {
            (
                k,
                0.5 * (voltage[k] + voltage[k - 1] + resistance * (current[k] + current[k - 1])),
            )
        })
        .collect();
    if steps.len() < FEWEST {
        return None;
    }
    let mut next = 0;
    let open = (0..voltage.len()).map(|k| {
        while next < steps.len() && steps[next].0 <= k {
            next += 1;
        }
        match (next.checked_sub(1).map(|before| steps[before]), steps.get(next)) {
            (Some((from, a)), Some(&(to, b))) => a + (b - a) * (k - from) as f64 / (to - from) as f64,
            (Some((_, value)), None) | (None, Some(&(_, value))) => value,
            (None, None) => voltage[k],
        }
    });
    Some(open.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_a_quantum_is_the_step_of_the_readings_and_fine_readings_have_none() {
        let at = |k: i32| 11.4 - 0.0005 * f64::from(k) + 0.15 * (0.05 * f64::from(k)).sin();
        let coarse: Vec<f64> = (0..2000).map(|k| (10.0 * at(k)).round() / 10.0).collect();
        let (quantum, rows) = quantum_of(&coarse);
        assert!((quantum - 0.1).abs() < 1e-6 && rows > 5.0, "{quantum} {rows}");
        // Between its steps the voltage is known to a small part of the quantum.
        let still = vec![0.0; coarse.len()];
        let open = between_steps(&coarse, &still, 0.02).expect("there are steps");
        let square: f64 = (40..1950).map(|k| (open[k as usize] - at(k)).powi(2)).sum();
        let error = (square / 1910.0).sqrt();
        assert!(error < 0.4 * 0.1, "{error}");
        let fine: Vec<f64> = (0..2000).map(at).collect();
        assert_eq!(quantum_of(&fine).0, 0.0);
    }
}
