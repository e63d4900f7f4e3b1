//! Rates of the columns as they were measured: a column that is held or interpolated from a slower stream has the rate
//! and the noise of its source.
//!
//! Between two samples of its source such a column has no information: linear interpolation misses the curvature of the
//! signal, a held value its change. Both count as noise here, in addition to the scatter of neighbouring samples of the
//! source.

use serde::Serialize;

use super::resample::median;
use super::{FlightLog, names};

/// Below this share of the rows' rate a column is of a slower stream.
const SLOWER: f64 = 0.7;
/// Fewest new values that determine a rate.
const FEWEST: usize = 8;
/// A new value that comes this many usual intervals after the last one indicates a gap in the log or a value that did
/// not change (a motor at its limit), not the rate of the source.
const LATE: f64 = 4.0;
/// Median of absolute values over the deviation, of normal ones.
const MEDIAN_OF_NORMAL: f64 = 0.6745;
/// Root mean square over an interval of (1 − x) x/2: the error of linear interpolation per second difference.
const LINE_ERROR: f64 = 0.0913;
/// Root mean square over an interval of x: a held value's error per difference.
const HELD_ERROR: f64 = 0.5774;

/// Rate and noise of one column.
#[derive(Debug, Clone, PartialEq, Serialize, utoipa::ToSchema)]
pub struct SensorRate {
    /// Column.
    pub column: String,
    /// Rows per second of the log, Hz.
    pub rows_hz: f64,
    /// New values per second, Hz.
    pub source_hz: f64,
    /// Standard deviation of the noise between neighbouring new values, in the unit of the column.
    pub noise: f64,
    /// Root mean square error of the rows between new values, in the unit of the column; 0 if every row is new.
    pub between: f64,
    /// Values are held between the new ones, not interpolated.
    pub held: bool,
}

impl SensorRate {
    /// True for a column that is held or interpolated from a slower stream.
    pub fn is_slower(&self) -> bool {
        self.source_hz < SLOWER * self.rows_hz
    }

    /// Deviation of a row from what a noise-free sensor would have read at that time.
    pub fn deviation(&self) -> f64 {
        self.noise.hypot(self.between)
    }
}

impl FlightLog {
    /// Rates of the state, inertial and battery columns, and of the motor outputs: that of the most informative output.
    pub fn source_rates(&self) -> Vec<SensorRate> {
        names::POSITION
            .iter()
            .chain(&names::VELOCITY)
            .chain(&names::ATTITUDE)
            .chain(&names::RATES)
            .chain(&names::ACCEL)
            .chain(&[names::BATTERY_VOLTAGE, names::BATTERY_CURRENT])
            .filter_map(|column| self.source_rate(column))
            .chain(self.duty_rate())
            .collect()
    }

    /// Of the motor outputs, noise and error of the one with the most new values, and the rate of the stream that all
    /// share; `None` where they do not move. A row in which any of them is new is one of it: at its limit, or in a calm
    /// hover written in whole steps, a motor repeats values.
    pub fn duty_rate(&self) -> Option<SensorRate> {
        let duties = self.duties();
        let busiest = (1..=duties.len())
            .filter_map(|rotor| self.source_rate(&names::duty(rotor)))
            .max_by(|a, b| a.source_hz.total_cmp(&b.source_hz))?;
        // No two rotors cancel, as the weights are no simple multiples of each other.
        let weights: Vec<f64> = (0..duties.len()).map(|rotor| (rotor as f64 + 2.0).ln()).collect();
        let together: Vec<f64> = (0..self.time_s.len())
            .map(|row| {
                weights
                    .iter()
                    .zip(&duties)
                    .map(|(weight, duty)| weight * duty[row])
                    .sum()
            })
            .collect();
        let stream_hz = new_values_hz(&self.time_s, &together).map_or(0.0, |hz| hz.min(busiest.rows_hz));
        Some(SensorRate {
            source_hz: busiest.source_hz.max(stream_hz),
            ..busiest
        })
    }

    /// Corrections that an estimator makes to its position relative to its own velocity, as a random walk, m/√s; worst
    /// axis, 0 if unknown.
    ///
    /// A fix corrects position and velocity each with its own gain, so the position of an estimator is not the integral
    /// of its velocity. Between two samples of a slow source a column only repeats the last correction: treated as
    /// noise of each row it would cancel over a quarter of a second, which corrections do not.
    pub fn position_corrections(&self) -> f64 {
        let within = [(f64::NEG_INFINITY, f64::INFINITY)];
        (0..3)
            .filter_map(|axis| {
                let velocity = self.column(names::VELOCITY[axis])?;
                self.corrections(names::POSITION[axis], &within, 0.0, |row| velocity[row])
            })
            .fold(0.0, f64::max)
    }

    /// The same for its attitude relative to its own angular rates within spans of time (s), rad/√s, axis by axis: η −
    /// ∫T(η)ω. An accelerometer and a compass correct an attitude that a gyroscope propagates, and one that is logged
    /// at another time or rate than the gyroscope is not the integral of the logged rates. The contribution of the
    /// white noise of the rates to such an integral belongs to them and is subtracted.
    pub fn attitude_corrections(&self, within: &[(f64, f64)]) -> [f64; 3] {
        let (Some(attitude), Some(rates)) = (self.vector(names::ATTITUDE), self.vector(names::RATES)) else {
            return [0.0; 3];
        };
        // T(η)ω of Eq. 2.
        let euler_rates = |row: usize| {
            let [p, q, r] = rates.map(|rate| rate[row]);
            let ((sin_roll, cos_roll), pitch) = (attitude[0][row].sin_cos(), attitude[1][row]);
            let across = sin_roll * q + cos_roll * r;
            [
                p + across * pitch.tan(),
                cos_roll * q - sin_roll * r,
                across / pitch.cos(),
            ]
        };
        [0, 1, 2].map(|axis| {
            let noise = self.source_rate(names::RATES[axis]).map_or(0.0, |rate| rate.noise);
            let corrections = self.corrections(names::ATTITUDE[axis], within, noise, |row| euler_rates(row)[axis]);
            corrections.unwrap_or(0.0)
        })
    }

    /// Random walk of `m = x − ∫ẋ` of a column relative to its own derivative, unit/√s: over windows B of one sample of
    /// its source up to 2 s, `q² = (⟨(m(t + B) − m(t))²⟩ − 2σ²)/B − σ_ẋ² h` about the median (a constant error of
    /// either cancels), less the white noise σ of a reading and σ_ẋ of its derivative on rows h apart, excluding the
    /// largest hundredth (resets). Worst window.
    fn corrections(
        &self,
        column: &str,
        within: &[(f64, f64)],
        derivative_noise: f64,
        derivative: impl Fn(usize) -> f64,
    ) -> Option<f64> {
        let (time, values) = (&self.time_s, self.column(column)?);
        let step_s = self.duration_s() / (time.len() - 1) as f64;
        let rate = self.source_rate(column)?;
        let (source_s, white) = (1.0 / rate.source_hz, 2.0 * rate.noise * rate.noise);
        let carried = derivative_noise * derivative_noise * step_s;
        let angle = names::ATTITUDE.contains(&column);
        let (mut integral, mut before) = (0.0, f64::NAN);
        let beside: Vec<f64> = (0..time.len())
            .map(|row| {
                let now = derivative(row);
                let moved = if row == 0 {
                    0.0
                } else {
                    0.5 * (before + now) * (time[row] - time[row - 1])
                };
                before = now;
                // A gap costs the windows over it, not all that follow.
                integral += if moved.is_finite() { moved } else { 0.0 };
                if now.is_finite() {
                    values[row] - integral
                } else {
                    f64::NAN
                }
            })
            .collect();
        [source_s, 0.25, 0.5, 1.0, 2.0]
            .into_iter()
            .filter(|window_s| *window_s >= source_s)
            .filter_map(|window_s| {
                let rows = ((window_s / step_s).round() as usize).max(1);
                let knots: Vec<(f64, f64)> = time.iter().copied().zip(beside.iter().copied()).step_by(rows).collect();
                let mut moved: Vec<f64> = knots
                    .windows(2)
                    .filter(|pair| within.iter().any(|&(from, to)| from <= pair[0].0 && pair[1].0 <= to))
                    .map(|pair| pair[1].1 - pair[0].1)
                    .map(|moved| if angle { super::resample::wrapped(moved) } else { moved })
                    .filter(|moved| moved.is_finite())
                    .collect();
                if moved.len() < FEWEST {
                    return None;
                }
                let middle = median(&mut moved)?;
                let mut squares: Vec<f64> = moved.iter().map(|one| (one - middle).powi(2)).collect();
                squares.sort_by(f64::total_cmp);
                squares.truncate(squares.len() - squares.len() / 100);
                let mean = squares.iter().sum::<f64>() / squares.len() as f64;
                let per_second = (mean - white).max(0.0) / (rows as f64 * step_s);
                Some((per_second - carried).max(0.0).sqrt())
            })
            .reduce(f64::max)
    }

    /// Rate of one column; `None` where too few values are new.
    ///
    /// The axes of an inertial sensor come together, so its rate is that of the axis with the most new values: a gyro
    /// with steps of 1 °/s repeats many readings on an axis that hardly turns.
    pub fn source_rate(&self, column: &str) -> Option<SensorRate> {
        let rows_hz = self.sample_rate_hz();
        let values = self.column(column)?;
        let knots = knots(&self.time_s, values);
        if knots.len() < FEWEST {
            return None;
        }
        let in_time = in_time(&self.time_s, &knots);
        let of_sensor = [names::RATES, names::ACCEL]
            .into_iter()
            .find(|axes| axes.contains(&column));
        let others = of_sensor.into_iter().flatten().filter(|axis| *axis != column);
        let source_hz = others
            .filter_map(|axis| new_values_hz(&self.time_s, self.column(axis)?))
            .fold(rate_of(&self.time_s, &in_time), f64::max)
            .min(rows_hz);
        let angle = names::ATTITUDE.contains(&column);
        let change = |k: usize| {
            let change = values[knots[k]] - values[knots[k - 1]];
            if angle {
                super::resample::wrapped(change)
            } else {
                change
            }
        };
        let first: Vec<f64> = (1..knots.len()).map(change).collect();
        let second: Vec<f64> = first.windows(2).map(|pair| pair[1] - pair[0]).collect();
        // Third differences leave noise of smooth signals: variance 20 σ². The median resists jumps.
        let third = second.windows(2).map(|pair| pair[1] - pair[0]);
        let usual = |values: &mut dyn Iterator<Item = f64>| {
            let mut sizes: Vec<f64> = values.map(f64::abs).filter(|size| size.is_finite()).collect();
            median(&mut sizes).unwrap_or(0.0) / MEDIAN_OF_NORMAL
        };
        let noise = usual(&mut third.into_iter()) / 20.0_f64.sqrt();
        let rows = || in_time.iter().flat_map(|pair| pair[0] + 1..pair[1] + 1);
        let still = rows().filter(|&row| values[row] == values[row - 1]).count();
        let held = 4 * still > rows().count();
        let mut rate = SensorRate {
            column: column.to_owned(),
            rows_hz,
            source_hz,
            noise,
            between: 0.0,
            held,
        };
        if rate.is_slower() {
            rate.between = if held {
                HELD_ERROR * usual(&mut first.iter().copied())
            } else {
                LINE_ERROR * usual(&mut second.iter().copied())
            };
        }
        Some(rate)
    }
}

impl FlightLog {
    /// The log with measured columns that are held from slower streams centred on their new values; `None` if there are
    /// none. A value that is held from its sample on is late by half of its source's interval on average, which would
    /// pass for a latency.
    ///
    /// Motor outputs do hold until the next one, and stay as they are.
    pub(crate) fn with_centred_holds(&self) -> Option<Self> {
        let measured = [
            names::POSITION,
            names::VELOCITY,
            names::ATTITUDE,
            names::RATES,
            names::ACCEL,
        ];
        let columns = measured.iter().flatten().chain(&[names::BATTERY_VOLTAGE]);
        let held: Vec<&str> = columns
            .copied()
            .filter(|column| {
                self.source_rate(column)
                    .is_some_and(|rate| rate.held && rate.is_slower())
            })
            .collect();
        if held.is_empty() {
            return None;
        }
        let mut log = self.clone();
        for name in held {
            centre(&self.time_s, log.columns.get_mut(name).expect("it has a rate"));
        }
        Some(log)
    }
}

/// Every row gets the nearer of the new values before and after it, where these follow each other as usual.
fn centre(time_s: &[f64], values: &mut [f64]) {
    let knots = knots(time_s, values);
    let pairs: Vec<[usize; 2]> = in_time(time_s, &knots).iter().map(|pair| [pair[0], pair[1]]).collect();
    for [from, to] in pairs {
        let middle = 0.5 * (time_s[from] + time_s[to]);
        let next = values[to];
        for row in from + 1..to {
            if time_s[row] > middle && values[row].is_finite() {
                values[row] = next;
            }
        }
    }
}

/// New values per second; `None` where they are too few.
fn new_values_hz(time_s: &[f64], values: &[f64]) -> Option<f64> {
    let knots = knots(time_s, values);
    (knots.len() >= FEWEST).then(|| rate_of(time_s, &in_time(time_s, &knots)))
}

/// Rate of new values that follow each other as usual, Hz.
fn rate_of(time_s: &[f64], in_time: &[&[usize]]) -> f64 {
    let span: f64 = in_time.iter().map(|pair| time_s[pair[1]] - time_s[pair[0]]).sum();
    in_time.len() as f64 / span
}

/// Pairs of neighbouring new values that follow each other as usual.
fn in_time<'a>(time_s: &[f64], knots: &'a [usize]) -> Vec<&'a [usize]> {
    let apart = |pair: &[usize]| time_s[pair[1]] - time_s[pair[0]];
    let mut sizes: Vec<f64> = knots.windows(2).map(apart).collect();
    let usual = median(&mut sizes).unwrap_or(f64::INFINITY);
    knots.windows(2).filter(|pair| apart(pair) <= LATE * usual).collect()
}

/// Rows with a new value: where linear interpolation through the neighbours has a kink. A sample of the source between
/// two rows causes a kink at both of them; such pairs count once.
fn knots(time_s: &[f64], values: &[f64]) -> Vec<usize> {
    let breaks: Vec<usize> = (1..values.len().saturating_sub(1))
        .filter(|&k| {
            let (before, after) = (values[k] - values[k - 1], values[k + 1] - values[k]);
            let (dt0, dt1) = (time_s[k] - time_s[k - 1], time_s[k + 1] - time_s[k]);
            let bend = (after / dt1 - before / dt0).abs() * dt0.min(dt1);
            let size = before.abs().max(after.abs()).max(1e-12);
            bend.is_finite() && bend > 1e-5 * size && (before != 0.0 || after != 0.0)
                // A held value: the step's first row counts, not the row before it.
                && !(before == 0.0 && after != 0.0)
        })
        .collect();
    let neighbours = |at: usize| at > 0 && breaks[at] == breaks[at - 1] + 1;
    (0..breaks.len())
        .filter(|&at| {
            let second_of_two = neighbours(at) && !(at > 1 && neighbours(at - 1));
            let ends_there = at + 1 == breaks.len() || !neighbours(at + 1);
            !(second_of_two && ends_there)
        })
        .map(|at| breaks[at])
        .collect()
}

#[cfg(test)]
mod tests {
    use rotortwin_plant::random::NormalStream;

    use super::*;

    #[test]
    fn val_held_and_interpolated_columns_have_the_rate_of_their_source() {
        let rows = 2000;
        let time: Vec<f64> = (0..rows).map(|k| f64::from(k) * 0.02).collect();
        // No three in a line: the second difference modulo 101 is never 0.
        let noise = |k: i64| ((k * k * 31 + k * 7) % 101) as f64 / 101.0;
        let fresh: Vec<f64> = (0..rows).map(|k| noise(i64::from(k))).collect();
        let held: Vec<f64> = (0..rows).map(|k| noise(i64::from(k / 5))).collect();
        let lines: Vec<f64> = (0..rows)
            .map(|k| {
                let (k, part) = (i64::from(k / 5), f64::from(k % 5) / 5.0);
                noise(k) * (1.0 - part) + noise(k + 1) * part
            })
            .collect();
        // The same between the rows: 10 Hz, 7 ms late.
        let late: Vec<f64> = time
            .iter()
            .map(|t| {
                let place = (t - 0.007).max(0.0) / 0.1;
                let (k, part) = (place.floor() as i64, place.fract());
                noise(k) * (1.0 - part) + noise(k + 1) * part
            })
            .collect();
        let columns = [
            names::RATES[0],
            names::VELOCITY[0],
            names::VELOCITY[1],
            names::VELOCITY[2],
        ]
        .map(str::to_owned);
        let log =
            FlightLog::from_columns("rates", time, columns.into_iter().zip([fresh, held, lines, late])).expect("a log");
        let found = log.source_rates();
        let hz = |name: &str| found.iter().find(|rate| rate.column == name).expect(name).source_hz;
        assert!((hz(names::RATES[0]) - 50.0).abs() < 2.0, "{found:?}");
        assert!((hz(names::VELOCITY[0]) - 10.0).abs() < 0.5, "{found:?}");
        assert!((hz(names::VELOCITY[1]) - 10.0).abs() < 0.5, "{found:?}");
        assert!((hz(names::VELOCITY[2]) - 10.0).abs() < 0.5, "{found:?}");
        let of = |name: &str| found.iter().find(|rate| rate.column == name).expect(name);
        assert!(!of(names::RATES[0]).is_slower() && of(names::RATES[0]).between == 0.0);
        assert!(of(names::VELOCITY[0]).held && !of(names::VELOCITY[1]).held);
    }

    /// "The log is at fault: latency of the velocity, 0.0487 s" of a healthy flight with 10 Hz in rows of 200 Hz.
    #[test]
    fn regress_a_held_value_is_not_late() {
        let time: Vec<f64> = (0..4000).map(|k| f64::from(k) * 0.005).collect();
        let at = |t: f64| 2.0 * (0.8 * t).sin() + 0.5 * t;
        let held: Vec<f64> = time.iter().map(|t| at((t * 10.0 + 1e-9).floor() / 10.0)).collect();
        let fresh: Vec<f64> = time.iter().map(|t| at(*t)).collect();
        let columns = [names::VELOCITY[0], names::RATES[0]].map(str::to_owned);
        let log = FlightLog::from_columns("held", time.clone(), columns.into_iter().zip([held, fresh])).expect("a log");
        let centred = log.with_centred_holds().expect("one column is held");
        let velocity = centred.column(names::VELOCITY[0]).expect("still there");
        let late = |values: &[f64]| {
            // ⟨error · slope⟩/⟨slope²⟩: the delay.
            let slope = |t: f64| 1.6 * (0.8 * t).cos() + 0.5;
            let rows = 20..3950;
            let (mut product, mut square) = (0.0, 0.0);
            for k in rows {
                product += (at(time[k]) - values[k]) * slope(time[k]);
                square += slope(time[k]).powi(2);
            }
            product / square
        };
        let before = late(log.column(names::VELOCITY[0]).expect("made"));
        assert!((before - 0.0475).abs() < 0.003, "{before}");
        assert!(late(velocity).abs() < 0.004, "{}", late(velocity));
        assert_eq!(centred.column(names::RATES[0]), log.column(names::RATES[0]));
    }

    /// "Slower than the rows (983 Hz): roll_rate_rad_s 554.9 Hz, pitch_rate_rad_s 471.5 Hz" of one gyroscope.
    #[test]
    fn regress_readings_that_repeat_do_not_slow_one_axis_of_a_sensor() {
        let time: Vec<f64> = (0..4000).map(|k| f64::from(k) * 0.001).collect();
        let noise = |k: i32| f64::from((k * k * 31 + k * 7) % 101) / 101.0 - 0.5;
        let degree = 1.0_f64.to_radians();
        // In whole degrees a second: one axis turns, the others hardly do.
        let axis = |most: f64| {
            (0..4000)
                .map(|k| (most * noise(k)).round() * degree)
                .collect::<Vec<f64>>()
        };
        let columns = names::RATES
            .map(str::to_owned)
            .into_iter()
            .zip([axis(400.0), axis(2.0), axis(3.0)]);
        let log = FlightLog::from_columns("coarse", time, columns).expect("a log");
        for name in names::RATES {
            let rate = log.source_rate(name).expect("a rate");
            assert!(!rate.is_slower() && rate.between == 0.0, "{rate:?}");
        }
    }

    /// Each of six motors of a calm hover, in whole microseconds of pulse, repeats its value in two of three rows.
    #[test]
    fn regress_outputs_in_whole_steps_do_not_slow_their_stream() {
        // From −1 to 1.
        let noise = |k: u64| {
            let mixed = (k + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            let mixed = (mixed ^ mixed >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            (mixed >> 33) as f64 / f64::from(1u32 << 30) - 1.0
        };
        let time: Vec<f64> = (0..4000).map(|k| f64::from(k) * 0.0025).collect();
        // In whole thousandths: a third of the values are off the middle one.
        let output = |rotor: u64| -> Vec<f64> {
            (0..4000)
                .map(|row| 0.5 + 0.001 * (0.6 * noise(rotor * 4000 + row)).round())
                .collect()
        };
        let columns = (1..=6).map(|rotor| (names::duty(rotor), output(rotor as u64)));
        let log = FlightLog::from_columns("calm", time, columns).expect("a log");
        let one = log.source_rate(&names::duty(1)).expect("it moves");
        assert!(one.is_slower(), "{one:?}");
        let rate = log.duty_rate().expect("they move");
        assert!(!rate.is_slower(), "{rate:?}");
    }

    #[test]
    fn regress_a_gap_and_a_motor_at_its_limit_do_not_slow_a_source() {
        let noise = |k: i64| ((k * k * 31 + k * 7) % 101) as f64 / 101.0;
        // 20 s at 25 Hz, 600 s without a row, 20 s more; the motor outputs at 5 Hz, one of them at its limit for three fifths of the time.
        let time: Vec<f64> = (0..1000)
            .map(|k| 0.04 * f64::from(k) + if k < 500 { 0.0 } else { 600.0 })
            .collect();
        let gyroscope: Vec<f64> = (0..1000).map(noise).collect();
        let output = |shift: i64| -> Vec<f64> {
            let at = |k: i64| 0.3 + 0.2 * noise(k + shift);
            (0..1000)
                .map(|row| {
                    let (k, part) = (row / 5, (row % 5) as f64 / 5.0);
                    at(k) * (1.0 - part) + at(k + 1) * part
                })
                .collect()
        };
        let mut saturated = output(40);
        for (row, value) in saturated.iter_mut().enumerate() {
            if row % 250 < 150 {
                *value = 1.0;
            }
        }
        let columns = [
            (names::RATES[0].to_owned(), gyroscope),
            (names::duty(1), output(0)),
            (names::duty(2), output(10)),
            (names::duty(3), output(20)),
            (names::duty(4), saturated),
        ];
        let log = FlightLog::from_columns("gap", time, columns).expect("a log");
        let rates = log.source_rate(names::RATES[0]).expect("it has values");
        assert!(
            (rates.source_hz - 25.0).abs() < 0.5 && rates.between == 0.0,
            "{rates:?}"
        );
        for rotor in 1..=4 {
            let rate = log.source_rate(&names::duty(rotor)).expect("it has values");
            assert!((rate.source_hz - 5.0).abs() < 0.3 && !rate.held, "{rate:?}");
        }
        let duties = log.duty_rate().expect("they move");
        assert!((duties.source_hz - 5.0).abs() < 0.3, "{duties:?}");
        assert!(log.source_rates().contains(&duties));
    }

    #[test]
    fn val_corrections_of_a_slow_position_are_a_random_walk_and_a_true_integral_has_none() {
        // 10 Hz on 50 Hz rows, each fix off by a pattern of deviation σ that no row predicts: q = σ/√0.1 s.
        let rows = 5000;
        let time: Vec<f64> = (0..rows).map(|k| f64::from(k) * 0.02).collect();
        let speed = |t: f64| (0.7 * t).sin();
        let velocity: Vec<f64> = time.iter().map(|t| speed(*t)).collect();
        let fix = |k: i64| ((k * k * 31 + k * 7) % 101) as f64 / 101.0 - 0.5;
        // ∫ sin 0.7 t dt; the walk of the corrections on top.
        let walk: Vec<f64> = (0..=1001)
            .scan(0.0, |sum, k| {
                *sum += fix(k);
                Some(*sum)
            })
            .collect();
        let at = |k: usize, size: f64| -(0.07 * k as f64).cos() / 0.7 + size * walk[k];
        let lines = |size: f64| -> Vec<f64> {
            (0..rows as usize)
                .map(|k| {
                    let (k, part) = (k / 5, (k % 5) as f64 / 5.0);
                    at(k, size) * (1.0 - part) + at(k + 1, size) * part
                })
                .collect()
        };
        let corrections = |size: f64| {
            let columns = [
                (names::POSITION[0].to_owned(), lines(size)),
                (names::VELOCITY[0].to_owned(), velocity.clone()),
            ];
            FlightLog::from_columns("fixes", time.clone(), columns)
                .expect("a log")
                .position_corrections()
        };
        let deviation = {
            let all: Vec<f64> = (0..1000).map(fix).collect();
            let mean = all.iter().sum::<f64>() / 1000.0;
            (all.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / 1000.0).sqrt()
        };
        let found = corrections(0.1);
        let truth = 0.1 * deviation / 0.1_f64.sqrt();
        assert!((0.7..2.0).contains(&(found / truth)), "{found} {truth}");
        assert!(corrections(0.0) < 0.05 * truth, "{}", corrections(0.0));
    }

    #[test]
    fn val_corrections_of_an_attitude_are_a_random_walk_and_noise_of_the_rates_is_not() {
        // 50 Hz; roll and pitch by a gyroscope whose rows scatter by 0.02 rad/s, roll corrected at 10 Hz by 1.5 mrad.
        let rows = 20_000_usize;
        let (mut gyro, mut fix) = (NormalStream::new(3, "gyroscope"), NormalStream::new(4, "corrections"));
        let time: Vec<f64> = (0..rows).map(|k| k as f64 * 0.02).collect();
        let scatter: Vec<f64> = (0..rows).map(|_| 0.02 * gyro.sample()).collect();
        let rate: Vec<f64> = time
            .iter()
            .zip(&scatter)
            .map(|(t, n)| 0.3 * (0.7 * t).cos() + n)
            .collect();
        let angle = |t: f64| 0.3 / 0.7 * (0.7 * t).sin();
        let mut walk = 0.0;
        let roll: Vec<f64> = (0..rows)
            .map(|k| {
                if k % 5 == 0 {
                    walk += 0.0015 * fix.sample();
                }
                angle(time[k]) + walk
            })
            .collect();
        let still = vec![0.0; rows];
        let columns = [
            (names::ATTITUDE[0], roll),
            (
                names::ATTITUDE[1],
                time.iter().map(|t| 0.01 * (0.9 * t).sin()).collect(),
            ),
            (names::ATTITUDE[2], still.clone()),
            (names::RATES[0], rate),
            (names::RATES[1], time.iter().map(|t| 0.009 * (0.9 * t).cos()).collect()),
            (names::RATES[2], still),
        ]
        .map(|(name, values)| (name.to_owned(), values));
        let log = FlightLog::from_columns("estimator", time, columns).expect("a log");
        let everywhere = [(f64::NEG_INFINITY, f64::INFINITY)];
        let [roll, pitch, _] = log.attitude_corrections(&everywhere);
        // q = σ/√0.1 s.
        let truth = 0.0015 / 0.1_f64.sqrt();
        assert!((0.8..1.4).contains(&(roll / truth)), "{roll} {truth}");
        // Pitch changes with the existing roll; the remaining part is not a correction.
        assert!(pitch < 0.3 * truth, "{pitch} {truth}");
        // Nothing outside of the time that counts.
        assert_eq!(log.attitude_corrections(&[(-10.0, -5.0)]), [0.0; 3]);
    }

    #[test]
    fn val_a_line_between_slow_samples_is_off_by_what_the_signal_bends() {
        // 1.37 Hz of amplitude 1 at 10 Hz; the true error of the lines for comparison.
        let omega = 1.37 * std::f64::consts::TAU;
        let time: Vec<f64> = (0..4000).map(|k| f64::from(k) * 0.02).collect();
        let source = |k: i32| (omega * 0.1 * f64::from(k)).sin();
        let lines: Vec<f64> = (0..4000)
            .map(|k| {
                let (k, part) = (k / 5, f64::from(k % 5) / 5.0);
                source(k) * (1.0 - part) + source(k + 1) * part
            })
            .collect();
        let errors = time
            .iter()
            .zip(&lines)
            .map(|(t, line)| ((omega * t).sin() - line).powi(2));
        let true_error = (errors.sum::<f64>() / 4000.0).sqrt();
        let columns = [(names::VELOCITY[0].to_owned(), lines)];
        let log = FlightLog::from_columns("lines", time, columns).expect("a log");
        let rate = log.source_rate(names::VELOCITY[0]).expect("it has values");
        // The median of a sine's absolute values is 1.48 times that of a normal variable of its deviation: 0.707/0.6745.
        assert!(
            (0.9..1.6).contains(&(rate.between / true_error)),
            "{rate:?}, {true_error}"
        );
    }
}
