//! Import and creation of flight logs.

use rotortwin_blind::example::Example;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Import of a flight log into canonical form: `log.csv` gives `log.parquet`, `log.toml`, and the import report `log.import.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LogImport {
    /// The log; its extension determines the format.
    pub file: PathBuf,
    /// Output folder.
    pub out: PathBuf,
    /// Accept the readable part of a file with a wrong checksum.
    #[serde(default)]
    pub damaged: bool,
    /// For a simulated run, use the truth instead of the sensed values.
    #[serde(default)]
    pub truth: bool,
    /// Vehicle document to check the log against: number and order of the rotors.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vehicle: Option<PathBuf>,
    /// Mapping file that takes precedence over the built-in ones.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mapping: Option<PathBuf>,
    /// Resample every column to this constant rate, Hz.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate_hz: Option<f64>,
    /// Remove the estimated delays from attitude, velocity and position.
    #[serde(default)]
    pub align: bool,
}

/// A flight of the independent simulator as a log: the output of [`LogImport`] under the name `log`, and `truth.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LogExample {
    /// Vehicle document.
    pub vehicle: PathBuf,
    /// Preset; unset: `effect`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub preset: Option<Example>,
    /// Hidden effect: an id, or `id:parameter=value,…`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub effect: Option<String>,
    /// Seed of every random stream and draw.
    pub seed: u64,
    /// Length, s.
    pub duration_s: f64,
    /// Output folder.
    pub out: PathBuf,
}
