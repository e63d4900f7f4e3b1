//! Replay of a recorded run.

use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use utoipa::ToSchema;

/// A second execution of a done run, in one process, to compare the run hashes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[schema(as = VerificationJob)]
pub struct Verification {
    /// Its folder: the summary, and the messages of the autopilot if one flew.
    #[schema(value_type = String)]
    pub run: PathBuf,
}

/// Result of a second execution.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Verified {
    /// Run hash of the first execution.
    pub recorded: String,
    /// Run hash of the second.
    pub replayed: String,
    /// Whether the hashes are equal.
    pub same: bool,
    /// Why the hashes may differ: the two executions were flown by different controllers. Absent otherwise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
}
