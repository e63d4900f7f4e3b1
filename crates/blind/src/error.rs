//! Errors of the generator, in one sentence each: what, where, what was expected.

use std::path::PathBuf;

/// A refusal or a failure of the generator.
#[derive(Debug, thiserror::Error)]
pub enum BlindError {
    /// A file could not be read or written.
    #[error("{action} `{path}`: {source}")]
    File {
        /// What was being done, e.g. "reading the vehicle document".
        action: &'static str,
        /// Which file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A file or an argument has unexpected content.
    #[error("{place}: {reason}")]
    Input {
        /// Where: a file and key, or an argument.
        place: String,
        /// What was expected and what was found.
        reason: String,
    },
    /// The vehicle left the air or its limits.
    #[error("the flight was lost at {time_s:.2} s: {reason}")]
    FlightLost {
        /// s since the start.
        time_s: f64,
        /// What happened.
        reason: &'static str,
    },
    /// The Parquet file could not be written.
    #[error("writing the log: {0}")]
    Parquet(#[from] parquet::errors::ParquetError),
}

impl BlindError {
    pub(crate) fn input(place: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Input {
            place: place.into(),
            reason: reason.into(),
        }
    }

    pub(crate) fn file(action: &'static str, path: impl Into<PathBuf>, source: std::io::Error) -> Self {
        Self::File {
            action,
            path: path.into(),
            source,
        }
    }
}

/// Result of this crate.
pub type Result<T> = std::result::Result<T, BlindError>;
