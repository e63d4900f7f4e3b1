//! How the server is: health, readiness, metrics, the front page.

use crate::App;
use crate::access::Caller;
use crate::jobs::JobKind;
use crate::jobs::store::Filter;
use crate::problem::Problem;
use axum::extract::State;
use axum::http::header;
use axum::response::{Html, IntoResponse};
use std::fmt::Write as _;
use std::sync::Arc;

/// Longest wait for the store of files.
const STORE_PATIENCE: std::time::Duration = std::time::Duration::from_secs(3);

/// The process lives.
#[utoipa::path(get, path = "/healthz", tag = "server", responses((status = 200, description = "alive", body = String)))]
pub(crate) async fn healthz() -> &'static str {
    "alive\n"
}

/// Database and store of files answer, and runs are accepted.
#[utoipa::path(get, path = "/readyz", tag = "server", responses(
    (status = 200, description = "ready", body = String),
    (status = 503, description = "the server ends, or its database or store of files does not answer", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn readyz(State(app): State<Arc<App>>) -> Result<&'static str, Problem> {
    if app.is_ending() {
        return Err(Problem::unavailable("the server is ending"));
    }
    app.database
        .ping()
        .await
        .map_err(|error| Problem::unavailable(format!("the database does not answer: {error}")))?;
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

/// A list of the runs, for people: each with its report.
pub(crate) async fn front(State(app): State<Arc<App>>, caller: Caller) -> Result<Html<String>, Problem> {
    let escape = |text: &str| text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;");
    let mut rows = String::new();
    let filter = Filter {
        kind: Some(JobKind::Run),
        tenant: caller.tenant_filter(),
        ..Filter::default()
    };
    for run in app.database.list(&filter, 100).await? {
        let facts: serde_json::Value = serde_json::from_str(&run.new.facts).unwrap_or_default();
        let fact = |key: &str| escape(facts[key].as_str().unwrap_or_default());
        let name = escape(&run.new.name);
        let (id, status) = (&run.id, run.status.as_str());
        let name = if run.bytes > 0 {
            format!("<a href=\"/api/v1/runs/{id}/artifacts/report.html\">{name}</a>")
        } else {
            name
        };
        let note = escape(run.error.as_deref().or(run.run_hash.as_deref()).unwrap_or(""));
        write!(
            rows,
            "<tr><td>{name}<td>{}<td>{}<td class={status}>{status}<td><a href=\"/api/v1/runs/{id}\">{id}</a><td>{note}</tr>",
            fact("vehicle"),
            fact("seed")
        )
        .map_err(|error| Problem::internal(&error))?;
    }
    if rows.is_empty() {
        rows.push_str("<tr><td colspan=6>No run yet: POST /api/v1/runs {\"scenario\": \"reference-flight\"}</tr>");
    }
    Ok(Html(FRONT.replace("@ROWS@", &rows)))
}

const FRONT: &str = r#"<!doctype html><html lang="en"><meta charset="utf-8"><title>rotortwin</title>
<meta name="viewport" content="width=device-width"><style>
:root { color-scheme: light dark; font: 15px/1.5 system-ui, sans-serif }
body { max-width: 70rem; margin: 2rem auto; padding: 0 1rem }
table { border-collapse: collapse; width: 100% } td, th { text-align: left; padding: .3rem .8rem .3rem 0; border-bottom: 1px solid #8884 }
td:nth-child(5), td:nth-child(6) { font: 12px ui-monospace, monospace } .done { color: #1a7f37 } .failed { color: #cf222e } .running { color: #0969da }
</style><h1>rotortwin</h1>
<p><a href="/api/v1/docs">API</a> · <a href="/api/v1/scenarios">scenarios</a> · <a href="/api/v1/vehicles">vehicles</a> · <a href="/metrics">metrics</a></p>
<table><tr><th>Run<th>Vehicle<th>Seed<th>State<th>Id<th>Run hash or reason</tr>@ROWS@</table></html>
"#;

/// The OpenAPI document.
pub(crate) async fn openapi() -> impl IntoResponse {
    ([(header::CONTENT_TYPE, "application/json")], super::openapi_document())
}
