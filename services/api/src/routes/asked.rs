//! The flights and models named in a request. For how they are found see [`super::tasks`].

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Flights to compare a model with.
#[derive(Debug, Clone, Default, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct Flights {
    /// Ids of imported logs; `ID@35:65` takes only these seconds.
    #[serde(default)]
    pub(super) logs: Vec<String>,
    /// Ids of runs that are done; `ID@35:65` takes only these seconds.
    #[serde(default)]
    pub(super) runs: Vec<String>,
}

/// The model.
#[derive(Debug, Clone, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct ModelChoice {
    /// Name of one of the server's vehicles: its nominal model.
    #[serde(default)]
    pub(super) vehicle: Option<String>,
    /// Id of an improvement: its final model.
    #[serde(default)]
    pub(super) improvement: Option<String>,
    /// A version of a model, as `rotortwin model export` writes it (TOML).
    #[serde(default)]
    pub(super) version: Option<String>,
    /// Name of a model, under `/api/v1/models`: its version at the head of `main`, or `NAME@v1`, `NAME@BRANCH`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) model: Option<String>,
    /// Comparison: label of the model in the result.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(min_length = 1, max_length = 200)]
    pub(super) label: Option<String>,
}
