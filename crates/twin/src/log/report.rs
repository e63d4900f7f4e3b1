//! The import report: nothing of an accepted log is dropped silently.

use super::event::FlightEvent;
use super::findings::Finding;
use super::rotor_order::RotorOrder;
use serde::{Deserialize, Serialize};

/// Report of one import.
#[derive(Clone, Debug, Default, Serialize, utoipa::ToSchema)]
pub struct ImportReport {
    /// Number of rows accepted.
    pub rows: usize,
    /// Rows per second where none is missing, Hz.
    pub sample_rate_hz: f64,
    /// Time of the log's own clock (time since boot, as the autopilot's tools show it) at our 0 s; absent if they are
    /// the same, s.
    pub clock_start_s: Option<f64>,
    /// Outputs of the autopilot, from 1, that drive the rotors, in their order; empty if the columns of the file are the rotors.
    pub rotor_outputs: Vec<usize>,
    /// Intervals without rows, longer than [`GAP_FACTOR`] usual intervals.
    pub gaps: Vec<Gap>,
    /// Date of the flight, if the file contains it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub flown: Option<Flown>,
    /// The kind of vehicle, if the log itself states that it is not a multirotor; one clause.
    #[serde(skip)]
    pub other_vehicle: Option<String>,
    /// Whose numbers the rotors have.
    #[serde(skip)]
    pub rotor_order: RotorOrder,
    /// What autopilot and pilot did; listed with the events of the flight.
    #[serde(skip)]
    pub happenings: Vec<FlightEvent>,
    /// How streams of different rates were brought to the time base; empty if the file has one time base.
    pub streams: Vec<Stream>,
    /// Columns that were not numeric or not used, with the reason.
    pub unused_columns: Vec<UnusedColumn>,
    /// Columns that are not canonical; they are kept.
    pub unknown_columns: Vec<String>,
    /// Empty cells per column (only columns that have some).
    pub missing_cells: Vec<MissingCells>,
    /// What is missing, and what cannot be tested without it.
    pub missing: Vec<Missing>,
    /// Estimated delays between columns that are physically coupled; not applied unless stated.
    pub delays: Vec<Delay>,
    /// What looks wrong although it could be read.
    pub findings: Vec<Finding>,
    /// Noise and quantisation of the columns.
    pub noise: Vec<ColumnNoise>,
    /// Conversions that were applied (units, frames, quaternion to Euler angles), in words.
    pub conversions: Vec<String>,
    /// Further notes for the reader of the result.
    pub notes: Vec<String>,
}

/// Calendar time of a log.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(as = LogFlown)]
pub struct Flown {
    /// Seconds since 1970-01-01 UTC at our 0 s.
    pub unix_s: f64,
    /// Its source, in words.
    pub from: String,
}

/// An interval is a gap when it is longer than this many usual intervals.
pub const GAP_FACTOR: f64 = 3.5;

/// An interval without rows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, utoipa::ToSchema)]
#[schema(as = LogGap)]
pub struct Gap {
    /// Last row before it, s.
    pub start_s: f64,
    /// First row after it, s.
    pub end_s: f64,
}

/// One stream of a log with several time bases.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(as = LogStream)]
pub struct Stream {
    /// Topic or message name.
    pub name: String,
    /// Number of samples.
    pub samples: usize,
    /// Median rate, Hz.
    pub sample_rate_hz: f64,
    /// How it was brought to the time base of the log.
    pub resampling: String,
}

/// A column of the file that is not in the log.
#[derive(Clone, Debug, PartialEq, Serialize, utoipa::ToSchema)]
pub struct UnusedColumn {
    /// Name in the file.
    pub column: String,
    /// Why.
    pub reason: String,
}

/// Empty cells of one column.
#[derive(Clone, Debug, PartialEq, Serialize, utoipa::ToSchema)]
pub struct MissingCells {
    /// The column.
    pub column: String,
    /// Cells without a value.
    pub cells: usize,
}

/// A group of columns that the log lacks, and what cannot be tested without it.
#[derive(Clone, Debug, PartialEq, Serialize, utoipa::ToSchema)]
#[schema(as = MissingColumns)]
pub struct Missing {
    /// The columns.
    pub columns: Vec<String>,
    /// What cannot be tested, one clause.
    pub rules_out: String,
}

/// Estimated delay of one signal behind another, physically coupled one.
#[derive(Clone, Debug, PartialEq, Serialize, utoipa::ToSchema)]
#[schema(as = LogDelay)]
pub struct Delay {
    /// Column(s) that are late if the delay is positive.
    pub signal: String,
    /// Signal that it was compared with.
    pub against: String,
    /// Delay of `signal`, s.
    pub delay_s: f64,
    /// Standard error of the delay, s.
    pub uncertainty_s: f64,
    /// Correlation at the delay.
    pub correlation: f64,
    /// True if the signal was shifted by the delay.
    pub applied: bool,
}

/// Noise and resolution of one column.
#[derive(Clone, Debug, PartialEq, Serialize, utoipa::ToSchema)]
pub struct ColumnNoise {
    /// The column.
    pub column: String,
    /// White noise estimated from third differences, unit of the column.
    pub noise: f64,
    /// Smallest step between different values, unit of the column; 0 if it looks continuous.
    pub resolution: f64,
}
