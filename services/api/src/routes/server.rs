//! State of the server: health, readiness, metrics, the OpenAPI document.

use crate::App;
use crate::access::Caller;
use crate::memory::Heap;
use crate::problem::Problem;
use axum::Json;
use axum::extract::rejection::QueryRejection;
use axum::extract::{Query, State};
use axum::http::header;
use axum::response::IntoResponse;
use serde::{Deserialize, Serialize};
use std::fmt::Write as _;
use std::io::Write as _;
use std::sync::{Arc, LazyLock};
use utoipa::{IntoParams, ToSchema};

/// Longest wait for the store of files.
const STORE_TIMEOUT: std::time::Duration = std::time::Duration::from_secs(3);

/// The process is alive.
#[utoipa::path(get, path = "/healthz", tag = "server", responses((status = 200, description = "alive", body = String)))]
pub(crate) async fn healthz() -> &'static str {
    "alive\n"
}

/// The database and the file store respond, the disk has room, and runs are accepted.
#[utoipa::path(get, path = "/readyz", tag = "server", responses(
    (status = 200, description = "ready", body = String),
    (status = 503, description = "the server is shutting down, its disk is full, or its database or file store does not respond", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn readyz(State(app): State<Arc<App>>) -> Result<String, Problem> {
    if app.is_ending() {
        return Err(Problem::unavailable("the server is ending"));
    }
    app.database
        .ping()
        .await
        .map_err(|error| Problem::unavailable(format!("the database does not respond: {error}")))?;
    let data = app.config.work.data.clone();
    let written = tokio::task::spawn_blocking(move || has_room(&data)).await;
    written
        .map_err(|error| Problem::internal(&error))?
        .map_err(|error| Problem::unavailable(format!("the data folder is not writable: {error}")))?;
    if !app.artifacts.has_room() {
        return Err(Problem::unavailable(
            "the disk of the jobs' files is full: no worker begins a job there until it has room",
        ));
    }
    match tokio::time::timeout(STORE_TIMEOUT, app.artifacts.ping()).await {
        // A cluster that does not answer keeps only parts waiting, and their nodes have to find this server all the same.
        Ok(Ok(())) => Ok(match &app.context.ray {
            None => "ready\n".to_owned(),
            Some(ray) => format!("ready\n{}\n", ray.in_short()),
        }),
        Ok(Err(error)) => Err(Problem::unavailable(format!(
            "the file store does not respond: {error}"
        ))),
        Err(_) => Err(Problem::unavailable(format!(
            "the file store does not respond within {} s",
            STORE_TIMEOUT.as_secs()
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

/// Limits and usage of the caller's tenant.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Limits {
    /// Maximum size of an uploaded flight log, bytes.
    largest_log: u64,
    /// Maximum size of a flight log that is judged directly and not stored, bytes.
    largest_judged_log: u64,
    /// Maximum size of all files, bytes.
    most_bytes: u64,
    /// Current size of all files, bytes.
    bytes: i64,
    /// Maximum number of queued and running jobs.
    most_open_jobs: u32,
    /// Jobs queued or running now.
    open_jobs: i64,
    /// Longest flight, s of simulated time.
    longest_flight_s: f64,
}

/// Limits of this server, so that clients can check before sending.
#[utoipa::path(get, path = "/api/v1/limits", tag = "server", operation_id = "limits", responses(
    (status = 200, description = "of the caller's tenant", body = Limits)
))]
pub(crate) async fn limits(State(app): State<Arc<App>>, caller: Caller) -> Result<Json<Limits>, Problem> {
    let (open_jobs, bytes) = app.database.account(&caller.tenant).await?;
    Ok(Json(Limits {
        largest_log: app.config.largest_upload,
        largest_judged_log: super::fdi_reports::LARGEST_LOG,
        most_bytes: app.config.most_bytes,
        bytes,
        most_open_jobs: app.config.most_open,
        open_jobs,
        longest_flight_s: app.config.longest_flight_s,
    }))
}

/// What is counted beside the rest.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(crate) struct Counted {
    /// Include open jobs by tenant; requires a token that sees the jobs of all tenants.
    #[serde(default)]
    tenants: bool,
}

/// Metrics for Prometheus: jobs, the age of the queue, and request durations.
#[utoipa::path(get, path = "/metrics", tag = "server", params(Counted), responses(
    (status = 200, description = "Prometheus text format", body = String),
    (status = 400, description = "malformed request", body = Problem, content_type = "application/problem+json"),
    (status = 403, description = "`tenants` requires a token that sees the jobs of all tenants", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn metrics(
    State(app): State<Arc<App>>,
    caller: Caller,
    counted: Result<Query<Counted>, QueryRejection>,
) -> Result<impl IntoResponse, Problem> {
    let Query(counted) = counted?;
    if counted.tenants && !caller.sees_all {
        return Err(Problem::forbidden(
            "`tenants` shows other tenants; expected a token that sees the jobs of all tenants",
        ));
    }
    let jobs = app.database.count().await?;
    let oldest = app.database.age_of_oldest_queued().await?;
    let queue_age_s = oldest.map_or(0.0, |ms| ms.max(0) as f64 / 1000.0);
    let by_tenant = if counted.tenants {
        app.database.count_open_by_tenant().await?
    } else {
        Vec::new()
    };
    let text = numbers(&app, &jobs, queue_age_s, &by_tenant).map_err(|error| Problem::internal(&error))?;
    Ok(([(header::CONTENT_TYPE, "text/plain; version=0.0.4")], text))
}

/// As Prometheus reads them.
fn numbers(
    app: &App,
    jobs: &[(String, String, i64)],
    queue_age_s: f64,
    by_tenant: &[(String, String, i64)],
) -> Result<String, std::fmt::Error> {
    let mut text = String::from("# HELP rotortwin_jobs Jobs by kind and state.\n# TYPE rotortwin_jobs gauge\n");
    for (kind, status, count) in jobs {
        writeln!(text, "rotortwin_jobs{{kind=\"{kind}\",status=\"{status}\"}} {count}")?;
    }
    if !by_tenant.is_empty() {
        text += "# HELP rotortwin_tenant_jobs Open jobs by tenant and state.\n# TYPE rotortwin_tenant_jobs gauge\n";
    }
    for (tenant, status, count) in by_tenant {
        let tenant = tenant.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n");
        writeln!(
            text,
            "rotortwin_tenant_jobs{{tenant=\"{tenant}\",status=\"{status}\"}} {count}"
        )?;
    }
    let workers = app.config.work.workers;
    writeln!(
        text,
        "# HELP rotortwin_queue_age_seconds Age of the oldest queued job, in seconds.\n\
         # TYPE rotortwin_queue_age_seconds gauge\nrotortwin_queue_age_seconds {queue_age_s}\n\
         # HELP rotortwin_workers Maximum number of jobs that this process does at the same time.\n\
         # TYPE rotortwin_workers gauge\nrotortwin_workers {workers}"
    )?;
    if let Some(heap) = crate::memory::heap() {
        let Heap { used, kept } = heap;
        writeln!(
            text,
            "# HELP rotortwin_heap_bytes Memory that is in use, and that was freed and not yet returned to the system.\n\
             # TYPE rotortwin_heap_bytes gauge\n\
             rotortwin_heap_bytes{{state=\"used\"}} {used}\nrotortwin_heap_bytes{{state=\"kept\"}} {kept}"
        )?;
    }
    if let Some(ray) = &app.context.ray {
        let (pending, running) = ray.parts();
        let up = u8::from(ray.is_up());
        writeln!(
            text,
            "# HELP rotortwin_ray_up Whether the Ray cluster answered the last request.\n# TYPE rotortwin_ray_up gauge\n\
             rotortwin_ray_up {up}\n\
             # HELP rotortwin_ray_parts Parts submitted to Ray and supervised by this server.\n# TYPE rotortwin_ray_parts gauge\n\
             rotortwin_ray_parts{{state=\"pending\"}} {pending}\nrotortwin_ray_parts{{state=\"running\"}} {running}"
        )?;
    }
    text += &app.metrics.text()?;
    Ok(text)
}

/// The OpenAPI document.
pub(crate) async fn openapi() -> impl IntoResponse {
    /// Half a megabyte of text, from several of parts.
    static DOCUMENT: LazyLock<String> = LazyLock::new(super::openapi_document);
    ([(header::CONTENT_TYPE, "application/json")], DOCUMENT.as_str())
}
