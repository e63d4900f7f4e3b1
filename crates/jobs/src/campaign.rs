//! Campaigns: many flights with statistics.

use serde::{Deserialize, Serialize};
use std::num::NonZeroUsize;
use std::ops::Range;
use std::path::PathBuf;

/// A campaign, or some of its shards. What its folder holds already is not flown again: over the shards of all parts it only puts the
/// results together.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Campaign {
    /// The campaign document. Scenarios and vehicles are found relative to it.
    pub campaign: PathBuf,
    /// Folder of the campaign; one that holds a part of it is continued.
    pub out: PathBuf,
    /// Only these shards of 32 flights, which are left as they are; unset: the whole campaign.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shards: Option<Range<u64>>,
    /// Stop after about this many flights; the same job continues.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limit: Option<u64>,
    /// Threads; unset: as many as the machine has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub threads: Option<NonZeroUsize>,
}
