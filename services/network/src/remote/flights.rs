//! Flights named by a command, as the server knows them.
//!
//! A flight is a log or run folder of this machine, or the id of a log or run of the server. Logs of this machine are uploaded under a key
//! derived from their bytes, so that the server imports a log once. A run folder, and a log with a side file, are converted to the
//! canonical form here, because an upload is one file.

use super::http::{Ask, Remote};
use super::{RemoteError, fetch, task};
use reqwest::StatusCode;
use rotortwin_jobs::Status;
use rotortwin_jobs::submission::Flights;
use rotortwin_twin::log::FlightLog;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::time::Duration;
use xxhash_rust::xxh3::xxh3_128;

/// Below this rate the connection of an upload counts as dead, bytes/s.
const SLOWEST_UPLOAD: u64 = 100_000;
/// Time allowed for an upload in addition to its transfer.
const ANSWER: Duration = Duration::from_secs(30);

/// Flights of a submission.
pub(super) async fn named(remote: &Remote, texts: &[PathBuf], quiet: bool) -> Result<Flights, RemoteError> {
    let (mut logs, mut runs) = (Vec::new(), Vec::new());
    for text in texts {
        let (path, part) = cut(text);
        if !path.exists()
            && let Some(id) = id_of(path)
        {
            let with_part = part.map_or_else(|| id.to_owned(), |part| format!("{id}@{part}"));
            match kind_of(remote, id).await? {
                "logs" => logs.push(with_part),
                _ => runs.push(with_part),
            }
            continue;
        }
        let bad = |sentence: String| RemoteError::BadInput(sentence);
        let (name, bytes, part) = as_file(path, part).map_err(bad)?;
        let done = import(remote, &name, bytes, "", quiet).await?;
        let id = fetch::text(&done.job, "id");
        logs.push(part.map_or_else(|| id.to_owned(), |part| format!("{id}@{part}")));
    }
    Ok(Flights { logs, runs })
}

/// Cuts `LOG@PART` like [`FlightLog::read_part`].
fn cut(text: &Path) -> (&Path, Option<&str>) {
    text.to_str()
        .and_then(|text| text.rsplit_once('@'))
        .filter(|_| !text.exists())
        .map_or((text, None), |(path, part)| (Path::new(path), Some(part)))
}

fn id_of(path: &Path) -> Option<&str> {
    let text = path.to_str()?;
    (text.len() == 32 && text.bytes().all(|byte| byte.is_ascii_hexdigit())).then_some(text)
}

/// Whether the server has a log or a run of this id.
async fn kind_of(remote: &Remote, id: &str) -> Result<&'static str, RemoteError> {
    for collection in ["logs", "runs"] {
        match remote.json(&Ask::get(format!("/api/v1/{collection}/{id}"))).await {
            Ok(_) => return Ok(collection),
            Err(RemoteError::BadInput(sentence)) => tracing::debug!(sentence, "not there"),
            Err(error) => return Err(error),
        }
    }
    Err(RemoteError::BadInput(format!(
        "{id}: not a file here, and not a log or run on {}",
        remote.url()
    )))
}

/// A log as one file: name, bytes, part of it in seconds.
fn as_file(path: &Path, part: Option<&str>) -> Result<(String, Vec<u8>, Option<String>), String> {
    let seconds = |part: &str| part.split_once(':').is_some();
    let whole = path.is_file() && !path.with_extension("toml").exists();
    if whole && part.is_none_or(seconds) {
        let bytes = std::fs::read(path).map_err(|error| format!("{}: cannot be read: {error}", path.display()))?;
        return Ok((upload_name(path, None), bytes, part.map(str::to_owned)));
    }
    let log = FlightLog::read(path).map_err(|error| error.to_string())?;
    let part = part
        .map(|part| match log.segments.iter().find(|segment| segment.name == part) {
            Some(segment) => Ok(format!("{}:{}", segment.start_s, segment.end_s)),
            None if seconds(part) => Ok(part.to_owned()),
            None => Err(format!(
                "{}@{part}: expected FROM:TO in seconds or one of its {} segments after `@`",
                path.display(),
                log.segments.len()
            )),
        })
        .transpose()?;
    let scratch = tempfile::tempdir().map_err(|error| format!("a temporary folder cannot be created: {error}"))?;
    let stored = log.store(scratch.path(), "log").map_err(|error| error.to_string())?;
    let bytes = std::fs::read(&stored).map_err(|error| format!("{}: cannot be read: {error}", stored.display()))?;
    Ok((upload_name(path, Some("parquet")), bytes, part))
}

/// The name of a file in a form that the server accepts.
pub(super) fn upload_name(path: &Path, ending: Option<&str>) -> String {
    let name = match ending {
        Some(ending) => path.with_extension(ending),
        None => path.to_owned(),
    };
    let name = name
        .file_name()
        .map_or_else(|| "log".into(), |name| name.to_string_lossy().into_owned());
    name.chars()
        .map(|c| {
            if c.is_ascii_alphanumeric() || "._- ()+".contains(c) {
                c
            } else {
                '_'
            }
        })
        .collect()
}

/// Uploads a log and waits until it is imported; `query`: import settings.
pub(super) async fn import(
    remote: &Remote,
    name: &str,
    bytes: Vec<u8>,
    query: &str,
    quiet: bool,
) -> Result<task::Done, RemoteError> {
    let key = format!(
        "log-{:032x}-{:032x}",
        xxh3_128(&bytes),
        xxh3_128(format!("{name}?{query}").as_bytes())
    );
    let limit = ANSWER + Duration::from_secs(bytes.len() as u64 / SLOWEST_UPLOAD);
    let url = format!("/api/v1/logs?name={}{query}", fetch::in_url(name));
    let ask = Ask::post(url).bytes(bytes).limit(limit);
    let mut job = remote.call(&ask.clone().header("idempotency-key", key)).await?;
    let mut there = job.status() == StatusCode::OK;
    let mut log: Value = job.json().await.map_err(no_json)?;
    if there && matches!(fetch::status(&log), Some(Status::Failed | Status::Canceled)) {
        // It may succeed today.
        job = remote.call(&ask.once()).await?;
        there = false;
        log = job.json().await.map_err(no_json)?;
    }
    let id = fetch::text(&log, "id").to_owned();
    if !quiet {
        let how = if there { "is already there:" } else { "uploaded:" };
        eprintln!("{name} {how} log {id} of {}", remote.url());
    }
    task::done(remote, format!("/api/v1/logs/{id}"), "log", quiet)
        .await
        .map_err(|error| match error {
            RemoteError::Failed(sentence) => RemoteError::BadInput(format!("{name}: {sentence}")),
            error @ RemoteError::BadInput(_) => error,
        })
}

fn no_json(error: reqwest::Error) -> RemoteError {
    RemoteError::Failed(format!("the response to an upload is not JSON: {error}"))
}
