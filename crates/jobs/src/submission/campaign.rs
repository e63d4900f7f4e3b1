//! A campaign to submit.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Many flights: grids and random draws over any setting of a scenario, with statistics of the detectors.
#[derive(Debug, Clone, Default, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CampaignSubmission {
    /// Name of one of the server's campaigns; or give `text`.
    #[serde(default)]
    pub campaign: Option<String>,
    /// A campaign document (TOML), as in the library's `campaigns`; at most 256 KiB.
    #[serde(default)]
    #[schema(max_length = 262_144)]
    pub text: Option<String>,
    /// Id of a classifier that was trained here: the network of the FDI engine in every flight, instead of that of
    /// the scenario.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub classifier: Option<String>,
    /// From −100 to 100; larger values run first.
    #[serde(default)]
    #[schema(minimum = -100, maximum = 100)]
    pub priority: i64,
    /// Time limit of an attempt at a part, s of wall time; default 6 h.
    #[serde(default)]
    #[schema(minimum = 1, maximum = 86_400)]
    pub max_wall_s: Option<u64>,
}
