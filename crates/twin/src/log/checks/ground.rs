//! Is there a flight in this log at all?

use super::kinematics::mean;
use super::push;
use crate::log::findings::{Finding, FindingKind};
use crate::log::resample::median;
use crate::log::{FlightLog, names};

/// Below this duty no propeller lifts its vehicle.
const IDLE_DUTY: f64 = 0.05;
/// Above this duty a motor is driven, not idling.
const DRIVEN_DUTY: f64 = 2.0 * IDLE_DUTY;
/// Less current than this lifts no vehicle that carries a logger, A.
const IDLE_CURRENT_A: f64 = 1.0;
/// An autopilot with its receiver draws more than this from the battery by itself, A: a sensor that reads less measures
/// nothing.
const ELECTRONICS_A: f64 = 0.02;
/// A vehicle at rest turns and shakes less than this (a simulated hover does more), rad/s and m/s².
const STILL_RATES_RAD_S: f64 = 0.01;
const STILL_ACCEL_M_S2: f64 = 0.06;
/// Duration of motion, with the motors off, that nobody makes by hand, s.
const FLIGHT_S: f64 = 0.5;

fn deviation(values: &[f64]) -> f64 {
    let middle = mean(values);
    let squares: Vec<f64> = values.iter().map(|value| (value - middle).powi(2)).collect();
    mean(&squares).sqrt()
}

/// Value below which this percentage of the rows lies.
fn high(values: &[f64], percent: usize) -> Option<f64> {
    let mut present: Vec<f64> = values.iter().copied().filter(|value| !value.is_nan()).collect();
    let place = (present.len() * percent / 100).min(present.len().checked_sub(1)?);
    Some(*present.select_nth_unstable_by(place, f64::total_cmp).1)
}

/// Mean duty of each row; none without motor outputs.
fn mean_duties(log: &FlightLog) -> Vec<f64> {
    let duties = log.duties();
    if duties.is_empty() {
        return Vec::new();
    }
    (0..log.time_s.len())
        .map(|row| duties.iter().map(|duty| duty[row]).sum::<f64>() / duties.len() as f64)
        .collect()
}

/// A battery's current that is too small for a flight.
pub(crate) struct IdleCurrent {
    /// Most of it, A.
    pub(crate) most_a: f64,
    /// … where, in words.
    pub(crate) where_it_is: &'static str,
    /// For half of that time it is below what the autopilot itself draws: it is evidence neither for nor against a
    /// flight.
    pub(crate) measures_nothing: bool,
}

/// The current that three quarters of the rows with driven motors stay below, if it is too small for a flight. If no
/// motor is driven, or none is in the log, that of 95 % of all rows: a flight may be short compared with the time that
/// its logger ran.
pub(crate) fn idle_current(log: &FlightLog) -> Option<IdleCurrent> {
    const FLYING: (usize, &str) = (75, "75 % of the rows in which its motors are commanded to give thrust");
    const ALL: (usize, &str) = (95, "95 % of the rows");
    let current = log.column(names::BATTERY_CURRENT)?;
    let driven: Vec<f64> = mean_duties(log)
        .iter()
        .zip(current)
        .filter(|(duty, current)| **duty > DRIVEN_DUTY && current.is_finite())
        .map(|(_, current)| *current)
        .collect();
    let lasts = driven.len() as f64 > FLIGHT_S * log.sample_rate_hz();
    let (values, (percent, where_it_is)) = if lasts { (&driven[..], FLYING) } else { (current, ALL) };
    // A sensor that is not connected reads 0 or less throughout.
    let reads = high(values, 95)? > 0.0;
    let most_a = high(values, percent).filter(|current| reads && *current < IDLE_CURRENT_A)?;
    Some(IdleCurrent {
        most_a,
        where_it_is,
        measures_nothing: high(values, 50)? < ELECTRONICS_A,
    })
}

/// How much the battery's voltage drops between low and high motor commands, over the voltage; `None` if the log lacks
/// either.
fn sag(log: &FlightLog) -> Option<f64> {
    /// Share of the highest motor command.
    const RESTING: f64 = 0.2;
    const DRIVEN: f64 = 0.6;
    const LEAST_S: f64 = 1.0;
    let voltage = log.column(names::BATTERY_VOLTAGE)?;
    let mean_duty = mean_duties(log);
    let driven: Vec<f64> = mean_duty.iter().copied().filter(|duty| *duty > DRIVEN_DUTY).collect();
    let most = high(&driven, 95)?;
    let usual = |of: &dyn Fn(f64) -> bool| {
        let rows = mean_duty.iter().zip(voltage);
        let mut values: Vec<f64> = rows
            .filter(|(duty, volts)| of(**duty) && volts.is_finite())
            .map(|(_, volts)| *volts)
            .collect();
        if (values.len() as f64) < LEAST_S * log.sample_rate_hz() {
            return None;
        }
        median(&mut values)
    };
    let resting = usual(&|duty| duty < RESTING * most)?;
    let driven = usual(&|duty| duty > DRIVEN * most)?;
    Some((resting - driven) / resting)
}

/// Motors above idle that load the battery; if its voltage does not decide this, with rates and vibration that no hand
/// or stand produces.
pub(crate) fn moves_under_power(log: &FlightLog) -> bool {
    const FLIES_RAD_S: f64 = 0.3;
    const FLIES_M_S2: f64 = 1.0;
    /// The battery of a vehicle in flight sags by at least this, over its voltage, and by no more with a current below
    /// [`IDLE_CURRENT_A`].
    const FLIES: f64 = 0.01;
    // Handling shakes a vehicle as much as a flight.
    if let Some(sag) = sag(log) {
        return sag > FLIES;
    }
    let (Some(rates), Some(accel)) = (log.vector(names::RATES), log.vector(names::ACCEL)) else {
        return false;
    };
    let driven = mean_duties(log).into_iter().filter(|duty| *duty > DRIVEN_DUTY);
    let turns = rates.iter().any(|axis| deviation(axis) > FLIES_RAD_S);
    turns && accel.iter().any(|axis| deviation(axis) > FLIES_M_S2) && 2 * driven.count() > log.time_s.len()
}

/// Whether the motor commands change from time to time between these times, s, as in the air.
pub(crate) fn motors_change(log: &FlightLog, start_s: f64, end_s: f64) -> bool {
    const CHANGES: f64 = 0.005;
    let inside = |duty: &[f64]| -> Vec<f64> {
        let rows = log.time_s.iter().zip(duty);
        rows.filter(|(time, value)| (start_s..=end_s).contains(*time) && value.is_finite())
            .map(|(_, value)| *value)
            .collect()
    };
    log.duties().iter().any(|duty| deviation(&inside(duty)) > CHANGES)
}

/// How much the motors change from second to second while the size of the specific force does not follow, and that
/// force, m/s²: if thrust carries a vehicle, 1.7 times the duty is at least 1.7 times the force, unless it carries a
/// load of half its mass. `None` if the force follows, if its position changes by metres, or if the log holds too
/// little.
///
/// Only seconds with more than half of the largest duty count: on the ground and in a hover the force is the weight as well.
fn force_without_motors(log: &FlightLog) -> Option<(f64, f64)> {
    const CHANGES: f64 = 1.7;
    const UNMOVED_M_S2: f64 = 0.25;
    const LEAST_S: usize = 20;
    /// Share of the seconds with a duty in the middle third: a vehicle that idles at half of what it then hovers with passes it once.
    const BETWEEN: f64 = 0.2;
    const ELSEWHERE_M: f64 = 2.0;
    let accel = log.vector(names::ACCEL)?;
    let range = |values: &[f64]| {
        let finite = || values.iter().copied().filter(|value| value.is_finite());
        finite().fold(f64::NEG_INFINITY, f64::max) - finite().fold(f64::INFINITY, f64::min)
    };
    let places = names::POSITION.iter().chain([&names::HEIGHT_ABOVE_GROUND]);
    if places
        .filter_map(|name| log.column(name))
        .any(|place| range(place) > ELSEWHERE_M)
    {
        return None;
    }
    let rows = log.sample_rate_hz().round() as usize;
    let mean_duty = mean_duties(log);
    if rows < 5 || mean_duty.is_empty() {
        return None;
    }
    let seconds: Vec<(f64, f64)> = (0..log.time_s.len() / rows)
        .map(|second| {
            let rows = second * rows..(second + 1) * rows;
            let force: Vec<f64> = rows
                .clone()
                .map(|row| accel.iter().map(|axis| axis[row].powi(2)).sum::<f64>().sqrt())
                .collect();
            (mean(&mean_duty[rows]), mean(&force))
        })
        .filter(|(duty, force)| duty.is_finite() && force.is_finite())
        .collect();
    let of = |values: &mut dyn Iterator<Item = f64>, percent: usize| high(&values.collect::<Vec<_>>(), percent);
    let most = of(&mut seconds.iter().map(|(duty, _)| *duty), 95)?;
    let driven: Vec<(f64, f64)> = seconds.into_iter().filter(|(duty, _)| *duty > 0.5 * most).collect();
    if driven.len() < LEAST_S {
        return None;
    }
    let duty = |percent| of(&mut driven.iter().map(|(duty, _)| *duty), percent);
    let force = |percent| of(&mut driven.iter().map(|(_, force)| *force), percent);
    let (low, most) = (duty(5)?, duty(95)?);
    let between = low + (most - low) / 3.0..most - (most - low) / 3.0;
    let count = driven.iter().filter(|(duty, _)| between.contains(duty)).count();
    if (count as f64) < BETWEEN * driven.len() as f64 {
        return None;
    }
    let changes = most / low;
    let spread = (force(90)? - force(10)?) / 2.56;
    (changes > CHANGES && spread < UNMOVED_M_S2).then_some((changes, force(50)?))
}

impl FlightLog {
    /// Evidence of the log as a whole against a flight, whatever a part of it looks like: the finding that all commands
    /// use.
    pub(crate) fn says_no_flight(&self) -> Option<&str> {
        let found = self
            .report
            .findings
            .iter()
            .find(|finding| finding.kind == FindingKind::NoFlight);
        found.map(|finding| finding.detail.as_str())
    }
}

pub(super) fn no_flight(log: &FlightLog, findings: &mut Vec<Finding>) {
    let mean_duty = mean_duties(log);
    if !mean_duty.is_empty() {
        let lifting = mean_duty.iter().filter(|duty| **duty > IDLE_DUTY).count();
        let lifting_s = lifting as f64 / log.sample_rate_hz();
        if lifting_s < FLIGHT_S {
            let most = mean_duty.into_iter().fold(0.0, f64::max);
            push(
                findings,
                FindingKind::NoFlight,
                format!("the motors idle throughout (mean duty at most {most:.3}): nothing can be identified"),
            );
            return;
        }
    }
    if let Some(current) = idle_current(log).filter(|current| !current.measures_nothing) {
        push(
            findings,
            FindingKind::NoFlight,
            format!(
                "the battery gives less than {:.2} A in {}: nothing flies, nothing can be identified",
                current.most_a, current.where_it_is
            ),
        );
        return;
    }
    if let Some((changes, force)) = force_without_motors(log) {
        push(
            findings,
            FindingKind::NoFlight,
            format!(
                "the motors are commanded up to {changes:.1} times as much, yet the specific force stays at {force:.1} m/s²: they do not carry the \
                 vehicle (no propellers, tied down, or on a stand)"
            ),
        );
        return;
    }
    // A column without a value does not vary, and says nothing of rest.
    let measured = |names| {
        log.vector(names)
            .filter(|axes| axes.iter().all(|axis| axis.iter().any(|value| !value.is_nan())))
    };
    if let (Some(rates), Some(accel)) = (measured(names::RATES), measured(names::ACCEL)) {
        let turning = rates.iter().map(|axis| deviation(axis)).fold(0.0, f64::max);
        let shaking = accel.iter().map(|axis| deviation(axis)).fold(0.0, f64::max);
        if turning < STILL_RATES_RAD_S && shaking < STILL_ACCEL_M_S2 {
            push(
                findings,
                FindingKind::NoFlight,
                format!(
                    "the vehicle rests: body rates vary by {turning:.4} rad/s and the specific force by {shaking:.3} m/s²; nothing can be identified"
                ),
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::flight_parts::PartKind;

    /// 50 Hz: 8 s at rest, 40 s with the motors up, 4 s at rest; the motors pull the battery down by `sag` volts, and
    /// its current sensor reads 0.3 A. The body turns and is knocked about all the time that the motors are up.
    fn handled(sag: f64) -> FlightLog {
        let time: Vec<f64> = (0..2600).map(|k| 0.02 * f64::from(k)).collect();
        let up = |t: f64| f64::from(u8::from((8.0..48.0).contains(&t)));
        let of = |f: &dyn Fn(f64) -> f64| -> Vec<f64> { time.iter().map(|t| f(*t)).collect() };
        let knock = |t: f64| if t % 2.0 < 0.1 { 8.0 } else { 0.0 };
        let mut columns: Vec<(String, Vec<f64>)> = (1..=4)
            .map(|rotor| {
                (
                    names::duty(rotor),
                    of(&|t| up(t) * (0.5 + 0.1 * (3.0 * t + f64::from(rotor as u8)).sin())),
                )
            })
            .collect();
        for (axis, name) in names::RATES.iter().enumerate() {
            columns.push(((*name).to_owned(), of(&|t| up(t) * 0.6 * (2.0 * t + axis as f64).sin())));
        }
        for (name, rest) in names::ACCEL.iter().zip([0.0, 0.0, -9.81]) {
            columns.push(((*name).to_owned(), of(&|t| rest + up(t) * (knock(t) + (1.7 * t).sin()))));
        }
        columns.push((
            names::BATTERY_VOLTAGE.to_owned(),
            of(&|t| 11.2 + 0.02 * (50.0 * t).sin() - up(t) * sag),
        ));
        columns.push((names::BATTERY_CURRENT.to_owned(), of(&|t| 0.2 + 0.1 * (40.0 * t).sin())));
        FlightLog::from_columns("handled", time, columns).expect("a log")
    }

    #[test]
    fn regress_a_vehicle_carried_by_hand_is_no_flight_for_any_command() {
        let log = handled(0.05);
        let why = log.says_no_flight().expect("the battery gives nothing");
        assert!(why.contains("the battery gives less than"), "{why}");
        let parts = log.flight_parts(None);
        assert!(
            parts.parts.iter().all(|part| part.kind == PartKind::Ground),
            "{parts:?}"
        );
        assert!(parts.no_flight().is_some_and(|found| found == why), "{parts:?}");
    }

    /// Motors that idle at half of what a calm hover then takes: on the ground and in the air the force is the weight.
    #[test]
    fn val_an_idle_before_a_hover_is_none_of_motors_that_carry_nothing() {
        let mut log = on_a_stand(false);
        for (row, t) in log.time_s.clone().into_iter().enumerate() {
            for rotor in 1..=4 {
                let duty = log.columns.get_mut(&names::duty(rotor)).expect("a motor");
                duty[row] = (0.25 + 0.15 * (t - 10.0)).clamp(0.25, 0.5);
            }
        }
        assert_eq!(force_without_motors(&log), None);
    }

    /// 50 Hz, 40 s on a stand: the motors go up and down by a factor of two and turn the vehicle about; with `carries`
    /// the accelerometer reads their thrust, the duty to the power 1.3.
    fn on_a_stand(carries: bool) -> FlightLog {
        let time: Vec<f64> = (0..2000).map(|k| 0.02 * f64::from(k)).collect();
        let of = |f: &dyn Fn(f64) -> f64| -> Vec<f64> { time.iter().map(|t| f(*t)).collect() };
        let duty = |t: f64| 0.1 * (1.0 + 0.4 * (0.7 * t).sin());
        let mut columns: Vec<(String, Vec<f64>)> = (1..=4).map(|rotor| (names::duty(rotor), of(&duty))).collect();
        for (axis, name) in names::RATES.iter().enumerate() {
            columns.push(((*name).to_owned(), of(&|t| 0.3 * (2.0 * t + axis as f64).sin())));
        }
        let thrust = |t: f64| if carries { (duty(t) / 0.1).powf(1.3) } else { 1.0 };
        for (name, rest) in names::ACCEL.iter().zip([-2.6, 0.0, -9.3]) {
            columns.push(((*name).to_owned(), of(&|t| rest * thrust(t) + 0.2 * (50.0 * t).sin())));
        }
        FlightLog::from_columns("stand", time, columns).expect("a log")
    }

    /// It used to yield a vehicle, with n = 0.1.
    #[test]
    fn regress_a_force_that_does_not_follow_the_motors_is_no_flight() {
        let log = on_a_stand(false);
        let why = log.says_no_flight().expect("the motors carry nothing");
        assert!(why.contains("the specific force stays at 9.7 m/s²"), "{why}");
        assert_eq!(log.flight_parts(None).air_s(), 0.0);
        assert_eq!(on_a_stand(true).says_no_flight(), None);
    }

    #[test]
    fn val_a_short_flight_in_a_long_log_is_a_flight() {
        // The same with 15 A while the motors are up, and half an hour of rest after it.
        let log = handled(0.7);
        let rows = 90_000;
        let time: Vec<f64> = (0..rows).map(|k| 0.02 * k as f64).collect();
        let longer = |name: &str| {
            let mut values = log.column(name).expect(name).to_vec();
            values.resize(rows, values[0]);
            (name.to_owned(), values)
        };
        let duties: Vec<String> = (1..=4).map(names::duty).collect();
        let kept = names::RATES.iter().chain(&names::ACCEL).copied();
        let mut columns: Vec<(String, Vec<f64>)> = kept.chain(duties.iter().map(String::as_str)).map(longer).collect();
        let current = longer(&duties[0]).1.iter().map(|duty| 0.3 + 30.0 * duty).collect();
        columns.push((names::BATTERY_CURRENT.to_owned(), current));
        let log = FlightLog::from_columns("short", time, columns).expect("a log");
        assert_eq!(log.says_no_flight(), None, "{:?}", log.report.findings);
        assert!(log.flight_parts(None).air_s() > 20.0);
    }

    /// A real flight was classified "on the ground" because of a sensor that reads 0.00 A except in a few rows.
    #[test]
    fn regress_a_current_below_that_of_the_autopilot_says_nothing_against_a_flight() {
        let handled = handled(0.0);
        let mut columns: Vec<(String, Vec<f64>)> = handled.columns.clone().into_iter().collect();
        columns.retain(|(name, _)| name != names::BATTERY_CURRENT && name != names::BATTERY_VOLTAGE);
        // A tenth of the rows reads up to 0.5 A.
        let current = |row: usize| {
            if row.is_multiple_of(10) {
                0.05 * (row % 11) as f64
            } else {
                0.0
            }
        };
        columns.push((
            names::BATTERY_CURRENT.to_owned(),
            (0..handled.time_s.len()).map(current).collect(),
        ));
        let log = FlightLog::from_columns("unconnected", handled.time_s, columns).expect("a log");
        assert_eq!(log.says_no_flight(), None, "{:?}", log.report.findings);
        assert!(log.column(names::BATTERY_CURRENT).is_none());
        let told = log.report.notes.join("\n");
        assert!(told.contains("less than an autopilot itself takes"), "{told}");
    }

    #[test]
    fn val_a_battery_that_gives_way_has_a_current_sensor_that_is_not_connected() {
        let log = handled(0.7);
        assert_eq!(log.says_no_flight(), None, "{:?}", log.report.findings);
        assert!(log.column(names::BATTERY_CURRENT).is_none());
        assert!(log.flight_parts(None).air_s() > 20.0);
    }
}
