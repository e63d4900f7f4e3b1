//! A command whose output answers a request while its caller waits: what it reads costs this request, never the server.

use super::child::{self, Limits};
use crate::problem::Problem;
use std::ffi::OsStr;
use std::path::Path;
use std::process::Stdio;
use std::time::Duration;
use tokio::process::Command;

/// Exit code of a command whose input is bad.
const BAD_INPUT: i32 = 2;

/// What a command may take, and how long.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Patience {
    /// Memory, bytes.
    pub(crate) memory: u64,
    /// Time by the clock, and on each of two processors.
    pub(crate) wall: Duration,
}

/// Runs `program WORDS…` and gives what it wrote: JSON.
///
/// A command that has both an answer and a complaint, such as a log that lacks what every detector needs, has answered.
///
/// # Errors
/// 422 with the command's sentence if its input is bad, or it reached a limit; 500 if it gave no answer for another reason.
pub(crate) async fn answer<W: AsRef<OsStr>>(
    program: &Path,
    words: impl IntoIterator<Item = W>,
    patience: Patience,
) -> Result<String, Problem> {
    let mut command = Command::new(program);
    command
        .args(words)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .kill_on_drop(true);
    child::without_secrets(&mut command);
    let started = command.spawn().map_err(|error| Problem::internal(&error))?;
    let limits = Limits {
        memory: patience.memory,
        cpu_s: 2 * patience.wall.as_secs(),
    };
    limits.hold(&started).map_err(|error| Problem::internal(&error))?;
    let ended = tokio::time::timeout(patience.wall, started.wait_with_output()).await;
    let Ok(output) = ended else {
        return Err(Problem::unprocessable(format!(
            "it took longer than {} s and was stopped; expected a shorter part of it",
            patience.wall.as_secs()
        )));
    };
    let output = output.map_err(|error| Problem::internal(&error))?;
    let said = String::from_utf8_lossy(&output.stderr);
    if matches!(output.status.code(), Some(0 | BAD_INPUT)) {
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        if serde_json::from_str::<serde::de::IgnoredAny>(&text).is_ok() {
            return Ok(text);
        }
    }
    let sentence = child::last_line(&said);
    if output.status.code() == Some(BAD_INPUT) {
        let sentence = sentence.strip_prefix("rotortwin: ").unwrap_or(&sentence);
        return Err(Problem::unprocessable(sentence));
    }
    Err(match child::limit_of(output.status, &said, patience.memory) {
        Some(why) => Problem::unprocessable(why),
        None => Problem::internal(&format!("{} ({})", sentence, output.status)),
    })
}
