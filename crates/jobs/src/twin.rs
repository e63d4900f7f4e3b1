//! Comparison of a model with flights.
//!
//! `logs` are flight logs of any source, or run folders; `LOG@35:65` selects only these seconds, `LOG@NAME` a segment. A model is named as
//! on the command line: `MODEL`, `MODEL@BRANCH` or `MODEL@v2` in the folder `models`, or the path of a version or vehicle file.

use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use utoipa::ToSchema;

/// Compares models with flights: where, when and by how much they disagree.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[schema(as = ComparisonJob)]
pub struct Comparison {
    /// The flights.
    #[schema(value_type = Vec<String>)]
    pub logs: Vec<PathBuf>,
    /// The models.
    pub model: Vec<String>,
    /// Labels in the result, one per model; empty: their names.
    #[serde(default)]
    pub label: Vec<String>,
    /// Folder of the models.
    #[schema(value_type = String)]
    pub models: PathBuf,
    /// Output folder for the report and its files.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>)]
    pub out: Option<PathBuf>,
}

/// Which effects a model lacks on flights of one vehicle.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[schema(as = DiagnosisJob)]
pub struct Diagnosis {
    /// The flights.
    #[schema(value_type = Vec<String>)]
    pub logs: Vec<PathBuf>,
    /// The model.
    pub model: String,
    /// Folder of the models.
    #[schema(value_type = String)]
    pub models: PathBuf,
    /// Additional effect documents of the caller to consider.
    #[serde(default)]
    #[schema(value_type = Vec<String>)]
    pub effects: Vec<PathBuf>,
    /// Healthy flights of the same vehicle; none, or at least three.
    #[serde(default)]
    #[schema(value_type = Vec<String>)]
    pub baseline: Vec<PathBuf>,
    /// Output folder for the diagnosis and the proposed model.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>)]
    pub out: Option<PathBuf>,
    /// Time limit of the search, s; it then returns what has been proved so far; absent: ten minutes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_limit_s: Option<u32>,
}

/// Compare, diagnose, add what is missing, compare again, until the model agrees or the reason why it does not is known.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[schema(as = ImprovementJob)]
pub struct Improvement {
    /// Flights of one vehicle to learn from.
    #[schema(value_type = Vec<String>)]
    pub logs: Vec<PathBuf>,
    /// Held-out flights of the same vehicle, not used in any fit.
    #[serde(default)]
    #[schema(value_type = Vec<String>)]
    pub held_out: Vec<PathBuf>,
    /// `MODEL` or `MODEL@BRANCH`; a vehicle file starts a model with its name.
    pub model: String,
    /// Folder of the models; accepted versions are kept there.
    #[schema(value_type = String)]
    pub models: PathBuf,
    /// The effects that are truly missing, if known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>)]
    pub truth: Option<PathBuf>,
    /// Output folder for the report and its files.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>)]
    pub out: Option<PathBuf>,
    /// File for the final version.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>)]
    pub final_version: Option<PathBuf>,
    /// Time limit of each search, s; it then returns what has been proved so far; absent: ten minutes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_limit_s: Option<u32>,
}

/// Identifies a vehicle from flight logs, its mass and its arm length: `vehicle.toml`, its blades and its
/// intervals.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = IdentificationJob)]
pub struct Identification {
    /// Flights of one vehicle.
    #[schema(value_type = Vec<String>)]
    pub logs: Vec<PathBuf>,
    /// Mass including battery, kg.
    pub mass_kg: f64,
    /// Distance from the centre to the farthest rotor, m.
    pub arm_m: f64,
    /// Frame, if the log does not contain it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frame: Option<String>,
    /// Use the frame even if the motion contradicts it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub trust_frame: bool,
    /// Battery capacity, A h.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub capacity_ah: Option<f64>,
    /// Cells in series.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cells: Option<u32>,
    /// Fit each half of each flight and score it on the other.
    #[serde(default)]
    pub held_out: bool,
    /// Thrust benches of one rotor, or datasheet tables.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[schema(value_type = Vec<String>)]
    pub bench: Vec<PathBuf>,
    /// `NAME.toml`, the document of the vehicle, with its blades, intervals and report in the same folder; unset: nothing is written.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>)]
    pub out: Option<PathBuf>,
}

/// The manoeuvre that would distinguish two effects.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[schema(as = NextFlightJob)]
pub struct NextFlight {
    /// The current model.
    pub model: String,
    /// Folder of the models.
    #[schema(value_type = String)]
    pub models: PathBuf,
    /// The two effects: `mass`, `rotor-thrust-scale#3`.
    pub between: [String; 2],
    /// File for the best manoeuvre as a scenario; unset: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>)]
    pub out: Option<PathBuf>,
    /// Seed of that scenario.
    #[serde(default = "first_seed")]
    pub seed: u64,
}

const fn first_seed() -> u64 {
    1
}
