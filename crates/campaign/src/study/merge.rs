//! Shards that were flown elsewhere are taken into a campaign's folder.
//!
//! ```text
//!  part-0/shards/000000.parquet ─┐
//!  part-1/shards/000001.parquet ─┼─▶ whole/shards ─▶ campaign.parquet, summary.json, …
//!  part-2/shards/000001.parquet ─┘   the same bytes as part-1's, or they are refused
//! ```
//! Any order, any number of times. A flight depends on its campaign and its number alone, so two folders that hold the same shard hold the
//! same bytes; where they do not, a machine or a program went wrong, and nothing says which.

use super::folder::CampaignFolder;
use super::plan::Campaign;
use std::path::Path;

/// Copies the shards of the folder `from` that `into` lacks; how many. An error is one sentence; what was copied before it stays.
///
/// # Errors
/// `from` is no folder of this campaign, was flown by another program, is being worked on, holds a shard that cannot be read, or one that
/// `into` has otherwise.
pub fn take_in(into: &CampaignFolder, from: &Path, campaign: &Campaign) -> Result<u64, String> {
    if from.canonicalize().ok() == into.path().canonicalize().ok() && from.exists() {
        return Err(format!(
            "{}: is the folder of the whole; expected another",
            from.display()
        ));
    }
    let part = CampaignFolder::open_present(from, campaign)?;
    let mut taken = 0;
    for shard in (0..part.shard_count()).filter(|shard| part.has_shard(*shard)) {
        if into.has_shard(shard) {
            if part.shard_bytes(shard)? != into.shard_bytes(shard)? {
                return Err(format!(
                    "{}: shard {shard} is another one than in {}: the same flights gave different results on two machines, or a file is \
                     damaged; fly it again and compare",
                    from.display(),
                    into.path().display()
                ));
            }
            continue;
        }
        // What cannot be read is refused here, where its folder can be named.
        part.read_shard(shard)?;
        into.copy_shard(shard, &part)?;
        taken += 1;
    }
    Ok(taken)
}
