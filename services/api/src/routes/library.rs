//! Documents that submissions can name: scenarios, vehicles, blades, effects, models.

use super::jobs::Shared;
use crate::App;
use crate::access::Caller;
use crate::library::own::{LARGEST_DOCUMENT, Precondition, Written, hash_of};
use crate::library::{Complaint, DocumentKind};
use crate::problem::Problem;
use axum::Json;
use axum::extract::rejection::JsonRejection;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

super::documents!(
    scenarios,
    crate::library::DocumentKind::Scenario,
    "scenario",
    "/api/v1/scenarios",
    "/api/v1/scenarios/{name}"
);
super::documents!(
    vehicles,
    crate::library::DocumentKind::Vehicle,
    "vehicle",
    "/api/v1/vehicles",
    "/api/v1/vehicles/{name}"
);
super::documents!(
    blades,
    crate::library::DocumentKind::Blades,
    "blade set",
    "/api/v1/blades",
    "/api/v1/blades/{name}"
);
super::documents!(
    effects,
    crate::library::DocumentKind::Effect,
    "effect document",
    "/api/v1/effects",
    "/api/v1/effects/{name}"
);
super::documents!(
    models,
    crate::library::DocumentKind::Model,
    "version of a model",
    "/api/v1/models",
    "/api/v1/models/{name}"
);

/// Longest name of a document.
const LONGEST_NAME: usize = 64;

/// Names, in order.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Names {
    /// All that can be named.
    items: Vec<String>,
    /// Those of them that the caller has left there.
    own: Vec<String>,
}

/// A document that was left in the library.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct StoredDocument {
    name: String,
    /// Of the text; the ETag without its quotes.
    hash: String,
}

pub(super) async fn list(app: &App, caller: &Caller, kind: DocumentKind) -> Result<Names, Problem> {
    let own = app.database.documents(&caller.tenant).await?;
    let own = own.into_iter().filter(|document| document.folder == kind.folder());
    Ok(Names {
        items: app.library(caller).await?.names(kind.folder()),
        own: own.map(|document| document.name).collect(),
    })
}

pub(super) async fn get(app: &App, caller: &Caller, kind: DocumentKind, name: &str) -> Result<Response, Problem> {
    let text = app.library(caller).await?.text(kind.folder(), name)?;
    let tag = format!("\"{}\"", hash_of(&text));
    Ok(([(header::CONTENT_TYPE, "application/toml"), (header::ETAG, &tag)], text).into_response())
}

pub(super) async fn put(
    app: &App,
    caller: &Caller,
    kind: DocumentKind,
    name: &str,
    headers: &HeaderMap,
    text: &str,
) -> Result<Response, Problem> {
    checked_name(name)?;
    let precondition = precondition(headers)?;
    if text.len() > LARGEST_DOCUMENT {
        return Err(Problem::too_large(format!(
            "the document has {} bytes; expected at most {LARGEST_DOCUMENT}",
            text.len()
        )));
    }
    let library = app.library(caller).await?;
    let complaints = check(library, kind, text.to_owned()).await?;
    if let Some(first) = complaints.first() {
        let all = complaints.iter().map(|complaint| complaint.sentence.clone()).collect();
        return Err(Problem::unprocessable(first.sentence.clone()).with_complaints(all));
    }
    let written = app
        .database
        .put_document(&caller.tenant, kind, name, text, &precondition)
        .await?;
    let stored = StoredDocument {
        name: name.to_owned(),
        hash: hash_of(text),
    };
    let tag = format!("\"{}\"", stored.hash);
    let address = format!("/api/v1/{}/{name}", kind.folder());
    match written {
        Written::Created => {
            let headers = [(header::LOCATION, address), (header::ETAG, tag)];
            Ok((StatusCode::CREATED, headers, Json(stored)).into_response())
        }
        Written::Replaced => Ok(([(header::ETAG, tag)], Json(stored)).into_response()),
        Written::Refused if precondition == Precondition::Absent => Err(Problem::precondition_failed(format!(
            "you have left '{name}' there already; expected none (`If-None-Match: *`)"
        ))),
        Written::Refused => Err(Problem::precondition_failed(format!(
            "'{name}' is not there, or was changed since; expected the text of `If-Match`"
        ))),
        Written::Full => Err(Problem::disk_full(format!(
            "'{}' has as many documents as one may have; delete some that are done with",
            caller.tenant
        ))),
    }
}

pub(super) async fn delete(app: &App, caller: &Caller, kind: DocumentKind, name: &str) -> Result<StatusCode, Problem> {
    if app.database.delete_document(&caller.tenant, kind, name).await? {
        return Ok(StatusCode::NO_CONTENT);
    }
    Err(Problem::not_found(format!(
        "you have left no '{name}' under {}; what the server has itself cannot be deleted",
        kind.folder()
    )))
}

/// It becomes the name of a file.
///
/// # Errors
/// 400.
pub(super) fn checked_name(name: &str) -> Result<(), Problem> {
    let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || "._-".contains(c);
    let begins = name.starts_with(|c: char| c.is_ascii_lowercase() || c.is_ascii_digit());
    if begins && name.len() <= LONGEST_NAME && name.chars().all(plain) {
        return Ok(());
    }
    Err(Problem::bad_request(format!(
        "'{name}' is no name for a document; expected 1 to {LONGEST_NAME} of a-z, 0-9, '.', '_' and '-', beginning with a letter or digit"
    )))
}

fn precondition(headers: &HeaderMap) -> Result<Precondition, Problem> {
    let value = |name| headers.get(name).map(|value| value.to_str().unwrap_or_default().trim());
    match (value(header::IF_MATCH), value(header::IF_NONE_MATCH)) {
        (None, None) => Ok(Precondition::None),
        (None, Some("*")) => Ok(Precondition::Absent),
        (Some(tag), None) if tag.len() > 2 && tag.starts_with('"') && tag.ends_with('"') => {
            Ok(Precondition::Hash(tag.trim_matches('"').to_owned()))
        }
        _ => Err(Problem::bad_request(
            "expected at most one of `If-Match: \"ETAG\"` and `If-None-Match: *`",
        )),
    }
}

async fn check(library: crate::library::Library, kind: DocumentKind, text: String) -> Result<Vec<Complaint>, Problem> {
    tokio::task::spawn_blocking(move || library.complaints(kind, &text))
        .await
        .map_err(|error| Problem::internal(&error))
}

/// A scenario to check: the name of one of the server's, or a text.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct ToValidate {
    /// Name of one of the server's scenarios.
    scenario: Option<String>,
    /// A scenario document (TOML), as it would stand in the library's `scenarios`.
    text: Option<String>,
    /// Keys to set on the named scenario, `key=value`.
    #[serde(default)]
    set: Vec<String>,
}

/// What a check found.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Validation {
    /// It can be used.
    valid: bool,
    /// Why not, one sentence: the first of the complaints.
    refusal: Option<String>,
    /// All that is wrong. Each later one was found with the values of the earlier ones put right or left out.
    complaints: Vec<Complaint>,
    /// What is allowed and most likely not meant.
    warnings: Vec<String>,
    /// Of a scenario: every setting in effect (TOML).
    effective: Option<String>,
}

impl Validation {
    fn refused(complaints: Vec<Complaint>) -> Self {
        Self {
            valid: false,
            refusal: complaints.first().map(|complaint| complaint.sentence.clone()),
            complaints,
            warnings: Vec::new(),
            effective: None,
        }
    }
}

/// Checks a scenario without flying it: all that is wrong with it, or every setting in effect.
#[utoipa::path(post, path = "/api/v1/scenarios/validate", tag = "library", operation_id = "validate_scenario", request_body = ToValidate, responses(
    (status = 200, description = "what was found", body = Validation),
    (status = 400, description = "unreadable", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "no such scenario", body = Problem, content_type = "application/problem+json"),
    (status = 413, description = "too large", body = Problem, content_type = "application/problem+json"),
    (status = 415, description = "not JSON", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "unreadable", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn validate_scenario(
    app: Shared,
    caller: Caller,
    body: Result<Json<ToValidate>, JsonRejection>,
) -> Result<Json<Validation>, Problem> {
    let Json(body) = body?;
    let library = app.library(&caller).await?;
    let (name, text) = (body.scenario.as_deref(), body.text.as_deref());
    match super::submissions::find_scenario(&library, name, text, &body.set) {
        Ok(scenario) => Ok(Json(Validation {
            valid: true,
            refusal: None,
            complaints: Vec::new(),
            warnings: scenario.warnings(),
            effective: Some(scenario.documents().to_toml()),
        })),
        Err(problem) if problem.kind.ends_with("unprocessable") => {
            let complaints = match body.text {
                Some(text) if body.scenario.is_none() && body.set.is_empty() => {
                    check(library, DocumentKind::Scenario, text).await?
                }
                _ => Vec::new(),
            };
            let only = Complaint {
                key: None,
                line: None,
                sentence: problem.detail,
            };
            let complaints = if complaints.is_empty() { vec![only] } else { complaints };
            Ok(Json(Validation::refused(complaints)))
        }
        Err(problem) => Err(problem),
    }
}

/// A document to check.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct TextToValidate {
    /// TOML.
    text: String,
}

macro_rules! validation {
    ($function:ident, $kind:expr, $word:literal, $path:literal) => {
        #[doc = concat!("Checks a ", $word, ": all that is wrong with it.")]
        #[utoipa::path(post, path = $path, summary = concat!("Checks a ", $word, ": all that is wrong with it."), tag = "library", operation_id = stringify!($function), request_body = TextToValidate, responses(
            (status = 200, description = "what was found", body = Validation),
            (status = 400, description = "unreadable", body = Problem, content_type = "application/problem+json"),
            (status = 413, description = "too large", body = Problem, content_type = "application/problem+json"),
            (status = 415, description = "not JSON", body = Problem, content_type = "application/problem+json"),
            (status = 422, description = "unreadable", body = Problem, content_type = "application/problem+json")
        ))]
        pub(crate) async fn $function(
            app: Shared,
            caller: Caller,
            body: Result<Json<TextToValidate>, JsonRejection>,
        ) -> Result<Json<Validation>, Problem> {
            let Json(body) = body?;
            let complaints = check(app.library(&caller).await?, $kind, body.text).await?;
            let valid = complaints.is_empty();
            Ok(Json(Validation {
                valid,
                ..Validation::refused(complaints)
            }))
        }
    };
}

validation!(
    validate_vehicle,
    DocumentKind::Vehicle,
    "vehicle",
    "/api/v1/vehicles/validate"
);
validation!(
    validate_blades,
    DocumentKind::Blades,
    "blade set",
    "/api/v1/blades/validate"
);
validation!(
    validate_effect,
    DocumentKind::Effect,
    "effect document",
    "/api/v1/effects/validate"
);
validation!(
    validate_model,
    DocumentKind::Model,
    "version of a model",
    "/api/v1/models/validate"
);

/// The effects that a model can have.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct EffectCatalogue {
    /// Id, name, equation, parameters with units and plausible ranges, channels, what it is confused with, source.
    #[schema(value_type = Vec<Object>)]
    items: serde_json::Value,
}

/// The catalogue of effects: the built-in ones and the documents of the library, as the diagnosis knows them.
#[utoipa::path(get, path = "/api/v1/catalogue", tag = "library", operation_id = "catalogue", responses(
    (status = 200, description = "declarations", body = EffectCatalogue),
    (status = 422, description = "a document of the library is no effect", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn catalogue(app: Shared, caller: Caller) -> Result<Json<EffectCatalogue>, Problem> {
    let catalogue = app.library(&caller).await?.catalogue()?;
    let items = serde_json::to_value(catalogue.entries()).map_err(|error| Problem::internal(&error))?;
    Ok(Json(EffectCatalogue { items }))
}
