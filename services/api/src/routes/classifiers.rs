//! Classifiers: train, evaluate. The file is an artifact, `classifier.json`; a run takes it by the job's id.

use super::facts::{ClassifierFacts, JobFacts};
use super::jobs::{self, JobView, Shared, Terms};
use super::tasks::{CLASSIFIER, Draft, LIBRARY, OUT, done, laid_out};
use crate::access::Caller;
use crate::json_object::JsonObject;
use crate::problem::Problem;
use axum::extract::Path;
use axum::extract::rejection::PathRejection;
use axum::http::HeaderMap;
use axum::response::Response;
use rotortwin_jobs::submission::ClassifierSubmission;
use rotortwin_jobs::{JobKind, StoredJob};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use utoipa::ToSchema;

super::collection!(
    classifiers,
    rotortwin_jobs::JobKind::Classifier,
    ClassifierResult,
    "classifier",
    "/api/v1/classifiers",
    "/api/v1/classifiers/{id}",
    "/api/v1/classifiers/{id}/cancel",
    "/api/v1/classifiers/{id}/events",
    "/api/v1/classifiers/{id}/artifacts",
    "/api/v1/classifiers/{id}/artifacts/{*path}"
);

/// Data sets, at most.
const MOST_REPEATS: u32 = 100;

/// Trains a classifier: the same seeds give the same bits.
#[utoipa::path(post, path = "/api/v1/classifiers", tag = "classifiers", operation_id = "submit_classifier", request_body = ClassifierSubmission,
    params(("Idempotency-Key" = Option<String>, Header, description = "a retry with the same key and body returns the existing job")),
    responses(
        (status = 202, description = "accepted and stored; the job will end as done, failed or canceled", body = JobView,
         headers(("Location" = String, description = "URL of the job"))),
        (status = 200, description = "already accepted under this Idempotency-Key", body = JobView),
        (status = 400, description = "malformed request", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "scenario not found", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "this Idempotency-Key was used with a different body", body = Problem, content_type = "application/problem+json"),
        (status = 413, description = "request body too large", body = Problem, content_type = "application/problem+json"),
        (status = 415, description = "the body is not JSON", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "the classifier cannot be trained with these settings", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "the server is shutting down", body = Problem, content_type = "application/problem+json"),
        (status = 507, description = "disk full", body = Problem, content_type = "application/problem+json")
    ))]
pub(crate) async fn submit(
    app: Shared,
    caller: Caller,
    headers: HeaderMap,
    body: Result<JsonObject<ClassifierSubmission>, Problem>,
) -> Result<Response, Problem> {
    let JsonObject(body) = body?;
    let hash = jobs::request_hash(&body);
    if let Some(answer) = jobs::before(&app, &caller, JobKind::Classifier, &headers, &hash, JobView::from).await? {
        return Ok(answer);
    }
    let library = app.library(&caller).await?;
    library.text("scenarios", &body.scenario)?;
    body.check().map_err(Problem::unprocessable)?;
    let method = body.method.as_str();
    let job = rotortwin_jobs::Job::Training(rotortwin_jobs::Training {
        method: body.method,
        scenario: format!("{LIBRARY}/scenarios/{}.toml", body.scenario).into(),
        seeds: body.seeds,
        first_seed: body.first_seed,
        out: PathBuf::from(OUT).join(CLASSIFIER),
        threads: None,
        hyperparameters: body.hyperparameters,
    });
    let draft = Draft {
        kind: JobKind::Classifier,
        name: format!("{}-{method}", body.scenario),
        facts: JobFacts::Classifier(ClassifierFacts {
            method: body.method,
            scenario: body.scenario.clone(),
            seeds: body.seeds,
            first_seed: body.first_seed,
        }),
        stored: StoredJob {
            job,
            inputs: vec![laid_out(&app, &library).await?],
        },
        terms: Terms {
            priority: body.priority,
            max_wall_s: None,
        },
    };
    draft.submit(&app, &caller, &headers, &body, Vec::new()).await
}

const fn five() -> u32 {
    5
}

/// Fresh flights of the protocol, judged with a classifier.
#[derive(Debug, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct Evaluation {
    /// Name of a scenario: vehicle, mismatch, sensors, detector settings; default: the one that the classifier was
    /// trained with.
    #[serde(default)]
    scenario: Option<String>,
    /// Data sets of the protocol: four courses, two charges, a fault in each rotor.
    #[serde(default = "five")]
    #[schema(minimum = 1, maximum = 100)]
    repeats: u32,
    /// Seed of all random draws.
    #[serde(default = "fresh")]
    seed: u64,
    /// From −100 to 100; larger values run first.
    #[serde(default)]
    #[schema(minimum = -100, maximum = 100)]
    priority: i64,
}

/// Not among the small ones that people train with.
const fn fresh() -> u64 {
    30_001
}

/// Flies fresh flights of the protocol with a classifier: a campaign, whose result holds its confusions, delays and false alarms.
#[utoipa::path(post, path = "/api/v1/classifiers/{id}/evaluations", tag = "classifiers", operation_id = "evaluate_classifier", request_body = Evaluation,
    params(("id" = String, Path), ("Idempotency-Key" = Option<String>, Header, description = "a retry with the same key and body returns the existing job")),
    responses(
        (status = 202, description = "accepted and stored; the campaign will end as done, failed or canceled", body = JobView,
         headers(("Location" = String, description = "URL of the campaign"))),
        (status = 200, description = "already accepted under this Idempotency-Key", body = JobView),
        (status = 400, description = "malformed request", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "classifier or scenario not found", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "this Idempotency-Key was used with a different body, or the classifier is not done", body = Problem, content_type = "application/problem+json"),
        (status = 413, description = "request body too large", body = Problem, content_type = "application/problem+json"),
        (status = 415, description = "the body is not JSON", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "the example cannot be flown with these settings", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "the server is shutting down", body = Problem, content_type = "application/problem+json"),
        (status = 507, description = "disk full", body = Problem, content_type = "application/problem+json")
    ))]
pub(crate) async fn evaluate(
    app: Shared,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
    headers: HeaderMap,
    body: Result<JsonObject<Evaluation>, Problem>,
) -> Result<Response, Problem> {
    let Path(id) = id?;
    let JsonObject(body) = body?;
    let hash = jobs::request_hash(&(&id, &body));
    if let Some(answer) = jobs::before(&app, &caller, JobKind::Campaign, &headers, &hash, JobView::from).await? {
        return Ok(answer);
    }
    let job = done(&app, &caller, JobKind::Classifier, &id).await?;
    if !(1..=MOST_REPEATS).contains(&body.repeats) {
        return Err(Problem::unprocessable(format!(
            "`repeats` is {}; expected 1 to {MOST_REPEATS}",
            body.repeats
        )));
    }
    let facts: Option<ClassifierFacts> = serde_json::from_str(&job.new.facts).ok();
    let trained_with = facts.as_ref().map_or("", |facts| facts.scenario.as_str());
    let scenario = body.scenario.as_deref().unwrap_or(trained_with);
    let library = app.library(&caller).await?;
    library.text("scenarios", scenario)?;
    let text = EVALUATION
        .replace("@NAME", &format!("evaluation-{}", job.new.name))
        .replace("@SCENARIO", scenario)
        .replace("@SEED", &body.seed.to_string())
        .replace("@REPEATS", &body.repeats.to_string());
    let terms = Terms {
        priority: body.priority,
        max_wall_s: None,
    };
    super::campaigns::accept(&app, &caller, &headers, &(&id, &body), library, text, Some(&id), terms).await
}

/// The protocol of the paper as a campaign: `@` marks the requested values.
const EVALUATION: &str = r#"
name = "@NAME"
description = "fresh flights of the protocol, judged with a classifier that was trained on others"
scenario = "../scenarios/@SCENARIO.toml"
seed = @SEED
repeats = @REPEATS
[set]
duration_s = 90.0
fault = [
    { time_s = 45.0, rotor = 1, blade = "b" },
    { time_s = 60.0, rotor = 1, blade = "c" },
    { time_s = 75.0, rotor = 1, blade = "d" },
]
[[axis]]
name = "trajectory"
courses = ["helix-1", "helix-2", "hover", "waypoints"]
[[axis]]
name = "charge"
key = "initial.state_of_charge"
values = [0.4, 1.0]
[[axis]]
name = "rotor"
keys = ["fault[0].rotor", "fault[1].rotor", "fault[2].rotor"]
rotors = true
"#;
