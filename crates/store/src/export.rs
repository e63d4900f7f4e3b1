//! Exports a whole run to one file in a format that other programs read.
//!
//! | format | from | for |
//! |---|---|---|
//! | `parquet`, `mcap` | already in the folder | pandas, Polars, DuckDB; Foxglove, Lichtblick |
//! | `ulog` | written from `telemetry.parquet` | Flight Review, PlotJuggler, pyulog |
//! | `csv` | the same | everything else |
//!
//! The same run gives the same bytes each time.

use crate::files::{MCAP_FILE, TELEMETRY_FILE};
use crate::query::{QueryError, TelemetryFile, render};
use crate::ulog::write_ulog;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

/// Export format.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ExportFormat {
    /// PX4's log format.
    Ulog,
    /// Streams of protobuf messages.
    Mcap,
    /// A table of columns.
    Parquet,
    /// A table of text.
    Csv,
}

impl ExportFormat {
    /// Corresponding file of the run folder; `None`: it must be written.
    pub const fn file(self) -> Option<&'static str> {
        match self {
            Self::Mcap => Some(MCAP_FILE),
            Self::Parquet => Some(TELEMETRY_FILE),
            Self::Ulog | Self::Csv => None,
        }
    }

    /// File extension.
    pub const fn extension(self) -> &'static str {
        match self {
            Self::Ulog => "ulg",
            Self::Mcap => "mcap",
            Self::Parquet => "parquet",
            Self::Csv => "csv",
        }
    }

    /// Media type.
    pub const fn content_type(self) -> &'static str {
        match self {
            Self::Parquet => "application/vnd.apache.parquet",
            Self::Csv => "text/csv; charset=utf-8",
            Self::Ulog | Self::Mcap => "application/octet-stream",
        }
    }
}

/// Writes telemetry as ULog or CSV into an open file, or copies formats that already exist.
///
/// * `telemetry`: a run's `telemetry.parquet`; MCAP is taken from the same folder
///
/// # Errors
/// A file is missing or damaged, or cannot be written.
pub fn export(telemetry: &Path, format: ExportFormat, out: &File) -> Result<(), QueryError> {
    let mut buffered = BufWriter::new(out);
    match format {
        ExportFormat::Ulog => write_ulog(&TelemetryFile::open(telemetry)?, &mut buffered)?,
        ExportFormat::Csv => render::whole_csv(&TelemetryFile::open(telemetry)?, &mut buffered)?,
        ExportFormat::Mcap | ExportFormat::Parquet => {
            let path = telemetry.with_file_name(format.file().unwrap_or(TELEMETRY_FILE));
            let mut source = File::open(&path).map_err(|source| QueryError::Io { path, source })?;
            std::io::copy(&mut source, &mut buffered).map_err(|source| QueryError::Output { source })?;
        }
    }
    let flushed = buffered.into_inner().map_err(std::io::IntoInnerError::into_error);
    flushed.map(drop).map_err(|source| QueryError::Output { source })
}

/// Exports a run into `out`, which appears only when complete; an existing file is replaced.
///
/// * `run`: the run's folder, or its `telemetry.parquet`
///
/// # Errors
/// As [`export`].
pub fn export_to(run: &Path, format: ExportFormat, out: &Path) -> Result<(), QueryError> {
    let telemetry = if run.is_dir() {
        run.join(TELEMETRY_FILE)
    } else {
        run.to_path_buf()
    };
    let refused = |path: &Path| {
        let path = path.to_path_buf();
        move |source| QueryError::Io { path, source }
    };
    let mut part = PathBuf::from(out).into_os_string();
    part.push(".part");
    let part = PathBuf::from(part);
    let file = File::create(&part).map_err(refused(&part))?;
    let written = export(&telemetry, format, &file).and_then(|()| std::fs::rename(&part, out).map_err(refused(out)));
    if written.is_err() {
        // The partial file is useless; failing to remove it does no further harm.
        drop(std::fs::remove_file(&part));
    }
    written
}
