//! A model compared with flights: comparisons, diagnoses, improvements.

use super::asked::{Flights, ModelChoice};
use super::facts::{JobFacts, TwinFacts};
use super::jobs::{self, JobView, Shared, Terms};
use super::tasks::{Draft, FINAL_MODEL, OUT};
use crate::App;
use crate::access::Caller;
use crate::jobs::JobKind;
use crate::json_object::JsonObject;
use crate::problem::Problem;
use axum::http::HeaderMap;
use axum::response::Response;
use rotortwin_jobs::{Comparison, Diagnosis, Improvement, Input, StoredJob};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use utoipa::ToSchema;

super::collection!(
    comparisons,
    crate::jobs::JobKind::Comparison,
    ComparisonResult,
    "comparison",
    "/api/v1/comparisons",
    "/api/v1/comparisons/{id}",
    "/api/v1/comparisons/{id}/cancel",
    "/api/v1/comparisons/{id}/events",
    "/api/v1/comparisons/{id}/artifacts",
    "/api/v1/comparisons/{id}/artifacts/{*path}"
);
super::collection!(
    diagnoses,
    crate::jobs::JobKind::Diagnosis,
    DiagnosisResult,
    "diagnosis",
    "/api/v1/diagnoses",
    "/api/v1/diagnoses/{id}",
    "/api/v1/diagnoses/{id}/cancel",
    "/api/v1/diagnoses/{id}/events",
    "/api/v1/diagnoses/{id}/artifacts",
    "/api/v1/diagnoses/{id}/artifacts/{*path}"
);
super::collection!(
    improvements,
    crate::jobs::JobKind::Improvement,
    ImprovementResult,
    "improvement",
    "/api/v1/improvements",
    "/api/v1/improvements/{id}",
    "/api/v1/improvements/{id}/cancel",
    "/api/v1/improvements/{id}/events",
    "/api/v1/improvements/{id}/artifacts",
    "/api/v1/improvements/{id}/artifacts/{*path}"
);

/// Folder of the models, next to or below the files of the job.
const MODELS: &str = "models";
/// A comparison has at most this many models.
const MOST_MODELS: usize = 16;
/// A submission brings at most this many effects of its own.
const MOST_EFFECTS: usize = 32;

/// A model and the flights to compare it with.
#[derive(Debug, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct TwinSubmission {
    /// The model.
    model: ModelChoice,
    /// Comparison: more models, each compared with the same flights; they follow `model` in the result, in this
    /// order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    more_models: Vec<ModelChoice>,
    /// Flights, all of one vehicle.
    flights: Flights,
    /// Diagnosis: your own effects to consider as well (TOML).
    #[serde(default)]
    effects: Vec<String>,
    /// Diagnosis: names of the library's effect documents to consider as well.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    library_effects: Vec<String>,
    /// Improvement: held-out flights, not used in any fit.
    #[serde(default)]
    held_out: Option<Flights>,
    /// From −100 to 100; larger values run first.
    #[serde(default)]
    #[schema(minimum = -100, maximum = 100)]
    priority: i64,
    /// Time limit of an attempt, s of wall time; default 6 h.
    #[serde(default)]
    #[schema(minimum = 1, maximum = 86_400)]
    max_wall_s: Option<u64>,
}

macro_rules! submission {
    ($function:ident, $path:literal, $tag:literal, $operation:literal, $summary:literal, $kind:expr) => {
        #[doc = $summary]
        #[utoipa::path(post, path = $path, summary = $summary, tag = $tag, operation_id = $operation, request_body = TwinSubmission,
            params(("Idempotency-Key" = Option<String>, Header, description = "a retry with the same key and body returns the existing job")),
            responses(
                (status = 202, description = "accepted and stored; the job will end as done, failed or canceled", body = JobView,
                 headers(("Location" = String, description = "URL of the job"))),
                (status = 200, description = "already accepted under this Idempotency-Key", body = JobView),
                (status = 400, description = "malformed request", body = Problem, content_type = "application/problem+json"),
                (status = 404, description = "log, run, vehicle or improvement not found", body = Problem, content_type = "application/problem+json"),
                (status = 409, description = "this Idempotency-Key was used with a different body, or a flight is not done", body = Problem, content_type = "application/problem+json"),
                (status = 413, description = "request body too large", body = Problem, content_type = "application/problem+json"),
                (status = 415, description = "the body is not JSON", body = Problem, content_type = "application/problem+json"),
                (status = 422, description = "the job cannot be done with these inputs", body = Problem, content_type = "application/problem+json"),
                (status = 503, description = "the server is shutting down", body = Problem, content_type = "application/problem+json"),
                (status = 507, description = "disk full", body = Problem, content_type = "application/problem+json")
            ))]
        pub(crate) async fn $function(
            app: Shared,
            caller: Caller,
            headers: HeaderMap,
            body: Result<JsonObject<TwinSubmission>, Problem>,
        ) -> Result<Response, Problem> {
            let JsonObject(body) = body?;
            submit(&app, &caller, &headers, &body, $kind).await
        }
    };
}

submission!(
    compare,
    "/api/v1/comparisons",
    "comparisons",
    "submit_comparison",
    "Compares a model with flights: where, when and by how much they differ.",
    JobKind::Comparison
);
submission!(
    diagnose,
    "/api/v1/diagnoses",
    "diagnoses",
    "submit_diagnosis",
    "Names the physical effect that a model lacks on flights, with evidence.",
    JobKind::Diagnosis
);
submission!(
    improve,
    "/api/v1/improvements",
    "improvements",
    "submit_improvement",
    "Compares, diagnoses, adds what is missing, and compares again until the model agrees. `artifacts/model.toml` is the final version.",
    JobKind::Improvement
);

async fn submit(
    app: &App,
    caller: &Caller,
    headers: &HeaderMap,
    body: &TwinSubmission,
    kind: JobKind,
) -> Result<Response, Problem> {
    let hash = jobs::request_hash(body);
    if let Some(answer) = jobs::before(app, caller, kind, headers, &hash, JobView::from).await? {
        return Ok(answer);
    }
    check_belongings(body, kind)?;
    let (model, mut inputs, name) = body.model.lay_out(app, caller, 0).await?;
    let mut labels = vec![body.model.label()?.map_or_else(|| name.clone(), str::to_owned)];
    let mut models = vec![model.clone()];
    for (place, choice) in body.more_models.iter().enumerate() {
        let (model, more, name) = choice.lay_out(app, caller, place + 1).await?;
        labels.push(choice.label()?.map_or(name, str::to_owned));
        models.push(model);
        inputs.extend(more);
    }
    let (flights, logs) = body.flights.lay_out(app, caller).await?;
    inputs.extend(logs);
    let library = app.library(caller).await?;
    let named = body.library_effects.iter().map(|name| library.text("effects", name));
    let named = named.collect::<Result<Vec<String>, Problem>>()?;
    let mut effects: Vec<PathBuf> = Vec::new();
    for (number, effect) in body.effects.iter().chain(&named).enumerate() {
        let path = format!("effects/{number}.toml");
        effects.push(path.clone().into());
        inputs.push(Input::text(path, effect.clone()));
    }
    let out = PathBuf::from(OUT);
    let job = match kind {
        JobKind::Comparison => rotortwin_jobs::Job::Comparison(Comparison {
            logs: flights,
            model: models,
            label: labels,
            models: MODELS.into(),
            out: Some(out),
        }),
        JobKind::Diagnosis => rotortwin_jobs::Job::Diagnosis(Diagnosis {
            logs: flights,
            model,
            models: MODELS.into(),
            effects,
            baseline: Vec::new(),
            out: Some(out),
            time_limit_s: None,
        }),
        _ => {
            let (held_out, logs) = match &body.held_out {
                Some(held_out) => held_out.lay_out(app, caller).await?,
                None => (Vec::new(), Vec::new()),
            };
            inputs.extend(logs);
            rotortwin_jobs::Job::Improvement(Improvement {
                logs: flights,
                held_out,
                model,
                models: out.join(MODELS),
                truth: None,
                final_version: Some(out.join(FINAL_MODEL)),
                time_limit_s: None,
                out: Some(out),
            })
        }
    };
    // The same log may be named twice, for two parts of it.
    inputs.sort_by(|a, b| a.path.cmp(&b.path));
    inputs.dedup_by(|a, b| a.path == b.path);
    let draft = Draft {
        kind,
        name,
        facts: JobFacts::Twin(TwinFacts {
            model: body.model.clone(),
            flights: body.flights.clone(),
            more_models: body.more_models.clone(),
        }),
        stored: StoredJob { job, inputs },
        terms: Terms {
            priority: body.priority,
            max_wall_s: body.max_wall_s,
        },
    };
    draft.submit(app, caller, headers, body, Vec::new()).await
}

fn check_belongings(body: &TwinSubmission, kind: JobKind) -> Result<(), Problem> {
    let effects = body.effects.len() + body.library_effects.len();
    if kind != JobKind::Diagnosis && effects > 0 {
        return Err(Problem::unprocessable("`effects` belong to a diagnosis"));
    }
    if effects > MOST_EFFECTS {
        return Err(Problem::unprocessable(format!(
            "{effects} `effects`; expected at most {MOST_EFFECTS}"
        )));
    }
    if kind == JobKind::Improvement && !body.model.is_a_vehicle() && !body.model.is_a_version() {
        return Err(Problem::unprocessable(
            "an improvement starts from the nominal model of a vehicle; expected `model: {\"vehicle\": …}`, or a `version` without effects",
        ));
    }
    if kind != JobKind::Comparison && !body.more_models.is_empty() {
        return Err(Problem::unprocessable("`more_models` belong to a comparison"));
    }
    if body.more_models.len() >= MOST_MODELS {
        return Err(Problem::unprocessable(format!(
            "{} models; expected at most {MOST_MODELS}",
            1 + body.more_models.len()
        )));
    }
    if kind != JobKind::Comparison && body.model.label()?.is_some() {
        return Err(Problem::unprocessable("`label` belongs to a comparison"));
    }
    if kind != JobKind::Improvement && body.held_out.is_some() {
        return Err(Problem::unprocessable("`held_out` belongs to an improvement"));
    }
    Ok(())
}
