//! A classifier to train.

use crate::training::{Hyperparameters, Method};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Data sets, at most.
const MOST_SEEDS: u32 = 100;

/// A classifier to train.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize, ToSchema)]
#[schema(as = Training)]
#[serde(deny_unknown_fields)]
pub struct ClassifierSubmission {
    /// Method: inputs and training of the network.
    #[serde(default)]
    pub method: Method,
    /// Name of one of the server's scenarios: vehicle, controller, sensors, detector settings.
    #[serde(default = "reference_flight")]
    pub scenario: String,
    /// Number of data sets (one per seed).
    #[serde(default = "five")]
    #[schema(minimum = 1, maximum = 100)]
    pub seeds: u32,
    /// First seed; the others follow.
    #[serde(default = "one")]
    pub first_seed: u64,
    /// Deviations from the method's training settings.
    #[serde(default, skip_serializing_if = "Hyperparameters::is_empty")]
    pub hyperparameters: Hyperparameters,
    /// From −100 to 100; larger values run first.
    #[serde(default)]
    #[schema(minimum = -100, maximum = 100)]
    pub priority: i64,
}

fn reference_flight() -> String {
    "reference-flight".to_owned()
}

const fn five() -> u32 {
    5
}

const fn one() -> u64 {
    1
}

impl ClassifierSubmission {
    /// Whether its numbers can be, whatever the scenario.
    ///
    /// # Errors
    /// One sentence.
    pub fn check(&self) -> Result<(), String> {
        if !(1..=MOST_SEEDS).contains(&self.seeds) {
            return Err(format!("`seeds` is {}; expected 1 to {MOST_SEEDS}", self.seeds));
        }
        self.hyperparameters
            .check()
            .map_err(|reason| format!("`hyperparameters`: {reason}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_numbers_out_of_range_are_refused_in_one_sentence() {
        let body = |text: &str| serde_json::from_str::<ClassifierSubmission>(text).unwrap().check();
        assert_eq!(body("{}"), Ok(()));
        assert_eq!(
            body(r#"{"seeds":101}"#),
            Err("`seeds` is 101; expected 1 to 100".to_owned())
        );
        assert_eq!(
            body(r#"{"hyperparameters":{"epochs":0}}"#),
            Err("`hyperparameters`: `epochs` is 0; expected 1 to 10000".to_owned())
        );
    }
}
