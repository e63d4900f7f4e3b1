//! Sparse logs, stuck and saturated columns, missing channels, noise of the rest.

use super::kinematics::white_noise;
use super::push;
use crate::log::findings::{Finding, FindingKind};
use crate::log::report::{ColumnNoise, Missing};
use crate::log::{FlightLog, names};

/// A measured column that repeats one value for this long is stuck, s.
const STUCK_S: f64 = 1.0;
/// … and for this many of its usual repetitions (a slow stream that is held repeats by nature).
const STUCK_RUNS: usize = 20;
/// A column is saturated when this share of its rows sits on its largest or smallest value.
const SATURATED_SHARE: f64 = 0.02;

/// Rows more rare than this follow no motion of a vehicle, Hz.
const SLOWEST_HZ: f64 = 2.0;

/// Attitudes, body rates or duties in rows that are seconds apart: a clock in another unit, as a rule.
pub(super) fn rows_too_far_apart(log: &FlightLog, findings: &mut Vec<Finding>) {
    let rate_hz = log.sample_rate_hz();
    let moves = |name: &String| is_inertial(name) || names::ATTITUDE.contains(&name.as_str());
    let is_of_a_flight = log
        .columns
        .keys()
        .any(|name| moves(name) || names::duty_rotor(name).is_some());
    if rate_hz < SLOWEST_HZ && is_of_a_flight {
        let apart_s = 1.0 / rate_hz;
        let apart = if apart_s < 1e6 {
            format!("{apart_s:.2}")
        } else {
            format!("{apart_s:.1e}")
        };
        push(
            findings,
            FindingKind::SlowRows,
            format!(
                "the rows are {apart} s apart, too far to follow the motion of a vehicle; if `time_s` holds milliseconds or microseconds, \
                 `rotortwin log map` drafts a mapping that says so"
            ),
        );
    }
}

pub(super) fn thin_log(log: &FlightLog, findings: &mut Vec<Finding>) {
    let with_values = |name: &&String| log.columns[*name].iter().any(|value| !value.is_nan());
    let empty: Vec<&str> = log
        .columns
        .keys()
        .filter(|name| !with_values(name))
        .map(String::as_str)
        .collect();
    if !empty.is_empty() {
        push(
            findings,
            FindingKind::AllMissing,
            format!("{} without any value", empty.join(", ")),
        );
    }
    let canonical: Vec<&String> = log
        .columns
        .keys()
        .filter(|name| names::is_canonical(name))
        .filter(with_values)
        .collect();
    if canonical.len() < 2 {
        let found = canonical.first().map_or("none", |name| name.as_str());
        push(
            findings,
            FindingKind::OneColumn,
            format!("one canonical column with values ({found}) besides the time: nothing can be compared"),
        );
    }
}

/// Columns of inertial sensors, which never repeat a value for long.
fn is_inertial(name: &str) -> bool {
    names::RATES.contains(&name) || names::ACCEL.contains(&name)
}

/// Columns that may rest for a while on the ground, or in the steps of their resolution, but not from end to end.
fn is_estimated(name: &str) -> bool {
    names::ATTITUDE.contains(&name) || names::VELOCITY.contains(&name) || names::POSITION.contains(&name)
}

pub(super) fn stuck_and_saturated(log: &FlightLog, findings: &mut Vec<Finding>) {
    let mut stuck = Vec::new();
    let mut saturated = Vec::new();
    for (name, values) in &log.columns {
        let duty = names::duty_rotor(name).is_some();
        let present: Vec<(f64, f64)> = log
            .time_s
            .iter()
            .copied()
            .zip(values.iter().copied())
            .filter(|(_, value)| !value.is_nan())
            .collect();
        if present.len() < 2 || !(is_inertial(name) || is_estimated(name) || duty) {
            continue;
        }
        if !duty
            && let Some((start_s, end_s)) = longest_run(&present)
            && (is_inertial(name) || present.iter().all(|(_, value)| *value == present[0].1))
        {
            stuck.push(format!("{name} from {start_s:.2} s to {end_s:.2} s"));
        }
        if is_estimated(name) {
            continue;
        }
        let limits = present
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), (_, value)| {
                (least.min(*value), most.max(*value))
            });
        let on = |limit: f64| present.iter().filter(|(_, value)| *value == limit).count();
        // Motors that are off are not saturated; nor are extremes that repeat by chance because of a coarse resolution.
        let sides: &[f64] = if duty { &[limits.1] } else { &[limits.0, limits.1] };
        let full = |limit: f64| !duty || limit > 0.99;
        let chance = 3.0 / distinct(&present) as f64;
        for limit in sides {
            let share = on(*limit) as f64 / present.len() as f64;
            let moves = limits.1 > limits.0;
            let named = stuck
                .last()
                .is_some_and(|entry: &String| entry.starts_with(&format!("{name} ")));
            if moves && !named && full(*limit) && share > SATURATED_SHARE.max(chance) {
                saturated.push(format!("{name} at {limit:.4} in {:.1} % of the rows", 100.0 * share));
            }
        }
    }
    if !stuck.is_empty() {
        push(
            findings,
            FindingKind::Stuck,
            format!("{} without change", stuck.join(", ")),
        );
    }
    if !saturated.is_empty() {
        push(findings, FindingKind::Saturated, saturated.join(", "));
    }
}

/// Number of different values, at most 1000.
fn distinct(present: &[(f64, f64)]) -> usize {
    const ENOUGH: usize = 1000;
    let mut seen = std::collections::BTreeSet::new();
    for (_, value) in present {
        seen.insert(value.to_bits());
        if seen.len() >= ENOUGH {
            break;
        }
    }
    seen.len()
}

/// When a column that had changed before was constant for the longest time, s; none if that is too short to be a fault.
pub(crate) fn stands_still(log: &FlightLog, name: &str) -> Option<(f64, f64)> {
    let values = log.column(name)?.iter().copied();
    let rows = log.time_s.iter().copied().zip(values);
    let present: Vec<(f64, f64)> = rows.filter(|(_, value)| !value.is_nan()).collect();
    if present.len() < 2 {
        return None;
    }
    longest_run(&present).filter(|(start_s, _)| *start_s > present[0].0)
}

/// The longest time without change, if it is long enough to be a fault.
fn longest_run(present: &[(f64, f64)]) -> Option<(f64, f64)> {
    let mut runs = Vec::new();
    let mut first = 0;
    for index in 1..=present.len() {
        if present.get(index).is_none_or(|(_, value)| *value != present[first].1) {
            runs.push((index - first, present[first].0, present[index - 1].0));
            first = index;
        }
    }
    let whole = runs.len() == 1;
    let mut lengths: Vec<usize> = runs.iter().map(|(length, _, _)| *length).collect();
    let middle = lengths.len() / 2;
    let usual = *lengths.select_nth_unstable(middle).1;
    let (length, start_s, end_s) = runs.into_iter().max_by_key(|(length, _, _)| *length)?;
    (whole || (end_s - start_s >= STUCK_S && length >= STUCK_RUNS * usual)).then_some((start_s, end_s))
}

/// What cannot be tested without the columns that are not there.
pub(super) fn missing(log: &FlightLog) -> Vec<Missing> {
    let has = |name: &str| {
        log.column(name)
            .is_some_and(|values| values.iter().any(|value| !value.is_nan()))
    };
    let duty_or_wrench = log.rotor_count() > 0 || has(names::THRUST_COMMAND);
    let mut list = Vec::new();
    let mut group = |columns: &[&str], rules_out: &str| {
        let absent: Vec<String> = columns
            .iter()
            .filter(|name| !has(name))
            .map(|name| (*name).to_owned())
            .collect();
        if !absent.is_empty() {
            list.push(Missing {
                columns: absent,
                rules_out: rules_out.to_owned(),
            });
        }
    };
    group(
        &names::RATES,
        "no moment balance: inertia, centre of mass, single rotors, motor lag, damping; no check of the attitude's axes and clock",
    );
    group(
        &names::ACCEL,
        "no force balance from the accelerometer: drag, mass and thrust scale only through the velocity",
    );
    group(
        &names::ATTITUDE,
        "no turning of forces into the world: no velocity residual, no tilt, no check of the rates",
    );
    group(
        &names::VELOCITY,
        "nothing that depends on airspeed (drag, wind, inflow, flapping); no velocity residual, no latency of the velocity",
    );
    group(
        &names::POSITION,
        "no position residual, no latency of the position, no effect of height without a range finder",
    );
    group(
        &[names::BATTERY_VOLTAGE],
        "nothing electrical: sag, internal resistance, voltage dependence of the thrust",
    );
    group(
        &[names::BATTERY_CURRENT],
        "internal resistance only through a model of the power",
    );
    if !log.columns.keys().any(|name| names::speed_rotor(name).is_some()) {
        group(
            &["rotor_speed_1_rad_s"],
            "motor lag, propeller and electronics cannot be separated rotor by rotor",
        );
    }
    if !duty_or_wrench {
        group(
            &["duty_1"],
            "no open-loop prediction and no thrust model: only the kinematics can be checked",
        );
    } else if log.rotor_count() == 0 {
        group(&["duty_1"], "single rotors: the log has a commanded wrench only");
    }
    list
}

/// Noise and resolution of the canonical columns.
pub(super) fn noise(log: &FlightLog) -> Vec<ColumnNoise> {
    log.columns
        .iter()
        .filter(|(name, _)| names::is_canonical(name) && names::duty_rotor(name).is_none())
        .map(|(name, values)| ColumnNoise {
            column: name.clone(),
            noise: white_noise(values),
            resolution: resolution(values),
        })
        .collect()
}

/// Smallest step between neighbours if a good part of the steps are whole multiples of it; otherwise 0.
fn resolution(values: &[f64]) -> f64 {
    /// Rounding of a multiple.
    const WHOLE: f64 = 0.02;
    const COARSE_SHARE: f64 = 0.95;
    let steps: Vec<f64> = values
        .windows(2)
        .map(|pair| (pair[1] - pair[0]).abs())
        .filter(|step| *step > 0.0)
        .collect();
    let least = steps.iter().copied().fold(f64::INFINITY, f64::min);
    if !least.is_finite() {
        return 0.0;
    }
    let whole = steps.iter().filter(|step| {
        let ratio = *step / least;
        ratio < 1e4 && (ratio - ratio.round()).abs() < WHOLE
    });
    if whole.count() as f64 > COARSE_SHARE * steps.len() as f64 {
        least
    } else {
        0.0
    }
}
