//! Scenarios: vehicle, trajectory, faults, controller and detector settings of a flight.
//!
//! A scenario names its vehicle document, and that its blade document, each by a path relative to itself; it may also name a classifier
//! file. [`Scenario::load`] reads and checks everything as a whole; its result can be flown. [`Documents`] is the effective configuration
//! with all defaults filled in: it serialises to one TOML text that [`Documents::from_toml`] reads back bit-identically.

use std::path::Path;

use rotortwin_flight_core::control::{Controller, ControllerConfig, ControllerConfigError};
use rotortwin_flight_core::fdi::{FdiConfig, FdiEngine};
use rotortwin_flight_core::thrust_map::ThrustMap;
use rotortwin_plant::effects::{Catalogue, EffectDocument};
use rotortwin_plant::error::Refusal;
use rotortwin_plant::powertrain::blades::{Blade, BladeSet};
use rotortwin_plant::powertrain::faults::FaultPlan;
use rotortwin_plant::sensing::faults::SensorFaultPlan;
use rotortwin_plant::trim::trim;
use rotortwin_plant::vehicle::load::LoadPlan;
use rotortwin_plant::vehicle::model::VehicleModel;
use rotortwin_plant::{Simulation, SimulationConfig};
use serde::{Deserialize, Serialize};

use crate::classifier::Classifier;
use crate::complaints::complaints;
use crate::effect_check;
use crate::effect_documents;
use crate::error::ConfigError;
use crate::names::{Kind, meant};
use crate::nominal;
use crate::scenario_document::{ScenarioDocument, Start};
use crate::settings::{Holder, ThrustToDutyMap, fdi_refusal};
use crate::toml_document::Document;
use crate::vehicle_documents::{VehicleDocuments, check_together};

/// The effective configuration: all documents of a scenario, defaults filled in.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Documents {
    /// The scenario.
    pub scenario: ScenarioDocument,
    /// Its vehicle.
    pub vehicle: VehicleModel,
    /// The vehicle's blades.
    pub blades: BladeSet,
    /// The full classifier named by `fdi.network` of the scenario: the path alone would not identify what was flown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub classifier: Option<Classifier>,
    /// The full effect documents listed in `effect_files` of the scenario.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub effects: Vec<EffectDocument>,
    /// The vehicle assumed by the detectors, if it differs from the scenario's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fdi_vehicle: Option<VehicleDocuments>,
}

impl Documents {
    /// One TOML text. Numbers read back bit-identically.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("documents hold nothing that TOML cannot")
    }

    /// The classifier must be present if and only if the scenario names one, and must fit.
    fn check_classifier(&self) -> Result<(), Refusal> {
        let settings = &self.scenario.fdi;
        match (&settings.network, &self.classifier) {
            (None, None) => Ok(()),
            (Some(_), Some(classifier)) => {
                classifier.check().map_err(|refusal| {
                    Refusal::new(
                        "fdi.network",
                        format!("`{}` of the classifier: {}", refusal.key, refusal.reason),
                    )
                })?;
                classifier.check_fits(settings, self.vehicle.rotor_count())
            }
            (Some(_), None) => Err(Refusal::new(
                "fdi.network",
                "expected the classifier with the documents, it is missing",
            )),
            (None, Some(_)) => Err(Refusal::new(
                "fdi.network",
                "expected this key, because there is a classifier",
            )),
        }
    }

    /// Reads a text from [`Documents::to_toml`]; errors refer to it as `name`.
    pub fn from_toml(name: &str, text: &str) -> Result<Self, ConfigError> {
        Document::from_text(name, text)?.parse()
    }
}

/// A scenario that has been checked as a whole and can be flown.
#[derive(Debug, Clone)]
pub struct Scenario {
    documents: Documents,
    simulation: SimulationConfig,
}

impl Scenario {
    /// Reads and checks the scenario at `path` with its vehicle and blades.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, ConfigError> {
        Self::load_with(path, &[])
    }

    /// [`Scenario::load`] with keys of the scenario document overridden before it is checked: `key=value`, the key a dotted path, the
    /// value in TOML (a bare word counts as text), such as `initial.state_of_charge=0.4`.
    pub fn load_with(path: impl AsRef<Path>, overrides: &[&str]) -> Result<Self, ConfigError> {
        let path = path.as_ref();
        let document = Document::read(path)?;
        let directory = path.parent().unwrap_or(Path::new(""));
        Self::resolve(document.with_overrides(overrides)?, directory, true)
    }

    /// [`Scenario::load`] as if `fdi.network` were absent: for training, which must work without the file that it will write.
    pub fn load_without_classifier(path: impl AsRef<Path>) -> Result<Self, ConfigError> {
        let path = path.as_ref();
        Self::resolve(Document::read(path)?, path.parent().unwrap_or(Path::new("")), false)
    }

    /// As [`Scenario::load`], from a text; the vehicle's path is relative to `directory`.
    pub fn parse(text: &str, directory: impl AsRef<Path>) -> Result<Self, ConfigError> {
        Self::resolve(Document::from_text("scenario", text)?, directory.as_ref(), true)
    }

    /// All errors of a text that [`Scenario::parse`] rejects; empty if it can be flown.
    pub fn complaints(text: &str, directory: impl AsRef<Path>) -> Vec<ConfigError> {
        const GOOD: &str = include_str!("../../../config/scenarios/reference-flight.toml");
        complaints("scenario", text, GOOD, |text| {
            Self::parse(text, directory.as_ref()).map(|_| ())
        })
    }

    /// Checks documents already in memory, such as those of a recorded run.
    pub fn from_documents(documents: &Documents) -> Result<Self, ConfigError> {
        let text = |value: Result<String, toml::ser::Error>| value.expect("documents hold nothing that TOML cannot");
        let render = |name: &str, text: String| Document::from_text(name, text);
        let scenario = Self::assemble(
            &render("scenario", text(toml::to_string(&documents.scenario)))?,
            &render("vehicle", text(toml::to_string(&documents.vehicle)))?,
            &render("blades", text(toml::to_string(&documents.blades)))?,
            documents.classifier.clone(),
            documents.effects.clone(),
            true,
        )?;
        match &documents.fdi_vehicle {
            Some(vehicle) => scenario
                .with_fdi_vehicle(vehicle.clone())
                .map_err(|refusal| ConfigError::new("detectors' vehicle", None, Some(refusal.key), refusal.reason)),
            None => Ok(scenario),
        }
    }

    /// The same scenario with detectors that assume a different vehicle.
    ///
    /// # Errors
    /// The vehicle has a different number of rotors, or cannot fly.
    pub fn with_fdi_vehicle(mut self, vehicle: VehicleDocuments) -> Result<Self, Refusal> {
        vehicle.check()?;
        if vehicle.rotor_count() != self.vehicle().rotor_count() {
            let (wanted, found) = (self.vehicle().rotor_count(), vehicle.rotor_count());
            let reason = format!("expected the {wanted} rotors of the scenario's vehicle, got {found}");
            return Err(Refusal::new("vehicle.rotors.layout", reason));
        }
        self.documents.fdi_vehicle = Some(vehicle);
        FdiEngine::new(self.fdi_config()).map_err(|error| Refusal::new("vehicle", error.to_string()))?;
        Ok(self)
    }

    fn resolve(scenario: Document, directory: &Path, with_classifier: bool) -> Result<Self, ConfigError> {
        let parsed: ScenarioDocument = scenario.parse()?;
        let vehicle_path = meant(Kind::Vehicle, directory, &parsed.vehicle);
        let effect_files = parsed.effect_files;
        let network = parsed.fdi.network.filter(|_| with_classifier);
        let vehicle = scenario.follow("vehicle", &vehicle_path)?;
        let parsed: VehicleModel = vehicle.parse()?;
        let beside = vehicle_path.parent().unwrap_or(Path::new(""));
        let blades_path = meant(Kind::Blades, beside, &parsed.rotors.blades);
        let blades = vehicle.follow("rotors.blades", &blades_path)?;
        let classifier = network
            .map(|path| Classifier::named(&scenario, "fdi.network", &meant(Kind::Classifier, directory, &path)))
            .transpose()?;
        let effects = effect_documents::named(&scenario, &effect_files, directory)?;
        Self::assemble(&scenario, &vehicle, &blades, classifier, effects, with_classifier)
    }

    pub(crate) fn assemble(
        scenario: &Document,
        vehicle: &Document,
        blades: &Document,
        classifier: Option<Classifier>,
        effects: Vec<EffectDocument>,
        with_classifier: bool,
    ) -> Result<Self, ConfigError> {
        let mut documents = Documents {
            scenario: scenario.parse()?,
            vehicle: vehicle.parse()?,
            blades: blades.parse()?,
            classifier,
            effects,
            fdi_vehicle: None,
        };
        if !with_classifier {
            documents.scenario.fdi.network = None;
        }
        check_together(&documents.vehicle, vehicle, &documents.blades, blades)?;
        let nominal = &documents.vehicle.rotors.nominal_blade;

        let document = &documents.scenario;
        let refuse = |refusal| scenario.refuse(refusal);
        document.check(&documents.vehicle).map_err(refuse)?;
        documents.check_classifier().map_err(refuse)?;
        let duration_steps = document.duration_steps();
        let rotor_count = documents.vehicle.rotor_count();
        if documents.effects.len() != document.effect_files.len() {
            let reason = "expected the effect documents that this key names with the documents";
            return Err(refuse(Refusal::new("effect_files", reason)));
        }
        let catalogue = Catalogue::with_documents(&documents.effects)
            .map_err(|r| refuse(Refusal::new("effect_files", r.reason)))?;
        effect_check::check(document, &documents.vehicle, &catalogue).map_err(refuse)?;
        let faults =
            FaultPlan::new(&document.fault, rotor_count, &documents.blades, nominal, duration_steps).map_err(refuse)?;
        let loads = LoadPlan::new(&document.load_drop, &documents.vehicle, duration_steps).map_err(refuse)?;
        let sensor_faults = SensorFaultPlan::new(&document.sensor_fault, duration_steps).map_err(refuse)?;
        let simulation = SimulationConfig {
            vehicle: documents.vehicle.clone(),
            nominal_blade: documents.blades.blade[nominal],
            duration_steps,
            integrator_substeps: document.integrator_substeps,
            state_of_charge: document.initial.state_of_charge,
            starts_trimmed: document.initial.start == Start::Trimmed,
            trajectory: document.trajectory.clone(),
            mismatch: document.mismatch.clone(),
            sensors: document.sensors.clone(),
            wind: document.wind.clone(),
            ground_down_m: document.ground.as_ref().map(|ground| ground.down_m),
            ground_contact: document.ground.as_ref().and_then(|ground| ground.contact.clone()),
            starts_on_ground: document.initial.start == Start::OnGround,
            faults,
            loads,
            sensor_faults,
            catalogue,
            effects: document.effect.clone(),
        };
        trim(&simulation).map_err(refuse)?;
        if simulation.ground_contact.is_some() {
            // Without random numbers: whether the vehicle has feet, and stands.
            Simulation::new(&simulation, document.seed).map_err(refuse)?;
        }
        let checked = Self { documents, simulation };
        Controller::new(checked.controller_config()).map_err(|error| match controller_refusal(&error, &checked) {
            (Holder::Vehicle, refusal) => vehicle.refuse(refusal),
            (Holder::Scenario, refusal) => scenario.refuse(refusal),
        })?;
        FdiEngine::new(checked.fdi_config()).map_err(|error| match fdi_refusal(&error) {
            (Holder::Vehicle, refusal) => vehicle.refuse(refusal),
            (Holder::Scenario, refusal) => scenario.refuse(refusal),
        })?;
        Ok(checked)
    }

    /// The effects that the scenario may name.
    pub fn catalogue(&self) -> &Catalogue {
        &self.simulation.catalogue
    }

    /// Valid but probably unintended settings, one sentence each.
    pub fn warnings(&self) -> Vec<String> {
        let document = &self.documents.scenario;
        let end_s = document.fdi.calibration_end_s;
        let mut warnings = Vec::new();
        for (index, fault) in document
            .fault
            .iter()
            .enumerate()
            .filter(|(_, fault)| fault.time_s < end_s)
        {
            warnings.push(format!(
                "fault[{index}].time_s: rotor {} is damaged at {} s, before the calibration of the detectors ends at {end_s} s \
                 (fdi.calibration_end_s): they regard damage present by then as healthy",
                fault.rotor, fault.time_s
            ));
        }
        for (index, drop) in document
            .load_drop
            .iter()
            .enumerate()
            .filter(|(_, drop)| drop.time_s < end_s)
        {
            warnings.push(format!(
                "load_drop[{index}].time_s: a load is dropped at {} s, before the calibration of the detectors ends at {end_s} s \
                 (fdi.calibration_end_s): they calibrate partly with it",
                drop.time_s
            ));
        }
        warnings
    }

    /// The effective configuration.
    pub fn documents(&self) -> &Documents {
        &self.documents
    }

    /// The scenario document, defaults filled in.
    pub fn document(&self) -> &ScenarioDocument {
        &self.documents.scenario
    }

    /// The nominal vehicle.
    pub fn vehicle(&self) -> &VehicleModel {
        &self.documents.vehicle
    }

    /// The blades that rotors can carry.
    pub fn blades(&self) -> &BladeSet {
        &self.documents.blades
    }

    /// The trained classifier of the network, if the scenario names one.
    pub fn classifier(&self) -> Option<&Classifier> {
        self.documents.classifier.as_ref()
    }

    /// The blade of a healthy rotor.
    pub fn nominal_blade(&self) -> &Blade {
        &self.documents.blades.blade[&self.documents.vehicle.rotors.nominal_blade]
    }

    /// Display name.
    pub fn name(&self) -> &str {
        &self.documents.scenario.name
    }

    /// Default seed.
    pub fn seed(&self) -> u64 {
        self.documents.scenario.seed
    }

    /// Length of the flight in steps.
    pub fn duration_steps(&self) -> u64 {
        self.documents.scenario.duration_steps()
    }

    /// Whether rotors and controller start trimmed.
    pub fn starts_trimmed(&self) -> bool {
        self.simulation.starts_trimmed
    }

    /// The flight without its documents.
    pub fn simulation_config(&self) -> &SimulationConfig {
        &self.simulation
    }

    /// The flight with the random numbers of `seed`, at step 0.
    ///
    /// # Errors
    /// The effects yield an invalid configuration of the vehicle drawn by this seed.
    pub fn simulation(&self, seed: u64) -> Result<Simulation, ConfigError> {
        Simulation::new(&self.simulation, seed)
            .map_err(|refusal| ConfigError::new(self.name(), None, Some(refusal.key), refusal.reason))
    }

    /// Eq. 19 of the nominal blade.
    pub fn thrust_map(&self) -> ThrustMap {
        nominal::thrust_map(self.nominal_blade())
    }

    /// Configuration of `flight-core`'s controller for the nominal vehicle.
    pub fn controller_config(&self) -> ControllerConfig {
        nominal::controller_config(self.vehicle(), self.nominal_blade(), &self.document().controller)
    }

    /// Configuration of `flight-core`'s detectors for the nominal vehicle, or for that of [`Scenario::with_fdi_vehicle`].
    pub fn fdi_config(&self) -> FdiConfig {
        let own = self.documents().fdi_vehicle.as_ref();
        let (vehicle, blade) = own.map_or((self.vehicle(), self.nominal_blade()), |own| {
            (&own.vehicle, own.nominal_blade())
        });
        nominal::fdi_config(vehicle, blade, &self.document().fdi, self.classifier())
    }
}

/// Maps a controller's rejection to the document and key responsible.
fn controller_refusal(error: &ControllerConfigError, scenario: &Scenario) -> (Holder, Refusal) {
    let linear = scenario.document().controller.thrust_to_duty == ThrustToDutyMap::Linear;
    match error {
        ControllerConfigError::HoverOutOfReach { .. } if linear => {
            let vehicle = scenario.vehicle();
            let mean = vehicle.body.mass_kg * vehicle.body.gravity_m_s2 / vehicle.rotor_count() as f64;
            let reason = format!(
                "expected more than any rotor gives in hover ({mean:.3} N in the mean), got {} N: {error}",
                vehicle.rotors.full_thrust_n
            );
            (Holder::Vehicle, Refusal::new("rotors.full_thrust_n", reason))
        }
        _ => (Holder::Scenario, Refusal::new("controller", error.to_string())),
    }
}
