//! A flight log on a uniform grid: measured kinematics raw and smoothed, missing samples, airborne parts.
//!
//! Residuals use the raw values, sensitivities the smoothed ones: raw noise in a regressor biases its coefficient towards 0 and
//! invents scale errors (errors in variables). The smoother is a Hann window of 0.15 s in all, symmetric, so that it has no phase.
//! Torques use the rates of an observer in both (`pass/body.rs`).

use std::sync::Arc;

use rotortwin_plant::Vector3;

use super::channels::{KA, KP, KV, M, V};
use super::vectors::rotation;
use crate::log::RotorOrder;
use crate::log::rest::{quiet_mean, scale_of};
use crate::log::{FlightLog, SensorRate, names};

/// Whole length of the Hann window, s.
pub const SMOOTHING_S: f64 = 0.15;
/// Seconds without weight at either end, where filters and the unknown initial thrust settle.
pub const EDGE_S: f64 = 0.4;
/// Share of the weight that the rotors must lift for a sample to count as flight.
const FLYING_SHARE: f64 = 0.3;
/// Jitter of the intervals above which the log is resampled.
const JITTER: f64 = 0.02;

/// A vector at every sample, shared between all users of the same values.
pub type Vectors = Arc<Vec<Vector3>>;

/// Measured motion of the vehicle.
#[derive(Debug, Clone, Default)]
pub struct Kinematics {
    /// m, NED.
    pub position: Vectors,
    /// m/s, NED.
    pub velocity: Vectors,
    /// Roll, pitch, yaw, rad; yaw and roll unwrapped.
    pub attitude: Vectors,
    /// rad/s, body.
    pub rates: Vectors,
    /// Angular acceleration by central differences, rad/s², body.
    pub angular_acceleration: Vectors,
    /// Specific force, m/s², body.
    pub accel: Vectors,
    /// Specific force, smoothed twice over ([`twiced`]): the input of effects. Empty for raw readings; a pass fills it.
    pub driving_accel: Vectors,
    /// Rates as measured, which the torques' observer follows; a pass fills it.
    pub observed_rates: Vectors,
    /// NED from body, rows first; empty where samples are missing.
    pub ned_from_body: Arc<Vec<[Vector3; 3]>>,
}

/// Which signals the log contains.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Available {
    /// Position.
    pub position: bool,
    /// Velocity.
    pub velocity: bool,
    /// Attitude.
    pub attitude: bool,
    /// Body rates.
    pub rates: bool,
    /// Accelerometer.
    pub accel: bool,
    /// Battery voltage.
    pub voltage: bool,
    /// Height above ground; without it the ground is assumed at the origin of NED.
    pub height_above_ground: bool,
}

/// What drives the rotors of the model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Drive {
    /// Duties (Eq. 19, lag).
    Duty,
    /// Measured rotor speeds: f = f_h (Ω/Ω_h)², no lag.
    RotorSpeed,
    /// A commanded wrench, allocated to the rotors, then the lag.
    Wrench,
    /// Nothing: force, torque and voltage channels are not testable.
    None,
}

/// Deviations of readings that are held or interpolated from slower streams, worst axis; 0 where every row is new.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct SlowNoise {
    /// m.
    pub position: f64,
    /// Corrections of a slow position relative to its velocity, a random walk: m/√s.
    pub corrections: f64,
    /// m/s.
    pub velocity: f64,
    /// rad.
    pub attitude: f64,
    /// Corrections of an estimator's attitude relative to its rates, a random walk, axis by axis: rad/√s.
    pub turns: [f64; 3],
    /// rad/s.
    pub rates: f64,
    /// m/s².
    pub accel: f64,
    /// V.
    pub voltage: f64,
    /// The same of a single row, V.
    pub voltage_row: f64,
    /// Noise of a reading of the voltage, without what the rows between two readings miss, V; 0 where every row is new.
    pub voltage_reading: f64,
    /// True where values of position or velocity are held.
    pub is_held: bool,
    /// Rows per reading of the voltage; 1 where every row is new.
    pub voltage_rows: f64,
    /// Commanded duty between two samples of the outputs, as white noise on every row with the same effect over many: fraction.
    pub duty: f64,
    /// Mean duty, fraction; 1 where there is none.
    pub mean_duty: f64,
    /// Time between samples of the command, s; 0 where every row is new.
    pub command_s: f64,
    /// How to have it sampled faster.
    pub faster_command: &'static str,
}

impl SlowNoise {
    fn of(log: &FlightLog, air: &[(f64, f64)], notes: &mut Vec<String>) -> Self {
        let mut told = Vec::new();
        let mut worst = |what: &str, unit: &str, columns: &[&str]| {
            let slow: Vec<_> = columns
                .iter()
                .filter_map(|column| log.source_rate(column))
                .filter(SensorRate::is_slower)
                .collect();
            let worst = |of: &dyn Fn(&SensorRate) -> f64| slow.iter().map(of).fold(0.0, f64::max);
            let deviation = worst(&SensorRate::deviation);
            if let Some(rate) = slow.iter().min_by(|a, b| a.source_hz.total_cmp(&b.source_hz)) {
                told.push(format!("{what} {:.1} Hz (1σ {deviation:.2e} {unit})", rate.source_hz));
            }
            // A held value keeps its error until the next one: that counts like a larger one that is new on each row.
            worst(&|rate| {
                let rows = if rate.held { rate.rows_hz / rate.source_hz } else { 1.0 };
                rate.deviation() * rows.sqrt()
            })
        };
        let voltage = log.source_rate(names::BATTERY_VOLTAGE).filter(SensorRate::is_slower);
        let mut slow = Self {
            position: worst("position", "m", &names::POSITION),
            corrections: 0.0,
            velocity: worst("velocity", "m/s", &names::VELOCITY),
            attitude: worst("attitude", "rad", &names::ATTITUDE),
            turns: [0.0; 3],
            rates: worst("rates", "rad/s", &names::RATES),
            accel: worst("specific force", "m/s²", &names::ACCEL),
            voltage: worst("voltage", "V", &[names::BATTERY_VOLTAGE]),
            is_held: names::POSITION
                .iter()
                .chain(&names::VELOCITY)
                .filter_map(|column| log.source_rate(column))
                .any(|rate| rate.held && rate.is_slower()),
            voltage_row: voltage.as_ref().map_or(0.0, SensorRate::deviation),
            voltage_reading: voltage.as_ref().map_or(0.0, |rate| rate.noise),
            voltage_rows: voltage.map_or(1.0, |rate| rate.rows_hz / rate.source_hz),
            duty: 0.0,
            mean_duty: 1.0,
            command_s: command_rate(log)
                .filter(SensorRate::is_slower)
                .map_or(0.0, |rate| 1.0 / rate.source_hz),
            faster_command: log.source.kind.faster_outputs(),
        };
        if slow.position > 0.0 || log.source.kind.is_of_an_estimator() {
            // An estimator's position is not the integral of its velocity: fixes correct it.
            slow.corrections = log.position_corrections();
        }
        if slow.attitude > 0.0 || slow.rates > 0.0 || log.source.kind.is_of_an_estimator() {
            slow.turns = log.attitude_corrections(air);
        }
        if let Some(rate) = log.duty_rate().filter(SensorRate::is_slower) {
            // An error that persists for n rows has √n times the effect over many rows of one that is new on each.
            slow.duty = rate.between * (rate.rows_hz / rate.source_hz).sqrt();
            // On the ground they idle: the thrust per duty there is not that of hover.
            let flies: Vec<bool> = (log.time_s.iter())
                .map(|time| air.is_empty() || air.iter().any(|(from, to)| (from..=to).contains(&time)))
                .collect();
            let duties = log.duties();
            let values = || {
                duties
                    .iter()
                    .flat_map(|duty| duty.iter().zip(&flies))
                    .filter(|(value, flies)| **flies && value.is_finite())
                    .map(|(value, _)| *value)
            };
            slow.mean_duty = values().sum::<f64>() / values().count().max(1) as f64;
            // Whether an output that repeats is the command in effect or a sample of one that went on, the log does not show.
            let bound = if rate.held {
                "; at most, as a command that is held may be known in every row: force and torque may be known better than their noise says"
            } else {
                ""
            };
            told.push(format!(
                "motor outputs {:.1} Hz (1σ {:.3}{bound})",
                rate.source_hz, rate.between
            ));
        }
        if !told.is_empty() {
            notes.push(format!(
                "slower than the rows ({:.1} Hz), so their noise includes that of the source and of the interpolation between its samples: {}",
                log.sample_rate_hz(),
                told.join(", ")
            ));
        }
        if slow.corrections > 0.0 {
            notes.push(format!(
                "position comes from an estimator: its corrections relative to its own velocity (a random walk of {:.2} m/√s) count as noise, so position shows nothing \
                 smaller about the vehicle",
                slow.corrections
            ));
        }
        let most = slow.turns.into_iter().fold(0.0, f64::max);
        if most > 0.0 {
            notes.push(format!(
                "attitude comes from an estimator, or is slower than the rates: its corrections relative to them (a random walk of {most:.1e} rad/√s) count as noise, so \
                 attitude shows nothing smaller about the vehicle"
            ));
        }
        slow
    }
}

/// Rate of the motor outputs, of the commanded wrench without any.
fn command_rate(log: &FlightLog) -> Option<SensorRate> {
    let wrench = names::TORQUE_COMMAND.iter().chain([&names::THRUST_COMMAND]);
    let rates = wrench.filter_map(|column| log.source_rate(column));
    let fastest = || rates.max_by(|a, b| a.source_hz.total_cmp(&b.source_hz));
    log.duty_rate().or_else(fastest)
}

/// A log on a uniform grid.
#[derive(Debug, Clone)]
pub struct Series {
    /// Time of the first sample, s.
    pub start_s: f64,
    /// Step, s.
    pub step_s: f64,
    /// Number of samples.
    pub len: usize,
    /// Number of rotors.
    pub rotors: usize,
    /// As measured; NaN where there is no measurement.
    pub raw: Kinematics,
    /// The same with gaps bridged by linear interpolation, if there are any: models with states of their own must not
    /// encounter NaN. Such samples do not count.
    pub bridged: Option<Kinematics>,
    /// Smoothed with [`SMOOTHING_S`].
    pub smooth: Kinematics,
    /// Input of each rotor, sample by sample (`k * rotors + i`): duty, or rotor speed in rad/s; thrust N for [`Drive::Wrench`].
    pub input: Vec<f64>,
    /// Kind of the input.
    pub drive: Drive,
    /// V; empty if missing.
    pub voltage: Vec<f64>,
    /// Height above ground, m; infinite where unknown.
    pub height: Vec<f64>,
    /// Which columns there are.
    pub available: Available,
    /// Noise of readings that are held or interpolated from slower streams; 0 where every row is new.
    pub slow: SlowNoise,
    /// In the air, upright and clear of the ground, from and to, s: only this is judged.
    pub air: Vec<(f64, f64)>,
    /// What was left out or done, in words.
    pub notes: Vec<String>,
}

impl Series {
    /// Puts a log on a uniform grid. `allocate` turns a commanded wrench (thrust, torque) into rotor thrusts.
    ///
    /// # Errors
    /// One sentence if the log contains nothing with which a vehicle with `rotors` rotors could be tested.
    pub fn new(log: &FlightLog, rotors: usize, allocate: impl Fn(f64, Vector3) -> Vec<f64>) -> Result<Self, String> {
        let rate = log.sample_rate_hz();
        if !(rate.is_finite() && rate > 0.0) {
            return Err(format!("{}: expected a sample rate above 0, got {rate} Hz", log.name));
        }
        let mut notes = Vec::new();
        if let RotorOrder::Vehicle(note) = &log.report.rotor_order {
            // The notes are shown elsewhere with the name of their log.
            let of_this = format!("{}: ", log.name);
            notes.push(note.strip_prefix(&of_this).unwrap_or(note).to_owned());
        }
        let thinned;
        let (log, rate) = match thinning(log.time_s.len(), rate) {
            None => (log, rate),
            Some(factor) => {
                notes.push(format!(
                    "{} rows at {rate:.0} Hz, taken as means of {factor}: a search over all of them would take minutes, and what is faster is \
                     vibration and filters; `LOG@a:b` of less than {:.0} s is taken as it is",
                    log.time_s.len(),
                    MOST_FAST_ROWS as f64 / rate
                ));
                thinned = log.thinned(factor);
                (&thinned, thinned.sample_rate_hz())
            }
        };
        let centred = log.with_centred_holds();
        let log = centred.as_ref().unwrap_or(log);
        let duration = log.duration_s();
        let air = in_the_air(log, &mut notes)?;
        let slow = SlowNoise::of(log, &air, &mut notes);
        let uniform = {
            let step = duration / (log.time_s.len() as f64 - 1.0);
            let start = log.time_s[0];
            log.time_s
                .iter()
                .enumerate()
                .all(|(k, &t)| (t - start - k as f64 * step).abs() < JITTER.max(1e-9) * step * 5.0)
        };
        let resampled;
        let log = if uniform {
            log
        } else {
            notes.push(format!("time base is not uniform: resampled to {rate:.3} Hz"));
            resampled = log.resampled(rate)?;
            &resampled
        };
        let n = log.time_s.len();
        if duration < 2.0 * EDGE_S + 1.0 || n < 50 {
            return Err(format!(
                "{}: expected at least {:.1} s and 50 rows of flight, got {duration:.2} s and {n} rows",
                log.name,
                2.0 * EDGE_S + 1.0
            ));
        }
        let step_s = duration / (n as f64 - 1.0);
        let vector = |names: [&str; 3]| {
            log.vector(names)
                .map(|[x, y, z]| (0..n).map(|k| [x[k], y[k], z[k]]).collect::<Vec<Vector3>>())
        };
        let (position, velocity, rates, accel) = (
            vector(names::POSITION),
            vector(names::VELOCITY),
            vector(names::RATES),
            vector(names::ACCEL),
        );
        let accel = match (accel, rest_scale(log, air.first().map_or(f64::NAN, |first| first.0))) {
            (Some(mut readings), Some(scale)) => {
                notes.push(format!(
                    "at rest before take-off the accelerometer reads {:.3} m/s²; its readings are divided by {scale:.4}",
                    scale * GRAVITY_M_S2
                ));
                readings.iter_mut().flatten().for_each(|reading| *reading /= scale);
                Some(readings)
            }
            (accel, _) => accel,
        };
        let attitude = vector(names::ATTITUDE).map(unwrapped);
        let voltage = log.column(names::BATTERY_VOLTAGE).map(<[f64]>::to_vec);
        let available = Available {
            position: position.is_some(),
            velocity: velocity.is_some(),
            attitude: attitude.is_some(),
            rates: rates.is_some(),
            accel: accel.is_some(),
            voltage: voltage.is_some(),
            height_above_ground: log.column(names::HEIGHT_ABOVE_GROUND).is_some(),
        };
        let zero = || vec![[0.0; 3]; n];
        let height = log.column(names::HEIGHT_ABOVE_GROUND).map_or_else(
            || match &position {
                Some(position) => position.iter().map(|p| -p[2]).collect(),
                None => vec![f64::INFINITY; n],
            },
            <[f64]>::to_vec,
        );
        let (drive, input) = rotor_input(log, rotors, &allocate, &mut notes)?;
        let mut raw = Kinematics {
            angular_acceleration: rates.as_ref().map_or_else(zero, |r| derivative(r, step_s)).into(),
            position: position.unwrap_or_else(zero).into(),
            velocity: velocity.unwrap_or_else(zero).into(),
            attitude: attitude.unwrap_or_else(zero).into(),
            rates: rates.unwrap_or_else(zero).into(),
            accel: accel.unwrap_or_else(zero).into(),
            ..Kinematics::default()
        };
        let bridged = if raw.is_whole() {
            raw.ned_from_body = rotations(&raw.attitude);
            None
        } else {
            Some(raw.bridged())
        };
        let half = (0.5 * SMOOTHING_S / step_s).round() as usize;
        let smoothed = |x: &[Vector3]| self::bridged(hann(x, half));
        let rates = smoothed(&raw.rates);
        let accel = smoothed(&raw.accel);
        let attitude = smoothed(&raw.attitude);
        let smooth = Kinematics {
            position: smoothed(&raw.position).into(),
            velocity: smoothed(&raw.velocity).into(),
            ned_from_body: rotations(&attitude),
            attitude: attitude.into(),
            angular_acceleration: derivative(&rates, step_s).into(),
            rates: rates.into(),
            driving_accel: twiced(&accel, half).into(),
            accel: accel.into(),
            observed_rates: Vectors::default(),
        };
        Ok(Self {
            start_s: log.time_s[0],
            step_s,
            len: n,
            rotors,
            raw,
            bridged,
            smooth,
            input,
            drive,
            voltage: voltage.unwrap_or_default(),
            height,
            available,
            slow,
            air,
            notes,
        })
    }

    /// Multiplies a commanded wrench, and adds a note.
    pub(crate) fn scale_command(&mut self, scale: f64) {
        for input in &mut self.input {
            *input *= scale;
        }
        self.notes.push(format!(
            "the commanded thrust is {:.2} times what the accelerometer and the mass of the model say: taken as uncalibrated and scaled by \
             {scale:.3}, so mass, air density and any common error of the thrust are not testable",
            1.0 / scale
        ));
    }

    /// As measured, gaps bridged.
    pub(crate) fn whole(&self) -> &Kinematics {
        self.bridged.as_ref().unwrap_or(&self.raw)
    }

    /// Time of sample `k`, s.
    pub fn time(&self, k: usize) -> f64 {
        self.start_s + k as f64 * self.step_s
    }

    /// False where the log has no row: everything there was bridged, the commands as well.
    pub(crate) fn has_row(&self, k: usize) -> bool {
        let (have, raw) = (self.available, &self.raw);
        let mut sensors = [
            (have.rates, &raw.rates),
            (have.accel, &raw.accel),
            (have.attitude, &raw.attitude),
            (have.velocity, &raw.velocity),
        ]
        .into_iter()
        .filter(|(there, _)| *there)
        .peekable();
        sensors.peek().is_none() || sensors.any(|(_, x)| is_finite(&x[k]))
    }

    /// True if everything that the prediction of a channel takes from the log at sample `k` was measured, not bridged.
    pub(crate) fn known(&self, channel: usize, k: usize) -> bool {
        let measured = |x: &[Vector3]| is_finite(&x[k]);
        let raw = &self.raw;
        match channel {
            KV..M => measured(&raw.attitude) && (!self.available.accel || measured(&raw.accel)),
            KA..KP => measured(&raw.attitude) && measured(&raw.rates),
            KP..V => measured(&raw.velocity),
            V => true,
            _ => measured(&raw.rates) && measured(&raw.velocity) && measured(&raw.attitude),
        }
    }

    /// True for samples in the air away from the ends: the rotors of the model lift a share of the weight.
    pub fn flying(&self, thrust: &[f64], weight_n: f64) -> Vec<bool> {
        let edge = (EDGE_S / self.step_s).ceil() as usize;
        let mut flying: Vec<bool> = (0..self.len)
            .map(|k| {
                let total: f64 = thrust[k * self.rotors..(k + 1) * self.rotors].iter().sum();
                k >= edge && k + edge < self.len && (self.drive == Drive::None || total > FLYING_SHARE * weight_n)
            })
            .collect();
        let mut parts = self.air.iter().peekable();
        for (k, flying) in flying.iter_mut().enumerate() {
            // Half a step of margin for the shift by resampling.
            let time = self.time(k);
            while parts.next_if(|part| part.1 + 0.5 * self.step_s < time).is_some() {}
            *flying &= parts.peek().is_some_and(|part| part.0 <= time + 0.5 * self.step_s);
        }
        // Take-off and landing touch the ground on either side of the edge.
        let ground: Vec<usize> = (edge..self.len - edge).filter(|&k| !flying[k]).collect();
        for k in ground {
            for near in k.saturating_sub(edge)..(k + edge).min(self.len) {
                flying[near] = false;
            }
        }
        flying
    }
}

/// What an accelerometer at rest must read, m/s².
const GRAVITY_M_S2: f64 = 9.81;
/// Seconds before take-off that do not count as rest.
const BEFORE_TAKE_OFF_S: f64 = 1.0;
/// Error of the scale from which readings are divided by it: smaller ones are an effect for a diagnosis to find.
const LEAST_SCALE_ERROR: f64 = 0.02;

/// Mean size of the specific force in the quiet seconds before take-off over gravity, if at least two seconds are quiet
/// and it is off by more than sensors ordinarily are. `vehicle from-log` corrects for the same, so the diagnosis of its
/// vehicle must use the same readings.
fn rest_scale(log: &FlightLog, take_off_s: f64) -> Option<f64> {
    let accel = log.vector(names::ACCEL)?;
    let rates = log.vector(names::RATES)?;
    let (mut quiet, mut first) = (Vec::new(), 0);
    for (k, &time) in log.time_s.iter().enumerate() {
        if time > take_off_s - BEFORE_TAKE_OFF_S {
            break;
        }
        if time - log.time_s[first] < 1.0 {
            continue;
        }
        quiet.extend(quiet_mean(accel, Some(rates), first..k));
        first = k;
    }
    let scale = scale_of(quiet, GRAVITY_M_S2)?;
    ((scale - 1.0).abs() > LEAST_SCALE_ERROR).then_some(scale)
}

/// Up to this many rows, a fast log is used row by row.
const MOST_FAST_ROWS: usize = 80_000;

/// How many rows of a long and fast log become one, so that some 250 a second remain.
fn thinning(rows: usize, rate_hz: f64) -> Option<usize> {
    const AIM_HZ: f64 = 250.0;
    let factor = (rate_hz / AIM_HZ).round() as usize;
    (rows > MOST_FAST_ROWS && factor > 1).then_some(factor)
}

/// Seconds of a log in which a model is judged; notes what is left out.
fn in_the_air(log: &FlightLog, notes: &mut Vec<String>) -> Result<Vec<(f64, f64)>, String> {
    let parts = log.flight_parts(None);
    let air = parts.in_the_air();
    let words = |spans: &[(f64, f64)]| {
        let shown: Vec<String> = spans
            .iter()
            .take(6)
            .map(|(a, b)| format!("{a:.1} to {b:.1} s"))
            .collect();
        let more = spans.len().saturating_sub(6);
        let more = if more > 0 {
            format!(" and {more} more")
        } else {
            String::new()
        };
        shown.join(", ") + &more
    };
    if air.is_empty() {
        return Err(format!(
            "{}: expected some seconds in the air, the log has none (`rotortwin log show` lists its parts)",
            log.name
        ));
    }
    let seconds: f64 = air.iter().map(|(a, b)| b - a).sum();
    if log.duration_s() - seconds > 0.1 {
        notes.push(format!(
            "judged in the air only, {} ({seconds:.1} of {:.1} s; `rotortwin log show` says what the rest is)",
            words(&air),
            log.duration_s()
        ));
    }
    Ok(air)
}

fn rotor_input(
    log: &FlightLog,
    rotors: usize,
    allocate: &impl Fn(f64, Vector3) -> Vec<f64>,
    notes: &mut Vec<String>,
) -> Result<(Drive, Vec<f64>), String> {
    let n = log.time_s.len();
    let interleave = |columns: &[&[f64]]| {
        let mut held = vec![0.0; rotors];
        let mut input = Vec::with_capacity(n * rotors);
        for k in 0..n {
            for (held, column) in held.iter_mut().zip(columns) {
                if column[k].is_finite() {
                    *held = column[k];
                }
            }
            input.extend_from_slice(&held);
        }
        input
    };
    let duties = log.duties();
    if !duties.is_empty() {
        if duties.len() != rotors {
            return Err(format!(
                "{}: expected the duties of {rotors} rotors, as the vehicle has, got {}",
                log.name,
                duties.len()
            ));
        }
        return Ok((Drive::Duty, interleave(&duties)));
    }
    let speeds: Vec<&[f64]> = (1..=rotors).map_while(|i| log.column(&names::rotor_speed(i))).collect();
    if speeds.len() == rotors {
        notes.push("no duties: rotor speeds drive the model (no lag, no command effects testable)".into());
        return Ok((Drive::RotorSpeed, interleave(&speeds)));
    }
    if let (Some(thrust), Some([x, y, z])) = (log.column(names::THRUST_COMMAND), log.vector(names::TORQUE_COMMAND)) {
        notes.push("no duties: the commanded wrench, allocated to the rotors, drives the model".into());
        let mut held = vec![0.0; rotors];
        let mut input = Vec::with_capacity(n * rotors);
        for k in 0..n {
            if [thrust[k], x[k], y[k], z[k]].iter().all(|v| v.is_finite()) {
                held = allocate(thrust[k], [x[k], y[k], z[k]]);
            }
            input.extend_from_slice(&held);
        }
        return Ok((Drive::Wrench, input));
    }
    notes.push(
        "neither duties nor rotor speeds nor a commanded wrench: forces, torques and voltage are not testable".into(),
    );
    Ok((Drive::None, vec![0.0; n * rotors]))
}

fn is_finite(v: &Vector3) -> bool {
    v.iter().all(|v| v.is_finite())
}

impl Kinematics {
    /// True if nothing is missing.
    fn is_whole(&self) -> bool {
        let all = [
            &self.position,
            &self.velocity,
            &self.attitude,
            &self.rates,
            &self.angular_acceleration,
            &self.accel,
        ];
        all.iter().all(|x| x.iter().all(is_finite))
    }

    fn bridged(&self) -> Self {
        let whole = |x: &Vectors| Arc::new(bridged(x.to_vec()));
        let attitude = whole(&self.attitude);
        Self {
            position: whole(&self.position),
            velocity: whole(&self.velocity),
            ned_from_body: rotations(&attitude),
            attitude,
            rates: whole(&self.rates),
            angular_acceleration: whole(&self.angular_acceleration),
            accel: whole(&self.accel),
            ..Self::default()
        }
    }
}

/// NED from body at every sample.
fn rotations(attitude: &[Vector3]) -> Arc<Vec<[Vector3; 3]>> {
    Arc::new(attitude.iter().map(|&attitude| rotation(attitude)).collect())
}

/// NaN bridged by linear interpolation between measurements, held at the ends; all 0 where nothing was ever measured.
fn bridged(x: Vec<Vector3>) -> Vec<Vector3> {
    let known: Vec<usize> = (0..x.len()).filter(|&k| is_finite(&x[k])).collect();
    if known.len() == x.len() {
        return x;
    }
    let (Some(&first), Some(&last)) = (known.first(), known.last()) else {
        return vec![[0.0; 3]; x.len()];
    };
    let mut out = x.clone();
    out[..first].fill(x[first]);
    out[last..].fill(x[last]);
    for pair in known.windows(2).filter(|pair| pair[1] - pair[0] > 1) {
        let (a, b) = (pair[0], pair[1]);
        for k in a + 1..b {
            let share = (k - a) as f64 / (b - a) as f64;
            out[k] = [0, 1, 2].map(|i| x[a][i] + share * (x[b][i] - x[a][i]));
        }
    }
    out
}

/// Euler angles without jumps of a full turn.
fn unwrapped(mut attitude: Vec<Vector3>) -> Vec<Vector3> {
    let turn = std::f64::consts::TAU;
    let mut before: Option<Vector3> = None;
    for angles in &mut attitude {
        if let Some(before) = before {
            for axis in [0, 2] {
                angles[axis] -= turn * ((angles[axis] - before[axis]) / turn).round();
            }
        }
        if angles.iter().all(|a| a.is_finite()) {
            before = Some(*angles);
        }
    }
    attitude
}

/// Central differences; one-sided at the ends.
fn derivative(x: &[Vector3], step_s: f64) -> Vec<Vector3> {
    let last = x.len() - 1;
    (0..x.len())
        .map(|k| {
            let (a, b) = (k.saturating_sub(1), (k + 1).min(last));
            let per = 1.0 / ((b - a) as f64 * step_s);
            [0, 1, 2].map(|i| (x[b][i] - x[a][i]) * per)
        })
        .collect()
}

/// Hann-weighted mean over `half` samples to either side; shorter, still symmetric, at the ends; NaN is ignored.
pub fn hann(x: &[Vector3], half: usize) -> Vec<Vector3> {
    if half == 0 {
        return x.to_vec();
    }
    let weights: Vec<f64> = (0..=half)
        .map(|j| 0.5 + 0.5 * libm::cos(std::f64::consts::PI * j as f64 / (half as f64 + 1.0)))
        .collect();
    let n = x.len();
    (0..n)
        .map(|k| {
            let reach = half.min(k).min(n - 1 - k);
            let (mut sum, mut total) = ([0.0; 3], 0.0);
            for (j, value) in x[k - reach..=k + reach].iter().enumerate() {
                if value[0].is_finite() && value[1].is_finite() && value[2].is_finite() {
                    let w = weights[j.abs_diff(reach)];
                    total += w;
                    for i in 0..3 {
                        sum[i] += w * value[i];
                    }
                }
            }
            if total > 0.0 {
                sum.map(|s| s / total)
            } else {
                [f64::NAN; 3]
            }
        })
        .collect()
}

/// 2x − Hx of a smoothed x = Hy: squares the window's loss at low frequencies, 1 − (1 − H)². For a pendulum of 2 s, a
/// driving signal that is 0.4 % too small makes the rope 0.04 % too short, many times its interval.
fn twiced(x: &[Vector3], half: usize) -> Vec<Vector3> {
    let again = hann(x, half);
    let twice = |(once, again): (&Vector3, &Vector3)| [0, 1, 2].map(|i| 2.0 * once[i] - again[i]);
    x.iter().zip(&again).map(twice).collect()
}

/// `x` at a time `shift_s` later, by cubic interpolation; values at the ends are held.
pub fn shifted(x: &[Vector3], shift_s: f64, step_s: f64) -> Vec<Vector3> {
    let samples = shift_s / step_s;
    let whole = samples.floor();
    let u = samples - whole;
    // Lagrange weights of the samples −1, 0, 1, 2.
    let w = [
        -u * (u - 1.0) * (u - 2.0) / 6.0,
        (u + 1.0) * (u - 1.0) * (u - 2.0) / 2.0,
        -(u + 1.0) * u * (u - 2.0) / 2.0,
        (u + 1.0) * u * (u - 1.0) / 6.0,
    ];
    let last = x.len() as i64 - 1;
    (0..=last)
        .map(|k| {
            let at = k + whole as i64;
            let mut sum = [0.0; 3];
            for (j, w) in w.iter().enumerate() {
                let sample = x[(at + j as i64 - 1).clamp(0, last) as usize];
                for i in 0..3 {
                    sum[i] += w * sample[i];
                }
            }
            sum
        })
        .collect()
}
