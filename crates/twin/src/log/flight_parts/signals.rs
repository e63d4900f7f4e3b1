//! The log in bins of 0.04 s: the signals that distinguish flight from ground.

use rotortwin_flight_core::MAX_ROTORS;

use super::super::{FlightLog, names};

/// Length of a bin, s; longer where the log's rows are further apart.
const BIN_S: f64 = 0.04;
/// Rows further apart than this, and than [`BREAK_ROWS`] ordinary ones, are not of one run, s.
pub(super) const BREAK_S: f64 = 1.0;
/// Telemetry comes at 1 Hz, late, or not at all: this many ordinary intervals are not a gap in a flight.
const BREAK_ROWS: f64 = 8.0;
/// Largest mean output of which no vehicle flies: DShot idles at up to 0.07.
pub(super) const IDLES: f64 = 0.08;
/// An output that varies less than this is not a motor.
const MOVES: f64 = 0.01;

/// Means over bins; a bin without a value has NaN.
#[derive(Debug, Clone, Default)]
pub(super) struct Signals {
    /// Median of the rows, Hz.
    pub(super) rate_hz: f64,
    /// Of the first row of each bin, s.
    pub(super) start_s: Vec<f64>,
    /// Up to where it reaches, s.
    pub(super) end_s: Vec<f64>,
    /// Number of each output in `duty`, from 1.
    pub(super) outputs: Vec<usize>,
    /// By output, then bin.
    pub(super) duty: Vec<Vec<f64>>,
    /// Mean of the outputs, or a substitute for it: 0 to 1.
    pub(super) effort: Option<Vec<f64>>,
    /// Specific force upwards along the body, m/s².
    pub(super) force: Option<Vec<f64>>,
    /// Size of the specific force, m/s².
    pub(super) shock: Option<Vec<f64>>,
    /// Rate at which it was measured, Hz; 0 where too little of it is new.
    pub(super) shock_hz: f64,
    /// All three axes of it are there.
    pub(super) has_all_forces: bool,
    /// Angle between the body's z and the vertical, rad.
    pub(super) tilt: Option<Vec<f64>>,
    /// Roll and pitch, rad.
    pub(super) lean: Option<[Vec<f64>; 2]>,
    /// Body rates, rad/s.
    pub(super) rates: Option<[Vec<f64>; 3]>,
    /// Upwards, m.
    pub(super) height: Option<Vec<f64>>,
    /// Names of the available signals.
    pub(super) sources: Vec<&'static str>,
}

/// The longest distance of two rows of one run, s.
fn break_s(rate_hz: f64) -> f64 {
    if rate_hz > 0.0 {
        BREAK_S.max(BREAK_ROWS / rate_hz)
    } else {
        BREAK_S
    }
}

impl Signals {
    pub(super) fn of(log: &FlightLog) -> Self {
        let time = &log.time_s;
        let rate_hz = log.sample_rate_hz();
        let longest = if rate_hz > 0.0 { BIN_S.max(1.0 / rate_hz) } else { BIN_S };
        let break_s = break_s(rate_hz);
        // Rows of each bin: neighbours within its length.
        let mut bins: Vec<std::ops::Range<usize>> = Vec::new();
        let mut first = 0;
        for row in 1..=time.len() {
            if row == time.len() || time[row] - time[first] > longest - 0.25 / rate_hz.max(1.0) {
                bins.push(first..row);
                first = row;
            }
        }
        let start_s: Vec<f64> = bins.iter().map(|bin| time[bin.start]).collect();
        let last_s = time.last().copied().unwrap_or(0.0);
        let end_s = bins
            .iter()
            .map(|bin| {
                let next = time.get(bin.end).copied().unwrap_or(last_s);
                if next - time[bin.end - 1] > break_s {
                    time[bin.end - 1]
                } else {
                    next
                }
            })
            .collect();
        let mean = |value: &dyn Fn(usize) -> f64| -> Vec<f64> {
            bins.iter()
                .map(|bin| {
                    let (mut sum, mut count) = (0.0, 0.0);
                    for value in bin.clone().map(value).filter(|value| value.is_finite()) {
                        sum += value;
                        count += 1.0;
                    }
                    sum / count
                })
                .collect()
        };
        let column = |name: &str| log.column(name).map(|values| mean(&|row| values[row]));
        let mut signals = Self {
            rate_hz,
            start_s,
            end_s,
            ..Self::default()
        };
        for output in motors(log) {
            if let Some(duty) = column(&names::duty(output)) {
                signals.outputs.push(output);
                signals.duty.push(duty);
            }
        }
        signals.effort = signals.effort(log, &column);
        if let Some(z) = log.column(names::ACCEL[2]) {
            signals.force = Some(mean(&|row| -z[row]));
            let [x, y] = [0, 1].map(|axis| log.column(names::ACCEL[axis]));
            let of = |values: Option<&[f64]>| values.map(|values| mean(&|row| values[row]));
            let flat = [of(x), of(y)];
            signals.has_all_forces = flat.iter().all(Option::is_some);
            let up = signals.force.clone().unwrap_or_default();
            let part = |axis: usize, bin: usize| flat[axis].as_ref().map_or(0.0, |values| values[bin]);
            signals.shock = Some(
                (0..up.len())
                    .map(|bin| (up[bin].powi(2) + part(0, bin).powi(2) + part(1, bin).powi(2)).sqrt())
                    .collect(),
            );
            signals.shock_hz = log.source_rate(names::ACCEL[2]).map_or(0.0, |rate| rate.source_hz);
            signals.sources.push("accelerometer");
        }
        if let [Some(roll), Some(pitch)] = [0, 1].map(|axis| log.column(names::ATTITUDE[axis])) {
            signals.tilt = Some(
                mean(&|row| roll[row].cos() * pitch[row].cos())
                    .into_iter()
                    .map(|cosine| cosine.clamp(-1.0, 1.0).acos())
                    .collect(),
            );
            signals.lean = Some([mean(&|row| roll[row]), mean(&|row| pitch[row])]);
            signals.sources.push("attitude");
        }
        signals.leave_out_a_runaway_attitude();
        let rates = names::RATES.map(column);
        if let [Some(roll), Some(pitch), Some(yaw)] = rates {
            signals.rates = Some([roll, pitch, yaw]);
            signals.sources.push("rates");
        }
        signals.height = column(names::HEIGHT_ABOVE_GROUND)
            .or_else(|| column(names::POSITION[2]).map(|down| down.into_iter().map(|down| -down).collect()))
            .or_else(|| column("barometer_height_m"));
        if signals.height.is_some() {
            signals.sources.push("height");
        }
        signals
    }

    /// A substitute for the collective thrust: outputs, otherwise rotor speeds over their largest, otherwise a throttle
    /// or a commanded thrust.
    fn effort(&mut self, log: &FlightLog, column: &dyn Fn(&str) -> Option<Vec<f64>>) -> Option<Vec<f64>> {
        let of_largest = |columns: Vec<Vec<f64>>| -> Option<Vec<f64>> {
            let bins = columns.first()?.len();
            let mean: Vec<f64> = (0..bins)
                .map(|bin| columns.iter().map(|values| values[bin]).sum::<f64>() / columns.len() as f64)
                .collect();
            let most = mean.iter().copied().fold(0.0, f64::max);
            (most > 0.0).then(|| mean.iter().map(|value| value / most).collect())
        };
        if !self.duty.is_empty() {
            self.sources.push("motor outputs");
            let count = self.duty.len() as f64;
            return Some(
                (0..self.start_s.len())
                    .map(|bin| self.duty.iter().map(|duty| duty[bin]).sum::<f64>() / count)
                    .collect(),
            );
        }
        let speeds: Vec<Vec<f64>> = (1..=MAX_ROTORS)
            .filter_map(|rotor| column(&names::rotor_speed(rotor)))
            .collect();
        if !speeds.is_empty() {
            self.sources.push("rotor speeds");
            return of_largest(speeds);
        }
        if let Some(thrust) = column(names::THRUST_COMMAND) {
            self.sources.push("commanded thrust");
            return of_largest(vec![thrust]);
        }
        if log.column("throttle_fraction").is_some() {
            self.sources.push("throttle");
            return column("throttle_fraction");
        }
        // Outputs that never leave idle cannot be recognised as rotors by their motion, but show that there was no
        // flight.
        let duties = log.duties();
        let idle = |values: &&[f64]| values.iter().all(|value| value.is_nan() || *value < IDLES);
        if !duties.is_empty() && duties.iter().all(|values| idle(&&values[..])) {
            self.sources.push("motor outputs");
            return Some(vec![0.0; self.start_s.len()]);
        }
        None
    }

    /// An attitude beyond 70° for much of the time with the motors up is that of an estimator which ran away, or of a board that is mounted
    /// another way: nothing flies so for long.
    fn leave_out_a_runaway_attitude(&mut self) {
        const TILT_RAD: f64 = 1.22;
        const SHARE: f64 = 0.3;
        let (Some(tilt), Some(effort)) = (&self.tilt, &self.effort) else {
            return;
        };
        let mut efforts: Vec<f64> = effort.iter().copied().filter(|e| e.is_finite()).collect();
        efforts.sort_by(f64::total_cmp);
        let Some(high) = efforts.get(efforts.len() * 9 / 10).copied() else {
            return;
        };
        let driven = tilt
            .iter()
            .zip(effort)
            .filter(|(_, effort)| **effort > (0.6 * high).max(IDLES));
        let (beyond, of) = driven.fold((0_usize, 0_usize), |(beyond, of), (tilt, _)| {
            (beyond + usize::from(*tilt > TILT_RAD), of + 1)
        });
        if beyond as f64 > SHARE * of as f64 {
            self.tilt = None;
            self.lean = None;
            self.sources.retain(|source| *source != "attitude");
        }
    }

    pub(super) fn bins(&self) -> usize {
        self.start_s.len()
    }

    /// True if a run of flight cannot continue from this bin to the next.
    pub(super) fn breaks_after(&self, bin: usize) -> bool {
        self.start_s
            .get(bin + 1)
            .is_some_and(|next| next - self.end_s[bin] > break_s(self.rate_hz))
    }

    /// Means over `seconds` about each bin.
    pub(super) fn smooth(&self, values: &[f64], seconds: f64) -> Vec<f64> {
        let half = 0.5 * seconds;
        let (mut from, mut to, mut sum, mut count) = (0, 0, 0.0, 0_usize);
        (0..values.len())
            .map(|bin| {
                while to < values.len() && self.start_s[to] <= self.start_s[bin] + half {
                    if values[to].is_finite() {
                        sum += values[to];
                        count += 1;
                    }
                    to += 1;
                }
                while self.start_s[from] < self.start_s[bin] - half {
                    if values[from].is_finite() {
                        sum -= values[from];
                        count -= 1;
                    }
                    from += 1;
                }
                if count == 0 { f64::NAN } else { sum / count as f64 }
            })
            .collect()
    }

    /// Deviations over `seconds` about each bin.
    pub(super) fn scatter(&self, values: &[f64], seconds: f64) -> Vec<f64> {
        let mean = self.smooth(values, seconds);
        let centre = mean.iter().copied().find(|value| value.is_finite()).unwrap_or(0.0);
        let squares: Vec<f64> = values.iter().map(|value| (value - centre).powi(2)).collect();
        self.smooth(&squares, seconds)
            .iter()
            .zip(&mean)
            .map(|(square, mean)| (square - (mean - centre).powi(2)).max(0.0).sqrt())
            .collect()
    }

    /// Bins whose first row lies in `from ≤ t < to`.
    pub(super) fn between(&self, from_s: f64, to_s: f64) -> std::ops::Range<usize> {
        let first = self.start_s.partition_point(|time| *time < from_s);
        let last = self.start_s.partition_point(|time| *time < to_s);
        first..last.max(first)
    }
}

/// Outputs that drive motors: those that move; all that are not 0 where none does (an ideal hover).
fn motors(log: &FlightLog) -> Vec<usize> {
    let range = |output: usize| -> Option<(f64, f64)> {
        let values = log.column(&names::duty(output))?;
        let finite = values.iter().copied().filter(|value| value.is_finite());
        Some(finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
            (low.min(value), high.max(value))
        }))
    };
    let ranges: Vec<(usize, f64, f64)> = (1..=MAX_ROTORS)
        .filter_map(|output| range(output).map(|(low, high)| (output, low, high)))
        .collect();
    let moving: Vec<usize> = ranges
        .iter()
        .filter(|(_, low, high)| high - low > MOVES && *high > 2.0 * MOVES)
        .map(|(output, ..)| *output)
        .collect();
    if moving.is_empty() {
        ranges
            .iter()
            .filter(|(_, _, high)| *high > 0.0)
            .map(|(output, ..)| *output)
            .collect()
    } else {
        moving
    }
}
