//! What submissions of tasks share: commands of `rotortwin` over the library, logs, runs and models.

use super::jobs::{self, JobView, Terms};
use crate::App;
use crate::access::Caller;
use crate::jobs::spec::{Content, Input, Spec, Task};
use crate::jobs::{Job, JobKind, NewJob, Status};
use crate::library::Library;
use crate::problem::Problem;
use axum::http::HeaderMap;
use axum::response::Response;
use rotortwin_twin::model::ModelVersion;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use utoipa::ToSchema;

/// Where a task finds the library.
pub(super) const LIBRARY: &str = "library";
/// Where a task finds a version of a model.
const VERSION: &str = "version.toml";
/// A job has at most this many parts.
const MOST_PARTS: u64 = 64;
/// A submission names at most this many logs and runs.
const MOST_LOGS: usize = 64;

/// A task that is being put together.
pub(super) struct Draft {
    pub(super) kind: JobKind,
    pub(super) name: String,
    pub(super) facts: serde_json::Value,
    pub(super) task: Task,
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
            spec: serde_json::to_string(&Spec::Task(self.task)).map_err(|error| Problem::internal(&error))?,
            facts: self.facts.to_string(),
            parent: None,
            idempotency_key: None,
            request_hash: String::new(),
            wall_limit_ms: self.terms.check()?,
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
    whole.facts["parts"] = parts.len().into();
    whole.submit(app, caller, headers, body, parts).await
}

/// A library as it is now, for a task.
///
/// # Errors
/// 500.
pub(super) async fn laid_out(app: &App, library: &Library) -> Result<Input, Problem> {
    let key = library
        .snapshot(&app.artifacts)
        .await
        .map_err(|error| Problem::internal(&error))?;
    Ok(Input {
        path: LIBRARY.to_owned(),
        content: Content::Folder(key),
    })
}

/// Flights to hold a model against.
#[derive(Debug, Clone, Default, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct Flights {
    /// Ids of imported logs; `ID@35:65` takes only these seconds.
    #[serde(default)]
    logs: Vec<String>,
    /// Ids of runs that are done; `ID@35:65` takes only these seconds.
    #[serde(default)]
    runs: Vec<String>,
}

impl Flights {
    /// Words for the command line, and the inputs that they mean.
    ///
    /// # Errors
    /// 404: no such log or run. 409: it is not done. 422: none, too many, or no part of a log.
    pub(super) async fn lay_out(&self, app: &App, caller: &Caller) -> Result<(Vec<String>, Vec<Input>), Problem> {
        let count = self.logs.len() + self.runs.len();
        if !(1..=MOST_LOGS).contains(&count) {
            return Err(Problem::unprocessable(format!(
                "{count} flights in `logs` and `runs`; expected 1 to {MOST_LOGS}"
            )));
        }
        let (mut words, mut inputs) = (Vec::new(), Vec::new());
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
                        let stem = super::logs::stem(&job.new.name);
                        for ending in ["parquet", "toml"] {
                            inputs.push(Input {
                                path: format!("{folder}/{stem}.{ending}"),
                                content: Content::File(format!("{key}/{}.{ending}", super::logs::STEM)),
                            });
                        }
                        format!("{folder}/{stem}.parquet")
                    }
                    _ => {
                        inputs.push(Input {
                            path: folder.clone(),
                            content: Content::Folder(key),
                        });
                        folder
                    }
                };
                words.push(part.map_or_else(|| file.clone(), |part| format!("{file}@{part}")));
            }
        }
        Ok((words, inputs))
    }
}

/// Seconds `FROM:TO`, or the name of a segment.
fn checked_part(part: &str) -> Result<&str, Problem> {
    let plain = |c: char| c.is_ascii_alphanumeric() || "._-:".contains(c);
    if !part.is_empty() && part.len() <= 64 && part.chars().all(plain) {
        return Ok(part);
    }
    Err(Problem::unprocessable(format!(
        "'{part}' is no part of a log; expected seconds such as 35:65, or the name of a segment"
    )))
}

/// Which model.
#[derive(Debug, Clone, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct ModelChoice {
    /// Name of one of the server's vehicles: its nominal model.
    #[serde(default)]
    vehicle: Option<String>,
    /// Id of an improvement: the model that it ended with.
    #[serde(default)]
    improvement: Option<String>,
    /// A version of a model, as `rotortwin model export` writes it (TOML).
    #[serde(default)]
    version: Option<String>,
    /// Name of a version that was left in the library, under `/api/v1/models`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    model: Option<String>,
    /// Comparison: what to call the model in the result.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(min_length = 1, max_length = 200)]
    label: Option<String>,
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

    /// The word for the command line, the inputs that it means, and a name.
    ///
    /// # Errors
    /// 404, 409, 422.
    pub(super) async fn lay_out(&self, app: &App, caller: &Caller) -> Result<(String, Vec<Input>, String), Problem> {
        let library = app.library(caller).await?;
        // Whatever it is made from, it stands alone: what is flown or fitted tomorrow is what was there today.
        let alone = |text: String, name: &str| {
            let input = Input {
                path: VERSION.to_owned(),
                content: Content::Text(text),
            };
            (VERSION.to_owned(), vec![input], name.to_owned())
        };
        match (&self.vehicle, &self.improvement, &self.version, &self.model) {
            (Some(name), None, None, None) => {
                library.text("vehicles", name)?;
                let inputs = vec![laid_out(app, &library).await?];
                Ok((format!("{LIBRARY}/vehicles/{name}.toml"), inputs, name.clone()))
            }
            (None, Some(id), None, None) => {
                let job = done(app, caller, JobKind::Improvement, id).await?;
                let file = super::twin::FINAL_MODEL;
                let input = Input {
                    path: file.to_owned(),
                    content: Content::File(format!("{}/{file}", job.folder.unwrap_or_default())),
                };
                Ok((file.to_owned(), vec![input], job.new.name))
            }
            (None, None, Some(text), None) => {
                let version = library.parse_model(text)?;
                Ok(alone(text.clone(), &version.name))
            }
            (None, None, None, Some(name)) => Ok(alone(library.model(name)?.to_toml(), name)),
            _ => Err(one_model()),
        }
    }

    /// The model itself.
    ///
    /// # Errors
    /// 404, 409, 422.
    pub(super) async fn read(&self, app: &App, caller: &Caller) -> Result<ModelVersion, Problem> {
        if self.label.is_some() {
            return Err(Problem::unprocessable("`label` belongs to the model of a comparison"));
        }
        let library = app.library(caller).await?;
        match (&self.vehicle, &self.improvement, &self.version, &self.model) {
            (Some(name), None, None, None) => Ok(ModelVersion::first(name, library.vehicle_documents(name)?)),
            (None, Some(id), None, None) => {
                let job = done(app, caller, JobKind::Improvement, id).await?;
                let file = app
                    .artifacts
                    .file(job.folder.as_deref().unwrap_or_default(), super::twin::FINAL_MODEL)
                    .await
                    .map_err(|error| Problem::internal(&error))?
                    .ok_or_else(|| Problem::not_found(format!("the model of improvement {id} is gone")))?;
                ModelVersion::load(file).map_err(|error| Problem::internal(&error))
            }
            (None, None, Some(text), None) => library.parse_model(text),
            (None, None, None, Some(name)) => library.model(name),
            _ => Err(one_model()),
        }
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
