//! Processes that answer a request while its caller waits: bad input can only break this request, never the server.

use super::child::{self, BAD_INPUT, Limits};
use crate::App;
use crate::problem::Problem;
use axum::http::header::CONTENT_TYPE;
use axum::response::{IntoResponse as _, Response};
use rotortwin_jobs::Question;
use std::path::Path;
use std::process::{Output, Stdio};
use std::time::Duration;
use tokio::io::AsyncWriteExt as _;
use tokio::process::Command;

/// Limits of a command.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Patience {
    /// Memory, bytes.
    pub(crate) memory: u64,
    /// Wall-clock time, and time on each of two processors.
    pub(crate) wall: Duration,
}

/// How a sentence about memory names its limit, where that is a setting of the operator.
pub(crate) use super::child::MEMORY_OPTION;

/// Longest wait for the questions that came before.
const QUEUE: Duration = Duration::from_secs(60);

/// Asks a process of its own a question when its turn has come, and answers with the JSON that it writes.
///
/// An answer with both a result and an error message, such as for a log that lacks required channels, counts as successful.
///
/// * `wall`: its longest time
/// * `for_callers`: a complaint without details that concern only the server, such as paths
///
/// # Errors
/// 422 with the sentence of the answer if its input is bad, or it reached a limit; 500 if there was no answer for another
/// reason; 503 if too many questions came before.
pub(crate) async fn answered(
    app: &App,
    question: &Question,
    wall: Duration,
    for_callers: impl Fn(&str) -> String,
) -> Result<String, Problem> {
    let patience = Patience {
        memory: app.config.work.job_memory,
        wall,
    };
    answered_within(app, question, patience, for_callers).await
}

/// As [`answered`], within these limits.
///
/// # Errors
/// As there.
pub(crate) async fn answered_within(
    app: &App,
    question: &Question,
    patience: Patience,
    for_callers: impl Fn(&str) -> String,
) -> Result<String, Problem> {
    let turn = tokio::time::timeout(QUEUE, app.fdi.reports.acquire()).await;
    let Ok(Ok(_turn)) = turn else {
        return Err(Problem::unavailable(
            "too many logs, effects and campaigns are being processed; retry later",
        ));
    };
    Said::to(&app.config.work.program, question, patience, None)
        .await
        .and_then(|said| said.answer(patience))
        .map_err(|mut problem| {
            problem.detail = for_callers(&problem.detail);
            problem
        })
}

/// JSON as a response.
pub(crate) fn json(text: String) -> Response {
    ([(CONTENT_TYPE, "application/json")], text).into_response()
}

/// Output of a command.
pub(crate) struct Said(Output);

impl Said {
    /// Asks `program job -` a question, optionally in a folder.
    ///
    /// # Errors
    /// 422 if it takes too long; 500 if it cannot be run.
    pub(crate) async fn to(
        program: &Path,
        question: &Question,
        patience: Patience,
        folder: Option<&Path>,
    ) -> Result<Self, Problem> {
        let text = question.to_json().map_err(|error| Problem::internal(&error))?;
        let mut command = Command::new(program);
        if let Some(folder) = folder {
            command.current_dir(folder);
        }
        command
            .args(["job", "-"])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .kill_on_drop(true);
        child::without_secrets(&mut command);
        let mut started = command.spawn().map_err(|error| Problem::internal(&error))?;
        let limits = Limits {
            memory: patience.memory,
            cpu_s: 2 * patience.wall.as_secs(),
        };
        limits.hold(&started).map_err(|error| Problem::internal(&error))?;
        if let Some(mut stdin) = started.stdin.take() {
            // More than a pipe holds is written while the process reads it; one that ends without reading says why.
            tokio::spawn(async move { stdin.write_all(text.as_bytes()).await });
        }
        let ended = tokio::time::timeout(patience.wall, started.wait_with_output()).await;
        let Ok(output) = ended else {
            return Err(Problem::unprocessable(format!(
                "the time limit of {} s was exceeded; expected a shorter part, or fewer values",
                patience.wall.as_secs()
            )));
        };
        output.map(Self).map_err(|error| Problem::internal(&error))
    }

    /// Its last error message.
    pub(crate) fn complaint(&self) -> String {
        let sentence = child::last_line(&String::from_utf8_lossy(&self.0.stderr));
        sentence.strip_prefix("rotortwin: ").unwrap_or(&sentence).to_owned()
    }

    /// The JSON that it wrote: see [`answered`].
    ///
    /// # Errors
    /// 422, 500.
    pub(crate) fn answer(self, patience: Patience) -> Result<String, Problem> {
        let sentence = self.complaint();
        let Output { status, stdout, stderr } = self.0;
        if matches!(status.code(), Some(0 | BAD_INPUT)) {
            let text = String::from_utf8_lossy(&stdout).into_owned();
            if serde_json::from_str::<serde::de::IgnoredAny>(&text).is_ok() {
                return Ok(text);
            }
        }
        if status.code() == Some(BAD_INPUT) {
            return Err(Problem::unprocessable(sentence));
        }
        Err(
            match child::limit_of(status, &String::from_utf8_lossy(&stderr), patience.memory) {
                Some(why) => Problem::unprocessable(why),
                None => Problem::internal(&format!("{sentence} ({status})")),
            },
        )
    }
}
