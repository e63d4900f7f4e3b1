//! How the flights and models named in a request are found: in the library, and among the jobs that are done.

use super::tasks::{FINAL_MODEL, LIBRARY, STEM, done, laid_out};
use crate::App;
use crate::access::Caller;
use crate::library::Library;
use crate::problem::Problem;
use rotortwin_jobs::submission::{Flights, ModelChoice};
use rotortwin_jobs::{Input, JobKind};
use rotortwin_twin::model::ModelVersion;
use std::path::{Path, PathBuf};

/// Where a job finds a version of a model.
const VERSION: &str = "version.toml";

/// Flights as a job names them, and the inputs that this means.
///
/// # Errors
/// 404: no such log or run. 409: it is not done. 422: none, too many, or no part of a log.
pub(super) async fn flights(
    app: &App,
    caller: &Caller,
    asked: &Flights,
) -> Result<(Vec<PathBuf>, Vec<Input>), Problem> {
    asked.check_count().map_err(Problem::unprocessable)?;
    let (mut paths, mut inputs) = (Vec::new(), Vec::new());
    for (kind, texts) in [(JobKind::Log, &asked.logs), (JobKind::Run, &asked.runs)] {
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

/// A model as a job names it, the inputs that this means, and a name. `place`: models of one job are laid out beside each other.
///
/// # Errors
/// 404, 409, 422.
pub(super) async fn model(
    app: &App,
    caller: &Caller,
    choice: &ModelChoice,
    place: usize,
) -> Result<(String, Vec<Input>, String), Problem> {
    let library = app.library(caller).await?;
    let file = |name: &str| match place {
        0 => name.to_owned(),
        _ => format!("{place}-{name}"),
    };
    // Whatever its origin, it is self-contained: later changes do not affect what is flown or fitted.
    let alone = |text: String, name: &str| (file(VERSION), vec![Input::text(file(VERSION), text)], name.to_owned());
    match (&choice.vehicle, &choice.improvement, &choice.version, &choice.model) {
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
            let version = app.readers.read(|| library.parse_model(text)).await?;
            Ok(alone(text.clone(), &version.name))
        }
        (None, None, None, Some(name)) => {
            let version = named_model(app, caller, &library, name).await?;
            Ok(alone(version.to_toml(), name))
        }
        _ => Err(one_model()),
    }
}

/// A model itself.
///
/// # Errors
/// 404, 409, 422.
pub(super) async fn version(app: &App, caller: &Caller, choice: &ModelChoice) -> Result<ModelVersion, Problem> {
    if choice.label.is_some() {
        return Err(Problem::unprocessable(
            "`label` applies to the models of a comparison only",
        ));
    }
    let library = app.library(caller).await?;
    match (&choice.vehicle, &choice.improvement, &choice.version, &choice.model) {
        (Some(name), None, None, None) => app.readers.read(|| library.first_version(name)).await,
        (None, Some(id), None, None) => {
            let job = done(app, caller, JobKind::Improvement, id).await?;
            let file = app
                .artifacts
                .file(job.folder.as_deref().unwrap_or_default(), FINAL_MODEL)
                .await
                .map_err(|error| Problem::of_files(&error))?
                .ok_or_else(|| Problem::not_found(format!("the model of improvement {id} was deleted")))?;
            let version = app.readers.read(|| ModelVersion::load(file)).await;
            version.map_err(|error| Problem::internal(&error))
        }
        (None, None, Some(text), None) => app.readers.read(|| library.parse_model(text)).await,
        (None, None, None, Some(name)) => named_model(app, caller, &library, name).await,
        _ => Err(one_model()),
    }
}

/// `NAME`, `NAME@v1` or `NAME@BRANCH`. A vehicle that no model was made of is its own first version, as under `/api/v1/models/NAME`.
async fn named_model(app: &App, caller: &Caller, library: &Library, text: &str) -> Result<ModelVersion, Problem> {
    match text.split_once('@') {
        None if !library.has("models", text) && library.has("vehicles", text) => {
            app.readers.read(|| library.first_version(text)).await
        }
        None => app.readers.read(|| library.model(text)).await,
        Some((name, at)) => app.model_version(caller, name, at).await,
    }
}

fn one_model() -> Problem {
    Problem::unprocessable("expected one of `vehicle`, `model`, `improvement`, `version` as the model")
}
