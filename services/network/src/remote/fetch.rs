//! Downloads a job's files into a local folder.

use super::RemoteError;
use super::http::{Ask, Patience, Remote, causes};
use reqwest::StatusCode;
use rotortwin_jobs::Status;
use serde_json::Value;
use std::fs::File;
use std::io::Write as _;
use std::path::{Component, Path};
use std::time::Duration;

/// Time-out for each piece of a file.
const PIECE: Duration = Duration::from_secs(30);

/// Whether a folder can receive downloaded files.
///
/// # Errors
/// It is not empty.
pub(crate) fn empty(folder: &Path) -> Result<(), String> {
    if std::fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_some()) {
        return Err(format!(
            "{} is not empty; expected a folder that does not exist or is empty",
            folder.display()
        ));
    }
    Ok(())
}

/// Downloads all files of a job into a folder; returns their number.
pub(crate) async fn everything(remote: &Remote, job: &str, folder: &Path) -> Result<usize, RemoteError> {
    let names = names(remote, job).await?;
    for name in &names {
        let relative = Path::new(name);
        if name.is_empty() || !relative.components().all(|part| matches!(part, Component::Normal(_))) {
            return Err(RemoteError::Failed(format!(
                "the server names a file '{name}' that would be outside {}",
                folder.display()
            )));
        }
        file(
            remote,
            &format!("{job}/artifacts/{}", in_url(name)),
            &folder.join(relative),
        )
        .await?;
    }
    Ok(names.len())
}

/// The names of a job's files.
pub(crate) async fn names(remote: &Remote, job: &str) -> Result<Vec<String>, RemoteError> {
    let files = remote.json(&Ask::get(format!("{job}/artifacts"))).await?;
    let items = files["items"].as_array().into_iter().flatten();
    Ok(items
        .map(|item| item["path"].as_str().unwrap_or_default().to_owned())
        .collect())
}

/// Downloads one file; resumes where a connection broke.
pub(crate) async fn file(remote: &Remote, path: &str, target: &Path) -> Result<(), RemoteError> {
    let told = |error: std::io::Error| RemoteError::Failed(format!("{}: cannot be written: {error}", target.display()));
    if let Some(parent) = target.parent() {
        std::fs::create_dir_all(parent).map_err(told)?;
    }
    let mut part = target.as_os_str().to_owned();
    part.push(".part");
    let mut out = File::create(&part).map_err(told)?;
    let (mut have, mut tag, mut patience) = (0_u64, None::<String>, Patience::new());
    'connections: loop {
        let mut ask = Ask::get(path);
        if have > 0 {
            ask = ask.header("range", format!("bytes={have}-"));
        }
        let mut answer = match remote.once(&ask).await {
            Ok(answer) if answer.status().is_success() => answer,
            Ok(answer) => {
                tokio::time::sleep(remote.pause_or_refusal(answer, &mut patience).await?).await;
                continue;
            }
            Err(words) => {
                tokio::time::sleep(remote.pause_or_loss(&words, &mut patience)?).await;
                continue;
            }
        };
        let its_tag = answer
            .headers()
            .get("etag")
            .and_then(|tag| Some(tag.to_str().ok()?.to_owned()));
        if have > 0 && (answer.status() != StatusCode::PARTIAL_CONTENT || its_tag != tag) {
            // A different file than at the start.
            out = File::create(&part).map_err(told)?;
            have = 0;
            if answer.status() == StatusCode::PARTIAL_CONTENT {
                continue;
            }
        }
        tag = its_tag;
        let expected = answer.content_length().map(|length| have + length);
        loop {
            let words = match tokio::time::timeout(PIECE, answer.chunk()).await {
                Ok(Ok(Some(piece))) => {
                    out.write_all(&piece).map_err(told)?;
                    have += piece.len() as u64;
                    patience = Patience::new();
                    continue;
                }
                Ok(Ok(None)) if expected.is_none_or(|length| length == have) => break 'connections,
                Ok(Ok(None)) => "the connection ended early".to_owned(),
                Ok(Err(error)) => causes(&error),
                Err(_) => format!("silence for {} s", PIECE.as_secs()),
            };
            tokio::time::sleep(remote.pause_or_loss(&words, &mut patience)?).await;
            continue 'connections;
        }
    }
    drop(out);
    std::fs::rename(&part, target).map_err(told)
}

/// The path of a file in an address.
pub(crate) fn in_url(name: &str) -> String {
    name.bytes()
        .map(|byte| match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'-' | b'_' | b'.' | b'~' | b'/' => char::from(byte).to_string(),
            _ => format!("%{byte:02X}"),
        })
        .collect()
}

/// The state of a job; `None`: the answer says none.
pub(super) fn status(job: &Value) -> Option<Status> {
    job["status"].as_str().map(Status::parse)
}

/// The text of a field, or a dash.
pub(crate) fn text<'a>(job: &'a Value, key: &str) -> &'a str {
    job[key].as_str().unwrap_or("–")
}
