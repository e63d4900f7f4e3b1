//! A run that was done is flown again.

use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// A run that was done is flown again, in one process, and its run hash compared.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Verification {
    /// Its folder: the summary, and what an autopilot sent if one flew.
    pub run: PathBuf,
}
