//! Server side of parts that nodes of an external cluster fetch and deliver.
//!
//! A node has a ticket that is valid as long as its attempt is running. Everything is checked against the job table, so that it may use any
//! server that shares it, even one restarted meanwhile.

use super::child::{self, LARGEST_FILE};
use super::{ATTEMPTS, WorkerContext, accounted, attempt_key, failed, files_key, pause_after_failure};
use crate::artifacts::files_below;
use crate::jobs::queue::new_id;
use crate::jobs::{Job, Outcome};
use crate::problem::Problem;
use rotortwin_jobs::{
    Content, Here, Input, JobFile, PartEnd, PartFile, PartHow, PartInput, PartOrder, QueueEventKind, Status, StoredJob,
};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::path::{Component, Path, PathBuf};
use std::time::Duration;

/// Subfolder of a part's files, as named in its job.
const OUT: &str = "out";
/// Longer inputs are fetched separately, bytes.
const INLINE: u64 = 256 << 10;
/// Number of retries if a claim changes hands while a part is delivered.
const LOOKS: usize = 5;

/// Ticket of a handed-over attempt, as stored in its row.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Ticket {
    /// Address of the cluster.
    pub(crate) executor: String,
    /// The submission whose process executes this attempt: its own, or that of an earlier attempt.
    pub(crate) submission: String,
    /// Secret presented by the node.
    pub(crate) secret: String,
}

impl Ticket {
    pub(crate) fn new(executor: &str, submission: &str) -> Self {
        Self {
            executor: executor.to_owned(),
            submission: submission.to_owned(),
            secret: format!("{:032x}", rand::random::<u128>()),
        }
    }

    pub(crate) fn parse(text: &str) -> Option<Self> {
        serde_json::from_str(text).ok()
    }

    pub(crate) fn to_json(&self) -> String {
        serde_json::json!(self).to_string()
    }
}

/// Path of the attempt on this server, for the node.
pub(crate) fn path(job: &Job) -> String {
    format!("/executor/v1/parts/{}/{}", job.id, job.attempts)
}

fn over() -> Problem {
    Problem::gone("this attempt of the part is over: it ended, was canceled, or another worker has the part")
}

/// The attempt that a ticket belongs to, with its claim.
///
/// # Errors
/// 410: it is over. 401: wrong ticket.
pub(crate) async fn find(
    context: &WorkerContext,
    id: &str,
    attempt: i64,
    secret: &str,
) -> Result<(Job, String), Problem> {
    let found = context.database.handed_over(id, attempt).await?;
    let (job, claim) = found.ok_or_else(over)?;
    let ticket = job.ticket.as_deref().and_then(Ticket::parse).ok_or_else(over)?;
    // Equal lengths, compared in constant time.
    let differs = ticket.secret.len() != secret.len()
        || ticket
            .secret
            .bytes()
            .zip(secret.bytes())
            .fold(0, |differs, (a, b)| differs | (a ^ b))
            != 0;
    if differs {
        return Err(Problem::unauthorized("expected the ticket of this attempt"));
    }
    Ok((job, claim))
}

fn stored(job: &Job) -> Result<StoredJob, Problem> {
    StoredJob::parse(&job.new.spec).map_err(|error| Problem::unprocessable(error.to_string()))
}

/// Instructions for the node, with a number of threads.
///
/// # Errors
/// 422: a job of a later version. 500, 507: files cannot be read.
pub(crate) async fn order(context: &WorkerContext, job: &Job, threads: NonZeroUsize) -> Result<PartOrder, Problem> {
    let StoredJob { job: spec, inputs } = stored(job)?;
    let mut told = Vec::new();
    for input in &inputs {
        told.extend(listed(context, input).await?);
    }
    let leftovers = spec.leftovers().iter().map(|&name| name.to_owned()).collect();
    let file = JobFile {
        job: spec.with_threads(threads),
        here: Here {
            until_input_ends: true,
            ..Here::default()
        },
    };
    let wall_limit_s = u64::try_from(job.new.wall_limit_ms / 1000).unwrap_or(0) + 1;
    Ok(PartOrder {
        program: env!("CARGO_PKG_VERSION").to_owned(),
        name: job.new.name.clone(),
        file: file.to_json().map_err(|error| Problem::internal(&error))?,
        inputs: told,
        out: OUT.to_owned(),
        leftovers,
        wall_limit_s,
        memory: context.job_memory,
        cpu_s: wall_limit_s.saturating_mul(threads.get() as u64 + 2),
    })
}

/// An input as files; short texts are included.
async fn listed(context: &WorkerContext, input: &Input) -> Result<Vec<PartInput>, Problem> {
    let of_files = |error: std::io::Error| Problem::of_files(&error);
    let mut all = Vec::new();
    match &input.content {
        Content::Text(text) => all.push(PartInput {
            path: input.path.clone(),
            text: Some(text.clone()),
        }),
        Content::File(_) => all.push(PartInput {
            path: input.path.clone(),
            text: None,
        }),
        Content::Folder(key) => {
            for file in context.artifacts.list(key).await.map_err(of_files)? {
                let text = if file.size <= INLINE {
                    let local = context.artifacts.file(key, &file.path).await.map_err(of_files)?;
                    let local = local.ok_or_else(|| gone(&file.path))?;
                    let bytes = tokio::fs::read(local).await.map_err(of_files)?;
                    String::from_utf8(bytes).ok()
                } else {
                    None
                };
                let path = format!("{}/{}", input.path, file.path);
                all.push(PartInput { path, text });
            }
        }
        // Parts do not wait for other parts.
        Content::Parts => return Err(Problem::internal("a part waits for parts")),
    }
    Ok(all)
}

fn gone(path: &str) -> Problem {
    Problem::not_found(format!("{path} is not an input of this part, or was deleted"))
}

/// A file that the order lists without its text.
///
/// # Errors
/// 404: not listed. 500, 507.
pub(crate) async fn input(context: &WorkerContext, job: &Job, path: &str) -> Result<PathBuf, Problem> {
    for input in stored(job)?.inputs {
        let (key, rest) = match (&input.content, path.strip_prefix(&input.path)) {
            (Content::File(key), Some("")) => key.rsplit_once('/').unwrap_or(("", key)),
            (Content::Folder(key), Some(rest)) if rest.starts_with('/') => (key.as_str(), &rest[1..]),
            _ => continue,
        };
        let file = context.artifacts.file(key, rest).await;
        if let Some(file) = file.map_err(|error| Problem::of_files(&error))? {
            return Ok(file);
        }
    }
    Err(gone(path))
}

/// A file being delivered.
pub(crate) struct Delivery {
    place: PathBuf,
    /// Temporary file, written first.
    pub(crate) beside: PathBuf,
}

impl Delivery {
    /// # Errors
    /// 422: the path leads elsewhere. 500, 507.
    pub(crate) fn begin(context: &WorkerContext, job: &Job, path: &str) -> Result<Self, Problem> {
        let plain = !path.is_empty()
            && Path::new(path)
                .components()
                .all(|part| matches!(part, Component::Normal(name) if !name.to_string_lossy().starts_with('.')));
        if !plain {
            return Err(Problem::unprocessable(format!(
                "'{path}' is not a valid file of a part; expected a relative path without dots at the beginning of a name"
            )));
        }
        let place = context.artifacts.place(&files_key(job)).join(path);
        let folder = place.parent().unwrap_or(&place).to_owned();
        std::fs::create_dir_all(&folder).map_err(|error| Problem::of_files(&error))?;
        Ok(Self {
            beside: folder.join(format!(".{}", new_id())),
            place,
        })
    }

    /// # Errors
    /// 500, 507.
    pub(crate) fn keep(self) -> Result<(), Problem> {
        std::fs::rename(&self.beside, &self.place).map_err(|error| Problem::of_files(&error))
    }

    pub(crate) fn discard(self) {
        if let Err(error) = std::fs::remove_file(&self.beside) {
            tracing::debug!(%error, "nothing to discard");
        }
    }
}

/// Largest file of a part, bytes.
pub(crate) const LARGEST_DELIVERY: u64 = LARGEST_FILE;

/// Stores the events of a part.
///
/// # Errors
/// 422: not an event. 410: the attempt is over.
pub(crate) async fn events(context: &WorkerContext, job: &Job, claim: &str, lines: &[String]) -> Result<(), Problem> {
    for line in lines {
        let event: serde_json::Value = serde_json::from_str(line)
            .map_err(|error| Problem::unprocessable(format!("a line is not JSON: {error}")))?;
        let kind = event["event"]
            .as_str()
            .filter(|kind| QueueEventKind::parse(kind).is_none());
        let kind = kind.ok_or_else(|| Problem::unprocessable("a line is not an event of a part"))?;
        if !context.database.event(&job.id, claim, kind, line).await? {
            // The claim has moved to another server; these are progress events, which may be lost.
            return Ok(());
        }
        child::tell_whole(context, job, claim, kind, line).await;
    }
    Ok(())
}

/// Ends an attempt as reported by its node; returns its ticket.
///
/// # Errors
/// 410: it is over already. 409: files are missing. 500, 503, 507.
pub(crate) async fn end(
    context: &WorkerContext,
    id: &str,
    attempt: i64,
    secret: &str,
    end: &PartEnd,
) -> Result<Ticket, Problem> {
    for _ in 0..LOOKS {
        let (job, claim) = find(context, id, attempt, secret).await?;
        let node = &end.node;
        let written = match &end.how {
            PartHow::Done { result, files } => {
                let outcome = delivered(context, &job, result, files).await?;
                context.database.finish(&job.id, &claim, &outcome).await?
            }
            PartHow::Refused { why } => {
                let outcome = accounted(context, &job, failed(&job, format!("on node {node}: {why}"))).await;
                context.database.finish(&job.id, &claim, &outcome).await?
            }
            PartHow::Failed { why } if job.failures + 1 >= ATTEMPTS => {
                let why = format!("on node {node}: {why} ({} attempts)", job.failures + 1);
                let outcome = accounted(context, &job, failed(&job, why)).await;
                context.database.finish(&job.id, &claim, &outcome).await?
            }
            PartHow::Failed { why } => {
                let pause = pause_after_failure(&job);
                let why = format!("on node {node}: {why}");
                context.database.release(&job.id, &claim, &why, Some(pause)).await?
            }
        };
        if written {
            context.artifacts.leave(&attempt_key(&job));
            return job.ticket.as_deref().and_then(Ticket::parse).ok_or_else(over);
        }
        // Another server has just taken over the attempt: its claim is equally valid.
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    Err(Problem::unavailable("the part is being handed over; retry later"))
}

/// The files of a part, if all have been delivered.
async fn delivered(context: &WorkerContext, job: &Job, result: &str, files: &[PartFile]) -> Result<Outcome, Problem> {
    if serde_json::from_str::<serde::de::IgnoredAny>(result).is_err() {
        return Err(Problem::unprocessable("the result is no JSON"));
    }
    let key = files_key(job);
    let mut there: BTreeMap<String, u64> = files_below(&context.artifacts.place(&key))
        .map_err(|error| Problem::of_files(&error))?
        .into_iter()
        .map(|file| (file.path, file.size))
        .collect();
    for file in files {
        match there.remove(&file.path) {
            Some(size) if size == file.size => {}
            there => {
                return Err(Problem::conflict(format!(
                    "{} has {} bytes here; expected {}",
                    file.path,
                    there.map_or_else(|| "no".to_owned(), |size| size.to_string()),
                    file.size
                )));
            }
        }
    }
    for path in there.into_keys() {
        // Remains of an interrupted upload.
        if let Err(error) = std::fs::remove_file(context.artifacts.place(&key).join(&path)) {
            tracing::warn!(job = job.id, path, %error, "a file of no known part cannot be removed");
        }
    }
    let bytes = context
        .artifacts
        .publish(&key)
        .await
        .map_err(|error| Problem::of_files(&error))?;
    Ok(Outcome {
        status: Status::Done,
        folder: Some(key),
        bytes: i64::try_from(bytes).unwrap_or(i64::MAX),
        run_hash: None,
        error: None,
        result: Some(result.to_owned()),
    })
}
