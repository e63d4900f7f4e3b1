//! Common parts of submissions other than runs: jobs over the library, logs, runs and models.

use super::asked::{Flights, ModelChoice};
use super::facts::JobFacts;
use super::jobs::{self, JobView, Terms};
use crate::App;
use crate::access::Caller;
use crate::jobs::{Job, JobKind, NewJob, Status};
use crate::library::Library;
use crate::problem::Problem;
use axum::http::HeaderMap;
use axum::response::Response;
use rotortwin_jobs::{Content, Input, StoredJob};
use rotortwin_twin::model::ModelVersion;
use serde::Serialize;
use std::collections::BTreeSet;
use std::ops::Range;
use std::path::{Path, PathBuf};

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
/// Where a job finds a version of a model.
const VERSION: &str = "version.toml";
/// A job has at most this many parts.
const MOST_PARTS: u64 = 64;
/// A submission names at most this many logs and runs.
const MOST_LOGS: usize = 64;

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

impl Flights {
    /// As a job names them, and the inputs that this means.
    ///
    /// # Errors
    /// 404: no such log or run. 409: it is not done. 422: none, too many, or no part of a log.
    pub(super) async fn lay_out(&self, app: &App, caller: &Caller) -> Result<(Vec<PathBuf>, Vec<Input>), Problem> {
        let count = self.logs.len() + self.runs.len();
        if !(1..=MOST_LOGS).contains(&count) {
            return Err(Problem::unprocessable(format!(
                "{count} flights in `logs` and `runs`; expected 1 to {MOST_LOGS}"
            )));
        }
        let (mut paths, mut inputs) = (Vec::new(), Vec::new());
        for (kind, texts) in [(JobKind::Log, &self.logs), (JobKind::Run, &self.runs)] {
            for text in texts {
                let (id, part) = match text.split_once('@') {
                    Some((id, part)) => (id, Some(checked_part(part)?)),
                    None => (text.as_str(), None),
                };
                let job = done(app, caller, kind, id).await?;
                let folder = format!("{}/{}", kind.collection(), job.id);
                let key = job.folder.unwrap_or_default();
                let file = match kind {
                    // Under the name that it was uploaded with, as results name their logs.
                    JobKind::Log => {
                        let stem = stem(&job.new.name);
                        for ending in ["parquet", "toml"] {
                            let file = format!("{key}/{}.{ending}", STEM);
                            inputs.push(Input::file(format!("{folder}/{stem}.{ending}"), file));
                        }
                        format!("{folder}/{stem}.parquet")
                    }
                    _ => {
                        inputs.push(Input::folder(folder.clone(), key));
                        folder
                    }
                };
                paths.push(
                    part.map_or_else(|| file.clone(), |part| format!("{file}@{part}"))
                        .into(),
                );
            }
        }
        Ok((paths, inputs))
    }
}

/// A log's name in results: that of its file, without the ending.
fn stem(name: &str) -> &str {
    let stem = Path::new(name).file_stem().and_then(|stem| stem.to_str());
    stem.filter(|stem| stem.chars().any(char::is_alphanumeric))
        .unwrap_or(STEM)
}

/// Seconds `FROM:TO`, or the name of a segment.
pub(super) fn checked_part(part: &str) -> Result<&str, Problem> {
    let plain = |c: char| c.is_ascii_alphanumeric() || "._-:@".contains(c);
    let seconds = |text: &str| text.parse::<f64>().ok().filter(|seconds| seconds.is_finite());
    // What follows a further `@` is not a time.
    let times = part.split('@').next().and_then(|times| times.split_once(':'));
    if let Some((from, to)) = times.and_then(|(from, to)| Some((seconds(from)?, seconds(to)?)))
        && from >= to
    {
        return Err(Problem::unprocessable(format!(
            "'{part}' is not a part of a log: it ends before it begins; expected seconds such as 35:65"
        )));
    }
    if !part.is_empty() && part.len() <= 64 && part.chars().all(plain) {
        return Ok(part);
    }
    Err(Problem::unprocessable(format!(
        "'{part}' is not a part of a log; expected seconds such as 35:65, or the name of a segment"
    )))
}

impl ModelChoice {
    /// The nominal model of a vehicle.
    pub(super) fn is_a_vehicle(&self) -> bool {
        self.vehicle.is_some()
    }

    /// A version that the client brings.
    pub(super) fn is_a_version(&self) -> bool {
        self.version.is_some()
    }

    /// What to call it.
    ///
    /// # Errors
    /// 422: no name.
    pub(super) fn label(&self) -> Result<Option<&str>, Problem> {
        let plain = |label: &&str| (1..=200).contains(&label.len()) && !label.chars().any(char::is_control);
        match self.label.as_deref() {
            Some(label) if plain(&label) => Ok(Some(label)),
            Some(_) => Err(Problem::unprocessable(
                "`label`: expected 1 to 200 bytes without control characters",
            )),
            None => Ok(None),
        }
    }

    /// As a job names it, the inputs that this means, and a name. `place`: models of one job are laid out beside each other.
    ///
    /// # Errors
    /// 404, 409, 422.
    pub(super) async fn lay_out(
        &self,
        app: &App,
        caller: &Caller,
        place: usize,
    ) -> Result<(String, Vec<Input>, String), Problem> {
        let library = app.library(caller).await?;
        let file = |name: &str| match place {
            0 => name.to_owned(),
            _ => format!("{place}-{name}"),
        };
        // Whatever its origin, it is self-contained: later changes do not affect what is flown or fitted.
        let alone = |text: String, name: &str| (file(VERSION), vec![Input::text(file(VERSION), text)], name.to_owned());
        match (&self.vehicle, &self.improvement, &self.version, &self.model) {
            (Some(name), None, None, None) => {
                library.text("vehicles", name)?;
                let inputs = vec![laid_out(app, &library).await?];
                Ok((format!("{LIBRARY}/vehicles/{name}.toml"), inputs, name.clone()))
            }
            (None, Some(id), None, None) => {
                let job = done(app, caller, JobKind::Improvement, id).await?;
                let path = file(FINAL_MODEL);
                let input = Input::file(
                    path.clone(),
                    format!("{}/{FINAL_MODEL}", job.folder.unwrap_or_default()),
                );
                Ok((path, vec![input], job.new.name))
            }
            (None, None, Some(text), None) => {
                let version = library.parse_model(text)?;
                Ok(alone(text.clone(), &version.name))
            }
            (None, None, None, Some(name)) => {
                let version = named_model(app, caller, &library, name).await?;
                Ok(alone(version.to_toml(), name))
            }
            _ => Err(one_model()),
        }
    }

    /// The model itself.
    ///
    /// # Errors
    /// 404, 409, 422.
    pub(super) async fn read(&self, app: &App, caller: &Caller) -> Result<ModelVersion, Problem> {
        if self.label.is_some() {
            return Err(Problem::unprocessable(
                "`label` applies to the models of a comparison only",
            ));
        }
        let library = app.library(caller).await?;
        match (&self.vehicle, &self.improvement, &self.version, &self.model) {
            (Some(name), None, None, None) => library.first_version(name),
            (None, Some(id), None, None) => {
                let job = done(app, caller, JobKind::Improvement, id).await?;
                let file = app
                    .artifacts
                    .file(job.folder.as_deref().unwrap_or_default(), FINAL_MODEL)
                    .await
                    .map_err(|error| Problem::of_files(&error))?
                    .ok_or_else(|| Problem::not_found(format!("the model of improvement {id} was deleted")))?;
                ModelVersion::load(file).map_err(|error| Problem::internal(&error))
            }
            (None, None, Some(text), None) => library.parse_model(text),
            (None, None, None, Some(name)) => named_model(app, caller, &library, name).await,
            _ => Err(one_model()),
        }
    }
}

/// `NAME`, `NAME@v1` or `NAME@BRANCH`. A vehicle that no model was made of is its own first version, as under `/api/v1/models/NAME`.
async fn named_model(app: &App, caller: &Caller, library: &Library, text: &str) -> Result<ModelVersion, Problem> {
    match text.split_once('@') {
        None if !library.has("models", text) && library.has("vehicles", text) => library.first_version(text),
        None => library.model(text),
        Some((name, at)) => app.model_version(caller, name, at).await,
    }
}

fn one_model() -> Problem {
    Problem::unprocessable("expected one of `vehicle`, `model`, `improvement`, `version` as the model")
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
