//! A diagnosis's answer for one log, reduced to what a score needs.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The verdict line of a diagnosis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// One or more effects are named.
    Named,
    /// Effects are named and others are as compatible with the log.
    Ambiguous,
    /// The model agrees with the log.
    Agrees,
    /// The error is real and not, or not all, in the catalogue.
    Outside,
}

/// A fitted parameter.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Fitted value.
    pub value: f64,
    /// 95 % interval.
    pub low: f64,
    /// 95 % interval.
    pub high: f64,
}

/// An effect that a diagnosis names.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Finding {
    /// Id in the catalogue.
    pub id: String,
    /// Rotor from 1.
    #[serde(default)]
    pub rotor: Option<usize>,
    /// Fitted parameters.
    #[serde(default)]
    pub parameters: BTreeMap<String, Estimate>,
    /// ln Bayes factor.
    #[serde(default)]
    pub evidence: Option<f64>,
    /// Start in mid-flight, s.
    #[serde(default)]
    pub onset_s: Option<f64>,
    /// Ids that cannot be distinguished from it with this log.
    #[serde(default)]
    pub also: Vec<String>,
}

/// An answer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Answer {
    /// Verdict.
    pub verdict: Verdict,
    /// Named effects, the most evident first.
    pub findings: Vec<Finding>,
    /// Smallest size that the log would have shown, by `id/parameter`, or `id:rotor/parameter` where the effect acts on one rotor;
    /// infinite where no size would.
    #[serde(default)]
    pub smallest: BTreeMap<String, f64>,
    /// χ² per residual, before and after the named effects were added.
    #[serde(default)]
    pub chi2: Option<[f64; 2]>,
}
