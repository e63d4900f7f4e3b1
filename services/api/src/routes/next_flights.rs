//! The next flight: the manoeuvre that would distinguish two effects.

use super::asked;
use super::facts::{JobFacts, NextFlightFacts};
use super::jobs::{self, JobView, Shared, Terms};
use super::tasks::{Draft, OUT};
use crate::access::Caller;
use crate::json_object::JsonObject;
use crate::problem::Problem;
use axum::http::HeaderMap;
use axum::response::Response;
use rotortwin_jobs::submission::ModelChoice;
use rotortwin_jobs::{JobKind, NextFlight, StoredJob};
use rotortwin_twin::next_flight::Rival;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

super::collection!(
    next_flights,
    rotortwin_jobs::JobKind::NextFlight,
    NextFlightResult,
    "proposal of a next flight",
    "/api/v1/next-flights",
    "/api/v1/next-flights/{id}",
    "/api/v1/next-flights/{id}/cancel",
    "/api/v1/next-flights/{id}/events",
    "/api/v1/next-flights/{id}/artifacts",
    "/api/v1/next-flights/{id}/artifacts/{*path}"
);

/// The best manoeuvre, among the files: a scenario, and the vehicle that it flies, next to it.
const SCENARIO: &str = "next-flight.toml";
/// Where no models of a folder are named.
const MODELS: &str = "models";

/// Two effects that a flight could not distinguish.
#[derive(Debug, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct NextFlightSubmission {
    /// The current model.
    model: ModelChoice,
    /// Ids in the catalogue; with the rotor where an effect has one: `rotor-thrust-scale#3`.
    #[schema(min_items = 2, max_items = 2)]
    between: [String; 2],
}

/// Submits a search for the manoeuvre that would distinguish two effects.
///
/// The result lists manoeuvres, the best one first; `artifacts/next-flight.toml` is the best one as a scenario.
#[utoipa::path(post, path = "/api/v1/next-flights", tag = "next_flights", operation_id = "submit_next_flight", request_body = NextFlightSubmission,
    params(("Idempotency-Key" = Option<String>, Header, description = "a retry with the same key and body returns the existing job")),
    responses(
        (status = 202, description = "accepted and stored; the job will end as done, failed or canceled", body = JobView,
         headers(("Location" = String, description = "URL of the job"))),
        (status = 200, description = "already accepted under this Idempotency-Key", body = JobView),
        (status = 400, description = "malformed request", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "model not found", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "this Idempotency-Key was used with a different body, or the improvement is not done", body = Problem, content_type = "application/problem+json"),
        (status = 413, description = "request body too large", body = Problem, content_type = "application/problem+json"),
        (status = 415, description = "the body is not JSON", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "the job cannot be done with these inputs", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "the server is shutting down", body = Problem, content_type = "application/problem+json"),
        (status = 507, description = "disk full", body = Problem, content_type = "application/problem+json")
    ))]
pub(crate) async fn submit(
    app: Shared,
    caller: Caller,
    headers: HeaderMap,
    body: Result<JsonObject<NextFlightSubmission>, Problem>,
) -> Result<Response, Problem> {
    let JsonObject(body) = body?;
    let hash = jobs::request_hash(&body);
    if let Some(answer) = jobs::before(&app, &caller, JobKind::NextFlight, &headers, &hash, JobView::from).await? {
        return Ok(answer);
    }
    // The nearest id of a long text would take long to find.
    if let Some(long) = body.between.iter().find(|text| text.len() > 64) {
        return Err(Problem::unprocessable(format!(
            "`between` has an id of {} bytes; expected at most 64",
            long.len()
        )));
    }
    let known = asked::version(&app, &caller, &body.model).await?;
    let catalogue = known.catalogue().map_err(|refusal| {
        Problem::unprocessable(format!(
            "model {}, key `{}`: {}",
            known.name, refusal.key, refusal.reason
        ))
    })?;
    Rival::pair(&body.between, &known, &catalogue)
        .map_err(|reason| Problem::unprocessable(format!("`between`: {reason}")))?;
    let (model, inputs, name) = asked::model(&app, &caller, &body.model, 0).await?;
    let job = NextFlight {
        model,
        models: MODELS.into(),
        between: body.between.clone(),
        out: Some(format!("{OUT}/{SCENARIO}").into()),
        seed: 1,
    };
    let draft = Draft {
        kind: JobKind::NextFlight,
        name,
        facts: JobFacts::NextFlight(NextFlightFacts {
            model: body.model.clone(),
            between: body.between.clone(),
        }),
        stored: StoredJob {
            job: rotortwin_jobs::Job::NextFlight(job),
            inputs,
        },
        terms: Terms::default(),
    };
    draft.submit(&app, &caller, &headers, &body, Vec::new()).await
}
