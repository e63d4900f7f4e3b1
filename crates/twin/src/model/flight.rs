//! A model version in the simulator: its vehicle and effects in the plant of a scenario.

use rotortwin_scenario::{ConfigError, Scenario};

use super::ModelVersion;

impl ModelVersion {
    /// The scenario with this version's vehicle, blades and effects in its plant; effects of the scenario's own stay.
    ///
    /// # Errors
    /// Both together cannot be flown.
    pub fn flown_in(&self, base: &Scenario) -> Result<Scenario, ConfigError> {
        let mut documents = base.documents().clone();
        documents.scenario.effect.extend(self.instances());
        for effect in &self.effect_document {
            if !documents.effects.contains(effect) {
                documents.scenario.effect_files.push(format!("{}.toml", effect.id));
                documents.effects.push(effect.clone());
            }
        }
        documents.vehicle = self.vehicle.clone();
        documents.blades = self.blades.clone();
        Scenario::from_documents(&documents)
    }
}
