//! A comparison, diagnosis or improvement to submit.

use super::named::{Flights, ModelChoice};
use crate::kind::JobKind;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// A comparison has at most this many models.
const MOST_MODELS: usize = 16;
/// A submission brings at most this many effects of its own.
const MOST_EFFECTS: usize = 32;

/// A model and the flights to compare it with.
#[derive(Debug, Clone, Default, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct TwinSubmission {
    /// The model.
    pub model: ModelChoice,
    /// Comparison: more models, each compared with the same flights; they follow `model` in the result, in this
    /// order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub more_models: Vec<ModelChoice>,
    /// Flights, all of one vehicle.
    pub flights: Flights,
    /// Diagnosis: your own effects to consider as well (TOML).
    #[serde(default)]
    pub effects: Vec<String>,
    /// Diagnosis: names of the library's effect documents to consider as well.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub library_effects: Vec<String>,
    /// Improvement: held-out flights, not used in any fit.
    #[serde(default)]
    pub held_out: Option<Flights>,
    /// From −100 to 100; larger values run first.
    #[serde(default)]
    #[schema(minimum = -100, maximum = 100)]
    pub priority: i64,
    /// Time limit of an attempt, s of wall time; default 6 h.
    #[serde(default)]
    #[schema(minimum = 1, maximum = 86_400)]
    pub max_wall_s: Option<u64>,
}

impl TwinSubmission {
    /// Whether each of its fields belongs to this kind of job.
    ///
    /// # Errors
    /// One sentence.
    pub fn check_for(&self, kind: JobKind) -> Result<(), String> {
        let effects = self.effects.len() + self.library_effects.len();
        if kind != JobKind::Diagnosis && effects > 0 {
            return Err("`effects` belong to a diagnosis".to_owned());
        }
        if effects > MOST_EFFECTS {
            return Err(format!("{effects} `effects`; expected at most {MOST_EFFECTS}"));
        }
        if kind == JobKind::Improvement && !self.model.is_a_vehicle() && !self.model.is_a_version() {
            return Err(
                "an improvement starts from the nominal model of a vehicle; expected `model: {\"vehicle\": …}`, or a `version` without effects"
                    .to_owned(),
            );
        }
        if kind != JobKind::Comparison && !self.more_models.is_empty() {
            return Err("`more_models` belong to a comparison".to_owned());
        }
        if self.more_models.len() >= MOST_MODELS {
            return Err(format!(
                "{} models; expected at most {MOST_MODELS}",
                1 + self.more_models.len()
            ));
        }
        if kind != JobKind::Comparison && self.model.label()?.is_some() {
            return Err("`label` belongs to a comparison".to_owned());
        }
        if kind != JobKind::Improvement && self.held_out.is_some() {
            return Err("`held_out` belongs to an improvement".to_owned());
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_each_field_belongs_to_its_kind_of_job() {
        let plain = TwinSubmission {
            model: ModelChoice::of_version(String::new()),
            ..TwinSubmission::default()
        };
        let with_effects = TwinSubmission {
            effects: vec![String::new()],
            ..plain.clone()
        };
        let with_models = TwinSubmission {
            more_models: vec![ModelChoice::default()],
            ..plain.clone()
        };
        let held_out = TwinSubmission {
            held_out: Some(Flights::default()),
            ..plain.clone()
        };
        let kinds = [JobKind::Comparison, JobKind::Diagnosis, JobKind::Improvement];
        for (body, fits) in [
            (plain, [true, true, true]),
            (with_effects, [false, true, false]),
            (with_models, [true, false, false]),
            (held_out, [false, false, true]),
        ] {
            assert_eq!(kinds.map(|kind| body.check_for(kind).is_ok()), fits, "{body:?}");
        }
    }
}
