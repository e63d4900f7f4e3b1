//! Columns and values of a campaign's table.

use serde::{Deserialize, Serialize};
use std::fmt;

/// Columns that every campaign has; axes must not use their names.
pub const FIXED_COLUMNS: [&str; 16] = [
    "flight",
    "seed",
    "status",
    "reason",
    "run_hash",
    "steps",
    "rotor_count",
    "fault_onset_s",
    "faulty_rotors",
    "onset_loss_share",
    "final_loss_share",
    "thrust_loss_n",
    "thrust_loss_low_n",
    "thrust_loss_high_n",
    "true_thrust_loss_n",
    "record",
];

/// A value in a table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[schema(as = AxisValue)]
#[serde(untagged)]
pub enum Cell {
    /// A whole number.
    Integer(i64),
    /// A number.
    Number(f64),
    /// A string.
    Text(String),
}

impl Cell {
    /// Converts a TOML value to a result: numbers unchanged, everything else as text.
    pub fn from_value(value: &toml::Value) -> Self {
        match value {
            toml::Value::Integer(x) => Self::Integer(*x),
            toml::Value::Float(x) => Self::Number(*x),
            toml::Value::String(text) => Self::Text(text.clone()),
            other => Self::Text(other.to_string()),
        }
    }

    /// Its numeric value, if any.
    pub fn number(&self) -> Option<f64> {
        match self {
            Self::Integer(x) => Some(*x as f64),
            Self::Number(x) => Some(*x),
            Self::Text(_) => None,
        }
    }
}

impl fmt::Display for Cell {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Integer(x) => x.fmt(out),
            Self::Number(x) => x.fmt(out),
            Self::Text(text) => text.fmt(out),
        }
    }
}
