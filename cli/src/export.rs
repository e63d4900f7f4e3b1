//! `rotortwin export`: exports a whole run to one file in a format that other programs read.

use crate::output;
use clap::{Parser, ValueEnum};
use rotortwin_runner::failure::Failure;
use rotortwin_store::export::{ExportFormat, export_to};
use rotortwin_store::query::QueryError;
use std::path::PathBuf;
use std::process::ExitCode;

/// Arguments of `rotortwin export`.
#[derive(Debug, Parser)]
pub struct Args {
    /// Run folder, or its telemetry.parquet
    run: PathBuf,
    /// What to write
    #[arg(long, value_enum)]
    format: FormatArg,
    /// File to write; must not exist [default: the run's name in the current folder]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

/// Formats.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum FormatArg {
    /// PX4's log format: Flight Review, PlotJuggler, pyulog
    Ulog,
    /// Foxglove, Lichtblick
    Mcap,
    /// pandas, Polars, DuckDB
    Parquet,
    /// Everything else
    Csv,
}

impl From<FormatArg> for ExportFormat {
    fn from(format: FormatArg) -> Self {
        match format {
            FormatArg::Ulog => Self::Ulog,
            FormatArg::Mcap => Self::Mcap,
            FormatArg::Parquet => Self::Parquet,
            FormatArg::Csv => Self::Csv,
        }
    }
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> ExitCode {
    let format = ExportFormat::from(args.format);
    let out = args.out.clone().unwrap_or_else(|| {
        let folder = if args.run.is_dir() {
            Some(args.run.as_path())
        } else {
            args.run.parent()
        };
        let name = folder.and_then(|folder| folder.canonicalize().ok());
        let name = name
            .as_deref()
            .and_then(std::path::Path::file_name)
            .unwrap_or("run".as_ref());
        PathBuf::from(format!("{}.{}", name.to_string_lossy(), format.extension()))
    });
    if out.exists() {
        return output::bad_input(format!(
            "{}: already exists; name another file with --out",
            out.display()
        ));
    }
    match export_to(&args.run, format, &out) {
        Ok(()) => {
            println!("{}", out.display());
            ExitCode::SUCCESS
        }
        Err(error @ QueryError::Output { .. }) => {
            output::told(&Failure::writing(&out, format!("{}: {error}", out.display())))
        }
        Err(error) => output::bad_input(error),
    }
}
