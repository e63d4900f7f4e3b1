//! Files of a run: report, telemetry, MCAP, summary, logs of its processes.

use crate::App;
use crate::problem::Problem;
use axum::Json;
use axum::body::Body;
use axum::extract::rejection::PathRejection;
use axum::extract::{Path, Request, State};
use axum::http::{HeaderValue, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use std::path::{Component, PathBuf};
use std::sync::Arc;
use tower_http::services::ServeFile;
use utoipa::ToSchema;

/// A file of a run.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Artifact {
    /// Path in the run's folder.
    path: String,
    /// Bytes.
    size: u64,
    /// Where to get it.
    href: String,
}

/// Files of a run.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Artifacts {
    items: Vec<Artifact>,
}

/// What files a run has left.
#[utoipa::path(get, path = "/api/v1/runs/{id}/artifacts", tag = "runs", params(("id" = String, Path)), responses(
    (status = 200, description = "its files; none before it has ended", body = Artifacts),
    (status = 400, description = "no id", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "no such run", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn list(
    State(app): State<Arc<App>>,
    id: Result<Path<String>, PathRejection>,
) -> Result<Json<Artifacts>, Problem> {
    let run = super::runs::find(&app, id).await?;
    let mut items = Vec::new();
    if let Some(folder) = &run.folder {
        let root = app.folder.path().join(folder);
        let mut open = vec![root.clone()];
        while let Some(folder) = open.pop() {
            let Ok(entries) = std::fs::read_dir(&folder) else {
                continue;
            };
            for entry in entries.filter_map(Result::ok) {
                let path = entry.path();
                let Ok(metadata) = entry.metadata() else { continue };
                if metadata.is_dir() {
                    open.push(path);
                } else if let Some(relative) = path.strip_prefix(&root).ok().and_then(|path| path.to_str()) {
                    items.push(Artifact {
                        path: relative.to_owned(),
                        size: metadata.len(),
                        href: format!("/api/v1/runs/{}/artifacts/{relative}", run.id),
                    });
                }
            }
        }
    }
    items.sort_by(|a, b| a.path.cmp(&b.path));
    Ok(Json(Artifacts { items }))
}

/// A file of a run; with ETag, conditional and range requests.
#[utoipa::path(get, path = "/api/v1/runs/{id}/artifacts/{*path}", tag = "runs",
    params(("id" = String, Path), ("path" = String, Path, description = "path in the run's folder, such as report.html")),
    responses(
        (status = 200, description = "the file", body = serde_json::Value, content_type = "*/*"),
        (status = 206, description = "the range", body = serde_json::Value, content_type = "*/*"),
        (status = 304, description = "unchanged"),
        (status = 400, description = "no path", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "no such run or file", body = Problem, content_type = "application/problem+json"),
        (status = 416, description = "there is no such range")
    ))]
pub(crate) async fn get(
    State(app): State<Arc<App>>,
    path: Result<Path<(String, String)>, PathRejection>,
    request: Request,
) -> Result<Response, Problem> {
    let Path((id, name)) = path?;
    let run = super::runs::find(&app, Ok(Path(id))).await?;
    let missing = || Problem::not_found(format!("run {} has no file '{name}'", run.id));
    let relative = PathBuf::from(&name);
    if !relative.components().all(|part| matches!(part, Component::Normal(_))) {
        return Err(missing());
    }
    let root = app.folder.path().join(run.folder.as_ref().ok_or_else(missing)?);
    let file = root.join(&relative).canonicalize().ok().ok_or_else(missing)?;
    if !file.starts_with(&root) || !file.is_file() {
        return Err(missing());
    }
    // A run's files never change once it has ended: its attempt and their size say which they are.
    let size = file.metadata().map_err(|error| Problem::internal(&error))?.len();
    let etag = format!("\"{}-{}-{size:x}\"", run.id, run.attempts);
    let same = |value: &HeaderValue| {
        value
            .to_str()
            .is_ok_and(|text| text == "*" || text.split(',').any(|tag| tag.trim().trim_start_matches("W/") == etag))
    };
    let etag_value = HeaderValue::from_str(&etag).map_err(|error| Problem::internal(&error))?;
    if request.headers().get(header::IF_NONE_MATCH).is_some_and(same) {
        return Ok((axum::http::StatusCode::NOT_MODIFIED, [(header::ETAG, etag_value)]).into_response());
    }
    let response = ServeFile::new(&file)
        .try_call(request)
        .await
        .map_err(|error| Problem::internal(&error))?;
    let mut response = response.map(Body::new);
    response.headers_mut().insert(header::ETAG, etag_value);
    Ok(response)
}
