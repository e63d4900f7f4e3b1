//! An invalid document, reported in one sentence with file, line and key.

use std::fmt;

/// A scenario, vehicle or blade document that cannot be flown.
///
/// Displays as one sentence that names file, line and key, and says what was expected:
///
/// ```text
/// config/scenarios/hover.toml, line 12, key `fault[0].rotor`: expected a rotor from 1 to 6, got 7
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ConfigError {
    file: String,
    line: Option<usize>,
    key: Option<String>,
    reason: String,
}

impl ConfigError {
    /// An error in `file`, at a line and key where these are known.
    pub fn new(file: &str, line: Option<usize>, key: Option<String>, reason: impl Into<String>) -> Self {
        Self {
            file: file.to_owned(),
            line,
            key,
            reason: reason.into(),
        }
    }

    /// The document, as named by the caller.
    pub fn file(&self) -> &str {
        &self.file
    }

    /// Line of the key, from 1; absent if the document as a whole is concerned.
    pub fn line(&self) -> Option<usize> {
        self.line
    }

    /// Dotted path of the key, such as `fault[0].rotor` (list entries from 0).
    pub fn key(&self) -> Option<&str> {
        self.key.as_deref()
    }

    /// What was expected and what was found.
    pub fn reason(&self) -> &str {
        &self.reason
    }
}

impl fmt::Display for ConfigError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(&self.file)?;
        if let Some(line) = self.line {
            write!(out, ", line {line}")?;
        }
        if let Some(key) = &self.key {
            write!(out, ", key `{key}`")?;
        }
        write!(out, ": {}", self.reason)
    }
}

impl std::error::Error for ConfigError {}
