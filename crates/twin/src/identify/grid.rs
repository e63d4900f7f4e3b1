//! The log on a uniform grid, with its rotors selected, and its airborne parts.

use std::ops::Range;

use super::slow_outputs::Slow;
use crate::log::flight_parts::EventKind;
use crate::log::rest::{quiet_mean, scale_of};
use crate::log::{FlightLog, GAP_FACTOR, names, running_mean};

/// m/s².
pub(crate) const GRAVITY: f64 = 9.81;
/// Tilt above which a flight has ended, rad: 70°.
const TILT_END_RAD: f64 = 1.22;
/// Specific force above which it has, m/s².
const FORCE_END: f64 = 35.0;
/// Specific force in flight, means over a second, m/s².
const FORCE_FLIGHT: Range<f64> = 4.0..25.0;
/// The same for an agile flight with pull-ups and free falls: the thrust curve is valid there, too.
const AGILE_FORCE: Range<f64> = 1.0..60.0;
const AGILE_END: f64 = 80.0;
/// A flight is agile if its motors exceed their usual mean by this factor.
const AGILE: f64 = 1.25;
/// A stretch without the force of flight is not on the ground if an agile flight recovers from it within this, s.
const EXCURSION_S: f64 = 5.0;
/// … in an excursion of any flight the vehicle falls, or its motors carry it: means of the specific force over a
/// second, m/s². A vehicle on the ground with its motors low measures its weight.
const FALLS: f64 = 7.0;
/// A gap up to this is bridged, s: rows of a log at 50 Hz are that far apart, and the motor lag is longer.
const BRIDGED_S: f64 = 0.02;
/// Lowest row rate from which a vehicle's torques and lag can be identified, Hz: slower rows show where it was, not
/// what turned it.
const SLOWEST_HZ: f64 = 10.0;
/// Left out at a take-off and before a landing, s; and where only the log ends, s.
const CUT_GROUND_S: f64 = 3.0;
const CUT_LOG_S: f64 = 0.5;
/// Left out instead if nothing long enough remains: a vehicle that is launched and caught by hand.
const CUT_SHORT_S: f64 = 1.0;
/// Shortest part that is used, s.
const SHORTEST_S: f64 = 3.0;
/// Longest time in the air that is fitted, s; of a longer flight, evenly spread pieces are used.
const MOST_SECONDS: f64 = 400.0;

/// One log, ready to be fitted.
#[derive(Debug, Clone)]
pub(crate) struct Grid {
    pub(crate) name: String,
    pub(crate) step_s: f64,
    /// Of the first row, on the log's clock.
    pub(crate) start_s: f64,
    pub(crate) rows: usize,
    /// Columns of the log (from 1) that are rotors.
    pub(crate) outputs: Vec<usize>,
    /// By rotor, then row.
    pub(crate) duty: Vec<Vec<f64>>,
    /// Body, rad/s.
    pub(crate) rates: Option<[Vec<f64>; 3]>,
    /// Specific force, body, m/s²; x and y may be missing.
    pub(crate) accel: [Option<Vec<f64>>; 3],
    /// True if the force along z is derived from the estimator's acceleration, for lack of an accelerometer.
    pub(crate) accel_from_estimator: bool,
    /// Corner of the autopilot's low-pass of the accelerometer, Hz, where it is known.
    pub(crate) accel_low_pass_hz: Option<f64>,
    pub(crate) voltage: Option<Vec<f64>>,
    pub(crate) current: Option<Vec<f64>>,
    /// Roll, pitch, yaw.
    pub(crate) attitude: Option<[Vec<f64>; 3]>,
    /// NED, m/s.
    pub(crate) velocity: Option<[Vec<f64>; 3]>,
    /// In the air, in the order of time.
    pub(crate) airborne: Vec<Range<usize>>,
    /// On the ground before the first take-off, at rest.
    pub(crate) rest: Option<Range<usize>>,
    /// Measured |a| at rest over 9.81 m/s²; readings are divided by it.
    pub(crate) accel_scale: Option<f64>,
    /// Motor outputs that come too slowly for roll and pitch.
    pub(crate) slow_outputs: Option<Slow>,
    /// Logged above 600 Hz, and decimated.
    pub(crate) fast: bool,
    pub(crate) notes: Vec<String>,
}

/// Outputs of a log that drive rotors: not those that stay constant.
pub(crate) fn moving_outputs(log: &FlightLog) -> Vec<usize> {
    (1..=rotortwin_flight_core::MAX_ROTORS)
        .filter(|output| {
            log.column(&names::duty(*output)).is_some_and(|values| {
                let finite = || values.iter().copied().filter(|value| value.is_finite());
                let low = finite().fold(f64::INFINITY, f64::min);
                let high = finite().fold(f64::NEG_INFINITY, f64::max);
                high - low > 0.01 && high > 0.02
            })
        })
        .collect()
}

impl Grid {
    /// A log with these of its outputs as rotors, in this order.
    pub(crate) fn new(log: &FlightLog, outputs: &[usize]) -> Result<Self, String> {
        let rate_hz = log.sample_rate_hz();
        if rate_hz < SLOWEST_HZ {
            return Err(format!(
                "{}: {rate_hz:.1} rows per second, expected at least {SLOWEST_HZ:.0}: what the motors did between two rows is unknown, so nothing about the vehicle can be inferred; use the log on the vehicle's memory card instead of the telemetry log",
                log.name
            ));
        }
        let even = {
            let step = 1.0 / rate_hz;
            log.time_s
                .windows(2)
                .all(|pair| ((pair[1] - pair[0]) / step - 1.0).abs() < 1e-3)
        };
        let resampled;
        let log = if even {
            log
        } else {
            // A recorder that falls behind drops a few rows every second.
            resampled = log.resampled_over(rate_hz, (GAP_FACTOR / rate_hz).max(BRIDGED_S))?;
            &resampled
        };
        let owned = |name: &str| log.column(name).map(<[f64]>::to_vec);
        let three = |names: [&str; 3]| -> Option<[Vec<f64>; 3]> {
            Some([owned(names[0])?, owned(names[1])?, owned(names[2])?])
        };
        let mut accel = names::ACCEL.map(owned);
        let mut accel_from_estimator = false;
        if accel[2].is_none()
            && let Some(up) = log.column("stateEstimate.az")
        {
            // World axes, gravity removed, g; level within a few degrees where it is used.
            accel[2] = Some(up.iter().map(|up| -GRAVITY * (1.0 + up)).collect());
            accel_from_estimator = true;
        }
        let mut grid = Self {
            name: log.name.clone(),
            step_s: log.duration_s() / (log.time_s.len() - 1) as f64,
            start_s: log.time_s[0],
            rows: log.time_s.len(),
            outputs: outputs.to_vec(),
            duty: outputs
                .iter()
                .map(|output| owned(&names::duty(*output)).ok_or_else(|| format!("duty_{output} is missing")))
                .collect::<Result<_, _>>()?,
            rates: three(names::RATES),
            accel,
            accel_from_estimator,
            accel_low_pass_hz: log.accelerometer_low_pass().map(|filter| filter.corner_hz),
            voltage: owned(names::BATTERY_VOLTAGE),
            current: owned(names::BATTERY_CURRENT),
            attitude: three(names::ATTITUDE),
            velocity: three(names::VELOCITY),
            airborne: Vec::new(),
            rest: None,
            accel_scale: None,
            slow_outputs: None,
            fast: false,
            notes: Vec::new(),
        };
        grid.find_rest();
        grid.decimate();
        grid.slow_outputs = Slow::of(log, grid.step_s, grid.fast);
        grid.find_airborne()?;
        grid.leave_out_motors_off(log)?;
        Ok(grid)
    }

    /// What a vehicle does while a parameter keeps one of its motors from turning is not representative of a vehicle
    /// whose motors all turn.
    fn leave_out_motors_off(&mut self, log: &FlightLog) -> Result<(), String> {
        for event in log
            .report
            .happenings
            .iter()
            .filter(|event| event.kind == EventKind::MotorOff)
        {
            let row = |time_s: f64| ((time_s - self.start_s) / self.step_s).clamp(0.0, self.rows as f64) as usize;
            let (from, to) = (row(event.start_s), row(event.end_s) + 1);
            if !self.airborne.iter().any(|part| part.start < to && from < part.end) {
                continue;
            }
            let shortest = self.rows_of(SHORTEST_S);
            let sides = |part: &Range<usize>| [part.start..part.end.min(from), part.start.max(to)..part.end];
            self.airborne = self
                .airborne
                .iter()
                .flat_map(sides)
                .filter(|side| side.len() >= shortest)
                .collect();
            let told = format!("from {:.1} s on {}", event.start_s, event.detail);
            if self.airborne.is_empty() {
                return Err(format!(
                    "{}: expected at least {SHORTEST_S} s of flight with all motors, found none: {told}",
                    self.name
                ));
            }
            self.notes
                .push(format!("{}: {told}; left out until it is on again", self.name));
        }
        Ok(())
    }

    /// Above 600 Hz, rows are averaged: vibration and the gyro's own filter are not part of the model, and they
    /// dominate the error between neighbouring rows.
    fn decimate(&mut self) {
        const FASTEST_HZ: f64 = 600.0;
        const AIM_HZ: f64 = 250.0;
        let rate = 1.0 / self.step_s;
        if rate <= FASTEST_HZ {
            return;
        }
        let factor = (rate / AIM_HZ).round() as usize;
        let rows = self.rows / factor;
        let centred = |values: &mut Vec<f64>| {
            let means = running_mean(values, factor / 2);
            *values = (0..rows).map(|row| means[row * factor]).collect();
        };
        // A duty holds from its row on: the mean over the interval of the new row.
        for duty in &mut self.duty {
            *duty = (0..rows)
                .map(|row| duty[row * factor..(row + 1) * factor].iter().sum::<f64>() / factor as f64)
                .collect();
        }
        let triples = [&mut self.rates, &mut self.velocity].into_iter().flatten().flatten();
        triples
            .chain(self.accel.iter_mut().flatten())
            .chain(self.voltage.iter_mut())
            .chain(self.current.iter_mut())
            .for_each(centred);
        // An angle has no mean at its seam.
        for angle in self.attitude.iter_mut().flatten() {
            *angle = (0..rows).map(|row| angle[row * factor]).collect();
        }
        self.rest = self.rest.take().map(|rest| rest.start / factor..rest.end / factor);
        self.fast = true;
        self.rows = rows;
        self.step_s *= factor as f64;
        self.notes
            .push(format!("{}: {rate:.0} Hz, taken as means of {factor} rows", self.name));
    }

    /// Number of rows in this many seconds, at least one.
    pub(crate) fn rows_of(&self, seconds: f64) -> usize {
        ((seconds / self.step_s).round() as usize).max(1)
    }

    /// Seconds in the air.
    pub(crate) fn airborne_s(&self) -> f64 {
        self.airborne.iter().map(ExactSizeIterator::len).sum::<usize>() as f64 * self.step_s
    }

    /// All rotors' mean duty at a row.
    pub(crate) fn mean_duty(&self, row: usize) -> f64 {
        self.duty.iter().map(|duty| duty[row]).sum::<f64>() / self.duty.len() as f64
    }

    /// Thrust over mass, m/s², upwards.
    pub(crate) fn lift(&self) -> Option<Vec<f64>> {
        self.accel[2].as_ref().map(|z| z.iter().map(|z| -z).collect())
    }

    /// Specific force along the thrust that carries the weight at the tilt of a row, m/s²: g/(cos φ cos θ), and g where the log has no attitude.
    pub(crate) fn weight_along_thrust(&self, row: usize) -> f64 {
        let upright = self
            .attitude
            .as_ref()
            .map_or(1.0, |[roll, pitch, _]| roll[row].cos() * pitch[row].cos());
        if upright > TILT_END_RAD.cos() {
            GRAVITY / upright
        } else {
            GRAVITY
        }
    }

    /// Rows in the air, split into pieces of about `seconds`, none shorter than half of it.
    pub(crate) fn pieces(&self, seconds: f64) -> Vec<Range<usize>> {
        let length = self.rows_of(seconds);
        self.airborne
            .iter()
            .flat_map(|part| {
                let count = ((part.len() as f64 / length as f64).round() as usize).max(1);
                let size = part.len() / count;
                (0..count).map(move |i| part.start + i * size..part.start + (i + 1) * size)
            })
            .filter(|piece| 2 * piece.len() >= length)
            .collect()
    }

    /// The longest quiet second or more before the rotors turn: mean |a|, compared with gravity.
    fn find_rest(&mut self) {
        let [Some(x), Some(y), Some(z)] = &self.accel else {
            return;
        };
        let idle = self.ground_level();
        let block = self.rows_of(1.0);
        let rates = self.rates.as_ref().map(|rates| rates.each_ref().map(Vec::as_slice));
        let mut quiet: Vec<(usize, f64)> = Vec::new();
        let mut start = 0;
        while start + block <= self.rows {
            let rows = start..start + block;
            if rows.clone().all(|k| self.mean_duty(k) <= idle)
                && let Some(mean) = quiet_mean([x, y, z], rates, rows)
            {
                quiet.push((start, mean));
            }
            start += block;
        }
        let Some(scale) = scale_of(quiet.iter().map(|(_, mean)| *mean).collect(), GRAVITY) else {
            return;
        };
        self.rest = Some(quiet[0].0..quiet[quiet.len() - 1].0 + block);
        // A good calibration leaves a tenth of a per cent.
        if (scale - 1.0).abs() > 0.002 {
            for axis in self.accel.iter_mut().flatten() {
                axis.iter_mut().for_each(|value| *value /= scale);
            }
            self.notes.push(format!(
                "{}: at rest the accelerometer reads {:.3} m/s²; its readings are divided by {scale:.4}",
                self.name,
                scale * GRAVITY
            ));
        }
        self.accel_scale = Some(scale);
    }

    /// Duty below which the vehicle is on the ground; 0 if the log has no time on the ground.
    fn ground_level(&self) -> f64 {
        let (low, usual, high) = self.levels();
        let high = if high > AGILE * usual { usual } else { high };
        if low > 0.55 * high { 0.0 } else { 0.5 * (low + high) }
    }

    /// Whether the pilot flies pull-ups and falls rather than hover and cruise.
    fn is_agile(&self) -> bool {
        let (_, usual, high) = self.levels();
        high > AGILE * usual
    }

    /// Mean duty: 2 % level, median of what is clearly above it, 90 % level.
    fn levels(&self) -> (f64, f64, f64) {
        let mut means: Vec<f64> = (0..self.rows).map(|k| self.mean_duty(k)).collect();
        means.retain(|mean| mean.is_finite());
        if means.is_empty() {
            return (0.0, 0.0, 0.0);
        }
        means.sort_by(f64::total_cmp);
        let level = |share: f64| means[((means.len() - 1) as f64 * share) as usize];
        let (low, high) = (level(0.02), level(0.9));
        let flown = &means[means.partition_point(|mean| *mean < low + 0.25 * (high - low))..];
        (low, flown[flown.len() / 2], high)
    }

    fn find_airborne(&mut self) -> Result<(), String> {
        let ground = self.ground_level();
        let agile = self.is_agile();
        let (force_flight, force_end) = if agile {
            (AGILE_FORCE, AGILE_END)
        } else {
            (FORCE_FLIGHT, FORCE_END)
        };
        let half = self.rows_of(0.5);
        let smooth = |values: &[f64]| running_mean(values, half);
        let duty: Vec<f64> = smooth(&(0..self.rows).map(|k| self.mean_duty(k)).collect::<Vec<_>>());
        let lift = self.lift();
        let lift_mean = lift.as_deref().map(smooth);
        // 20 Hz: vibration is not a crash.
        let fast = self.rows_of(0.025);
        let shock = lift.as_deref().map(|lift| running_mean(lift, fast));
        let tilted = |k: usize| {
            self.attitude
                .as_ref()
                .is_some_and(|[roll, pitch, _]| (roll[k].cos() * pitch[k].cos()) < TILT_END_RAD.cos())
        };
        let has_values = |k: usize| {
            self.duty.iter().all(|duty| duty[k].is_finite())
                && self
                    .rates
                    .as_ref()
                    .is_none_or(|rates| rates.iter().all(|rate| rate[k].is_finite()))
                && self.accel[2].as_ref().is_none_or(|z| z[k].is_finite())
        };
        let driven = |k: usize| duty[k] > ground && duty[k] > 0.03;
        let flies = |k: usize| {
            driven(k)
                && lift_mean.as_ref().is_none_or(|lift| force_flight.contains(&lift[k]))
                && shock.as_ref().is_none_or(|shock| shock[k].abs() < force_end)
                && !tilted(k)
                && has_values(k)
        };
        let falls = |k: usize| lift_mean.as_ref().is_some_and(|lift| lift[k] < FALLS);
        let cut_log = self.rows_of(CUT_LOG_S);
        let shortest = self.rows_of(SHORTEST_S);
        let mut flights: Vec<Range<usize>> = Vec::new();
        let mut start = None;
        for k in 0..=self.rows {
            let up = k < self.rows && flies(k);
            match (up, start) {
                (true, None) => start = Some(k),
                (false, Some(from)) => {
                    flights.push(from..k);
                    start = None;
                }
                _ => {}
            }
        }
        let excursion = self.rows_of(EXCURSION_S);
        // A gap in the log, or an excursion between two stretches of flight, is neither landing nor take-off.
        let stays_up = |apart: Range<usize>| {
            let short = apart.len() < excursion;
            apart.clone().all(|k| !has_values(k))
                || short && (agile || apart.clone().all(|k| !has_values(k) || driven(k) || falls(k)))
        };
        let without_ends = |cut_s: f64| -> Vec<Range<usize>> {
            let cut = self.rows_of(cut_s);
            let inner = flights.iter().enumerate().map(|(index, flight)| {
                let before = index.checked_sub(1).map(|before| flights[before].end..flight.start);
                let after = flights.get(index + 1).map(|after| flight.end..after.start);
                let comes_back = |apart: Option<Range<usize>>| apart.is_some_and(stays_up);
                let at_begin = flight.start == 0 || comes_back(before);
                let at_end = flight.end == self.rows || comes_back(after);
                let begin = flight.start + if at_begin { cut_log } else { cut };
                let end = flight.end.saturating_sub(if at_end { cut_log } else { cut });
                begin..end
            });
            inner.filter(|part| part.end >= part.start + shortest).collect()
        };
        let mut parts = without_ends(CUT_GROUND_S);
        if parts.is_empty() {
            parts = without_ends(CUT_SHORT_S);
            if parts.is_empty() {
                let share = |is: &dyn Fn(usize) -> bool| {
                    let driven = (0..self.rows).filter(|k| duty[*k] > ground && duty[*k] > 0.03);
                    let (count, of) = driven.fold((0, 0), |(count, of), k| (count + usize::from(is(k)), of + 1));
                    (of > 0).then(|| 100.0 * count as f64 / of as f64)
                };
                let flown: usize = flights.iter().map(ExactSizeIterator::len).sum();
                let longest = flights.iter().map(ExactSizeIterator::len).max().unwrap_or(0);
                let holes = flights
                    .windows(2)
                    .filter(|pair| (pair[0].end..pair[1].start).all(|k| !has_values(k)))
                    .count();
                let forceless = |k: usize| lift_mean.as_ref().is_some_and(|lift| !force_flight.contains(&lift[k]));
                let why = match (share(&forceless), share(&tilted)) {
                    _ if holes > 0 && flown >= shortest => format!(
                        "of {:.1} s that look like flight the longest stretch without a hole in the log is {:.1} s ({holes} gaps)",
                        flown as f64 * self.step_s,
                        longest as f64 * self.step_s
                    ),
                    (None, _) => "the motors idle".to_owned(),
                    (Some(force), _) if force > 20.0 => format!(
                        "in {force:.0} % of the time with the motors up, the accelerometer's mean along the thrust is outside of {} to {} m/s², which \
                         carries no vehicle: vibration or a wrong range spoils it",
                        force_flight.start, force_flight.end
                    ),
                    (_, Some(tilt)) if tilt > 20.0 => format!("in {tilt:.0} % of it the tilt is above 70°"),
                    _ => "the motors idle, or the specific force or the tilt is not that of flight".to_owned(),
                };
                return Err(format!(
                    "{}: expected at least {SHORTEST_S} s of flight (after {CUT_SHORT_S} s from take-off and before landing), found none: {why}",
                    self.name
                ));
            }
            self.notes.push(format!(
                "{}: no flight of {SHORTEST_S} s is {CUT_GROUND_S} s away from take-off and landing; {CUT_SHORT_S} s is left out at either end, so that \
                 launch, ground or catch may still be in it",
                self.name
            ));
        }
        self.airborne = parts;
        self.thin_out();
        Ok(())
    }

    /// Evenly spread pieces of a long flight.
    fn thin_out(&mut self) {
        let total = self.airborne_s();
        if total <= MOST_SECONDS {
            return;
        }
        let keep = MOST_SECONDS / total;
        let pieces = self.pieces(20.0 / keep);
        self.airborne = pieces
            .into_iter()
            .map(|piece| piece.start..piece.start + (piece.len() as f64 * keep) as usize)
            .collect();
        self.notes.push(format!(
            "{}: {total:.0} s in the air, of which {:.0} s in {} evenly spread pieces are fitted",
            self.name,
            self.airborne_s(),
            self.airborne.len()
        ));
    }
}

/// Mean and deviation.
pub(crate) fn mean_deviation(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let (mut count, mut sum, mut squares) = (0.0, 0.0, 0.0);
    for value in values {
        count += 1.0;
        sum += value;
        squares += value * value;
    }
    let mean = sum / count;
    (mean, (squares / count - mean * mean).max(0.0).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// In the air from end to end at 500 Hz, without the rows that `dropped` selects; duty and force along the thrust
    /// as functions of time.
    fn log(seconds: f64, dropped: impl Fn(f64) -> bool, flown: impl Fn(f64) -> (f64, f64)) -> FlightLog {
        let rows = (500.0 * seconds) as usize;
        let time: Vec<f64> = (0..rows).map(|k| 0.002 * k as f64).filter(|t| !dropped(*t)).collect();
        let of = |f: &dyn Fn(f64) -> f64| -> Vec<f64> { time.iter().map(|t| f(*t)).collect() };
        let mut columns: Vec<(String, Vec<f64>)> = (1..=4)
            .map(|rotor| (format!("duty_{rotor}"), of(&|t| flown(t).0 + 0.01 * (5.0 * t).sin())))
            .collect();
        columns.push(("accel_z_m_s2".to_owned(), of(&|t| -flown(t).1)));
        for name in names::RATES {
            columns.push((name.to_owned(), of(&|t| 0.1 * (7.0 * t).sin())));
        }
        FlightLog::from_columns("made", time, columns).expect("a log")
    }

    fn airborne(log: &FlightLog) -> Result<Vec<(f64, f64)>, String> {
        let grid = Grid::new(log, &[1, 2, 3, 4])?;
        let second = |row: usize| grid.start_s + row as f64 * grid.step_s;
        Ok(grid
            .airborne
            .iter()
            .map(|part| (second(part.start), second(part.end)))
            .collect())
    }

    /// A recorder that drops 10 ms every 1.2 s used to give "no flight, the motors idle".
    #[test]
    fn regress_rows_that_a_recorder_drops_are_no_landing() {
        let hover = |_: f64| (0.5, 9.81);
        let found = airborne(&log(14.0, |t| t % 1.2 > 1.19, hover)).expect("a flight");
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(found[0].0 < 0.6 && found[0].1 > 13.4, "{found:?}");
        // A gap of half a second costs as much as an end of the log, on both sides.
        let found = airborne(&log(14.0, |t| (6.0..6.5).contains(&t), hover)).expect("a flight");
        assert_eq!(found.len(), 2, "{found:?}");
        assert!(
            (found[0].1 - 5.5).abs() < 0.05 && (found[1].0 - 7.0).abs() < 0.05,
            "{found:?}"
        );
        // If gaps leave nothing, the refusal says so.
        let refusal = airborne(&log(14.0, |t| t % 2.0 > 1.8, hover)).expect_err("too short");
        assert!(
            refusal.contains("the longest stretch without a hole in the log is 1.8 s"),
            "{refusal}"
        );
    }

    /// A punch to full throttle followed by free fall, as the documentation recommends, used to end the flight like a
    /// landing.
    #[test]
    fn regress_a_throttle_pulse_and_its_fall_are_no_landing() {
        let pulsed = |ground: bool| {
            let flown = move |t: f64| match t {
                5.0..5.4 => (0.95, 40.0),
                5.4..6.4 if ground => (0.05, 9.81),
                5.4..6.4 => (0.05, 0.6),
                _ => (0.3, 9.81),
            };
            airborne(&log(20.0, |_| false, flown)).expect("a flight")
        };
        let found = pulsed(false);
        assert!(found.len() == 2 && found[0].1 > 3.9 && found[1].0 < 7.6, "{found:?}");
        // A vehicle that measures its weight with its motors low is on the ground.
        let found = pulsed(true);
        assert!(found.len() == 2 && found[1].0 > 9.3, "{found:?}");
    }
}
