//! The draft of a mapping for an uploaded third-party table: what its columns may be, and questions that only its owner
//! can answer.

use super::facts::UploadFacts;
use super::jobs::{self, Shared};
use super::logs::file_name;
use crate::access::Caller;
use crate::problem::Problem;
use crate::worker::answer::{answered, json};
use axum::extract::Path;
use axum::extract::rejection::PathRejection;
use axum::response::Response;
use rotortwin_jobs::{JobKind, MappingDraft, Question};
use rotortwin_twin::log::Draft;
use std::time::Duration;

/// Longest time that a table takes.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(60);

/// Drafts a mapping for an uploaded CSV with column names of its own, whether or not its import failed.
///
/// The draft is guessed from names and numbers; what they leave open becomes a question. `POST
/// /api/v1/logs/{id}/import` takes `mapping` as returned, or edited.
#[utoipa::path(get, path = "/api/v1/logs/{id}/mapping", tag = "logs", operation_id = "draft_log_mapping", params(("id" = String, Path)), responses(
    (status = 200, description = "the draft", body = Draft),
    (status = 400, description = "invalid id", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "log not found, not uploaded, or the uploaded file was deleted", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "the file is not a text table, or is too large", body = Problem, content_type = "application/problem+json"),
    (status = 503, description = "too many logs are being read; retry later", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn draft(
    app: Shared,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
) -> Result<Response, Problem> {
    let log = jobs::find(&app, &caller, JobKind::Log, id).await?;
    let gone = || Problem::not_found(format!("log {} has no uploaded file on this server", log.id));
    let facts = UploadFacts::of(&log.new.facts).ok_or_else(gone)?;
    let file = app.artifacts.file(&facts.upload, &file_name(&facts.file)?).await;
    let file = file.map_err(|error| Problem::of_files(&error))?.ok_or_else(gone)?;
    // Its owner knows the file by the name that it was sent under.
    let path = file.display().to_string();
    let question = Question::MappingDraft(MappingDraft { file });
    let for_callers = |text: &str| text.replace(&path, &facts.file);
    let text = answered(&app, &question, ANSWER_TIMEOUT, for_callers).await?;
    Ok(json(for_callers(&text)))
}
