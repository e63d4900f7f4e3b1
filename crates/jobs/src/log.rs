//! Flight logs are imported, or made as examples.

use rotortwin_blind::example::Example;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// A flight log is brought into canonical form: `log.csv` gives `log.parquet`, `log.toml`, and the account of the import `log.import.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LogImport {
    /// The log; its ending says what it is.
    pub file: PathBuf,
    /// Folder for them.
    pub out: PathBuf,
    /// Take what can be read of a file whose checksum is wrong.
    #[serde(default)]
    pub damaged: bool,
    /// Of a simulated run, take the truth instead of what was sensed.
    #[serde(default)]
    pub truth: bool,
    /// Vehicle document to hold the log against: number and order of the rotors.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vehicle: Option<PathBuf>,
    /// Mapping file whose rows go before the built-in ones.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mapping: Option<PathBuf>,
    /// Bring every column to this constant rate, Hz.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate_hz: Option<f64>,
    /// Take the estimated delays out of attitude, velocity and position.
    #[serde(default)]
    pub align: bool,
}

/// A flight of the independent simulator as a log: what [`LogImport`] leaves under the name `log`, and `truth.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LogExample {
    /// Vehicle document.
    pub vehicle: PathBuf,
    /// What it is to show; unset: `effect`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub preset: Option<Example>,
    /// What is hidden: an id, or `id:parameter=value,…`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub effect: Option<String>,
    /// Of every random stream, and of what is drawn.
    pub seed: u64,
    /// s.
    pub duration_s: f64,
    /// Folder for the files.
    pub out: PathBuf,
}
