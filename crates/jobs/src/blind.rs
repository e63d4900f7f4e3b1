//! Blind benches: logs with hidden effects from an independent simulator, each diagnosed, and the answers scored.

use crate::span::Span;
use rotortwin_blind::bench::cases::Preset;
use serde::{Deserialize, Serialize};
use std::num::NonZeroUsize;
use std::ops::Range;
use std::path::PathBuf;
use utoipa::ToSchema;

/// A blind bench, or some of its cases. Cases that are already in its folder are not repeated; if the rows of all
/// parts are there, only the score is computed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = BlindBenchJob)]
pub struct BlindBench {
    /// Presets to run, one after another.
    pub presets: Vec<Preset>,
    /// Cases per preset.
    pub n: usize,
    /// Seed of the random draws.
    pub seed: u64,
    /// Vehicle documents, used in turn.
    pub vehicles: Vec<String>,
    /// Length of a flight, s.
    pub duration_s: f64,
    /// Folder of the results; a bench that was stopped is resumed there.
    #[schema(value_type = String)]
    pub out: PathBuf,
    /// Only these cases, counted over all presets; unset: all cases and the score.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Span>)]
    pub cases: Option<Range<u64>>,
    /// Number of parallel processes; unset: 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<usize>, minimum = 1)]
    pub processes: Option<NonZeroUsize>,
    /// Keep the generated logs.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub keep_logs: bool,
}
