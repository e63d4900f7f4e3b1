//! Accuracy of the detectors on a log with known truth, as JSON: the output of `rotortwin fdi-log --truth` and `POST
//! /api/v1/fdi/scores`.

use super::score::DetectorScore;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Score of the detectors on one log.
#[derive(Debug, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LogScore {
    /// First damage, s of the log's time.
    pub onset_s: Option<f64>,
    /// Windows that the log's duration holds, judged or not: those of a detector that have a verdict are its `windows`, the rest is
    /// on the ground, in a calibration or could not be judged.
    pub windows: u64,
    /// Each detector.
    pub detectors: Vec<NamedScore>,
    /// Windows of the sequential detector that name the correct rotors while the loss is constant, with each loss inside its 95 % interval.
    pub inside: u64,
    /// Total number.
    pub inside_of: u64,
}

/// Counts of one detector by its name; `by_severity` is empty if a loss is of unknown size.
#[derive(Debug, Serialize, Deserialize, ToSchema)]
pub struct NamedScore {
    /// `t_test`, `network` or `sequential`.
    pub detector: String,
    /// Its counts.
    #[serde(flatten)]
    pub score: DetectorScore,
}
