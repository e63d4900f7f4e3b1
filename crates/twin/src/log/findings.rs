//! Suspicious features of a log that could be read: named, so that they are not mistaken for missing physics.

use serde::Serialize;
use std::fmt;

/// Something suspicious about a log.
#[derive(Clone, Debug, PartialEq, Serialize, utoipa::ToSchema)]
#[schema(as = LogFinding)]
pub struct Finding {
    /// What it is.
    pub kind: FindingKind,
    /// The evidence, one sentence with figures.
    pub detail: String,
}

impl Finding {
    /// True if a model must not be compared with this log before the finding is resolved.
    pub fn blocks(&self) -> bool {
        self.kind.blocks()
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.kind, self.detail)
    }
}

/// Kinds of suspicion.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
#[schema(as = LogFindingKind)]
pub enum FindingKind {
    /// z of the accelerometer points up (and y is not flipped with it).
    UpsideDownAxes,
    /// Specific force in g.
    AccelInG,
    /// Angles in degrees.
    AnglesInDegrees,
    /// Body rates in degrees per second.
    RatesInDegrees,
    /// Body axes forward, left, up.
    BodyAxesFlu,
    /// World axes east, north, up.
    WorldAxesEnu,
    /// Time stamps wrong by a constant factor.
    TimeScale,
    /// Rows too far apart for any motion of a vehicle.
    SlowRows,
    /// Columns that never change.
    Stuck,
    /// Columns that sit on a limit.
    Saturated,
    /// Nothing but the time, or one column only.
    OneColumn,
    /// A column without any value.
    AllMissing,
    /// Motors idle, on the ground: nothing can be identified.
    NoFlight,
    /// The duties belong to other rotors than the vehicle file says.
    SwappedMotors,
    /// Two body axes are exchanged.
    SwappedAxes,
    /// The vehicle has another number of rotors.
    RotorCount,
    /// A gain between columns that should be 1: a wrong unit.
    ScaleMismatch,
    /// Columns that physics couples move without each other.
    Inconsistent,
}

impl FindingKind {
    /// True if a model must not be compared with a log with this before it is resolved.
    pub fn blocks(&self) -> bool {
        !matches!(self, Self::Stuck | Self::Saturated | Self::AllMissing)
    }
}

impl fmt::Display for FindingKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::UpsideDownAxes => "axes upside down",
            Self::AccelInG => "accelerometer in g",
            Self::AnglesInDegrees => "angles in degrees",
            Self::RatesInDegrees => "rates in degrees per second",
            Self::BodyAxesFlu => "body axes forward-left-up",
            Self::WorldAxesEnu => "world axes east-north-up",
            Self::TimeScale => "time stamps off by a factor",
            Self::SlowRows => "rows too far apart",
            Self::Stuck => "stuck column",
            Self::Saturated => "saturated column",
            Self::OneColumn => "too few columns",
            Self::AllMissing => "empty column",
            Self::NoFlight => "no flight",
            Self::SwappedMotors => "swapped motors",
            Self::SwappedAxes => "swapped axes",
            Self::RotorCount => "rotor count",
            Self::ScaleMismatch => "scales that do not fit",
            Self::Inconsistent => "columns that do not fit",
        })
    }
}
