//! Training of classifiers.

use serde::{Deserialize, Serialize};
use std::num::NonZeroUsize;
use std::path::PathBuf;
use utoipa::ToSchema;

/// A classifier to be trained: the same seeds give the same bits.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[schema(as = TrainingJob)]
pub struct Training {
    /// Inputs and training of the network.
    pub method: Method,
    /// Scenario that gives vehicle, controller, sensors and detector settings.
    #[schema(value_type = String)]
    pub scenario: PathBuf,
    /// Number of data sets (one per seed).
    pub seeds: u32,
    /// First seed; the others follow.
    pub first_seed: u64,
    /// Classifier file to write.
    #[schema(value_type = String)]
    pub out: PathBuf,
    /// Threads; unset: as many as the machine has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<usize>, minimum = 1)]
    pub threads: Option<NonZeroUsize>,
}

/// What the network reads and how it is trained.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// As in the paper, for scenarios with `nominal_thrust = "static"`.
    #[default]
    Paper,
    /// Rotor lag in the residuals, self-calibrated, Adam; for scenarios with `nominal_thrust = "lagged"`.
    Improved,
}

impl Method {
    /// Name in JSON and on the command line.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Improved => "improved",
        }
    }
}
