//! Whether a simulator wrote a log: it compares a model with another model, and nobody should take it for a flight.
//!
//! ArduPilot's simulator logs what it simulates (`SIM`) and has parameters `SIM_…`; PX4's publishes the truth (`…_groundtruth`); runs of
//! this program have columns `true_…`. A simulator that leaves no trace of itself is not recognised.

use super::sources::SourceLog;
use super::table::Table;

/// Parameters of ArduPilot's simulator; a vehicle has none.
const PARAMETER: &str = "SIM_";
/// Fewest of them.
const FEWEST_PARAMETERS: usize = 5;

fn note(by: &str) -> String {
    format!("A SIMULATOR WROTE THIS LOG ({by}): it tells how a model compares with another one, not with a vehicle")
}

/// What the streams of an autopilot's log say.
pub(super) fn of_streams(log: &SourceLog) -> Option<String> {
    if let Some(stream) = log.streams.iter().find(|s| s.name.ends_with("_groundtruth")) {
        return Some(note(&format!("it holds the truth, {}", stream.name)));
    }
    if log.streams.iter().any(|s| s.kind.starts_with("rotortwin.v1.")) {
        return Some(note("it is the recording of a run of this program"));
    }
    if log.streams.iter().any(|s| s.name == "SIM" || s.name == "SIM2") {
        return Some(note("it holds messages SIM of ArduPilot's simulator"));
    }
    let parameters = log.parameters.keys().filter(|name| name.starts_with(PARAMETER)).count();
    (parameters >= FEWEST_PARAMETERS).then(|| note(&format!("{parameters} parameters {PARAMETER}…")))
}

/// What the columns of a canonical table say.
pub(super) fn of_columns(table: &Table) -> Option<String> {
    let truth = table.columns.iter().find(|column| column.name.starts_with("true_"))?;
    Some(note(&format!("it holds the truth, {}", truth.name)))
}

#[cfg(test)]
mod tests {
    use super::super::sources::RawStream;
    use super::*;

    fn with(stream: &str, parameters: usize) -> SourceLog {
        SourceLog {
            streams: vec![RawStream {
                name: stream.to_owned(),
                ..RawStream::default()
            }],
            parameters: (0..parameters).map(|i| (format!("SIM_P{i}"), 1.0)).collect(),
            ..SourceLog::default()
        }
    }

    #[test]
    fn val_simulators_are_told_from_vehicles() {
        for log in [with("SIM", 0), with("vehicle_attitude_groundtruth", 0), with("IMU", 20)] {
            assert!(of_streams(&log).is_some_and(|note| note.starts_with("A SIMULATOR")));
        }
        // A vehicle with a parameter of a simulated battery.
        assert!(of_streams(&with("IMU", 1)).is_none());
        let mut table = Table::default();
        table.push("time_s", vec![0.0]);
        assert!(of_columns(&table).is_none());
        table.push("true_roll_rad", vec![0.0]);
        assert!(of_columns(&table).is_some());
    }
}
