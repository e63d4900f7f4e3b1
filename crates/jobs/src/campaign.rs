//! Campaigns: many flights with statistics.

use crate::span::Span;
use serde::{Deserialize, Serialize};
use std::num::NonZeroUsize;
use std::ops::Range;
use std::path::PathBuf;
use utoipa::ToSchema;

/// A campaign, or some of its shards. Flights that are already in its folder are not repeated; if the shards of
/// all parts are there, only their results are combined.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[schema(as = CampaignJob)]
pub struct Campaign {
    /// The campaign document. Scenarios and vehicles are found relative to it.
    #[schema(value_type = String)]
    pub campaign: PathBuf,
    /// Folder of the campaign; an incomplete campaign in it is resumed.
    #[schema(value_type = String)]
    pub out: PathBuf,
    /// Only these shards of 32 flights, without combining results; unset: the whole campaign.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Span>)]
    pub shards: Option<Range<u64>>,
    /// Stop after about this many flights; the same job resumes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limit: Option<u64>,
    /// Threads; unset: as many as the machine has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<usize>, minimum = 1)]
    pub threads: Option<NonZeroUsize>,
}
