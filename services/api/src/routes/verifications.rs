//! Verification of runs by a replay: a job like any other, so that it is scheduled fairly and restarted if its worker
//! is gone. The request waits for its end.

use super::facts::{JobFacts, VerificationFacts};
use super::jobs::{self, JobView, Shared, Terms};
use super::runs;
use super::tasks::Draft;
use crate::App;
use crate::access::Caller;
use crate::jobs::{Job, NewJob};
use crate::problem::Problem;
use axum::Json;
use axum::extract::Path;
use axum::extract::rejection::PathRejection;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use rotortwin_jobs::flight::Place;
use rotortwin_jobs::{Input, JobKind, Status, StoredJob, Verification as VerificationJob, Verified};
use rotortwin_sim::commands::COMMANDS_FILE;
use rotortwin_store::files::SUMMARY_FILE;
use serde::Serialize;
use std::time::Duration;
use utoipa::ToSchema;

super::collection!(
    verifications,
    rotortwin_jobs::JobKind::Verification,
    VerificationResult,
    "run flown again",
    "/api/v1/verifications",
    "/api/v1/verifications/{id}",
    "/api/v1/verifications/{id}/cancel",
    "/api/v1/verifications/{id}/events",
    "/api/v1/verifications/{id}/artifacts",
    "/api/v1/verifications/{id}/artifacts/{*path}"
);

/// A request waits this long; the job continues. Proxies and clients give up after 30 to 60 s.
const WAIT_TIMEOUT: Duration = Duration::from_secs(20);
/// Time limit of the second execution.
const LONGEST: Duration = Duration::from_secs(600);
/// Another process may have written the end.
const LOOK: Duration = Duration::from_secs(1);
const KIND: JobKind = JobKind::Verification;
/// Where the job finds the run.
const RUN: &str = "run";

/// Result of a second execution.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Verification {
    /// The hashes are equal.
    same: bool,
    /// Run hash of the run.
    recorded: String,
    /// Run hash of the second execution, in one process.
    again: String,
    /// Why the hashes may differ: an external controller flew the run, and the built-in one the second execution.
    /// Absent otherwise.
    #[serde(skip_serializing_if = "Option::is_none")]
    note: Option<String>,
    /// Duration including the time in the queue, ms.
    wall_ms: i64,
    /// Id of the verification job: `/api/v1/verifications/{id}`.
    job: String,
}

/// Flies a done run a second time, in one process, and compares the run hash. This is a queued job; the response comes when it has ended, or
/// after 20 s with the job, which continues.
#[utoipa::path(post, path = "/api/v1/runs/{id}/verify", tag = "runs", operation_id = "verify_run",
    params(("id" = String, Path), ("Idempotency-Key" = Option<String>, Header, description = "a retry with the same key waits for the same job")), responses(
    (status = 200, description = "compared", body = Verification),
    (status = 202, description = "still running: ask again with the same Idempotency-Key, or follow the job", body = JobView,
     headers(("Location" = String, description = "URL of the job"))),
    (status = 400, description = "invalid id", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "run not found", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "the run is not done", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "this version cannot fly the scenario", body = Problem, content_type = "application/problem+json"),
    (status = 503, description = "the server is shutting down; the job continues", body = Problem, content_type = "application/problem+json"),
    (status = 507, description = "disk full", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn verify(
    app: Shared,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let Path(id) = id?;
    let key = jobs::idempotency_key(&headers)?;
    let hash = jobs::request_hash(&id);
    // A retry waits for the same job, also where the run has been deleted since.
    if let Some(key) = &key
        && let Some(job) = jobs::job_before(&app, &caller, KIND, key, &hash).await?
    {
        let run = app.database.get(&id).await?;
        return compared(&app, run.as_ref(), &job.id).await;
    }
    let run = runs::find(&app, &caller, Ok(Path(id))).await?;
    let (Some(_), Some(folder), Status::Done) = (&run.run_hash, &run.folder, run.status) else {
        return Err(Problem::conflict(format!(
            "the run is {}; only a run that is done can be flown again and compared",
            run.status.as_str()
        )));
    };
    let mut files = vec![SUMMARY_FILE];
    if run.new.autopilot.is_some() {
        files.push(COMMANDS_FILE);
    }
    let mut inputs = Vec::with_capacity(files.len());
    for file in files {
        let there = app
            .artifacts
            .file(folder, file)
            .await
            .map_err(|error| Problem::of_files(&error))?;
        if there.is_none() {
            return Err(Problem::not_found(format!("the files of run {} were deleted", run.id)));
        }
        inputs.push(Input::file(format!("{RUN}/{file}"), format!("{folder}/{file}")));
    }
    let draft = Draft {
        kind: KIND,
        name: run.new.name.clone(),
        facts: JobFacts::Verification(VerificationFacts { run: run.id.clone() }),
        stored: StoredJob {
            job: rotortwin_jobs::Job::Verification(VerificationJob { run: RUN.into() }),
            inputs,
        },
        terms: Terms {
            max_wall_s: Some(LONGEST.as_secs()),
            ..Terms::default()
        },
    };
    let new = NewJob {
        parent: Some(run.id.clone()),
        idempotency_key: key,
        request_hash: hash,
        ..draft.into_job(&caller)?
    };
    let (job, _) = jobs::admit(&app, new).await?;
    compared(&app, Some(&run), &job.id).await
}

/// The answer once the job has ended, or the job as it is after [`WAIT_TIMEOUT`]. `run`: the run that it repeats, if it
/// exists.
async fn compared(app: &App, run: Option<&Job>, id: &str) -> Result<Response, Problem> {
    let job = ended(app, id).await?;
    if !job.status.is_final() {
        let location = format!("/api/v1/{}/{}", KIND.collection(), job.id);
        let goes_on = (
            StatusCode::ACCEPTED,
            [(header::LOCATION, location)],
            Json(JobView::from(job)),
        );
        return Ok(goes_on.into_response());
    }
    let replayed = job
        .result
        .as_deref()
        .and_then(|text| serde_json::from_str::<Verified>(text).ok());
    let Some(replayed) = replayed.filter(|_| job.status == Status::Done) else {
        let why = job.error.unwrap_or_else(|| format!("it was {}", job.status.as_str()));
        return Err(Problem::unprocessable(why.strip_prefix("rotortwin: ").unwrap_or(&why)));
    };
    let recorded = run.and_then(|run| run.run_hash.clone());
    let same = replayed.same && recorded.as_ref().is_none_or(|hash| *hash == replayed.recorded);
    let note = (!same)
        .then(|| replayed.note.or_else(|| run.and_then(note_of_others)))
        .flatten();
    if !same && note.is_none() {
        tracing::error!(
            run = run.map(|run| &run.id),
            recorded = replayed.recorded,
            again = replayed.replayed,
            "a second execution differs"
        );
    }
    Ok(Json(Verification {
        same,
        recorded: recorded.unwrap_or(replayed.recorded),
        again: replayed.replayed,
        note,
        wall_ms: job.finished_ms.unwrap_or(job.submitted_ms) - job.submitted_ms,
        job: job.id,
    })
    .into_response())
}

/// Why a second execution of a run may differ in which a third-party controller or FDI engine took part, whatever it called itself.
fn note_of_others(run: &Job) -> Option<String> {
    let facts: runs::Facts = serde_json::from_str(&run.new.facts).unwrap_or_default();
    let who = match (facts.controller.place(), facts.fdi) {
        (Some(Place::External), _) => "an external controller flew",
        (_, Place::External) => "an external FDI engine reported in",
        _ => return None,
    };
    Some(format!(
        "{who} the run, and our own did in the second execution, because the external one is not available here: the hashes do not show whether the run is \
         reproducible"
    ))
}

/// The job once it has ended, or as it is after [`WAIT_TIMEOUT`].
async fn ended(app: &App, id: &str) -> Result<Job, Problem> {
    let begun = tokio::time::Instant::now();
    let mut news = app.database.hub.watch(id);
    let mut ending = app.context.ending.subscribe();
    loop {
        let gone = || Problem::not_found(format!("the verification {id} was deleted"));
        let job = app.database.get(id).await?.ok_or_else(gone)?;
        if job.status.is_final() || begun.elapsed() > WAIT_TIMEOUT {
            return Ok(job);
        }
        if *ending.borrow_and_update() {
            return Err(Problem::unavailable(format!(
                "the server is ending; the verification continues: /api/v1/verifications/{id}"
            )));
        }
        tokio::select! {
            () = news.changed() => {}
            _ = ending.changed() => {}
            () = tokio::time::sleep(LOOK) => {}
        }
    }
}
