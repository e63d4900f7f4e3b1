//! What changed from one version to another: effects, their parameters, and keys of the vehicle.

use serde::Serialize;

use super::{ModelEffect, ModelVersion};

/// Changes from one version to another.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Difference {
    /// Parameters of effects that appeared, went or changed.
    pub parameters: Vec<ParameterChange>,
    /// Keys of vehicle and blades that changed.
    pub keys: Vec<KeyChange>,
}

/// One parameter of one effect.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ParameterChange {
    /// As in [`ModelEffect::label`].
    pub effect: String,
    /// Name in the catalogue.
    pub parameter: String,
    /// Value and deviation before; absent where the effect or parameter is new.
    pub before: Option<Value>,
    /// Value and deviation after; absent where it went.
    pub after: Option<Value>,
}

/// Value and standard deviation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Value {
    /// In the unit of the catalogue.
    pub value: f64,
    /// 1 sigma; absent where the value is taken as exact.
    pub deviation: Option<f64>,
}

/// One key of the vehicle or of its blades.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct KeyChange {
    /// Dotted path, such as `vehicle.body.mass_kg`.
    pub key: String,
    /// TOML text before; absent where the key is new.
    pub before: Option<String>,
    /// TOML text after; absent where it went.
    pub after: Option<String>,
}

impl Difference {
    /// Changes from `before` to `after`.
    pub fn between(before: &ModelVersion, after: &ModelVersion) -> Self {
        let mut parameters = Vec::new();
        for effect in &before.effect {
            let other = after.effect.iter().find(|other| other.is_same_term(effect));
            collect(Some(effect), other, &mut parameters);
        }
        for effect in &after.effect {
            if !before.effect.iter().any(|other| other.is_same_term(effect)) {
                collect(None, Some(effect), &mut parameters);
            }
        }
        let keys = keys_between(&leaves(before), &leaves(after));
        Self { parameters, keys }
    }

    /// Whether nothing changed that a flight could show.
    pub fn is_empty(&self) -> bool {
        self.parameters.is_empty() && self.keys.is_empty()
    }
}

impl ModelVersion {
    /// True if `next` adds nothing: no value, no key, no document of an effect.
    pub fn has_all_of(&self, next: &Self) -> bool {
        self.effect_document == next.effect_document && Difference::between(self, next).is_empty()
    }
}

fn value(effect: Option<&ModelEffect>, name: &str) -> Option<Value> {
    let effect = effect?;
    Some(Value {
        value: *effect.parameters.get(name)?,
        deviation: effect.deviations.get(name).copied(),
    })
}

fn collect(before: Option<&ModelEffect>, after: Option<&ModelEffect>, changes: &mut Vec<ParameterChange>) {
    let Some(either) = after.or(before) else { return };
    let names: std::collections::BTreeSet<&String> = [before, after]
        .into_iter()
        .flatten()
        .flat_map(|effect| effect.parameters.keys())
        .collect();
    for name in names {
        let change = ParameterChange {
            effect: either.label(),
            parameter: name.clone(),
            before: value(before, name),
            after: value(after, name),
        };
        if change.before != change.after {
            changes.push(change);
        }
    }
    let onset = |effect: Option<&ModelEffect>| {
        effect
            .and_then(|e| e.onset_s)
            .map(|value| Value { value, deviation: None })
    };
    if onset(before) != onset(after) {
        changes.push(ParameterChange {
            effect: either.label(),
            parameter: "onset_s".into(),
            before: onset(before),
            after: onset(after),
        });
    }
}

type Leaves = std::collections::BTreeMap<String, String>;

fn leaves(version: &ModelVersion) -> Leaves {
    let mut found = Leaves::new();
    let tree = toml::Value::try_from(version.documents()).expect("documents hold nothing that TOML cannot");
    walk(&tree, String::new(), &mut found);
    if version.wind_of_each_flight {
        found.insert("wind_of_each_flight".to_owned(), "true".to_owned());
    }
    found
}

fn walk(value: &toml::Value, path: String, found: &mut Leaves) {
    match value {
        toml::Value::Table(table) => {
            for (key, value) in table {
                let path = if path.is_empty() {
                    key.clone()
                } else {
                    format!("{path}.{key}")
                };
                walk(value, path, found);
            }
        }
        leaf => {
            found.insert(path, leaf.to_string());
        }
    }
}

fn keys_between(before: &Leaves, after: &Leaves) -> Vec<KeyChange> {
    let keys: std::collections::BTreeSet<&String> = before.keys().chain(after.keys()).collect();
    keys.into_iter()
        .filter(|key| before.get(*key) != after.get(*key))
        .map(|key| KeyChange {
            key: key.clone(),
            before: before.get(key).cloned(),
            after: after.get(key).cloned(),
        })
        .collect()
}
