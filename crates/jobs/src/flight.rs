//! A flight.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// A flight.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[schema(as = FlightJob)]
pub struct Flight {
    /// Scenario, vehicle, blades, classifier in full (TOML): whatever becomes of files and of the library, the flight is the same.
    pub documents: String,
    /// u64; a text, because JSON numbers of other programs end at 2⁵³.
    pub seed: String,
    /// How the processes are connected.
    pub link: Link,
    /// How fast.
    pub pace: Pace,
    /// Who the controller is.
    #[serde(default)]
    pub controller: Controller,
    /// Who the FDI engine is.
    #[serde(default)]
    pub fdi: Place,
    /// How long peers from outside are waited for, ms.
    #[serde(default = "join_timeout")]
    pub join_timeout_ms: u64,
}

/// How long peers from outside are waited for where nothing is said, ms.
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
    /// As documents and the command line have it.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::InProcess => "in-process",
            Self::Iceoryx2 => "iceoryx2",
            Self::Zenoh => "zenoh",
        }
    }
}

/// How fast.
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
    /// As documents and the command line have it.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Fast => "fast",
            Self::RealTime => "real-time",
        }
    }
}

/// Who flies.
#[derive(Debug, Default, Clone, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Controller {
    /// Ours, started beside the plant.
    #[default]
    Beside,
    /// Ours, on whichever host offers it (`rotortwin worker --roles`). Needs `link: zenoh`.
    Worker,
    /// Somebody else's: it joins with the run's ticket. Needs `link: zenoh`.
    External,
    /// The autopilot of this name, which an operator has listed (`GET /api/v1/autopilots`); plant and FDI engine are one process.
    Autopilot(String),
}

impl Controller {
    /// Where it is; `None`: it is an autopilot.
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

/// Where a part of a flight is.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Place {
    /// Ours, started beside the plant.
    #[default]
    Beside,
    /// Ours, on whichever host offers it (`rotortwin worker --roles`). Needs `link: zenoh`.
    Worker,
    /// Somebody else's: it joins with the run's ticket. Needs `link: zenoh`.
    External,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows that were queued before there were autopilots are read as they are.
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
