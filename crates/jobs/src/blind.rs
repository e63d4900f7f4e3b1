//! Blind benches: logs with hidden effects from an independent simulator, each diagnosed, and the answers scored.

use rotortwin_blind::bench::cases::Preset;
use serde::{Deserialize, Serialize};
use std::num::NonZeroUsize;
use std::ops::Range;
use std::path::PathBuf;

/// A blind bench, or some of its cases. Existing results in its folder are not recomputed: with the rows of all parts it only computes the
/// score.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BlindBench {
    /// Presets to run, one after another.
    pub presets: Vec<Preset>,
    /// Cases of each preset.
    pub n: usize,
    /// Seed of the draws.
    pub seed: u64,
    /// Vehicle documents, taken in turn.
    pub vehicles: Vec<String>,
    /// Length of a flight, s.
    pub duration_s: f64,
    /// Folder of the results; an interrupted bench resumes there.
    pub out: PathBuf,
    /// Only these cases, counted over all presets; unset: all, and the score.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cases: Option<Range<u64>>,
    /// Processes at a time; unset: 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub processes: Option<NonZeroUsize>,
    /// Keep the generated logs.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub keep_logs: bool,
}
