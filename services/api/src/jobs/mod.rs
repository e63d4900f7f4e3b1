//! Jobs: long-running tasks with a result, such as flights, campaigns and diagnoses.
//!
//! ```text
//!  submit ─▶ queued ──claim──▶ running ──finish──▶ done, failed, canceled
//!               ▲                 │
//!               └── release, lost claim (again after a pause, ATTEMPTS times in all)
//! ```
//! The state of jobs is in the database ([`store`]); [`hub`] only wakes those waiting for changes.

pub(crate) mod autopilots;
pub(crate) mod database;
pub(crate) mod handed;
pub(crate) mod hub;
pub(crate) mod live;
pub(crate) mod queue;
pub(crate) mod seats;
pub(crate) mod store;
mod table;
pub(crate) mod timed;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Default tenant.
pub(crate) const LOCAL_TENANT: &str = "local";

/// State of a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Status {
    /// Accepted; waits for a worker.
    Queued,
    /// A worker has it.
    Running,
    /// It is complete.
    Done,
    /// It ended early; `error` says why.
    Failed,
    /// Somebody stopped it.
    Canceled,
}

impl Status {
    /// Name in the database.
    pub(crate) const fn as_str(self) -> &'static str {
        match self {
            Self::Queued => "queued",
            Self::Running => "running",
            Self::Done => "done",
            Self::Failed => "failed",
            Self::Canceled => "canceled",
        }
    }

    fn parse(text: &str) -> Self {
        match text {
            "queued" => Self::Queued,
            "running" => Self::Running,
            "done" => Self::Done,
            "canceled" => Self::Canceled,
            _ => Self::Failed,
        }
    }

    /// Whether the state is final.
    pub(crate) const fn is_final(self) -> bool {
        matches!(self, Self::Done | Self::Failed | Self::Canceled)
    }
}

/// Kind of a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum JobKind {
    /// One flight.
    Run,
    /// Many flights, with statistics.
    Campaign,
    /// Some of a campaign's flights.
    CampaignShard,
    /// Logs with hidden effects, diagnosed and scored.
    BlindBench,
    /// Some of a blind bench's cases.
    BlindBenchShard,
    /// A flight log that is imported.
    Log,
    /// A model compared with a log.
    Comparison,
    /// Which effects a model lacks.
    Diagnosis,
    /// Compare, diagnose, add, compare again: versions of a model.
    Improvement,
    /// A vehicle that is identified from logs.
    Identification,
    /// The manoeuvre that would distinguish two effects.
    NextFlight,
    /// A classifier that is trained.
    Classifier,
    /// A run that is flown again.
    Verification,
}

impl JobKind {
    /// All kinds, for look-ups.
    const ALL: [Self; 13] = [
        Self::Run,
        Self::Campaign,
        Self::CampaignShard,
        Self::BlindBench,
        Self::BlindBenchShard,
        Self::Log,
        Self::Comparison,
        Self::Diagnosis,
        Self::Improvement,
        Self::Identification,
        Self::NextFlight,
        Self::Classifier,
        Self::Verification,
    ];

    /// Name in the database.
    pub(crate) const fn as_str(self) -> &'static str {
        match self {
            Self::Run => "run",
            Self::Campaign => "campaign",
            Self::CampaignShard => "campaign-shard",
            Self::BlindBench => "blind-bench",
            Self::BlindBenchShard => "blind-bench-shard",
            Self::Log => "log",
            Self::Comparison => "comparison",
            Self::Diagnosis => "diagnosis",
            Self::Improvement => "improvement",
            Self::Identification => "identification",
            Self::NextFlight => "next-flight",
            Self::Classifier => "classifier",
            Self::Verification => "verification",
        }
    }

    /// Collection of this kind in the API: `/api/v1/COLLECTION`.
    pub(crate) const fn collection(self) -> &'static str {
        match self {
            Self::Run => "runs",
            Self::Campaign => "campaigns",
            Self::CampaignShard => "campaign-shards",
            Self::BlindBench => "blind-benches",
            Self::BlindBenchShard => "blind-bench-shards",
            Self::Log => "logs",
            Self::Comparison => "comparisons",
            Self::Diagnosis => "diagnoses",
            Self::Improvement => "improvements",
            Self::Identification => "identifications",
            Self::NextFlight => "next-flights",
            Self::Classifier => "classifiers",
            Self::Verification => "verifications",
        }
    }

    fn parse(text: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.as_str() == text)
    }
}

/// A job to submit.
#[derive(Debug, Clone)]
pub(crate) struct NewJob {
    /// Kind.
    pub(crate) kind: JobKind,
    /// Name of the scenario, the campaign, …
    pub(crate) name: String,
    /// Tenant.
    pub(crate) tenant: String,
    /// Larger takes precedence among the jobs of a tenant.
    pub(crate) priority: i64,
    /// JSON ([`rotortwin_jobs::StoredJob`]).
    pub(crate) spec: String,
    /// JSON: facts shown in lists.
    pub(crate) facts: String,
    /// The job it is forked from.
    pub(crate) parent: Option<String>,
    /// The client's key for this submission.
    pub(crate) idempotency_key: Option<String>,
    /// Hash of the submitted body.
    pub(crate) request_hash: String,
    /// Time limit of one attempt, ms.
    pub(crate) wall_limit_ms: i64,
    /// The autopilot that flies it: one run at a time, by the process that lists it.
    pub(crate) autopilot: Option<String>,
    /// Jobs whose files it or its parts read: they cannot be deleted before it has ended.
    pub(crate) needs: Vec<String>,
    /// Size of the uploaded file, which is kept until the job is deleted.
    pub(crate) upload_bytes: i64,
    /// Its parts: it starts when all of them are done.
    pub(crate) parts: Vec<NewJob>,
}

/// A job.
#[derive(Debug, Clone)]
pub(crate) struct Job {
    /// Time-ordered: later jobs have larger ids.
    pub(crate) id: String,
    /// Its state.
    pub(crate) status: Status,
    /// As submitted; `needs` and `parts` are empty.
    pub(crate) new: NewJob,
    /// The job that waits for this one.
    pub(crate) part_of: Option<String>,
    /// Number of unfinished parts.
    pub(crate) waits_for: i64,
    /// ms since 1970, by the database's clock, like all times.
    pub(crate) submitted_ms: i64,
    /// Start of the last attempt.
    pub(crate) started_ms: Option<i64>,
    /// End of the job.
    pub(crate) finished_ms: Option<i64>,
    /// Number of attempts.
    pub(crate) attempts: i64,
    /// Number of attempts that failed by themselves.
    pub(crate) failures: i64,
    /// Its current or last worker.
    pub(crate) worker: Option<String>,
    /// A cancellation has been requested.
    pub(crate) cancel_requested: bool,
    /// JSON: how external peers join.
    pub(crate) ticket: Option<String>,
    /// Folder of the valid attempt in the artifact store.
    pub(crate) folder: Option<String>,
    /// Size of its files, including its upload.
    pub(crate) bytes: i64,
    /// Hash over all samples of a flight.
    pub(crate) run_hash: Option<String>,
    /// Why it failed.
    pub(crate) error: Option<String>,
    /// JSON.
    pub(crate) result: Option<String>,
    /// JSON: the numbers of the result, flattened.
    pub(crate) metrics: Option<String>,
    /// Final verdict of a run's sequential detector.
    pub(crate) verdict: Option<i32>,
}

/// One event of a job.
#[derive(Debug, Clone)]
pub(crate) struct Event {
    /// From 1, without gaps.
    pub(crate) seq: i64,
    /// What happened.
    pub(crate) kind: String,
    /// JSON.
    pub(crate) data: String,
}

/// An event of any job, with its position in the global order.
#[derive(Debug, Clone)]
pub(crate) struct PlacedEvent {
    /// Its position.
    pub(crate) place: EventPlace,
    /// Its job.
    pub(crate) job: String,
    /// Kind of that job.
    pub(crate) job_kind: JobKind,
    /// The event itself.
    pub(crate) event: Event,
}

/// A position in the order of all events: id of the writing transaction, and its own number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct EventPlace {
    pub(crate) written: i64,
    pub(crate) position: i64,
}

impl std::fmt::Display for EventPlace {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}.{}", self.written, self.position)
    }
}

impl std::str::FromStr for EventPlace {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = |text: &str| text.parse::<i64>().ok().filter(|number| *number >= 0);
        text.split_once('.')
            .and_then(|(written, position)| {
                Some(Self {
                    written: number(written)?,
                    position: number(position)?,
                })
            })
            .ok_or_else(|| format!("'{text}' is not the id of an event; expected one such as 0.17"))
    }
}

/// A worker's final report.
#[derive(Debug, Clone)]
pub(crate) struct Outcome {
    /// A final status.
    pub(crate) status: Status,
    /// Its folder in the artifact store.
    pub(crate) folder: Option<String>,
    /// Size of its files.
    pub(crate) bytes: i64,
    /// Hash over all samples of a flight.
    pub(crate) run_hash: Option<String>,
    /// Why it failed.
    pub(crate) error: Option<String>,
    /// JSON.
    pub(crate) result: Option<String>,
}
