//! Runs: submit, list, get, cancel, delete, fork, verify, join.

use super::jobs::{self, ListQuery, Shared, Terms};
use crate::App;
use crate::access::Caller;
use crate::clock::now_ms;
use crate::jobs::spec::{Flight, Link, Pace, Place, Spec, join_timeout};
use crate::jobs::{Job, JobKind, NewJob, Status};
use crate::problem::Problem;
use axum::Json;
use axum::extract::rejection::{JsonRejection, PathRejection, QueryRejection};
use axum::extract::{Path, Query};
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use rotortwin_plant::classifier::Classifier;
use rotortwin_plant::{Documents, Scenario};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

const KIND: JobKind = JobKind::Run;
/// Peers from outside are waited for at most this long, ms.
const LONGEST_JOIN_MS: u64 = 3_600_000;

/// A flight to be flown.
#[derive(Debug, Deserialize, Serialize, ToSchema)]
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
    /// Id of a classifier that was trained here: the network of the FDI engine, instead of the scenario's.
    #[serde(default)]
    classifier: Option<String>,
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
    /// Who flies: ours beside the plant, ours on a worker that offers it, or somebody else's that joins with the run's ticket.
    #[serde(default)]
    controller: Place,
    /// Who detects: as for the controller.
    #[serde(default)]
    fdi: Place,
    /// Parts that are not beside the plant are waited for this long, ms.
    #[serde(default = "join_timeout")]
    #[schema(minimum = 1, maximum = 3_600_000)]
    join_timeout_ms: u64,
    /// It fails when an attempt takes longer, s of wall time; by default 6 h.
    #[serde(default)]
    #[schema(minimum = 1, maximum = 86_400)]
    max_wall_s: Option<u64>,
    /// It is refused when the flight would take longer, s of simulated time.
    #[serde(default)]
    max_sim_s: Option<f64>,
}

/// What lists show of a run.
#[derive(Debug, Default, Serialize, Deserialize)]
struct Facts {
    vehicle: String,
    seed: String,
    link: Link,
    pace: Pace,
    #[serde(default)]
    controller: Place,
    #[serde(default)]
    fdi: Place,
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
    /// On whose account.
    tenant: String,
    /// How it stands.
    status: Status,
    /// Of all noise.
    seed: u64,
    /// How the processes are connected.
    link: Link,
    /// How fast.
    pace: Pace,
    /// Who flies.
    controller: Place,
    /// Who detects.
    fdi: Place,
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
    /// Who has or had it.
    worker: Option<String>,
    /// Somebody wants it stopped.
    cancel_requested: bool,
    /// Bytes of its files.
    bytes: i64,
    /// Over all samples: equal for equal scenario, seed and program, whatever the link.
    run_hash: Option<String>,
    /// Why it failed, one sentence.
    error: Option<String>,
    /// What it was, what the detectors said: `summary.json`. Not in lists.
    #[schema(value_type = Option<Object>)]
    summary: Option<serde_json::Value>,
}

impl From<Job> for Run {
    fn from(job: Job) -> Self {
        let facts: Facts = serde_json::from_str(&job.new.facts).unwrap_or_default();
        Self {
            id: job.id,
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
            cancel_requested: job.cancel_requested,
            bytes: job.bytes,
            run_hash: job.run_hash,
            error: job.error,
            summary: job.result.and_then(|text| serde_json::from_str(&text).ok()),
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

async fn with_classifier(app: &App, caller: &Caller, scenario: &Scenario, id: &str) -> Result<Scenario, Problem> {
    let job = super::tasks::done(app, caller, JobKind::Classifier, id).await?;
    let name = super::classifiers::FILE;
    let file = app
        .artifacts
        .file(job.folder.as_deref().unwrap_or_default(), name)
        .await
        .map_err(|error| Problem::internal(&error))?
        .ok_or_else(|| Problem::not_found(format!("the file of classifier {id} is gone")))?;
    let classifier = Classifier::read(&file).map_err(|error| app.library.refusal(&error))?;
    let mut documents = scenario.documents().clone();
    documents.scenario.fdi.network = Some(name.to_owned());
    documents.classifier = Some(classifier);
    Scenario::from_documents(&documents).map_err(|error| Problem::unprocessable(error.to_string()))
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
    app: Shared,
    caller: Caller,
    headers: HeaderMap,
    body: Result<Json<Submission>, JsonRejection>,
) -> Result<Response, Problem> {
    let Json(body) = body?;
    let scenario = submitted_scenario(&app, &body)?;
    let scenario = match &body.classifier {
        None => scenario,
        Some(id) => with_classifier(&app, &caller, &scenario, id).await?,
    };
    accept(
        &app,
        &caller,
        &headers,
        jobs::request_hash(&body),
        body,
        &scenario,
        None,
    )
    .await
}

async fn accept(
    app: &App,
    caller: &Caller,
    headers: &HeaderMap,
    request_hash: String,
    body: Submission,
    scenario: &Scenario,
    parent: Option<String>,
) -> Result<Response, Problem> {
    let terms = Terms {
        priority: body.priority,
        max_wall_s: body.max_wall_s,
    };
    let wall_limit_ms = terms.check()?;
    check_places(&body)?;
    let documents = scenario.documents();
    let duration = documents.scenario.duration_s;
    let longest = app.config.longest_flight_s;
    if duration > longest {
        return Err(Problem::unprocessable(format!(
            "the flight takes {duration} s of simulated time; this server flies at most {longest} s (`--longest-flight`)"
        )));
    }
    if let Some(most) = body.max_sim_s.filter(|most| duration > *most) {
        return Err(Problem::unprocessable(format!(
            "the flight takes {duration} s of simulated time; expected at most `max_sim_s` = {most}"
        )));
    }
    let seed = body.seed.unwrap_or_else(|| scenario.seed());
    rotortwin_plant::Simulation::new(scenario, seed).map_err(|error| Problem::unprocessable(error.to_string()))?;
    let spec = Flight {
        documents: documents.to_toml(),
        seed: seed.to_string(),
        link: body.link,
        pace: body.pace,
        controller: body.controller,
        fdi: body.fdi,
        join_timeout_ms: body.join_timeout_ms,
    };
    let facts = Facts {
        vehicle: documents.vehicle.name.clone(),
        seed: seed.to_string(),
        link: body.link,
        pace: body.pace,
        controller: body.controller,
        fdi: body.fdi,
    };
    let new = NewJob {
        kind: KIND,
        name: scenario.name().to_owned(),
        tenant: caller.tenant.clone(),
        priority: body.priority,
        spec: json(&Spec::Flight(spec))?,
        facts: json(&facts)?,
        parent,
        idempotency_key: jobs::idempotency_key(headers)?,
        request_hash,
        wall_limit_ms,
        parts: Vec::new(),
    };
    jobs::accept(app, new, Run::from).await
}

fn json(value: &impl Serialize) -> Result<String, Problem> {
    serde_json::to_string(value).map_err(|error| Problem::internal(&error))
}

/// Parts elsewhere are reached over zenoh only.
fn check_places(body: &Submission) -> Result<(), Problem> {
    if !(1..=LONGEST_JOIN_MS).contains(&body.join_timeout_ms) {
        return Err(Problem::unprocessable(format!(
            "`join_timeout_ms` is {}; expected 1 to {LONGEST_JOIN_MS}",
            body.join_timeout_ms
        )));
    }
    for (name, place) in [("controller", body.controller), ("fdi", body.fdi)] {
        if place != Place::Beside && body.link != Link::Zenoh {
            return Err(Problem::unprocessable(format!(
                "`{name}` is not beside the plant, and `link` is {}; expected `link: zenoh`",
                body.link.as_str()
            )));
        }
    }
    Ok(())
}

/// Runs, latest first.
#[utoipa::path(get, path = "/api/v1/runs", tag = "runs", params(ListQuery), responses(
    (status = 200, description = "a page", body = RunPage),
    (status = 400, description = "a filter that is none", body = Problem, content_type = "application/problem+json")
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
#[utoipa::path(get, path = "/api/v1/runs/{id}", tag = "runs", params(("id" = String, Path)), responses(
    (status = 200, description = "the run", body = Run),
    (status = 400, description = "no id", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "no such run", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn get(
    app: Shared,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
) -> Result<Json<Run>, Problem> {
    Ok(Json(find(&app, &caller, id).await?.into()))
}

/// Deletes a run that has ended, with its files.
#[utoipa::path(delete, path = "/api/v1/runs/{id}", tag = "runs", params(("id" = String, Path)), responses(
    (status = 204, description = "deleted"),
    (status = 400, description = "no id", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "no such run", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "it has not ended", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn delete(
    app: Shared,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
) -> Result<StatusCode, Problem> {
    let run = find(&app, &caller, id).await?;
    jobs::delete(&app, &run).await
}

/// Stops a run: a queued one at once, a running one within about a second. What it has flown is kept.
#[utoipa::path(post, path = "/api/v1/runs/{id}/cancel", tag = "runs", params(("id" = String, Path)), responses(
    (status = 202, description = "it ends", body = Run),
    (status = 400, description = "no id", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "no such run", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "it has ended already", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn cancel(
    app: Shared,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
) -> Result<(StatusCode, Json<Run>), Problem> {
    let run = find(&app, &caller, id).await?;
    Ok((StatusCode::ACCEPTED, Json(jobs::cancel(&app, &run).await?.into())))
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
    app: Shared,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
    headers: HeaderMap,
    body: Result<Json<Fork>, JsonRejection>,
) -> Result<Response, Problem> {
    let run = find(&app, &caller, id).await?;
    let Json(body) = body?;
    let spec = flight_of(&run)?;
    let mut documents = recorded(&spec)?.documents().clone();
    if body.healthy {
        documents.scenario.fault.clear();
        documents.scenario.sensor_fault.clear();
    }
    let scenario = Scenario::from_documents(&documents).map_err(|error| Problem::unprocessable(error.to_string()))?;
    let submission = Submission {
        scenario: None,
        text: None,
        set: Vec::new(),
        documents: None,
        classifier: None,
        seed: Some(match body.seed {
            Some(seed) => seed,
            None => spec.seed.parse().map_err(|error| Problem::internal(&error))?,
        }),
        link: spec.link,
        pace: spec.pace,
        priority: body.priority,
        controller: spec.controller,
        fdi: spec.fdi,
        join_timeout_ms: spec.join_timeout_ms,
        max_wall_s: u64::try_from(run.new.wall_limit_ms / 1000).ok(),
        max_sim_s: None,
    };
    let hash = jobs::request_hash(&(&run.id, &body));
    accept(&app, &caller, &headers, hash, submission, &scenario, Some(run.id)).await
}

pub(super) fn flight_of(run: &Job) -> Result<Flight, Problem> {
    match serde_json::from_str(&run.new.spec) {
        Ok(Spec::Flight(flight)) => Ok(flight),
        Ok(Spec::Task(_)) => Err(Problem::unprocessable("the run is no flight")),
        Err(error) => Err(Problem::unprocessable(format!(
            "this version cannot read what another one accepted: {error}"
        ))),
    }
}

fn recorded(flight: &Flight) -> Result<Scenario, Problem> {
    Documents::from_toml("the recorded scenario", &flight.documents)
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
    app: Shared,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
) -> Result<Json<Verification>, Problem> {
    let run = find(&app, &caller, id).await?;
    let (Some(recorded_hash), Some(folder), Status::Done) = (run.run_hash.clone(), &run.folder, run.status) else {
        return Err(Problem::conflict(format!(
            "the run is {}; only a run that was done can be flown again and compared",
            run.status.as_str()
        )));
    };
    // The whole folder: `replay` reads the documents in the summary.
    let summary = app
        .artifacts
        .file(folder, "summary.json")
        .await
        .map_err(|error| Problem::internal(&error))?
        .ok_or_else(|| Problem::not_found(format!("the files of run {} are gone", run.id)))?;
    let start = now_ms();
    let output = tokio::process::Command::new(&app.config.work.program)
        .args(["replay", "--json"])
        .arg(summary.parent().unwrap_or(&summary))
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

/// How one part of a run joins it from elsewhere.
#[derive(Debug, Serialize, Deserialize, ToSchema)]
pub(crate) struct Ticket {
    /// `controller` or `fdi`.
    role: String,
    /// Where the plant is met: `zenoh:connect=tcp/HOST:PORT`.
    link: String,
    /// 16 hex digits; part of all topics of the run.
    run_id: String,
    /// Version of the messages of `proto/` that the plant speaks.
    messages: u32,
    /// The plant waits this long for all parts to join, ms from the event `join`.
    join_timeout_ms: u64,
    /// The plant waits this long for the answer of a part that lives, ms.
    step_timeout_ms: u64,
    /// What starts our own part there.
    command: String,
}

/// The tickets of a run.
#[derive(Debug, Serialize, Deserialize, ToSchema)]
pub(crate) struct Tickets {
    peers: Vec<Ticket>,
}

/// How parts from elsewhere join a run: endpoint, run id, message version, time-outs. There once the plant waits (event `join`).
#[utoipa::path(get, path = "/api/v1/runs/{id}/ticket", tag = "runs", operation_id = "ticket", params(("id" = String, Path)), responses(
    (status = 200, description = "how they join", body = Tickets),
    (status = 400, description = "no id", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "no such run", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "nobody is waited for, or not yet", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn ticket(
    app: Shared,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
) -> Result<Json<Tickets>, Problem> {
    let run = find(&app, &caller, id).await?;
    let facts: Facts = serde_json::from_str(&run.new.facts).unwrap_or_default();
    if facts.controller == Place::Beside && facts.fdi == Place::Beside {
        return Err(Problem::conflict(
            "all parts of this run are started beside its plant; submit it with `controller` or `fdi` = `external`",
        ));
    }
    let text = run.ticket.ok_or_else(|| {
        Problem::conflict(format!(
            "the run is {}, and its plant does not wait for anybody; ask again after the event `join`",
            run.status.as_str()
        ))
    })?;
    serde_json::from_str(&text)
        .map(Json)
        .map_err(|error| Problem::internal(&error))
}
