//! Whole runs in one file of a format that other programs read.
//!
//! MCAP and Parquet are files of the run. ULog and CSV are written to a file in the data folder's `exports`, which is
//! unlinked as soon as it is open for sending, so it disappears with the response. Files left there by a killed server
//! are removed by a later export. Its modification time is the end of the run: the same run has the same entity tag each
//! time, so that an interrupted download can be resumed.

use crate::App;
use crate::access::Caller;
use crate::clock::now_ms;
use crate::problem::Problem;
use axum::extract::rejection::{PathRejection, QueryRejection};
use axum::extract::{Path, Query, Request, State};
use axum::http::{HeaderValue, header};
use axum::response::Response;
use rotortwin_store::export::{self, ExportFormat};
use rotortwin_store::files::TELEMETRY_FILE;
use rotortwin_store::query::QueryError;
use serde::Deserialize;
use std::fs::File;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, SystemTime};
use utoipa::{IntoParams, ToSchema};

/// No export takes this long: older files were left by a server that died.
const LEFT_BEHIND_MS: i64 = 3_600_000;

/// What to write.
#[derive(Debug, Clone, Copy, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum ExportName {
    /// PX4's log format: Flight Review, PlotJuggler, pyulog.
    Ulog,
    /// Foxglove, Lichtblick.
    Mcap,
    /// pandas, Polars, DuckDB.
    Parquet,
    /// Everything else.
    Csv,
}

impl From<ExportName> for ExportFormat {
    fn from(name: ExportName) -> Self {
        match name {
            ExportName::Ulog => Self::Ulog,
            ExportName::Mcap => Self::Mcap,
            ExportName::Parquet => Self::Parquet,
            ExportName::Csv => Self::Csv,
        }
    }
}

/// Which format.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub(crate) struct ExportQuery {
    /// What to write.
    #[param(inline)]
    format: ExportName,
}

/// A file that is removed when this is dropped; who has it open can still read it.
struct Unnamed(PathBuf);

impl Drop for Unnamed {
    fn drop(&mut self) {
        if let Err(error) = std::fs::remove_file(&self.0) {
            tracing::warn!(path = %self.0.display(), %error, "an export cannot be removed");
        }
    }
}

/// The whole run as one file; with range requests. The same run gives the same bytes each time.
#[utoipa::path(get, path = "/api/v1/runs/{id}/export", tag = "telemetry", operation_id = "export_run", params(("id" = String, Path), ExportQuery), responses(
    (status = 200, description = "the file", content(
        (Vec<u8> = "application/octet-stream"), (Vec<u8> = "application/vnd.apache.parquet"), (String = "text/csv"))),
    (status = 206, description = "the requested range", content(
        (Vec<u8> = "application/octet-stream"), (Vec<u8> = "application/vnd.apache.parquet"), (String = "text/csv"))),
    (status = 400, description = "unknown format", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "run not found, or it recorded nothing", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "the run has not ended", body = Problem, content_type = "application/problem+json"),
    (status = 412, description = "`If-Match` or `If-Unmodified-Since` does not hold", body = Problem, content_type = "application/problem+json"),
    (status = 416, description = "range not satisfiable", body = Problem, content_type = "application/problem+json"),
    (status = 507, description = "disk full", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn export(
    State(app): State<Arc<App>>,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
    query: Result<Query<ExportQuery>, QueryRejection>,
    request: Request,
) -> Result<Response, Problem> {
    let Query(query) = query?;
    let format = ExportFormat::from(query.format);
    let run = super::runs::find(&app, &caller, id).await?;
    let source = super::telemetry::file_of(&app, &run, format.file().unwrap_or(TELEMETRY_FILE)).await?;
    // Removed when this function is left; the answer has the file open by then.
    let made = match format.file() {
        Some(_) => None,
        None => {
            let ended =
                SystemTime::UNIX_EPOCH + Duration::from_millis(run.finished_ms.unwrap_or_default().unsigned_abs());
            Some(write(&app, source.clone(), format, ended).await?)
        }
    };
    let path = made.as_ref().map_or(&source, |Unnamed(path)| path);
    let mut response = super::artifacts::serve(path, request, None).await?;
    if response.status().is_success() {
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(format.content_type()));
        let disposition = format!("attachment; filename=\"{}.{}\"", run.id, format.extension());
        if let Ok(value) = HeaderValue::from_str(&disposition) {
            headers.insert(header::CONTENT_DISPOSITION, value);
        }
    }
    Ok(response)
}

/// * `ended`: the time of the file
async fn write(app: &App, source: PathBuf, format: ExportFormat, ended: SystemTime) -> Result<Unnamed, Problem> {
    static NUMBER: AtomicU64 = AtomicU64::new(0);
    let folder = app.artifacts.place("exports");
    let now_ms = now_ms();
    // The time stands first, for `remove_old`.
    let name = format!(
        "{now_ms}-{}-{}",
        std::process::id(),
        NUMBER.fetch_add(1, Ordering::Relaxed)
    );
    let written = super::telemetry::blocking(move || {
        let io = |path: PathBuf| move |source| QueryError::Io { path, source };
        std::fs::create_dir_all(&folder).map_err(io(folder.clone()))?;
        remove_old(&folder, now_ms);
        let path = folder.join(name);
        let file = File::create_new(&path).map_err(io(path.clone()))?;
        let made = Unnamed(path);
        match export::export(&source, format, &file) {
            Err(QueryError::Output { source }) if source.kind() == std::io::ErrorKind::StorageFull => Ok(None),
            Err(error) => Err(error),
            Ok(()) => {
                file.set_modified(ended).map_err(io(made.0.clone()))?;
                Ok(Some(made))
            }
        }
    });
    written
        .await?
        .ok_or_else(|| Problem::disk_full("the export cannot be written: the disk of the data folder is full"))
}

fn remove_old(folder: &std::path::Path, now_ms: i64) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    for entry in entries.filter_map(Result::ok) {
        let name = entry.file_name();
        let began_ms: Option<i64> = name.to_str().and_then(|name| name.split('-').next()?.parse().ok());
        if began_ms.is_none_or(|began_ms| now_ms - began_ms > LEFT_BEHIND_MS) {
            drop(Unnamed(entry.path()));
        }
    }
}
