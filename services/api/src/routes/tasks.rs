//! Common parts of submissions other than runs: jobs over the library, logs, runs and models.

use super::facts::JobFacts;
use super::jobs::{self, JobView, Terms};
use crate::App;
use crate::access::Caller;
use crate::jobs::{Job, NewJob};
use crate::library::Library;
use crate::problem::Problem;
use axum::http::HeaderMap;
use axum::response::Response;
use rotortwin_jobs::{Content, Input, JobKind, Status, StoredJob};
use serde::Serialize;
use std::collections::BTreeSet;
use std::ops::Range;
use std::path::PathBuf;

/// Where a job finds the library.
pub(super) const LIBRARY: &str = "library";
/// Where a job leaves its files.
pub(super) const OUT: &str = "out";
/// Imported logs are named so: `log.parquet`, `log.toml`, `log.import.json`.
pub(super) const STEM: &str = "log";
/// The version that an improvement ends with, in its files.
pub(super) const FINAL_MODEL: &str = "model.toml";
/// File of a trained classifier.
pub(super) const CLASSIFIER: &str = "classifier.json";
/// A job has at most this many parts.
const MOST_PARTS: u64 = 64;

/// A job that is being put together.
pub(super) struct Draft {
    pub(super) kind: JobKind,
    pub(super) name: String,
    pub(super) facts: JobFacts,
    pub(super) stored: StoredJob,
    pub(super) terms: Terms,
}

impl Draft {
    /// As a job without key and parts.
    ///
    /// # Errors
    /// 422: terms out of range.
    pub(super) fn into_job(self, caller: &Caller) -> Result<NewJob, Problem> {
        Ok(NewJob {
            kind: self.kind,
            name: self.name,
            tenant: caller.tenant.clone(),
            priority: self.terms.priority,
            spec: self.stored.to_json().map_err(|error| Problem::internal(&error))?,
            facts: serde_json::to_string(&self.facts).map_err(|error| Problem::internal(&error))?,
            parent: None,
            idempotency_key: None,
            request_hash: String::new(),
            wall_limit_ms: self.terms.check()?,
            autopilot: None,
            needs: jobs_read_by(&self.stored.inputs),
            upload_bytes: 0,
            parts: Vec::new(),
        })
    }

    /// Puts it into the queue, to be begun when its parts are done.
    ///
    /// # Errors
    /// 400, 409, 422, 429, 503, 507.
    pub(super) async fn submit(
        self,
        app: &App,
        caller: &Caller,
        headers: &HeaderMap,
        body: &impl Serialize,
        parts: Vec<NewJob>,
    ) -> Result<Response, Problem> {
        let new = NewJob {
            idempotency_key: jobs::idempotency_key(headers)?,
            request_hash: jobs::request_hash(body),
            parts,
            ..self.into_job(caller)?
        };
        jobs::accept(app, new, JobView::from).await
    }
}

/// The jobs whose files are among these inputs.
fn jobs_read_by(inputs: &[Input]) -> Vec<String> {
    let ids: BTreeSet<&str> = inputs
        .iter()
        .filter_map(|input| match &input.content {
            Content::File(key) | Content::Folder(key) => Some(key),
            Content::Text(_) | Content::Parts => None,
        })
        // Runs of version 1 of the database lie in `runs`.
        .filter_map(|key| key.strip_prefix("jobs/").or_else(|| key.strip_prefix("runs/")))
        .filter_map(|rest| rest.split('/').next())
        .collect();
    ids.into_iter().map(str::to_owned).collect()
}

/// Divides `units` (shards of flights, cases) into at most [`MOST_PARTS`] parts, all of one length but the last.
fn divided(units: u64) -> Vec<Range<u64>> {
    let length = units.div_ceil(MOST_PARTS).max(1);
    (0..units.div_ceil(length))
        .map(|part| part * length..((part + 1) * length).min(units))
        .collect()
}

/// Puts a job into the queue that all workers do together: `draft` makes a job of a part of its `units`, and of what puts the parts together
/// (`None`). The latter's facts get the number of `parts`.
///
/// # Errors
/// 400, 409, 422, 429, 503, 507.
pub(super) async fn submit_in_parts(
    app: &App,
    caller: &Caller,
    headers: &HeaderMap,
    body: &impl Serialize,
    units: u64,
    draft: impl Fn(Option<&Range<u64>>) -> Draft,
) -> Result<Response, Problem> {
    let parts = divided(units)
        .iter()
        .map(|part| draft(Some(part)).into_job(caller))
        .collect::<Result<Vec<NewJob>, Problem>>()?;
    let mut whole = draft(None);
    whole.facts = whole.facts.with_parts(parts.len());
    whole.submit(app, caller, headers, body, parts).await
}

/// A library as it is now, for a job.
///
/// # Errors
/// 500, 507.
pub(super) async fn laid_out(app: &App, library: &Library) -> Result<Input, Problem> {
    let key = library
        .snapshot(&app.artifacts)
        .await
        .map_err(|error| Problem::of_files(&error))?;
    Ok(Input::folder(LIBRARY, key))
}

/// A job of this kind that is done.
///
/// # Errors
/// 404, 409.
pub(super) async fn done(app: &App, caller: &Caller, kind: JobKind, id: &str) -> Result<Job, Problem> {
    let job = jobs::find(app, caller, kind, Ok(axum::extract::Path(id.to_owned()))).await?;
    if job.status != Status::Done {
        return Err(Problem::conflict(format!(
            "the {} {id} is {}; expected one that is done",
            kind.as_str(),
            job.status.as_str()
        )));
    }
    Ok(job)
}

/// The file of a classifier that was trained here.
///
/// # Errors
/// 404, 409.
pub(super) async fn trained(app: &App, caller: &Caller, id: &str) -> Result<PathBuf, Problem> {
    let job = done(app, caller, JobKind::Classifier, id).await?;
    app.artifacts
        .file(job.folder.as_deref().unwrap_or_default(), CLASSIFIER)
        .await
        .map_err(|error| Problem::of_files(&error))?
        .ok_or_else(|| Problem::not_found(format!("the file of classifier {id} was deleted")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_parts_cover_every_unit_once() {
        for units in (1..200).chain([1000, 10_000, 1_000_003]) {
            let parts = divided(units);
            assert!(parts.len() as u64 <= MOST_PARTS.min(units), "{units}");
            assert_eq!((parts[0].start, parts[parts.len() - 1].end), (0, units));
            assert!(parts.iter().all(|part| !part.is_empty()), "{units}");
            assert!(parts.windows(2).all(|two| two[0].end == two[1].start), "{units}");
        }
    }
}
