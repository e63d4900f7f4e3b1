//! Scenarios and vehicles that the server has.

use crate::App;
use crate::problem::Problem;
use axum::Json;
use axum::extract::rejection::{JsonRejection, PathRejection};
use axum::extract::{Path, State};
use axum::http::header;
use axum::response::IntoResponse;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use utoipa::ToSchema;

/// Names.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Names {
    items: Vec<String>,
}

/// Names of the scenarios.
#[utoipa::path(get, path = "/api/v1/scenarios", tag = "library", responses((status = 200, description = "names", body = Names)))]
pub(crate) async fn scenarios(State(app): State<Arc<App>>) -> Json<Names> {
    Json(Names {
        items: app.library.names("scenarios"),
    })
}

/// Names of the vehicles.
#[utoipa::path(get, path = "/api/v1/vehicles", tag = "library", responses((status = 200, description = "names", body = Names)))]
pub(crate) async fn vehicles(State(app): State<Arc<App>>) -> Json<Names> {
    Json(Names {
        items: app.library.names("vehicles"),
    })
}

/// A scenario's document.
#[utoipa::path(get, path = "/api/v1/scenarios/{name}", tag = "library", params(("name" = String, Path)), responses(
    (status = 200, description = "TOML", body = String, content_type = "application/toml"),
    (status = 400, description = "no name", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "no such scenario", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn scenario(
    State(app): State<Arc<App>>,
    name: Result<Path<String>, PathRejection>,
) -> Result<impl IntoResponse, Problem> {
    let Path(name) = name?;
    Ok((
        [(header::CONTENT_TYPE, "application/toml")],
        app.library.text("scenarios", &name)?,
    ))
}

/// A vehicle's document.
#[utoipa::path(get, path = "/api/v1/vehicles/{name}", tag = "library", params(("name" = String, Path)), responses(
    (status = 200, description = "TOML", body = String, content_type = "application/toml"),
    (status = 400, description = "no name", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "no such vehicle", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn vehicle(
    State(app): State<Arc<App>>,
    name: Result<Path<String>, PathRejection>,
) -> Result<impl IntoResponse, Problem> {
    let Path(name) = name?;
    Ok((
        [(header::CONTENT_TYPE, "application/toml")],
        app.library.text("vehicles", &name)?,
    ))
}

/// A scenario to check: the name of one of the server's, or a text.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct ToValidate {
    /// Name of one of the server's scenarios.
    pub(crate) scenario: Option<String>,
    /// A scenario document (TOML), as it would stand in the library's `scenarios`.
    pub(crate) text: Option<String>,
    /// Keys to set on the named scenario, `key=value`.
    #[serde(default)]
    pub(crate) set: Vec<String>,
}

/// What a check found.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Validation {
    /// It can be flown.
    valid: bool,
    /// Why not, one sentence.
    refusal: Option<String>,
    /// What is allowed and most likely not meant.
    warnings: Vec<String>,
    /// Every setting in effect (TOML).
    effective: Option<String>,
}

/// Checks a scenario without flying it.
#[utoipa::path(post, path = "/api/v1/scenarios/validate", tag = "library", request_body = ToValidate, responses(
    (status = 200, description = "what was found", body = Validation),
    (status = 400, description = "unreadable", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "no such scenario", body = Problem, content_type = "application/problem+json"),
    (status = 413, description = "too large", body = Problem, content_type = "application/problem+json"),
    (status = 415, description = "not JSON", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "unreadable", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn validate(
    State(app): State<Arc<App>>,
    body: Result<Json<ToValidate>, JsonRejection>,
) -> Result<Json<Validation>, Problem> {
    let Json(body) = body?;
    match super::runs::find_scenario(&app, body.scenario.as_deref(), body.text.as_deref(), &body.set) {
        Ok(scenario) => Ok(Json(Validation {
            valid: true,
            refusal: None,
            warnings: scenario.warnings(),
            effective: Some(scenario.documents().to_toml()),
        })),
        Err(problem) if problem.kind.ends_with("unprocessable") => Ok(Json(Validation {
            valid: false,
            refusal: Some(problem.detail),
            warnings: Vec::new(),
            effective: None,
        })),
        Err(problem) => Err(problem),
    }
}
