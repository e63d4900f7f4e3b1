//! Model-independent view of a flight: trajectory, parts and events, motor outputs, vibration; of an imported log or of
//! a run.

use super::fdi_reports::stored_as;
use super::jobs::Shared;
use crate::App;
use crate::access::Caller;
use crate::problem::Problem;
use crate::worker::answer::{answered, json};
use axum::extract::Path;
use axum::extract::rejection::PathRejection;
use axum::response::Response;
use rotortwin_jobs::{JobKind, LogOverTime, Question};
use rotortwin_twin::flight_picture::FlightPicture;
use std::time::Duration;

/// Longest time that a log takes.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(60);

/// A flight over time, of an imported log.
#[utoipa::path(get, path = "/api/v1/logs/{id}/flight", tag = "logs", operation_id = "log_flight", params(("id" = String, Path)), responses(
    (status = 200, description = "the flight", body = FlightPicture),
    (status = 400, description = "invalid id", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "log not found", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "the log is not imported", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "the query needs too much memory or time", body = Problem, content_type = "application/problem+json"),
    (status = 503, description = "too many logs are being read; retry later", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn of_log(
    app: Shared,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
) -> Result<Response, Problem> {
    picture(&app, &caller, JobKind::Log, &id?.0).await
}

/// A flight over time, of a run: as measured by its sensors, not the truth.
#[utoipa::path(get, path = "/api/v1/runs/{id}/flight", tag = "telemetry", operation_id = "run_flight", params(("id" = String, Path)), responses(
    (status = 200, description = "the flight", body = FlightPicture),
    (status = 400, description = "invalid id", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "run not found", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "the job is not done", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "the query needs too much memory or time", body = Problem, content_type = "application/problem+json"),
    (status = 503, description = "too many logs are being read; retry later", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn of_run(
    app: Shared,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
) -> Result<Response, Problem> {
    picture(&app, &caller, JobKind::Run, &id?.0).await
}

/// Read by a process of its own, as every log.
async fn picture(app: &App, caller: &Caller, kind: JobKind, id: &str) -> Result<Response, Problem> {
    let file = stored_as(app, caller, kind, id).await?;
    let path = file.display().to_string();
    let question = Question::LogOverTime(LogOverTime { file });
    let for_callers = |sentence: &str| {
        sentence
            .replace(&format!("{path}: "), "the log: ")
            .replace(&path, "the log")
    };
    answered(app, &question, ANSWER_TIMEOUT, for_callers).await.map(json)
}
