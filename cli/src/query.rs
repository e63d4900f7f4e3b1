//! `rotortwin query`: SQL over results, using DuckDB in a local Python.
//!
//! ```text
//!  query ── request, one line of JSON ──▶ python3 -c clients/python/src/rotortwin/_query.py ── one line of JSON per row ──▶ table, JSON, CSV
//! ```
//! The engine runs in a separate process with memory and time limits; it answers one SELECT, and can only read the Parquet files below the
//! named folders. Why there is no engine in this program: docs/decisions/0065.

use crate::{output, terminal};
use clap::Parser;
use rotortwin_campaign::table_file::quoted;
use rotortwin_runner::grid::Grid;
use rustix::process::{Pid, Resource, Rlimit, prlimit};
use serde::Deserialize;
use serde_json::{Value, json};
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitCode, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::{Duration, Instant};

/// The engine: the module of the Python package, which is independent of the rest of it.
const ENGINE: &str = include_str!("../../clients/python/src/rotortwin/_query.py");

/// Runs the text that follows it, without importing anything from the current folder.
const START: &str = "import sys; sys.path = [p for p in sys.path if p]; space = {'__name__': 'rotortwin_query'}; \
                     exec(compile(sys.argv.pop(), 'query', 'exec'), space); sys.exit(space['main']())";

/// Exit code of the engine: `NO_DUCKDB` in its source.
const NO_DUCKDB: i32 = 4;

/// Error message if there is no engine; the server recognises its beginning.
const MISSING: &str = "SQL over results needs Python 3.10 or later with DuckDB 1.2 or later, which was not found; expected `pip install duckdb pyarrow` \
                       for the python3 on the search path, or --python PROGRAM (or ROTORTWIN_PYTHON) that names another one";

/// Default number of rows of a human-readable table.
const ROWS_OF_A_TABLE: u64 = 100;

/// Memory of Python, DuckDB and PyArrow in addition to that of a query, bytes. Measured: 0.3 GB with two threads; stacks are counted in full.
const OVERHEAD: u64 = 1_000_000_000;

/// Lines read ahead of printing.
const LINES_AHEAD: usize = 1024;

/// Arguments of `rotortwin query`.
#[derive(Debug, Parser)]
pub struct Args {
    /// One SELECT in DuckDB's SQL; each kind of Parquet file is a table: telemetry, campaign, shards, rows, …
    pub sql: String,
    /// Folders with results, or s3://BUCKET/PREFIX with the credentials in AWS_…; subfolders included [default: runs]
    #[arg(value_name = "FOLDER")]
    folders: Vec<String>,
    /// A folder, and its name in the column `folder`; may be given several times
    #[arg(long = "named", value_name = "NAME=FOLDER", value_parser = named)]
    named: Vec<(String, String)>,
    /// Print one JSON object: columns, rows, and whether there are more
    #[arg(long, conflicts_with = "csv")]
    json: bool,
    /// Print CSV
    #[arg(long)]
    csv: bool,
    /// Maximum number of rows [default: 100 in a table; all with --json or --csv]
    #[arg(long = "limit", visible_alias = "rows", value_name = "COUNT")]
    rows: Option<u64>,
    /// Memory limit of the query, MB; the rest goes to a temporary folder
    #[arg(long, value_name = "MB", default_value_t = 512, value_parser = clap::value_parser!(u64).range(16..=1_000_000))]
    memory: u64,
    /// Time limit of the query, s
    #[arg(long = "time-limit", visible_alias = "time", value_name = "S", default_value_t = 600, value_parser = clap::value_parser!(u64).range(1..=86_400))]
    time_s: u64,
    /// Threads [default: as many as this process may use]
    #[arg(long = "jobs", value_name = "COUNT", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Python interpreter with DuckDB [default: python3 in the folder of this program, otherwise on the search path]
    #[arg(long, value_name = "PROGRAM", env = "ROTORTWIN_PYTHON")]
    python: Option<PathBuf>,
    /// Maximum size of the result, bytes
    #[arg(long, value_name = "BYTES", hide = true)]
    most_bytes: Option<u64>,
    /// Size limit of the temporary folder, MB
    #[arg(long, value_name = "MB", hide = true, default_value_t = 64_000)]
    most_spilled: u64,
}

fn named(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((name, folder)) if !name.is_empty() && !folder.is_empty() => Ok((name.to_owned(), folder.to_owned())),
        _ => Err("expected NAME=FOLDER".to_owned()),
    }
}

/// Exit code 2 for invalid SQL, 1 if there is no engine or it reached a limit.
pub(crate) fn run(args: &Args) -> ExitCode {
    match ask(args) {
        Ok(()) => ExitCode::SUCCESS,
        Err(Refusal::BadInput(sentence)) => output::bad_input(sentence),
        Err(Refusal::Failed(sentence)) => output::failed(sentence),
    }
}

enum Refusal {
    BadInput(String),
    Failed(String),
}

fn ask(args: &Args) -> Result<(), Refusal> {
    let spill = tempfile::Builder::new()
        .prefix("rotortwin-query-")
        .tempdir()
        .map_err(|error| Refusal::Failed(format!("a temporary folder for the query cannot be created: {error}")))?;
    let request = request(args, spill.path());
    for python in pythons(args.python.as_deref()) {
        let mut engine = match Engine::start(&python, &request, args) {
            Ok(engine) => engine,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => continue,
            Err(error) => {
                return Err(Refusal::Failed(format!(
                    "{}: cannot be started: {error}",
                    python.display()
                )));
            }
        };
        let mut printer = Printer::new(args);
        while let Some(line) = engine.next_line()? {
            printer.take(&line).map_err(Refusal::Failed)?;
            if terminal::is_closed() {
                return Ok(());
            }
        }
        match engine.end()? {
            NO_DUCKDB => {}
            0 => return printer.finish().map_err(Refusal::Failed),
            code => return Err(engine.refusal(code)),
        }
    }
    Err(Refusal::Failed(MISSING.to_owned()))
}

fn request(args: &Args, spill: &Path) -> String {
    let is_alone = args.named.is_empty() && args.folders.len() < 2;
    let mut sources: Vec<[&str; 2]> = args
        .named
        .iter()
        .map(|(name, folder)| [name.as_str(), folder.as_str()])
        .collect();
    for folder in args.folders.iter().map(String::as_str) {
        sources.push([if is_alone { "" } else { folder.trim_end_matches('/') }, folder]);
    }
    if sources.is_empty() {
        sources.push(["", "runs"]);
    }
    let rows = args
        .rows
        .or_else(|| (!args.json && !args.csv).then_some(ROWS_OF_A_TABLE));
    json!({
        "sql": args.sql,
        "sources": sources,
        "memory": format!("{}MB", args.memory),
        "threads": args.threads,
        "spill": spill,
        "spill_most": format!("{}MB", args.most_spilled),
        "rows": rows,
        "bytes": args.most_bytes,
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
    fn start(python: &Path, request: &str, args: &Args) -> std::io::Result<Self> {
        let mut child = Command::new(python)
            .args(["-c", START, ENGINE])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()?;
        limit_memory(&child, args.memory * 1_000_000 + OVERHEAD)?;
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
            until: Instant::now() + Duration::from_secs(args.time_s),
            limit_s: args.time_s,
            memory: args.memory,
        })
    }

    /// The next line; `None` after the last one.
    fn next_line(&mut self) -> Result<Option<String>, Refusal> {
        let left = self.until.saturating_duration_since(Instant::now());
        match self.lines.recv_timeout(left) {
            Ok(Ok(line)) => Ok(Some(line)),
            Ok(Err(error)) => Err(Refusal::Failed(format!("the response cannot be read: {error}"))),
            Err(RecvTimeoutError::Disconnected) => Ok(None),
            Err(RecvTimeoutError::Timeout) => Err(Refusal::Failed(format!(
                // The server recognises its beginning.
                "the query exceeded {} s and was stopped; expected a smaller query, or a larger --time-limit",
                self.limit_s
            ))),
        }
    }

    /// Waits for its exit code; −1: ended by a signal.
    fn end(&mut self) -> Result<i32, Refusal> {
        let status = self
            .child
            .wait()
            .map_err(|error| Refusal::Failed(format!("waiting for the query process failed: {error}")))?;
        Ok(status.code().unwrap_or(-1))
    }

    /// Its error message before it ended with this code.
    fn refusal(&mut self, code: i32) -> Refusal {
        let words = self.words.take().map(std::thread::JoinHandle::join);
        let words = words.and_then(Result::ok).unwrap_or_default();
        let last = words.lines().rev().find(|line| !line.trim().is_empty());
        let sentence = last.unwrap_or("it said nothing").trim();
        match code {
            2 => Refusal::BadInput(sentence.to_owned()),
            1 if !words.contains("Traceback") => Refusal::Failed(sentence.to_owned()),
            // The server recognises the beginning of this one, too.
            _ => Refusal::Failed(format!(
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

/// A line of the engine.
#[derive(Deserialize)]
#[serde(untagged)]
enum Line {
    Row(Vec<Value>),
    Start { columns: Vec<Column> },
    End { rows: u64, more: bool },
}

#[derive(Deserialize)]
struct Column {
    name: String,
    #[serde(rename = "type")]
    kind: String,
}

impl Column {
    fn is_number(&self) -> bool {
        let kinds = ["INT", "DOUBLE", "FLOAT", "DECIMAL"];
        kinds.iter().any(|kind| self.kind.contains(kind)) && !self.kind.contains(['[', '('])
            || self.kind.starts_with("DECIMAL")
    }
}

/// Prints rows as they arrive; a table, once it is complete.
struct Printer<'a> {
    args: &'a Args,
    columns: Vec<Column>,
    table: Vec<Vec<String>>,
    rows: u64,
    end: Option<(u64, bool)>,
}

impl<'a> Printer<'a> {
    fn new(args: &'a Args) -> Self {
        Self {
            args,
            columns: Vec::new(),
            table: Vec::new(),
            rows: 0,
            end: None,
        }
    }

    fn take(&mut self, text: &str) -> Result<(), String> {
        // Rows of JSON are passed through.
        if self.args.json && text.starts_with('[') {
            print!("{}{text}", if self.rows == 0 { "\n" } else { ",\n" });
            self.rows += 1;
            return Ok(());
        }
        let line =
            serde_json::from_str(text).map_err(|error| format!("the result is damaged: {error}: {text:.200}"))?;
        match line {
            Line::Start { columns } => {
                if self.args.json {
                    let columns: Vec<Value> = columns
                        .iter()
                        .map(|column| json!({ "name": column.name, "type": column.kind }))
                        .collect();
                    print!("{{\"columns\":{},\"rows\":[", Value::Array(columns));
                } else if self.args.csv {
                    let names: Vec<String> = columns.iter().map(|column| quoted(&column.name)).collect();
                    println!("{}", names.join(","));
                }
                self.columns = columns;
            }
            Line::Row(row) => {
                self.rows += 1;
                if self.args.csv {
                    let cells: Vec<String> = row.iter().map(|value| quoted(&plain(value))).collect();
                    println!("{}", cells.join(","));
                } else {
                    self.table.push(row.iter().map(plain).collect());
                }
            }
            Line::End { rows, more } => self.end = Some((rows, more)),
        }
        Ok(())
    }

    fn finish(self) -> Result<(), String> {
        let Some((rows, more)) = self.end.filter(|(rows, _)| *rows == self.rows) else {
            return Err(format!("the result ended early, after {} rows", self.rows));
        };
        if self.args.json {
            println!("\n],\"more\":{more}}}");
            return Ok(());
        }
        if self.args.csv {
            if more {
                eprintln!("the first {rows} rows; there are more");
            }
            return Ok(());
        }
        let numbers = self.columns.iter().enumerate();
        let numbers: Vec<usize> = numbers
            .filter(|(_, column)| column.is_number())
            .map(|(place, _)| place)
            .collect();
        let mut grid = Grid::new(self.columns.iter().map(|column| column.name.as_str())).numbers(numbers);
        for row in self.table {
            grid.add_row(row);
        }
        println!("{grid}");
        if more {
            println!("The first {rows} rows; --rows N shows more, --csv and --json show all.");
        }
        Ok(())
    }
}

/// A human-readable value; empty for null.
fn plain(value: &Value) -> String {
    match value {
        Value::Null => String::new(),
        Value::String(text) => text.clone(),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn args(words: &[&str]) -> Args {
        Args::try_parse_from(["query"].iter().chain(words)).expect("they parse")
    }

    fn sources(words: &[&str]) -> Value {
        let request: Value = serde_json::from_str(&request(&args(words), Path::new("/spill"))).expect("JSON");
        request["sources"].clone()
    }

    #[test]
    fn val_places_have_names_where_there_are_several() {
        assert_eq!(sources(&["SELECT 1"]), json!([["", "runs"]]));
        assert_eq!(sources(&["SELECT 1", "out/"]), json!([["", "out/"]]));
        assert_eq!(
            sources(&["SELECT 1", "a/", "s3://b/c"]),
            json!([["a", "a/"], ["s3://b/c", "s3://b/c"]])
        );
        assert_eq!(sources(&["SELECT 1", "--named", "x=a=b"]), json!([["x", "a=b"]]));
        let parsed = Args::try_parse_from(["query", "SELECT 1", "--named", "=a"]);
        assert!(parsed.is_err_and(|error| error.to_string().contains("expected NAME=FOLDER")));
    }

    #[test]
    fn val_cells_of_csv() {
        assert_eq!(quoted("plain"), "plain");
        assert_eq!(quoted("a,\"b\""), "\"a,\"\"b\"\"\"");
        assert_eq!(plain(&json!(null)), "");
        assert_eq!(plain(&json!([1, "x"])), "[1,\"x\"]");
    }
}
