//! Contents of an imported log: channels, and samples decimated so that a plot looks the same, as for runs.

use super::jobs::Shared;
use super::tasks::{STEM, done};
use super::telemetry::{AnswerFormat, ChannelInfo, Channels, Selection, Telemetry, blocking};
use crate::App;
use crate::access::Caller;
use crate::problem::Problem;
use axum::Json;
use axum::extract::rejection::{PathRejection, QueryRejection};
use axum::extract::{Path, Query};
use axum::http::{HeaderMap, header};
use axum::response::{IntoResponse as _, Response};
use rotortwin_jobs::JobKind;
use rotortwin_store::query::{self, TelemetryFile, render::RunTable};
use std::path::PathBuf;

/// Contents of an imported log.
#[utoipa::path(get, path = "/api/v1/logs/{id}/channels", tag = "logs", operation_id = "log_channels", params(("id" = String, Path)), responses(
    (status = 200, description = "the channels", body = Channels),
    (status = 400, description = "invalid id", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "log not found", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "the log is not imported", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn channels(
    app: Shared,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
) -> Result<Json<Channels>, Problem> {
    let Path(id) = id?;
    let path = file_of(&app, &caller, &id).await?;
    let answer = blocking(move || {
        let file = TelemetryFile::open(&path)?;
        let items = file.channels().iter().cloned().map(ChannelInfo::from);
        Ok(Channels::new(file.rows(), items.collect()))
    });
    Ok(Json(answer.await?))
}

/// Samples of an imported log, decimated so that a plot looks the same.
#[utoipa::path(get, path = "/api/v1/logs/{id}/telemetry", tag = "logs", operation_id = "log_telemetry", params(("id" = String, Path), Selection), responses(
    (status = 200, description = "the samples; `run` holds the id of the log", content(
        (Telemetry = "application/json"), (String = "text/csv"), (Vec<u8> = "application/vnd.apache.parquet"))),
    (status = 400, description = "invalid parameter", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "log not found", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "the log is not imported", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "unknown channel, empty interval, or too many values", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn telemetry(
    app: Shared,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
    selection: Result<Query<Selection>, QueryRejection>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let (Path(id), Query(selection)) = (id?, selection?);
    let path = file_of(&app, &caller, &id).await?;
    let format = AnswerFormat::of(selection.format(), &headers);
    let body = blocking(move || {
        let table = TelemetryFile::open(&path)?.query(&selection.query())?;
        query::render::one(&RunTable { run: id, table }, format)
    });
    Ok(([(header::CONTENT_TYPE, format.content_type())], body.await?).into_response())
}

/// The canonical form of a log that is imported.
async fn file_of(app: &App, caller: &Caller, id: &str) -> Result<PathBuf, Problem> {
    let job = done(app, caller, JobKind::Log, id).await?;
    let file = app
        .artifacts
        .file(job.folder.as_deref().unwrap_or_default(), &format!("{STEM}.parquet"))
        .await
        .map_err(|error| Problem::of_files(&error))?;
    file.ok_or_else(|| Problem::not_found(format!("the file of log {id} was deleted")))
}
