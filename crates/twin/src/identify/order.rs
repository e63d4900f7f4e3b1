//! A log read in the rotor order of a vehicle file: every comparison of a log with a vehicle goes through [`read_for`].
//!
//! Autopilots number their motors by their own tables, a vehicle file by its own. Where the log's parameters give the
//! positions of its motors (`CA_ROTORn_PX`, `FRAME_CLASS` …), each is matched to the vehicle by its direction and its
//! spin. Where they do not, the columns are used unchanged, and the gate ([`FlightLog::refusal_against`]) rejects what
//! the motion contradicts.

use rotortwin_plant::vehicle::model::VehicleModel;
use std::path::Path;

use super::airframe::{self, Airframe};
use super::frames::Place;
use crate::log::{FindingKind, FlightLog, ReadOptions, RotorOrder};

/// A motor and a rotor that lie farther apart, seen from the middle, are not the same, degrees. Builders measure; tables are exact.
const TOLERANCE_DEG: f64 = 15.0;

/// Reads a log, or a part of it, for comparison with a vehicle: its rotors are put into the vehicle's order if the log
/// states theirs.
///
/// # Errors
/// As [`FlightLog::read_part`].
pub fn read_for(text: &Path, options: &ReadOptions, vehicle: &VehicleModel) -> Result<FlightLog, String> {
    FlightLog::read_part_with(text, options).map(|log| in_the_order_of(log, vehicle))
}

/// The log with its rotors in the vehicle's order, if its parameters state it; what was done is in
/// [`RotorOrder::Vehicle`].
pub fn in_the_order_of(mut log: FlightLog, vehicle: &VehicleModel) -> FlightLog {
    // Columns that are not in the autopilot's order are not described by any parameters.
    if log.report.rotor_order != RotorOrder::Logged || log.report.rotor_outputs.is_empty() {
        return log;
    }
    let Some((name, places, how)) = airframe::stated_places(&log) else {
        return log;
    };
    if places.len() != log.rotor_count() || places.len() != vehicle.rotor_count() {
        return log;
    }
    let Some(order) = order_on(&places, vehicle) else {
        let note = format!(
            "{}: its parameters put the motors where the vehicle '{}' has none ({name}: {how}); the columns are taken in the vehicle's order as \
             they are",
            log.name, vehicle.name
        );
        log.report.rotor_order = RotorOrder::Vehicle(note);
        return log;
    };
    if order.iter().copied().eq(0..order.len()) {
        return log;
    }
    let was_right = !is_swapped(&log, vehicle);
    let back = inverse(&order);
    log.reorder_rotors(&order);
    let is_wrong = is_swapped(&log, vehicle);
    let note = if is_wrong && was_right {
        log.reorder_rotors(&back);
        format!(
            "{}: by its parameters ({name}: {how}) its motors are in another order than the rotors of the vehicle '{}', and the motion says that \
             they are not: the columns are taken as they are",
            log.name, vehicle.name
        )
    } else {
        let motors: Vec<String> = order.iter().map(|motor| (motor + 1).to_string()).collect();
        format!(
            "{}: read in the rotor order of the vehicle '{}': its rotors 1 to {} are the log's motors {} ({name}: {how})",
            log.name,
            vehicle.name,
            order.len(),
            motors.join(", ")
        )
    };
    log.report.rotor_order = RotorOrder::Vehicle(note);
    log
}

/// Why a vehicle identified from a log is rejected: frames with too many rotors to try every order are compared with
/// the motion here, as in a later comparison of the log with the vehicle. `None` if nothing contradicts it, or the
/// motion was used before.
pub fn frame_contradiction(log: &FlightLog, vehicle: &VehicleModel, airframe: &Airframe) -> Option<String> {
    if airframe.motion.is_some() || airframe.against_the_motion {
        return None;
    }
    let log = in_the_order_of(log.clone(), vehicle);
    let found = log.check_against_vehicle(vehicle).into_iter();
    let swapped = found
        .into_iter()
        .find(|finding| finding.kind == FindingKind::SwappedMotors)?;
    Some(format!(
        "{}: the frame {} ({}) contradicts the motion: {}; name the right one with --frame, or insist with --trust-frame",
        log.name, airframe.name, airframe.how, swapped.detail
    ))
}

fn is_swapped(log: &FlightLog, vehicle: &VehicleModel) -> bool {
    let found = log.check_against_vehicle(vehicle);
    found.iter().any(|finding| finding.kind == FindingKind::SwappedMotors)
}

/// For each rotor of the vehicle the motor that is it, both from 0; `None` where a rotor has none, or more than one.
fn order_on(places: &[Place], vehicle: &VehicleModel) -> Option<Vec<usize>> {
    let azimuth = |x: f64, y: f64| y.atan2(x).to_degrees();
    let mut order = Vec::with_capacity(places.len());
    for rotor in &vehicle.rotors.layout.placements() {
        let [x, y, _] = rotor.position_body;
        let is_it = |place: &Place| {
            let away = (azimuth(place.position[0], place.position[1]) - azimuth(x, y)).rem_euclid(360.0);
            place.spin == rotor.spin && away.min(360.0 - away) < TOLERANCE_DEG
        };
        let mut found = (0..places.len()).filter(|motor| is_it(&places[*motor]));
        order.push(found.next().filter(|_| found.next().is_none())?);
    }
    let mut sorted = order.clone();
    sorted.sort_unstable();
    sorted.into_iter().eq(0..places.len()).then_some(order)
}

fn inverse(order: &[usize]) -> Vec<usize> {
    let mut inverse = vec![0; order.len()];
    for (rotor, motor) in order.iter().enumerate() {
        inverse[*motor] = rotor;
    }
    inverse
}

/// Both vehicles have their rotors in the same order: a log that was put in that of one is in that of the other.
pub fn same_rotor_order(a: &VehicleModel, b: &VehicleModel) -> bool {
    let places = |vehicle: &VehicleModel| -> Vec<Place> {
        let of = |rotor: &rotortwin_plant::vehicle::model::RotorPlacement| Place {
            position: [rotor.position_body[0], rotor.position_body[1]],
            spin: rotor.spin,
        };
        vehicle.rotors.layout.placements().iter().map(of).collect()
    };
    order_on(&places(a), b).is_none_or(|order| order.into_iter().eq(0..a.rotor_count()))
}
