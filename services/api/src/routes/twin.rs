//! A model held against flights: comparisons, diagnoses, improvements.

use super::jobs::{JobView, Shared, Terms};
use super::tasks::{Draft, Flights, ModelChoice};
use crate::App;
use crate::access::Caller;
use crate::jobs::JobKind;
use crate::jobs::spec::{Content, Input, Task};
use crate::problem::Problem;
use axum::Json;
use axum::extract::rejection::JsonRejection;
use axum::http::HeaderMap;
use axum::response::Response;
use serde::{Deserialize, Serialize};
use serde_json::json;
use utoipa::ToSchema;

super::collection!(
    comparisons,
    crate::jobs::JobKind::Comparison,
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
    "improvement",
    "/api/v1/improvements",
    "/api/v1/improvements/{id}",
    "/api/v1/improvements/{id}/cancel",
    "/api/v1/improvements/{id}/events",
    "/api/v1/improvements/{id}/artifacts",
    "/api/v1/improvements/{id}/artifacts/{*path}"
);

/// The version that an improvement ends with, in its files.
pub(super) const FINAL_MODEL: &str = "model.toml";
/// A submission brings at most this many effects of its own.
const MOST_EFFECTS: usize = 32;

/// A model and the flights that it is held against.
#[derive(Debug, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct TwinSubmission {
    /// Which model.
    model: ModelChoice,
    /// Which flights; all of one vehicle.
    flights: Flights,
    /// Diagnosis: effects of one's own that may be named, too (TOML).
    #[serde(default)]
    effects: Vec<String>,
    /// Diagnosis: names of effect documents of the library that may be named, too.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    library_effects: Vec<String>,
    /// Improvement: flights that no fit sees, as proof.
    #[serde(default)]
    held_out: Option<Flights>,
    /// From −100 to 100; larger goes first.
    #[serde(default)]
    #[schema(minimum = -100, maximum = 100)]
    priority: i64,
    /// It fails when an attempt takes longer, s of wall time; by default 6 h.
    #[serde(default)]
    #[schema(minimum = 1, maximum = 86_400)]
    max_wall_s: Option<u64>,
}

macro_rules! submission {
    ($function:ident, $path:literal, $tag:literal, $operation:literal, $summary:literal, $kind:expr) => {
        #[doc = $summary]
        #[utoipa::path(post, path = $path, summary = $summary, tag = $tag, operation_id = $operation, request_body = TwinSubmission,
            params(("Idempotency-Key" = Option<String>, Header, description = "the same key and body again give the one that is there")),
            responses(
                (status = 202, description = "accepted: it is on disk, and will end as done, failed or canceled", body = JobView,
                 headers(("Location" = String, description = "its address"))),
                (status = 200, description = "accepted before under this key", body = JobView),
                (status = 400, description = "unreadable", body = Problem, content_type = "application/problem+json"),
                (status = 404, description = "no such log, run, vehicle or improvement", body = Problem, content_type = "application/problem+json"),
                (status = 409, description = "another body was submitted under this key, or a flight is not done", body = Problem, content_type = "application/problem+json"),
                (status = 413, description = "too large", body = Problem, content_type = "application/problem+json"),
                (status = 415, description = "not JSON", body = Problem, content_type = "application/problem+json"),
                (status = 422, description = "it cannot be done so", body = Problem, content_type = "application/problem+json"),
                (status = 503, description = "the server is ending", body = Problem, content_type = "application/problem+json"),
                (status = 507, description = "the disk is full", body = Problem, content_type = "application/problem+json")
            ))]
        pub(crate) async fn $function(
            app: Shared,
            caller: Caller,
            headers: HeaderMap,
            body: Result<Json<TwinSubmission>, JsonRejection>,
        ) -> Result<Response, Problem> {
            let Json(body) = body?;
            submit(&app, &caller, &headers, &body, $kind).await
        }
    };
}

submission!(
    compare,
    "/api/v1/comparisons",
    "comparisons",
    "submit_comparison",
    "Holds a model against flights: where, when and how much they disagree.",
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
    "Compares, diagnoses, adds what is missing, compares again, until the model agrees. `artifacts/model.toml` is the version that it ends with.",
    JobKind::Improvement
);

async fn submit(
    app: &App,
    caller: &Caller,
    headers: &HeaderMap,
    body: &TwinSubmission,
    kind: JobKind,
) -> Result<Response, Problem> {
    check_belongings(body, kind)?;
    let (model, mut inputs, name) = body.model.lay_out(app, caller).await?;
    let (flights, logs) = body.flights.lay_out(app, caller).await?;
    inputs.extend(logs);
    let mut args: Vec<String> = vec![
        match kind {
            JobKind::Comparison => "compare",
            JobKind::Diagnosis => "diagnose",
            _ => "improve",
        }
        .to_owned(),
    ];
    args.extend(flights.iter().cloned());
    args.extend([
        "--model".to_owned(),
        model,
        "--out".to_owned(),
        "out".to_owned(),
        "--json".to_owned(),
    ]);
    if let Some(label) = body.model.label()? {
        args.push(format!("--label={label}"));
    }
    if kind != JobKind::Comparison {
        args.push("--events".to_owned());
    }
    let library = app.library(caller).await?;
    let named = body.library_effects.iter().map(|name| library.text("effects", name));
    let named = named.collect::<Result<Vec<String>, Problem>>()?;
    for (number, effect) in body.effects.iter().chain(&named).enumerate() {
        let path = format!("effects/{number}.toml");
        args.extend(["--effects".to_owned(), path.clone()]);
        inputs.push(Input {
            path,
            content: Content::Text(effect.clone()),
        });
    }
    if kind == JobKind::Improvement {
        args.extend(
            [
                "--yes",
                "--models",
                "out/models",
                "--final",
                &format!("out/{FINAL_MODEL}"),
            ]
            .map(str::to_owned),
        );
        if let Some(held_out) = &body.held_out {
            let (words, logs) = held_out.lay_out(app, caller).await?;
            inputs.extend(logs);
            args.push("--held-out".to_owned());
            args.extend(words);
        }
    }
    // The same log may be named twice, for two parts of it.
    inputs.sort_by(|a, b| a.path.cmp(&b.path));
    inputs.dedup_by(|a, b| a.path == b.path);
    let draft = Draft {
        kind,
        name,
        facts: json!({ "model": body.model, "flights": body.flights }),
        task: Task {
            args,
            inputs,
            result: None,
            discard: Vec::new(),
        },
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
            "an improvement begins with a vehicle's nominal model; expected `model: {\"vehicle\": …}`, or a `version` without effects",
        ));
    }
    if kind != JobKind::Comparison && body.model.label()?.is_some() {
        return Err(Problem::unprocessable("`label` belongs to a comparison"));
    }
    if kind != JobKind::Improvement && body.held_out.is_some() {
        return Err(Problem::unprocessable("`held_out` belongs to an improvement"));
    }
    Ok(())
}
