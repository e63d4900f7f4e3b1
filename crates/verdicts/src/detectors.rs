//! Detectors for a user's model.

use rotortwin_plant::error::Refusal;
use rotortwin_scenario::template::{TomlFile, set_value};
use rotortwin_scenario::{Classifier, DetectorSettings, Detectors};
use rotortwin_twin::model::ModelStore;
use std::path::Path;

/// Reference model of the detectors, and their settings.
#[derive(Debug)]
pub struct DetectorChoice<'a> {
    /// Store of model versions.
    pub store: &'a ModelStore,
    /// A vehicle, MODEL, MODEL@BRANCH, MODEL@v2, or a version file.
    pub model: &'a str,
    /// If absent, the network gives no verdict.
    pub classifier: Option<&'a Path>,
    /// `KEY=VALUE` of the `[fdi]` table of scenarios; defaults are those of the classifier's training.
    pub settings: &'a [String],
}

impl DetectorChoice<'_> {
    /// The detectors, and a sentence on the parts of the model that they ignore.
    ///
    /// # Errors
    /// Unknown model, invalid file, or invalid setting.
    pub fn detectors(&self) -> Result<(Detectors, Option<String>), String> {
        let found = self.store.find(self.model);
        let version = found.map_err(|error| error.to_string())?.version;
        let refused = |refusal: Refusal| format!("{}, `{}`: {}", self.model, refusal.key, refusal.reason);
        let vehicle = version.for_detectors().map_err(refused)?;
        let note = (!vehicle.not_carried.is_empty()).then(|| {
            format!(
                "the detectors have no parameter for {} of the model: its effect counts as a disturbance",
                vehicle.not_carried.join(", ")
            )
        });
        let classifier = self.classifier.map(Classifier::read).transpose();
        let classifier = classifier.map_err(|error| error.to_string())?;
        let detectors = Detectors::new(vehicle.documents, &self.parsed_settings()?, classifier).map_err(refused)?;
        Ok((detectors, note))
    }

    fn parsed_settings(&self) -> Result<DetectorSettings, String> {
        let mut table = toml::Table::new();
        for setting in self.settings {
            let refuse = |reason: &str| format!("--set {setting}: {reason}");
            let (key, value) = setting.split_once('=').ok_or_else(|| refuse("expected KEY=VALUE"))?;
            let value = toml::from_str::<toml::Table>(&format!("value = {value}"))
                .ok()
                .and_then(|mut table| table.remove("value"))
                .unwrap_or_else(|| toml::Value::String(value.to_owned()));
            set_value(&mut table, key.trim(), value).map_err(|reason| refuse(&reason))?;
        }
        let text = toml::to_string(&table).map_err(|error| error.to_string())?;
        TomlFile::from_text("--set", &text)
            .and_then(|file| file.parse())
            .map_err(|error| format!("--set, key `{}`: {}", error.key().unwrap_or("?"), error.reason()))
    }
}
