//! Runs: list, get, cancel, delete, join.

use super::jobs::{self, ListQuery, Shared};
use crate::App;
use crate::access::Caller;
use crate::jobs::Job;
use crate::problem::Problem;
use axum::Json;
use axum::extract::rejection::{PathRejection, QueryRejection};
use axum::extract::{Path, Query};
use axum::http::StatusCode;
use rotortwin_jobs::flight::{Controller, Flight, Link, Pace, Place};
use rotortwin_jobs::{JobKind, Status, StoredJob, Tickets};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

const KIND: JobKind = JobKind::Run;

/// What lists show of a run.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct Facts {
    pub(super) vehicle: String,
    pub(super) seed: String,
    pub(super) link: Link,
    pub(super) pace: Pace,
    #[serde(default)]
    pub(super) controller: Controller,
    #[serde(default)]
    pub(super) fdi: Place,
    #[serde(default)]
    pub(super) warnings: Vec<String>,
}

/// A run.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Run {
    /// Later runs have larger ids.
    id: String,
    /// `run`; jobs of all kinds have this, and a `result`.
    kind: JobKind,
    /// Name of the scenario.
    name: String,
    /// Name of the vehicle.
    vehicle: String,
    /// Its tenant.
    tenant: String,
    /// Its state.
    status: Status,
    /// Of all noise.
    seed: u64,
    /// How the processes are connected.
    link: Link,
    /// Pace of the run.
    pace: Pace,
    /// Controller of the run.
    controller: Controller,
    /// FDI engine of the run.
    fdi: Place,
    /// Larger values run first.
    priority: i64,
    /// The run that it was forked from, or the campaign that the flight belongs to.
    parent: Option<String>,
    /// ms since 1970, UTC.
    submitted_ms: i64,
    /// ms since 1970, UTC.
    started_ms: Option<i64>,
    /// ms since 1970, UTC.
    finished_ms: Option<i64>,
    /// Number of attempts.
    attempts: i64,
    /// Worker that executes or executed the job.
    worker: Option<String>,
    /// What a queued run waits for besides a free worker: its autopilot is busy or away. Not in lists.
    waits_because: Option<String>,
    /// A cancellation has been requested.
    cancel_requested: bool,
    /// Size of its files, bytes.
    bytes: i64,
    /// Verdict of the sequential detector at the end: 0 healthy, a rotor from 1, 100 i + j two rotors, −1 unknown fault, −2 not ready,
    /// −3 ambiguous. Absent before the end.
    verdict: Option<i32>,
    /// Hash over all samples: equal for equal scenario, seed and program, whatever the link.
    run_hash: Option<String>,
    /// Why it failed, one sentence.
    error: Option<String>,
    /// Settings that are allowed but probably unintended.
    warnings: Vec<String>,
    /// Summary of the flight and of the detectors' verdicts: `summary.json`. Not in lists.
    #[schema(value_type = Option<rotortwin_store::Summary>)]
    summary: Option<serde_json::Value>,
    /// The same as `summary`, under the name that the results of all jobs have.
    #[schema(value_type = Option<rotortwin_store::Summary>)]
    result: Option<serde_json::Value>,
}

impl From<Job> for Run {
    fn from(job: Job) -> Self {
        let facts: Facts = serde_json::from_str(&job.new.facts).unwrap_or_default();
        let summary: Option<serde_json::Value> = job.result.and_then(|text| serde_json::from_str(&text).ok());
        Self {
            verdict: job.verdict,
            id: job.id,
            kind: job.new.kind,
            name: job.new.name,
            vehicle: facts.vehicle,
            tenant: job.new.tenant,
            status: job.status,
            seed: facts.seed.parse().unwrap_or(0),
            link: facts.link,
            pace: facts.pace,
            controller: facts.controller,
            fdi: facts.fdi,
            priority: job.new.priority,
            parent: job.new.parent,
            submitted_ms: job.submitted_ms,
            started_ms: job.started_ms,
            finished_ms: job.finished_ms,
            attempts: job.attempts,
            worker: job.worker,
            waits_because: None,
            cancel_requested: job.cancel_requested,
            bytes: job.bytes,
            run_hash: job.run_hash,
            error: job.error,
            warnings: facts.warnings,
            result: summary.clone(),
            summary,
        }
    }
}

/// A page of runs, latest first.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct RunPage {
    items: Vec<Run>,
    /// `cursor` of the next page; absent on the last one.
    next: Option<String>,
}

/// Runs, latest first.
#[utoipa::path(get, path = "/api/v1/runs", tag = "runs", operation_id = "list_runs", params(ListQuery), responses(
    (status = 200, description = "one page of the list", body = RunPage),
    (status = 400, description = "invalid filter", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn list(
    app: Shared,
    caller: Caller,
    query: Result<Query<ListQuery>, QueryRejection>,
) -> Result<Json<RunPage>, Problem> {
    let (jobs, next) = jobs::page(&app, &caller, KIND, query).await?;
    Ok(Json(RunPage {
        items: jobs.into_iter().map(Run::from).collect(),
        next,
    }))
}

/// The run of this id.
pub(super) async fn find(app: &App, caller: &Caller, id: Result<Path<String>, PathRejection>) -> Result<Job, Problem> {
    jobs::find(app, caller, KIND, id).await
}

/// A run with its summary.
#[utoipa::path(get, path = "/api/v1/runs/{id}", tag = "runs", operation_id = "get_run", params(("id" = String, Path)), responses(
    (status = 200, description = "the run", body = Run),
    (status = 400, description = "invalid id", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "run not found", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn get(
    app: Shared,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
) -> Result<Json<Run>, Problem> {
    let run = find(&app, &caller, id).await?;
    let waits_because = super::autopilots::waits_because(&app, &caller, &run).await?;
    Ok(Json(Run {
        waits_because,
        ..run.into()
    }))
}

/// Deletes a run that has ended, with its files.
#[utoipa::path(delete, path = "/api/v1/runs/{id}", tag = "runs", operation_id = "delete_run", params(("id" = String, Path)), responses(
    (status = 204, description = "deleted"),
    (status = 400, description = "invalid id", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "run not found", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "the job has not ended, or a queued or running job needs its files", body = Problem, content_type = "application/problem+json"),
    (status = 507, description = "disk full", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn delete(
    app: Shared,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
) -> Result<StatusCode, Problem> {
    let run = find(&app, &caller, id).await?;
    jobs::delete(&app, &run).await
}

/// Cancels a run: a queued one at once, a running one within about a second. The part flown so far is kept.
#[utoipa::path(post, path = "/api/v1/runs/{id}/cancel", tag = "runs", operation_id = "cancel_run", params(("id" = String, Path)), responses(
    (status = 202, description = "the job is being stopped", body = Run),
    (status = 400, description = "invalid id", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "run not found", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "the job has already ended", body = Problem, content_type = "application/problem+json"),
    (status = 507, description = "disk full", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn cancel(
    app: Shared,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
) -> Result<(StatusCode, Json<Run>), Problem> {
    let run = find(&app, &caller, id).await?;
    Ok((StatusCode::ACCEPTED, Json(jobs::cancel(&app, &run).await?.into())))
}

pub(super) fn flight_of(run: &Job) -> Result<Flight, Problem> {
    match StoredJob::parse(&run.new.spec) {
        Ok(StoredJob {
            job: rotortwin_jobs::Job::Run(flight),
            ..
        }) => Ok(flight),
        Ok(_) => Err(Problem::unprocessable("the run is no flight")),
        Err(error) => Err(Problem::unprocessable(format!(
            "this version cannot read a job that another version accepted: {error}"
        ))),
    }
}

/// How external peers join a run: endpoint, run id, message version, time-outs. Available once the plant is waiting (event `join`).
/// Requires the scope `write`: anyone with a ticket can fly the run.
#[utoipa::path(get, path = "/api/v1/runs/{id}/ticket", tag = "runs", operation_id = "get_run_ticket", params(("id" = String, Path)), responses(
    (status = 200, description = "how the peers join", body = Tickets),
    (status = 400, description = "invalid id", body = Problem, content_type = "application/problem+json"),
    (status = 403, description = "the token does not allow this", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "run not found", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "the run is not waiting for a peer, or not yet", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn ticket(
    app: Shared,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
) -> Result<Json<Tickets>, Problem> {
    caller.must_write("whoever has a ticket can fly the run")?;
    let run = find(&app, &caller, id).await?;
    let facts: Facts = serde_json::from_str(&run.new.facts).unwrap_or_default();
    if matches!(facts.controller, Controller::Beside | Controller::Autopilot(_)) && facts.fdi == Place::Beside {
        return Err(Problem::conflict(
            "all parts of this run are started by the server; submit it with `controller` or `fdi` = `external`",
        ));
    }
    let text = run.ticket.ok_or_else(|| {
        Problem::conflict(format!(
            "the run is {}, and its plant is not waiting for a peer; retry after the event `join`",
            run.status.as_str()
        ))
    })?;
    serde_json::from_str(&text)
        .map(Json)
        .map_err(|error| Problem::internal(&error))
}
