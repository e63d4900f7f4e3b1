//! A flight.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// A flight.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
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
    pub controller: Place,
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

/// Who flies as controller, who as FDI engine.
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
