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

use rotortwin_jobs::{JobKind, Status};

/// Default tenant.
pub(crate) const LOCAL_TENANT: &str = "local";

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
