//! Is there a flight in this log at all?

use super::kinematics::mean;
use super::push;
use crate::log::findings::{Finding, FindingKind};
use crate::log::{FlightLog, names};

/// Below this duty no propeller lifts its vehicle.
const IDLE_DUTY: f64 = 0.05;
/// Less current than this lifts nothing that carries a logger, A.
const IDLE_CURRENT_A: f64 = 1.0;
/// A vehicle at rest turns and shakes less than this (a simulated hover does more), rad/s and m/s².
const STILL_RATES_RAD_S: f64 = 0.01;
const STILL_ACCEL_M_S2: f64 = 0.06;
/// Motion that nobody makes by hand while the motors are off, s of it.
const FLIGHT_S: f64 = 0.5;

fn deviation(values: &[f64]) -> f64 {
    let middle = mean(values);
    let squares: Vec<f64> = values.iter().map(|value| (value - middle).powi(2)).collect();
    mean(&squares).sqrt()
}

/// Value below which 95 % of the rows lie.
fn high(values: &[f64]) -> Option<f64> {
    let mut present: Vec<f64> = values.iter().copied().filter(|value| !value.is_nan()).collect();
    let place = (present.len() * 95 / 100).min(present.len().checked_sub(1)?);
    Some(*present.select_nth_unstable_by(place, f64::total_cmp).1)
}

/// The current that 95 % of the rows stay below, where it is too small for a flight, A.
pub(crate) fn idle_current(log: &FlightLog) -> Option<f64> {
    log.column(names::BATTERY_CURRENT)
        .and_then(high)
        .filter(|current| *current > 0.0 && *current < IDLE_CURRENT_A)
}

/// Motors above idle while the body turns and shakes as nobody's hand or stand makes it.
pub(crate) fn moves_under_power(log: &FlightLog) -> bool {
    const FLIES_RAD_S: f64 = 0.3;
    const FLIES_M_S2: f64 = 1.0;
    let duties = log.duties();
    let (Some(rates), Some(accel)) = (log.vector(names::RATES), log.vector(names::ACCEL)) else {
        return false;
    };
    let mean_duty = |row: usize| duties.iter().map(|duty| duty[row]).sum::<f64>() / duties.len() as f64;
    let driven = (0..log.time_s.len()).filter(|row| mean_duty(*row) > 2.0 * IDLE_DUTY);
    let turns = rates.iter().any(|axis| deviation(axis) > FLIES_RAD_S);
    turns && accel.iter().any(|axis| deviation(axis) > FLIES_M_S2) && 2 * driven.count() > log.time_s.len()
}

/// Whether the motors are told other duties from time to time between these times, s, as in the air.
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

pub(super) fn no_flight(log: &FlightLog, findings: &mut Vec<Finding>) {
    let duties = log.duties();
    if !duties.is_empty() {
        let rows = log.time_s.len();
        let mean_duty = |row: usize| duties.iter().map(|duty| duty[row]).sum::<f64>() / duties.len() as f64;
        let lifting = (0..rows).filter(|row| mean_duty(*row) > IDLE_DUTY).count();
        let lifting_s = lifting as f64 / log.sample_rate_hz();
        if lifting_s < FLIGHT_S {
            let most = (0..rows).map(mean_duty).fold(0.0, f64::max);
            push(
                findings,
                FindingKind::NoFlight,
                format!("the motors idle throughout (mean duty at most {most:.3}): nothing can be identified"),
            );
            return;
        }
    }
    if let Some(current) = idle_current(log) {
        push(
            findings,
            FindingKind::NoFlight,
            format!(
                "the battery gives less than {current:.2} A in 95 % of the rows: nothing flies, nothing can be identified"
            ),
        );
        return;
    }
    if let (Some(rates), Some(accel)) = (log.vector(names::RATES), log.vector(names::ACCEL)) {
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
