//! Errors of run folders; each message is one sentence that names the file.

use std::path::{Path, PathBuf};

/// Error of this crate.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// An operating system error.
    #[error("{}: {action}: {source}", path.display())]
    Io {
        /// File or folder.
        path: PathBuf,
        /// Attempted action, "cannot …".
        action: &'static str,
        /// Why.
        source: std::io::Error,
    },
    /// The folder for a new run is not empty.
    #[error("{}: the folder is not empty; choose a new or empty one for this run", path.display())]
    FolderNotEmpty {
        /// The folder.
        path: PathBuf,
    },
    /// The path for a new run folder is a file.
    #[error("{}: not a folder; choose a new or empty folder for this run", path.display())]
    NotAFolder {
        /// The path.
        path: PathBuf,
    },
    /// No run found here.
    #[error("{}: no run here ({expected} is missing)", path.display())]
    NoRun {
        /// The folder.
        path: PathBuf,
        /// The file that was expected.
        expected: &'static str,
    },
    /// The run in this folder was interrupted: only its spool exists.
    #[error("{}: this run was interrupted before it could be written; only its spool is left", path.display())]
    Interrupted {
        /// The folder.
        path: PathBuf,
    },
    /// The file is not a spool that this program can read.
    #[error("{}: not a telemetry spool: {reason}", path.display())]
    NotASpool {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// Rotor count above the maximum of a row.
    #[error("a run cannot be recorded with {count} rotors; 1 to {max} are possible", max = rotortwin_flight_core::MAX_ROTORS)]
    RotorCount {
        /// The count.
        count: usize,
    },
    /// The summary is invalid.
    #[error("{}: not a summary that this program can read: {source}", path.display())]
    Summary {
        /// The file.
        path: PathBuf,
        /// Why.
        source: serde_json::Error,
    },
    /// A summary with another format version.
    #[error("{}: summary format {found}; this program reads format {expected}", path.display())]
    SummaryVersion {
        /// The file.
        path: PathBuf,
        /// Version in the file.
        found: u64,
        /// Supported version.
        expected: u32,
    },
    /// The telemetry could not be read for the report.
    #[error("the report: {source}")]
    Report {
        /// The file.
        path: PathBuf,
        /// Why; names the file.
        source: Box<crate::query::QueryError>,
    },
    /// The telemetry could not be read.
    #[error("{0}")]
    Telemetry(#[source] Box<crate::query::QueryError>),
    /// Parquet could not be written.
    #[error("{}: cannot write Parquet: {source}", path.display())]
    Parquet {
        /// The file.
        path: PathBuf,
        /// Why.
        source: parquet::errors::ParquetError,
    },
    /// MCAP could not be read.
    #[error("{}: this MCAP file cannot be read: {source}", path.display())]
    McapRead {
        /// The file.
        path: PathBuf,
        /// Why.
        source: mcap::McapError,
    },
    /// The run cannot be judged by a detector of the user's own.
    #[error("{}: {reason}", path.display())]
    Judge {
        /// The run.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// MCAP could not be written.
    #[error("{}: cannot write MCAP: {source}", path.display())]
    Mcap {
        /// The file.
        path: PathBuf,
        /// Why.
        source: mcap::McapError,
    },
}

impl From<crate::query::QueryError> for StoreError {
    fn from(source: crate::query::QueryError) -> Self {
        Self::Telemetry(Box::new(source))
    }
}

/// `map_err` helper: an I/O error with its file and the attempted action.
pub(crate) fn io<'a>(path: &'a Path, action: &'static str) -> impl FnOnce(std::io::Error) -> StoreError + 'a {
    move |source| StoreError::Io {
        path: path.to_path_buf(),
        action,
        source,
    }
}

/// Result of this crate.
pub type Result<T> = std::result::Result<T, StoreError>;
