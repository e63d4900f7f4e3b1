//! Flights of a report over time: each flight, and measured against model in every channel that can be tested.

use serde::Serialize;

use crate::compare::report::Drawn;
use crate::compare::{NamedModel, compare};
use crate::flight_picture::FlightPicture;
use crate::log::FlightLog;

/// Rows of all logs beyond which a report compares nothing: it would hold gigabytes for a picture of a screen.
const MOST_ROWS: usize = 2_000_000;

/// The flights of a report.
#[derive(Serialize)]
pub struct OverTime {
    flights: Vec<FlightPicture>,
    /// Absent where it could not be compared.
    compared: Option<Drawn>,
    /// Why it could not, one sentence.
    not_compared: Option<String>,
}

impl OverTime {
    /// Draws logs, and compares models with them. What cannot be compared is drawn all the same, with the reason.
    pub fn of(logs: &[FlightLog], models: &[NamedModel]) -> Self {
        let rows: usize = logs.iter().map(|log| log.time_s.len()).sum();
        let compared = if rows > MOST_ROWS {
            Err(format!(
                "The flights have {rows} rows together: too many to draw each channel against the model here; compare a part of them, as in LOG@35:65."
            ))
        } else {
            compare(logs, models)
                .map(|(comparison, series)| Drawn::new(comparison, &series))
                .map_err(|error| error.to_string())
        };
        let (compared, not_compared) = match compared {
            Ok(drawn) => (Some(drawn), None),
            Err(reason) => (None, Some(reason)),
        };
        Self {
            flights: logs.iter().map(FlightPicture::of).collect(),
            compared,
            not_compared,
        }
    }
}
