//! Telemetry of runs that have ended: channels, intervals, as many rows as a plot needs.
//!
//! The files are read and decoded on separate threads, at most [`AT_ONCE`] queries at a time.

use crate::App;
use crate::access::Caller;
use crate::jobs::Job;
use crate::problem::Problem;
use axum::Json;
use axum::extract::rejection::{PathRejection, QueryRejection};
use axum::extract::{Path, Query, State};
use axum::http::{HeaderMap, header};
use axum::response::{IntoResponse, Response};
use rotortwin_store::files::TELEMETRY_FILE;
use rotortwin_store::query::{
    self, ChannelKind, DEFAULT_POINTS, Format, MOST_VALUES, QueryError, TelemetryFile, render::RunTable,
};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::sync::Arc;
use tokio::sync::Semaphore;
use utoipa::{IntoParams, ToSchema};

/// Queries that are answered at the same time; others wait.
const AT_ONCE: usize = 4;
/// Runs of one comparison.
const MOST_RUNS: usize = 100;

static QUERIES: Semaphore = Semaphore::const_new(AT_ONCE);

/// Format of a response.
#[derive(Debug, Clone, Copy, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum AnswerFormat {
    /// `units` and `data` by channel; no value is `null`.
    Json,
    /// A header line, then a line a row; no value is an empty cell.
    Csv,
    /// For pandas, Polars, DuckDB; no value is NaN.
    Parquet,
}

impl AnswerFormat {
    /// The format requested by name, or by `Accept`; JSON otherwise.
    pub(super) fn of(named: Option<Self>, headers: &HeaderMap) -> Format {
        let accept = headers.get(header::ACCEPT).and_then(|value| value.to_str().ok());
        match (named, accept) {
            (Some(Self::Json), _) => Format::Json,
            (Some(Self::Csv), _) => Format::Csv,
            (Some(Self::Parquet), _) => Format::Parquet,
            (None, Some(accept)) if accept.starts_with("text/csv") => Format::Csv,
            (None, Some(accept)) if accept.starts_with("application/vnd.apache.parquet") => Format::Parquet,
            (None, _) => Format::Json,
        }
    }
}

/// A channel of a run.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct ChannelInfo {
    /// Name, unique in the run.
    name: String,
    /// Unit as written for people (`m/s`); `1` for fractions and codes.
    unit: String,
    /// What it means.
    description: String,
    /// `f64`, `f32`, `i32`, `i64`, `bool`; `text` and `other` cannot be requested.
    #[schema(value_type = String)]
    kind: ChannelKind,
}

/// Channels of a run.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Channels {
    /// Number of samples of each.
    rows: u64,
    /// In the order of the file.
    items: Vec<ChannelInfo>,
}

impl From<query::Channel> for ChannelInfo {
    fn from(channel: query::Channel) -> Self {
        Self {
            name: channel.name,
            unit: channel.unit,
            description: channel.description,
            kind: channel.kind,
        }
    }
}

impl Channels {
    pub(super) fn new(rows: u64, items: Vec<ChannelInfo>) -> Self {
        Self { rows, items }
    }
}

/// What a run recorded.
#[utoipa::path(get, path = "/api/v1/runs/{id}/channels", tag = "telemetry", operation_id = "run_channels", params(("id" = String, Path)), responses(
    (status = 200, description = "the channels", body = Channels),
    (status = 400, description = "invalid id", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "run not found, or it recorded nothing", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "the run has not ended", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn channels(
    State(app): State<Arc<App>>,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
) -> Result<Json<Channels>, Problem> {
    let run = super::runs::find(&app, &caller, id).await?;
    let path = file_of(&app, &run, TELEMETRY_FILE).await?;
    let answer = blocking(move || {
        let file = TelemetryFile::open(&path)?;
        let items = file.channels().iter().cloned().map(ChannelInfo::from);
        Ok(Channels::new(file.rows(), items.collect()))
    });
    Ok(Json(answer.await?))
}

/// Which channels, when, and how many rows.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub(crate) struct Selection {
    /// Comma-separated names; one `*` per name matches anything (`duty_*`). The time is always included.
    #[param(example = "roll_rad,duty_*")]
    channels: String,
    /// Start of the interval, s; default: the start of the flight.
    from_s: Option<f64>,
    /// End of the interval, s; default: the end of the flight.
    to_s: Option<f64>,
    /// Maximum number of rows, at least 2; default 2000. If the interval has more, each pair of rows represents a bucket of samples: its smallest and
    /// largest value in the order in which they occurred.
    #[param(minimum = 2)]
    points: Option<usize>,
    /// Default: as `Accept` says, or JSON.
    #[param(inline)]
    format: Option<AnswerFormat>,
}

impl Selection {
    pub(super) fn format(&self) -> Option<AnswerFormat> {
        self.format
    }

    pub(super) fn query(&self) -> query::Query {
        query::Query {
            channels: names(&self.channels),
            from_s: self.from_s,
            to_s: self.to_s,
            points: self.points.unwrap_or(DEFAULT_POINTS),
        }
    }
}

pub(super) fn names(list: &str) -> Vec<String> {
    let names = list.split(',').map(str::trim).filter(|name| !name.is_empty());
    names.map(str::to_owned).collect()
}

/// Samples of one run.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Telemetry {
    /// Id of the run.
    run: String,
    /// Samples in the interval.
    source_rows: u64,
    /// Number of rows.
    rows: u64,
    /// True if the samples were decimated.
    decimated: bool,
    /// Unit by channel.
    #[schema(value_type = BTreeMap<String, String>)]
    units: serde_json::Value,
    /// Values by channel, `time_s` first; `null`: no value.
    #[schema(value_type = BTreeMap<String, Vec<Option<f64>>>)]
    data: serde_json::Value,
}

/// Samples of several runs.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct ManyTelemetry {
    /// In the order in which the runs were named.
    items: Vec<Telemetry>,
}

/// Samples of a run, decimated so that a plot looks the same.
#[utoipa::path(get, path = "/api/v1/runs/{id}/telemetry", tag = "telemetry", operation_id = "run_telemetry", params(("id" = String, Path), Selection), responses(
    (status = 200, description = "the samples", content(
        (Telemetry = "application/json"), (String = "text/csv"), (Vec<u8> = "application/vnd.apache.parquet"))),
    (status = 400, description = "invalid parameter", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "run not found, or it recorded nothing", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "the run has not ended", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "unknown channel, empty interval, or too many values", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn telemetry(
    State(app): State<Arc<App>>,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
    selection: Result<Query<Selection>, QueryRejection>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let Query(selection) = selection?;
    let run = super::runs::find(&app, &caller, id).await?;
    let path = file_of(&app, &run, TELEMETRY_FILE).await?;
    let format = AnswerFormat::of(selection.format, &headers);
    let body = blocking(move || {
        let table = TelemetryFile::open(&path)?.query(&selection.query())?;
        query::render::one(&RunTable { run: run.id, table }, format)
    });
    Ok(([(header::CONTENT_TYPE, format.content_type())], body.await?).into_response())
}

/// Which runs.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub(crate) struct Runs {
    /// Comma-separated ids, at most 100.
    runs: String,
}

/// The same channels of several runs, for comparison: in JSON one object per run, in CSV and Parquet a first
/// column `run`.
#[utoipa::path(get, path = "/api/v1/telemetry", tag = "telemetry", operation_id = "compare_telemetry", params(Runs, Selection), responses(
    (status = 200, description = "the samples", content(
        (ManyTelemetry = "application/json"), (String = "text/csv"), (Vec<u8> = "application/vnd.apache.parquet"))),
    (status = 400, description = "invalid parameter", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "run not found, or it recorded nothing", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "one of the runs has not ended", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "unknown channel, empty interval, or too many runs or values", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn compare(
    State(app): State<Arc<App>>,
    caller: Caller,
    runs: Result<Query<Runs>, QueryRejection>,
    selection: Result<Query<Selection>, QueryRejection>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let (Query(runs), Query(selection)) = (runs?, selection?);
    let ids = names(&runs.runs);
    if ids.is_empty() || ids.len() > MOST_RUNS {
        return Err(Problem::unprocessable(format!(
            "`runs` names {} runs; expected 1 to {MOST_RUNS}",
            ids.len()
        )));
    }
    let mut files = Vec::with_capacity(ids.len());
    for id in ids {
        let run = super::runs::find(&app, &caller, Ok(Path(id))).await?;
        let path = file_of(&app, &run, TELEMETRY_FILE).await?;
        files.push((run.id, path));
    }
    let format = AnswerFormat::of(selection.format, &headers);
    let body = blocking(move || {
        let query = selection.query();
        let (mut tables, mut values) = (Vec::with_capacity(files.len()), 0);
        for (run, path) in files {
            let table = TelemetryFile::open(&path)?.query(&query)?;
            values += (table.rows() * table.columns.len()) as u64;
            if values > MOST_VALUES {
                return Err(QueryError::TooMany { values });
            }
            tables.push(RunTable { run, table });
        }
        query::render::several(&tables, format)
    });
    Ok(([(header::CONTENT_TYPE, format.content_type())], body.await?).into_response())
}

/// Where a file of a run that has ended is.
pub(super) async fn file_of(app: &App, run: &Job, name: &str) -> Result<PathBuf, Problem> {
    if !run.status.is_final() {
        return Err(Problem::conflict(format!(
            "run {} is {}; its {name} is available once it has ended",
            run.id,
            run.status.as_str()
        )));
    }
    let missing = || Problem::not_found(format!("run {} ended without {name}", run.id));
    let folder = run.folder.as_ref().ok_or_else(missing)?;
    let file = app
        .artifacts
        .file(folder, name)
        .await
        .map_err(|error| Problem::of_files(&error))?;
    file.ok_or_else(missing)
}

/// Reads files outside the threads that serve, not too many at the same time.
pub(super) async fn blocking<T: Send + 'static>(
    work: impl FnOnce() -> Result<T, QueryError> + Send + 'static,
) -> Result<T, Problem> {
    let permit = QUERIES.acquire().await.map_err(|error| Problem::internal(&error))?;
    let done = tokio::task::spawn_blocking(move || {
        let result = work();
        drop(permit);
        result
    });
    done.await.map_err(|error| Problem::internal(&error))?.map_err(|error| {
        if error.is_of_the_file() {
            Problem::of_files(&error)
        } else {
            Problem::unprocessable(error.to_string())
        }
    })
}
