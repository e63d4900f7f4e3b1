//! Import and creation of flight logs.

use rotortwin_blind::example::Example;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use utoipa::ToSchema;

/// Conversion of a flight log to canonical form: `log.csv` gives `log.parquet`, `log.toml`, and the import report
/// `log.import.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = LogImportJob)]
pub struct LogImport {
    /// The log; its file extension determines the format.
    #[schema(value_type = String)]
    pub file: PathBuf,
    /// Output folder.
    #[schema(value_type = String)]
    pub out: PathBuf,
    /// Accept the readable part of a file with a wrong checksum.
    #[serde(default)]
    pub damaged: bool,
    /// For a simulated run, use the truth instead of the sensed values.
    #[serde(default)]
    pub truth: bool,
    /// Vehicle document to check the log against: number and order of the rotors.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>)]
    pub vehicle: Option<PathBuf>,
    /// Mapping file that takes precedence over the built-in ones.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>)]
    pub mapping: Option<PathBuf>,
    /// Resample every column to this constant rate, Hz.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate_hz: Option<f64>,
    /// Remove the estimated delays from attitude, velocity and position.
    #[serde(default)]
    pub align: bool,
}

/// A flight of the independent simulator as a log: the output of [`LogImport`] under the name `log`, and
/// `truth.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = LogExampleJob)]
pub struct LogExample {
    /// Vehicle document.
    #[schema(value_type = String)]
    pub vehicle: PathBuf,
    /// Preset; unset: `effect`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub preset: Option<Example>,
    /// Hidden effect: an id, or `id:parameter=value,…`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub effect: Option<String>,
    /// Seed of all random streams and draws.
    pub seed: u64,
    /// Length, s.
    pub duration_s: f64,
    /// A case of a blind bench, flown again with its seed; unset: an excitation flight according to `preset` or
    /// `effect`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub case: Option<ExampleCase>,
    /// Output folder.
    #[schema(value_type = String)]
    pub out: PathBuf,
}

/// Settings of the generator for a case of a blind bench, except vehicle, length and seed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = LogExampleCase)]
pub struct ExampleCase {
    /// Built-in flight.
    pub flight: String,
    /// Hidden effects, each as `id:parameter=value,…`; a companion comes before the effect that needs it.
    pub effects: Vec<String>,
    /// With small deviations in all other parameters.
    pub clutter: bool,
    /// Factor on the generator's white force and torque.
    pub disturbance: f64,
}
