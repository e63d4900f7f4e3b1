//! Jobs of the queue, as data: stored by a server, executed by a worker. This crate executes nothing itself.
//!
//! ```text
//!  submission (HTTP body) ─▶ Job ─▶ StoredJob (a row) ─▶ worker: lays out the inputs, writes a JobFile ─▶ `rotortwin job FILE` ─▶ runner
//!  command line ─▶ Job ───────────────────────────────────────────────────────────────────────────────────────────────────────▶ runner
//! ```
//! While running, a job emits [`JobEvent`]s. It refers to files by path. The [`Input`]s of the [`StoredJob`] define their location and
//! content on the executing machine; a worker lays them out first. What a server's queue says about a job, and what its clients send, is here
//! too: [`submission`], [`QueueEvent`], [`JobKind`], [`Status`].

pub mod blind;
pub mod campaign;
pub mod error;
pub mod event;
pub mod file;
pub mod flight;
pub mod input;
pub mod kind;
pub mod log;
pub mod part;
pub mod question;
pub mod queue_event;
mod span;
pub mod status;
pub mod stored;
pub mod submission;
pub mod ticket;
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
pub use kind::JobKind;
pub use log::{ExampleCase, LogExample, LogImport};
pub use part::{NextPart, PartAccepted, PartEnd, PartEvents, PartFile, PartHow, PartInput, PartOrder};
pub use question::{
    CampaignCheck, CheckedCampaign, CheckedFlight, EffectPicture, LogOverTime, LogTruth, LogVerdict, MappingDraft,
    Question, SqlQuestion,
};
pub use queue_event::{QueueEvent, QueueEventKind};
pub use status::Status;
pub use stored::StoredJob;
pub use ticket::{Invitation, SeatRole, Ticket, Tickets};
pub use training::Training;
pub use twin::{Comparison, Diagnosis, Identification, Improvement, NextFlight};
pub use verification::{Verification, Verified};

use serde::{Deserialize, Serialize};
use std::num::NonZeroUsize;
use utoipa::ToSchema;

/// All kinds of jobs. In JSON, `job` says which.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "job", rename_all = "kebab-case")]
pub enum Job {
    /// One flight.
    Run(Flight),
    /// Many flights, some shards of a campaign, or the combination of their results.
    Campaign(Campaign),
    /// Logs with hidden effects, some cases of a bench, or the combination of their results.
    BlindBench(BlindBench),
    /// Import of a flight log.
    LogImport(LogImport),
    /// Creation of an example flight log.
    LogExample(LogExample),
    /// Comparison of models with flights.
    Comparison(Comparison),
    /// Which effects a model lacks.
    Diagnosis(Diagnosis),
    /// Compare, diagnose, add, compare again.
    Improvement(Improvement),
    /// A vehicle identified from flight logs.
    Identification(Identification),
    /// What to fly next.
    NextFlight(NextFlight),
    /// Training of a classifier.
    Training(Training),
    /// Replay of a run.
    Verification(Verification),
}

impl Job {
    /// Sets its number of threads, if it supports several and does not set it itself.
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

    /// Files in its folder that are useless after it has ended.
    pub const fn leftovers(&self) -> &'static [&'static str] {
        match self {
            Self::Campaign(_) => &["campaign.lock"],
            _ => &[],
        }
    }
}
