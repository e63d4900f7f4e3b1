//! Blind benches: logs with hidden effects from an independent simulator, each diagnosed, and the answers scored.

use crate::span::Span;
use rotortwin_blind::bench::cases::Preset;
use serde::{Deserialize, Serialize};
use std::num::NonZeroUsize;
use std::ops::Range;
use std::path::PathBuf;
use utoipa::ToSchema;

/// A blind bench, or some of its cases. What its folder holds already is not done again: over the rows of all parts it only makes the score.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = BlindBenchJob)]
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
    /// Folder of the results; a bench that was stopped is continued there.
    #[schema(value_type = String)]
    pub out: PathBuf,
    /// Only these cases, counted over all presets; unset: all, and the score.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Span>)]
    pub cases: Option<Range<u64>>,
    /// Processes at a time; unset: 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<usize>, minimum = 1)]
    pub processes: Option<NonZeroUsize>,
    /// Keep the generated logs.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub keep_logs: bool,
}
