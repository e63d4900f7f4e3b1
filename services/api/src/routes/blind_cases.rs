//! The cases of a blind bench: those in a cell of the confusion matrix, and each with its truth, its answer and its
//! log.
//!
//! ```text
//!  confusion matrix ─ hidden, named ─▶ GET  …/cases             rows of the score there
//!                                      GET  …/cases/{n}         what was hidden, and the diagnosis in full
//!                                      POST …/cases/{n}/log ──▶ a log job: the generator flies case n again, with its seed
//! ```
//! The logs themselves are not kept: they would take a hundred times as much space as everything else, and the
//! generator can write the same one again.

use super::facts::{ExampleFacts, JobFacts};
use super::jobs::{self, JobView, Shared, Terms};
use super::log_examples::HiddenTruth;
use super::results::DiagnosisResult;
use super::tasks::{Draft, OUT, done};
use crate::App;
use crate::access::Caller;
use crate::jobs::store::Filter;
use crate::jobs::{Job, NewJob};
use crate::problem::Problem;
use axum::Json;
use axum::extract::rejection::{PathRejection, QueryRejection};
use axum::extract::{Path, Query};
use axum::response::Response;
use rotortwin_blind::bench::cases::Preset;
use rotortwin_blind::bench::score::{Outcome, Row};
use rotortwin_blind::bench::sheet::cell;
use rotortwin_blind::hidden::Hidden;
use rotortwin_blind::truth::Truth;
use rotortwin_jobs::{Content, ExampleCase, JobKind, LogExample, StoredJob};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::PathBuf;
use utoipa::{IntoParams, ToSchema};

/// Rows of all cases, in the files of a bench.
const SCORE: &str = "score.json";
/// Logs of one bench that a page can name.
const MOST_LOGS: i64 = 20_000;

/// Which cases.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(crate) struct CasesQuery {
    /// Only cases of this row of the confusion matrix, such as `rotor-drag`.
    #[param(max_length = 1000)]
    hidden: Option<String>,
    /// Only cases of this column of the confusion matrix, such as `nothing`.
    #[param(max_length = 1000)]
    named: Option<String>,
    /// Only cases with this outcome.
    outcome: Option<Outcome>,
    /// Only cases of this preset.
    preset: Option<Preset>,
    /// `next` of the previous page.
    #[param(minimum = 0)]
    cursor: Option<usize>,
    /// Items per page, 1 to 1000.
    #[param(minimum = 1, maximum = 1000, default = 50)]
    limit: Option<i64>,
}

impl CasesQuery {
    fn wants(&self, row: &Row, hidden: &str, named: &str) -> bool {
        self.cursor.is_none_or(|first| row.case.index >= first)
            && self.hidden.as_deref().is_none_or(|wanted| wanted == hidden)
            && self.named.as_deref().is_none_or(|wanted| wanted == named)
            && self.outcome.is_none_or(|wanted| wanted == row.outcome)
            && self.preset.is_none_or(|wanted| wanted == row.case.preset)
    }
}

/// A case of a blind bench, scored.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct BlindCase {
    /// From 0, over all presets.
    case: usize,
    /// Preset of the case.
    preset: Preset,
    /// Name of the vehicle.
    vehicle: String,
    /// Built-in flight.
    flight: String,
    /// Seed of the flight, in decimal digits because it does not fit a JavaScript number.
    seed: String,
    /// What was hidden.
    effects: Vec<Hidden>,
    /// With small deviations in all other parameters.
    clutter: bool,
    /// Row of the confusion matrix.
    hidden: String,
    /// Column of the confusion matrix.
    named: String,
    /// The effects that were named, in words with their rotors; empty: none.
    answer: String,
    /// Score of the answer.
    outcome: Outcome,
    /// ln of the Bayes factor of the first named effect.
    evidence: Option<f64>,
    /// Largest relative error of the parameters of each correctly named effect.
    parameter_errors: Vec<f64>,
    /// Error of the onset, s.
    onset_error_s: Option<f64>,
    /// Duration of the diagnosis, s.
    seconds: f64,
    /// Why there is no answer.
    failure: Option<String>,
    /// Id of the log if this case was flown again; absent if it was not, or not by the caller's tenant.
    log: Option<String>,
}

impl From<Row> for BlindCase {
    fn from(row: Row) -> Self {
        let (hidden, named) = cell(&row);
        Self {
            case: row.case.index,
            preset: row.case.preset,
            vehicle: name_of(&row.case.vehicle),
            flight: row.case.flight,
            seed: row.case.seed.to_string(),
            effects: row.case.effects,
            clutter: row.case.clutter,
            hidden,
            named,
            answer: row.named,
            outcome: row.outcome,
            evidence: row.evidence,
            parameter_errors: row.parameter_errors,
            onset_error_s: row.onset_error_s,
            seconds: row.seconds,
            failure: row.failure,
            log: None,
        }
    }
}

/// Name of a vehicle by the path of its document.
fn name_of(vehicle: &str) -> String {
    let stem = std::path::Path::new(vehicle).file_stem();
    stem.map_or_else(|| vehicle.to_owned(), |stem| stem.to_string_lossy().into_owned())
}

/// A page of cases, in their order.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct BlindCasePage {
    items: Vec<BlindCase>,
    /// `cursor` of the next page; absent on the last one.
    next: Option<String>,
}

/// A case with all that belongs to it.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct BlindCaseWithAnswer {
    #[serde(flatten)]
    case: BlindCase,
    /// What was hidden; `null`: no flight could be flown.
    truth: Option<HiddenTruth>,
    /// The diagnosis in full, as `rotortwin diagnose --json` writes it; `null`: it failed.
    #[schema(value_type = Option<DiagnosisResult>)]
    diagnosis: Option<Value>,
}

/// The rows of a bench, in order.
#[derive(Deserialize)]
struct Score {
    rows: Vec<Row>,
}

/// Cases of a bench that is done: all of them, or those in a cell of its confusion matrix.
#[utoipa::path(get, path = "/api/v1/blind-benches/{id}/cases", tag = "blind_benches", operation_id = "blind_bench_cases", params(("id" = String, Path), CasesQuery), responses(
    (status = 200, description = "one page of the list", body = BlindCasePage),
    (status = 400, description = "invalid filter", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "blind bench not found", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "the job is not done", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn list(
    app: Shared,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
    query: Result<Query<CasesQuery>, QueryRejection>,
) -> Result<Json<BlindCasePage>, Problem> {
    let Path(id) = id?;
    let Query(query) = query?;
    let limit = query.limit.unwrap_or(50);
    let limit = usize::try_from(limit).unwrap_or(usize::MAX);
    let bench = done(&app, &caller, JobKind::BlindBench, &id).await?;
    let wanted = rows_of(&app, &bench).await?.into_iter().filter(|row| {
        let (hidden, named) = cell(row);
        query.wants(row, &hidden, &named)
    });
    let mut rows: Vec<Row> = wanted.take(limit + 1).collect();
    let next = rows.get(limit).map(|row| row.case.index.to_string());
    rows.truncate(limit);
    let logs = logs_of(&app, &caller, &id).await?;
    let items = rows.into_iter().map(|row| with_log(row, &id, &logs)).collect();
    Ok(Json(BlindCasePage { items, next }))
}

/// A case of a bench that is done: what was hidden, and the diagnosis in full.
#[utoipa::path(get, path = "/api/v1/blind-benches/{id}/cases/{case}", tag = "blind_benches", operation_id = "blind_bench_case",
    params(("id" = String, Path), ("case" = usize, Path, description = "number of the case, from 0")), responses(
    (status = 200, description = "the case", body = BlindCaseWithAnswer),
    (status = 400, description = "invalid case number", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "blind bench or case not found", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "the job is not done", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn get(
    app: Shared,
    caller: Caller,
    path: Result<Path<(String, usize)>, PathRejection>,
) -> Result<Json<BlindCaseWithAnswer>, Problem> {
    let Path((id, case)) = path?;
    let bench = done(&app, &caller, JobKind::BlindBench, &id).await?;
    let row = row_of(&app, &bench, case).await?;
    let truth = truth_of(&app, &bench, case).await?.map(HiddenTruth::from);
    let diagnosis = match text_of(&app, &bench, &format!("answers/{case:05}.json")).await? {
        // A diagnosis that failed leaves an empty file.
        Some(text) if row.failure.is_none() => {
            Some(serde_json::from_str(&text).map_err(|error| Problem::internal(&error))?)
        }
        _ => None,
    };
    let logs = logs_of(&app, &caller, &id).await?;
    Ok(Json(BlindCaseWithAnswer {
        case: with_log(row, &id, &logs),
        truth,
        diagnosis,
    }))
}

/// Flies a case of a bench again, as a log: the one that the diagnosis received. `parent` of the log is the bench.
///
/// A repeated request returns the existing log.
#[utoipa::path(post, path = "/api/v1/blind-benches/{id}/cases/{case}/log", tag = "blind_benches", operation_id = "log_blind_bench_case",
    params(("id" = String, Path), ("case" = usize, Path, description = "number of the case, from 0")), responses(
    (status = 202, description = "accepted and stored; the job will end as done, failed or canceled", body = JobView,
     headers(("Location" = String, description = "URL of the log"))),
    (status = 200, description = "the existing log", body = JobView),
    (status = 400, description = "invalid case number", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "blind bench or case not found", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "the job is not done", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "the case was never flown, or the bench was made by another version of the server", body = Problem, content_type = "application/problem+json"),
    (status = 429, description = "quota of queued jobs exceeded", body = Problem, content_type = "application/problem+json"),
    (status = 503, description = "the server is shutting down", body = Problem, content_type = "application/problem+json"),
    (status = 507, description = "disk full", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn log(
    app: Shared,
    caller: Caller,
    path: Result<Path<(String, usize)>, PathRejection>,
) -> Result<Response, Problem> {
    let Path((id, case)) = path?;
    let bench = done(&app, &caller, JobKind::BlindBench, &id).await?;
    let key = key(&id, case);
    let hash = jobs::request_hash(&key);
    if let Some(answer) = jobs::before_under(&app, &caller, JobKind::Log, &key, &hash, JobView::from).await? {
        return Ok(answer);
    }
    let row = row_of(&app, &bench, case).await?;
    let Some(truth) = truth_of(&app, &bench, case).await? else {
        return Err(Problem::unprocessable(format!(
            "case {case} has no log: {}",
            row.failure.as_deref().unwrap_or("it was never flown")
        )));
    };
    let draft = flown_again(&bench, row, &truth)?;
    let new = NewJob {
        parent: Some(id),
        idempotency_key: Some(key),
        request_hash: hash,
        ..draft.into_job(&caller)?
    };
    jobs::accept(&app, new, JobView::from).await
}

/// The job that flies a case again, with the library of its bench.
fn flown_again(bench: &Job, row: Row, truth: &Truth) -> Result<Draft, Problem> {
    let other_version = || {
        Problem::unprocessable("this version cannot read the bench, which another version accepted; submit it again")
    };
    let stored = StoredJob::parse(&bench.new.spec).map_err(|_unreadable| other_version())?;
    let rotortwin_jobs::Job::BlindBench(spec) = stored.job else {
        return Err(other_version());
    };
    let example = LogExample {
        vehicle: PathBuf::from(&row.case.vehicle),
        preset: None,
        effect: None,
        // That of the flight that was not lost.
        seed: truth.seed,
        duration_s: spec.duration_s,
        case: Some(ExampleCase {
            flight: row.case.flight.clone(),
            effects: row.case.effect_arguments(),
            clutter: row.case.clutter,
            disturbance: row.case.disturbance,
        }),
        out: OUT.into(),
    };
    Ok(Draft {
        kind: JobKind::Log,
        name: format!("{}-case-{}.parquet", row.case.preset.name(), row.case.index),
        facts: JobFacts::Example(ExampleFacts {
            example: true,
            vehicle: name_of(&row.case.vehicle),
            duration_s: spec.duration_s,
            case: Some(row.case.index),
        }),
        stored: StoredJob {
            job: rotortwin_jobs::Job::LogExample(example),
            inputs: stored
                .inputs
                .into_iter()
                .filter(|input| input.content != Content::Parts)
                .collect(),
        },
        terms: Terms::default(),
    })
}

/// The key under which the log of a case is submitted: requested twice, it is the same log.
fn key(bench: &str, case: usize) -> String {
    format!("blind-benches/{bench}/cases/{case}/log")
}

fn with_log(row: Row, bench: &str, logs: &BTreeMap<String, String>) -> BlindCase {
    let mut case = BlindCase::from(row);
    case.log = logs.get(&key(bench, case.case)).cloned();
    case
}

/// Ids of the logs that cases of a bench were flown again as, by their keys.
async fn logs_of(app: &App, caller: &Caller, bench: &str) -> Result<BTreeMap<String, String>, Problem> {
    let filter = Filter {
        kind: Some(JobKind::Log),
        tenant: Some(&caller.tenant),
        parent: Some(bench),
        ..Filter::default()
    };
    let logs = app.database.list(&filter, MOST_LOGS).await?;
    let keyed = logs
        .into_iter()
        .filter_map(|log| Some((log.new.idempotency_key?, log.id)));
    Ok(keyed.collect())
}

/// All rows of a bench, in order.
async fn rows_of(app: &App, bench: &Job) -> Result<Vec<Row>, Problem> {
    let folder = bench.folder.as_deref().unwrap_or_default();
    let file = app.artifacts.file(folder, SCORE).await;
    let file = file
        .map_err(|error| Problem::of_files(&error))?
        .ok_or_else(|| Problem::not_found(format!("{SCORE} of the bench was deleted")))?;
    // 10,000 cases are 15 MB of text.
    let rows = tokio::task::spawn_blocking(move || {
        let text = std::fs::read(file).map_err(|error| error.to_string())?;
        let score: Score = serde_json::from_slice(&text).map_err(|error| error.to_string())?;
        Ok::<_, String>(score.rows)
    });
    let rows = rows.await.map_err(|error| Problem::internal(&error))?;
    rows.map_err(|reason| Problem::internal(&format!("{SCORE}: {reason}")))
}

async fn row_of(app: &App, bench: &Job, case: usize) -> Result<Row, Problem> {
    let rows = rows_of(app, bench).await?;
    let count = rows.len();
    rows.into_iter().find(|row| row.case.index == case).ok_or_else(|| {
        Problem::not_found(format!(
            "case {case} not found in this bench; expected 0 to {}",
            count.saturating_sub(1)
        ))
    })
}

/// What was hidden in a case; none if every flight of it was lost.
async fn truth_of(app: &App, bench: &Job, case: usize) -> Result<Option<Truth>, Problem> {
    let text = text_of(app, bench, &format!("truth/{case:05}.json")).await?;
    text.map(|text| serde_json::from_str(&text).map_err(|error| Problem::internal(&error)))
        .transpose()
}

/// A text among the files of a bench.
async fn text_of(app: &App, bench: &Job, name: &str) -> Result<Option<String>, Problem> {
    let folder = bench.folder.as_deref().unwrap_or_default();
    let file = app.artifacts.file(folder, name).await;
    match file.map_err(|error| Problem::of_files(&error))? {
        Some(file) => {
            let text = tokio::fs::read_to_string(file).await;
            text.map(Some).map_err(|error| Problem::of_files(&error))
        }
        None => Ok(None),
    }
}
