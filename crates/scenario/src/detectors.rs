//! Detectors without a scenario, for flights flown elsewhere.
//!
//! ```text
//!  vehicle, blades ──┐
//!  [fdi] settings  ──┼─▶ Detectors (checked together) ─▶ FdiConfig ─▶ flight-core's engine
//!  classifier      ──┘
//! ```
//! The same checks and numbers as in a [`Scenario`](crate::Scenario) with this vehicle, `[fdi]` table and classifier, so that the engine
//! gives bit-identical results for the same measurements.

use rotortwin_flight_core::fdi::{FdiConfig, FdiEngine};
use serde::{Deserialize, Serialize};

use crate::classifier::Classifier;
use crate::nominal::fdi_config;
use crate::settings::{FdiSettings, Holder, NominalThrustModel, fdi_refusal};
use crate::vehicle_documents::VehicleDocuments;
use rotortwin_plant::error::Refusal;

/// The `[fdi]` table of a scenario, every key optional. Missing keys default to the classifier's training, otherwise to a scenario's
/// defaults.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DetectorSettings {
    /// Samples of 2.5 ms per decision.
    pub window_samples: Option<u16>,
    /// h of H_i = h I, 1/s.
    pub observer_gain_1_s: Option<f64>,
    /// Rotor model of the residual generators.
    pub nominal_thrust: Option<NominalThrustModel>,
    /// α_FD of the T-test.
    pub alpha_detect: Option<f64>,
    /// α_FDI of the T-test.
    pub alpha_isolate: Option<f64>,
    /// Start of the calibration, s.
    pub calibration_start_s: Option<f64>,
    /// End of the calibration, s; verdicts follow.
    pub calibration_end_s: Option<f64>,
}

impl DetectorSettings {
    /// The settings in effect.
    pub fn or_trained(&self, classifier: Option<&Classifier>) -> FdiSettings {
        let standard = FdiSettings::default();
        let trained = classifier.map(|classifier| &classifier.inputs);
        FdiSettings {
            window_samples: self
                .window_samples
                .or(trained.map(|inputs| inputs.window_samples))
                .unwrap_or(standard.window_samples),
            observer_gain_1_s: self
                .observer_gain_1_s
                .or(trained.map(|inputs| inputs.observer_gain_1_s))
                .unwrap_or(standard.observer_gain_1_s),
            nominal_thrust: self
                .nominal_thrust
                .or(trained.map(|inputs| inputs.nominal_thrust))
                .unwrap_or(standard.nominal_thrust),
            alpha_detect: self.alpha_detect.unwrap_or(standard.alpha_detect),
            alpha_isolate: self.alpha_isolate.unwrap_or(standard.alpha_isolate),
            calibration_start_s: self.calibration_start_s.unwrap_or(standard.calibration_start_s),
            calibration_end_s: self.calibration_end_s.unwrap_or(standard.calibration_end_s),
            network: None,
        }
    }
}

/// Detectors for a vehicle; checked as a whole.
#[derive(Debug, Clone)]
pub struct Detectors {
    vehicle: VehicleDocuments,
    settings: FdiSettings,
    classifier: Option<Classifier>,
    config: FdiConfig,
}

impl Detectors {
    /// * `vehicle`: the healthy one, with its blades   * `classifier`: if absent, the network gives no verdict
    ///
    /// # Errors
    /// The key (`vehicle.…`, `fdi.…`) and what was expected.
    pub fn new(
        vehicle: VehicleDocuments,
        settings: &DetectorSettings,
        classifier: Option<Classifier>,
    ) -> Result<Self, Refusal> {
        vehicle.check()?;
        let settings = settings.or_trained(classifier.as_ref());
        settings.check().map_err(|refusal| refusal.under("fdi"))?;
        if let Some(classifier) = &classifier {
            classifier.check().map_err(|refusal| refusal.under("classifier"))?;
            classifier.check_fits(&settings, vehicle.rotor_count())?;
        }
        let config = fdi_config(
            &vehicle.vehicle,
            vehicle.nominal_blade(),
            &settings,
            classifier.as_ref(),
        );
        FdiEngine::new(config).map_err(|error| match fdi_refusal(&error) {
            (Holder::Vehicle, refusal) => refusal.under("vehicle"),
            (Holder::Scenario, refusal) => refusal,
        })?;
        Ok(Self {
            vehicle,
            settings,
            classifier,
            config,
        })
    }

    /// Configuration of the engine.
    pub fn config(&self) -> &FdiConfig {
        &self.config
    }

    /// The vehicle that the detectors assume.
    pub fn vehicle(&self) -> &VehicleDocuments {
        &self.vehicle
    }

    /// Every setting in effect.
    pub fn settings(&self) -> &FdiSettings {
        &self.settings
    }

    /// The classifier of the network.
    pub fn classifier(&self) -> Option<&Classifier> {
        self.classifier.as_ref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Scenario;
    use std::path::{Path, PathBuf};

    fn config(name: &str) -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config").join(name)
    }

    fn f550() -> VehicleDocuments {
        VehicleDocuments::load(config("vehicles/f550.toml")).expect("a good vehicle")
    }

    fn classifier(name: &str) -> Classifier {
        Classifier::read(&config(&format!("classifiers/{name}.json"))).expect("a good classifier")
    }

    #[test]
    fn val_same_numbers_as_a_scenario() {
        for (scenario, name) in [("lag-aware-reference-flight", Some("f550-improved")), ("hover", None)] {
            let flown = Scenario::load(config(&format!("scenarios/{scenario}.toml"))).expect("a good scenario");
            assert_eq!(flown.classifier().is_some(), name.is_some(), "{scenario}");
            let fdi = &flown.document().fdi;
            let settings = DetectorSettings {
                calibration_end_s: Some(fdi.calibration_end_s),
                ..DetectorSettings::default()
            };
            let detectors = Detectors::new(f550(), &settings, name.map(classifier)).expect("they fit");
            assert_eq!(*detectors.config(), flown.fdi_config(), "{scenario}");
        }
    }

    #[test]
    fn val_refusals_name_the_key() {
        let settings = |json: &str| serde_json::from_str::<DetectorSettings>(json).expect("settings");
        let refused = |vehicle: VehicleDocuments, json: &str, name: Option<&str>| {
            Detectors::new(vehicle, &settings(json), name.map(classifier))
                .map(|_| ())
                .expect_err("a refusal")
        };
        let end = refused(f550(), r#"{"calibration_end_s": 1.0}"#, None);
        assert_eq!(end.key, "fdi.calibration_end_s", "{}", end.reason);
        let unfit = refused(f550(), r#"{"nominal_thrust": "static"}"#, Some("f550-improved"));
        assert_eq!(unfit.key, "fdi.network");
        assert!(unfit.reason.contains("lagged"), "{}", unfit.reason);
        let quad = VehicleDocuments::load(config("vehicles/quad-x.toml")).expect("a good vehicle");
        assert!(refused(quad, "{}", Some("f550-paper")).reason.contains("6 rotors"));
        let mut heavy = f550();
        heavy.vehicle.body.mass_kg = -1.0;
        assert_eq!(refused(heavy, "{}", None).key, "vehicle.body.mass_kg");
    }
}
