//! A flight.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// A flight.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[schema(as = FlightJob)]
pub struct Flight {
    /// Scenario, vehicle, blades and classifier in full (TOML), so that the flight does not depend on files or the library.
    pub documents: String,
    /// u64 as text, because JSON numbers are exact only up to 2⁵³ in many programs.
    pub seed: String,
    /// How the processes are connected.
    pub link: Link,
    /// Pace of the flight.
    pub pace: Pace,
    /// Controller.
    #[serde(default)]
    pub controller: Controller,
    /// FDI engine.
    #[serde(default)]
    pub fdi: Place,
    /// How long to wait for external peers, ms.
    #[serde(default = "join_timeout")]
    pub join_timeout_ms: u64,
}

/// Default time to wait for external peers, ms.
pub const fn join_timeout() -> u64 {
    60_000
}

/// How plant, controller and FDI engine are connected.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Link {
    /// Function calls in one process.
    InProcess,
    /// Three processes, shared memory.
    #[default]
    Iceoryx2,
    /// Three processes, TCP.
    Zenoh,
}

impl Link {
    /// Name in documents and on the command line.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::InProcess => "in-process",
            Self::Iceoryx2 => "iceoryx2",
            Self::Zenoh => "zenoh",
        }
    }
}

/// Pace of the run.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Pace {
    /// As fast as possible.
    #[default]
    Fast,
    /// 400 steps per second of wall clock.
    RealTime,
}

impl Pace {
    /// Name in documents and on the command line.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Fast => "fast",
            Self::RealTime => "real-time",
        }
    }
}

/// Controller of the run.
#[derive(Debug, Default, Clone, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Controller {
    /// The built-in one, started together with the plant.
    #[default]
    Beside,
    /// The built-in one, on any host that offers it (`rotortwin worker --roles`). Needs `link: zenoh`.
    Worker,
    /// An external one, which joins with the run's ticket. Needs `link: zenoh`.
    External,
    /// The autopilot of this name, configured by an operator (`GET /api/v1/autopilots`); plant and FDI engine are one
    /// process.
    Autopilot(String),
}

impl Controller {
    /// Where it runs; `None` for an autopilot.
    pub const fn place(&self) -> Option<Place> {
        match self {
            Self::Beside => Some(Place::Beside),
            Self::Worker => Some(Place::Worker),
            Self::External => Some(Place::External),
            Self::Autopilot(_) => None,
        }
    }

    /// Name of the autopilot, if it is one.
    pub fn autopilot(&self) -> Option<&str> {
        match self {
            Self::Autopilot(name) => Some(name),
            _ => None,
        }
    }
}

/// Interval of a part of a flight.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Place {
    /// The built-in one, started together with the plant.
    #[default]
    Beside,
    /// The built-in one, on any host that offers it (`rotortwin worker --roles`). Needs `link: zenoh`.
    Worker,
    /// An external one, which joins with the run's ticket. Needs `link: zenoh`.
    External,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows queued before autopilots were supported are still read.
    #[test]
    fn val_a_controller_is_a_word_or_a_named_autopilot() {
        let read = |text: &str| serde_json::from_str::<Controller>(text);
        assert_eq!(read("\"beside\"").unwrap(), Controller::Beside);
        assert_eq!(read("\"external\"").unwrap(), Controller::External);
        let named = Controller::Autopilot("bench-1".to_owned());
        let text = serde_json::to_string(&named).unwrap();
        assert_eq!(text, r#"{"autopilot":"bench-1"}"#);
        assert_eq!(read(&text).unwrap(), named);
        for wrong in ["\"autopilot\"", r#"{"address":"127.0.0.1:9002"}"#, "{}", "\"pid\""] {
            assert!(read(wrong).is_err(), "{wrong}");
        }
    }
}
