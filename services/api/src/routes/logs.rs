//! Flight logs: upload and import.

use super::facts::{JobFacts, UploadFacts};
use super::jobs::{self, JobView, Shared, Terms};
use super::tasks::{Draft, LIBRARY, OUT, STEM, laid_out};
use super::uploads::Upload;
use crate::App;
use crate::access::Caller;
use crate::incoming::Incoming;
use crate::jobs::NewJob;
use crate::json_object::JsonObject;
use crate::problem::Problem;
use axum::body::Body;
use axum::extract::rejection::{PathRejection, QueryRejection};
use axum::extract::{Path, Query};
use axum::http::HeaderMap;
use axum::response::Response;
use rotortwin_jobs::{Input, JobKind, LogImport, StoredJob};
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};
use xxhash_rust::xxh3::Xxh3;

super::collection!(
    logs,
    rotortwin_jobs::JobKind::Log,
    LogResult,
    "log",
    "/api/v1/logs",
    "/api/v1/logs/{id}",
    "/api/v1/logs/{id}/cancel",
    "/api/v1/logs/{id}/events",
    "/api/v1/logs/{id}/artifacts",
    "/api/v1/logs/{id}/artifacts/{*path}"
);

/// Where a job finds the mapping that came with it.
const MAPPING: &str = "mapping.toml";
/// Bytes.
const LONGEST_MAPPING: usize = 64 << 10;
/// Suffixes by which the import recognises the type of a file.
const ENDINGS: [&str; 13] = [
    "csv", "tsv", "parquet", "ulg", "bin", "log", "tlog", "bbl", "bfl", "txt", "mcap", "db3", "usd",
];

/// How a log is to be read.
#[derive(Debug, Deserialize, Serialize, IntoParams, ToSchema)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(crate) struct Import {
    /// The file's name: its ending says what it is (`csv`, `tsv`, `parquet`, PX4 `ulg`, ArduPilot `bin` or `log`, MAVLink `tlog`, blackbox `bbl`, `bfl` or `txt`, ROS 2 `mcap` or `db3`; `usd` or none: Crazyflie micro-SD log).
    name: String,
    /// Resample every column to this constant rate, Hz.
    rate_hz: Option<f64>,
    /// Remove the estimated delays from attitude, velocity and position.
    #[serde(default)]
    align: bool,
    /// Import the readable part of a file whose checksum is wrong.
    #[serde(default)]
    damaged: bool,
    /// Name of one of the server's vehicles to check the log against: number and order of the rotors.
    vehicle: Option<String>,
}

/// Uploads a flight log (the body is the file), and imports it.
///
/// Afterwards `artifacts/log.parquet` and `log.toml` are the log in canonical form, and the result is the import
/// report: channels, gaps, delays, what is missing and what cannot be tested without it.
#[utoipa::path(post, path = "/api/v1/logs", tag = "logs", operation_id = "submit_log",
    request_body(content = Vec<u8>, content_type = "application/octet-stream"),
    params(Import, ("Idempotency-Key" = Option<String>, Header, description = "a retry with the same key and file returns the existing log")),
    responses(
        (status = 202, description = "accepted and stored; the job will end as done, failed or canceled", body = JobView,
         headers(("Location" = String, description = "URL of the log"))),
        (status = 200, description = "already accepted under this Idempotency-Key", body = JobView),
        (status = 400, description = "malformed request", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "vehicle not found", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "this Idempotency-Key was used with a different file", body = Problem, content_type = "application/problem+json"),
        (status = 413, description = "request body too large", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "the log cannot be imported with these settings", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "the server is shutting down", body = Problem, content_type = "application/problem+json"),
        (status = 507, description = "disk full", body = Problem, content_type = "application/problem+json")
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
    let mut job = LogImport {
        file: file.clone().into(),
        out: OUT.into(),
        damaged: import.damaged,
        truth: false,
        vehicle: None,
        mapping: None,
        rate_hz: import.rate_hz,
        align: import.align,
    };
    check_rate(import.rate_hz)?;
    let (incoming, size, hash) = receive(&app, body, &file).await?;
    let mut inputs = vec![Input::file(file.clone(), format!("{}/{file}", incoming.key()))];
    let answer = async {
        let submission = (&import, &hash);
        let known = jobs::request_hash(&submission);
        if let Some(answer) = jobs::before(&app, &caller, JobKind::Log, &headers, &known, JobView::from).await? {
            return Ok(answer);
        }
        if let Some(vehicle) = &import.vehicle {
            let library = app.library(&caller).await?;
            library.text("vehicles", vehicle)?;
            inputs.push(laid_out(&app, &library).await?);
            job.vehicle = Some(format!("{LIBRARY}/vehicles/{vehicle}.toml").into());
        }
        let draft = Draft {
            kind: JobKind::Log,
            name: import.name.clone(),
            facts: JobFacts::Upload(facts(&import, size, &hash, incoming.key())),
            stored: StoredJob {
                job: rotortwin_jobs::Job::LogImport(job),
                inputs,
            },
            terms: Terms::default(),
        };
        let new = NewJob {
            idempotency_key: jobs::idempotency_key(&headers)?,
            request_hash: known,
            upload_bytes: i64::try_from(size).unwrap_or(i64::MAX),
            ..draft.into_job(&caller)?
        };
        jobs::accept(&app, new, JobView::from).await
    }
    .await;
    settle(incoming, status_of(&answer)).await;
    answer
}

/// What lists show of an upload.
fn facts(import: &Import, size: u64, hash: &str, key: &str) -> UploadFacts {
    UploadFacts {
        file: import.name.clone(),
        bytes: size,
        xxh3: hash.to_owned(),
        upload: key.to_owned(),
        vehicle: import.vehicle.clone(),
    }
}

/// How to read an uploaded log again.
#[derive(Debug, Default, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct ImportAgain {
    /// Resample every column to this constant rate, Hz.
    rate_hz: Option<f64>,
    /// Remove the estimated delays from attitude, velocity and position.
    #[serde(default)]
    align: bool,
    /// Import the readable part of a file whose checksum is wrong.
    #[serde(default)]
    damaged: bool,
    /// Name of one of the library's vehicles to check the log against: number and order of the rotors.
    vehicle: Option<String>,
    /// A mapping (TOML) whose rows override the built-in ones of PX4, ArduPilot and Crazyflie logs: columns, units,
    /// axes, order of the motors; for a CSV with column names of its own, the draft of `GET
    /// /api/v1/logs/{id}/mapping`.
    #[schema(max_length = 65_536)]
    mapping: Option<String>,
}

/// Imports an uploaded log again with other settings, as a new log whose parent is the first one.
#[utoipa::path(post, path = "/api/v1/logs/{id}/import", tag = "logs", operation_id = "import_log_again", request_body = ImportAgain,
    params(("id" = String, Path), ("Idempotency-Key" = Option<String>, Header, description = "a retry with the same key and body returns the existing log")),
    responses(
        (status = 202, description = "accepted and stored; the job will end as done, failed or canceled", body = JobView,
         headers(("Location" = String, description = "URL of the log"))),
        (status = 200, description = "already accepted under this Idempotency-Key", body = JobView),
        (status = 400, description = "malformed request", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "log or vehicle not found, or the uploaded file was deleted", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "this Idempotency-Key was used with a different body", body = Problem, content_type = "application/problem+json"),
        (status = 413, description = "request body too large", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "the log cannot be imported with these settings", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "the server is shutting down", body = Problem, content_type = "application/problem+json"),
        (status = 507, description = "disk full", body = Problem, content_type = "application/problem+json")
    ))]
pub(crate) async fn again(
    app: Shared,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
    headers: HeaderMap,
    body: Result<JsonObject<ImportAgain>, Problem>,
) -> Result<Response, Problem> {
    let (Path(id), JsonObject(body)) = (id?, body?);
    let submission = (&id, &body);
    let known = jobs::request_hash(&submission);
    if let Some(answer) = jobs::before(&app, &caller, JobKind::Log, &headers, &known, JobView::from).await? {
        return Ok(answer);
    }
    let log = jobs::find(&app, &caller, JobKind::Log, Ok(Path(id.clone()))).await?;
    check_rate(body.rate_hz)?;
    if body.mapping.as_ref().is_some_and(|text| text.len() > LONGEST_MAPPING) {
        return Err(Problem::unprocessable(format!(
            "`mapping` is longer than {LONGEST_MAPPING} bytes; give only the rows that differ"
        )));
    }
    let gone = || {
        Problem::not_found(format!(
            "the uploaded file of log {} was deleted, so it cannot be imported again",
            log.id
        ))
    };
    let facts = UploadFacts::of(&log.new.facts).ok_or_else(gone)?;
    let (upload, file) = (&facts.upload, file_name(&facts.file)?);
    // A copy of its own: the first log may be deleted.
    let source = app.artifacts.file(upload, &file).await;
    let source = source.map_err(|error| Problem::of_files(&error))?.ok_or_else(gone)?;
    let io = |error: std::io::Error| Problem::unwritten(&error, "the file cannot be kept: the disk is full");
    let mut incoming = Incoming::begin(&app.artifacts, &app.config.work.data).map_err(io)?;
    let key = incoming.key().to_owned();
    let copied = async {
        tokio::fs::create_dir_all(incoming.folder()).await.map_err(io)?;
        let size = tokio::fs::copy(&source, incoming.folder().join(&file))
            .await
            .map_err(io)?;
        incoming.decide();
        app.artifacts.publish(&key).await.map_err(io)?;
        let mut inputs = vec![Input::file(file.clone(), format!("{key}/{file}"))];
        let mut job = LogImport {
            file: file.clone().into(),
            out: OUT.into(),
            damaged: body.damaged,
            truth: false,
            vehicle: None,
            mapping: None,
            rate_hz: body.rate_hz,
            align: body.align,
        };
        if let Some(text) = &body.mapping {
            inputs.push(Input::text(MAPPING, text.clone()));
            job.mapping = Some(MAPPING.into());
        }
        if let Some(vehicle) = &body.vehicle {
            let library = app.library(&caller).await?;
            library.text("vehicles", vehicle)?;
            inputs.push(laid_out(&app, &library).await?);
            job.vehicle = Some(format!("{LIBRARY}/vehicles/{vehicle}.toml").into());
        }
        let facts = UploadFacts {
            upload: key.clone(),
            vehicle: body.vehicle.clone().or_else(|| facts.vehicle.clone()),
            ..facts.clone()
        };
        let draft = Draft {
            kind: JobKind::Log,
            name: log.new.name.clone(),
            facts: JobFacts::Upload(facts),
            stored: StoredJob {
                job: rotortwin_jobs::Job::LogImport(job),
                inputs,
            },
            terms: Terms::default(),
        };
        let new = NewJob {
            parent: Some(log.id.clone()),
            idempotency_key: jobs::idempotency_key(&headers)?,
            request_hash: known,
            upload_bytes: i64::try_from(size).unwrap_or(i64::MAX),
            ..draft.into_job(&caller)?
        };
        jobs::accept(&app, new, JobView::from).await
    };
    let answer = copied.await;
    settle(incoming, status_of(&answer)).await;
    answer
}

/// What becomes of a file once its job was submitted. A refused or repeated one is of no use to anybody. Where the database did not answer,
/// or the server failed, the job may be there all the same: the next start looks.
async fn settle(incoming: Incoming, status: u16) {
    match status {
        202 => incoming.keep(),
        500 | 503 => {}
        _ => incoming.discard().await,
    }
}

fn status_of(answer: &Result<Response, Problem>) -> u16 {
    answer
        .as_ref()
        .map_or_else(|problem| problem.status, |answer| answer.status().as_u16())
}

fn check_rate(rate_hz: Option<f64>) -> Result<(), Problem> {
    match rate_hz.filter(|rate| !(1.0..=10_000.0).contains(rate)) {
        Some(rate) => Err(Problem::unprocessable(format!(
            "`rate_hz` is {rate}; expected 1 to 10000"
        ))),
        None => Ok(()),
    }
}

/// `log`, with the suffix of the uploaded file.
pub(super) fn file_name(name: &str) -> Result<String, Problem> {
    // Marks that turn the direction of a text, or are not seen.
    let hides =
        |c: char| matches!(c, '\u{200b}'..='\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}');
    let plain = |c: char| !c.is_control() && !"/\\".contains(c) && !hides(c);
    if name.is_empty() || name.len() > 200 || !name.chars().all(plain) {
        return Err(Problem::unprocessable(
            "`name`: expected the name of a file, 1 to 200 bytes without slashes and control characters",
        ));
    }
    match std::path::Path::new(name)
        .extension()
        .and_then(|ending| ending.to_str())
    {
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

/// Streams a body to a file of the artifact store; the file, its size in bytes and its hash.
async fn receive(app: &App, body: Body, file: &str) -> Result<(Incoming, u64, String), Problem> {
    let (mut size, mut hash) = (0_u64, Xxh3::new());
    let full = "the file cannot be kept: the disk of the data folder is full";
    let most = app.config.largest_upload;
    let upload = Upload {
        most,
        too_large: &format!("the file has more than {most} bytes (`--largest-upload`)"),
        broken: "the file arrived incomplete",
        full,
    };
    // A full disk is reported after the body has arrived, even if no mark can be written.
    let (mut incoming, target) = match Incoming::begin(&app.artifacts, &app.config.work.data) {
        Err(error) => (None, Err(error)),
        Ok(incoming) => {
            let folder = incoming.folder();
            let target = match tokio::fs::create_dir_all(&folder).await {
                Ok(()) => tokio::fs::File::create(folder.join(file)).await,
                Err(error) => Err(error),
            };
            (Some(incoming), target)
        }
    };
    let received = async {
        size = upload.write(body, target, |bytes| hash.update(bytes)).await?;
        if size == 0 {
            return Err(Problem::unprocessable("the body is empty; expected a flight log"));
        }
        if let Some(incoming) = &mut incoming {
            incoming.decide();
            let published = app.artifacts.publish(incoming.key()).await;
            published.map_err(|error| Problem::unwritten(&error, full))?;
        }
        Ok(())
    };
    let received = received.await;
    match (received, incoming) {
        (Ok(()), Some(incoming)) => Ok((incoming, size, format!("{:032x}", hash.digest128()))),
        // Without a mark there was no file to be written to.
        (Ok(()), None) => Err(Problem::disk_full(full)),
        (Err(problem), incoming) => {
            if let Some(incoming) = incoming {
                incoming.discard().await;
            }
            Err(problem)
        }
    }
}
