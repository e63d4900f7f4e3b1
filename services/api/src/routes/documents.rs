//! Documents of one kind in the library: list, get, put, delete. Written once, described for each.

use crate::App;
use crate::access::Caller;
use crate::library::DocumentKind;
use crate::library::own::{LARGEST_DOCUMENT, Precondition, Written, hash_of};
use crate::problem::Problem;
use axum::Json;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use rotortwin_twin::model::constants::FROM_LOG;
use serde::Serialize;
use utoipa::ToSchema;

/// Longest name of a document.
const LONGEST_NAME: usize = 64;

/// Names, in order.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Names {
    /// All names.
    items: Vec<String>,
    /// Those that belong to the caller.
    own: Vec<String>,
}

/// A document stored in the library.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct StoredDocument {
    name: String,
    /// Content hash: the ETag without its quotes.
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
    check_form(headers)?;
    let precondition = precondition(headers)?;
    if text.len() > LARGEST_DOCUMENT {
        return Err(Problem::too_large(format!(
            "the document has {} bytes; expected at most {LARGEST_DOCUMENT}",
            text.len()
        )));
    }
    if kind == DocumentKind::Model && app.database.has_model(&caller.tenant, name).await? {
        return Err(Problem::conflict(format!(
            "the model '{name}' has versions that would be lost; add a version to it, or choose another name"
        )));
    }
    let library = app.library(caller).await?;
    let complaints = app.readers.read(|| library.complaints(kind, text)).await;
    if let Some(first) = complaints.first() {
        let all = complaints.iter().map(|complaint| complaint.sentence.clone()).collect();
        return Err(Problem::unprocessable(first.sentence.clone()).with_complaints(all));
    }
    let written = app
        .database
        .put_document(&caller.tenant, kind, name, text, &precondition)
        .await?;
    // A constant that was edited is exact; a vehicle that no identification wrote has nothing of the earlier one.
    let is_written = matches!(written, Written::Created | Written::Replaced);
    if kind == DocumentKind::Vehicle && is_written && !text.contains(FROM_LOG) {
        forget_intervals(app, caller, name).await?;
    }
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
        Written::Refused => Err(refused(name, &precondition)),
        Written::Full => Err(Problem::disk_full(format!(
            "'{}' has reached its quota of documents; delete some that are no longer needed",
            caller.tenant
        ))),
    }
}

/// Refuses what is to be done to a document if the precondition does not hold.
///
/// # Errors
/// 412, 500.
pub(super) async fn check_precondition(
    app: &App,
    caller: &Caller,
    kind: DocumentKind,
    name: &str,
    precondition: &Precondition,
) -> Result<(), Problem> {
    if app.database.holds(&caller.tenant, kind, name, precondition).await? {
        return Ok(());
    }
    Err(refused(name, precondition))
}

fn refused(name: &str, precondition: &Precondition) -> Problem {
    Problem::precondition_failed(match precondition {
        Precondition::Absent => format!("you already have a '{name}'; expected none (`If-None-Match: *`)"),
        Precondition::Hash(_) | Precondition::None => {
            format!("'{name}' does not exist or has changed; expected the text of `If-Match`")
        }
    })
}

pub(super) async fn delete(
    app: &App,
    caller: &Caller,
    kind: DocumentKind,
    name: &str,
    headers: &HeaderMap,
) -> Result<StatusCode, Problem> {
    let precondition = precondition(headers)?;
    check_precondition(app, caller, kind, name, &precondition).await?;
    let hash = match &precondition {
        Precondition::Hash(hash) => Some(hash.as_str()),
        Precondition::None | Precondition::Absent => None,
    };
    let deleted = app.database.delete_document(&caller.tenant, kind, name, hash).await?;
    if !deleted && hash.is_some() {
        // Somebody else was faster.
        return Err(refused(name, &precondition));
    }
    if kind == DocumentKind::Vehicle {
        forget_intervals(app, caller, name).await?;
    }
    let had_versions = kind == DocumentKind::Model && app.database.forget_model(&caller.tenant, name).await?;
    if deleted || had_versions {
        return Ok(StatusCode::NO_CONTENT);
    }
    Err(Problem::not_found(format!(
        "you have no '{name}' under {}; the server's own documents cannot be deleted",
        kind.folder()
    )))
}

/// Intervals of a vehicle that is another one now, or none.
async fn forget_intervals(app: &App, caller: &Caller, name: &str) -> Result<(), Problem> {
    app.database
        .delete_document(&caller.tenant, DocumentKind::Intervals, name, None)
        .await?;
    Ok(())
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
        "'{name}' is not a valid document name; expected 1 to {LONGEST_NAME} of a-z, 0-9, '.', '_' and '-', beginning with a letter or digit"
    )))
}

/// A document says that it is TOML.
fn check_form(headers: &HeaderMap) -> Result<(), Problem> {
    let kind = headers
        .get(header::CONTENT_TYPE)
        .map(|kind| kind.to_str().unwrap_or_default());
    let essence = kind.unwrap_or_default().split(';').next().unwrap_or_default().trim();
    if essence.eq_ignore_ascii_case("application/toml") {
        return Ok(());
    }
    Err(Problem::unsupported(format!(
        "unsupported content type {}; expected `Content-Type: application/toml`",
        kind.unwrap_or("nothing in particular")
    )))
}

pub(super) fn precondition(headers: &HeaderMap) -> Result<Precondition, Problem> {
    let value = |name| headers.get(name).map(|value| value.to_str().unwrap_or_default().trim());
    match (value(header::IF_MATCH), value(header::IF_NONE_MATCH)) {
        (None, None) => Ok(Precondition::None),
        (None, Some("*")) => Ok(Precondition::Absent),
        (Some(tag), None) if tag.len() > 2 && tag.starts_with('"') && tag.ends_with('"') => {
            Ok(Precondition::Hash(tag.trim_matches('"').to_owned()))
        }
        (Some(_), Some(_)) => Err(Problem::precondition_failed(
            "`If-Match` and `If-None-Match` cannot both hold; expected at most one of them",
        )),
        _ => Err(Problem::bad_request(
            "expected `If-Match: \"ETAG\"` or `If-None-Match: *`",
        )),
    }
}

/// Makes a module with the addresses of one kind of document.
macro_rules! documents {
    ($module:ident, $kind:expr, $word:literal, $all:literal, $one:literal) => {
        pub(crate) mod $module {
            use crate::App;
            use crate::access::Caller;
            use crate::library::DocumentKind;
            use crate::problem::Problem;
            use crate::routes::documents::{self, Names, StoredDocument};
            use crate::routes::jobs::Shared;
            use axum::Json;
            use axum::extract::Path;
            use axum::extract::rejection::{PathRejection, StringRejection};
            use axum::http::{HeaderMap, StatusCode};
            use axum::response::Response;
            use std::sync::Arc;
            use utoipa_axum::router::OpenApiRouter;
            use utoipa_axum::routes;

            const KIND: DocumentKind = $kind;

            /// All of them.
            pub(crate) fn routes() -> OpenApiRouter<Arc<App>> {
                OpenApiRouter::new().routes(routes!(list)).routes(routes!(get, put, delete))
            }

            #[doc = concat!("Names of all ", stringify!($module), ".")]
            #[utoipa::path(get, path = $all, summary = concat!("Names of all ", stringify!($module), "."), tag = "library", operation_id = concat!("list_", stringify!($module)), responses(
                (status = 200, description = "the names", body = Names)
            ))]
            pub(crate) async fn list(app: Shared, caller: Caller) -> Result<Json<Names>, Problem> {
                documents::list(&app, &caller, KIND).await.map(Json)
            }

            #[doc = concat!("The text of ", $word, ".")]
            #[utoipa::path(get, path = $one, summary = concat!("The text of ", $word, "."), tag = "library", operation_id = concat!("get_", stringify!($module)), params(("name" = String, Path)), responses(
                (status = 200, description = "TOML", body = String, content_type = "application/toml", headers(("ETag" = String, description = "changes whenever the text does"))),
                (status = 400, description = "invalid name", body = Problem, content_type = "application/problem+json"),
                (status = 404, description = "not found", body = Problem, content_type = "application/problem+json")
            ))]
            pub(crate) async fn get(
                app: Shared,
                caller: Caller,
                name: Result<Path<String>, PathRejection>,
            ) -> Result<Response, Problem> {
                let Path(name) = name?;
                documents::get(&app, &caller, KIND, &name).await
            }

            #[doc = concat!("Stores ", $word, " in the library, for your tenant.")]
            ///
            /// It is checked before it is stored. A document of your own hides the server's with the same name. `If-None-Match: *` only
            /// creates, `If-Match: ETAG` only replaces that version.
            #[utoipa::path(put, path = $one, summary = concat!("Stores ", $word, " in the library, for your tenant."), tag = "library", operation_id = concat!("put_", stringify!($module)),
                params(
                    ("name" = String, Path, max_length = 64, pattern = "^[a-z0-9][a-z0-9._-]*$"), ("If-Match" = Option<String>, Header), ("If-None-Match" = Option<String>, Header)),
                request_body(content = String, content_type = "application/toml"), responses(
                (status = 201, description = "created", body = StoredDocument, headers(("Location" = String, description = "URL of the document"), ("ETag" = String, description = "changes whenever the text does"))),
                (status = 200, description = "replaced", body = StoredDocument, headers(("ETag" = String, description = "changes whenever the text does"))),
                (status = 400, description = "invalid name, or empty text", body = Problem, content_type = "application/problem+json"),
                (status = 409, description = "a model with this name has versions that would be lost", body = Problem, content_type = "application/problem+json"),
                (status = 412, description = "`If-Match` or `If-None-Match` does not hold", body = Problem, content_type = "application/problem+json"),
                (status = 413, description = "request body too large", body = Problem, content_type = "application/problem+json"),
                (status = 415, description = "the body is not TOML", body = Problem, content_type = "application/problem+json"),
                (status = 422, description = "rejected: `complaints` lists every error", body = Problem, content_type = "application/problem+json"),
                (status = 507, description = "disk full, or quota of documents exceeded", body = Problem, content_type = "application/problem+json")
            ))]
            pub(crate) async fn put(
                app: Shared,
                caller: Caller,
                name: Result<Path<String>, PathRejection>,
                headers: HeaderMap,
                text: Result<String, StringRejection>,
            ) -> Result<Response, Problem> {
                let Path(name) = name?;
                documents::put(&app, &caller, KIND, &name, &headers, &text?).await
            }

            #[doc = concat!("Removes ", $word, " of your own from the library.")]
            #[utoipa::path(delete, path = $one, summary = concat!("Removes ", $word, " of your own from the library."), tag = "library", operation_id = concat!("delete_", stringify!($module)), params(("name" = String, Path), ("If-Match" = Option<String>, Header)), responses(
                (status = 204, description = "deleted"),
                (status = 400, description = "invalid name", body = Problem, content_type = "application/problem+json"),
                (status = 404, description = "you have no document with this name", body = Problem, content_type = "application/problem+json"),
                (status = 412, description = "`If-Match` does not hold", body = Problem, content_type = "application/problem+json"),
                (status = 507, description = "disk full", body = Problem, content_type = "application/problem+json")
            ))]
            pub(crate) async fn delete(
                app: Shared,
                caller: Caller,
                name: Result<Path<String>, PathRejection>,
                headers: HeaderMap,
            ) -> Result<StatusCode, Problem> {
                let Path(name) = name?;
                documents::delete(&app, &caller, KIND, &name, &headers).await
            }
        }
    };
}

pub(crate) use documents;
