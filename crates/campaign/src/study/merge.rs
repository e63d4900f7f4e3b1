//! Merges shards flown elsewhere into a campaign's folder.
//!
//! ```text
//!  part-0/shards/000000.parquet ─┐
//!  part-1/shards/000001.parquet ─┼─▶ whole/shards ─▶ campaign.parquet, summary.json, …
//!  part-2/shards/000001.parquet ─┘   must be identical to part-1's, or it is rejected
//! ```
//! In any order, repeatably. A flight depends on its campaign and its number alone, so two folders with the same shard contain the
//! same bytes; if they differ, a machine or a program is at fault, and there is no telling which.

use super::folder::{CampaignFolder, shard_name};
use super::own;
use super::plan::Campaign;
use std::path::Path;

/// Copies the shards of the folder `from` that `into` lacks, and the scores of detectors that judge after the flight; returns the number of shards.
/// Shards copied before an error stay.
///
/// # Errors
/// `from` is not a folder of this campaign, was flown by another program, is in use, or contains an unreadable shard or one that
/// differs from that of `into`; so with its scores.
pub fn take_in(into: &CampaignFolder, from: &Path, campaign: &Campaign) -> Result<u64, String> {
    if from.canonicalize().ok() == into.path().canonicalize().ok() && from.exists() {
        return Err(format!(
            "{}: is the folder of the whole; expected another",
            from.display()
        ));
    }
    let part = CampaignFolder::open_present(from, campaign)?;
    let place = from.display().to_string();
    let mut taken = 0;
    for shard in (0..part.shard_count()).filter(|shard| part.has_shard(*shard)) {
        taken += u64::from(take_in_shard(into, &place, shard, &part.shard_bytes(shard)?)?);
    }
    own::take_in(into, &part)?;
    Ok(taken)
}

/// Merges one shard from `place`, a folder or an address; `false` if it already exists with the same bytes.
///
/// # Errors
/// It cannot be read, or differs from that of `into`.
pub fn take_in_shard(into: &CampaignFolder, place: &str, shard: u64, content: &[u8]) -> Result<bool, String> {
    if !into.has_shard(shard) {
        into.put_shard(shard, content, &format!("{place}/{}", shard_name(shard)))?;
        return Ok(true);
    }
    if content == into.shard_bytes(shard)? {
        return Ok(false);
    }
    Err(different(place, &into.path().display().to_string(), shard))
}

/// Two places have different bytes for the same flights.
pub fn different(place: &str, other: &str, shard: u64) -> String {
    format!(
        "{place}: shard {shard} differs from that in {other}: the same flights gave different results on two machines, or a file is \
         damaged; fly it again and compare"
    )
}
