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

/// Rejects the first log that must be fixed before a diagnosis with this vehicle.
pub(crate) fn refused(logs: &[FlightLog], vehicle: &VehicleModel) -> Result<(), Failure> {
    match logs.iter().find_map(|log| log.refusal_before_diagnosis(vehicle)) {
        Some(sentence) => Err(Failure::input(sentence)),
        None => Ok(()),
    }
}
