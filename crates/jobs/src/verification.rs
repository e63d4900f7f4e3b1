//! Replay of a recorded run.

use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use utoipa::ToSchema;

/// A done run is flown a second time, in one process, and its run hash compared.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[schema(as = VerificationJob)]
pub struct Verification {
    /// Its folder: the summary, and what an autopilot sent if one flew.
    #[schema(value_type = String)]
    pub run: PathBuf,
}

/// What a second execution gave.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Verified {
    /// Run hash of the first execution.
    pub recorded: String,
    /// Run hash of the second.
    pub replayed: String,
    /// Whether they are the same.
    pub same: bool,
    /// Why the hashes may differ: the two executions were flown by different controllers. Absent otherwise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
}
