//! What a worker is told to do. It stands in the database as JSON: whatever becomes of files and of the library, the job is the same.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// What a worker is told to do.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub(crate) enum Spec {
    /// `rotortwin fly`.
    Flight(Flight),
    /// Another command of `rotortwin`.
    Task(Task),
}

/// A flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Flight {
    /// Scenario, vehicle, blades, classifier in full (TOML).
    pub(crate) documents: String,
    /// u64; a text, because JSON numbers of other programs end at 2⁵³.
    pub(crate) seed: String,
    /// How the processes are connected.
    pub(crate) link: Link,
    /// How fast.
    pub(crate) pace: Pace,
    /// Who the controller is.
    #[serde(default)]
    pub(crate) controller: Place,
    /// Who the FDI engine is.
    #[serde(default)]
    pub(crate) fdi: Place,
    /// How long peers from outside are waited for.
    #[serde(default = "join_timeout")]
    pub(crate) join_timeout_ms: u64,
}

/// How long peers from outside are waited for where nothing is said.
pub(crate) const fn join_timeout() -> u64 {
    60_000
}

/// How plant, controller and FDI engine are connected.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Link {
    /// Function calls in one process.
    InProcess,
    /// Three processes, shared memory.
    #[default]
    Iceoryx2,
    /// Three processes, TCP.
    Zenoh,
}

impl Link {
    /// As the command line has it.
    pub(crate) const fn as_str(self) -> &'static str {
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
pub(crate) enum Pace {
    /// As fast as possible.
    #[default]
    Fast,
    /// 400 steps per second of wall clock.
    RealTime,
}

impl Pace {
    /// As the command line has it.
    pub(crate) const fn as_str(self) -> &'static str {
        match self {
            Self::Fast => "fast",
            Self::RealTime => "real-time",
        }
    }
}

/// Who flies as controller, who as FDI engine.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Place {
    /// Ours, started beside the plant.
    #[default]
    Beside,
    /// Ours, on whichever host offers it (`rotortwin worker --roles`). Needs `link: zenoh`.
    Worker,
    /// Somebody else's: it joins with the run's ticket. Needs `link: zenoh`.
    External,
}

/// A command of `rotortwin`. The arguments are made by the server from a checked submission, never from words of a client.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Task {
    /// After `rotortwin`; run in a folder that holds the inputs. `out` is the folder of its files.
    pub(crate) args: Vec<String>,
    /// What it reads.
    pub(crate) inputs: Vec<Input>,
    /// File in `out` that holds the result (JSON); none: its standard output is the result.
    pub(crate) result: Option<String>,
    /// Files that are of no use to anybody once it is done, in `out`.
    #[serde(default)]
    pub(crate) discard: Vec<String>,
}

/// A file or folder that a task reads.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Input {
    /// Where it is to be, relative to the folder in which the task runs.
    pub(crate) path: String,
    /// What is to be there.
    pub(crate) content: Content,
}

/// Where an input comes from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Content {
    /// This text.
    Text(String),
    /// A file of the artifact store.
    File(String),
    /// Everything below this in the artifact store.
    Folder(String),
    /// For a job that waits for parts: everything that each part has left, one below the other.
    Parts,
}
