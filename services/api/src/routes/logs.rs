//! Flight logs: upload and import.

use super::jobs::{JobView, Shared, Terms};
use super::tasks::Draft;
use crate::App;
use crate::access::Caller;
use crate::jobs::JobKind;
use crate::jobs::queue::new_id;
use crate::jobs::spec::{Content, Input, Task};
use crate::problem::Problem;
use axum::body::Body;
use axum::extract::Query;
use axum::extract::rejection::QueryRejection;
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use futures_util::StreamExt as _;
use serde::{Deserialize, Serialize};
use std::path::Path;
use tokio::io::AsyncWriteExt as _;
use utoipa::{IntoParams, ToSchema};
use xxhash_rust::xxh3::Xxh3;

super::collection!(
    logs,
    crate::jobs::JobKind::Log,
    "log",
    "/api/v1/logs",
    "/api/v1/logs/{id}",
    "/api/v1/logs/{id}/cancel",
    "/api/v1/logs/{id}/events",
    "/api/v1/logs/{id}/artifacts",
    "/api/v1/logs/{id}/artifacts/{*path}"
);

/// Imported logs are named so: `log.parquet`, `log.toml`, `log.import.json`.
pub(super) const STEM: &str = "log";
/// Endings by which the import knows what a file is.
const ENDINGS: [&str; 6] = ["csv", "parquet", "ulg", "bin", "log", "usd"];

/// How a log is to be read.
#[derive(Debug, Deserialize, Serialize, IntoParams, ToSchema)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(crate) struct Import {
    /// The file's name: its ending says what it is (`csv`, `parquet`, PX4 `ulg`, ArduPilot `bin` or `log`; none: Crazyflie micro-SD log).
    name: String,
    /// Bring every column to this constant rate, Hz.
    rate_hz: Option<f64>,
    /// Take the estimated delays out of attitude, velocity and position.
    #[serde(default)]
    align: bool,
    /// Take what can be read of a file whose checksum is wrong.
    #[serde(default)]
    damaged: bool,
    /// Name of one of the server's vehicles to hold the log against: number and order of the rotors.
    vehicle: Option<String>,
}

/// Uploads a flight log (the body is the file), and imports it.
///
/// Afterwards `artifacts/log.parquet` and `log.toml` are the log in canonical form, and the result is the account of the import: channels,
/// gaps, delays, what is missing and what that makes untestable.
#[utoipa::path(post, path = "/api/v1/logs", tag = "logs", operation_id = "submit_log",
    request_body(content = Vec<u8>, content_type = "application/octet-stream"),
    params(Import, ("Idempotency-Key" = Option<String>, Header, description = "the same key and file again give the log that is there")),
    responses(
        (status = 202, description = "accepted: it is on disk, and will end as done, failed or canceled", body = JobView,
         headers(("Location" = String, description = "address of the log"))),
        (status = 200, description = "accepted before under this key", body = JobView),
        (status = 400, description = "unreadable", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "no such vehicle", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "another file was submitted under this key", body = Problem, content_type = "application/problem+json"),
        (status = 413, description = "too large", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "it cannot be imported so", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "the server is ending", body = Problem, content_type = "application/problem+json"),
        (status = 507, description = "the disk is full", body = Problem, content_type = "application/problem+json")
    ))]
pub(crate) async fn submit(
    app: Shared,
    caller: Caller,
    headers: HeaderMap,
    import: Result<Query<Import>, QueryRejection>,
    body: Body,
) -> Result<Response, Problem> {
    let Query(import) = import?;
    let file = file_name(&import.name)?;
    let mut args: Vec<String> = ["log", "import", &file, "--out", "out", "--quiet"]
        .map(str::to_owned)
        .to_vec();
    let mut inputs = Vec::new();
    if let Some(rate) = import.rate_hz {
        if !(1.0..=10_000.0).contains(&rate) {
            return Err(Problem::unprocessable(format!(
                "`rate_hz` is {rate}; expected 1 to 10000"
            )));
        }
        args.extend(["--rate".to_owned(), rate.to_string()]);
    }
    args.extend(import.align.then(|| "--align".to_owned()));
    args.extend(import.damaged.then(|| "--damaged".to_owned()));
    if let Some(vehicle) = &import.vehicle {
        let library = app.library(&caller).await?;
        library.text("vehicles", vehicle)?;
        inputs.push(super::tasks::laid_out(&app, &library).await?);
        args.extend([
            "--vehicle".to_owned(),
            format!("{}/vehicles/{vehicle}.toml", super::tasks::LIBRARY),
        ]);
    }
    let (key, size, hash) = receive(&app, body, &file).await?;
    inputs.push(Input {
        path: file.clone(),
        content: Content::File(format!("{key}/{file}")),
    });
    let draft = Draft {
        kind: JobKind::Log,
        name: import.name.clone(),
        facts: serde_json::json!({ "file": import.name, "bytes": size, "xxh3": hash, "upload": key }),
        task: Task {
            args,
            inputs,
            result: Some(format!("{STEM}.import.json")),
            discard: Vec::new(),
        },
        terms: Terms::default(),
    };
    let answer = draft
        .submit(&app, &caller, &headers, &(&import, &hash), Vec::new())
        .await;
    // A refused or repeated file is of no use to anybody.
    if answer
        .as_ref()
        .map_or(true, |answer| answer.status() != StatusCode::ACCEPTED)
        && let Err(error) = app.artifacts.delete(&key).await
    {
        tracing::warn!(key, %error, "an upload that nobody needs cannot be deleted");
    }
    answer
}

/// `log`, with the ending of what was sent.
fn file_name(name: &str) -> Result<String, Problem> {
    let plain = |c: char| c.is_ascii_alphanumeric() || "._- ()+".contains(c);
    if name.is_empty() || name.len() > 200 || !name.chars().all(plain) {
        return Err(Problem::unprocessable(
            "`name`: expected the name of a file, 1 to 200 letters, digits and ._- ()+",
        ));
    }
    match Path::new(name).extension().and_then(|ending| ending.to_str()) {
        None => Ok(STEM.to_owned()),
        Some(ending) if ENDINGS.contains(&ending.to_ascii_lowercase().as_str()) => {
            Ok(format!("{STEM}.{}", ending.to_ascii_lowercase()))
        }
        Some(ending) => Err(Problem::unprocessable(format!(
            "`name` ends with '{ending}'; expected one of {}, or none",
            ENDINGS.join(", ")
        ))),
    }
}

/// A log's name in results: that of its file, without the ending.
pub(super) fn stem(name: &str) -> &str {
    let stem = Path::new(name).file_stem().and_then(|stem| stem.to_str());
    stem.filter(|stem| stem.chars().any(|c| c.is_ascii_alphanumeric()))
        .unwrap_or(STEM)
}

/// Streams a body to a file of the artifact store; key, size and hash.
async fn receive(app: &App, body: Body, file: &str) -> Result<(String, u64, String), Problem> {
    let key = format!("uploads/{}", new_id());
    let folder = app.artifacts.place(&key);
    let (mut size, mut hash) = (0_u64, Xxh3::new());
    let io = |error: std::io::Error| Problem::unwritten(&error, "the file cannot be kept: the disk is full");
    tokio::fs::create_dir_all(&folder).await.map_err(io)?;
    let received = async {
        let mut target = tokio::fs::File::create(folder.join(file)).await.map_err(io)?;
        let mut stream = body.into_data_stream();
        while let Some(bytes) = stream.next().await {
            let bytes = bytes.map_err(|error| Problem::bad_request(format!("the file did not come whole: {error}")))?;
            size += bytes.len() as u64;
            if size > app.config.largest_upload {
                return Err(Problem::too_large(format!(
                    "the file has more than {} bytes (`--largest-upload`)",
                    app.config.largest_upload
                )));
            }
            hash.update(&bytes);
            target.write_all(&bytes).await.map_err(io)?;
        }
        target.flush().await.map_err(io)?;
        if size == 0 {
            return Err(Problem::unprocessable("the body is empty; expected a flight log"));
        }
        app.artifacts.publish(&key).await.map_err(io)
    };
    match received.await {
        Ok(_) => Ok((key, size, format!("{:032x}", hash.digest128()))),
        Err(problem) => {
            if let Err(error) = app.artifacts.delete(&key).await {
                tracing::warn!(key, %error, "a part of an upload cannot be deleted");
            }
            Err(problem)
        }
    }
}
