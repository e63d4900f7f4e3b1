//! FDI over an uploaded flight log: evaluated in a separate process, like every untrusted file.

use super::uploads::Upload;
use crate::App;
use crate::access::Caller;
use crate::problem::Problem;
use crate::worker::answer::{answered, json};
use axum::Json;
use axum::body::Body;
use axum::extract::rejection::QueryRejection;
use axum::extract::{Query, RawQuery, State};
use axum::http::Uri;
use axum::response::Response;
use rotortwin_campaign::study::log_score::LogScore;
use rotortwin_jobs::{JobKind, LogTruth, LogVerdict, Question};
use rotortwin_scenario::DetectorSettings;
use rotortwin_verdicts::log::LogReport;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use utoipa::{IntoParams, ToSchema};

/// No uploaded log is larger.
pub(super) const LARGEST_LOG: u64 = 128 << 20;
/// Cells of its table, at most: 256 MiB of numbers.
const MOST_CELLS: usize = 1 << 25;
/// Longest time that a log takes: four hours of flight at 400 Hz take a fifth of it.
const LONGEST: Duration = Duration::from_secs(120);

/// Which detectors.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(crate) struct Which {
    /// Id of a log that was imported here, or of a run that is done; the body is then empty.
    log: Option<String>,
    /// Part of the log: seconds `FROM:TO`, a segment, or `order:2-5-6-3-1-4` to assign its columns to other rotors.
    part: Option<String>,
    /// Name of one of the server's vehicles.
    vehicle: String,
    /// Name of one of the server's classifiers; without one the network gives no verdict.
    classifier: Option<String>,
    /// Start of the calibration, s.
    calibration_start_s: Option<f64>,
    /// End of the calibration, s; the vehicle is assumed healthy until then.
    calibration_end_s: Option<f64>,
    /// `true`: the response also contains `flight`: trajectory, parts, motor outputs and vibration, for plotting.
    #[serde(default)]
    flight: bool,
}

/// Runs the detectors on a flight log, uploaded or already imported: verdicts over time, final verdict, missing
/// channels.
///
/// The body is a log: canonical CSV or Parquet (as written by `rotortwin log import`), or an autopilot's. A log
/// of 32 to 400 Hz is judged at its own rate; any other log is resampled to the nearest of these. The log is not
/// stored.
#[utoipa::path(post, path = "/api/v1/fdi/reports", tag = "fdi", operation_id = "judge_log", params(Which),
    request_body(description = "the log, at most 128 MiB", content(
        (String = "text/csv"), (Vec<u8> = "application/vnd.apache.parquet"), (Vec<u8> = "application/octet-stream"))),
    responses(
        (status = 200, description = "the verdicts of the detectors", body = LogReport),
        (status = 400, description = "malformed request", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "vehicle, classifier, log or run not found", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "the log or run is not done", body = Problem, content_type = "application/problem+json"),
        (status = 413, description = "request body too large", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "not a flight log, or the log of a different vehicle", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "too many logs are being judged; retry later", body = Problem, content_type = "application/problem+json"),
        (status = 507, description = "disk full", body = Problem, content_type = "application/problem+json")
    ))]
pub(crate) async fn judge(
    State(app): State<Arc<App>>,
    caller: Caller,
    which: Result<Query<Which>, QueryRejection>,
    body: Body,
) -> Result<Response, Problem> {
    let Query(which) = which?;
    judged(&app, &caller, &which, body, None).await.map(json)
}

/// What is true; the rest of the query is [`Which`].
#[derive(Debug, Default, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(crate) struct KnownTruth {
    /// Column of the log with the truth: 0 healthy, the damaged rotor, −1 several; `fault_label` of a run.
    truth_column: Option<String>,
    /// The truth as rows `time_s,rotor,loss`, separated by `;`, such as `31.2,3,0.08;52,3,0`: from this log time on,
    /// the rotor has lost this fraction of its thrust; 0: recovered, empty: unknown size. For a healthy log: `0,0,`.
    truth: Option<String>,
}

/// A judged log, with the score of the detectors.
#[derive(Debug, Serialize, Deserialize, ToSchema)]
pub(crate) struct ScoredReport {
    /// Result of the detectors.
    #[schema(value_type = LogReport)]
    report: serde_json::Value,
    /// Score of these verdicts.
    score: LogScore,
}

/// Runs the detectors on a flight log whose truth is known, and scores the verdicts of all detectors.
///
/// As `POST /api/v1/fdi/reports`, with either `truth` or `truth_column`; definitions: docs/campaigns.md.
#[utoipa::path(post, path = "/api/v1/fdi/scores", tag = "fdi", operation_id = "score_log", params(Which, KnownTruth),
    request_body(description = "the log, at most 128 MiB", content(
        (String = "text/csv"), (Vec<u8> = "application/vnd.apache.parquet"), (Vec<u8> = "application/octet-stream"))),
    responses(
        (status = 200, description = "the verdicts of the detectors, and their score", body = ScoredReport),
        (status = 400, description = "malformed request", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "vehicle, classifier, log or run not found", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "the log or run is not done", body = Problem, content_type = "application/problem+json"),
        (status = 413, description = "request body too large", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "not a flight log, the log of a different vehicle, or it contains no truth", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "too many logs are being judged; retry later", body = Problem, content_type = "application/problem+json"),
        (status = 507, description = "disk full", body = Problem, content_type = "application/problem+json")
    ))]
pub(crate) async fn score(
    State(app): State<Arc<App>>,
    caller: Caller,
    RawQuery(query): RawQuery,
    body: Body,
) -> Result<Json<ScoredReport>, Problem> {
    let (which, known) = split(query.as_deref().unwrap_or_default())?;
    let truth = match (known.truth, known.truth_column) {
        (Some(rows), None) => LogTruth::Rows(format!("time_s,rotor,loss\n{}\n", rows.replace(';', "\n"))),
        (None, Some(column)) => LogTruth::Column(column),
        (rows, _) => {
            return Err(Problem::unprocessable(format!(
                "expected `truth` (rows time_s,rotor,loss with `;` between them) or `truth_column` (a column of the log), got {}",
                if rows.is_some() { "both" } else { "neither" }
            )));
        }
    };
    let text = judged(&app, &caller, &which, body, Some(truth)).await?;
    // The name of the file, which is the server's matter, is left out.
    serde_json::from_str(&text)
        .map(Json)
        .map_err(|error| Problem::internal(&error))
}

/// A query that says which detectors, and what is true. The deserializer of queries cannot put one type into another: it is cut in two.
fn split(query: &str) -> Result<(Which, KnownTruth), Problem> {
    let (truth, which): (Vec<&str>, Vec<&str>) = query.split('&').partition(|pair| {
        let key = pair.split('=').next().unwrap_or_default();
        matches!(key, "truth" | "truth_column")
    });
    Ok((part_of(&which)?, part_of(&truth)?))
}

/// Pairs of a query as a type.
fn part_of<T: serde::de::DeserializeOwned>(pairs: &[&str]) -> Result<T, Problem> {
    let uri = Uri::try_from(format!("/?{}", pairs.join("&")));
    let uri = uri.map_err(|error| Problem::bad_request(format!("the query is none: {error}")))?;
    let Query(part) = Query::try_from_uri(&uri)?;
    Ok(part)
}

/// What `rotortwin fdi-log` says of a log.
async fn judged(
    app: &App,
    caller: &Caller,
    which: &Which,
    body: Body,
    truth: Option<LogTruth>,
) -> Result<String, Problem> {
    let settings = DetectorSettings {
        calibration_start_s: which.calibration_start_s,
        calibration_end_s: which.calibration_end_s,
        ..DetectorSettings::default()
    };
    let part = which.part.as_deref().map(super::asked::checked_part).transpose()?;
    let library = app.library(caller).await?;
    // Made here only to be refused: the process that judges makes its own.
    let (vehicle, classifier) = (Some(which.vehicle.as_str()), which.classifier.as_deref());
    let made = || super::fdi::detectors(&library, vehicle, None, classifier, &settings);
    app.readers.read(made).await?;
    let file = match &which.log {
        Some(id) => Flight::Stored(stored(app, caller, id).await?),
        None => Flight::Uploaded(received(app, body).await?),
    };
    let mut log = file.path().as_os_str().to_owned();
    if let Some(part) = part {
        log.push(format!("@{part}"));
    }
    let set = [
        ("calibration_start_s", which.calibration_start_s),
        ("calibration_end_s", which.calibration_end_s),
    ];
    let set = set.into_iter().filter_map(|(key, value)| Some((key, value?)));
    let classifier = which.classifier.as_ref();
    let question = Question::LogVerdict(LogVerdict {
        logs: vec![log.into()],
        model: library.file("vehicles", &which.vehicle, "toml").display().to_string(),
        models: "models".into(),
        classifier: classifier.map(|name| library.file("classifiers", name, "json")),
        settings: set.map(|(key, value)| format!("{key}={value:?}")).collect(),
        truth,
        flight: which.flight,
        most_cells: Some(MOST_CELLS),
        ..LogVerdict::default()
    });
    let path = file.path().display().to_string();
    // Under the name of an upload's file nobody knows it.
    let stem = match &file {
        Flight::Uploaded(file) => file.path().file_stem().map(|stem| format!("{}: ", stem.display())),
        Flight::Stored(_) => None,
    };
    let for_callers = |sentence: &str| {
        let sentence = library
            .without_root(&sentence)
            .replace(&format!("{path}: the log "), "the log ")
            .replace(&format!("{path}: "), "the log: ")
            .replace(&path, "the log");
        match &stem {
            Some(stem) => sentence.replace(stem, ""),
            None => sentence,
        }
    };
    answered(app, &question, LONGEST, for_callers).await
}

/// Where the log is.
enum Flight {
    Stored(PathBuf),
    /// Gone when it is dropped.
    Uploaded(tempfile::NamedTempFile),
}

impl Flight {
    fn path(&self) -> &Path {
        match self {
            Self::Stored(path) => path,
            Self::Uploaded(file) => file.path(),
        }
    }
}

/// The log of this id, or the folder of the run of this id.
async fn stored(app: &App, caller: &Caller, id: &str) -> Result<PathBuf, Problem> {
    match stored_as(app, caller, JobKind::Log, id).await {
        Err(problem) if problem.status == 404 => {
            let run = stored_as(app, caller, JobKind::Run, id).await;
            run.map_err(|problem| match problem.status {
                404 => Problem::not_found(format!("log or run {id} not found")),
                _ => problem,
            })
        }
        other => other,
    }
}

/// The log, or the folder of the run, of this id.
pub(super) async fn stored_as(app: &App, caller: &Caller, kind: JobKind, id: &str) -> Result<PathBuf, Problem> {
    let job = super::tasks::done(app, caller, kind, id).await?;
    let is_run = kind == JobKind::Run;
    let (table, beside) = if is_run {
        ("telemetry.parquet".to_owned(), "summary.json".to_owned())
    } else {
        let stem = super::tasks::STEM;
        (format!("{stem}.parquet"), format!("{stem}.toml"))
    };
    let key = job.folder.unwrap_or_default();
    let mut found = None;
    // The table last: with a bucket, the other inputs are local files by then.
    for name in [beside, table] {
        let file = app.artifacts.file(&key, &name).await;
        found = file.map_err(|error| Problem::of_files(&error))?;
    }
    let file = found.ok_or_else(|| Problem::not_found(format!("the file of {id} was deleted")))?;
    Ok(match file.parent() {
        Some(folder) if is_run => folder.to_owned(),
        _ => file,
    })
}

/// The body as a file of its own, which is gone when it is dropped.
async fn received(app: &App, body: Body) -> Result<tempfile::NamedTempFile, Problem> {
    let full = "the log cannot be kept while it is judged: the disk of the data folder is full";
    let told = |error: std::io::Error| Problem::unwritten(&error, full);
    let file = tempfile::Builder::new()
        .prefix(crate::incoming::JUDGED)
        .tempfile_in(&app.config.work.data)
        .map_err(told)?;
    let out = file.reopen().map(tokio::fs::File::from_std);
    let upload = Upload {
        most: LARGEST_LOG,
        too_large: &format!("the log has more than {LARGEST_LOG} bytes; expected a shorter part of it"),
        broken: "the log arrived incomplete",
        full,
    };
    let size = upload.write(body, out, |_| {}).await?;
    if size == 0 {
        return Err(Problem::bad_request("the body is empty; expected a flight log"));
    }
    Ok(file)
}
