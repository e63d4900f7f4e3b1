//! Any job but a flight: campaign, diagnosis, training.

use super::child::{self, BAD_INPUT, Everything, Limits, Reason};
use super::{Ended, WorkerContext, files_key, job_command};
use crate::jobs::{Job, Outcome};
use rotortwin_jobs::{Content, Here, Input, JobFile, Status, StoredJob};
use std::io;
use std::num::NonZeroUsize;
use std::path::Path;

/// Its log, next to its files.
const COMPLAINTS: &str = "task.log";

pub(super) async fn perform(
    context: &WorkerContext,
    job: &Job,
    token: &str,
    stored: StoredJob,
    folder: &Path,
) -> Ended {
    let complaints = folder.join(COMPLAINTS);
    if let Err(error) = lay_out(context, job, &stored.inputs, folder).await {
        return Ended::Failed(format!("the inputs of the job cannot be written: {error}"));
    }
    let threads = NonZeroUsize::new(context.threads).unwrap_or(NonZeroUsize::MIN);
    let StoredJob { job: spec, inputs } = stored;
    let spec = spec.with_threads(threads);
    let leftovers = spec.leftovers();
    let file = JobFile {
        job: spec,
        here: Here {
            until_input_ends: true,
            ..Here::default()
        },
    };
    let command = match job_command(&context.program, &file, folder) {
        Ok(command) => command,
        Err(error) => return Ended::Failed(format!("the job cannot be handed over: {error}")),
    };
    let child = match child::start(command, Limits::of(context, job), &complaints) {
        Ok(child) => child,
        Err(error) => return Ended::Failed(format!("the job could not be started: {error}")),
    };
    let end = child::watch(context, job, token, child, &mut Everything).await;
    match end.reason {
        Reason::Lost => return Ended::Lost,
        Reason::WorkerEnds => return Ended::WorkerEnds,
        Reason::Itself | Reason::Canceled | Reason::TooLong => {}
    }
    let code = end.status.and_then(|status| status.code());
    let (status, error) = match (end.reason, code) {
        (Reason::Canceled, _) => (Status::Canceled, Some("canceled".to_owned())),
        (Reason::TooLong, _) => (
            Status::Failed,
            Some(format!(
                "the limit of {} s of wall time was exceeded",
                job.new.wall_limit_ms / 1000
            )),
        ),
        (_, Some(0)) => (Status::Done, None),
        (_, Some(BAD_INPUT)) => (Status::Failed, Some(child::last_words(&complaints))),
        _ => match child::limit_reached(context, end.status, &complaints) {
            Some(why) => (Status::Failed, Some(why)),
            None => return Ended::Failed(child::last_words(&complaints)),
        },
    };
    let out = folder.join("out");
    for name in leftovers {
        remove(&out.join(name));
    }
    let result = Some(end.words).filter(|text| is_json(text));
    if status == Status::Done && result.is_none() {
        return Ended::Failed("it ended without a result".to_owned());
    }
    // Its inputs are stored in its row, and need not be kept here, too.
    for input in &inputs {
        let top = input.path.split('/').next().unwrap_or_default();
        if top != "out" {
            remove(&folder.join(top));
        }
    }
    match context.artifacts.publish(&files_key(job)).await {
        Ok(bytes) => Ended::Outcome(Outcome {
            status,
            folder: Some(files_key(job)),
            bytes: i64::try_from(bytes).unwrap_or(i64::MAX),
            run_hash: None,
            error,
            result,
        }),
        Err(error) => Ended::Failed(format!("the job's files cannot be kept: {error}")),
    }
}

fn is_json(text: &str) -> bool {
    serde_json::from_str::<serde::de::IgnoredAny>(text).is_ok()
}

/// Removes useless files; a failure does not matter.
fn remove(path: &Path) {
    let removed = if path.is_dir() {
        std::fs::remove_dir_all(path)
    } else {
        std::fs::remove_file(path)
    };
    if let Err(error) = removed {
        tracing::debug!(path = %path.display(), %error, "nothing to discard");
    }
}

async fn lay_out(context: &WorkerContext, job: &Job, inputs: &[Input], folder: &Path) -> io::Result<()> {
    std::fs::create_dir_all(folder.join("out"))?;
    for input in inputs {
        let path = folder.join(&input.path);
        if let Some(parent) = path.parent() {
            std::fs::create_dir_all(parent)?;
        }
        match &input.content {
            Content::Text(text) => std::fs::write(&path, text)?,
            Content::File(key) => {
                let (parent, name) = key.rsplit_once('/').unwrap_or(("", key));
                let file = context.artifacts.file(parent, name).await?;
                let file = file.ok_or_else(|| io::Error::other(format!("{key} is gone")))?;
                std::fs::copy(file, &path)?;
            }
            Content::Folder(key) => copy_folder(context, key, &path).await?,
            Content::Parts => {
                for part in context.database.parts(&job.id).await.map_err(io::Error::other)? {
                    let key = part.folder.ok_or_else(|| io::Error::other("a part has left nothing"))?;
                    copy_folder(context, &key, &path).await?;
                }
            }
        }
    }
    Ok(())
}

async fn copy_folder(context: &WorkerContext, key: &str, to: &Path) -> io::Result<()> {
    for file in context.artifacts.list(key).await? {
        let source = context.artifacts.file(key, &file.path).await?;
        let source = source.ok_or_else(|| io::Error::other(format!("{key}/{} is gone", file.path)))?;
        let target = to.join(&file.path);
        if let Some(parent) = target.parent() {
            std::fs::create_dir_all(parent)?;
        }
        std::fs::copy(source, target)?;
    }
    Ok(())
}
