//! A model compared with flights: comparisons, diagnoses, improvements.

use super::asked;
use super::facts::{JobFacts, TwinFacts};
use super::jobs::{self, JobView, Shared, Terms};
use super::tasks::{Draft, FINAL_MODEL, OUT};
use crate::App;
use crate::access::Caller;
use crate::json_object::JsonObject;
use crate::problem::Problem;
use axum::http::HeaderMap;
use axum::response::Response;
use rotortwin_jobs::submission::{ModelChoice, TwinSubmission};
use rotortwin_jobs::{Comparison, Diagnosis, Improvement, Input, JobKind, StoredJob};
use std::path::PathBuf;

super::collection!(
    comparisons,
    rotortwin_jobs::JobKind::Comparison,
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
    rotortwin_jobs::JobKind::Diagnosis,
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
    rotortwin_jobs::JobKind::Improvement,
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
    body.check_for(kind).map_err(Problem::unprocessable)?;
    let (model, mut inputs, name) = asked::model(app, caller, &body.model, 0).await?;
    let label = |choice: &ModelChoice, name: &str| {
        let own = choice.label().map_err(Problem::unprocessable)?;
        Ok::<_, Problem>(own.unwrap_or(name).to_owned())
    };
    let mut labels = vec![label(&body.model, &name)?];
    let mut models = vec![model.clone()];
    for (place, choice) in body.more_models.iter().enumerate() {
        let (model, more, name) = asked::model(app, caller, choice, place + 1).await?;
        labels.push(label(choice, &name)?);
        models.push(model);
        inputs.extend(more);
    }
    let (flights, logs) = asked::flights(app, caller, &body.flights).await?;
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
                Some(held_out) => asked::flights(app, caller, held_out).await?,
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
