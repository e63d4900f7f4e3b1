//! Workers: each takes one job at a time from the queue and executes it in a separate process, `rotortwin job FILE`.
//!
//! ```text
//!  queue ──claim──▶ worker ──spawns──▶ rotortwin job ──spawns──▶ sim, controller, fdi (a flight)
//!                     │ ◀── events, one JSON line each ──┘
//!                     └──▶ files ─▶ artifact store; then events, outcome (with the claim's token) ─▶ database
//! ```
//! * Each attempt has its own folder, so that a worker that was presumed dead cannot overwrite another's files.
//! * A process ends when its standard input is closed: none outlives a killed worker.
//! * Attempts without a result, or failures of our own processes, are retried, [`ATTEMPTS`] times in all. The same seed gives
//!   identical results, so a second execution is harmless.

pub(crate) mod answer;
mod child;
mod flight;
pub(crate) mod handed;
pub(crate) mod ray;
mod seat;
mod task;

use crate::artifacts::Artifacts;
use crate::jobs::database::Database;
use crate::jobs::queue::{FairShare, Left, Takes};
use crate::jobs::{Job, Outcome};
use crate::pulse::Pulse;
use crate::traces::Traces;
use rotortwin_jobs::{JobFile, SeatRole, Status, StoredJob};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use tokio::process::Command;
use tokio::sync::watch;

/// Lifetime of a claim without a heartbeat.
const LEASE: Duration = Duration::from_secs(15);
/// Maximum attempts of a job that fails by itself.
const ATTEMPTS: i64 = 3;
/// Maximum attempts of a job whose workers die: it may be the cause.
const ATTEMPTS_OF_DEAD_WORKERS: i64 = 25;
/// Polling interval of an idle worker, whether or not it was woken.
const LOOK: Duration = Duration::from_secs(2);
/// How long a worker retries to store the result of a job.
const LAST_WORD: Duration = Duration::from_secs(60);

/// The job, in its folder.
const JOB_FILE: &str = "job.json";

/// Context of the workers.
#[derive(Debug)]
pub(crate) struct WorkerContext {
    /// The queue.
    pub(crate) database: Database,
    /// File store.
    pub(crate) artifacts: Artifacts,
    /// The `rotortwin` program.
    pub(crate) program: PathBuf,
    /// Display name of this process.
    pub(crate) name: String,
    /// Limit of running jobs per tenant.
    pub(crate) share: FairShare,
    /// Liveness of this process.
    pub(crate) pulse: Pulse,
    /// Autopilots reachable from here.
    pub(crate) autopilots: Vec<crate::Autopilot>,
    /// How processes on other hosts reach a plant started here.
    pub(crate) zenoh: Meeting,
    /// Threads of one job.
    pub(crate) threads: usize,
    /// Memory limit of a job's process, bytes.
    pub(crate) job_memory: u64,
    /// Becomes true on shutdown.
    pub(crate) ending: watch::Sender<bool>,
    /// Exporter of request and attempt spans.
    pub(crate) traces: Traces,
    /// A cluster for the parts of jobs; none: they are executed here.
    pub(crate) ray: Option<Arc<ray::Ray>>,
}

impl WorkerContext {
    /// Kinds of jobs taken by slots of this process.
    fn takes(&self) -> Takes {
        if self.ray.is_some() {
            Takes::AllButParts
        } else {
            Takes::All
        }
    }
}

/// Meeting point of a run's processes on different hosts.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Meeting {
    /// The plant listens here, on a free port if it is 0: `tcp/10.0.0.2:0`.
    Listen(String),
    /// All connect to this router: `tcp/router:7447`.
    Router(String),
}

/// End of an attempt.
enum Ended {
    Outcome(Outcome),
    /// A failure of our own: retry.
    Failed(String),
    /// The claim was lost.
    Lost,
    /// This process is shutting down: another one starts the job again.
    WorkerEnds,
}

impl Ended {
    /// A keyword, and the reason of a failure.
    fn in_short(&self) -> (&'static str, Option<&str>) {
        match self {
            Self::Outcome(outcome) => {
                let error = outcome.error.as_deref().filter(|_| outcome.status == Status::Failed);
                (outcome.status.as_str(), error)
            }
            Self::Failed(why) => ("failed", Some(why)),
            Self::Lost => ("lost", Some("another worker has this job")),
            Self::WorkerEnds => ("requeued", None),
        }
    }
}

/// Executes jobs until the process ends.
pub(crate) async fn work(context: Arc<WorkerContext>) {
    let mut ending = context.ending.subscribe();
    while !*ending.borrow() {
        context.pulse.beat();
        // On a full disk a job would only use up its attempts.
        let claimed = if context.artifacts.has_room() {
            context
                .database
                .claim(&context.name, LEASE, context.share, context.takes())
                .await
        } else {
            tracing::warn!("the disk with the files of jobs is full: no job is started");
            Ok(None)
        };
        match claimed {
            Ok(Some((job, token))) => {
                tracing::info!(
                    job = job.id,
                    kind = job.new.kind.as_str(),
                    attempt = job.attempts,
                    "begun"
                );
                let span = context.traces.attempt(&job, &context.name);
                let ended = attempt(&context, &job, &token).await;
                let (outcome, error) = ended.in_short();
                span.end(outcome, error);
                write_down(&context, &job, &token, ended).await;
                continue;
            }
            Ok(None) => {}
            Err(error) => tracing::error!(%error, "a worker cannot read the queue"),
        }
        tokio::select! {
            () = context.database.hub.queue.notified() => {}
            _ = ending.changed() => {}
            () = tokio::time::sleep(LOOK) => {}
        }
    }
}

/// Applies the limits of a job to a process of another program's parts: its own memory in bytes, processor time in s.
///
/// # Errors
/// The kernel refuses.
pub fn hold_within(process: u32, memory: u64, cpu_s: u64) -> std::io::Result<()> {
    child::Limits { memory, cpu_s }.hold_process(process)
}

/// The limit that ended a process limited by [`hold_within`] to `memory` bytes, with output `said`; `None`: another reason.
pub fn limit_that_ended(status: std::process::ExitStatus, said: &str, memory: u64) -> Option<String> {
    child::limit_of(status, said, memory)
}

/// Takes seats of runs flown elsewhere until the process ends.
pub(crate) async fn serve_seats(context: Arc<WorkerContext>, roles: Vec<SeatRole>) {
    let mut ending = context.ending.subscribe();
    while !*ending.borrow() {
        match context.database.take_seat(&roles).await {
            Ok(Some(seat)) => {
                seat::serve(&context, &seat).await;
                continue;
            }
            Ok(None) => {}
            Err(error) => tracing::error!(%error, "seats cannot be looked for"),
        }
        tokio::select! {
            () = context.database.hub.queue.notified() => {}
            _ = ending.changed() => {}
            () = tokio::time::sleep(LOOK / 4) => {}
        }
    }
}

/// Renews the offers of this process's autopilots.
///
/// # Errors
/// The database.
pub(crate) async fn offer_autopilots(context: &WorkerContext) -> Result<(), sqlx::Error> {
    for autopilot in &context.autopilots {
        if !context
            .database
            .offer_autopilot(&context.name, autopilot, LEASE)
            .await?
        {
            tracing::warn!(
                autopilot = autopilot.name,
                "another worker offers an autopilot with this name and uses it; this worker's autopilot is ignored"
            );
        }
    }
    Ok(())
}

/// [`offer_autopilots`] until the process ends.
pub(crate) async fn keep_offering(context: Arc<WorkerContext>) {
    let mut ending = context.ending.subscribe();
    while !*ending.borrow() {
        tokio::select! {
            _ = ending.changed() => {}
            () = tokio::time::sleep(LEASE / 3) => {
                if let Err(error) = offer_autopilots(&context).await {
                    tracing::error!(%error, "autopilots cannot be offered");
                }
            }
        }
    }
    if let Err(error) = context.database.withdraw_autopilots(Some(&context.name)).await {
        tracing::warn!(%error, "autopilots stay offered until their lease expires");
    }
}

/// Queues jobs of dead workers again.
pub(crate) async fn look_after_claims(context: Arc<WorkerContext>) {
    let mut ending = context.ending.subscribe();
    while !*ending.borrow() {
        if let Err(error) = requeue(&context.database, &context.artifacts, Left::Abandoned).await {
            tracing::error!(%error, "the search for abandoned jobs failed");
        }
        tokio::select! {
            _ = ending.changed() => {}
            () = tokio::time::sleep(LEASE / 3) => {}
        }
    }
}

/// Queues abandoned jobs again.
///
/// # Errors
/// The database.
pub(crate) async fn requeue(database: &Database, artifacts: &Artifacts, left: Left) -> Result<(), sqlx::Error> {
    for (id, status) in database.requeue_abandoned(left, ATTEMPTS_OF_DEAD_WORKERS).await? {
        if !status.is_final() {
            tracing::warn!(job = id, "its worker died: queued again");
            continue;
        }
        tracing::warn!(job = id, status = status.as_str(), "its worker died");
        discard(artifacts, &format!("jobs/{id}")).await;
    }
    Ok(())
}

/// Deletes files that nobody can read. What cannot be deleted now stays until its job is deleted.
async fn discard(artifacts: &Artifacts, key: &str) {
    if let Err(error) = artifacts.delete(key).await {
        tracing::warn!(key, %error, "files that nobody can read cannot be deleted");
    }
}

/// Key of an attempt's folder in the artifact store.
pub(crate) fn attempt_key(job: &Job) -> String {
    attempt_key_of(&job.id, job.attempts)
}

fn attempt_key_of(id: &str, attempt: i64) -> String {
    format!("jobs/{id}/{attempt}")
}

/// Key of the files of an attempt.
fn files_key(job: &Job) -> String {
    format!("{}/out", attempt_key(job))
}

async fn attempt(context: &WorkerContext, job: &Job, token: &str) -> Ended {
    forget_attempts_before(context, job).await;
    // Such a folder can only exist if a worker was killed between claiming and starting; no other process writes there.
    let folder = context.artifacts.place(&attempt_key(job));
    if let Err(error) = fresh_folder(&folder) {
        return Ended::Failed(format!("{}: cannot be made: {error}", folder.display()));
    }
    match StoredJob::parse(&job.new.spec) {
        Ok(StoredJob {
            job: rotortwin_jobs::Job::Run(spec),
            ..
        }) => flight::fly(context, job, token, &spec, &folder).await,
        Ok(stored) => task::perform(context, job, token, stored, &folder).await,
        Err(error) => Ended::Outcome(failed(job, error.to_string())),
    }
}

/// Results of earlier attempts are obsolete: the same seed gives identical results. (One may still be writing, on a disconnected host; it will
/// find its folder gone, and its claim lost.)
async fn forget_attempts_before(context: &WorkerContext, job: &Job) {
    for attempt in 1..job.attempts {
        discard(&context.artifacts, &attempt_key_of(&job.id, attempt)).await;
    }
}

/// The process of a job, in the job's folder: `rotortwin job job.json`. All parameters are in that file, so that no command option can be
/// misspelt here.
fn job_command(program: &Path, file: &JobFile, folder: &Path) -> std::io::Result<Command> {
    std::fs::write(folder.join(JOB_FILE), file.to_json()?)?;
    let mut command = Command::new(program);
    command.args(["job", JOB_FILE]).current_dir(folder);
    Ok(command)
}

fn fresh_folder(folder: &std::path::Path) -> std::io::Result<()> {
    if folder.exists() {
        std::fs::remove_dir_all(folder)?;
    }
    std::fs::create_dir_all(folder)
}

/// Pause before a retry.
fn pause_after_failure(job: &Job) -> Duration {
    Duration::from_millis(500) * 4_u32.pow(u32::try_from(job.failures).unwrap_or(0))
}

async fn write_down(context: &WorkerContext, job: &Job, token: &str, ended: Ended) {
    let ended = match ended {
        Ended::Failed(why) if job.failures + 1 >= ATTEMPTS => {
            Ended::Outcome(failed(job, format!("{why} ({} attempts)", job.failures + 1)))
        }
        ended => ended,
    };
    let ended = match ended {
        Ended::Outcome(outcome) => Ended::Outcome(accounted(context, job, outcome).await),
        ended => ended,
    };
    let last_word = last_word(context, job, token, &ended).await;
    match last_word {
        Some(true) if matches!(&ended, Ended::Outcome(outcome) if outcome.status == Status::Done) => {
            forget_parts(context, &job.id).await;
        }
        Some(false) => {
            tracing::warn!(job = job.id, "another worker has this job: its result counts");
            discard(&context.artifacts, &attempt_key(job)).await;
        }
        _ => {}
    }
    context.artifacts.leave(&attempt_key(job));
}

/// Writes the end of an attempt into the database. `false`: another worker has the job; `None`: the database could not
/// be reached.
async fn last_word(context: &WorkerContext, job: &Job, token: &str, ended: &Ended) -> Option<bool> {
    let begun = tokio::time::Instant::now();
    loop {
        let written = match ended {
            Ended::Lost => Ok(false),
            Ended::Failed(why) => {
                let pause = pause_after_failure(job);
                context.database.release(&job.id, token, why, Some(pause)).await
            }
            Ended::WorkerEnds => {
                context
                    .database
                    .release(&job.id, token, "its worker was stopped", None)
                    .await
            }
            Ended::Outcome(outcome) => context.database.finish(&job.id, token, outcome).await,
        };
        match written {
            Ok(written) => return Some(written),
            Err(error) if begun.elapsed() < LAST_WORD => {
                tracing::error!(job = job.id, %error, "the end of a job cannot be written; trying again");
                tokio::time::sleep(Duration::from_millis(500)).await;
            }
            // The claim expires and the job is started again: nothing is lost.
            Err(error) => {
                tracing::error!(job = job.id, %error, "the end of a job cannot be written; it will be started again");
                return None;
            }
        }
    }
}

/// The stored files of an attempt count for its tenant, however it ended; unreadable ones are removed.
async fn accounted(context: &WorkerContext, job: &Job, mut outcome: Outcome) -> Outcome {
    if outcome.status == Status::Done || outcome.bytes > 0 {
        return outcome;
    }
    if outcome.folder.is_some() {
        outcome.bytes = kept_of_failed(context, job).await;
        return outcome;
    }
    discard(&context.artifacts, &attempt_key(job)).await;
    outcome
}

/// Keeps the files of a job's last attempt for error analysis; returns their size, which counts for its tenant.
async fn kept_of_failed(context: &WorkerContext, job: &Job) -> i64 {
    match context.artifacts.publish(&files_key(job)).await {
        Ok(bytes) => i64::try_from(bytes).unwrap_or(i64::MAX),
        Err(error) => {
            tracing::warn!(job = job.id, %error, "files of a job that failed cannot be kept; they are removed");
            discard(&context.artifacts, &attempt_key(job)).await;
            0
        }
    }
}

/// The files of a job's parts are in its own files now.
async fn forget_parts(context: &WorkerContext, job: &str) {
    let forgotten = async {
        for key in context
            .database
            .forget_files_of_parts(job)
            .await
            .map_err(std::io::Error::other)?
        {
            context.artifacts.delete(&key).await?;
        }
        Ok::<(), std::io::Error>(())
    };
    if let Err(error) = forgotten.await {
        tracing::warn!(job, %error, "files of its parts, no longer needed, cannot be deleted");
    }
}

fn failed(job: &Job, error: String) -> Outcome {
    Outcome {
        status: Status::Failed,
        folder: Some(files_key(job)),
        bytes: 0,
        run_hash: None,
        error: Some(error),
        result: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rotortwin_jobs::{Here, Verification};
    use std::ffi::OsStr;

    /// A job is defined by its file alone: renaming an option breaks no queued job.
    #[test]
    fn regress_a_worker_spells_no_option() {
        let folder = tempfile::tempdir().unwrap();
        let file = JobFile {
            job: rotortwin_jobs::Job::Verification(Verification { run: "run".into() }),
            here: Here::default(),
        };
        let command = job_command(Path::new("rotortwin"), &file, folder.path()).unwrap();
        let words: Vec<&OsStr> = command.as_std().get_args().collect();
        assert_eq!(words, ["job", JOB_FILE]);
        let written = std::fs::read_to_string(folder.path().join(JOB_FILE)).unwrap();
        assert_eq!(JobFile::parse(&written), Ok(file));
        for source in [
            include_str!("flight.rs"),
            include_str!("task.rs"),
            include_str!("child.rs"),
            // Questions that callers wait for.
            include_str!("../routes/fdi_reports.rs"),
            include_str!("../routes/log_mapping.rs"),
            include_str!("../routes/queries.rs"),
            include_str!("../routes/sandbox.rs"),
        ] {
            assert_eq!(source.matches("\"--").count(), 0);
        }
    }
}
