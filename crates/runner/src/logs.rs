//! Reading of a job's flights.

use crate::failure::Failure;
use rotortwin_plant::vehicle::model::VehicleModel;
use rotortwin_twin::identify::read_for;
use rotortwin_twin::log::{FlightLog, ReadOptions};
use std::path::PathBuf;

/// Reads the logs at these paths, or parts of them.
pub(crate) fn read_logs(paths: &[PathBuf]) -> Result<Vec<FlightLog>, Failure> {
    paths
        .iter()
        .map(|path| FlightLog::read_part(path).map_err(Failure::input))
        .collect()
}

/// The same, each in the rotor order of the vehicle to compare with.
pub(crate) fn read_logs_for(paths: &[PathBuf], vehicle: &VehicleModel) -> Result<Vec<FlightLog>, Failure> {
    paths
        .iter()
        .map(|path| read_for(path, &ReadOptions::default(), vehicle).map_err(Failure::input))
        .collect()
}

/// Rejects healthy flights of which one is, or overlaps, a log that is to be compared with them: what it has would count as healthy.
pub(crate) fn own_baseline(logs: &[FlightLog], healthy: &[FlightLog]) -> Result<(), Failure> {
    let span = |log: &FlightLog| log.time_s.first().copied().zip(log.time_s.last().copied());
    let is_of = |log: &FlightLog, other: &FlightLog| {
        let apart = span(log)
            .zip(span(other))
            .is_none_or(|(one, two)| one.1 <= two.0 || two.1 <= one.0);
        log.source.content_hash == other.source.content_hash && !apart
    };
    match logs.iter().find(|log| healthy.iter().any(|other| is_of(log, other))) {
        Some(log) => Err(Failure::input(format!(
            "{} is among the healthy flights, too: expected other flights, or other parts (LOG@from:to), as what it has would count as healthy",
            log.name
        ))),
        None => Ok(()),
    }
}

/// Rejects the first log that must be fixed before a diagnosis with this vehicle.
pub(crate) fn refused(logs: &[FlightLog], vehicle: &VehicleModel) -> Result<(), Failure> {
    match logs.iter().find_map(|log| log.refusal_before_diagnosis(vehicle)) {
        Some(sentence) => Err(Failure::input(sentence)),
        None => Ok(()),
    }
}
