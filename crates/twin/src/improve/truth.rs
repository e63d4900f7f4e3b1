//! The truth behind a log, if it is known: the oracle that no fit can beat except by chance.

use std::path::Path;

use rotortwin_plant::effects::EffectInstance;
use serde::Deserialize;

use crate::model::{ModelEffect, ModelVersion, Provenance};

/// The model including the truth: a version, a list of effects, or the output of the blind generator.
///
/// # Errors
/// One sentence: not readable, none of these, or an effect that the catalogue rejects.
pub fn truth(path: &Path, model: &ModelVersion) -> Result<ModelVersion, String> {
    let refuse = |reason: String| format!("{}: {reason}", path.display());
    let text = std::fs::read_to_string(path).map_err(|error| refuse(format!("expected a readable file: {error}")))?;
    let bare = ModelVersion::first(model.name.clone(), model.documents());
    let effects: Vec<EffectInstance> = if path.extension().is_some_and(|e| e == "json") {
        let json: serde_json::Value =
            serde_json::from_str(&text).map_err(|error| refuse(format!("expected JSON: {error}")))?;
        let list = json["effects"]
            .as_array()
            .ok_or_else(|| refuse("expected a list `effects`".to_owned()))?;
        list.iter()
            .map(|entry| {
                let mut entry = entry.clone();
                if let Some(id) = entry["id"].as_str().map(str::to_owned)
                    && let Some(object) = entry.as_object_mut()
                {
                    object.remove("id");
                    object.insert("effect".to_owned(), id.into());
                }
                serde_json::from_value(entry).map_err(|error| refuse(format!("in `effects`: {error}")))
            })
            .collect::<Result<_, _>>()?
    } else if text.contains("model_format") {
        return ModelVersion::load(path).map_err(|error| error.to_string());
    } else {
        #[derive(Deserialize)]
        struct File {
            effect: Vec<EffectInstance>,
        }
        let file: File = toml::from_str(&text).map_err(|error| {
            refuse(format!(
                "expected a model version or a list of [[effect]]: {}",
                error.message()
            ))
        })?;
        file.effect
    };
    let effects = effects.into_iter().map(|instance| ModelEffect {
        effect: instance.effect,
        rotor: instance.rotor,
        onset_s: instance.onset_s,
        parameters: instance.parameters,
        deviations: Default::default(),
        provenance: Provenance::by_hand(),
    });
    let version = bare.with_effects(effects, "the truth");
    version
        .check()
        .map_err(|refusal| refuse(format!("key `{}`: {}", refusal.key, refusal.reason)))?;
    Ok(version)
}
