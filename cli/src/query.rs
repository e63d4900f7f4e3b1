//! `rotortwin query`: SQL over results, using DuckDB in a local Python ([`rotortwin_runner::sql`]).

use crate::{output, terminal};
use clap::Parser;
use rotortwin_campaign::table_file::quoted;
use rotortwin_jobs::SqlQuestion;
use rotortwin_runner::failure::Failure;
use rotortwin_runner::grid::Grid;
use rotortwin_runner::sql;
use serde::Deserialize;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Environment variable that names the Python interpreter.
const PYTHON: &str = "ROTORTWIN_PYTHON";

/// Size limit of the temporary folder, MB.
const MOST_SPILLED_MB: u64 = 64_000;

/// Default number of rows of a human-readable table.
const ROWS_OF_A_TABLE: u64 = 100;

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
    #[arg(long, value_name = "PROGRAM", env = PYTHON)]
    python: Option<PathBuf>,
}

fn named(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((name, folder)) if !name.is_empty() && !folder.is_empty() => Ok((name.to_owned(), folder.to_owned())),
        _ => Err("expected NAME=FOLDER".to_owned()),
    }
}

impl Args {
    /// The question that they ask.
    fn question(&self) -> SqlQuestion {
        let is_alone = self.named.is_empty() && self.folders.len() < 2;
        let mut sources = self.named.clone();
        for folder in &self.folders {
            let name = if is_alone { "" } else { folder.trim_end_matches('/') };
            sources.push((name.to_owned(), folder.clone()));
        }
        if sources.is_empty() {
            sources.push((String::new(), "runs".to_owned()));
        }
        let is_table = self.form() == Form::Table;
        SqlQuestion {
            sql: self.sql.clone(),
            sources,
            rows: self.rows.or(is_table.then_some(ROWS_OF_A_TABLE)),
            most_bytes: None,
            memory_mb: self.memory,
            most_spilled_mb: MOST_SPILLED_MB,
            time_s: self.time_s,
            threads: self.threads,
        }
    }

    fn form(&self) -> Form {
        match (self.json, self.csv) {
            (true, _) => Form::Json,
            (_, true) => Form::Csv,
            _ => Form::Table,
        }
    }
}

/// Exit code 2 for invalid SQL, 1 if there is no engine or it reached a limit.
pub(crate) fn run(args: &Args) -> ExitCode {
    answer(&args.question(), args.python.as_deref(), args.form())
}

/// Prints the answer to a question as JSON, with the Python that the environment names.
pub(crate) fn print_json(question: &SqlQuestion) -> ExitCode {
    let python = std::env::var_os(PYTHON).map(PathBuf::from);
    answer(question, python.as_deref(), Form::Json)
}

fn answer(question: &SqlQuestion, python: Option<&Path>, form: Form) -> ExitCode {
    let mut printer = Printer::new(form);
    let asked = sql::ask(question, python, &mut |line| {
        printer.take(line)?;
        Ok(!terminal::is_closed())
    });
    let done = asked.and_then(|complete| match complete {
        true => printer.finish().map_err(Failure::Failed),
        false => Ok(()),
    });
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => output::told(&failure),
    }
}

/// How an answer is printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Form {
    Json,
    Csv,
    Table,
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
struct Printer {
    form: Form,
    columns: Vec<Column>,
    table: Vec<Vec<String>>,
    rows: u64,
    end: Option<(u64, bool)>,
}

impl Printer {
    fn new(form: Form) -> Self {
        Self {
            form,
            columns: Vec::new(),
            table: Vec::new(),
            rows: 0,
            end: None,
        }
    }

    fn take(&mut self, text: &str) -> Result<(), String> {
        // Rows of JSON are passed through.
        if self.form == Form::Json && text.starts_with('[') {
            print!("{}{text}", if self.rows == 0 { "\n" } else { ",\n" });
            self.rows += 1;
            return Ok(());
        }
        let line =
            serde_json::from_str(text).map_err(|error| format!("the result is damaged: {error}: {text:.200}"))?;
        match line {
            Line::Start { columns } => {
                if self.form == Form::Json {
                    let columns: Vec<Value> = columns
                        .iter()
                        .map(|column| json!({ "name": column.name, "type": column.kind }))
                        .collect();
                    print!("{{\"columns\":{},\"rows\":[", Value::Array(columns));
                } else if self.form == Form::Csv {
                    let names: Vec<String> = columns.iter().map(|column| quoted(&column.name)).collect();
                    println!("{}", names.join(","));
                }
                self.columns = columns;
            }
            Line::Row(row) => {
                self.rows += 1;
                if self.form == Form::Csv {
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
        if self.form == Form::Json {
            println!("\n],\"more\":{more}}}");
            return Ok(());
        }
        if self.form == Form::Csv {
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
        json!(args(words).question().sources)
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
