//! An autopilot with its own instruments and clock, in place of the controller.
//!
//! ```text
//!  plant ── Readings at t ──▶ Autopilot ──▶ duties for t … t + interval ──▶ plant
//! ```
//! It sees what a flight board sees, and is called at its own rate, in parts of 0.5 ms of the plant's clock, which is the master: an
//! autopilot that takes three seconds to compute costs no simulated time.

use rotortwin_flight_core::MAX_ROTORS;
use std::time::Duration;

/// Instrument readings of a vehicle at one instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Readings {
    /// Time of the plant, ns, since its start.
    pub time_ns: u64,
    /// Specific force, m/s², body: (0, 0, −g) at rest.
    pub specific_force_m_s2: [f64; 3],
    /// rad/s, body.
    pub body_rates_rad_s: [f64; 3],
    /// Gauss, body.
    pub magnetic_field_gauss: [f64; 3],
    /// Static pressure, hPa.
    pub pressure_hpa: f64,
    /// Altitude of that pressure in the standard atmosphere, m.
    pub pressure_altitude_m: f64,
    /// °C.
    pub temperature_c: f64,
    /// The fix received since the last readings.
    pub gps: Option<Fix>,
    /// Distance to the ground along the body's down axis, m; `None`: out of range.
    pub range_m: Option<f64>,
    /// At the battery's terminals, V; 0: unknown.
    pub battery_voltage_v: f64,
    /// Discharge positive, A.
    pub battery_current_a: f64,
    /// True position, m, NED from home: for simulator links that model their own sensors.
    pub position_ned_m: [f64; 3],
    /// True velocity, m/s, NED.
    pub velocity_ned_m_s: [f64; 3],
    /// True roll, pitch, yaw, rad.
    pub attitude_rad: [f64; 3],
}

/// One satellite navigation fix.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Fix {
    /// Degrees.
    pub latitude_deg: f64,
    /// Degrees.
    pub longitude_deg: f64,
    /// Above mean sea level, m.
    pub altitude_m: f64,
    /// m/s, NED.
    pub velocity_ned_m_s: [f64; 3],
}

/// Commanded position: the reference of the scenario, before the flight its first point.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wanted {
    /// m, NED.
    pub position_ned_m: [f64; 3],
    /// m/s, NED.
    pub velocity_ned_m_s: [f64; 3],
    /// rad.
    pub yaw_rad: f64,
}

/// Identity of an autopilot, for the record of a run.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Identity {
    /// For example "ArduPilot at 127.0.0.1:40112".
    pub peer: String,
    /// For example "ArduPilot 4.7.0 dev (2598e9d4)"; `None`: unknown.
    pub version: Option<String>,
    /// True if it waits for us in each of its steps.
    pub lockstep: bool,
}

impl Identity {
    /// Identity of a lockstep controller that reports itself as `NAME VERSION`.
    pub fn of_program(program: &str) -> Self {
        let versioned = program
            .rsplit_once(' ')
            .filter(|(_, version)| version.starts_with(|first: char| first.is_ascii_digit()));
        let (peer, version) = match versioned {
            Some((name, version)) => (name, Some(version.to_owned())),
            None => (program, None),
        };
        Self {
            peer: peer.to_owned(),
            version,
            lockstep: true,
        }
    }
}

/// Why we stopped waiting for an autopilot.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{sentence}")]
pub struct AutopilotError {
    /// Error message with peer and last frame.
    pub sentence: String,
    /// How long it had been silent; 0 if it was not silence.
    pub silence: Duration,
    /// True if it never connected, fell silent or disconnected; false if it violated the protocol.
    pub lost: bool,
    /// We were asked to stop meanwhile; nobody is at fault.
    pub stopped: bool,
}

impl AutopilotError {
    /// A protocol violation.
    pub fn wrong(sentence: impl Into<String>) -> Self {
        Self {
            sentence: sentence.into(),
            silence: Duration::ZERO,
            lost: false,
            stopped: false,
        }
    }

    /// The peer is missing.
    pub fn lost(sentence: impl Into<String>, silence: Duration) -> Self {
        Self {
            silence,
            lost: true,
            ..Self::wrong(sentence)
        }
    }

    /// Stopped while waiting.
    pub fn stopped() -> Self {
        Self {
            stopped: true,
            ..Self::wrong("stopped while waiting")
        }
    }
}

/// An autopilot with its own protocol.
pub trait Autopilot {
    /// Parts of 0.5 ms from one exchange to the next.
    fn interval_parts(&self) -> u32;

    /// Sends the current readings and returns the duties, in our rotor order, that are held until the next exchange.
    ///
    /// # Errors
    /// It never connected, fell silent, or violated the protocol; the message names peer and frame. Never waits longer than its time-outs.
    fn exchange(&mut self, readings: &Readings) -> Result<[f64; MAX_ROTORS], AutopilotError>;

    /// Its identity, as far as known.
    fn identity(&self) -> Identity;

    /// Commanded position from now on; called at each step of 2.5 ms, before, during and after the flight. Ignored by an autopilot under
    /// external control.
    fn steer(&mut self, _wanted: &Wanted) {}

    /// A line of its messages, or of ours to it, since the last call.
    fn words(&mut self) -> Option<String> {
        None
    }

    /// The hand-over: after a restart it would no longer be the same flight.
    fn flight_begins(&mut self) {}

    /// The last step of the flight is over. True: it lands now, and exchanges must continue until [`Autopilot::landed`].
    fn flight_ends(&mut self) -> bool {
        false
    }

    /// True once it has landed and stopped its motors.
    fn landed(&self) -> bool {
        false
    }

    /// The run is over.
    fn finish(&mut self) {}
}
