//! Why a log is refused: each error is one sentence that names the file and, where there is one, the row and the column.

use std::path::{Path, PathBuf};

/// A flight log that is not accepted. Nothing of it is kept.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// The operating system refused.
    #[error("{}: {action}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What was being done, "cannot …".
        action: &'static str,
        /// Why.
        source: std::io::Error,
    },
    /// The file as a whole is invalid.
    #[error("{}: {reason}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What was found and what was expected.
        reason: String,
    },
    /// One cell cannot be accepted. Rows count from 1, the first after the header.
    #[error("{}: row {row}, column {column}: {reason}", path.display())]
    Cell {
        /// The file.
        path: PathBuf,
        /// Data row, from 1.
        row: usize,
        /// Column as named in the file.
        column: String,
        /// What was found and what was expected.
        reason: String,
    },
    /// A whole column cannot be right.
    #[error("{}: column {column}: {reason}", path.display())]
    Column {
        /// The file.
        path: PathBuf,
        /// Column as named in the file.
        column: String,
        /// What was found and what was expected.
        reason: String,
    },
}

impl LogError {
    pub(crate) fn format(path: &Path, reason: impl Into<String>) -> Self {
        Self::Format {
            path: path.to_path_buf(),
            reason: one_line(&reason.into()),
        }
    }

    pub(crate) fn cell(path: &Path, row: usize, column: &str, reason: impl Into<String>) -> Self {
        Self::Cell {
            path: path.to_path_buf(),
            row,
            column: one_line(column),
            reason: one_line(&reason.into()),
        }
    }

    pub(crate) fn column(path: &Path, column: &str, reason: impl Into<String>) -> Self {
        Self::Column {
            path: path.to_path_buf(),
            column: one_line(column),
            reason: one_line(&reason.into()),
        }
    }
}

/// `map_err` helper: an I/O error with its file and what was being done.
pub(crate) fn io<'a>(path: &'a Path, action: &'static str) -> impl FnOnce(std::io::Error) -> LogError + 'a {
    move |source| LogError::Io {
        path: path.to_path_buf(),
        action,
        source,
    }
}

/// What a damaged file spells, quoted in a sentence, must not break it: control characters are written out.
fn one_line(text: &str) -> String {
    let mut line = String::with_capacity(text.len());
    for c in text.chars() {
        if c.is_control() {
            line.extend(c.escape_default());
        } else {
            line.push(c);
        }
    }
    line
}
