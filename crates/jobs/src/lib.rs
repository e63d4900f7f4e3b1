//! Jobs of the queue, as data: what a server stores and a worker does. This crate does nothing itself.
//!
//! ```text
//!  HTTP body ─▶ Job ─▶ StoredJob (a row) ─▶ worker: lays out the inputs, writes a JobFile ─▶ `rotortwin job FILE` ─▶ runner
//!  command line ─▶ Job ──────────────────────────────────────────────────────────────────────────────────────────▶ runner
//! ```
//! While it is done, a job tells [`JobEvent`]s. It names files by path. Where those are on the machine that does it, and what is in them, is said by the [`Input`]s of the
//! [`StoredJob`], which a worker lays out first.

pub mod blind;
pub mod campaign;
pub mod error;
pub mod event;
pub mod file;
pub mod flight;
pub mod input;
pub mod log;
pub mod part;
mod span;
pub mod stored;
pub mod training;
pub mod twin;
pub mod verification;
mod version_1;

pub use blind::BlindBench;
pub use campaign::Campaign;
pub use error::NotUnderstood;
pub use event::{CaseDone, JobEvent, Progress};
pub use file::{AutopilotHere, FlightHere, Here, JobFile, Meeting};
pub use flight::Flight;
pub use input::{Content, Input};
pub use log::{ExampleCase, LogExample, LogImport};
pub use part::{NextPart, PartAccepted, PartEnd, PartEvents, PartFile, PartHow, PartInput, PartOrder};
pub use stored::StoredJob;
pub use training::Training;
pub use twin::{Comparison, Diagnosis, Identification, Improvement, NextFlight};
pub use verification::{Verification, Verified};

use serde::{Deserialize, Serialize};
use std::num::NonZeroUsize;
use utoipa::ToSchema;

/// Everything that can be asked for. In JSON, `job` says which.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "job", rename_all = "kebab-case")]
pub enum Job {
    /// One flight.
    Run(Flight),
    /// Many flights, or some of a campaign's, or their results put together.
    Campaign(Campaign),
    /// Logs with hidden effects, or some of a bench's, or their rows put together.
    BlindBench(BlindBench),
    /// A flight log is imported.
    LogImport(LogImport),
    /// A flight log is made as an example.
    LogExample(LogExample),
    /// Models compared with flights.
    Comparison(Comparison),
    /// Which effects a model lacks.
    Diagnosis(Diagnosis),
    /// Compare, diagnose, add, compare again.
    Improvement(Improvement),
    /// A vehicle from flight logs.
    Identification(Identification),
    /// What to fly next.
    NextFlight(NextFlight),
    /// A classifier is trained.
    Training(Training),
    /// A run is flown again.
    Verification(Verification),
}

impl Job {
    /// Sets how many threads it may take, where it can take several and does not say so itself.
    #[must_use]
    pub fn with_threads(mut self, threads: NonZeroUsize) -> Self {
        let slot = match &mut self {
            Self::Campaign(campaign) => Some(&mut campaign.threads),
            Self::BlindBench(bench) => Some(&mut bench.processes),
            Self::Training(training) => Some(&mut training.threads),
            _ => None,
        };
        if let Some(slot) = slot {
            slot.get_or_insert(threads);
        }
        self
    }

    /// Files in its folder that nobody needs once it has ended.
    pub const fn leftovers(&self) -> &'static [&'static str] {
        match self {
            Self::Campaign(_) => &["campaign.lock"],
            _ => &[],
        }
    }
}
