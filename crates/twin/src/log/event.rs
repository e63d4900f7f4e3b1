//! Events of a flight: of the vehicle, its autopilot, its pilot.

use serde::{Deserialize, Serialize};

/// What happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "kebab-case")]
#[schema(as = FlightEventKind)]
pub enum EventKind {
    /// A motor output at its upper limit.
    Saturated,
    /// A motor at its limit while the attitude runs away.
    LostRotor,
    /// A parameter took a motor away.
    MotorOff,
    /// Position, velocity or heading jump while the vehicle does not.
    EstimatorReset,
    /// No rows.
    Gap,
    /// An impact at the end of a landing.
    HardLanding,
    /// Another flight mode; armed, disarmed.
    Mode,
    /// Parameters of the autopilot were changed.
    Parameter,
    /// A pilot's sticks away from their middle.
    Pilot,
}

impl EventKind {
    /// Whether it decides about a flight: a rotor without its thrust.
    pub fn decides(self) -> bool {
        matches!(self, Self::LostRotor | Self::MotorOff)
    }
}

/// An event of the flight.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct FlightEvent {
    /// What.
    pub kind: EventKind,
    /// s, on the log's time.
    pub start_s: f64,
    /// s, on the log's time.
    pub end_s: f64,
    /// Motor output concerned, from 1, as in `duty_1`.
    pub output: Option<usize>,
    /// One clause with figures.
    pub detail: String,
}
