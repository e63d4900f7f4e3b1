//! One identified quantity: value, interval, source.

use crate::Z95;
use crate::model::constants::Source;
use serde::Serialize;

/// A value with its 95 % interval.
#[derive(Debug, Clone, PartialEq, Serialize, utoipa::ToSchema)]
#[schema(as = IdentifiedValue)]
pub struct Estimate {
    /// Key of the vehicle document (`body.mass_kg`), or a name of its own if the document has no key for it.
    pub key: String,
    /// In words.
    pub name: String,
    /// SI unit; empty for a ratio.
    pub unit: &'static str,
    /// Best estimate.
    pub value: f64,
    /// Lower end of the 95 % interval.
    pub low: f64,
    /// Upper end.
    pub high: f64,
    /// Source.
    pub source: Source,
    /// Method, in a few words.
    pub how: String,
    /// How to improve it; empty if not needed.
    pub better: String,
}

impl Estimate {
    /// A value with a deviation.
    pub(crate) fn normal(
        key: &str,
        name: &str,
        unit: &'static str,
        value: f64,
        deviation: f64,
        source: Source,
    ) -> Self {
        Self {
            key: key.to_owned(),
            name: name.to_owned(),
            unit,
            value,
            low: value - Z95 * deviation,
            high: value + Z95 * deviation,
            source,
            how: String::new(),
            better: String::new(),
        }
    }

    /// A positive value with a deviation of its logarithm.
    pub(crate) fn log_normal(
        key: &str,
        name: &str,
        unit: &'static str,
        value: f64,
        log_deviation: f64,
        source: Source,
    ) -> Self {
        let factor = (Z95 * log_deviation).exp();
        Self {
            low: value / factor,
            high: value * factor,
            ..Self::normal(key, name, unit, value, 0.0, source)
        }
    }

    pub(crate) fn how(mut self, text: impl Into<String>) -> Self {
        self.how = text.into();
        self
    }

    pub(crate) fn better(mut self, text: impl Into<String>) -> Self {
        self.better = text.into();
        self
    }
}
