//! Scenario documents: which vehicle flies what, with which faults, seen by which controller and detector settings.
//!
//! A scenario names its vehicle document, that one its blade document, each by a path relative to itself; it may name a classifier
//! file as well. [`Scenario::load`] reads and checks all as a whole; what it returns can be flown. [`Documents`] is the effective configuration with every default
//! filled in: it serialises to one TOML text that [`Documents::from_toml`] reads back to the same bits.

use std::path::Path;

use rotortwin_flight_core::control::{Controller, ControllerConfigError};
use rotortwin_flight_core::fdi::{FdiConfigError, FdiEngine, SequentialConfigError};
use serde::{Deserialize, Serialize};

use crate::blades::{Blade, BladeSet};
use crate::classifier::Classifier;
use crate::complaints::complaints;
use crate::document::Document;
use crate::effect_check;
use crate::effects::{Catalogue, EffectDocument, EffectInstance};
use crate::environment::WindModel;
use crate::error::{ConfigError, Refusal, in_range};
use crate::faults::{FaultEntry, FaultPlan};
use crate::mismatch::{MismatchModel, Size};
use crate::sensor_faults::{SensorFaultEntry, SensorFaultPlan};
use crate::sensors::SensorModel;
use crate::trajectory::Trajectory;
use crate::vehicle::VehicleModel;
use crate::vehicle_documents::{VehicleDocuments, check_together};
use crate::{nearest_step, simulation};

/// Longest flight, s.
const MAX_DURATION_S: f64 = 86_400.0;

/// A scenario document as written, defaults filled in.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScenarioDocument {
    /// Name shown to people and used for run folders.
    pub name: String,
    /// What the flight shows.
    pub description: String,
    /// Path of the vehicle document, relative to the scenario document.
    pub vehicle: String,
    /// Length of the flight, s; rounded to steps of 2.5 ms.
    pub duration_s: f64,
    /// Seed of every random stream, unless the caller gives another.
    #[serde(default = "first_seed")]
    pub seed: u64,
    /// Runge–Kutta steps per 2.5 ms.
    #[serde(default = "one")]
    pub integrator_substeps: u32,
    /// State at take-over.
    #[serde(default)]
    pub initial: Initial,
    /// What to follow.
    pub trajectory: Trajectory,
    /// Gains of the controller.
    #[serde(default)]
    pub controller: ControllerSettings,
    /// Settings of the detectors.
    #[serde(default)]
    pub fdi: FdiSettings,
    /// How far the true vehicle is from its document.
    #[serde(default)]
    pub mismatch: MismatchModel,
    /// Sensor noise.
    #[serde(default)]
    pub sensors: SensorModel,
    /// Wind; still air if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wind: Option<WindModel>,
    /// Ground; none in reach if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ground: Option<Ground>,
    /// Paths of effect documents whose effects the scenario may name, relative to the scenario document.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub effect_files: Vec<String>,
    /// Effects that the nominal vehicle lacks.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub effect: Vec<EffectInstance>,
    /// Propeller faults and failures.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub fault: Vec<FaultEntry>,
    /// Sensor faults.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sensor_fault: Vec<SensorFaultEntry>,
}

fn first_seed() -> u64 {
    1
}

fn one() -> u32 {
    1
}

/// `[ground]`: where the ground is. Effects feel it; a vehicle still falls through.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ground {
    /// z of the ground, m, NED: 0 is the height of the origin.
    pub down_m: f64,
}

/// `[initial]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Initial {
    /// SoC at the start, fraction.
    pub state_of_charge: f64,
    /// State of the rotors.
    pub start: Start,
}

impl Default for Initial {
    fn default() -> Self {
        Self {
            state_of_charge: 0.9,
            start: Start::Trimmed,
        }
    }
}

/// How a flight begins; always in the air, at rest at the first point of the trajectory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Start {
    /// Rotors at hover thrust, z integrator of the controller preset.
    Trimmed,
    /// Rotors at rest, integrators at 0: the vehicle drops before it climbs.
    MotorsOff,
}

/// `[controller]`: cascaded PID (Table 5); outputs are accelerations.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ControllerSettings {
    /// North: 1/s², 1/s³, 1/s.
    pub position_x: Gains,
    /// East.
    pub position_y: Gains,
    /// Down.
    pub position_z: Gains,
    /// φ: 1/s², 1/s³, 1/s.
    pub roll: Gains,
    /// θ.
    pub pitch: Gains,
    /// ψ.
    pub yaw: Gains,
    /// Largest tilt of the commanded thrust, degrees.
    pub tilt_limit_deg: f64,
    /// How a thrust becomes a duty.
    pub thrust_to_duty: ThrustToDutyMap,
}

impl Default for ControllerSettings {
    /// Table 5; 35° and the linear map, where the paper is silent.
    fn default() -> Self {
        let slow = Gains {
            proportional: 4.98,
            integral: 2.08,
            derivative: 3.90,
        };
        let fast = Gains {
            proportional: 242.0,
            integral: 720.0,
            derivative: 27.0,
        };
        Self {
            position_x: slow,
            position_y: slow,
            position_z: slow,
            roll: fast,
            pitch: fast,
            yaw: slow,
            tilt_limit_deg: 35.0,
            thrust_to_duty: ThrustToDutyMap::Linear,
        }
    }
}

/// Gains of one PID loop.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gains {
    /// K_p, 1/s².
    pub proportional: f64,
    /// K_i, 1/s³.
    pub integral: f64,
    /// K_d, 1/s.
    pub derivative: f64,
}

/// How the controller turns a thrust into a duty.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ThrustToDutyMap {
    /// u = f / `rotors.full_thrust_n`.
    Linear,
    /// Inverse of Eq. 19 at the measured voltage.
    InverseMap,
}

/// `[fdi]`: residual generators and detectors (Table 5).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FdiSettings {
    /// Samples of 2.5 ms per decision.
    pub window_samples: u16,
    /// h of H_i = h I, 1/s.
    pub observer_gain_1_s: f64,
    /// Rotor model of the residual generators.
    pub nominal_thrust: NominalThrustModel,
    /// α_FD of the T-test.
    pub alpha_detect: f64,
    /// α_FDI of the T-test.
    pub alpha_isolate: f64,
    /// Start of the detectors' calibration, s.
    pub calibration_start_s: f64,
    /// End of the calibration, s; verdicts follow.
    pub calibration_end_s: f64,
    /// Classifier file of the network, relative to the scenario document; without one the network gives no verdict.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub network: Option<String>,
}

impl Default for FdiSettings {
    /// Table 5; calibration from 2 s to 10 s.
    fn default() -> Self {
        Self {
            window_samples: 25,
            observer_gain_1_s: 5.0,
            nominal_thrust: NominalThrustModel::Static,
            alpha_detect: 1e-10,
            alpha_isolate: 1e-8,
            calibration_start_s: 2.0,
            calibration_end_s: 10.0,
            network: None,
        }
    }
}

/// The document that holds a refused value.
pub(crate) enum Holder {
    Scenario,
    Vehicle,
}

/// Names the document and the key that a controller is refused for.
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

/// Names the document and the key that detectors are refused for.
pub(crate) fn fdi_refusal(error: &FdiConfigError) -> (Holder, Refusal) {
    let (holder, key, reason) = match error {
        FdiConfigError::Sequential(SequentialConfigError { field, expected }) => {
            let reason = format!("the sequential detector needs it to be {expected}");
            match *field {
                "calibration_start" => (Holder::Scenario, "fdi.calibration_start_s", reason),
                "calibration_end" => (Holder::Scenario, "fdi.calibration_end_s", reason),
                "updates_per_window" => (Holder::Scenario, "fdi.window_samples", reason),
                "rotor_time_constant" => (Holder::Vehicle, "rotors.thrust_lag_s", reason),
                // All other values are constants.
                _ => (Holder::Scenario, "fdi", error.to_string()),
            }
        }
        FdiConfigError::OutOfRange { field, expected } => {
            let reason = format!("the detectors need it to be {expected}");
            match *field {
                "mass" => (Holder::Vehicle, "body.mass_kg", reason),
                "inertia_body" => (Holder::Vehicle, "body.inertia_body_kg_m2", reason),
                "gravity" => (Holder::Vehicle, "body.gravity_m_s2", reason),
                "linear_drag" => (Holder::Vehicle, "body.linear_drag_kg_s", reason),
                "angular_drag" => (Holder::Vehicle, "body.angular_drag_nms", reason),
                "nominal_thrust.time_constant" => (Holder::Vehicle, "rotors.thrust_lag_s", reason),
                "nominal_thrust.full_thrust" => (Holder::Vehicle, "rotors.full_thrust_n", reason),
                "observer_gain" => (Holder::Scenario, "fdi.observer_gain_1_s", reason),
                "window_len" => (Holder::Scenario, "fdi.window_samples", reason),
                "t_test.baseline_start and baseline_end" => (Holder::Scenario, "fdi.calibration_end_s", reason),
                "t_test.alpha_detect and alpha_isolate" => (Holder::Scenario, "fdi.alpha_detect", reason),
                _ => (Holder::Scenario, "fdi", error.to_string()),
            }
        }
        FdiConfigError::NetworkRotorCount { .. } => (Holder::Scenario, "fdi.network", error.to_string()),
    };
    (holder, Refusal::new(key, reason))
}

/// Rotor model of the residual generators.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum NominalThrustModel {
    /// Eq. 19 at once, as in the paper.
    Static,
    /// Eq. 19 through the vehicle's lag.
    Lagged,
    /// `rotors.full_thrust_n` times duty: no battery compensation, as in the paper's ablation.
    Linear,
}

impl NominalThrustModel {
    /// As written in a document.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Static => "static",
            Self::Lagged => "lagged",
            Self::Linear => "linear",
        }
    }
}

impl FdiSettings {
    pub(crate) fn check(&self) -> Result<(), Refusal> {
        in_range("window_samples", f64::from(self.window_samples), 2.0, 1000.0, "")?;
        in_range("observer_gain_1_s", self.observer_gain_1_s, 0.01, 399.0, "1/s")?;
        in_range("alpha_detect", self.alpha_detect, 1e-300, 0.5, "")?;
        in_range("alpha_isolate", self.alpha_isolate, 1e-300, 0.5, "")?;
        in_range("calibration_start_s", self.calibration_start_s, 0.0, 3600.0, "s")?;
        in_range("calibration_end_s", self.calibration_end_s, 0.0, 3600.0, "s")?;
        if nearest_step(self.calibration_end_s) <= nearest_step(self.calibration_start_s) {
            let reason = format!(
                "expected an end of the calibration after its start at {} s, got {} s",
                self.calibration_start_s, self.calibration_end_s
            );
            return Err(Refusal::new("calibration_end_s", reason));
        }
        Ok(())
    }
}

/// The documents that `effect_files` of a scenario names, relative to `directory`.
pub(crate) fn effect_documents(
    scenario: &Document,
    files: &[String],
    directory: &Path,
) -> Result<Vec<EffectDocument>, ConfigError> {
    let read = |(i, path): (usize, &String)| {
        let document = scenario.follow(&format!("effect_files[{i}]"), &directory.join(path))?;
        EffectDocument::from_document(&document)
    };
    files.iter().enumerate().map(read).collect()
}

impl ScenarioDocument {
    /// Length of the flight in steps.
    pub fn duration_steps(&self) -> u64 {
        nearest_step(self.duration_s)
    }

    fn check(&self, vehicle: &VehicleModel) -> Result<(), Refusal> {
        // It becomes the name of a folder.
        let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
        let starts_well = self.name.starts_with(|c: char| c.is_ascii_alphanumeric());
        if self.name.len() > 64 || !starts_well || !self.name.chars().all(plain) {
            let reason = format!(
                "expected a name of 1 to 64 letters, digits, '-', '_' and '.' that begins with a letter or digit, got {:?}",
                self.name
            );
            return Err(Refusal::new("name", reason));
        }
        in_range("duration_s", self.duration_s, crate::STEP_S, MAX_DURATION_S, "s")?;
        in_range(
            "integrator_substeps",
            f64::from(self.integrator_substeps),
            1.0,
            1000.0,
            "",
        )?;
        in_range("initial.state_of_charge", self.initial.state_of_charge, 0.01, 1.0, "")?;
        self.trajectory.check().map_err(|r| r.under("trajectory"))?;
        self.controller.check().map_err(|r| r.under("controller"))?;
        self.fdi.check().map_err(|r| r.under("fdi"))?;
        self.mismatch
            .check(Size::of(vehicle))
            .map_err(|r| r.under("mismatch"))?;
        self.sensors.check().map_err(|r| r.under("sensors"))?;
        if let Some(wind) = &self.wind {
            let drag = vehicle.body.linear_drag_kg_s + self.mismatch.magnitudes(Size::of(vehicle)).linear_drag_kg_s;
            let drag = if self.has_drag_effect() { f64::INFINITY } else { drag };
            wind.check(drag).map_err(|r| r.under("wind"))?;
        }
        if let Some(ground) = &self.ground {
            in_range("ground.down_m", ground.down_m, -10_000.0, 10_000.0, "m")?;
        }
        Ok(())
    }
}

impl ControllerSettings {
    fn check(&self) -> Result<(), Refusal> {
        let loops = [
            ("position_x", &self.position_x),
            ("position_y", &self.position_y),
            ("position_z", &self.position_z),
            ("roll", &self.roll),
            ("pitch", &self.pitch),
            ("yaw", &self.yaw),
        ];
        for (name, gains) in loops {
            in_range(&format!("{name}.proportional"), gains.proportional, 0.0, 1e5, "1/s²")?;
            in_range(&format!("{name}.integral"), gains.integral, 0.0, 1e5, "1/s³")?;
            in_range(&format!("{name}.derivative"), gains.derivative, 0.0, 1e5, "1/s")?;
        }
        in_range("tilt_limit_deg", self.tilt_limit_deg, 1.0, 80.0, "degrees")
    }
}

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
    /// The classifier that `fdi.network` of the scenario names, in full: the path alone would not tell what was flown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub classifier: Option<Classifier>,
    /// The effect documents that `effect_files` of the scenario names, in full.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub effects: Vec<EffectDocument>,
    /// The vehicle that the detectors believe in, where it is another than the one of the scenario's document.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fdi_vehicle: Option<VehicleDocuments>,
}

impl Documents {
    /// One TOML text. Numbers are written so that they read back to the same bits.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("documents hold nothing that TOML cannot")
    }

    /// The classifier is there if and only if the scenario names one, and fits.
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
                "expected this key, as there is a classifier",
            )),
        }
    }

    /// Reads a text of [`Documents::to_toml`]; `name` is what errors call it.
    pub fn from_toml(name: &str, text: &str) -> Result<Self, ConfigError> {
        Document::from_text(name, text)?.parse()
    }
}

/// A scenario that has been checked as a whole and can be flown.
#[derive(Debug, Clone)]
pub struct Scenario {
    documents: Documents,
    pub(crate) fault_plan: FaultPlan,
    pub(crate) sensor_fault_plan: SensorFaultPlan,
    catalogue: Catalogue,
}

impl Scenario {
    /// Reads and checks the scenario at `path` with its vehicle and blades.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, ConfigError> {
        Self::load_with(path, &[])
    }

    /// [`Scenario::load`] with keys of the scenario document set before it is checked: `key=value`, the key a dotted path, the
    /// value in TOML (a bare word counts as text), such as `initial.state_of_charge=0.4`.
    pub fn load_with(path: impl AsRef<Path>, overrides: &[&str]) -> Result<Self, ConfigError> {
        let path = path.as_ref();
        let document = Document::read(path)?;
        let directory = path.parent().unwrap_or(Path::new(""));
        Self::resolve(document.with_overrides(overrides)?, directory, true)
    }

    /// [`Scenario::load`] as if `fdi.network` were absent: for training, which must work without the file that it is to write.
    pub fn load_without_classifier(path: impl AsRef<Path>) -> Result<Self, ConfigError> {
        let path = path.as_ref();
        Self::resolve(Document::read(path)?, path.parent().unwrap_or(Path::new("")), false)
    }

    /// As [`Scenario::load`], from a text; the vehicle's path is relative to `directory`.
    pub fn parse(text: &str, directory: impl AsRef<Path>) -> Result<Self, ConfigError> {
        Self::resolve(Document::from_text("scenario", text)?, directory.as_ref(), true)
    }

    /// All that is wrong with a text that [`Scenario::parse`] refuses; empty: it can be flown.
    pub fn complaints(text: &str, directory: impl AsRef<Path>) -> Vec<ConfigError> {
        const GOOD: &str = include_str!("../../../config/scenarios/reference-flight.toml");
        complaints("scenario", text, GOOD, |text| {
            Self::parse(text, directory.as_ref()).map(|_| ())
        })
    }

    /// Checks documents that are in memory already, such as those of a recorded run.
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

    /// The same scenario with detectors that believe in another vehicle than the one of its document.
    ///
    /// # Errors
    /// The vehicle has another number of rotors, or cannot fly.
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
        let vehicle_path = directory.join(&parsed.vehicle);
        let effect_files = parsed.effect_files;
        let network = parsed.fdi.network.filter(|_| with_classifier);
        let vehicle = scenario.follow("vehicle", &vehicle_path)?;
        let parsed: VehicleModel = vehicle.parse()?;
        let blades_path = vehicle_path
            .parent()
            .unwrap_or(Path::new(""))
            .join(&parsed.rotors.blades);
        let blades = vehicle.follow("rotors.blades", &blades_path)?;
        let classifier = network
            .map(|path| scenario.follow_classifier("fdi.network", &directory.join(path)))
            .transpose()?;
        let effects = effect_documents(&scenario, &effect_files, directory)?;
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
        let fault_plan =
            FaultPlan::new(&document.fault, rotor_count, &documents.blades, nominal, duration_steps).map_err(refuse)?;
        let sensor_fault_plan = SensorFaultPlan::new(&document.sensor_fault, duration_steps).map_err(refuse)?;
        let checked = Self {
            documents,
            fault_plan,
            sensor_fault_plan,
            catalogue,
        };
        simulation::trim(&checked).map_err(refuse)?;
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
        &self.catalogue
    }

    /// What is allowed but most likely not meant, one sentence each.
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
                 (fdi.calibration_end_s): they take what is there until then for healthy",
                fault.rotor, fault.time_s
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

    /// Name shown to people.
    pub fn name(&self) -> &str {
        &self.documents.scenario.name
    }

    /// Seed to use where the caller gives none.
    pub fn seed(&self) -> u64 {
        self.documents.scenario.seed
    }

    /// Length of the flight in steps.
    pub fn duration_steps(&self) -> u64 {
        self.documents.scenario.duration_steps()
    }

    /// Whether rotors and controller start trimmed.
    pub fn starts_trimmed(&self) -> bool {
        self.documents.scenario.initial.start == Start::Trimmed
    }
}
