//! How the server is: health, readiness, metrics, the OpenAPI document.

use crate::App;
use crate::problem::Problem;
use axum::extract::State;
use axum::http::header;
use axum::response::IntoResponse;
use std::fmt::Write as _;
use std::io::Write as _;
use std::sync::Arc;

/// Longest wait for the store of files.
const STORE_PATIENCE: std::time::Duration = std::time::Duration::from_secs(3);

/// The process lives.
#[utoipa::path(get, path = "/healthz", tag = "server", responses((status = 200, description = "alive", body = String)))]
pub(crate) async fn healthz() -> &'static str {
    "alive\n"
}

/// Database and store of files answer, the disk has room, and runs are accepted.
#[utoipa::path(get, path = "/readyz", tag = "server", responses(
    (status = 200, description = "ready", body = String),
    (status = 503, description = "the server ends, its disk is full, or its database or store of files does not answer", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn readyz(State(app): State<Arc<App>>) -> Result<&'static str, Problem> {
    if app.is_ending() {
        return Err(Problem::unavailable("the server is ending"));
    }
    app.database
        .ping()
        .await
        .map_err(|error| Problem::unavailable(format!("the database does not answer: {error}")))?;
    let data = app.config.work.data.clone();
    let written = tokio::task::spawn_blocking(move || has_room(&data)).await;
    written
        .map_err(|error| Problem::internal(&error))?
        .map_err(|error| Problem::unavailable(format!("nothing can be written to the data folder: {error}")))?;
    match tokio::time::timeout(STORE_PATIENCE, app.artifacts.ping()).await {
        Ok(Ok(())) => Ok("ready\n"),
        Ok(Err(error)) => Err(Problem::unavailable(format!(
            "the store of files does not answer: {error}"
        ))),
        Err(_) => Err(Problem::unavailable(format!(
            "the store of files does not answer within {} s",
            STORE_PATIENCE.as_secs()
        ))),
    }
}

/// Whether a submission would find room on the disk of the data folder.
fn has_room(data: &std::path::Path) -> std::io::Result<()> {
    /// About what one takes, with the log of the database.
    const A_SUBMISSION: usize = 256 << 10;
    let mut file = tempfile::tempfile_in(data)?;
    file.write_all(&vec![1; A_SUBMISSION])?;
    file.sync_data()
}

/// Numbers for Prometheus.
#[utoipa::path(get, path = "/metrics", tag = "server", responses((status = 200, description = "Prometheus text format", body = String)))]
pub(crate) async fn metrics(State(app): State<Arc<App>>) -> Result<impl IntoResponse, Problem> {
    let mut text = String::from("# HELP rotortwin_jobs Jobs by kind and state.\n# TYPE rotortwin_jobs gauge\n");
    for (kind, status, count) in app.database.count().await? {
        writeln!(text, "rotortwin_jobs{{kind=\"{kind}\",status=\"{status}\"}} {count}")
            .map_err(|error| Problem::internal(&error))?;
    }
    let workers = app.config.work.workers;
    write!(
        text,
        "# HELP rotortwin_workers Jobs that this process does at the same time at most.\n# TYPE rotortwin_workers gauge\nrotortwin_workers {workers}\n"
    )
    .map_err(|error| Problem::internal(&error))?;
    Ok(([(header::CONTENT_TYPE, "text/plain; version=0.0.4")], text))
}

/// The OpenAPI document.
pub(crate) async fn openapi() -> impl IntoResponse {
    ([(header::CONTENT_TYPE, "application/json")], super::openapi_document())
}
