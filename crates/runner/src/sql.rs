//! SQL over results, using DuckDB in a local Python.
//!
//! ```text
//!  question ── request, one line of JSON ──▶ python3 -c clients/python/src/rotortwin/_query.py ── one line of JSON per row ──▶ caller
//! ```
//! The engine runs in a separate process with memory and time limits; it answers one SELECT, and can only read the Parquet files below the
//! named folders. Why there is no engine in this program: docs/decisions/0065.

use crate::failure::Failure;
use rotortwin_jobs::SqlQuestion;
use rustix::process::{Pid, Resource, Rlimit, prlimit};
use serde_json::json;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::{Duration, Instant};

/// The engine: the module of the Python package, which is independent of the rest of it.
const ENGINE: &str = include_str!("../../../clients/python/src/rotortwin/_query.py");

/// Runs the text that follows it, without importing anything from the current folder.
const START: &str = "import sys; sys.path = [p for p in sys.path if p]; space = {'__name__': 'rotortwin_query'}; \
                     exec(compile(sys.argv.pop(), 'query', 'exec'), space); sys.exit(space['main']())";

/// Exit code of the engine: `NO_DUCKDB` in its source.
const NO_DUCKDB: i32 = 4;

/// Error message if there is no engine; the server recognises its beginning.
const MISSING: &str = "SQL over results needs Python 3.10 or later with DuckDB 1.2 or later, which was not found; expected `pip install duckdb pyarrow` \
                       for the python3 on the search path, or --python PROGRAM (or ROTORTWIN_PYTHON) that names another one";

/// Memory of Python, DuckDB and PyArrow in addition to that of a query, bytes. Measured: 0.3 GB with two threads; stacks are counted in full.
const OVERHEAD: u64 = 1_000_000_000;

/// Lines read ahead of printing.
const LINES_AHEAD: usize = 1024;

/// Receiver of the engine's lines; false: no more are wanted.
pub type Take<'a> = &'a mut dyn FnMut(&str) -> Result<bool, String>;

/// Passes the engine's lines on as they arrive; false: the receiver stopped it.
///
/// * `python`: interpreter with DuckDB; `None`: python3 in the folder of this program, otherwise on the search path
///
/// # Errors
/// Invalid SQL; there is no engine, or it reached a limit.
pub fn ask(question: &SqlQuestion, python: Option<&Path>, take: Take<'_>) -> Result<bool, Failure> {
    let spill = tempfile::Builder::new()
        .prefix("rotortwin-query-")
        .tempdir()
        .map_err(|error| Failure::Failed(format!("a temporary folder for the query cannot be created: {error}")))?;
    let request = request(question, spill.path());
    for python in pythons(python) {
        let mut engine = match Engine::start(&python, &request, question) {
            Ok(engine) => engine,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => continue,
            Err(error) => {
                return Err(Failure::Failed(format!(
                    "{}: cannot be started: {error}",
                    python.display()
                )));
            }
        };
        while let Some(line) = engine.next_line()? {
            if !take(&line).map_err(Failure::Failed)? {
                return Ok(false);
            }
        }
        match engine.end()? {
            NO_DUCKDB => {}
            0 => return Ok(true),
            code => return Err(engine.refusal(code)),
        }
    }
    Err(Failure::Failed(MISSING.to_owned()))
}

fn request(question: &SqlQuestion, spill: &Path) -> String {
    json!({
        "sql": question.sql,
        "sources": question.sources,
        "memory": format!("{}MB", question.memory_mb),
        "threads": question.threads,
        "spill": spill,
        "spill_most": format!("{}MB", question.most_spilled_mb),
        "rows": question.rows,
        "bytes": question.most_bytes,
    })
    .to_string()
}

/// The requested Python, or all that may have DuckDB.
fn pythons(asked: Option<&Path>) -> Vec<PathBuf> {
    if let Some(asked) = asked {
        return vec![asked.to_owned()];
    }
    // The wheel installs this program next to its environment's Python.
    let beside = std::env::current_exe().ok().map(|own| own.with_file_name("python3"));
    let beside = beside.filter(|path| path.is_file());
    beside.into_iter().chain([PathBuf::from("python3")]).collect()
}

/// A process that answers one query.
struct Engine {
    child: Child,
    /// Kept open until this ends: the process treats its closing as our death.
    _stdin: std::process::ChildStdin,
    lines: Receiver<std::io::Result<String>>,
    words: Option<std::thread::JoinHandle<String>>,
    until: Instant,
    limit_s: u64,
    memory: u64,
}

impl Drop for Engine {
    fn drop(&mut self) {
        // It may have ended by itself.
        self.child.kill().ok();
        self.child.wait().ok();
    }
}

impl Engine {
    fn start(python: &Path, request: &str, question: &SqlQuestion) -> std::io::Result<Self> {
        let mut child = Command::new(python)
            .args(["-c", START, ENGINE])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()?;
        limit_memory(&child, question.memory_mb * 1_000_000 + OVERHEAD)?;
        let missing = || std::io::Error::other("it has no standard input and output");
        let mut stdin = child.stdin.take().ok_or_else(missing)?;
        let stdout = child.stdout.take().ok_or_else(missing)?;
        let mut stderr = child.stderr.take().ok_or_else(missing)?;
        let words = std::thread::spawn(move || {
            let mut bytes = Vec::new();
            // Unreadable output is not reported.
            stderr.read_to_end(&mut bytes).ok();
            String::from_utf8_lossy(&bytes).into_owned()
        });
        let (send, lines) = sync_channel(LINES_AHEAD);
        std::thread::spawn(move || {
            for line in BufReader::new(stdout).lines() {
                if send.send(line).is_err() {
                    break;
                }
            }
        });
        let sent = writeln!(stdin, "{request}").and_then(|()| stdin.flush());
        match sent {
            // A Python that cannot even read this has printed the reason.
            Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => return Err(error),
            _ => {}
        }
        Ok(Self {
            child,
            _stdin: stdin,
            lines,
            words: Some(words),
            until: Instant::now() + Duration::from_secs(question.time_s),
            limit_s: question.time_s,
            memory: question.memory_mb,
        })
    }

    /// The next line; `None` after the last one.
    fn next_line(&mut self) -> Result<Option<String>, Failure> {
        let left = self.until.saturating_duration_since(Instant::now());
        match self.lines.recv_timeout(left) {
            Ok(Ok(line)) => Ok(Some(line)),
            Ok(Err(error)) => Err(Failure::Failed(format!("the response cannot be read: {error}"))),
            Err(RecvTimeoutError::Disconnected) => Ok(None),
            Err(RecvTimeoutError::Timeout) => Err(Failure::Failed(format!(
                // The server recognises its beginning.
                "the query exceeded {} s and was stopped; expected a smaller query, or a larger --time-limit",
                self.limit_s
            ))),
        }
    }

    /// Waits for its exit code; −1: ended by a signal.
    fn end(&mut self) -> Result<i32, Failure> {
        let status = self
            .child
            .wait()
            .map_err(|error| Failure::Failed(format!("waiting for the query process failed: {error}")))?;
        Ok(status.code().unwrap_or(-1))
    }

    /// Its error message before it ended with this code.
    fn refusal(&mut self, code: i32) -> Failure {
        let words = self.words.take().map(std::thread::JoinHandle::join);
        let words = words.and_then(Result::ok).unwrap_or_default();
        let last = words.lines().rev().find(|line| !line.trim().is_empty());
        let sentence = last.unwrap_or("it said nothing").trim();
        match code {
            2 => Failure::Input(sentence.to_owned()),
            1 if !words.contains("Traceback") => Failure::Failed(sentence.to_owned()),
            // The server recognises the beginning of this one, too.
            _ => Failure::Failed(format!(
                "the query process ended without a result: {sentence} (it may take {} MB; --memory allows more)",
                self.memory
            )),
        }
    }
}

fn limit_memory(child: &Child, most: u64) -> std::io::Result<()> {
    let pid = Pid::from_raw(child.id().cast_signed());
    // Not the address space, of which shared memory reserves much without using it.
    let limits = [(Resource::Data, most), (Resource::Core, 0)];
    for (resource, most) in limits {
        let was = rustix::process::getrlimit(resource);
        let most = was.maximum.map_or(most, |maximum| maximum.min(most));
        let limit = Rlimit {
            current: Some(most),
            maximum: Some(most),
        };
        match prlimit(pid, resource, limit) {
            // Its death is noticed elsewhere.
            Err(error) if error != rustix::io::Errno::SRCH => return Err(error.into()),
            _ => {}
        }
    }
    Ok(())
}
