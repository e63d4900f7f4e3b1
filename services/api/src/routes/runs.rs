//! Runs: submit, list, get, cancel, delete, fork, verify.

use crate::App;
use crate::clock::now_ms;
use crate::problem::Problem;
use crate::store::{NewRun, RunRow, RunStatus, Submitted};
use axum::Json;
use axum::extract::rejection::{JsonRejection, PathRejection, QueryRejection};
use axum::extract::{Path, Query, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use rotortwin_plant::{Documents, Scenario};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use utoipa::{IntoParams, ToSchema};

/// A page has this many runs at most.
const LARGEST_PAGE: i64 = 1000;
/// The API key of a submission is not longer.
const LONGEST_KEY: usize = 200;

/// A flight to be flown.
#[derive(Debug, Default, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct Submission {
    /// Name of one of the server's scenarios; or give `text`.
    #[serde(default)]
    scenario: Option<String>,
    /// A scenario document (TOML), as it would stand in the library's `scenarios`.
    #[serde(default)]
    text: Option<String>,
    /// All documents of a flight (TOML), as the summary of a run holds them: nothing is looked up in the library.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    documents: Option<String>,
    /// Keys to set on the named scenario: `key=value`, such as `initial.state_of_charge=0.4`.
    #[serde(default)]
    set: Vec<String>,
    /// Seed of all noise; by default the scenario's.
    #[serde(default)]
    seed: Option<u64>,
    /// How plant, controller and FDI engine are connected.
    #[serde(default)]
    link: Link,
    /// As fast as possible, or 400 steps per second of wall clock.
    #[serde(default)]
    pace: Pace,
    /// From −100 to 100; larger goes first.
    #[serde(default)]
    #[schema(minimum = -100, maximum = 100)]
    priority: i64,
}

#[derive(Debug, Default, Clone, Copy, Deserialize, Serialize, ToSchema)]
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
    fn as_str(self) -> &'static str {
        match self {
            Self::InProcess => "in-process",
            Self::Iceoryx2 => "iceoryx2",
            Self::Zenoh => "zenoh",
        }
    }
}

#[derive(Debug, Default, Clone, Copy, Deserialize, Serialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Pace {
    /// As fast as possible.
    #[default]
    Fast,
    /// 400 steps per second of wall clock.
    RealTime,
}

impl Pace {
    fn as_str(self) -> &'static str {
        match self {
            Self::Fast => "fast",
            Self::RealTime => "real-time",
        }
    }
}

/// A run.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Run {
    /// Later runs have larger ids.
    id: String,
    /// Of the scenario.
    name: String,
    /// Of the vehicle.
    vehicle: String,
    /// How it stands.
    status: RunStatus,
    /// Of all noise.
    seed: u64,
    /// How the processes are connected.
    link: String,
    /// `fast` or `real-time`.
    pace: String,
    /// Larger goes first.
    priority: i64,
    /// The run that it was forked from.
    parent: Option<String>,
    /// ms since 1970, UTC.
    submitted_ms: i64,
    /// ms since 1970, UTC.
    started_ms: Option<i64>,
    /// ms since 1970, UTC.
    finished_ms: Option<i64>,
    /// How often it was begun.
    attempts: i64,
    /// Somebody wants it stopped.
    cancel_requested: bool,
    /// Over all samples: equal for equal scenario, seed and program, whatever the link.
    run_hash: Option<String>,
    /// Why it failed, one sentence.
    error: Option<String>,
    /// What it was, what the detectors said: `summary.json`. Not in lists.
    #[schema(value_type = Option<Object>)]
    summary: Option<serde_json::Value>,
}

impl Run {
    fn of(row: RunRow, whole: bool) -> Self {
        let summary = row
            .summary
            .filter(|_| whole)
            .and_then(|text| serde_json::from_str(&text).ok());
        Self {
            id: row.id,
            name: row.name,
            vehicle: row.vehicle,
            status: row.status,
            seed: row.seed,
            link: row.link,
            pace: row.pace,
            priority: row.priority,
            parent: row.parent,
            submitted_ms: row.submitted_ms,
            started_ms: row.started_ms,
            finished_ms: row.finished_ms,
            attempts: row.attempts,
            cancel_requested: row.cancel_requested,
            run_hash: row.run_hash,
            error: row.error,
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

/// Which runs.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(crate) struct Filter {
    /// Only runs in this state.
    status: Option<RunStatus>,
    /// Only runs of this scenario.
    name: Option<String>,
    /// `next` of the page before.
    cursor: Option<String>,
    /// Runs a page, 1 to 1000.
    #[param(minimum = 1, maximum = 1000, default = 50)]
    limit: Option<i64>,
}

/// The scenario that a request means.
pub(crate) fn find_scenario(
    app: &App,
    name: Option<&str>,
    text: Option<&str>,
    set: &[String],
) -> Result<Scenario, Problem> {
    match (name, text) {
        (Some(name), None) => app.library.scenario(name, set),
        (None, Some(_)) if !set.is_empty() => Err(Problem::unprocessable(
            "`set` belongs to a named `scenario`; a `text` says everything itself",
        )),
        (None, Some(text)) => app.library.parse(text),
        _ => Err(Problem::unprocessable(
            "expected either `scenario`, the name of one of the server's scenarios, or `text`, a scenario document",
        )),
    }
}

fn submitted_scenario(app: &App, body: &Submission) -> Result<Scenario, Problem> {
    match &body.documents {
        None => find_scenario(app, body.scenario.as_deref(), body.text.as_deref(), &body.set),
        Some(_) if body.scenario.is_some() || body.text.is_some() || !body.set.is_empty() => {
            Err(Problem::unprocessable(
                "`documents` say everything themselves; expected them without `scenario`, `text` and `set`",
            ))
        }
        Some(text) => Documents::from_toml("`documents`", text)
            .and_then(|documents| Scenario::from_documents(&documents))
            .map_err(|error| Problem::unprocessable(error.to_string())),
    }
}

/// Submits a flight.
#[utoipa::path(post, path = "/api/v1/runs", tag = "runs", request_body = Submission,
    params(("Idempotency-Key" = Option<String>, Header, description = "the same key and body again give the run that is there")),
    responses(
        (status = 202, description = "accepted: it is on disk, and will end as done, failed or canceled", body = Run,
         headers(("Location" = String, description = "address of the run"))),
        (status = 200, description = "accepted before under this key", body = Run),
        (status = 400, description = "unreadable", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "no such scenario", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "another body was submitted under this key", body = Problem, content_type = "application/problem+json"),
        (status = 413, description = "too large", body = Problem, content_type = "application/problem+json"),
        (status = 415, description = "not JSON", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "it cannot be flown", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "the server is ending", body = Problem, content_type = "application/problem+json"),
        (status = 507, description = "the disk is full", body = Problem, content_type = "application/problem+json")
    ))]
pub(crate) async fn submit(
    State(app): State<Arc<App>>,
    headers: HeaderMap,
    body: Result<Json<Submission>, JsonRejection>,
) -> Result<Response, Problem> {
    let Json(body) = body?;
    accept(&app, &headers, body, None).await
}

async fn accept(
    app: &Arc<App>,
    headers: &HeaderMap,
    body: Submission,
    parent: Option<(String, Scenario)>,
) -> Result<Response, Problem> {
    if *app.ending.borrow() {
        return Err(Problem::unavailable("the server is ending"));
    }
    if !(-100..=100).contains(&body.priority) {
        return Err(Problem::unprocessable(format!(
            "`priority` is {}; expected -100 to 100",
            body.priority
        )));
    }
    let idempotency_key = idempotency_key(headers)?;
    let canonical = serde_json::json!({ "body": body, "parent": parent.as_ref().map(|(id, _)| id) }).to_string();
    let (parent, scenario) = match parent {
        Some((id, scenario)) => (Some(id), scenario),
        None => (None, submitted_scenario(app, &body)?),
    };
    let seed = body.seed.unwrap_or_else(|| scenario.seed());
    rotortwin_plant::Simulation::new(&scenario, seed).map_err(|error| Problem::unprocessable(error.to_string()))?;
    let new = NewRun {
        name: scenario.name().to_owned(),
        vehicle: scenario.documents().vehicle.name.clone(),
        priority: body.priority,
        documents: scenario.documents().to_toml(),
        seed,
        link: body.link.as_str().to_owned(),
        pace: body.pace.as_str().to_owned(),
        parent,
        idempotency_key,
        request_hash: format!("{:032x}", xxhash_rust::xxh3::xxh3_128(canonical.as_bytes())),
    };
    match app.store.submit(new).await? {
        Submitted::New(row) => {
            app.hub.queue.notify_one();
            let location = format!("/api/v1/runs/{}", row.id);
            Ok((
                StatusCode::ACCEPTED,
                [(header::LOCATION, location)],
                Json(Run::of(row, true)),
            )
                .into_response())
        }
        Submitted::Before(row) => Ok((StatusCode::OK, Json(Run::of(row, true))).into_response()),
        Submitted::Other => Err(Problem::conflict(
            "another body was submitted under this Idempotency-Key; expected the same body, or a new key",
        )),
    }
}

fn idempotency_key(headers: &HeaderMap) -> Result<Option<String>, Problem> {
    let Some(value) = headers.get("idempotency-key") else {
        return Ok(None);
    };
    match value.to_str() {
        Ok(text) if (1..=LONGEST_KEY).contains(&text.len()) => Ok(Some(text.to_owned())),
        _ => Err(Problem::bad_request(format!(
            "Idempotency-Key: expected 1 to {LONGEST_KEY} printable ASCII characters"
        ))),
    }
}

/// Runs, latest first.
#[utoipa::path(get, path = "/api/v1/runs", tag = "runs", params(Filter), responses(
    (status = 200, description = "a page", body = RunPage),
    (status = 400, description = "a filter that is none", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn list(
    State(app): State<Arc<App>>,
    filter: Result<Query<Filter>, QueryRejection>,
) -> Result<Json<RunPage>, Problem> {
    let Query(filter) = filter?;
    let limit = filter.limit.unwrap_or(50);
    if !(1..=LARGEST_PAGE).contains(&limit) {
        return Err(Problem::bad_request(format!(
            "`limit` is {limit}; expected 1 to {LARGEST_PAGE}"
        )));
    }
    let mut rows = app
        .store
        .list(
            filter.status,
            filter.name.as_deref(),
            filter.cursor.as_deref(),
            limit + 1,
        )
        .await?;
    let more = rows.len() as i64 > limit;
    rows.truncate(usize::try_from(limit).unwrap_or(usize::MAX));
    let next = rows.last().filter(|_| more).map(|row| row.id.clone());
    Ok(Json(RunPage {
        items: rows.into_iter().map(|row| Run::of(row, false)).collect(),
        next,
    }))
}

/// The run of this id.
pub(crate) async fn find(app: &App, id: Result<Path<String>, PathRejection>) -> Result<RunRow, Problem> {
    let Path(id) = id?;
    app.store
        .get(&id)
        .await?
        .ok_or_else(|| Problem::not_found(format!("there is no run {id}")))
}

/// A run with its summary.
#[utoipa::path(get, path = "/api/v1/runs/{id}", tag = "runs", params(("id" = String, Path)), responses(
    (status = 200, description = "the run", body = Run),
    (status = 400, description = "no id", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "no such run", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn get(
    State(app): State<Arc<App>>,
    id: Result<Path<String>, PathRejection>,
) -> Result<Json<Run>, Problem> {
    Ok(Json(Run::of(find(&app, id).await?, true)))
}

/// Deletes a run that has ended, with its files.
#[utoipa::path(delete, path = "/api/v1/runs/{id}", tag = "runs", params(("id" = String, Path)), responses(
    (status = 204, description = "deleted"),
    (status = 400, description = "no id", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "no such run", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "it has not ended", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn delete(
    State(app): State<Arc<App>>,
    id: Result<Path<String>, PathRejection>,
) -> Result<StatusCode, Problem> {
    let run = find(&app, id).await?;
    if !app.store.delete(&run.id).await? {
        return Err(Problem::conflict(format!(
            "the run is {}; cancel it before it is deleted",
            run.status.as_str()
        )));
    }
    let folder = app.folder.path().join("runs").join(&run.id);
    match tokio::fs::remove_dir_all(&folder).await {
        Ok(()) => {}
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {}
        Err(error) => tracing::warn!(run = run.id, %error, "its files cannot be deleted"),
    }
    app.hub.wake(&run.id);
    Ok(StatusCode::NO_CONTENT)
}

/// Stops a run: a queued one at once, a running one within about a second. What it has flown is kept.
#[utoipa::path(post, path = "/api/v1/runs/{id}/cancel", tag = "runs", params(("id" = String, Path)), responses(
    (status = 202, description = "it ends", body = Run),
    (status = 400, description = "no id", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "no such run", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "it has ended already", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn cancel(
    State(app): State<Arc<App>>,
    id: Result<Path<String>, PathRejection>,
) -> Result<(StatusCode, Json<Run>), Problem> {
    let run = find(&app, id).await?;
    if run.status.is_final() {
        return Err(Problem::conflict(format!(
            "the run has ended already: {}",
            run.status.as_str()
        )));
    }
    let row = app
        .store
        .cancel(&run.id)
        .await?
        .ok_or_else(|| Problem::not_found(format!("there is no run {}", run.id)))?;
    app.hub.wake(&row.id);
    Ok((StatusCode::ACCEPTED, Json(Run::of(row, true))))
}

/// What is to be different in a fork.
#[derive(Debug, Default, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct Fork {
    /// No propeller is damaged, no sensor fails.
    #[serde(default)]
    healthy: bool,
    /// Seed of all noise; by default that of the run.
    #[serde(default)]
    seed: Option<u64>,
    /// From −100 to 100; larger goes first.
    #[serde(default)]
    #[schema(minimum = -100, maximum = 100)]
    priority: i64,
}

/// Submits the same flight again with a difference.
#[utoipa::path(post, path = "/api/v1/runs/{id}/fork", tag = "runs", request_body = Fork,
    params(("id" = String, Path), ("Idempotency-Key" = Option<String>, Header)), responses(
    (status = 202, description = "accepted", body = Run),
    (status = 200, description = "accepted before under this key", body = Run),
    (status = 400, description = "unreadable", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "no such run", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "another body was submitted under this key", body = Problem, content_type = "application/problem+json"),
    (status = 413, description = "too large", body = Problem, content_type = "application/problem+json"),
    (status = 415, description = "not JSON", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "it cannot be flown", body = Problem, content_type = "application/problem+json"),
    (status = 503, description = "the server is ending", body = Problem, content_type = "application/problem+json"),
    (status = 507, description = "the disk is full", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn fork(
    State(app): State<Arc<App>>,
    id: Result<Path<String>, PathRejection>,
    headers: HeaderMap,
    body: Result<Json<Fork>, JsonRejection>,
) -> Result<Response, Problem> {
    let run = find(&app, id).await?;
    let Json(body) = body?;
    let mut documents = recorded(&run)?.documents().clone();
    if body.healthy {
        documents.scenario.fault.clear();
        documents.scenario.sensor_fault.clear();
    }
    let scenario = Scenario::from_documents(&documents).map_err(|error| Problem::unprocessable(error.to_string()))?;
    let submission = Submission {
        // Of no meaning but for the comparison of bodies under one key.
        scenario: body.healthy.then(|| "healthy".to_owned()),
        seed: Some(body.seed.unwrap_or(run.seed)),
        link: serde_json::from_value(run.link.clone().into()).map_err(|error| Problem::internal(&error))?,
        pace: serde_json::from_value(run.pace.clone().into()).map_err(|error| Problem::internal(&error))?,
        priority: body.priority,
        ..Submission::default()
    };
    accept(&app, &headers, submission, Some((run.id, scenario))).await
}

fn recorded(run: &RunRow) -> Result<Scenario, Problem> {
    Documents::from_toml("the recorded scenario", &run.documents)
        .and_then(|documents| Scenario::from_documents(&documents))
        .map_err(|error| Problem::unprocessable(format!("this version cannot fly what another one accepted: {error}")))
}

/// What a second execution gave.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Verification {
    /// The hashes are equal.
    same: bool,
    /// Of the run.
    recorded: String,
    /// Of the second execution, in one process.
    again: String,
    /// How long it took, ms.
    wall_ms: i64,
}

/// Flies a run that was done again, in one process, and compares the run hash.
#[utoipa::path(post, path = "/api/v1/runs/{id}/verify", tag = "runs", params(("id" = String, Path)), responses(
    (status = 200, description = "compared", body = Verification),
    (status = 400, description = "no id", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "no such run", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "it was not done", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "this version cannot fly it", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn verify(
    State(app): State<Arc<App>>,
    id: Result<Path<String>, PathRejection>,
) -> Result<Json<Verification>, Problem> {
    let run = find(&app, id).await?;
    let (Some(recorded_hash), Some(folder), RunStatus::Done) = (run.run_hash.clone(), &run.folder, run.status) else {
        return Err(Problem::conflict(format!(
            "the run is {}; only a run that was done can be flown again and compared",
            run.status.as_str()
        )));
    };
    let start = now_ms();
    let output = tokio::process::Command::new(&app.config.program)
        .args(["replay", "--json"])
        .arg(app.folder.path().join(folder))
        .kill_on_drop(true)
        .output()
        .await
        .map_err(|error| Problem::internal(&error))?;
    let answer: serde_json::Value = serde_json::from_slice(&output.stdout).map_err(|error| {
        let words = String::from_utf8_lossy(&output.stderr);
        Problem::internal(&format!("replay gave no JSON ({error}): {words}"))
    })?;
    let again = answer["replayed"].as_str().unwrap_or_default().to_owned();
    if again != recorded_hash {
        tracing::error!(
            run = run.id,
            recorded = recorded_hash,
            again,
            "a second execution differs"
        );
    }
    Ok(Json(Verification {
        same: again == recorded_hash,
        recorded: recorded_hash,
        again,
        wall_ms: now_ms() - start,
    }))
}
