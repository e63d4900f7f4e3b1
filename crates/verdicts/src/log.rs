//! Evaluation of a whole flight log: verdicts over time, the final verdict, and missing channels.
//!
//! ```text
//!  file ─▶ twin::log ─▶ parts of the flight ─▶ constant rate ─▶ runs of complete steps in the air ─▶ FdiSession ─▶ LogReport
//! ```
//! Behind `POST /api/v1/fdi/reports` and `rotortwin fdi-log`. A log at 400 Hz is used unchanged, bit for bit. One of 32
//! to 400 Hz is judged at its own rate: interpolated rows have no noise of their own, so the detectors, which measure
//! the noise from row to row, would take the remaining noise for gusts. A faster one is resampled to 400 Hz, a slower
//! one to 32 Hz. Steps have its mean rate, each with the nearest row: rows are uneven by a few milliseconds, and linear
//! interpolation would remove half of the noise.
//!
//! Between rows further apart than the flight controller's steps there were duties that the log does not have. A row's
//! duty d then counts as
//!
//! ```text
//!  d_k + (d_k+1 − d_k) (1 − f/f_c)/2       f: rate of the log, f_c = 400 Hz: the mean until the next row of steps along a straight line
//! ```
//! Responses of the duties to sensor noise between rows stay unknown, and act as a white force.
//!
//! Duties of a stream slower than the rows lie on straight lines between its values, and what they did in between is a
//! white force ([`FdiSession::duties_every`]); duties that are held below [`SLOWEST_CONTROL_HZ`] are samples of a faster
//! command, too.
//!
//! Steps without a value in a channel that the detectors need are lost steps, handled like a gap in a session. A log
//! without velocity or attitude, or with a velocity slower than its rows, is judged by its
//! accelerometer ([`crate::axial`]), one without duties or a voltage by its rotor speeds if it has them
//! ([`crate::speeds`]), otherwise one without a voltage by its duties, and one with a slow voltage by both
//! ([`crate::voltage`]): `lacks` says what that costs.
//!
//! Only the airborne part is passed to the session: the log shows when the vehicle left the ground and when it
//! returned, which a session has to detect without the rest of the flight. A *stretch* is the part evaluated after one
//! calibration.

use crate::axial::Axial;
use crate::exchanged;
pub use crate::report::{DetectorCount, Lack, LogReport, LogView, NotJudgedView, StretchView, Suspicion};
use crate::sparse::with_voltage_in_every_row;
use crate::speeds::BySpeed;
use crate::turn_rates;
use crate::view::{
    ChangeView, DetectorsView, LoadView, ObstacleView, Obstruction, SequentialView, WindowView, code_in,
};
use crate::voltage::{WorkedOutVoltage, with_drops};
use rotortwin_fdi_session::session::LONGEST_CHUNK;
use rotortwin_fdi_session::validity::CANNOT_JUDGE;
use rotortwin_fdi_session::{Chunk, FdiSession, Learner, Learnt, Sample, Window};
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_flight_core::fdi::verdict_code::{HEALTHY, NOT_READY};
use rotortwin_flight_core::fdi::{FdiConfig, FdiConfigError};
use rotortwin_plant::STEP_RATE_HZ;
use rotortwin_scenario::Detectors;
use rotortwin_twin::log::flight_parts::{FlightPart, FlightParts, PartKind};
use rotortwin_twin::log::{FlightLog, GAP_FACTOR, RotorOrder, SensorRate, names};

/// Longest log, s: at 400 Hz, 5.8 million steps.
pub const LONGEST_S: f64 = 4.0 * 3600.0;
/// Maximum number of verdict changes in a report.
const LONGEST_TIMELINE: usize = 1000;
/// Cosine of 70°: the model is not valid beyond this tilt.
const UPRIGHT_COSINE: f64 = 0.342;
/// Lowest rate at which a log is judged, Hz: a window then has two samples.
const LOWEST_RATE_HZ: f64 = 32.0;
/// Below it a third of the losses of 5 % is found late or never; rates between 50 and 100 Hz were not measured.
const BLIND_BELOW_HZ: f64 = 75.0;
/// Correlation time of the gusts if the momentum is integrated from samples of the force that are far apart, since what
/// lies between them is white. s, and samples.
const FORCE_NOISE_TIME_S: f32 = 0.15;
const FORCE_NOISE_SAMPLES: f32 = 15.0;
/// Minimum number of samples before the calibration: 200 for measuring the noise, and a quarter more that do not count.
const NOISE_SAMPLES: f32 = 270.0;
/// Duties that are held between fewer new values per second are samples of faster ones, Hz: nothing flies on commands
/// this slow.
const SLOWEST_CONTROL_HZ: f64 = 30.0;
/// A median rate this close to 400 Hz counts as 400 Hz.
const SAME_RATE_HZ: f64 = 0.5;

/// Why a log cannot be evaluated.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct LogRefusal(String);

/// Channels required by the detectors: purpose and columns.
fn needed(rotor_count: usize) -> Vec<(&'static str, Vec<String>)> {
    let owned = |names: [&str; 3]| names.map(str::to_owned).to_vec();
    vec![
        (
            "the momentum of the vehicle, and so every residual (the accelerometer's accel_z_m_s2 would do, too)",
            owned(names::VELOCITY),
        ),
        (
            "the direction of thrust and weight, and so every residual (the accelerometer's accel_z_m_s2 would do, too)",
            owned(names::ATTITUDE),
        ),
        ("the angular momentum, and so every residual", owned(names::RATES)),
        (
            "the thrust that was commanded",
            (1..=rotor_count).map(names::duty).collect(),
        ),
    ]
}

/// The log has values of this column.
fn has(log: &FlightLog, name: &str) -> bool {
    let values = log.column(name);
    values.is_some_and(|values| values.iter().any(|value| !value.is_nan()))
}

/// Columns of velocity and attitude of which the log has no value.
fn without_motion(log: &FlightLog) -> Vec<String> {
    let needed = names::VELOCITY.iter().chain(&names::ATTITUDE);
    let missing = needed.filter(|name| !has(log, name));
    missing.map(|name| (*name).to_owned()).collect()
}

/// Rate at which a log is judged, Hz: its own, within the detectors' range.
fn judged_rate_hz(log: &FlightLog) -> f64 {
    let median_hz = log.sample_rate_hz();
    if median_hz > STEP_RATE_HZ - SAME_RATE_HZ {
        return STEP_RATE_HZ;
    }
    // The mean, where it differs: a median of uneven rows has steps between them.
    let intervals = log.time_s.windows(2).map(|pair| pair[1] - pair[0]);
    let (rows, time_s) = intervals
        .filter(|interval| interval * median_hz <= GAP_FACTOR)
        .fold((0.0, 0.0), |(rows, time_s), interval| (rows + 1.0, time_s + interval));
    let rate_hz = if rows > 0.0 { rows / time_s } else { median_hz };
    // A session's period is whole tens of nanoseconds.
    1e8 / (1e8 / rate_hz.clamp(LOWEST_RATE_HZ, STEP_RATE_HZ)).round()
}

/// Detectors for a rate other than 400 Hz: windows and calibration of about the same length, which begins when there
/// are enough samples to estimate the noise.
fn at_rate(config: &FdiConfig, rate_hz: f64) -> FdiConfig {
    let mut config = *config;
    if rate_hz >= STEP_RATE_HZ {
        return config;
    }
    let window_s = config.period * f32::from(config.window_len);
    config.period = (1.0 / rate_hz) as f32;
    config.window_len = (window_s / config.period).round().max(2.0) as u16;
    let later = (NOISE_SAMPLES * config.period - config.sequential.calibration_start).max(0.0);
    for time in [
        &mut config.sequential.calibration_start,
        &mut config.sequential.calibration_end,
        &mut config.t_test.baseline_start,
        &mut config.t_test.baseline_end,
    ] {
        *time += later;
    }
    config
}

/// A log of less than 400 Hz as steps of its mean rate, with duties averaged until the next row, see the module.
fn as_steps(log: &FlightLog, rate_hz: f64) -> FlightLog {
    let share = 0.5 * (1.0 - rate_hz / STEP_RATE_HZ);
    let gap_s = GAP_FACTOR / log.sample_rate_hz();
    let is_resampled = log.sample_rate_hz() < LOWEST_RATE_HZ;
    let mut log = log.clone();
    let steps = log.steps(rate_hz);
    let FlightLog { time_s, columns, .. } = &mut log;
    for (_, duty) in columns.iter_mut().filter(|(name, _)| names::duty_rotor(name).is_some()) {
        for row in 1..duty.len() {
            let change = duty[row] - duty[row - 1];
            if change.is_finite() && time_s[row] - time_s[row - 1] <= gap_s {
                duty[row - 1] += share * change;
            }
        }
    }
    if is_resampled || time_s.len() < 2 {
        return log;
    }
    let start_s = time_s[0];
    let step_times: Vec<f64> = (0..steps).map(|step| start_s + step as f64 / rate_hz).collect();
    let rows: Vec<Option<usize>> = step_times
        .iter()
        .map(|&step_s| {
            let after = time_s.partition_point(|time| *time < step_s).clamp(1, time_s.len() - 1);
            let [before_s, after_s] = [after - 1, after].map(|row| time_s[row]);
            let (row, off_s) = if step_s - before_s < after_s - step_s {
                (after - 1, step_s - before_s)
            } else {
                (after, (after_s - step_s).abs())
            };
            (after_s - before_s <= gap_s || off_s * rate_hz <= 0.5).then_some(row)
        })
        .collect();
    for values in columns.values_mut() {
        *values = rows.iter().map(|row| row.map_or(f64::NAN, |row| values[row])).collect();
    }
    *time_s = step_times;
    log
}

/// A column has new values less often than the log has rows: its rate, Hz.
fn slow_hz(log: &FlightLog, name: &str) -> Option<f64> {
    let rate = log.source_rate(name)?;
    rate.is_slower().then_some(rate.source_hz)
}

/// The duties come from a stream slower than the log's rows: its rate, Hz.
fn slow_duty_hz(log: &FlightLog) -> Option<f64> {
    let rate = log.duty_rate().filter(SensorRate::is_slower)?;
    (!rate.held || rate.source_hz < SLOWEST_CONTROL_HZ).then_some(rate.source_hz)
}

/// Duties that are held, but only because the log holds samples of them, as straight lines between these; `None`: they
/// are not.
fn with_duties_as_lines(log: &FlightLog) -> Option<FlightLog> {
    let rate = log.duty_rate().filter(|rate| rate.is_slower() && rate.held)?;
    if rate.source_hz >= SLOWEST_CONTROL_HZ {
        return None;
    }
    let longest_s = GAP_FACTOR / rate.source_hz;
    let mut log = log.clone();
    let FlightLog { time_s, columns, .. } = &mut log;
    for (_, duty) in columns.iter_mut().filter(|(name, _)| names::duty_rotor(name).is_some()) {
        let new: Vec<usize> = (1..duty.len()).filter(|row| duty[*row] != duty[row - 1]).collect();
        let pairs = new
            .windows(2)
            .filter(|pair| time_s[pair[1]] - time_s[pair[0]] <= longest_s);
        for pair in pairs {
            let [from, to] = [pair[0], pair[1]];
            let [start, change] = [duty[from], duty[to] - duty[from]];
            for row in from + 1..to {
                duty[row] = start + change * (time_s[row] - time_s[from]) / (time_s[to] - time_s[from]);
            }
        }
    }
    Some(log)
}

/// What cannot be determined with slow duties, Hz.
fn judged_between_duties(log: &FlightLog, rotor_count: usize, hz: f64) -> Lack {
    Lack {
        columns: (1..=rotor_count).map(names::duty).collect(),
        rules_out: format!(
            "small losses, and losses in a manoeuvre: the motor commands have {hz:.1} Hz in rows of {:.1} Hz, and what they were between two values counts as an \
             unknown force (smallest_loss says what would be seen)",
            log.sample_rate_hz()
        ),
        prevents_verdicts: false,
    }
}

/// What cannot be determined with a slow velocity, Hz, and no accelerometer at the log's own rate.
fn judged_by_lines(hz: f64, rate_hz: f64) -> Lack {
    Lack {
        columns: names::VELOCITY.map(str::to_owned).to_vec(),
        rules_out: format!(
            "losses of a few percent that would be seen otherwise: the velocity has {hz:.1} Hz in rows of {rate_hz:.1} Hz, and its noise lasts from row to row as a gust does \
             (an accel_z_m_s2 of the rows' rate would do; smallest_loss says what would be seen)"
        ),
        prevents_verdicts: false,
    }
}

/// What cannot be determined with a slow voltage, Hz.
fn judged_with_drops(hz: f64, rate_hz: f64) -> Lack {
    Lack {
        columns: vec![names::BATTERY_VOLTAGE.to_owned()],
        rules_out: format!(
            "intervals of a loss as true as they say: the voltage has {hz:.1} Hz in rows of {rate_hz:.1} Hz, and between its values it is worked out from the duties and the \
             vehicle's internal resistance, whose error is not in the intervals"
        ),
        prevents_verdicts: false,
    }
}

/// What cannot be determined if a log is judged by its accelerometer.
///
/// * `slow_hz`: of a velocity that exists but is slow
fn judged_by_force(log: &FlightLog, axial: &Axial, slow_hz: Option<f64>) -> Lack {
    let (mut columns, mut why) = (without_motion(log), "attitude and velocity of the vehicle".to_owned());
    if let (true, Some(hz)) = (columns.is_empty(), slow_hz) {
        columns = names::VELOCITY.map(str::to_owned).to_vec();
        why += &format!(", as the velocity has only {hz:.1} Hz");
    }
    Lack {
        columns,
        rules_out: format!(
            "{why}. The specific force along the rotors' axis is judged instead of the momentum; the drag along \
             that axis counts as unknown (0 ± {:.2} N·s/m, 95 %), drag across it as none, and an accelerometer away from the centre of mass as gusts: \
             intervals and the smallest detectable loss are larger for it",
            axial.drag
        ),
        prevents_verdicts: false,
    }
}

/// The log has a value of every rotor's duty.
fn has_duties(log: &FlightLog, rotor_count: usize) -> bool {
    (1..=rotor_count).all(|rotor| has(log, &names::duty(rotor)))
}

/// What cannot be determined if a log is judged by its rotor speeds.
fn judged_by_speeds(log: &FlightLog, rotor_count: usize, speeds: &BySpeed) -> Lack {
    let duties = (1..=rotor_count).map(names::duty);
    let columns = duties.chain([names::BATTERY_VOLTAGE.to_owned()]);
    Lack {
        columns: columns.filter(|name| !has(log, name)).collect(),
        rules_out: format!(
            "motors that turn too slowly for their commands, and losses common to all rotors. The thrust was taken from the measured rotor speeds, as {:.3e} N·s² times \
             their squares, which carried the weight in the first seconds in the air: what is judged is how much each propeller lifts at its speed",
            speeds.lift_coefficient
        ),
        prevents_verdicts: false,
    }
}

/// What the log lacks in addition to the voltage.
fn lacks(log: &FlightLog, detectors: &Detectors) -> Vec<Lack> {
    let mut lacks: Vec<Lack> = needed(detectors.vehicle().rotor_count())
        .into_iter()
        .filter_map(|(what_for, columns)| {
            let columns: Vec<String> = columns.into_iter().filter(|name| !has(log, name)).collect();
            (!columns.is_empty()).then(|| Lack {
                columns,
                rules_out: format!("all verdicts: they give {what_for}"),
                prevents_verdicts: true,
            })
        })
        .collect();
    if detectors.classifier().is_none() {
        lacks.push(Lack {
            columns: Vec::new(),
            rules_out: "verdicts of the network: no classifier was named".to_owned(),
            prevents_verdicts: false,
        });
    }
    lacks
}

/// The voltage of a log that has none, and what cannot be determined without it.
///
/// * `rate_hz`: of the requested steps   * `leak`: decay rate of the downward velocity, 1/s
fn without_voltage(
    log: &FlightLog,
    parts: &FlightParts,
    detectors: &Detectors,
    rate_hz: f64,
    leak: f64,
) -> (Option<WorkedOutVoltage>, Lack) {
    let columns = vec![names::BATTERY_VOLTAGE.to_owned()];
    match WorkedOutVoltage::of(log, parts, detectors, rate_hz, leak) {
        Ok(voltage) => {
            let begin = voltage.begin;
            let rules_out = format!(
                "losses common to all rotors, and losses as slow as the discharge of the battery. The voltage was inferred from the duties with the \
                 vehicle's battery: {:.2} V in the mean of {:.1} to {:.1} s, where the thrust carried the weight (charge {:.0} % at their \
                 beginning); the size of a loss counts from that",
                begin.voltage_v,
                begin.from_s,
                begin.to_s,
                100.0 * begin.state_of_charge
            );
            let lack = Lack {
                columns,
                rules_out,
                prevents_verdicts: false,
            };
            (Some(voltage), lack)
        }
        Err(why) => {
            let rules_out = format!(
                "all verdicts: it determines the thrust of a rotor at a duty, and cannot be inferred from the duties either: {why}"
            );
            let lack = Lack {
                columns,
                rules_out,
                prevents_verdicts: true,
            };
            (None, lack)
        }
    }
}

/// Evaluates an imported log.
///
/// * `every_window`: include every window in the report
///
/// # Errors
/// It belongs to another vehicle, its rotors are in a different order, or it is too long.
pub fn judge(log: &FlightLog, detectors: &Detectors, every_window: bool) -> Result<LogReport, LogRefusal> {
    judge_after(log, detectors, None, every_window)
}

/// [`judge`] with what was learnt about the vehicle from healthy flights ([`learn`]).
///
/// # Errors
/// As [`judge`].
pub fn judge_after(
    log: &FlightLog,
    detectors: &Detectors,
    learnt: Option<&Learnt>,
    every_window: bool,
) -> Result<LogReport, LogRefusal> {
    let session = |config: &FdiConfig| match learnt {
        Some(learnt) => FdiSession::with_learnt(config, 1, learnt),
        None => FdiSession::new(*config, 1),
    };
    let (judge, lacks) = run(log, detectors, every_window, session)?;
    Ok(report(log, detectors, judge, lacks))
}

/// What healthy flights reveal about the vehicle beyond the model of the detectors, and evidence against their being
/// healthy, a sentence each.
///
/// # Errors
/// One sentence: a log that [`judge`] would reject, or that lacks what every detector needs, or has too little time in
/// the air.
pub fn learn(logs: &[FlightLog], detectors: &Detectors) -> Result<(Learnt, Vec<String>), LogRefusal> {
    let mut learner = Learner::new(detectors.config());
    let mut notes = Vec::new();
    for log in logs {
        let of_log = |what: String| LogRefusal(format!("{}: {what}", log.name));
        let flight = learner.clone();
        let session = |config: &FdiConfig| Ok(FdiSession::new(*config, 1)?.that_learns(flight));
        let (judge, lacks) = run(log, detectors, false, session).map_err(|refusal| of_log(refusal.0))?;
        if let Some(lack) = lacks.iter().find(|lack| lack.prevents_verdicts) {
            let columns = lack.columns.join(", ");
            return Err(of_log(format!(
                "a log without {columns} cannot be used as a healthy flight"
            )));
        }
        let is_said = |stretch: &&(u64, StretchView)| stretch.1.sequential.verdict.code != HEALTHY;
        if let Some((_, stretch)) = judge.stretches.iter().find(is_said) {
            notes.push(format!(
                "{}, used as a healthy flight: the detectors found a fault in it at {:.1} s",
                log.name, stretch.to_s
            ));
        }
        learner = judge.session.into_learner().expect("it was given one");
    }
    let learnt = learner.learnt().ok_or_else(|| {
        LogRefusal(
            "the healthy flights hold less than 20 s in the air after a calibration, too little to learn from"
                .to_owned(),
        )
    })?;
    Ok((learnt, notes))
}

/// A log prepared for a session; and what it lacks.
fn run(
    log: &FlightLog,
    detectors: &Detectors,
    every_window: bool,
    session: impl FnOnce(&FdiConfig) -> Result<FdiSession, FdiConfigError>,
) -> Result<(Judge, Vec<Lack>), LogRefusal> {
    let rotor_count = detectors.vehicle().rotor_count();
    let duties = log.duties().len();
    if duties > 0 && duties != rotor_count {
        return Err(LogRefusal(format!(
            "the log has the duties of {duties} rotors, expected the {rotor_count} of the vehicle '{}'",
            detectors.vehicle().vehicle.name
        )));
    }
    let vehicle = &detectors.vehicle().vehicle;
    if let Some(refusal) = log.refusal_before_detection(vehicle) {
        return Err(LogRefusal(refusal));
    }
    if let Some(refusal) = exchanged::refusal(log, vehicle) {
        return Err(LogRefusal(refusal));
    }
    if log.duration_s() > LONGEST_S {
        return Err(LogRefusal(format!(
            "the log lasts {:.0} s, expected {LONGEST_S} s at most; judge parts of it",
            log.duration_s()
        )));
    }
    let whole = with_voltage_in_every_row(log);
    let (log, filled) = match &whole {
        Some((log, note)) => (log, Some(note)),
        None => (log, None),
    };
    let drawn = with_duties_as_lines(log);
    let log = drawn.as_ref().unwrap_or(log);
    let rate_hz = judged_rate_hz(log);
    // Rows of 400 Hz in the mean may be uneven.
    let is_slow = log.sample_rate_hz() < STEP_RATE_HZ - SAME_RATE_HZ;
    let slow_velocity = slow_hz(log, names::VELOCITY[2]);
    // An accelerometer at the log's own rate is more informative than an interpolated velocity.
    let by_force = has(log, names::ACCEL[2]) && slow_hz(log, names::ACCEL[2]).is_none();
    let axial = (!without_motion(log).is_empty() || slow_velocity.is_some() && by_force)
        .then(|| Axial::of(log, detectors.config()))
        .flatten();
    let (judged, config) = match &axial {
        Some(axial) => (&axial.log, &axial.config),
        None => (log, detectors.config()),
    };
    let parts = parts_of(log);
    let speeds = (!has_duties(log, rotor_count) || !has(log, names::BATTERY_VOLTAGE))
        .then(|| BySpeed::of(log, judged, config, &parts, detectors))
        .flatten();
    let (judged, config) = match &speeds {
        Some(speeds) => (&speeds.log, &speeds.config),
        None => (judged, config),
    };
    let mut config = at_rate(config, rate_hz);
    if is_slow && axial.is_some() {
        config.sequential.disturbance_correlation_time = FORCE_NOISE_TIME_S.max(FORCE_NOISE_SAMPLES / rate_hz as f32);
    }
    let mut steps = is_slow.then(|| as_steps(judged, rate_hz));
    let slow_voltage = slow_hz(log, names::BATTERY_VOLTAGE).filter(|_| speeds.is_none());
    if slow_voltage.is_some() {
        let rows_hz = if is_slow { rate_hz } else { log.sample_rate_hz() };
        with_drops(steps.get_or_insert_with(|| judged.clone()), detectors, rows_hz);
    }
    let judged = steps.as_ref().unwrap_or(judged);
    let mut lacks = lacks(judged, detectors);
    if let Some(hz) = slow_voltage {
        lacks.insert(0, judged_with_drops(hz, rate_hz));
    }
    let slow_duties = slow_duty_hz(log).filter(|_| speeds.is_none());
    if let Some(hz) = slow_duties {
        lacks.insert(0, judged_between_duties(log, rotor_count, hz));
    }
    match (&axial, slow_velocity) {
        (Some(axial), _) => lacks.insert(0, judged_by_force(log, axial, slow_velocity)),
        (None, Some(hz)) => lacks.insert(0, judged_by_lines(hz, rate_hz)),
        _ => {}
    }
    if let Some(speeds) = &speeds {
        lacks.insert(0, judged_by_speeds(log, rotor_count, speeds));
    }
    let mut voltage = None;
    if speeds.is_none() && !has(log, names::BATTERY_VOLTAGE) && !lacks.iter().any(|lack| lack.prevents_verdicts) {
        let leak = axial.as_ref().map_or(0.0, |_| Axial::LEAK);
        let (worked_out, lack) = without_voltage(judged, &parts, detectors, rate_hz, leak);
        voltage = worked_out;
        lacks.insert(0, lack);
    }
    let session = session(&config).expect("the detectors were checked");
    let session = if axial.is_some() { session.by_force() } else { session };
    let session = match slow_duties {
        Some(hz) => session.duties_every(1.0 / hz),
        None => session,
    };
    // What is not in the air is not passed to the session.
    let known = !parts.parts.is_empty() && parts.parts.iter().all(|part| part.kind != PartKind::Unknown);
    let session = if known { session.in_the_air() } else { session };
    let mut judge = Judge::new(session, parts, rate_hz);
    judge.lists = every_window;
    judge.voltage = voltage;
    judge.notes.extend(filled.cloned());
    judge.notes.extend(mostly_empty(judged, rotor_count));
    if !lacks.iter().any(|lack| lack.prevents_verdicts) {
        judge.run(judged, rotor_count);
    }
    Ok((judge, lacks))
}

/// The needed columns that most rows have no value of, in a sentence: those rows are lost.
fn mostly_empty(log: &FlightLog, rotor_count: usize) -> Option<String> {
    let needed = needed(rotor_count).into_iter().flat_map(|(_, columns)| columns);
    let share = |name: &String| {
        let values = log.column(name)?;
        let known = values.iter().filter(|value| !value.is_nan()).count();
        (known > 0 && 2 * known < values.len()).then_some(100.0 * known as f64 / values.len() as f64)
    };
    let sparse: Vec<String> = needed
        .chain([names::BATTERY_VOLTAGE.to_owned()])
        .filter_map(|name| share(&name).map(|percent| format!("{name} ({percent:.0} %)")))
        .collect();
    (!sparse.is_empty()).then(|| {
        format!(
            "most rows have no value of {}, and a row without one is lost: streams of several rates belong into tables of their own, which an import \
             brings to one time base (docs/logs.md)",
            sparse.join(", ")
        )
    })
}

fn report(log: &FlightLog, detectors: &Detectors, judge: Judge, lacks: Vec<Lack>) -> LogReport {
    let vehicle = &detectors.vehicle().vehicle;
    let rate_hz = log.sample_rate_hz();
    let resampled = !(LOWEST_RATE_HZ..=STEP_RATE_HZ + SAME_RATE_HZ).contains(&rate_hz);
    let mut view = DetectorsView::from(detectors);
    if judge.rate_hz < STEP_RATE_HZ {
        let config = at_rate(detectors.config(), judge.rate_hz);
        let milliseconds = |seconds: f32| (1e3 * f64::from(seconds)).round() / 1e3;
        view.window_samples = config.window_len;
        view.calibration_start_s = milliseconds(config.sequential.calibration_start);
        view.calibration_end_s = milliseconds(config.sequential.calibration_end);
    }
    let self_calibrated = detectors
        .config()
        .network
        .is_some_and(|network| network.self_calibrated());
    let mut notes = judge.notes;
    let left_out = notes.len().saturating_sub(MOST_NOTES);
    if left_out > 0 {
        notes.truncate(MOST_NOTES);
        notes.push(format!(
            "and {left_out} more notes like these, which are not listed ({} of {} steps were lost in all)",
            judge.lost,
            judge.session.samples() + judge.lost
        ));
    }
    // The detectors end where a vehicle tumbles; the motor commands before that are more informative than "not judged".
    let log_start_s = log.time_s.first().copied().unwrap_or(0.0);
    let lost = judge.parts.events.iter().filter(|event| event.kind.decides());
    notes.splice(
        0..0,
        lost.map(|event| format!("{:.2} s: {}", event.start_s - log_start_s, event.detail)),
    );
    if let RotorOrder::Vehicle(note) = &log.report.rotor_order {
        notes.insert(0, note.clone());
    }
    if (rate_hz - STEP_RATE_HZ).abs() > SAME_RATE_HZ {
        notes.insert(0, format!(
            "the log has {rate_hz:.1} Hz and was judged at {:.1} Hz: the detectors were made for 400 Hz, their delays and false alarms on this log are \
             not those of docs/figures.md{}",
            judge.rate_hz,
            if rate_hz < BLIND_BELOW_HZ {
                "; at 50 Hz and less a loss of 5 % is often found late or never (docs/detector.md, logs of low rates)"
            } else {
                ""
            }
        ));
    }
    let findings = log
        .report
        .findings
        .iter()
        .cloned()
        .chain(log.check_against_vehicle(vehicle));
    let found = findings.map(|finding| Suspicion {
        finding: finding.to_string(),
        blocks: finding.blocks(),
    });
    let in_degrees = turn_rates::in_degrees(log).map(|finding| Suspicion { finding, blocks: true });
    let suspicions = found.chain(in_degrees).collect();
    LogReport {
        log: LogView {
            content_hash: log.source.content_hash.clone(),
            rows: log.time_s.len(),
            start_s: log_start_s,
            duration_s: log.duration_s(),
            rate_hz,
            gaps: log.report.gaps.len(),
        },
        detectors: view,
        judged_rate_hz: judge.rate_hz,
        resampled,
        steps: judge.session.samples(),
        lost_steps: judge.lost,
        rejected_steps: judge.session.rejected_samples(),
        decided_s: judge.counts[2].decided as f64 * f64::from(judge.session.window_samples()) / judge.rate_hz,
        sentence: String::new(),
        detectable: None,
        final_window: judge
            .last_judged
            .as_ref()
            .or(judge.session.last())
            .map(|window| WindowView::from(window).later(judge.session.origin().unwrap_or(0) as f64 / judge.rate_hz)),
        loads: judge.loads,
        stretches: judge.stretches.into_iter().map(|(_, stretch)| stretch).collect(),
        not_judged: judge.not_judged,
        not_judged_left_out: judge.not_judged_left_out,
        timeline: judge.timeline,
        timeline_left_out: judge.left_out,
        windows: judge.windows,
        counts: judge
            .counts
            .into_iter()
            .filter(|count| count.detector != NETWORK_OVER_TIME || self_calibrated)
            .collect(),
        lacks,
        suspicions,
        notes,
        flight: None,
    }
    .said()
}

/// Notes of the session that are listed.
const MOST_NOTES: usize = 20;

/// Key of the network over time.
pub const NETWORK_OVER_TIME: &str = "network_over_time";

/// Column of the first duty in a block: after velocity, attitude and rates.
const FIRST_DUTY: usize = 9;

/// Duties of a row.
fn duties(block: &[Vec<f64>], row: usize, rotor_count: usize) -> [f32; MAX_ROTORS] {
    let mut duty = [0.0; MAX_ROTORS];
    for (rotor, slot) in duty.iter_mut().enumerate().take(rotor_count) {
        *slot = block[FIRST_DUTY + rotor][row] as f32;
    }
    duty
}

/// Feeds a session and counts its verdicts.
struct Judge {
    session: FdiSession,
    /// Of its steps, Hz.
    rate_hz: f64,
    chunk: Chunk,
    /// Replaces the missing voltage of the log.
    voltage: Option<WorkedOutVoltage>,
    lost: u64,
    timeline: Vec<ChangeView>,
    left_out: u64,
    loads: Vec<LoadView>,
    /// List every window.
    lists: bool,
    windows: Vec<WindowView>,
    last_code: Option<i32>,
    counts: [DetectorCount; 4],
    alarmed: [bool; 4],
    notes: Vec<String>,
    parts: FlightParts,
    /// Index of the part that contained the last step.
    part: usize,
    /// The last steps were not in the air: the gap seen by the session is not one of the log.
    left_air: bool,
    /// Each with the first step of its calibration.
    stretches: Vec<(u64, StretchView)>,
    not_judged: Vec<NotJudgedView>,
    not_judged_left_out: u64,
    last_judged: Option<Window>,
    /// End of the last window, or of the steps skipped after it; steps since the log's first row.
    accounted: u64,
}

impl Judge {
    fn new(session: FdiSession, parts: FlightParts, rate_hz: f64) -> Self {
        let count = |detector: &str| DetectorCount {
            detector: detector.to_owned(),
            decided: 0,
            healthy: 0,
            alarmed: 0,
            alarms: 0,
            first_alarm_s: None,
        };
        Self {
            session,
            rate_hz,
            chunk: Chunk::default(),
            voltage: None,
            lost: 0,
            timeline: Vec::new(),
            left_out: 0,
            loads: Vec::new(),
            lists: false,
            windows: Vec::new(),
            last_code: None,
            counts: ["t_test", "network", "sequential", NETWORK_OVER_TIME].map(count),
            alarmed: [false; 4],
            notes: Vec::new(),
            parts,
            part: 0,
            left_air: false,
            stretches: Vec::new(),
            not_judged: Vec::new(),
            not_judged_left_out: 0,
            last_judged: None,
            accounted: 0,
        }
    }

    fn run(&mut self, log: &FlightLog, rotor_count: usize) {
        let duties: Vec<String> = (1..=rotor_count).map(names::duty).collect();
        let mut columns: Vec<&str> = [names::VELOCITY, names::ATTITUDE, names::RATES].concat();
        columns.extend(duties.iter().map(String::as_str));
        if self.voltage.is_none() {
            columns.push(names::BATTERY_VOLTAGE);
        }
        let start_s = log.time_s.first().copied().unwrap_or(0.0);
        let given: Result<(), std::convert::Infallible> = log.for_each_block(&columns, self.rate_hz, |first, block| {
            for row in 0..block[0].len() {
                let step = first + row;
                let time_s = start_s + step as f64 / self.rate_hz;
                let voltage = self.voltage_at(time_s - start_s, block, row, rotor_count);
                match self.outside_of_air(time_s) {
                    Some(obstacle) => self.skip(step as u64, obstacle),
                    None => self.row(step, block, row, rotor_count, voltage),
                }
            }
            Ok(())
        });
        match given {
            Ok(()) => self.flush(),
        }
    }

    /// V, from the log or estimated; the battery is discharged from the point where its charge was estimated.
    fn voltage_at(&mut self, since_s: f64, block: &[Vec<f64>], row: usize, rotor_count: usize) -> f32 {
        let Some(voltage) = &mut self.voltage else {
            return block[FIRST_DUTY + rotor_count][row] as f32;
        };
        let duty = duties(block, row, rotor_count);
        // Without duties (a gap) it is unchanged.
        if since_s < voltage.begin.from_s || duty.iter().any(|duty| duty.is_nan()) {
            return voltage.now();
        }
        voltage.step(&duty) as f32
    }

    fn row(&mut self, step: usize, block: &[Vec<f64>], row: usize, rotor_count: usize, voltage: f32) {
        if block.iter().any(|values| values[row].is_nan()) {
            self.lost += 1;
            self.skip(
                step as u64,
                ObstacleView {
                    reason: Obstruction::Gap,
                    why: "a channel that the detectors need has no value".to_owned(),
                },
            );
            return;
        }
        let number = |column: usize| block[column][row] as f32;
        let three = |first: usize| [number(first), number(first + 1), number(first + 2)];
        if self.chunk.samples.is_empty() {
            self.chunk.first_step = step as u64;
        }
        self.chunk.samples.push(Sample {
            // The detectors do not use it.
            position_ned_m: [0.0; 3],
            velocity_ned_m_s: three(0),
            attitude_rad: three(3),
            body_rates_rad_s: three(6),
            duty: duties(block, row, rotor_count),
            battery_voltage_v: voltage,
            time_s: None,
        });
        if self.chunk.samples.len() == LONGEST_CHUNK {
            self.flush();
        }
    }

    /// The part that contains a time, if it is not in the air.
    fn outside_of_air(&mut self, time_s: f64) -> Option<ObstacleView> {
        let parts = &self.parts.parts;
        while parts.get(self.part).is_some_and(|part| part.end_s <= time_s) && self.part + 1 < parts.len() {
            self.part += 1;
        }
        let part = parts.get(self.part)?;
        (part.start_s <= time_s).then(|| obstacle_of(part)).flatten()
    }

    /// Skips a step that is not passed to the session.
    fn skip(&mut self, step: u64, obstacle: ObstacleView) {
        self.flush();
        self.left_air |= obstacle.reason != Obstruction::Gap;
        self.alarmed = [false; 4];
        if self.left_air && self.last_code != Some(CANNOT_JUDGE) {
            self.last_code = Some(CANNOT_JUDGE);
            self.turn(ChangeView {
                step,
                time_s: step as f64 / self.rate_hz,
                sequential: SequentialView::cannot_judge(),
                cannot_judge: Some(obstacle.clone()),
            });
        }
        self.account(step, step + 1, Some(obstacle));
    }

    /// Records that steps have no verdict, and why. The rest of an incomplete window belongs to the next entry.
    fn account(&mut self, from: u64, to: u64, obstacle: Option<ObstacleView>) {
        let rest = from.saturating_sub(self.accounted);
        let from = if rest < u64::from(self.session.window_samples()) {
            from.min(self.accounted)
        } else {
            from
        };
        self.accounted = to;
        let Some(obstacle) = obstacle else { return };
        let [from_s, to_s] = [from, to].map(|step| step as f64 / self.rate_hz);
        let full = self.not_judged.len() >= LONGEST_TIMELINE;
        match self.not_judged.last_mut() {
            Some(last) if last.obstacle.reason == obstacle.reason && from_s - last.to_s < 1.0 / self.rate_hz => {
                last.to_s = to_s;
                if obstacle.reason == Obstruction::Upset {
                    // Its tilt only increases.
                    last.obstacle = obstacle;
                }
            }
            _ if full => self.not_judged_left_out += 1,
            _ => self.not_judged.push(NotJudgedView { from_s, to_s, obstacle }),
        }
    }

    fn turn(&mut self, change: ChangeView) {
        if self.timeline.len() < LONGEST_TIMELINE {
            self.timeline.push(change);
        } else {
            self.left_out += 1;
        }
    }

    fn flush(&mut self) {
        if self.chunk.samples.is_empty() {
            return;
        }
        self.chunk.after_gap = true;
        match self.session.feed(&self.chunk) {
            Ok(answer) => {
                let own_gap = std::mem::take(&mut self.left_air);
                let first = usize::from(own_gap && self.session.origin() != Some(self.chunk.first_step));
                self.notes.extend(answer.notes.into_iter().skip(first));
                for window in &answer.windows {
                    self.count(window);
                }
            }
            // A number beyond f32: the step is lost, and reported.
            Err(refusal) => {
                self.lost += self.chunk.samples.len() as u64;
                self.notes
                    .push(format!("{} steps were left out: {refusal}", self.chunk.samples.len()));
            }
        }
        self.chunk.samples.clear();
    }

    fn count(&mut self, window: &Window) {
        let report = &window.report;
        let origin = self.session.origin().unwrap_or(0);
        let end = report.stamp.step + 1;
        let begin = end.saturating_sub(u64::from(self.session.window_samples()));
        // Since the log's first row, which may lie before the first complete step.
        let time_s = (report.stamp.step as f64) / self.rate_hz;
        for (index, code) in [
            report.t_test,
            report.network,
            report.sequential,
            window.network_over_time.code,
        ]
        .map(|code| code_in(window, code))
        .into_iter()
        .enumerate()
        {
            let count = &mut self.counts[index];
            let decided = !matches!(code, CANNOT_JUDGE | NOT_READY);
            let alarm = decided && code != HEALTHY;
            count.decided += u64::from(decided);
            count.healthy += u64::from(code == HEALTHY);
            count.alarmed += u64::from(alarm);
            if alarm && !self.alarmed[index] {
                count.alarms += 1;
                count.first_alarm_s.get_or_insert(time_s);
            }
            self.alarmed[index] = alarm;
        }
        let code = code_in(window, report.sequential);
        let obstacle = match code {
            NOT_READY => Some(ObstacleView {
                reason: Obstruction::Calibration,
                why: "the detectors calibrate themselves; damage present by then counts as healthy".to_owned(),
            }),
            CANNOT_JUDGE => window.obstacle.as_ref().map(ObstacleView::from),
            _ => {
                self.judged(begin, end, window);
                None
            }
        };
        self.account(begin, end, obstacle);
        let since_first_row_s = origin as f64 / self.rate_hz;
        if self.lists {
            self.windows.push(WindowView::from(window).later(since_first_row_s));
        }
        if window.load.is_some_and(|load| load.is_new()) {
            self.loads
                .extend(WindowView::from(window).later(since_first_row_s).load);
        }
        if self.last_code != Some(code) {
            let mut change = ChangeView::of(window);
            change.time_s += since_first_row_s;
            self.turn(change);
        }
        self.last_code = Some(code);
    }

    /// A window with a verdict.
    fn judged(&mut self, begin: u64, end: u64, window: &Window) {
        self.last_judged = Some(window.clone());
        let [from_s, to_s] = [begin, end].map(|step| step as f64 / self.rate_hz);
        let sequential = SequentialView::in_window(window);
        let calibration = window.calibrated_from;
        match self.stretches.last_mut() {
            Some((of, stretch)) if *of == calibration => {
                stretch.to_s = to_s;
                stretch.sequential = sequential;
            }
            _ => self.stretches.push((
                calibration,
                StretchView {
                    from_s,
                    to_s,
                    sequential,
                },
            )),
        }
    }
}

/// Parts of the flight. An upset detected by force alone counts as in the air: a hard climb is within the detectors' model.
fn parts_of(log: &FlightLog) -> FlightParts {
    let mut parts = log.flight_parts(None);
    let [roll, pitch] = [0, 1].map(|axis| log.column(names::ATTITUDE[axis]));
    for part in parts.parts.iter_mut().filter(|part| part.kind == PartKind::Upset) {
        let rows = log.time_s.partition_point(|time| *time < part.start_s)
            ..log.time_s.partition_point(|time| *time < part.end_s);
        let tilts = |row: usize| match (roll, pitch) {
            (Some(roll), Some(pitch)) => roll[row].cos() * pitch[row].cos() < UPRIGHT_COSINE,
            _ => true,
        };
        if !rows.into_iter().any(tilts) {
            part.kind = PartKind::Air;
        }
    }
    parts
}

/// Why a part of a flight is not evaluated; `None` if it is in the air.
fn obstacle_of(part: &FlightPart) -> Option<ObstacleView> {
    let reason = match part.kind {
        PartKind::Air | PartKind::Unknown => return None,
        PartKind::Upset => Obstruction::Upset,
        PartKind::Ground => Obstruction::OnGround,
        PartKind::TakeOff => Obstruction::TakeOff,
        PartKind::Landing => Obstruction::Landing,
        PartKind::Crash => Obstruction::Crash,
    };
    let why = if part.why.is_empty() {
        part.kind.words().to_owned()
    } else {
        format!("{}: {}", part.kind.words(), part.why)
    };
    Some(ObstacleView { reason, why })
}
