//! Files of a job: report, telemetry, MCAP, summary, logs of its processes.

use super::jobs::Shared;
use crate::App;
use crate::access::Caller;
use crate::jobs::Job;
use crate::problem::Problem;
use axum::Json;
use axum::body::Body;
use axum::extract::rejection::PathRejection;
use axum::extract::{Path, Request};
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use tower_http::services::ServeFile;
use utoipa::ToSchema;

/// A file of a job.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Artifact {
    /// Path in the job's folder.
    path: String,
    /// Bytes.
    size: u64,
    /// URL of the file.
    href: String,
}

/// Files of a job.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Artifacts {
    items: Vec<Artifact>,
}

/// Lists the files of a run.
#[utoipa::path(get, path = "/api/v1/runs/{id}/artifacts", tag = "runs", operation_id = "list_run_files", params(("id" = String, Path)), responses(
    (status = 200, description = "its files; none until the job has ended", body = Artifacts),
    (status = 400, description = "invalid id", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "run not found", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn list(
    app: Shared,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
) -> Result<Json<Artifacts>, Problem> {
    let run = super::runs::find(&app, &caller, id).await?;
    of(&app, &run).await
}

/// The files of a job.
///
/// # Errors
/// 500: the store does not answer.
pub(super) async fn of(app: &App, job: &Job) -> Result<Json<Artifacts>, Problem> {
    let files = match &job.folder {
        None => Vec::new(),
        Some(folder) => app
            .artifacts
            .list(folder)
            .await
            .map_err(|error| Problem::internal(&error))?,
    };
    let collection = job.new.kind.collection();
    let items = files
        .into_iter()
        .map(|file| Artifact {
            href: format!("/api/v1/{collection}/{}/artifacts/{}", job.id, file.path),
            path: file.path,
            size: file.size,
        })
        .collect();
    Ok(Json(Artifacts { items }))
}

/// A file of a run; with ETag, conditional and range requests.
#[utoipa::path(get, path = "/api/v1/runs/{id}/artifacts/{*path}", tag = "runs", operation_id = "get_run_file",
    params(("id" = String, Path), ("path" = String, Path, description = "path in the run's folder, such as report.html")),
    responses(
        (status = 200, description = "the file", body = serde_json::Value, content_type = "*/*"),
        (status = 206, description = "the requested range", body = serde_json::Value, content_type = "*/*"),
        (status = 304, description = "not modified"),
        (status = 400, description = "invalid path", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "run or file not found", body = Problem, content_type = "application/problem+json"),
        (status = 412, description = "`If-Match` or `If-Unmodified-Since` does not hold", body = Problem, content_type = "application/problem+json"),
        (status = 416, description = "range not satisfiable", body = Problem, content_type = "application/problem+json")
    ))]
pub(crate) async fn get(
    app: Shared,
    caller: Caller,
    path: Result<Path<(String, String)>, PathRejection>,
    request: Request,
) -> Result<Response, Problem> {
    let Path((id, name)) = path?;
    let run = super::runs::find(&app, &caller, Ok(Path(id))).await?;
    one(&app, &run, &name, request).await
}

/// Answers with a file, or the part asked for.
///
/// A `Range` is ignored (RFC 9110) if its unit is unknown, and if it is for another version of the file (`If-Range`): a download that is
/// taken up again would join two files.
///
/// * `etag`: of this version; the file's own by default
///
/// # Errors
/// 500.
pub(super) async fn serve(
    path: &std::path::Path,
    mut request: Request,
    etag: Option<&HeaderValue>,
) -> Result<Response, Problem> {
    let in_bytes = |range: &HeaderValue| {
        let text = range.to_str().unwrap_or_default().trim_start();
        text.get(..6).is_some_and(|unit| unit.eq_ignore_ascii_case("bytes="))
    };
    if request
        .headers()
        .get(header::RANGE)
        .is_some_and(|range| !in_bytes(range))
    {
        request.headers_mut().remove(header::RANGE);
    }
    let unmet = || Problem::precondition_failed("the file is not the one that If-Match or If-Unmodified-Since names");
    // The file's own tag, with which ServeFile would compare, is not the one that was given out.
    if let Some(etag) = etag
        && let Some(wanted) = request.headers_mut().remove(header::IF_MATCH)
    {
        if !names(&wanted, etag) {
            return Err(unmet());
        }
        // Holds, so the time does not count (RFC 9110, 13.2.2).
        request.headers_mut().remove(header::IF_UNMODIFIED_SINCE);
    }
    let mut whole = Request::new(Body::empty());
    (*whole.method_mut(), *whole.uri_mut()) = (request.method().clone(), request.uri().clone());
    *whole.headers_mut() = request.headers().clone();
    whole.headers_mut().remove(header::RANGE);
    let version = request.headers_mut().remove(header::IF_RANGE);
    let ask = |request: Request| async {
        let answer = ServeFile::new(path).try_call(request).await;
        answer.map_err(|error| Problem::internal(&error))
    };
    let mut answer = ask(request).await?;
    let headers = answer.headers();
    let current = [etag.or(headers.get(header::ETAG)), headers.get(header::LAST_MODIFIED)];
    if version.is_some_and(|version| !current.contains(&Some(&version))) {
        answer = ask(whole).await?;
    }
    let size = || path.metadata().map_or(0, |about| about.len());
    let problem = match answer.status() {
        StatusCode::RANGE_NOT_SATISFIABLE => Problem::range_not_satisfiable(format!(
            "the file has {} bytes, none in the range asked for; expected a range such as bytes=0-99",
            size()
        )),
        StatusCode::PRECONDITION_FAILED => unmet(),
        _ => return Ok(answer.map(Body::new)),
    };
    let mut response = problem.into_response();
    if let Some(range) = answer.headers().get(header::CONTENT_RANGE) {
        response.headers_mut().insert(header::CONTENT_RANGE, range.clone());
    }
    Ok(response)
}

/// Whether a list of entity tags, or `*`, names this one.
fn names(tags: &HeaderValue, etag: &HeaderValue) -> bool {
    let (Ok(tags), Ok(etag)) = (tags.to_str(), etag.to_str()) else {
        return false;
    };
    tags.trim() == "*" || tags.split(',').any(|tag| tag.trim().trim_start_matches("W/") == etag)
}

/// A file of a job.
///
/// # Errors
/// 404.
pub(super) async fn one(app: &App, job: &Job, name: &str, request: Request) -> Result<Response, Problem> {
    let missing = || Problem::not_found(format!("{} {} has no file '{name}'", job.new.kind.as_str(), job.id));
    let folder = job.folder.as_ref().ok_or_else(missing)?;
    let file = app
        .artifacts
        .file(folder, name)
        .await
        .map_err(|error| Problem::of_files(&error))?;
    let file = file.ok_or_else(missing)?;
    // A job's files never change once it has ended: its attempt and their size say which they are.
    let size = file.metadata().map_err(|error| Problem::internal(&error))?.len();
    let etag = format!("\"{}-{}-{size:x}\"", job.id, job.attempts);
    let etag_value = HeaderValue::from_str(&etag).map_err(|error| Problem::internal(&error))?;
    let wanted = request.headers().get(header::IF_NONE_MATCH);
    if wanted.is_some_and(|tags| names(tags, &etag_value)) {
        return Ok((StatusCode::NOT_MODIFIED, [(header::ETAG, etag_value)]).into_response());
    }
    let mut response = serve(&file, request, Some(&etag_value)).await?;
    response.headers_mut().insert(header::ETAG, etag_value);
    response
        .headers_mut()
        .insert(header::CONTENT_SECURITY_POLICY, crate::browsers::FILES);
    Ok(response)
}
