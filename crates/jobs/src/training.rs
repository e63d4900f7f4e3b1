//! Training of classifiers.

use serde::{Deserialize, Serialize};
use std::num::NonZeroUsize;
use std::path::PathBuf;
use utoipa::ToSchema;

/// Training of a classifier: the same seeds give the same bits.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = TrainingJob)]
pub struct Training {
    /// Inputs and training of the network.
    pub method: Method,
    /// Scenario that gives vehicle, controller, sensors and detector settings.
    #[schema(value_type = String)]
    pub scenario: PathBuf,
    /// Number of data sets (one per seed).
    pub seeds: u32,
    /// First seed; the others follow.
    pub first_seed: u64,
    /// Classifier file to write.
    #[schema(value_type = String)]
    pub out: PathBuf,
    /// Threads; unset: as many as the machine has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<usize>, minimum = 1)]
    pub threads: Option<NonZeroUsize>,
    /// Deviations from the method's training settings.
    #[serde(default, skip_serializing_if = "Hyperparameters::is_empty")]
    pub hyperparameters: Hyperparameters,
}

/// Settings of network and training; unset: defaults of the method.
#[derive(Debug, Default, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Hyperparameters {
    /// Number of epochs.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(minimum = 1, maximum = 10000)]
    pub epochs: Option<u32>,
    /// Hidden neurons, at most three per rotor, the limit of the flight code.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(minimum = 1, maximum = 48)]
    pub hidden: Option<u32>,
    /// Update rule of the weights.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub optimiser: Option<Rule>,
    /// ε, above 0; with Adam the initial one.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(exclusive_minimum = 0.0, maximum = 1.0)]
    pub learning_rate: Option<f64>,
    /// µ of the gradient descent; Adam has none.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(minimum = 0.0, exclusive_maximum = 1.0)]
    pub momentum: Option<f64>,
    /// λ: weight decay.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(minimum = 0.0, maximum = 1.0)]
    pub l2: Option<f64>,
    /// Windows per mini-batch.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(minimum = 1, maximum = 10000)]
    pub batch: Option<u32>,
    /// Seed of split, initial weights and order of the windows; unset: that of the data set.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
}

impl Hyperparameters {
    /// All as the method has them.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// Whether each number can be, whatever the vehicle and the method.
    ///
    /// # Errors
    /// One sentence.
    pub fn check(&self) -> Result<(), String> {
        let counts = [
            ("epochs", self.epochs, 10_000),
            ("hidden", self.hidden, 48),
            ("batch", self.batch, 10_000),
        ];
        for (name, value, most) in counts {
            if let Some(value) = value.filter(|value| !(1..=most).contains(value)) {
                return Err(format!("`{name}` is {value}; expected 1 to {most}"));
            }
        }
        let numbers = [
            (
                "learning_rate",
                self.learning_rate,
                f64::MIN_POSITIVE..=1.0,
                "above 0, and 1 at most",
            ),
            (
                "momentum",
                self.momentum,
                0.0..=1.0 - f64::EPSILON,
                "0 or more, and below 1",
            ),
            ("l2", self.l2, 0.0..=1.0, "0 to 1"),
        ];
        for (name, value, range, words) in numbers {
            if let Some(value) = value.filter(|value| !range.contains(value)) {
                return Err(format!("`{name}` is {value}; expected {words}"));
            }
        }
        if self.optimiser == Some(Rule::Adam) && self.momentum.is_some() {
            return Err("`momentum` is one of sgdm; leave it out with adam".to_owned());
        }
        Ok(())
    }
}

/// Update rule of the weights.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
#[serde(rename_all = "lowercase")]
#[schema(as = OptimiserRule)]
pub enum Rule {
    /// Stochastic gradient descent with momentum, as in the paper.
    Sgdm,
    /// Adam (Kingma and Ba 2015), with a learning rate that falls to 0 as a half cosine.
    Adam,
}

impl Rule {
    /// Name in JSON and on the command line.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Sgdm => "sgdm",
            Self::Adam => "adam",
        }
    }
}

/// What the network reads and how it is trained.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// As in the paper, for scenarios with `nominal_thrust = "static"`.
    #[default]
    Paper,
    /// Rotor lag in the residuals, self-calibrated, Adam; for scenarios with `nominal_thrust = "lagged"`.
    Improved,
}

impl Method {
    /// Name in JSON and on the command line.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Improved => "improved",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_a_job_of_the_version_before_has_no_hyperparameters_and_says_none() {
        let before = r#"{"method":"improved","scenario":"s.toml","seeds":5,"first_seed":7,"out":"c.json"}"#;
        let training: Training = serde_json::from_str(before).expect("still a job");
        assert!(training.hyperparameters.is_empty());
        assert_eq!(serde_json::to_string(&training).expect("JSON"), before);
    }

    #[test]
    fn val_numbers_out_of_range_are_refused_in_one_sentence() {
        for (json, sentence) in [
            (r#"{"epochs":0}"#, "`epochs` is 0; expected 1 to 10000"),
            (
                r#"{"learning_rate":0.0}"#,
                "`learning_rate` is 0; expected above 0, and 1 at most",
            ),
            (
                r#"{"momentum":1.0}"#,
                "`momentum` is 1; expected 0 or more, and below 1",
            ),
            (
                r#"{"optimiser":"adam","momentum":0.5}"#,
                "`momentum` is one of sgdm; leave it out with adam",
            ),
        ] {
            let asked: Hyperparameters = serde_json::from_str(json).expect("known fields");
            assert_eq!(asked.check(), Err(sentence.to_owned()), "{json}");
        }
        let good = r#"{"epochs":3,"hidden":12,"optimiser":"sgdm","learning_rate":0.01,"momentum":0.0,"l2":0.0,"batch":16,"seed":9}"#;
        let asked: Hyperparameters = serde_json::from_str(good).expect("known fields");
        assert_eq!(asked.check(), Ok(()));
        assert!(serde_json::from_str::<Hyperparameters>(r#"{"epoch":3}"#).is_err());
    }
}
