//! SQL over the files of jobs, while the caller waits: answered by a process of `rotortwin query`, which can read those
//! files and no others.

use super::jobs::Shared;
use crate::App;
use crate::access::Caller;
use crate::json_object::JsonObject;
use crate::problem::Problem;
use crate::worker::answer::{Patience, Said, json};
use axum::response::Response;
use rotortwin_jobs::{JobKind, Question, SqlQuestion};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::time::Duration;
use utoipa::ToSchema;

/// Jobs that one query may be about.
const MOST_JOBS: usize = 1000;
/// Bytes of their Parquet files, which a server with a bucket fetches first.
const MOST_BYTES: u64 = 16 << 30;
/// Rows of an answer, at most, and where nothing is said.
const MOST_ROWS: u32 = 100_000;
const USUAL_ROWS: u32 = 1000;
/// Longest statement, bytes.
const LONGEST_SQL: usize = 100_000;
/// Longest answer, bytes.
const LONGEST_ANSWER: u64 = 32 << 20;
/// Longest wait for those that came before.
const QUEUE_TIMEOUT: Duration = Duration::from_secs(30);
/// Most that a query puts onto the disk, MB.
const MOST_SPILLED_MB: u64 = 4000;
/// Memory that a query may use in addition to Python's own, MB, if jobs may use four times as much.
const MEMORY_MB: u64 = 512;
/// Threads of a query.
const THREADS: u16 = 2;
/// How the sentence begins that says that this host has no engine (`MISSING` of the command).
const NO_ENGINE: &str = "SQL over results needs";
/// How the sentences begin that say that it took too long, or more memory than it may.
const TOO_LONG: &str = "the query exceeded";
const TOO_LARGE: &str = "the query process ended without a result";

/// A query, and the jobs whose files it reads.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct SqlQuery {
    /// One SELECT in DuckDB's SQL. Files of the same name form a table of that name, such as `telemetry` of runs and
    /// `campaign` of campaigns, in which the column `folder` begins with the id of the job.
    #[schema(max_length = 100_000)]
    sql: String,
    /// Ids of runs.
    #[serde(default)]
    runs: Vec<String>,
    /// Ids of campaigns.
    #[serde(default)]
    campaigns: Vec<String>,
    /// Ids of blind benches.
    #[serde(default)]
    blind_benches: Vec<String>,
    /// Maximum number of rows in the result.
    #[schema(minimum = 1, maximum = 100_000, default = 1000)]
    rows: Option<u32>,
}

/// A column of a result.
#[derive(Debug, Serialize, Deserialize, ToSchema)]
pub(crate) struct QueryColumn {
    name: String,
    /// DuckDB's type: `DOUBLE`, `BIGINT`, `VARCHAR`, …
    #[serde(rename = "type")]
    kind: String,
}

/// The result of a query, as `rotortwin query --json` writes it: `rows[i][j]` belongs to `columns[j]`.
#[derive(Debug, Serialize, Deserialize, ToSchema)]
pub(crate) struct QueryAnswer {
    columns: Vec<QueryColumn>,
    /// Numbers, booleans, strings, lists, objects; null: no value, or not a number. Types that JSON lacks are
    /// strings.
    #[schema(value_type = Vec<Vec<serde_json::Value>>)]
    rows: Vec<Vec<Value>>,
    /// True if there are more rows than these.
    more: bool,
}

/// Runs an SQL query over the Parquet files of done jobs: at most 30 s (`--query-time`) and 32 MiB.
#[utoipa::path(post, path = "/api/v1/queries", tag = "queries", operation_id = "query", request_body = SqlQuery, responses(
    (status = 200, description = "the result", body = QueryAnswer),
    (status = 400, description = "invalid body", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "job not found", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "one of the jobs is not done", body = Problem, content_type = "application/problem+json"),
    (status = 413, description = "limit exceeded", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "invalid SQL, or a query beyond the limits", body = Problem, content_type = "application/problem+json"),
    (status = 501, description = "this server has no SQL engine", body = Problem, content_type = "application/problem+json"),
    (status = 503, description = "too many queries at the same time", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn query(
    app: Shared,
    caller: Caller,
    body: Result<JsonObject<SqlQuery>, Problem>,
) -> Result<Response, Problem> {
    let JsonObject(query) = body?;
    let rows = query.rows.unwrap_or(USUAL_ROWS);
    if !(1..=MOST_ROWS).contains(&rows) {
        return Err(Problem::unprocessable(format!(
            "`rows` is {rows}; expected 1 to {MOST_ROWS}"
        )));
    }
    if query.sql.len() > LONGEST_SQL || query.sql.contains('\0') {
        return Err(Problem::unprocessable(format!(
            "`sql` has {} bytes; expected at most {LONGEST_SQL}, and none of them zero",
            query.sql.len()
        )));
    }
    let folders = folders(&app, &caller, &query).await?;
    let turn = tokio::time::timeout(QUEUE_TIMEOUT, app.queries.acquire()).await;
    let Ok(Ok(_turn)) = turn else {
        return Err(Problem::unavailable("too many queries at the same time; retry later"));
    };
    let longest = app.config.query_time;
    let memory = MEMORY_MB.min(app.config.work.job_memory / 4_000_000).max(16);
    let question = Question::Sql(SqlQuestion {
        sql: query.sql,
        sources: folders,
        rows: Some(u64::from(rows)),
        most_bytes: Some(LONGEST_ANSWER),
        memory_mb: memory,
        most_spilled_mb: MOST_SPILLED_MB,
        time_s: longest.as_secs(),
        threads: Some(THREADS),
    });
    let patience = Patience {
        memory: app.config.work.job_memory,
        // The command itself says it first.
        wall: longest + Duration::from_secs(10),
    };
    // Below the root, where paths are keys: the engine's messages about files reveal nothing about this host.
    let root = app.artifacts.place("");
    let said = Said::to(&app.config.work.program, &question, patience, Some(&root)).await?;
    let complaint = said.complaint();
    if complaint.starts_with(NO_ENGINE) {
        return Err(Problem::not_implemented(format!("on this server: {complaint}")));
    }
    if complaint.starts_with(TOO_LONG) {
        return Err(Problem::unprocessable(format!(
            "the query exceeded {} s and was stopped; expected a smaller query (`--query-time`)",
            longest.as_secs()
        )));
    }
    if complaint.starts_with(TOO_LARGE) {
        return Err(Problem::unprocessable(format!(
            "the query ended without a result; expected one that needs less than {memory} MB of memory"
        )));
    }
    // As it is: 32 MiB of JSON as values would be several times as much memory of this process.
    said.answer(patience).map(json)
}

/// Id and key of each job, whose Parquet files are local files after this.
async fn folders(app: &App, caller: &Caller, query: &SqlQuery) -> Result<Vec<(String, String)>, Problem> {
    let kinds = [
        (JobKind::Run, &query.runs),
        (JobKind::Campaign, &query.campaigns),
        (JobKind::BlindBench, &query.blind_benches),
    ];
    let count: usize = kinds.iter().map(|(_, ids)| ids.len()).sum();
    if count == 0 || count > MOST_JOBS {
        return Err(Problem::unprocessable(format!(
            "{count} jobs in `runs`, `campaigns` and `blind_benches`; expected 1 to {MOST_JOBS}"
        )));
    }
    let mut folders = Vec::new();
    let mut size = 0;
    for (kind, ids) in kinds {
        for id in ids {
            let job = super::tasks::done(app, caller, kind, id).await?;
            let key = job.folder.unwrap_or_default();
            let files = app
                .artifacts
                .list(&key)
                .await
                .map_err(|error| Problem::internal(&error))?;
            let tables: Vec<_> = files
                .into_iter()
                .filter(|file| file.path.ends_with(".parquet"))
                .collect();
            if tables.is_empty() {
                return Err(Problem::unprocessable(format!(
                    "the {} {id} has no Parquet files",
                    kind.as_str()
                )));
            }
            size += tables.iter().map(|file| file.size).sum::<u64>();
            if size > MOST_BYTES {
                return Err(Problem::too_large(format!(
                    "the files of these jobs have more than {} GiB; expected fewer jobs",
                    MOST_BYTES >> 30
                )));
            }
            for file in tables {
                let there = app.artifacts.file(&key, &file.path).await;
                if there.map_err(|error| Problem::internal(&error))?.is_none() {
                    return Err(Problem::not_found(format!("{} of {id} is gone", file.path)));
                }
            }
            folders.push((id.clone(), key));
        }
    }
    Ok(folders)
}
