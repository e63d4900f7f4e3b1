//! Submission of runs: from scratch, or as a fork of an existing one.

use super::asked;
use super::jobs::{self, Shared, Terms};
use super::runs::{Facts, Run, flight_of};
use crate::App;
use crate::access::Caller;
use crate::jobs::NewJob;
use crate::json_object::JsonObject;
use crate::library::Library;
use crate::problem::Problem;
use axum::extract::Path;
use axum::extract::rejection::PathRejection;
use axum::http::HeaderMap;
use axum::response::Response;
use rotortwin_jobs::flight::{Controller, Flight, Link};
use rotortwin_jobs::submission::RunSubmission;
use rotortwin_jobs::{JobKind, StoredJob};
use rotortwin_scenario::classifier::Classifier;
use rotortwin_scenario::{Documents, Scenario};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// The scenario that a request means.
pub(crate) fn find_scenario(
    library: &Library,
    name: Option<&str>,
    text: Option<&str>,
    set: &[String],
) -> Result<Scenario, Problem> {
    match (name, text) {
        (Some(name), None) => library.scenario(name, set),
        (None, Some(_)) if !set.is_empty() => Err(Problem::unprocessable(
            "`set` applies to a named `scenario`; a `text` is complete by itself",
        )),
        (None, Some(text)) => library.parse(text),
        _ => Err(Problem::unprocessable(
            "expected either `scenario`, the name of one of the server's scenarios, or `text`, a scenario document",
        )),
    }
}

fn submitted_scenario(library: &Library, body: &RunSubmission) -> Result<Scenario, Problem> {
    match &body.documents {
        None => find_scenario(library, body.scenario.as_deref(), body.text.as_deref(), &body.set),
        Some(_) if body.scenario.is_some() || body.text.is_some() || !body.set.is_empty() => {
            Err(Problem::unprocessable(
                "`documents` are complete by themselves; expected them without `scenario`, `text` and `set`",
            ))
        }
        Some(text) => Documents::from_toml("`documents`", text)
            .and_then(|documents| Scenario::from_documents(&documents))
            .map_err(|error| Problem::unprocessable(error.to_string())),
    }
}

/// The scenario with the requested models, and what the detectors' model cannot contain.
async fn with_models(
    app: &App,
    caller: &Caller,
    mut scenario: Scenario,
    body: &RunSubmission,
) -> Result<(Scenario, Vec<String>), Problem> {
    let mut notes = Vec::new();
    if let Some(choice) = &body.model {
        let version = asked::version(app, caller, choice).await?;
        let flown = app.readers.read(|| version.flown_in(&scenario)).await;
        scenario = flown.map_err(|error| Problem::unprocessable(format!("with `model`: {error}")))?;
    }
    if let Some(choice) = &body.fdi_model {
        let refused = |refusal: rotortwin_plant::error::Refusal| {
            Problem::unprocessable(format!("`fdi_model`, key `{}`: {}", refusal.key, refusal.reason))
        };
        let version = asked::version(app, caller, choice).await?;
        let vehicle = app.readers.read(|| version.for_detectors()).await.map_err(refused)?;
        if !vehicle.not_carried.is_empty() {
            notes.push(format!(
                "the detectors have no parameter for {}: ignored by the detectors",
                vehicle.not_carried.join(", ")
            ));
        }
        let judged = app.readers.read(|| scenario.with_fdi_vehicle(vehicle.documents)).await;
        scenario = judged.map_err(refused)?;
    }
    Ok((scenario, notes))
}

async fn with_classifier(app: &App, caller: &Caller, scenario: &Scenario, id: &str) -> Result<Scenario, Problem> {
    let file = super::tasks::trained(app, caller, id).await?;
    let classifier = Classifier::read(&file).map_err(|error| app.shelf.refusal(&error))?;
    let mut documents = scenario.documents().clone();
    documents.scenario.fdi.network = Some(super::tasks::CLASSIFIER.to_owned());
    documents.classifier = Some(classifier);
    let checked = app.readers.read(|| Scenario::from_documents(&documents)).await;
    checked.map_err(|error| Problem::unprocessable(error.to_string()))
}

/// Submits a flight.
#[utoipa::path(post, path = "/api/v1/runs", tag = "runs", operation_id = "submit_run", request_body = RunSubmission,
    params(("Idempotency-Key" = Option<String>, Header, description = "a retry with the same key and body returns the existing run")),
    responses(
        (status = 202, description = "accepted and stored; the job will end as done, failed or canceled", body = Run,
         headers(("Location" = String, description = "URL of the run"))),
        (status = 200, description = "already accepted under this Idempotency-Key", body = Run),
        (status = 400, description = "malformed request", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "scenario not found", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "this Idempotency-Key was used with a different body", body = Problem, content_type = "application/problem+json"),
        (status = 413, description = "request body too large", body = Problem, content_type = "application/problem+json"),
        (status = 415, description = "the body is not JSON", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "the scenario cannot be flown", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "the server is shutting down", body = Problem, content_type = "application/problem+json"),
        (status = 507, description = "disk full", body = Problem, content_type = "application/problem+json")
    ))]
pub(crate) async fn submit(
    app: Shared,
    caller: Caller,
    headers: HeaderMap,
    body: Result<JsonObject<RunSubmission>, Problem>,
) -> Result<Response, Problem> {
    let JsonObject(body) = body?;
    let hash = jobs::request_hash(&body);
    if let Some(answer) = jobs::before(&app, &caller, JobKind::Run, &headers, &hash, Run::from).await? {
        return Ok(answer);
    }
    let library = app.library(&caller).await?;
    let scenario = app.readers.read(|| submitted_scenario(&library, &body)).await?;
    let (scenario, notes) = with_models(&app, &caller, scenario, &body).await?;
    let scenario = match &body.classifier {
        None => scenario,
        Some(id) => with_classifier(&app, &caller, &scenario, id).await?,
    };
    accept(&app, &caller, &headers, hash, body, &scenario, notes, None).await
}

#[expect(
    clippy::too_many_arguments,
    reason = "all that is known of a run when it is accepted"
)]
async fn accept(
    app: &App,
    caller: &Caller,
    headers: &HeaderMap,
    request_hash: String,
    body: RunSubmission,
    scenario: &Scenario,
    notes: Vec<String>,
    parent: Option<String>,
) -> Result<Response, Problem> {
    let terms = Terms {
        priority: body.priority,
        max_wall_s: body.max_wall_s,
    };
    let wall_limit_ms = terms.check()?;
    body.check_places().map_err(Problem::unprocessable)?;
    let link = match &body.controller {
        Controller::Autopilot(name) => {
            let how = (body.link, body.fdi, body.pace);
            super::autopilots::check(app, name, scenario, body.seed, how).await?;
            Link::InProcess
        }
        _ => body.link,
    };
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
    let written = app
        .readers
        .read(|| scenario.simulation(seed).map(|_| documents.to_toml()));
    let spec = Flight {
        documents: written
            .await
            .map_err(|error| Problem::unprocessable(error.to_string()))?,
        seed: seed.to_string(),
        link,
        pace: body.pace,
        controller: body.controller.clone(),
        fdi: body.fdi,
        join_timeout_ms: body.join_timeout_ms,
    };
    let facts = Facts {
        vehicle: documents.vehicle.name.clone(),
        seed: seed.to_string(),
        link,
        pace: body.pace,
        controller: body.controller.clone(),
        fdi: body.fdi,
        warnings: scenario.warnings().into_iter().chain(notes).collect(),
    };
    let new = NewJob {
        kind: JobKind::Run,
        name: scenario.name().to_owned(),
        tenant: caller.tenant.clone(),
        priority: body.priority,
        spec: StoredJob::alone(rotortwin_jobs::Job::Run(spec))
            .to_json()
            .map_err(|error| Problem::internal(&error))?,
        facts: json(&facts)?,
        parent,
        idempotency_key: jobs::idempotency_key(headers)?,
        request_hash,
        wall_limit_ms,
        autopilot: body.controller.autopilot().map(str::to_owned),
        needs: Vec::new(),
        upload_bytes: 0,
        parts: Vec::new(),
    };
    jobs::accept(app, new, Run::from).await
}

fn json(value: &impl Serialize) -> Result<String, Problem> {
    serde_json::to_string(value).map_err(|error| Problem::internal(&error))
}

/// Changes for a fork.
#[derive(Debug, Default, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct Fork {
    /// No propeller is damaged and no sensor fails.
    #[serde(default)]
    healthy: bool,
    /// Seed of all noise; default: that of the run.
    #[serde(default)]
    seed: Option<u64>,
    /// From −100 to 100; larger values run first.
    #[serde(default)]
    #[schema(minimum = -100, maximum = 100)]
    priority: i64,
}

/// Submits the same flight with changed settings.
#[utoipa::path(post, path = "/api/v1/runs/{id}/fork", tag = "runs", operation_id = "fork_run", request_body = Fork,
    params(("id" = String, Path), ("Idempotency-Key" = Option<String>, Header)), responses(
    (status = 202, description = "accepted", body = Run),
    (status = 200, description = "already accepted under this Idempotency-Key", body = Run),
    (status = 400, description = "malformed request", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "run not found", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "this Idempotency-Key was used with a different body", body = Problem, content_type = "application/problem+json"),
    (status = 413, description = "request body too large", body = Problem, content_type = "application/problem+json"),
    (status = 415, description = "the body is not JSON", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "the scenario cannot be flown", body = Problem, content_type = "application/problem+json"),
    (status = 503, description = "the server is shutting down", body = Problem, content_type = "application/problem+json"),
    (status = 507, description = "disk full", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn fork(
    app: Shared,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
    headers: HeaderMap,
    body: Result<JsonObject<Fork>, Problem>,
) -> Result<Response, Problem> {
    let Path(id) = id?;
    let JsonObject(body) = body?;
    let hash = jobs::request_hash(&(&id, &body));
    if let Some(answer) = jobs::before(&app, &caller, JobKind::Run, &headers, &hash, Run::from).await? {
        return Ok(answer);
    }
    let run = super::runs::find(&app, &caller, Ok(Path(id))).await?;
    let spec = flight_of(&run)?;
    let changed = || {
        let mut documents = recorded(&spec)?.documents().clone();
        if body.healthy {
            documents.scenario.fault.clear();
            documents.scenario.sensor_fault.clear();
        }
        Scenario::from_documents(&documents).map_err(|error| Problem::unprocessable(error.to_string()))
    };
    let scenario = app.readers.read(changed).await?;
    let submission = RunSubmission {
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
        ..RunSubmission::default()
    };
    accept(
        &app,
        &caller,
        &headers,
        hash,
        submission,
        &scenario,
        Vec::new(),
        Some(run.id),
    )
    .await
}

/// Submits a flight that another job has flown, in one process and as fast as possible.
///
/// # Errors
/// 409, 422, 429, 503, 507.
pub(super) async fn again(
    app: &App,
    caller: &Caller,
    headers: &HeaderMap,
    request_hash: String,
    scenario: &Scenario,
    seed: u64,
    parent: String,
) -> Result<Response, Problem> {
    let submission = RunSubmission {
        seed: Some(seed),
        link: Link::InProcess,
        ..RunSubmission::default()
    };
    accept(
        app,
        caller,
        headers,
        request_hash,
        submission,
        scenario,
        Vec::new(),
        Some(parent),
    )
    .await
}

/// The scenario of a run that was accepted.
///
/// # Errors
/// 422: by another version.
pub(super) fn recorded(flight: &Flight) -> Result<Scenario, Problem> {
    Documents::from_toml("the recorded scenario", &flight.documents)
        .and_then(|documents| Scenario::from_documents(&documents))
        .map_err(|error| {
            Problem::unprocessable(format!(
                "this version cannot fly a run that another version accepted: {error}"
            ))
        })
}
