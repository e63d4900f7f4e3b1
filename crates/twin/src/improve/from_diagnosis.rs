//! Effects that a diagnosis found, as terms of a model version with their provenance.
//!
//! Reads the JSON of a diagnosis (`rotortwin diagnose --json`), so that an older file works as well as the latest
//! answer. Faults of sensors and clocks (`sensor_or_timing`) are ignored: they are corrected in the log, not in the
//! model.

use rotortwin_plant::effects::EffectDocument;
use serde_json::Value;

use crate::model::{HeldOut, LogReference, ModelEffect, ModelVersion, Provenance, Source, TOOL};
use crate::propose::Proposal;

/// The missing physics of a diagnosis, in the order in which it was found. `logs` are the logs that it was made from; if empty, the
/// names in the JSON are taken, without hashes.
///
/// # Errors
/// One sentence: the JSON is not that of a diagnosis.
pub fn effects(diagnosis: &Value, logs: &[LogReference]) -> Result<Vec<ModelEffect>, String> {
    let findings = diagnosis["effects"]
        .as_array()
        .ok_or("expected the JSON of a diagnosis, it has no list `effects`")?;
    let logs = references(diagnosis, logs);
    let held_out: Vec<HeldOut> = diagnosis["held_out"]
        .as_array()
        .map_or(&[] as &[Value], Vec::as_slice)
        .iter()
        .filter_map(|entry| {
            Some(HeldOut {
                data: "held-out blocks, all effects found".to_owned(),
                quantity: entry["quantity"].as_str()?.to_owned(),
                unit: entry["unit"].as_str()?.to_owned(),
                before: entry["before"].as_f64()?,
                after: entry["after"].as_f64()?,
            })
        })
        .collect();
    findings
        .iter()
        .enumerate()
        .map(|(place, finding)| {
            let missing = |key: &str| {
                format!("expected the JSON of a diagnosis, `effects[{place}].{key}` is missing or of another kind")
            };
            let mut effect = ModelEffect {
                effect: finding["instance"]["effect"]
                    .as_str()
                    .ok_or_else(|| missing("instance.effect"))?
                    .to_owned(),
                rotor: finding["instance"]["rotor"]
                    .as_u64()
                    .and_then(|rotor| usize::try_from(rotor).ok()),
                onset_s: finding["onset_s"].as_f64(),
                parameters: Default::default(),
                deviations: Default::default(),
                provenance: Provenance {
                    source: Source::Diagnosis,
                    tool: TOOL.to_owned(),
                    ln_bayes_factor: finding["ln_bayes_factor"].as_f64(),
                    posterior: finding["posterior"].as_f64(),
                    log: logs.clone(),
                    held_out: held_out.clone(),
                },
            };
            for parameter in finding["parameters"].as_array().ok_or_else(|| missing("parameters"))? {
                let name = parameter["name"].as_str().ok_or_else(|| missing("parameters[].name"))?;
                let value = parameter["value"]
                    .as_f64()
                    .ok_or_else(|| missing("parameters[].value"))?;
                effect.parameters.insert(name.to_owned(), value);
                if let Some(deviation) = parameter["deviation"].as_f64() {
                    effect.deviations.insert(name.to_owned(), deviation);
                }
            }
            Ok(effect)
        })
        .collect()
}

/// What a version is to get.
#[derive(Debug, Clone, Default)]
pub struct Addition {
    /// Terms of the model.
    pub effects: Vec<ModelEffect>,
    /// Documents of effects that the catalogue lacks.
    pub documents: Vec<EffectDocument>,
    /// A wind of its own for each flight.
    pub own_winds: bool,
}

impl Addition {
    /// One effect.
    pub fn of_one(effect: ModelEffect, documents: Vec<EffectDocument>) -> Self {
        Self {
            effects: vec![effect],
            documents,
            own_winds: false,
        }
    }

    /// What a diagnosis found: the missing physics, and the winds of its flights, unless the last of the versions has these.
    ///
    /// # Errors
    /// One sentence: the JSON is not that of a diagnosis.
    pub fn found(diagnosis: &Value, line: &[ModelVersion]) -> Result<Self, String> {
        Ok(Self {
            effects: effects(diagnosis, &[])?,
            documents: Vec::new(),
            own_winds: has_winds(diagnosis) && line.last().is_some_and(|head| !head.wind_of_each_flight),
        })
    }

    /// What a diagnosis proposes.
    ///
    /// # Errors
    /// As of [`proposal`].
    pub fn proposed(diagnosis: &Value) -> Result<Self, String> {
        let (document, effect) = proposal(diagnosis, &[])?;
        Ok(Self::of_one(effect, vec![document]))
    }

    /// True if a version would get nothing.
    pub fn is_empty(&self) -> bool {
        self.effects.is_empty() && !self.own_winds
    }

    /// The same with one of the effects alone, counted from 1; `option` is what gave the number.
    ///
    /// # Errors
    /// One sentence: there is no such effect.
    pub fn picked(mut self, number: usize, option: &str) -> Result<Self, String> {
        let count = self.effects.len();
        if !(1..=count).contains(&number) {
            return Err(format!("expected {option} from 1 to {count}, got {number}"));
        }
        self.effects = vec![self.effects.swap_remove(number - 1)];
        Ok(self)
    }

    /// The version that follows.
    #[must_use]
    pub fn onto(self, version: &ModelVersion, note: impl Into<String>) -> ModelVersion {
        let next = version.with_effects(self.effects, note).with_documents(&self.documents);
        if self.own_winds { next.with_own_winds() } else { next }
    }
}

fn has_winds(diagnosis: &Value) -> bool {
    diagnosis["winds"].as_array().is_some_and(|winds| !winds.is_empty())
}

/// The proposal of a diagnosis that found its error in no catalogue: an effect of a user, and its term with the fitted factors.
///
/// # Errors
/// One sentence: not a diagnosis, or one that proposes nothing.
pub fn proposal(diagnosis: &Value, logs: &[LogReference]) -> Result<(EffectDocument, ModelEffect), String> {
    let found = diagnosis
        .get("proposal")
        .ok_or("expected the JSON of a diagnosis, it has no key `proposal`")?;
    if found.is_null() {
        return Err("this diagnosis proposes nothing: that is for errors outside of the catalogue".into());
    }
    let found: Proposal = serde_json::from_value(found.clone())
        .map_err(|error| format!("expected the JSON of a diagnosis, in `proposal`: {error}"))?;
    let (Some(document), Some(instance)) = (&found.document, found.instance()) else {
        return Err(format!("this diagnosis proposes no term. {}", found.sentence()));
    };
    let effect = ModelEffect {
        effect: instance.effect,
        rotor: None,
        onset_s: None,
        parameters: instance.parameters,
        deviations: found.terms.iter().map(|t| (t.parameter.clone(), t.deviation)).collect(),
        provenance: Provenance {
            source: Source::Diagnosis,
            tool: TOOL.to_owned(),
            ln_bayes_factor: None,
            posterior: None,
            log: references(diagnosis, logs),
            held_out: Vec::new(),
        },
    };
    Ok((document.clone(), effect))
}

/// Refuses to add the findings of a diagnosis to a model other than the one on which it was made. `line` are the
/// versions from the first to the one being extended. Versions in between may only contain findings of the same
/// diagnosis: its effects may be added one by one.
///
/// # Errors
/// One sentence with both models, or that the JSON does not state its own.
pub fn check_base(diagnosis: &Value, line: &[ModelVersion]) -> Result<(), String> {
    let part = |key: &str| {
        diagnosis["model"][key].as_str().ok_or_else(|| {
            format!(
                "expected the JSON of a diagnosis, it has no `model.{key}`: an older program wrote it; diagnose again"
            )
        })
    };
    let (name, hash) = (part("name")?, part("hash")?);
    let Some(head) = line.last() else {
        return Err("expected a model with a version".into());
    };
    let own = effects(diagnosis, &[])?;
    let only_adds = |base: &ModelVersion| {
        let others = |version: &ModelVersion| -> Vec<ModelEffect> {
            let found = |effect: &ModelEffect| {
                own.iter()
                    .any(|o| o.is_same_term(effect) && o.parameters == effect.parameters)
            };
            version.effect.iter().filter(|effect| !found(effect)).cloned().collect()
        };
        base.vehicle_hash() == head.vehicle_hash()
            && base.effect_document == head.effect_document
            && (base.wind_of_each_flight == head.wind_of_each_flight || has_winds(diagnosis))
            && others(base) == others(head)
    };
    if head.hash() == hash || line.iter().any(|base| base.hash() == hash && only_adds(base)) {
        return Ok(());
    }
    Err(format!(
        "this diagnosis was made on {name} with the content hash {hash}, and {} is at {}: diagnose against that, or add to a branch \
         of the version that was diagnosed",
        head.name,
        head.hash()
    ))
}

/// The given logs, or those that the diagnosis names.
fn references(diagnosis: &Value, logs: &[LogReference]) -> Vec<LogReference> {
    if !logs.is_empty() {
        return logs.to_vec();
    }
    let names = diagnosis["logs"].as_array().map_or(&[] as &[Value], Vec::as_slice);
    let named = names.iter().filter_map(Value::as_str);
    named
        .map(|name| LogReference {
            name: name.to_owned(),
            hash: String::new(),
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn vehicle() -> ModelVersion {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/vehicles/f550.toml");
        ModelVersion::load(path).unwrap()
    }

    fn diagnosis_of(model: &ModelVersion) -> Value {
        let finding = |effect: &str, parameter: &str, value: f64| {
            serde_json::json!({
                "instance": {"effect": effect, "rotor": null}, "onset_s": null, "ln_bayes_factor": 50.0, "posterior": 1.0,
                "parameters": [{"name": parameter, "value": value, "deviation": 0.01}]
            })
        };
        serde_json::json!({
            "model": {"name": model.name, "hash": model.hash()}, "logs": ["a.parquet"], "held_out": [],
            "effects": [finding("mass", "share", 0.1), finding("rotor-drag", "drag_n_s_m", 0.25)]
        })
    }

    #[test]
    fn val_effects_of_one_diagnosis_go_onto_the_model_it_was_made_on_one_by_one() {
        let first = vehicle();
        let json = diagnosis_of(&first);
        let found = effects(&json, &[]).unwrap();
        assert_eq!(check_base(&json, std::slice::from_ref(&first)), Ok(()));
        let second = first.with_effects([found[1].clone()], "");
        assert_eq!(check_base(&json, &[first.clone(), second.clone()]), Ok(()));
        // Something else in between makes it another model.
        let mut by_hand = found[0].clone();
        by_hand.effect = "centre-of-mass".into();
        let third = second.with_effects([by_hand], "");
        let refusal = check_base(&json, &[first.clone(), second, third.clone()]).unwrap_err();
        assert!(
            refusal.contains(&first.hash()) && refusal.contains(&third.hash()),
            "{refusal}"
        );
    }

    #[test]
    fn val_a_diagnosis_of_another_model_is_refused() {
        let first = vehicle();
        let mut other = first.clone();
        other.vehicle.name = "another".into();
        let refusal = check_base(&diagnosis_of(&other), std::slice::from_ref(&first)).unwrap_err();
        assert!(
            refusal.contains(&first.hash()) && refusal.contains(&other.hash()),
            "{refusal}"
        );
        let mut nameless = diagnosis_of(&first);
        nameless.as_object_mut().unwrap().remove("model");
        assert!(check_base(&nameless, &[first]).unwrap_err().contains("`model.name`"));
    }
}
