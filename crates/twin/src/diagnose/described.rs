//! What is left over of a channel, as a diagnosis gives it.

use serde::Serialize;
use utoipa::ToSchema;

/// What is left of one channel of a log.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
#[schema(as = DiagnosisRemainder)]
pub struct Remainder {
    /// Log.
    pub log: String,
    /// Channel: `fx`.
    pub channel: String,
    /// What is off by it, in words; of a derivative, the column itself.
    pub what: String,
    /// Unit of the sizes.
    pub unit: String,
    /// Root mean square, in the frequencies of `band` where there is one.
    pub size: f64,
    /// What noise leaves there.
    pub noise: f64,
    /// Frequencies that hold most of what is more than noise; absent if it has none of its own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub band: Option<FrequencyBand>,
    /// A periodic error.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub line: Option<Line>,
    /// Frequency above which there is less than noise, Hz: a column that was low-passed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub quiet_above_hz: Option<f64>,
    /// Time over which it stays alike, s; absent if samples differ as noise does.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub correlation_s: Option<f64>,
    /// When it changes, if it does so once.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub onset: Option<RemainderOnset>,
    /// The signal that it follows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub follows: Option<Follows>,
    /// The signal with which its size grows or shrinks.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub size_follows: Option<Follows>,
    /// All of it in a sentence.
    pub sentence: String,
}

/// Frequencies, Hz.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
#[schema(as = RemainderBand)]
pub struct FrequencyBand {
    /// From; 0 for everything slower.
    pub low_hz: f64,
    /// To.
    pub high_hz: f64,
    /// True if it is alike at all frequencies, as more noise of the sensor would be.
    pub flat: bool,
}

/// A periodic error.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
#[schema(as = RemainderLine)]
pub struct Line {
    /// Hz.
    pub hz: f64,
    /// Width at half its height, Hz.
    pub width_hz: f64,
}

/// A single change in time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
pub struct RemainderOnset {
    /// When, s of the log.
    pub at_s: f64,
    /// True for a step of the mean; false for one of the size.
    pub of_mean: bool,
    /// Mean or root mean square before.
    pub before: f64,
    /// And after.
    pub after: f64,
    /// Unit of both.
    pub unit: &'static str,
}

/// A signal and how much of the error it explains.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
#[schema(as = RemainderFollows)]
pub struct Follows {
    /// In words.
    pub signal: String,
    /// Share of its square that a straight line over the signal explains on blocks that its fit did not see.
    pub r_squared: f64,
    /// Of the rate of change of what the model predicts: by how much the column is late, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub late_s: Option<f64>,
}
