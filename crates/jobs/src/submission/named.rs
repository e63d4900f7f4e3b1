//! The flights and models named in a request.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// A submission names at most this many logs and runs.
const MOST_LOGS: usize = 64;

/// Flights to compare a model with.
#[derive(Debug, Clone, Default, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Flights {
    /// Ids of imported logs; `ID@35:65` takes only these seconds.
    #[serde(default)]
    pub logs: Vec<String>,
    /// Ids of runs that are done; `ID@35:65` takes only these seconds.
    #[serde(default)]
    pub runs: Vec<String>,
}

impl Flights {
    /// Whether there is one, and not too many.
    ///
    /// # Errors
    /// One sentence.
    pub fn check_count(&self) -> Result<(), String> {
        let count = self.logs.len() + self.runs.len();
        if (1..=MOST_LOGS).contains(&count) {
            return Ok(());
        }
        Err(format!(
            "{count} flights in `logs` and `runs`; expected 1 to {MOST_LOGS}"
        ))
    }
}

/// The model.
#[derive(Debug, Clone, Default, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ModelChoice {
    /// Name of one of the server's vehicles: its nominal model.
    #[serde(default)]
    pub vehicle: Option<String>,
    /// Id of an improvement: its final model.
    #[serde(default)]
    pub improvement: Option<String>,
    /// A version of a model, as `rotortwin model export` writes it (TOML).
    #[serde(default)]
    pub version: Option<String>,
    /// Name of a model, under `/api/v1/models`: its version at the head of `main`, or `NAME@v1`, `NAME@BRANCH`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model: Option<String>,
    /// Comparison: label of the model in the result.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(min_length = 1, max_length = 200)]
    pub label: Option<String>,
}

impl ModelChoice {
    /// A version that the client brings.
    pub fn of_version(version: String) -> Self {
        Self {
            version: Some(version),
            ..Self::default()
        }
    }

    /// A model of the server, `NAME`, `NAME@v1` or `NAME@BRANCH`.
    pub fn of_server(name: String) -> Self {
        Self {
            model: Some(name),
            ..Self::default()
        }
    }

    /// The nominal model of a vehicle.
    pub const fn is_a_vehicle(&self) -> bool {
        self.vehicle.is_some()
    }

    /// A version that the client brings.
    pub const fn is_a_version(&self) -> bool {
        self.version.is_some()
    }

    /// What to call it.
    ///
    /// # Errors
    /// One sentence: no name.
    pub fn label(&self) -> Result<Option<&str>, String> {
        let plain = |label: &&str| (1..=200).contains(&label.len()) && !label.chars().any(char::is_control);
        match self.label.as_deref() {
            Some(label) if plain(&label) => Ok(Some(label)),
            Some(_) => Err("`label`: expected 1 to 200 bytes without control characters".to_owned()),
            None => Ok(None),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_flights_are_counted_over_logs_and_runs() {
        let flights = |logs: usize, runs: usize| Flights {
            logs: vec![String::new(); logs],
            runs: vec![String::new(); runs],
        };
        for (logs, runs, fits) in [(0, 0, false), (1, 0, true), (32, 32, true), (32, 33, false)] {
            assert_eq!(flights(logs, runs).check_count().is_ok(), fits, "{logs} {runs}");
        }
    }

    #[test]
    fn val_a_label_is_one_plain_line() {
        let labelled = |label: &str| ModelChoice {
            label: Some(label.to_owned()),
            ..ModelChoice::default()
        };
        assert_eq!(ModelChoice::default().label(), Ok(None));
        assert_eq!(labelled("mine").label(), Ok(Some("mine")));
        for wrong in ["", "a\nb", &"x".repeat(201)] {
            assert!(labelled(wrong).label().is_err(), "{wrong:?}");
        }
    }
}
