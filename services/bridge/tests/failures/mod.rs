//! Error messages of failed flights.

use rotortwin_flight::autopilot::AutopilotOutcome;
use rotortwin_flight::lockstep::FlightEnd;

/// The error message of a failed flight.
pub(crate) fn sentence(outcome: &AutopilotOutcome) -> &str {
    match &outcome.flight.end {
        FlightEnd::Failed(failure) => &failure.sentence,
        other => panic!("the flight should have failed: {other:?}"),
    }
}
