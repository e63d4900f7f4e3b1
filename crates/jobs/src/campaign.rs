//! Campaigns: many flights with statistics.

use serde::{Deserialize, Serialize};
use std::num::NonZeroUsize;
use std::ops::Range;
use std::path::PathBuf;

/// A campaign, or some of its shards. Existing shards in its folder are not flown again: with the shards of all parts it only
/// combines the results.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Campaign {
    /// The campaign document. Scenarios and vehicles are found relative to it.
    pub campaign: PathBuf,
    /// Folder of the campaign; a partial one is resumed.
    pub out: PathBuf,
    /// Only these shards of 32 flights, without combining results; unset: the whole campaign.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shards: Option<Range<u64>>,
    /// Stop after about this many flights; the same job resumes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limit: Option<u64>,
    /// Threads; unset: as many as the machine has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub threads: Option<NonZeroUsize>,
}
